"""Where events lie that move in time, on lanes with clocks and steps of their own."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq
from tests.core.test_dynamics_step_map import OSCILLATOR, Equations

from hillsphere.dynamics import StepMap, system

MOVING = Equations(
    OSCILLATOR.law,
    OSCILLATOR.states,
    OSCILLATOR.values,
    OSCILLATOR.controls,
    {"moving": lambda x, t: x[0] - 0.125 * (t - 4.0)},
)


def test_an_event_that_moves_while_the_state_does() -> None:
    """Cos 2τ = (t0 + τ − 4)/8 by Brent's method, of lanes that start at other times."""
    t0 = np.array([0.0, 3.0, 7.5])
    duration = np.array([3.0, 2.0, 2.5])
    s = system(MOVING)
    x0 = np.array([np.ones(3), np.zeros(3)])
    found = StepMap(s, stm=True).locate("moving", x0, duration, 200, t0=t0)
    assert_array_equal(found.found, True)
    for k in range(3):
        tau = brentq(
            lambda tau, k=k: np.cos(2.0 * tau) - 0.125 * (t0[k] + tau - 4.0), 0.0, 1.5, xtol=1e-15
        )
        assert_allclose(found.time[k], t0[k] + tau, rtol=0, atol=1e-12)
        c, si = np.cos(2.0 * tau), np.sin(2.0 * tau)
        assert_allclose(found.x[:, k], [c, -2.0 * si], rtol=0, atol=1e-11)
        assert found.phi is not None
        assert_allclose(found.phi[:, :, k], [[c, si / 2.0], [-2.0 * si, c]], rtol=0, atol=1e-11)


def test_one_lane_meets_it_and_others_do_not() -> None:
    """A lane that ends before, one that starts behind it, one that meets it in the last step."""
    s = system(OSCILLATOR)
    # falls through −1/2 at acos(−1/2)/2 = π/3 for a = 1
    x0 = np.array([[1.0, -0.9, 1.0], [0.0, 0.0, 0.0]])
    duration = np.array([1.0, 0.2, np.pi / 3.0 + 1e-3])
    found = StepMap(s).locate("ground", x0, duration, 64)
    assert_array_equal(found.found, [False, False, True])
    assert_array_equal(np.isnan(found.time), [True, True, False])
    assert_allclose(found.time[2], np.pi / 3.0, rtol=0, atol=1e-11)
    ends = [np.cos(2.0), -0.9 * np.cos(0.4), -0.5]
    assert_allclose(found.x[0], ends, rtol=0, atol=1e-9)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_crossing_before_the_wait_is_over_does_not_count(sense: float) -> None:
    """Steps of exactly 1/64: the crossing at π/4 lies in the one from 50/64 to 51/64."""
    s = system(OSCILLATOR)
    step_map = StepMap(s)
    for after, expected in ((0.0, np.pi / 4.0), (51.0 / 64.0, 3.0 * np.pi / 4.0)):
        found = step_map.locate(
            s.x[0], [1.0, 0.0], sense * 4.0, 256, direction=0, after=sense * after
        )
        assert_allclose(found.time, sense * expected, rtol=0, atol=1e-11)


def test_the_first_of_several_crossings_by_lane() -> None:
    """Lanes of other amplitudes, each first through the level from above."""
    a = np.array([0.6, 0.75, 1.5, 4.0])
    s = system(OSCILLATOR)
    found = StepMap(s).locate("ground", np.array([a, 0.0 * a]), 7.0, 700)
    assert_allclose(found.time, 0.5 * np.arccos(-0.5 / a), rtol=0, atol=1e-11)
    rising = StepMap(s).locate("ground", np.array([a, 0.0 * a]), 7.0, 700, direction=1)
    assert_allclose(rising.time, np.pi - 0.5 * np.arccos(-0.5 / a), rtol=0, atol=1e-11)
