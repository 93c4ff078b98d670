"""Loops of a plant that moves all the time and a controller that sees it at samples."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.analysis.margins import loop_margins
from hillsphere_controllers.analysis.sampled_loop import (
    SampledLoop,
    first_unstable_period,
    sampled_margins,
)
from hillsphere_controllers.systems.algebra import feedback, gain, series
from hillsphere_controllers.systems.holding import zero_order_hold
from hillsphere_controllers.systems.sampling import sampled_controller

PERIOD = 60.0


def plant(axes: int = 1, unstable: float = 4e-7) -> LtiSystem:
    """Double integrators with a gravity gradient, coupled; positions, then velocities are seen."""
    one, zero = np.eye(axes), np.zeros((axes, axes))
    pull = unstable * (one + 0.3 * (np.ones((axes, axes)) - one))
    a = np.block([[zero, one], [pull, zero]])
    return LtiSystem(a, np.vstack([zero, one]), np.eye(2 * axes), np.zeros((2 * axes, axes)))


def pid(axes: int = 1, kp: float = 3e-4, kd: float = 0.03, ki: float = 1e-6) -> LtiSystem:
    """Return −(Kp r + Kd v + Ki ∫ r) through filters of 0.05 Hz."""
    one, zero = np.eye(axes), np.zeros((axes, axes))
    k = LtiSystem(zero, np.hstack([one, zero]), -ki * one, np.hstack([-kp * one, -kd * one]))
    return series(low_pass(2 * axes), k)


def low_pass(width: int) -> LtiSystem:
    one, w = np.eye(width), 2 * np.pi * 0.05
    return LtiSystem(-w * one, w * one, one, 0 * one)


def by_integration(loop: SampledLoop, state: Array) -> Array:
    """Return the state a period later by SciPy, for a controller in continuous time."""
    g, k, n, m = loop.plant, loop.controller, loop.plant.order, loop.controller.order
    x, old = state[: n + m], state[n + m :]
    new = g.c @ x[:n]
    for begin, end, y in ((0.0, loop.delay_s, old), (loop.delay_s, loop.period_s, new)):
        if end > begin:

            def rate(t: float, z: Array, y: Array = y) -> Array:
                u = k.c @ z[n:] + k.d @ y
                return np.concatenate([g.a @ z[:n] + g.b @ u, k.a @ z[n:] + k.b @ y])

            x = solve_ivp(rate, (begin, end), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return np.concatenate([x, new])


@pytest.mark.parametrize("delay", [0.0, 13.0, 60.0])
def test_monodromy_against_integration(delay: float) -> None:
    loop = SampledLoop(plant(2), pid(2), PERIOD, delay)
    state = np.random.default_rng(1).normal(size=4 + 6 + 4)
    assert_allclose(loop.monodromy() @ state, by_integration(loop, state), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 20.0, 60.0])
def test_a_held_controller_is_the_discrete_loop(delay: float) -> None:
    """Poles, sensitivity and margins as the plant seen through the hold has them."""
    k = sampled_controller(series(pid(3, kp=4e-5, kd=8e-3, ki=1e-8)), PERIOD, "mean")
    loop = SampledLoop(plant(3), k, PERIOD, delay)
    l_u = series(zero_order_hold(plant(3), PERIOD, delay), series(k, gain(-np.eye(3), PERIOD)))
    closed = feedback(gain(np.eye(3), PERIOD), l_u)
    found = np.sort(np.abs(np.linalg.eigvals(loop.monodromy())))[::-1]
    wanted = np.sort(np.abs(closed.poles))[::-1]
    assert_allclose(found[:10], wanted[:10], rtol=1e-8)
    omega = np.linspace(1e-4, np.pi / PERIOD, 50)
    margins = sampled_margins(loop)
    if delay != 20.0:  # else the disturbance of one begins with the sample, of the other later
        found_s, wanted_s = (one.response(omega) for one in (loop.sensitivity(), closed))
        assert_allclose(found_s, wanted_s, rtol=0, atol=1e-9)
        assert_allclose(margins.peak, hinf_norm(closed).value, rtol=1e-8)
    each = loop_margins(l_u)
    assert_allclose(margins.gain_upper[:3], [one.gain_upper for one in each], rtol=1e-6)
    assert_allclose(margins.gain_lower[:3], [one.gain_lower for one in each], rtol=1e-6)


def test_margins_between_samples() -> None:
    """A factor at its margin puts an eigenvalue on the circle; S is what a steady push leaves."""
    loop = SampledLoop(plant(3), pid(3), PERIOD)
    margins = sampled_margins(loop)
    assert margins.spectral_radius < 1.0
    for factors in (
        np.array([margins.gain_upper[0], 1.0, 1.0]),
        np.array([1.0, margins.gain_lower[1], 1.0]),
        np.full(3, margins.gain_upper[3]),
        np.full(3, margins.gain_lower[3]),
    ):
        assert_allclose(loop.spectral_radius(factors), 1.0, rtol=1e-9)
        assert loop.spectral_radius(1.0 + 0.99 * (factors - 1.0)) < 1.0
    # integral action: nothing of a constant disturbance stays
    assert_allclose(loop.sensitivity().response(np.array([0.0]))[0], 0.0, rtol=0, atol=1e-8)
    assert margins.peak >= margins.peaks.max() > 1.0
    assert margins.peak_rad_s <= np.pi / PERIOD
    # a short period is the loop in continuous time
    quick = SampledLoop(plant(1), pid(1), 0.01)
    omega = np.logspace(-4, -1, 30)
    smooth = feedback(gain(np.eye(1)), series(plant(1), series(pid(1), gain(-np.eye(1)))))
    found, wanted = quick.sensitivity().response(omega), smooth.response(omega)
    assert_allclose(found, wanted, rtol=0, atol=2e-3)


@pytest.mark.parametrize(("kind", "expected"), [("pd", 0.0287), ("pid", 0.0129)])
def test_where_sixty_seconds_lose_stability(kind: str, expected: float) -> None:
    """A PD of damping 0.7 and a PID of a triple pole lose it at these frequencies."""

    def stable(w: float) -> bool:
        kp, kd, ki = (w * w, 1.4 * w, 0.0) if kind == "pd" else (3 * w * w, 3 * w, w**3)
        return SampledLoop(plant(1, 0.0), series(low_pass(2), of(kp, kd, ki)), PERIOD).is_stable

    def of(kp: float, kd: float, ki: float) -> LtiSystem:
        d = np.array([[-kp, -kd]])
        if ki == 0.0:
            return gain(d)
        return LtiSystem(np.zeros((1, 1)), np.array([[1.0, 0.0]]), np.array([[-ki]]), d)

    assert stable(0.98 * expected)
    assert not stable(1.02 * expected)


def test_the_period_at_which_stability_is_lost() -> None:
    plants = [plant(3, pull) for pull in (2e-7, 8e-7)]
    lost = first_unstable_period(plants, lambda h: pid(3), 1.0, 300.0)
    assert PERIOD < lost < 200.0
    for factor, stable in ((0.999, True), (1.001, False)):
        loops = [SampledLoop(one, pid(3), factor * lost) for one in plants]
        assert all(one.is_stable for one in loops) is stable
    assert first_unstable_period(plants, lambda h: pid(3), 1.0, 50.0) == np.inf
    assert first_unstable_period(plants, lambda h: pid(3), 150.0, 300.0) == 150.0
    with pytest.raises(InputError, match="must rise"):
        first_unstable_period(plants, lambda h: pid(3), 10.0, 5.0)


def test_an_unstable_loop_bears_nothing() -> None:
    margins = sampled_margins(SampledLoop(plant(1), pid(1), 400.0))
    assert margins.spectral_radius > 1.0
    assert margins.peak == np.inf
    assert_allclose(margins.gain_lower, 1.0)
    assert_allclose(margins.gain_upper, 1.0)


def test_what_does_not_fit() -> None:
    other = sampled_controller(pid(), 7.0, "held")
    for message, g, k, delay in (
        ("signals do not fit", plant(2), pid(3), 0.0),
        ("without direct term", gain(np.eye(1)), gain(np.eye(1)), 0.0),
        ("delay at most as long", plant(), pid(), 61.0),
        ("made for a period of 7 s", plant(), other, 0.0),
    ):
        with pytest.raises(InputError, match=message):
            SampledLoop(g, k, PERIOD, delay)
