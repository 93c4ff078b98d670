"""The closed loop on plants and laws of a third party: exact solutions and SciPy beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers, Parameter, Scales, Variable
from hillsphere.products import load_product, save_product
from hillsphere.simulation import (
    Cases,
    FixedReference,
    PhaseReference,
    SampledReference,
    Simulator,
    Thruster,
    simulate,
)
from hillsphere.symbolic import Expr, Params, dot, power, variable

GM, RADIUS, PERIOD = 7.0e5, 12e3, 60.0
POSITIONS = tuple(Variable(n, 1) for n in ("x", "y", "z"))
VELOCITIES = tuple(Variable(n, 1, -1) for n in ("vx", "vy", "vz"))
CONTROLS = tuple(Variable(n, 1, -2) for n in ("ax", "ay", "az"))
START = np.array([20e3, 0.0, 1e3, 0.0, 5.0, 0.0])
TARGET = np.array([20e3, 50.0, 0.0, 0.0, 0.0, 0.0])
KP, KD = 2e-5, 6e-3


class Central:
    """Attraction of a point, and a push that grows with time so that the clock matters."""

    frame = "hill:toy"
    states = POSITIONS + VELOCITIES
    controls = CONTROLS
    scales = Scales(20e3, 1e3)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"), Parameter("push", 1e-8, "m/s3"))

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        pull = -p["gm"] * power(dot(x[:3], x[:3]), -1.5)
        ax, ay, az = (pull * q + a for q, a in zip(x[:3], u, strict=True))
        return (*x[3:], ax, ay + p["push"] * t, az)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": dot(x[:3], x[:3]) / RADIUS**2 - 1.0}


class TabulatedCentral(Central):
    """The same attraction as a function of arrays."""

    external = tuple(Variable(f"toy:g{i}", 1, -2) for i in "xyz")

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        ax, ay, az = (variable(v.name) + a for v, a in zip(self.external, u, strict=True))
        return (*x[3:], ax, ay + p["push"] * t, az)

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        return np.asarray(-p[0] * x[:3] / np.sum(x[:3] ** 2, axis=0) ** 1.5)

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        raise AssertionError("no derivatives are needed")


class Free:
    """A double integrator on one axis."""

    frame = "hill:toy"
    states = (POSITIONS[0], VELOCITIES[0])
    controls = CONTROLS[:1]
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


class Linear:
    """u = −K (y − ref), held or as impulses."""

    def __init__(
        self, gain: Any, actuation: Literal["hold", "impulse"] = "hold", period_s: float = PERIOD
    ) -> None:
        self.gain, self.actuation, self.period_s = np.array(gain), actuation, period_s

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return self.gain @ (ref - y), xc


class Filtered:
    """A filter ẋ = (e − x)/τ of each error, and u = K x; every input has its filter."""

    period_s = PERIOD

    def __init__(
        self, gain: Any, tau: float, measurement: Literal["held", "continuous"] = "held"
    ) -> None:
        self.gain, self.tau, self.measurement = np.array(gain), tau, measurement
        self.inputs = self.gain.shape[1]
        self.states = tuple(Variable(f"toy:f{i}") for i in range(self.inputs))

    def initial(self, n_cases: int) -> Array:
        return np.zeros((self.inputs, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        return tuple((r - s - f) / self.tau for f, s, r in zip(xc, y, ref, strict=True))

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        return tuple(dot(row, xc) for row in self.gain.tolist())


PD = np.hstack([KP * np.eye(3), KD * np.eye(3)])


def starts(count: int) -> Array:
    size = np.array([300.0, 300.0, 300.0, 0.1, 0.1, 0.1])[:, None]
    return np.asarray(START[:, None] + size * np.random.default_rng(3).normal(size=(6, count)))


def flown_by_scipy(rate: Any, x: Array, t: float, duration: float) -> Array:
    found = solve_ivp(rate, (t, t + duration), x, method="DOP853", rtol=1e-13, atol=1e-10)
    return np.asarray(found.y[:, -1])


def central(t: float, x: Array, u: Array, gm: Any) -> Array:
    pull = -gm * x[:3] / np.linalg.norm(x[:3]) ** 3
    return np.concatenate([x[3:6], pull + u + np.array([0.0, 1e-8 * t, 0.0])])


def test_held_control_against_scipy() -> None:
    count, samples = 3, 10
    x0, gm = starts(count), GM * np.array([0.9, 1.0, 1.1])
    random = np.random.default_rng(4)
    feed = 1e-3 * random.normal(size=(3, samples))
    table = TARGET[:, None] + random.normal(size=(6, samples)) * 0.1
    gain = np.eye(3)[:, :, None] + 0.05 * random.normal(size=(3, 3, count))
    flights = simulate(
        Central(), Linear(PD), Cases(x0, p=gm[None], gain=gain, t0_s=500.0), samples,
        reference=SampledReference(table, feed), run_time=["gm"], substeps=2, history=True,
    )  # fmt: skip
    assert flights.status == ("completed",) * count
    for j in range(count):
        x, dv = x0[:, j], 0.0
        for k in range(samples):
            u = gain[:, :, j] @ (PD @ (table[:, k] - x) + feed[:, k])
            assert flights.history is not None
            assert_allclose(flights.history.u[:, k, j], u, rtol=1e-9)
            t = 500.0 + k * PERIOD
            x = flown_by_scipy(lambda t, y, u=u, j=j: central(t, y, u, gm[j]), x, t, PERIOD)
            dv += float(np.linalg.norm(u)) * PERIOD
        assert_allclose(flights.x[:, j], x, rtol=1e-9)
        assert_allclose(flights.dv_m_s[j], dv, rtol=1e-9)
    assert_array_equal(flights.time_s, 500.0 + samples * PERIOD)
    assert_array_equal(flights.samples, samples)


def test_impulses_against_scipy() -> None:
    samples, x0 = 6, starts(2)
    law = Linear(np.hstack([1e-3 * np.eye(3), 0.5 * np.eye(3)]), "impulse", 300.0)
    flights = simulate(Central(), law, Cases(x0), samples, reference=TARGET, substeps=8)
    for j in range(2):
        x, dv = x0[:, j].copy(), 0.0
        for k in range(samples):
            impulse = law.gain @ (TARGET - x)
            x[3:] += impulse
            dv += float(np.linalg.norm(impulse))
            x = flown_by_scipy(lambda t, y: central(t, y, np.zeros(3), GM), x, 300.0 * k, 300.0)
        assert_allclose(flights.x[:, j], x, rtol=1e-9, atol=1e-9)
        assert_allclose(flights.dv_m_s[j], dv, rtol=1e-10)


@pytest.mark.parametrize("measurement", ["held", "continuous"])
@pytest.mark.parametrize("plant", [Central, TabulatedCentral])
def test_continuous_law_against_scipy(
    plant: type[Central], measurement: Literal["held", "continuous"]
) -> None:
    samples, tau = 5, 10.0
    law = Filtered(PD, tau, measurement)
    gain = np.array([[1.0, 0.02, 0.0], [0.0, 0.9, 0.01], [0.03, 0.0, 1.1]])
    feed = np.array([1e-3, 0.0, -2e-3])[:, None].repeat(samples, axis=1)
    reference = SampledReference(TARGET[:, None].repeat(samples, axis=1), feed)
    x0 = starts(2)
    flights = simulate(
        plant(), law, Cases(x0, gain=gain[:, :, None].repeat(2, axis=2)), samples,
        reference=reference, substeps=12, history=True,
    )  # fmt: skip
    assert flights.history is not None
    for j in range(2):
        y = np.concatenate([x0[:, j], np.zeros(7)])
        for k in range(samples):
            seen = y[:6].copy()

            def rate(t: float, y: Array, seen: Array = seen) -> Array:
                error = TARGET - (seen if measurement == "held" else y[:6])
                u = gain @ (PD @ y[6:12] + feed[:, 0])
                size = [np.linalg.norm(u)]
                return np.concatenate([central(t, y, u, GM), (error - y[6:12]) / tau, size])

            told = PD @ y[6:12] + feed[:, 0]
            assert_allclose(flights.history.u[:, k, j], told, rtol=1e-8, atol=1e-12)
            y = flown_by_scipy(rate, y, k * PERIOD, PERIOD)
        assert_allclose(flights.x[:, j], y[:6], rtol=1e-9)
        # ∫|u| dt has near-kinks where the command turns: measured 2e-6 with these sub-steps.
        assert_allclose(flights.dv_m_s[j], y[12], rtol=1e-5)


def test_double_integrator_with_held_feedback_is_a_power_of_a_matrix() -> None:
    law = Linear([[0.02, 0.2]], period_s=2.0)
    step = np.array([[1.0, 2.0], [0.0, 1.0]]) - np.array([[2.0], [2.0]]) @ law.gain
    x0 = np.array([[1.0, -3.0], [0.5, 0.2]])
    flights = simulate(Free(), law, Cases(x0), 25, method="rk6")
    assert_allclose(flights.x, np.linalg.matrix_power(step, 25) @ x0, rtol=0, atol=1e-14)


def test_double_integrator_with_continuous_feedback_is_a_matrix_exponential() -> None:
    law = Filtered([[1e-3, 0.05]], 5.0, "continuous")
    rate = np.zeros((4, 4))
    rate[0, 1] = 1.0
    rate[1, 2:] = law.gain[0]
    rate[2:, :2], rate[2:, 2:] = -np.eye(2) / 5.0, -np.eye(2) / 5.0
    x0 = np.array([[1.0, -3.0], [0.5, 0.2]])
    flights = simulate(Free(), law, Cases(x0), 10, substeps=40)
    exact = expm(rate * 600.0)[:2, :2] @ x0
    assert_allclose(flights.x, exact, rtol=0, atol=1e-12)


def test_impulses_in_free_space_add_up() -> None:
    class Constant(Linear):
        def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
            return np.full((1, y.shape[1]), 0.25 if k % 2 else -0.5), xc

    flights = simulate(Free(), Constant([[0.0, 0.0]], "impulse", 10.0), Cases([[0.0], [1.0]]), 8)
    # Four times −0.5 and +0.25: all of these numbers are exact in binary.
    assert flights.dv_m_s[0] == 3.0
    assert flights.x[1, 0] == 0.0
    assert flights.firings[0] == 8


def test_each_case_has_its_own_period_and_number_of_samples() -> None:
    law = Linear([[0.02, 0.2]], period_s=2.0)
    x0 = np.array([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5]])
    periods, samples = np.array([1.0, 2.0, 3.0]), np.array([4, 9, 0])
    flights = simulate(Free(), law, Cases(x0, period_s=periods), samples, history=True)
    for j, (h, count) in enumerate(zip(periods.tolist(), samples.tolist(), strict=True)):
        step = np.array([[1.0, h], [0.0, 1.0]]) - np.array([[h * h / 2], [h]]) @ law.gain
        exact = np.linalg.matrix_power(step, count) @ x0[:, j]
        assert_allclose(flights.x[:, j], exact, rtol=0, atol=1e-14)
    assert_array_equal(flights.time_s, periods * samples)
    assert_array_equal(flights.samples, samples)
    assert flights.status == ("completed",) * 3


def test_reference_as_a_function_of_phase() -> None:
    seen: list[Array] = []

    def motion(phase: Array, cases: Integers) -> Array:
        seen.append(phase)
        return np.array([np.sin(2 * np.pi * phase), np.zeros_like(phase)])

    reference = PhaseReference(motion, lambda t, y, cases: t / 8.0 + 0.25)
    flights = simulate(
        Free(), Linear([[0.02, 0.2]], period_s=2.0), Cases([[0.0], [0.0]]), 6,
        reference=reference, history=True,
    )  # fmt: skip
    assert flights.history is not None
    assert_allclose([p[0] for p in seen], [0.25, 0.5, 0.75, 0.0, 0.25, 0.5])
    assert_allclose(flights.history.ref[0, :, 0], [1, 0, -1, 0, 1, 0], rtol=0, atol=1e-15)


def test_references_differ_by_number_of_case() -> None:
    table = FixedReference(np.array([[0.0, 10.0, 20.0], [0.0, 0.0, 0.0]]))
    cases = Cases(np.zeros((2, 2)), numbers=[2, 1])
    flights = simulate(
        Free(), Linear([[0.1, 0.4]], period_s=1.0), cases, 200, reference=table
    )  # fmt: skip
    assert_allclose(flights.x[0], [20.0, 10.0], rtol=1e-6)


def test_history_is_kept_until_the_end(tmp_path: Path) -> None:
    x0 = np.array([[1.0, np.nan], [0.0, 0.0]])
    flights = simulate(Free(), Linear([[0.02, 0.2]], period_s=2.0), Cases(x0), 5, history=True)
    history = flights.history
    assert history is not None
    assert history.x.shape == (2, 6, 2)
    assert history.u.shape == (1, 5, 2)
    assert np.isfinite(history.x[:, :, 0]).all()
    assert np.isnan(history.x[:, :, 1]).all()
    assert_array_equal(history.time_s[:, 0], [0, 2, 4, 6, 8, 10])
    assert_array_equal(history.x[:, -1, 0], flights.x[:, 0])
    save_product(tmp_path / "flights.npz", flights)
    back = load_product(tmp_path / "flights.npz")
    assert back.status == ("completed", "diverged")
    assert_array_equal(back.history.x, history.x)


def test_no_cases_give_no_flights() -> None:
    flights = simulate(Free(), Linear([[0.02, 0.2]]), Cases(np.empty((2, 0))), 5)
    assert flights.status == ()
    assert flights.x.shape == (2, 0)
    assert flights.counts() == {}


def test_substeps_are_chosen_by_step_doubling() -> None:
    cases = Cases(starts(3))
    loop = Simulator(Central(), Linear(PD, period_s=1200.0))
    steps = loop.choose_substeps(cases, 1e-10)
    coarse = loop.map.propagate(cases.x0, 1200.0, steps, np.zeros(3))
    fine = loop.map.propagate(cases.x0, 1200.0, 4 * steps, np.zeros(3))
    assert steps > 1
    assert np.abs(coarse[:3] - fine[:3]).max() < 20e3 * 1e-10


def test_progress_is_told_case_by_case() -> None:
    told: list[int] = []
    simulate(
        Free(), Linear([[0.02, 0.2]]), Cases(np.zeros((2, 70))), 3, advance=told.append
    )  # fmt: skip
    assert sum(told) == 70
    assert told.count(0) == 2


BAD: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("x0", {"x0": np.zeros((3, 2))}, {}, r"x0 must be \(2, N\)"),
    ("samples", {}, {"samples": -1}, "samples must be"),
    ("samples", {}, {"samples": 1.5}, "samples must be"),
    ("gain", {"gain": np.zeros((2, 2, 1))}, {}, r"gain must be \(1, 1, 1\)"),
    ("period", {"period_s": 0.0}, {}, "period_s must be positive"),
    ("budget", {"dv_budget_m_s": -1.0}, {}, "dv_budget_m_s must be"),
    ("numbers", {"numbers": [-1]}, {}, "numbers must be"),
    ("reference", {}, {"reference": np.zeros(3)}, "they must agree"),
    ("substeps", {}, {"substeps": 0}, "substeps must be at least 1"),
    ("tolerance", {}, {"tolerance": 0.0}, "tolerance must be positive"),
    ("actuator", {}, {"actuator": Thruster()}, "dimension"),
    ("table", {}, {"reference": SampledReference(np.zeros((2, 2)))}, "sample 2 was requested"),
    ("parameter", {}, {"run_time": ["gm"]}, "no parameter 'gm'"),
]


@pytest.mark.parametrize(("what", "cases", "options", "message"), BAD)
def test_bad_input(what: str, cases: dict[str, Any], options: dict[str, Any], message: str) -> None:
    given = Cases(**{"x0": np.zeros((2, 1)), **cases})
    arguments = {"samples": 5, **options}
    with pytest.raises(InputError, match=message):
        simulate(Free(), Linear([[0.02, 0.2]]), given, **arguments)


def test_laws_that_do_not_fit_are_refused() -> None:
    cases = Cases(np.zeros((2, 1)))
    with pytest.raises(InputError, match="commands"):
        simulate(Free(), Linear([[0.0, 0.0]] * 2), cases, 1)
    with pytest.raises(InputError, match="no actuator can come between"):
        Simulator(Free(), Filtered([[1.0, 1.0]], 5.0), actuator=Thruster(dimension=1))
    with pytest.raises(InputError, match="2 states of the plant"):
        Simulator(Free(), Filtered([[1.0, 1.0, 1.0]], 5.0, "continuous"))
    with pytest.raises(InputError, match="takes 3 inputs"):
        simulate(Free(), Filtered([[1.0, 1.0, 1.0]], 5.0), cases, 1)
    with pytest.raises(InputError, match=r"leave Cases\.period_s out"):
        simulate(
            Free(), Filtered([[1.0, 1.0]], 5.0), Cases(np.zeros((2, 1)), period_s=2.0), 1
        )  # fmt: skip
    with pytest.raises(InputError, match="period_s of the law"):
        Simulator(Free(), Linear([[0.0, 0.0]], period_s=0.0))
