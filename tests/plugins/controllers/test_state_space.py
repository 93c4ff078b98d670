"""Linear compensators: discretisation, the sampled loop and the continuous one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hillsphere.dynamics import system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.plugins import default_registry, validate
from hillsphere.simulation import Cases, simulate
from hillsphere.testing import example
from hillsphere_controllers.specs import StateSpaceSpec
from hillsphere_controllers.state_space import (
    ContinuousStateSpace,
    SampledStateSpace,
    state_space,
    zero_order_hold_matrices,
)

LOW, KP, KD, PERIOD = 2 * np.pi * 0.05, 2.5e-5, 7.5e-3, 60.0
EYE, ZERO = np.eye(3), np.zeros((3, 3))
# Integral of the filtered position error, and filters of 0.05 Hz on positions and velocities.
A = np.block([[ZERO, EYE, ZERO], [ZERO, -LOW * EYE, ZERO], [ZERO, ZERO, -LOW * EYE]])
B = np.block([[ZERO, ZERO], [LOW * EYE, ZERO], [ZERO, LOW * EYE]])
C = np.hstack([2e-8 * EYE, KP * EYE, KD * EYE])
TARGET = np.array([30e3, 0.0, 0.0, 0.0, 0.0, 0.0])


def law(**keys: Any) -> SampledStateSpace | ContinuousStateSpace:
    table = {"period_s": PERIOD, "form": "continuous", "a": A, "b": B, "c": C, **keys}
    rows = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in table.items()}
    return state_space(StateSpaceSpec.model_validate(rows))


def starts() -> Array:
    size = np.array([100.0, 100.0, 100.0, 0.1, 0.1, 0.1])[:, None]
    return np.asarray(TARGET[:, None] + size * np.random.default_rng(6).normal(size=(6, 2)))


def test_discretisation_of_a_first_order_lag_and_an_integrator() -> None:
    a, b = zero_order_hold_matrices(np.diag([-0.3, 0.0]), np.array([[0.3], [2.0]]), 5.0)
    kept = np.exp(-1.5)
    assert_allclose(a, np.diag([kept, 1.0]), rtol=1e-14)
    assert_allclose(b, [[1.0 - kept], [10.0]], rtol=1e-14)


def test_discretisation_solves_the_equations_for_a_held_error() -> None:
    random = np.random.default_rng(1)
    a, b = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    x, e = random.normal(size=4), random.normal(size=2)
    found = solve_ivp(
        lambda t, y: a @ y + b @ e, (0.0, 0.7), x, method="DOP853", rtol=1e-13, atol=1e-13
    )
    ad, bd = zero_order_hold_matrices(a, b, 0.7)
    assert_allclose(ad @ x + bd @ e, found.y[:, -1], rtol=1e-11)


def test_sampled_and_continuous_states_are_the_same_filter() -> None:
    # Between samples the error is held, so the states at the samples agree exactly.
    sampled, moving = law(), law(states="continuous")
    assert isinstance(sampled, SampledStateSpace)
    assert isinstance(moving, ContinuousStateSpace)
    e = np.random.default_rng(2).normal(size=(6, 1))
    _, once = sampled.step(0, np.zeros(1), -e, np.zeros((6, 1)), np.ones((9, 1)))
    both = np.zeros((15, 15))
    both[:9, :9], both[:9, 9:] = A, B
    exact = (expm(both * PERIOD) @ np.concatenate([np.ones((9, 1)), e]))[:9]
    assert_allclose(once, exact, rtol=1e-12)


def test_held_compensator_on_hills_problem_against_scipy() -> None:
    plant, compensator = example("plant", "hill"), law()
    assert isinstance(compensator, SampledStateSpace)
    x0, samples = starts(), 8
    flights = simulate(plant, compensator, Cases(x0), samples, reference=TARGET, method="rk6")
    equations = system(plant, controls=True)
    rate = equations.function(*equations.rhs)
    ad, bd = zero_order_hold_matrices(A, B, PERIOD)
    for j in range(2):
        x, xc = x0[:, j], np.zeros(9)
        for k in range(samples):
            u, xc = C @ xc, ad @ xc + bd @ (TARGET - x)
            x = solve_ivp(
                lambda t, y, u=u: rate(y, u), (k * PERIOD, (k + 1) * PERIOD), x,
                method="DOP853", rtol=1e-13, atol=1e-10,
            ).y[:, -1]  # fmt: skip
        assert_allclose(flights.x[:3, j], x[:3], rtol=0, atol=3e-6)
        assert_allclose(flights.x[3:, j], x[3:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("measurement", ["held", "continuous"])
def test_continuous_compensator_on_hills_problem_against_scipy(measurement: str) -> None:
    plant = example("plant", "hill")
    x0, samples = starts(), 6
    compensator = law(states="continuous", measurement=measurement)
    flights = simulate(plant, compensator, Cases(x0), samples, reference=TARGET, substeps=20)
    equations = system(plant, controls=True)
    rate = equations.function(*equations.rhs)
    for j in range(2):
        y = np.concatenate([x0[:, j], np.zeros(9)])
        for k in range(samples):
            seen = y[:6].copy()

            def slope(t: float, y: Array, seen: Array = seen) -> Array:
                e = TARGET - (seen if measurement == "held" else y[:6])
                return np.concatenate([rate(y[:6], C @ y[6:]), A @ y[6:] + B @ e])

            y = solve_ivp(
                slope, (k * PERIOD, (k + 1) * PERIOD), y, method="DOP853", rtol=1e-13, atol=1e-10
            ).y[:, -1]
        assert_allclose(flights.x[:3, j], y[:3], rtol=0, atol=3e-6)
        assert_allclose(flights.x[3:, j], y[3:6], rtol=0, atol=1e-8)


def test_a_gain_alone_is_a_discrete_law_without_states() -> None:
    gain = np.hstack([KP * EYE, KD * EYE])
    compensator = law(form="discrete", a=(), b=(), c=(), d=gain)
    assert isinstance(compensator, SampledStateSpace)
    y = np.arange(12.0).reshape(6, 2)
    u, xc = compensator.step(0, np.zeros(2), y, np.ones((6, 2)), compensator.initial(2))
    assert xc.shape == (0, 2)
    assert_allclose(u, gain @ (1.0 - y), rtol=1e-15)
    with pytest.raises(InputError, match="6 inputs"):
        compensator.step(0, np.zeros(2), y[:3], y[:3], xc)


def test_impulses_are_possible() -> None:
    gain = np.hstack([1e-3 * EYE, EYE])
    compensator = law(form="discrete", a=(), b=(), c=(), d=gain, actuation="impulse")
    flights = simulate(
        example("plant", "hill"), compensator, Cases(starts()), 3, reference=TARGET, history=True
    )
    assert flights.history is not None
    u = flights.history.u
    assert_allclose(flights.dv_m_s, np.sqrt((u**2).sum(axis=0)).sum(axis=0), rtol=1e-14)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"d": [[1.0, 2.0]]}, "must be 1 × 1"),
        ({"b": [[1.0], [2.0]]}, "must be 1 × 1"),
        ({"c": ()}, "neither c nor d"),
        ({"states": "continuous", "form": "discrete"}, "need form = 'continuous'"),
        ({"states": "continuous", "actuation": "impulse"}, "command an acceleration"),
        ({"measurement": "continuous"}, "needs states = 'continuous'"),
        ({"a": [[1.0, 2.0]]}, "must be 1 × 1"),
        ({"a": (), "b": ()}, "says how many values"),
    ],
)
def test_bad_specs(keys: dict[str, Any], message: str) -> None:
    table = {"period_s": 60, "form": "continuous", "a": [[-1.0]], "b": [[1.0]], "c": [[1.0]]}
    spec = default_registry().get("compensator", "state_space").load_spec()
    with pytest.raises(InputError, match=message):
        validate(spec, {**table, **keys}, where="here")
