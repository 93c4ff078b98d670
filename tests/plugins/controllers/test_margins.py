from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import block_diag

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.margins import LoopMargins, loop_margins
from hillsphere_controllers.systems.algebra import append, feedback, gain, series
from hillsphere_controllers.systems.conversion import to_control, transfer_function
from hillsphere_controllers.systems.holding import zero_order_hold
from hillsphere_controllers.systems.sampling import sampled_loop


def one(loop: LtiSystem) -> LoopMargins:
    (found,) = loop_margins(loop)
    return found


def closed(loop: LtiSystem) -> LtiSystem:
    return feedback(loop, gain(np.eye(loop.shape[0]), loop.dt_s))


def test_lag_of_third_order_in_closed_form() -> None:
    """k/(s + 1)³: the phase is −π at √3, where (1 + ω²)^(3/2) = 8."""
    found = one(transfer_function([2.0], [1.0, 3.0, 3.0, 1.0]))
    assert_allclose([found.gain_upper, found.gain_upper_rad_s], [4.0, np.sqrt(3.0)], rtol=1e-9)
    assert found.gain_lower == 0.0
    assert np.isnan(found.gain_lower_rad_s)
    omega = np.sqrt(2.0 ** (2.0 / 3.0) - 1.0)
    phase = np.pi - 3.0 * np.arctan(omega)
    assert_allclose([found.phase_rad, found.phase_rad_s], [phase, omega], rtol=1e-9)
    assert_allclose([found.delay_s, found.delay_rad_s], [phase / omega, omega], rtol=1e-9)


def test_conditionally_stable_loop_bears_less_gain_too() -> None:
    """k/(s − 1) is stable for k > 1; its phase is −π at zero frequency."""
    found = one(transfer_function([4.0], [1.0, -1.0]))
    assert_allclose(found.gain_lower, 0.25, rtol=1e-12)
    assert found.gain_lower_rad_s == 0.0
    assert found.gain_upper == np.inf
    # |L| = 1 at √15, where −L has the angle arctan √15
    assert_allclose([found.phase_rad, found.phase_rad_s], [np.arccos(0.25), np.sqrt(15.0)])
    # 4 (s + 1)²/s³ is −8 at ω = 1
    several = one(transfer_function([4.0, 8.0, 4.0], [1.0, 0.0, 0.0, 0.0]))
    assert_allclose([several.gain_lower, several.gain_lower_rad_s], [0.125, 1.0], rtol=1e-7)
    assert several.gain_upper == np.inf


def test_double_integrator_with_lead() -> None:
    """(s + 1)/s²: the gain is one at ω² = (1 + √5)/2, any gain does."""
    found = one(transfer_function([1.0, 1.0], [1.0, 0.0, 0.0]))
    omega = np.sqrt(0.5 * (1.0 + np.sqrt(5.0)))
    assert (found.gain_lower, found.gain_upper) == (0.0, np.inf)
    assert_allclose([found.phase_rad, found.phase_rad_s], [np.arctan(omega), omega], rtol=1e-9)


def random_loop(seed: int, order: int, channels: int, dt_s: float | None) -> LtiSystem:
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order)) - 0.5 * np.eye(order)
    if dt_s is not None:
        a *= 0.95 / np.abs(np.linalg.eigvals(a)).max()
    return LtiSystem(
        a, random.normal(size=(order, channels)), random.normal(size=(channels, order)),
        np.zeros((channels, channels)), dt_s,
    )  # fmt: skip


def scaled(loop: LtiSystem, channel: int, factor: float) -> LtiSystem:
    factors = np.ones(loop.shape[0])
    factors[channel] = factor
    return series(loop, gain(np.diag(factors), loop.dt_s))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.integers(1, 7), st.integers(1, 3), st.booleans())
def test_stable_up_to_the_gain_margin_and_no_further(
    seed: int, order: int, channels: int, sampled: bool
) -> None:
    """By the poles of the closed loop, which the crossings are not made of."""
    loop = random_loop(seed, order, channels, 0.2 if sampled else None)
    assume(closed(loop).is_stable)
    for channel, found in enumerate(loop_margins(loop)):
        for factor, sign in ((found.gain_lower, 1.0), (found.gain_upper, -1.0)):
            bounded = 0.0 < factor < np.inf
            inside = factor * (1.0 + sign * 1e-6) if bounded else 1e-5 if sign > 0 else 1e5
            assert closed(scaled(loop, channel, inside)).is_stable
            if bounded:
                beyond = factor * (1.0 - sign * 1e-5)
                assert not closed(scaled(loop, channel, beyond)).is_stable


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.integers(1, 6), st.booleans())
def test_phase_margin_by_the_response_on_a_dense_grid(seed: int, order: int, sampled: bool) -> None:
    loop = random_loop(seed, order, 1, 0.2 if sampled else None)
    assume(closed(loop).is_stable)
    found = one(loop)
    omega = np.logspace(-3, 3 if not sampled else np.log10(np.pi / 0.2), 100_000)
    response = loop.response(omega)[:, 0, 0]
    size = np.log(np.abs(response))
    crossings = np.flatnonzero(size[1:] * size[:-1] < 0.0)
    if not crossings.size:
        return
    least = np.abs(np.angle(-response[crossings])).min()
    assert_allclose(found.phase_rad, least, rtol=0, atol=2e-3)
    lags = np.angle(-response[crossings]) % (2.0 * np.pi)
    delay = (lags / omega[crossings]).min()
    if sampled and np.abs(response[-1]) >= 1.0:
        assert found.delay_s == 0.0
    elif np.abs(lags - 2.0 * np.pi).min() > 1e-2 and lags.min() > 1e-2:
        assert_allclose(found.delay_s, delay, rtol=2e-2)


@pytest.mark.parametrize("seed", [2, 5, 7, 11])
def test_python_control_finds_the_same(seed: int) -> None:
    control = pytest.importorskip("control")
    loop = random_loop(seed, 5, 1, None)
    loop = LtiSystem(loop.a - 1.5 * np.eye(5), loop.b, loop.c, loop.d)
    found = one(loop)
    gains, phases, *_ = control.stability_margins(to_control(loop), returnall=True)
    above = np.min(gains[gains > 1.0], initial=np.inf)
    assert found.stable
    assert_allclose(found.gain_upper, above, rtol=1e-6)
    assert_allclose(np.degrees(found.phase_rad), np.abs(phases).min(initial=180.0), rtol=1e-6)


def test_delay_margin_by_whole_delays_of_a_sampled_loop() -> None:
    """Stable for as many periods of delay as fit below it, and for no more."""
    dt = 0.05
    plant = transfer_function([1.0, 1.0], [1.0, 0.1, 0.0])
    loop = zero_order_hold(plant, dt)
    margin = one(loop).delay_s
    whole = int(margin / dt)
    assert whole > 3
    assert closed(zero_order_hold(plant, dt, whole * dt)).is_stable
    assert not closed(zero_order_hold(plant, dt, (whole + 1) * dt)).is_stable


def late(loop: LtiSystem, periods: int) -> LtiSystem:
    """Return z⁻ᵏ L."""
    step = LtiSystem(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)), loop.dt_s)
    return series(*[step] * periods, loop) if periods else loop


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.integers(1, 5), st.floats(-1.5, 1.5))
def test_whole_periods_of_delay_below_the_margin(seed: int, order: int, direct: float) -> None:
    """By the poles; none is promised where the gain at z = −1 or the direct term reach one."""
    dt = 0.2
    loop = replace(random_loop(seed, order, 1, dt), d=np.array([[direct]]))
    assume(abs(1.0 + direct) > 1e-3 and closed(loop).is_stable)
    found = one(loop)
    if found.delay_s == 0.0:
        assert found.delay_rad_s == pytest.approx(np.pi / dt)
        at_half_rate = float(abs(loop.response(np.array([np.pi / dt]))[0, 0, 0]))
        assert max(at_half_rate, abs(direct)) >= 1.0
    else:
        most = 30 if found.delay_s == np.inf else min(30, int(np.ceil(found.delay_s / dt)) - 1)
        for periods in range(most + 1):
            assert closed(late(loop, periods)).is_stable


def test_gain_above_one_at_half_the_sampling_rate_bears_no_delay() -> None:
    """Constant gain 2; a direct term of 2 and a lag; one without, −0.8/(z + 0.5)."""
    dt = 0.1
    lag = LtiSystem(np.array([[0.1]]), np.eye(1), np.array([[0.1]]), np.array([[2.0]]), dt)
    strict = LtiSystem(np.array([[-0.5]]), np.eye(1), np.array([[-0.8]]), np.zeros((1, 1)), dt)
    for loop in (gain(np.array([[2.0]]), dt), lag, strict):
        assert closed(loop).is_stable
        assert not closed(late(loop, 1)).is_stable
        found = one(loop)
        assert found.stable
        assert found.delay_s == 0.0
    # the loop of a plant with a direct term that the hold moves by a period
    plant, fast = transfer_function([2.0, 1.0], [1.0, 1.0]), transfer_function([0.9], [1.0])
    assert one(sampled_loop(plant, fast, 1.0)).delay_s == 0.0
    assert not closed(sampled_loop(plant, fast, 1.0, delay_s=1e-6)).is_stable


def test_fast_sampling_is_continuous_time_but_for_the_hold() -> None:
    """Half a period of delay, which costs ω dt/2 of phase."""
    plant, dt = transfer_function([2.0], [1.0, 3.0, 3.0, 1.0]), 1e-3
    smooth, sampled = one(plant), one(zero_order_hold(plant, dt))
    lost = 0.5 * dt * smooth.phase_rad_s
    assert_allclose(smooth.phase_rad - sampled.phase_rad, lost, rtol=1e-3)
    assert_allclose(smooth.delay_s - sampled.delay_s, 0.5 * dt, rtol=1e-2)


def test_one_channel_with_the_others_closed() -> None:
    """A spinning body, 1/(s² + a²) [s − a², a(s + 1); −a(s + 1), s − a²], a = 10: each loop 1/s."""
    a = 10.0
    loop = LtiSystem(
        np.array([[0.0, a], [-a, 0.0]]), np.eye(2), np.array([[1.0, a], [-a, 1.0]]),
        np.zeros((2, 2)),
    )  # fmt: skip
    for found in loop_margins(loop):
        assert (found.gain_lower, found.gain_upper) == (0.0, np.inf)
        assert_allclose([found.phase_rad, found.delay_s], 0.5 * np.pi, rtol=1e-9)


def test_loops_that_do_not_touch() -> None:
    first, second = (transfer_function([k], [1.0, 3.0, 3.0, 1.0]) for k in (2.0, 4.0))
    both = loop_margins(append(first, second))
    assert_allclose([m.gain_upper for m in both], [4.0, 2.0], rtol=1e-9)


def test_loops_without_margin() -> None:
    unstable = one(transfer_function([20.0], [1.0, 3.0, 3.0, 1.0]))
    assert not unstable.stable
    assert (unstable.gain_lower, unstable.gain_upper) == (1.0, 1.0)
    assert (unstable.phase_rad, unstable.delay_s) == (0.0, 0.0)
    # a gain that stays above one bears no delay at all
    direct = one(transfer_function([3.0, 2.0], [1.0, 1.0]))
    assert direct.stable
    assert direct.delay_s == 0.0
    calm = one(transfer_function([0.5], [1.0, 1.0]))
    assert (calm.phase_rad, calm.delay_s, calm.gain_upper) == (np.pi, np.inf, np.inf)
    negative = one(transfer_function([-0.5], [1.0, 1.0]))
    assert_allclose([negative.gain_upper, negative.gain_upper_rad_s], [2.0, 0.0], atol=0)


def spread(seed: int) -> Array:
    return 10.0 ** np.random.default_rng(seed).uniform(-6.0, 3.0, size=8)


@pytest.mark.parametrize("seed", range(3))
def test_poles_over_nine_decades(seed: int) -> None:
    """Gain margin by the poles, where crossings lie decades apart."""
    poles = spread(seed)
    lag = series(*(transfer_function([p], [1.0, p]) for p in poles))
    loop = series(lag, gain(np.array([[1.5]])))
    found = one(loop)
    assert found.stable
    assert closed(scaled(loop, 0, found.gain_upper * 0.9999)).is_stable
    assert not closed(scaled(loop, 0, found.gain_upper * 1.0001)).is_stable


def test_what_is_no_loop() -> None:
    with pytest.raises(InputError, match="as many outputs as inputs"):
        loop_margins(gain(np.ones((2, 1))))


@pytest.mark.parametrize(
    ("numerator", "denominator", "lower", "upper"),
    [
        ([100.0], [1.0, 1e7 - 1e-6, -10.0], 0.1, np.inf),  # poles 1e13 apart
        ([1e9], [1.0, -1.0], 1e-9, np.inf),
        ([1e-9], [1.0, 3.0, 3.0, 1.0], 0.0, 8e9),
    ],
)
def test_bounds_of_gains_far_from_one(
    numerator: list[float], denominator: list[float], lower: float, upper: float
) -> None:
    """k/(s + 1)³ bears 8/k; k/(s − p) needs a gain of p/k."""
    found = one(transfer_function(numerator, denominator))
    assert_allclose(found.gain_lower, lower, rtol=1e-6)
    assert_allclose(found.gain_upper, upper, rtol=1e-6)


def test_poles_on_the_axis_bound_no_gain() -> None:
    """What rounding makes of the sign of L at an undamped pole is no crossing."""
    found = one(transfer_function([1.0, 0.2], [1.0, 5.0, 1.0, 5.0]))
    assert (found.gain_lower, found.gain_upper) == (0.0, np.inf)


@pytest.mark.parametrize("large", [0.0, 10.0])
def test_fast_poles_hide_no_crossing_of_slow_ones(large: float) -> None:
    """With k (s + z)²/s³ at −180° where ω = z, no gain less than z/(2 k) is borne.

    An actuator is 1e9 times as fast; two filters slower than all of it cancel each other.
    """
    z = k = 1e-3
    slow = transfer_function([k, 2.0 * k * z, k * z * z], [1.0, 0.0, 0.0, 0.0])
    loop = series(slow, transfer_function([1e6], [1.0, 1e6]))
    a, b, c = np.diag([-5e-6, -5e-6]), np.ones((2, 1)), large * np.array([[1.0, -1.0]])
    loop = LtiSystem(block_diag(loop.a, a), np.vstack([loop.b, b]), np.hstack([loop.c, c]), loop.d)
    found = one(loop)
    assert found.stable
    assert_allclose(found.gain_lower, 0.5, rtol=1e-4)
    assert_allclose(found.gain_lower_rad_s, z, rtol=1e-4)
    for factor, stable in ((0.52, True), (0.48, False)):
        assert closed(scaled(loop, 0, factor)).is_stable is stable
