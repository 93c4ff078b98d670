"""Margins of loops with delays against crossings that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import hillsphere_controllers as hc

LAG = hc.transfer_function([2.0], [1.0, 1.0])
INTEGRATOR = hc.transfer_function([1.0], [1.0, 0.0])


def test_integrator_and_lag_side_by_side() -> None:
    """The loop e^{-0.5 s}/s crosses at 1 and π rad/s, the lag at √3 and where its phase is −π."""
    first, second = hc.margins(
        hc.append(hc.delay(0.5) @ INTEGRATOR, hc.series(LAG, hc.delay(0.3)))
    ).loops
    assert first.stable
    assert (first.gain_lower, first.gain_upper) == pytest.approx((0.0, np.pi), rel=1e-8)
    assert first.phase_rad == pytest.approx(0.5 * np.pi - 0.5, rel=1e-8)
    assert first.delay_s == pytest.approx(0.5 * np.pi - 0.5, rel=1e-8)
    turn = brentq(lambda w: 0.3 * w + np.arctan(w) - np.pi, 1.0, 20.0)
    assert second.gain_upper == pytest.approx(0.5 * np.hypot(1.0, turn), rel=1e-8)
    assert second.delay_s == pytest.approx((np.pi - np.pi / 3.0) / np.sqrt(3.0) - 0.3, rel=1e-8)


def test_an_unstable_plant_has_a_least_gain() -> None:
    """3 e^{-0.1 s}/(s − 1): the gain of 1 at zero is needed; the phase is −π again at ω."""
    (made,) = hc.margins(hc.delay(0.1) @ hc.transfer_function([3.0], [1.0, -1.0])).loops
    turn = brentq(lambda w: np.arctan(w) - 0.1 * w, 1.0, 20.0)
    assert made.gain_lower == pytest.approx(1.0 / 3.0, rel=1e-8)
    assert made.gain_upper == pytest.approx(np.hypot(1.0, turn) / 3.0, rel=1e-8)


def test_an_unstable_loop_and_the_bounds_of_the_delay() -> None:
    assert not hc.margins(hc.delay(5.0) @ LAG).loops[0].stable
    (alone,) = hc.margins(hc.delay(0.3) @ LAG).loops
    both = hc.delaymargin(hc.delay(0.3) @ LAG, 5.0)
    assert both.lower_s < alone.delay_s < both.upper_s


def test_sum_of_an_uncertain_system_and_one_after_the_other() -> None:
    k = hc.ureal("k", 3.0, percentage=10)
    made = hc.parallel(hc.series(LAG, k), 1.0)
    assert made.nominal.response(np.array([0.0]))[0, 0, 0] == pytest.approx(7.0)
    assert [u.name for u in made.uncertainties] == ["k"]
