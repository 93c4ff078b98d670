from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.disk_margins import (
    DiskMargin,
    disk_margin,
    disk_margin_of_both_ends,
)
from hillsphere_controllers.analysis.margins import loop_margins
from hillsphere_controllers.systems.algebra import append, feedback, gain, series
from hillsphere_controllers.systems.conversion import to_control, transfer_function
from hillsphere_controllers.systems.holding import zero_order_hold

THIRD = transfer_function([2.0], [1.0, 3.0, 3.0, 1.0])


def spinning(a: float) -> LtiSystem:
    """1/(s² + a²) [s − a², a(s + 1); −a(s + 1), s − a²]."""
    return LtiSystem(
        np.array([[0.0, a], [-a, 0.0]]), np.eye(2), np.array([[1.0, a], [-a, 1.0]]),
        np.zeros((2, 2)),
    )  # fmt: skip


def test_spinning_body_in_closed_form() -> None:
    """T = [1 a; −a 1]/(s + 1), so that S − I/2 has the norm (a + √(1 + a²))/2.

    At this point each loop alone has all gain and 90° of phase: both together have next to nothing.
    """
    a = 10.0
    alpha = 2.0 * (np.sqrt(1.0 + a * a) - a)
    found = disk_margin(spinning(a), factors="full")
    assert_allclose(found.alpha, alpha, rtol=1e-8)
    # factors of their own for each channel do no less harm
    assert_allclose(disk_margin(spinning(a)).alpha, alpha, rtol=2e-4)
    assert_allclose(
        [found.gain_lower, found.gain_upper],
        [(2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)],
        rtol=1e-8,
    )
    assert_allclose(found.phase_rad, 2.0 * np.arctan(0.5 * alpha), rtol=1e-8)
    assert all(m.phase_rad > 1.5 for m in loop_margins(spinning(a)))


@pytest.mark.parametrize("skew", [0.0, 1.0, -1.0, 0.3])
def test_the_disk_touches_the_curve_and_no_more(skew: float) -> None:
    """The least |δ| that some frequency needs, over the whole curve −1/L."""
    omega = np.concatenate([[0.0], np.logspace(-3, 3, 200_001)])
    factor = -1.0 / THIRD.response(omega)[:, 0, 0]
    # f = (1 + (1 − σ)/2 αδ)/(1 − (1 + σ)/2 αδ), solved for αδ
    needed = np.abs((factor - 1.0) / (0.5 * (1.0 - skew) + 0.5 * (1.0 + skew) * factor))
    found = disk_margin(THIRD, skew)
    assert_allclose(found.alpha, needed.min(), rtol=1e-7)
    assert_allclose(found.frequency_rad_s, omega[needed.argmin()], rtol=1e-3)


def factors(found: DiskMargin, delta: complex) -> complex:
    u = 0.5 * (1.0 - found.skew) * found.alpha * delta
    v = 0.5 * (1.0 + found.skew) * found.alpha * delta
    return (1.0 + u) / (1.0 - v)


@pytest.mark.parametrize("skew", [0.0, 1.0, -1.0, 0.7])
def test_gain_and_phase_are_those_of_the_disk(skew: float) -> None:
    found = disk_margin(THIRD, skew)
    ring = np.array([factors(found, z) for z in np.exp(1j * np.linspace(0, 2 * np.pi, 100_001))])
    real = [factors(found, -1.0).real, factors(found, 1.0).real]
    assert_allclose([found.gain_lower, found.gain_upper], real, rtol=1e-12)
    # where its edge has the size one
    size = np.log(np.abs(ring))
    place = np.flatnonzero(size[1:] * size[:-1] <= 0.0)
    assert_allclose(found.phase_rad, np.abs(np.angle(ring[place])).max(), rtol=0, atol=2e-4)


def test_skews_of_the_sensitivities() -> None:
    """σ = 1: 1/‖S‖∞, the distance of the curve from −1; σ = −1: 1/‖T‖∞."""
    omega = np.logspace(-3, 3, 200_001)
    curve = THIRD.response(omega)[:, 0, 0]
    assert_allclose(disk_margin(THIRD, 1.0).alpha, np.abs(1.0 + curve).min(), rtol=1e-7)
    assert_allclose(disk_margin(THIRD, -1.0).alpha, np.abs(1.0 + 1.0 / curve).min(), rtol=1e-7)


def test_python_control_finds_the_same() -> None:
    control = pytest.importorskip("control")
    theirs = control.disk_margins(to_control(THIRD), np.logspace(-1, 1, 3001))
    found = disk_margin(THIRD)
    assert_allclose(found.alpha, theirs[0], rtol=1e-5)
    assert_allclose(20.0 * np.log10(found.gain_upper), theirs[1], rtol=1e-5)
    assert_allclose(np.degrees(found.phase_rad), theirs[2], rtol=1e-5)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.integers(1, 5), st.booleans(), st.floats(-1.0, 1.0))
def test_every_factor_inside_keeps_the_loop_stable(
    seed: int, order: int, sampled: bool, skew: float
) -> None:
    """Real factors on all channels at once, at both ends of the disk and between."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order)) - 0.5 * np.eye(order)
    if sampled:
        a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
    loop = LtiSystem(
        a, random.normal(size=(order, 2)), random.normal(size=(2, order)), np.zeros((2, 2)),
        0.1 if sampled else None,
    )  # fmt: skip
    one = gain(np.eye(2), loop.dt_s)
    found = disk_margin(loop, skew)
    assert (found.alpha > 0.0) == feedback(loop, one).is_stable
    assume(found.alpha > 0.0)
    for _ in range(10):
        pair = [factors(found, complex(d)).real for d in random.uniform(-0.999, 0.999, size=2)]
        assert feedback(series(loop, gain(np.diag(pair), loop.dt_s)), one).is_stable
    # and no channel alone bears less than the disk promises
    for margins in loop_margins(loop):
        assert found.gain_upper <= margins.gain_upper * (1.0 + 1e-6)
        assert found.phase_rad <= margins.phase_rad + 1e-6


def test_factors_of_their_own_bear_more_than_those_that_mix() -> None:
    """Of channels that act one way only: each then counts by itself."""
    first, second = (transfer_function([k], [1.0, 3.0, 3.0, 1.0]) for k in (2.0, 4.0))
    loop = series(append(first, second), gain(np.array([[1.0, 0.0], [5.0, 1.0]])))
    own, mixing = disk_margin(loop), disk_margin(loop, factors="full")
    alone = disk_margin(second).alpha
    assert alone < disk_margin(first).alpha
    assert_allclose(own.alpha, alone, rtol=1e-3)
    assert own.alpha <= alone
    assert mixing.alpha < 0.5 * own.alpha


def test_both_ends_bear_less_than_each() -> None:
    plant, controller = spinning(3.0), gain(np.array([[1.0, 0.2], [0.0, 1.5]]))
    both = disk_margin_of_both_ends(plant, controller)
    at_controls = disk_margin(series(plant, controller))
    at_measurements = disk_margin(series(controller, plant))
    assert 0.0 < both.alpha <= min(at_controls.alpha, at_measurements.alpha) * (1.0 + 1e-9)
    # for a loop of gain one and one channel, changing both ends by f changes it by f²
    lag = transfer_function([2.0], [1.0, 3.0, 3.0, 1.0])
    found = disk_margin_of_both_ends(lag, gain(np.eye(1)))
    assert found.gain_upper**2 <= loop_margins(lag)[0].gain_upper
    assert 2.0 * found.phase_rad <= loop_margins(lag)[0].phase_rad


def test_discrete_time_is_what_the_computer_sees() -> None:
    """A hold of 0.2 s takes its share."""
    assert disk_margin(zero_order_hold(THIRD, 0.2)).alpha < 0.95 * disk_margin(THIRD).alpha
    assert_allclose(
        disk_margin(zero_order_hold(THIRD, 1e-4)).alpha, disk_margin(THIRD).alpha, rtol=1e-3
    )


def test_loops_without_margin_and_without_end() -> None:
    none = disk_margin(transfer_function([20.0], [1.0, 3.0, 3.0, 1.0]))
    assert (none.alpha, none.gain_lower, none.gain_upper, none.phase_rad) == (0.0, 1.0, 1.0, 0.0)
    assert np.isnan(none.frequency_rad_s)
    # L = 1: S − I/2 vanishes, every factor but −1 does
    endless = disk_margin(gain(np.eye(1)))
    assert (endless.alpha, endless.gain_upper, endless.phase_rad) == (np.inf, np.inf, np.pi)


def test_what_is_no_loop() -> None:
    with pytest.raises(InputError, match="as many outputs as inputs"):
        disk_margin(gain(np.ones((2, 1))))
    with pytest.raises(InputError, match="skew must be finite"):
        disk_margin(THIRD, np.nan)
    with pytest.raises(InputError, match="needs a controller of 1 × 1"):
        disk_margin_of_both_ends(THIRD, gain(np.eye(2)))
