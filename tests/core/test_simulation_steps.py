"""A feedforward that changes between two samples, and sub-steps fit for a law's poles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.simulation import (
    Cases,
    CommandSteps,
    KnownPoles,
    SampledReference,
    Simulator,
    Thruster,
)
from hillsphere.symbolic import Expr, Params

PERIOD, KP, KD = 60.0, 1e-4, 0.012
SHARES = np.array([0.25, 0.5, 0.25])


class Line:
    """A double integrator with a ground at x = 0."""

    frame = "toy:line"
    states = (Variable("x", 1), Variable("v", 1, -1))
    controls = (Variable("a", 1, -2),)
    scales = Scales(10.0, 10.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": x[0]}


class Held:
    """u = Kp (r − y) + Kd (ṙ − ẏ) of the line, held or as an impulse."""

    period_s = PERIOD

    def __init__(self, actuation: Literal["hold", "impulse"] = "hold") -> None:
        self.actuation = actuation

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        gap = ref - y
        return KP * gap[:1] + KD * gap[1:], xc


class Filtered:
    """The same through a filter of every error, between samples too."""

    period_s = PERIOD
    measurement: Literal["held", "continuous"] = "held"
    inputs = 2
    states = (Variable("toy:f0"), Variable("toy:f1"))

    def __init__(self, corner: float = 0.05) -> None:
        self.fastest_rad_s = corner

    def initial(self, n_cases: int) -> Array:
        return np.zeros((2, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        return tuple(self.fastest_rad_s * (r - s - f) for f, s, r in zip(xc, y, ref, strict=True))

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        return (KP * xc[0] + KD * xc[1],)


def stepped(samples: int, seed: int = 1) -> list[CommandSteps]:
    """Return steps of a command, of three lengths, that differ from sample to sample."""
    random = np.random.default_rng(seed)
    return [CommandSteps(SHARES, 1e-3 * random.normal(size=(3, 1, 1))) for _ in range(samples)]


def table(samples: int) -> Array:
    return np.array([np.linspace(500.0, 520.0, samples), np.zeros(samples)])


def test_steps_of_a_held_command_are_flown_exactly() -> None:
    samples, steps = 5, stepped(5)
    goal = table(samples)
    x0 = np.array([[480.0, 510.0], [0.1, -0.2]])
    gain = np.full((1, 1, 2), 0.9)
    reference = SampledReference(goal, steps=steps)
    loop = Simulator(Line(), Held(), reference=reference)
    found = loop.fly(Cases(x0, gain=gain), samples, history=True)
    for lane in range(2):
        (x, v), dv = x0[:, lane], 0.0
        for k in range(samples):
            own = KP * (goal[0, k] - x) + KD * (goal[1, k] - v)
            assert found.history is not None
            assert_allclose(found.history.own[0, k, lane], own, rtol=1e-9)
            assert_allclose(found.history.dv_m_s[k, lane], dv, rtol=1e-12, atol=1e-15)
            for share, feed in zip(SHARES, steps[k].u[:, 0, 0], strict=True):
                # the errors of the actuator are those of the whole command
                h, a = share * PERIOD, 0.9 * (own + feed)
                x, v, dv = x + h * v + 0.5 * h * h * a, v + h * a, dv + h * abs(a)
        assert_allclose(found.x[:, lane], [x, v], rtol=1e-12)
        assert_allclose(found.dv_m_s[lane], dv, rtol=1e-12)
    assert_array_equal(found.time_s, samples * PERIOD)
    # More sub-steps change nothing of a polynomial; equal steps nothing of what is held.
    finer = Simulator(Line(), Held(), reference=reference, substeps=7)
    assert_allclose(finer.fly(Cases(x0, gain=gain), samples).x, found.x, rtol=1e-12)
    even = [CommandSteps(SHARES, np.repeat(one.u[:1], 3, axis=0)) for one in steps]
    held = np.array([[one.u[0, 0, 0] for one in steps]])
    assert_allclose(
        Simulator(Line(), Held(), reference=SampledReference(goal, steps=even))
        .fly(Cases(x0), samples).x,
        Simulator(Line(), Held(), reference=SampledReference(goal, held)).fly(Cases(x0), samples).x,
        rtol=1e-13,
    )  # fmt: skip


def test_steps_reach_a_continuous_law() -> None:
    samples, steps, law = 4, stepped(4, 2), Filtered()
    goal = table(samples)
    x0 = np.array([[470.0], [0.3]])
    gain = np.full((1, 1, 1), 1.1)
    loop = Simulator(Line(), law, reference=SampledReference(goal, steps=steps), substeps=24)
    found = loop.fly(Cases(x0, gain=gain), samples, history=True)
    # states x, v, two filters; inputs the held errors and the feedforward
    w = law.fastest_rad_s
    a = np.zeros((7, 7))
    a[0, 1], a[1, 2:4], a[1, 6] = 1.0, 1.1 * np.array([KP, KD]), 1.1
    a[2, [2, 4]], a[3, [3, 5]] = (-w, w), (-w, w)
    y, filters = x0[:, 0], np.zeros(2)
    for k in range(samples):
        own = KP * filters[0] + KD * filters[1]
        assert found.history is not None
        assert_allclose(found.history.own[0, k, 0], own, rtol=1e-8, atol=1e-15)
        assert_allclose(found.history.u[0, k, 0], own + steps[k].u[0, 0, 0], rtol=1e-8)
        held = goal[:, k] - y
        for share, feed in zip(SHARES, steps[k].u[:, 0, 0], strict=True):
            z = expm(a * share * PERIOD) @ np.concatenate([y, filters, held, [feed]])
            y, filters = z[:2], z[2:4]
    assert_allclose(found.x[:, 0], y, rtol=1e-9)


def test_a_flight_ends_within_a_later_step() -> None:
    """Free fall from rest begins at the second step; the third would catch it."""
    steps = [CommandSteps(SHARES, np.array([0.0, -1.0, 50.0]).reshape(3, 1, 1))] * 2

    class Idle(Held):
        def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
            return 0.0 * y[:1], xc

    loop = Simulator(Line(), Idle(), reference=SampledReference(np.zeros((2, 2)), steps=steps))
    # From 200 m it takes 20 s of the 30; from 500 m it is caught.
    found = loop.fly(Cases(np.array([[200.0, 500.0, 900.0], [0.0, 0.0, 0.0]])), 1)
    assert found.status == ("impact", "completed", "completed")
    assert_allclose(found.time_s, [35.0, 60.0, 60.0], rtol=1e-12)
    assert_allclose(found.dv_m_s, [20.0, 30.0 + 750.0, 780.0], rtol=1e-12)
    assert_allclose(found.x[:, 0], [0.0, -20.0], rtol=0, atol=1e-9)
    limited = loop.fly(Cases(np.array([[900.0], [0.0]]), dv_budget_m_s=31.0), 2)
    assert limited.status == ("propellant",)
    assert_allclose(limited.time_s, [45.0 + 1.0 / 50.0], rtol=1e-12)
    assert_array_equal(limited.firings, [1])


def test_errors_of_an_actuator_last_the_whole_period() -> None:
    samples, noisy = 3, Thruster(magnitude_sigma=0.1, dimension=1)
    steps = [CommandSteps(SHARES, np.array([1.0, 2.0, -1.0]).reshape(3, 1, 1))] * samples
    loop = Simulator(
        Line(), Held("hold"), actuator=noisy, reference=SampledReference(table(3), steps=steps)
    )
    found = loop.fly(Cases(np.array([[5000.0], [0.0]])), samples, seed=3, history=True)
    assert found.history is not None
    x, v = 5000.0, 0.0
    for k in range(samples):
        own = found.history.own[0, k, 0]
        factor = found.history.u[0, k, 0] / (own + 1.0)
        assert abs(factor - 1.0) > 1e-3
        for share, feed in zip(SHARES, (1.0, 2.0, -1.0), strict=True):
            h, a = share * PERIOD, factor * (own + feed)
            x, v = x + h * v + 0.5 * h * h * a, v + h * a
    assert_allclose(found.x[:, 0], [x, v], rtol=1e-11)


def test_a_tolerance_holds_in_every_step() -> None:
    steps = stepped(3, 5)
    reference = SampledReference(table(3), steps=steps)
    coarse = Simulator(Line(), Filtered(0.5), reference=reference, tolerance=1e-9)
    fine = Simulator(Line(), Filtered(0.5), reference=reference, substeps=400)
    x0 = np.array([[490.0], [0.0]])
    found, wanted = (one.fly(Cases(x0), 3) for one in (coarse, fine))
    assert found.status == ("completed",)
    assert_allclose(found.x, wanted.x, rtol=0, atol=1e-7)


@pytest.mark.parametrize(("method", "most_s"), [("rk6", 1.07), ("dop853", 3.5)])
def test_sub_steps_fit_the_poles_of_a_law(method: str, most_s: float) -> None:
    law = Filtered(2 * np.pi * 0.05)
    assert isinstance(law, KnownPoles)
    least = int(np.ceil(law.fastest_rad_s * PERIOD / most_s))
    Simulator(Line(), law, method=method, substeps=least)
    with pytest.raises(InputError, match=rf"at least {least} of them; got {least - 1}"):
        Simulator(Line(), law, method=method, substeps=least - 1)
    Simulator(Line(), law, method=method, substeps=1, tolerance=1e-9)


@pytest.mark.parametrize(
    ("shares", "shape"),
    [([0.5, 0.6], (2, 1, 1)), ([1.0, 0.0], (2, 1, 1)), ([1.0], (2, 1, 1)), ([1.0], (1, 1))],
)
def test_steps_that_do_not_fit(shares: list[float], shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="shares \\(J,\\) of a command"):
        CommandSteps(np.array(shares), np.zeros(shape))


def test_what_cannot_take_steps() -> None:
    steps: Any = stepped(2)
    loop = Simulator(Line(), Held("impulse"), reference=SampledReference(table(2), steps=steps))
    with pytest.raises(InputError, match="an impulse cannot do that"):
        loop.fly(Cases(np.ones((2, 1))), 1)
    with pytest.raises(InputError, match="not both"):
        SampledReference(table(2), np.zeros((1, 2)), steps)
    short = Simulator(Line(), Held(), reference=SampledReference(table(3), steps=steps))
    with pytest.raises(InputError, match="steps has 2 samples, but sample 2"):
        short.fly(Cases(np.full((2, 1), 500.0)), 3)
