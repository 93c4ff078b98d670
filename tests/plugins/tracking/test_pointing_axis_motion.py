"""Axes that follow their targets: never beyond a limit, and as fast as the limits allow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere_tracking.pointing.axis_motion import (
    AxisState,
    advance,
    at_rest,
    braking_rate,
    follow,
)
from hillsphere_tracking.pointing.mounts import AxisLimits

LIMITS = AxisLimits(-1.0, 2.0, 0.2, 0.1)
T = 0.1


def _within(angle: np.ndarray, limits: AxisLimits, period: float) -> None:
    """Assert that a course keeps all limits, to rounding."""
    rate = np.diff(angle, axis=0) / period
    assert angle.min() >= limits.lower_rad - 1e-12
    assert angle.max() <= limits.upper_rad + 1e-12
    assert np.abs(rate).max() <= limits.rate_rad_s * (1.0 + 1e-9)
    change = np.diff(np.concatenate([np.zeros_like(rate[:1]), rate]), axis=0)
    assert np.abs(change).max() <= limits.acceleration_rad_s2 * period * (1.0 + 1e-9)


@given(
    seed=st.integers(0, 10_000),
    rate=st.floats(0.01, 3.0),
    acceleration=st.floats(0.01, 5.0),
    period=st.sampled_from([0.02, 0.1, 1.0]),
    jump=st.floats(0.0, 4.0),
)
@settings(max_examples=25, deadline=None)
def test_never_beyond_any_limit(
    seed: int, rate: float, acceleration: float, period: float, jump: float
) -> None:
    random = np.random.default_rng(seed)
    limits = AxisLimits(-1.0, 2.0, rate, acceleration)
    # rough targets, jumps and targets beyond the stops
    targets = np.cumsum(random.normal(0.0, 0.1, (150, 20)), axis=0)
    targets += jump * np.sign(random.normal(size=(150, 20)))
    angle, rates = follow(targets, period, limits)
    _within(angle, limits, period)
    np.testing.assert_allclose(np.diff(angle, axis=0), rates[1:] * period, rtol=0, atol=1e-12)


def test_a_target_within_the_limits_is_followed_exactly() -> None:
    times = np.arange(0.0, 60.0, T)
    target = 0.5 + 0.4 * (1.0 - np.cos(0.3 * times))  # at rest at first; at most 0.12/s, 0.036/s²
    angle, _ = follow(target, T, LIMITS)
    np.testing.assert_allclose(angle, target, rtol=0, atol=1e-12)


@pytest.mark.parametrize("distance", [0.05, 0.39, 0.41, 1.5])
def test_a_step_takes_the_shortest_time_without_overshoot(distance: float) -> None:
    """Bang-bang: 2√(d/a), or d/v + v/a when the rate saturates; two periods more for sampling."""
    angle, _ = follow(np.full(400, distance), T, LIMITS, at_rest(0.0))
    a, v = LIMITS.acceleration_rad_s2, LIMITS.rate_rad_s
    shortest = 2.0 * np.sqrt(distance / a) if distance < v**2 / a else distance / v + v / a
    arrived = np.flatnonzero(np.abs(angle - distance) < 1e-9)[0] * T
    assert shortest - T <= arrived <= shortest + 2.0 * T
    assert angle.max() <= distance + 1e-12


def test_a_moving_target_is_caught_up_without_overshoot() -> None:
    target = 0.1 * np.arange(0.0, 15.0, T)
    angle, _ = follow(target, T, LIMITS, at_rest(-0.5))
    behind = target - angle
    # 0.5 behind, at rest: v 0.2, a 0.1, target 0.1. It falls to 0.5 + 0.05 behind in 1 s, closes at
    # 0.1 from t = 2 s on, and brakes from 0.1 relative in the last second over 0.05.
    assert behind.min() >= -1e-12
    caught = np.flatnonzero(np.abs(behind) < 1e-9)[0] * T
    assert caught == pytest.approx(2.0 + (0.5 - 0.05) / 0.1 + 1.0, abs=2 * T)
    np.testing.assert_allclose(behind[-10:], 0.0, rtol=0, atol=1e-12)


def test_stops_are_reached_at_rest() -> None:
    angle, rate = follow(np.full(300, 5.0), T, LIMITS, at_rest(0.0))
    assert angle[-1] == pytest.approx(LIMITS.upper_rad, abs=1e-12)
    assert rate[-1] == pytest.approx(0.0, abs=1e-12)


def test_braking_rate_can_be_braked() -> None:
    distance = np.linspace(0.0, 0.3, 2000)
    now = braking_rate(distance, 0.1, T)
    later = braking_rate(distance - now * T, 0.1, T)
    assert np.all(later >= now - 0.1 * T - 1e-12)
    assert np.all(now * T <= distance + 1e-15)
    # and it is nearly the continuous-time √(2ad)
    assert np.all(np.abs(now - np.sqrt(2.0 * 0.1 * distance)) <= 0.1 * T)


def test_streamed_is_the_same_as_whole() -> None:
    targets = np.random.default_rng(1).uniform(-2.0, 3.0, 50)
    state = AxisState(np.array([0.3]), np.array([0.0]))
    whole, _ = follow(targets, T, LIMITS, state)
    for k in range(1, 50):
        state = advance(state, targets[k - 1 : k], targets[k : k + 1], T, LIMITS)
        assert state.angle_rad[0] == whole[k]


def test_errors() -> None:
    with pytest.raises(InputError, match="period"):
        advance(at_rest(0.0), np.zeros(1), np.zeros(1), 0.0, LIMITS)
    with pytest.raises(InputError, match="finite"):
        advance(at_rest(0.0), np.array([np.nan]), np.zeros(1), T, LIMITS)
