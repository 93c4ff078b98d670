"""The first crossing of an event that only just happens, or just does not, within long steps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq
from tests.core.test_dynamics_locating import MOVING
from tests.core.test_dynamics_step_map import OSCILLATOR

from hillsphere.dynamics import StepMap, system
from hillsphere.interfaces import Array
from hillsphere.symbolic import exp

LANES = 60


def level(tau: Array | float, x0: Array, t0: float) -> Array:
    """Return g = x − (t − 4)/8 with ẍ = −4x, in closed form."""
    x = x0[0] * np.cos(2.0 * tau) + 0.5 * x0[1] * np.sin(2.0 * tau)
    return np.asarray(x - 0.125 * (t0 + tau - 4.0))


def touch(at: Array, gap: Array, t0: Array) -> Array:
    """Return the states at t0 of flights whose g has a minimum `gap` a time `at` later."""
    x, half = 0.125 * (t0 + at - 4.0) + gap, 0.5 * 0.125
    c, s = np.cos(2.0 * at), np.sin(2.0 * at)
    return np.array([x * c - half * s, 2.0 * (x * s + half * c)])


def first_fall(x0: Array, t0: float, at: float, end: float) -> float:
    """Return when g first falls through zero along the flight; NaN if it does not."""
    grid = np.append(np.linspace(0.0, end, 4001), at)
    grid = grid[np.argsort(np.abs(grid))]
    g = level(grid, x0, t0)
    falls = np.flatnonzero((g[:-1] > 0.0) & (g[1:] <= 0.0))
    if not len(falls):
        return float("nan")
    k = int(falls[0])
    return float(brentq(lambda tau: float(level(tau, x0, t0)), grid[k], grid[k + 1], xtol=1e-15))


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("steps", [3, 40])
def test_a_moving_plane_that_is_just_touched(steps: int, sense: float) -> None:
    rng = np.random.default_rng(5)
    end = 2.0 * sense
    # x < 0 where g has its minimum, so that it is one: t0 + at < 4.
    t0 = rng.uniform(-1.0, 1.5, LANES)
    at = end * rng.uniform(0.1, 0.9, LANES)
    gap = rng.choice([-1.0, 1.0], LANES) * 10.0 ** rng.uniform(-5.0, -1.0, LANES)
    x0 = touch(at, gap, t0)
    expected = np.array(
        [first_fall(x0[:, i], float(t0[i]), float(at[i]), end) for i in range(LANES)]
    )
    assert 10 < np.count_nonzero(np.isfinite(expected)) < LANES - 10
    found = StepMap(system(MOVING)).locate("moving", x0, end, steps, t0=t0)
    assert found.resolved.all()
    assert_array_equal(found.found, np.isfinite(expected))
    # Three steps of a third of a period: the formula's own error is 1e-6.
    assert_allclose(found.time, t0 + expected, rtol=0, atol=1e-4 if steps == 3 else 1e-8)


def test_without_a_bound_what_comes_close_is_not_resolved() -> None:
    """Of exp(x) − c nothing is bounded; x = a cos 2t."""
    s = system(OSCILLATOR)
    # From 1: its values at the ends of steps jump from above 0.1 to below −0.1; it hardly
    # reaches 0.05; it is far; it comes close only after it has crossed.
    c = np.exp(0.5)
    a = np.array([1.0, np.log(c + 0.05), 1.0, 1.0])
    duration = np.array([1.2, 0.02, 0.1, 3.0])
    found = StepMap(s).locate(exp(s.x[0]) - c, np.array([a, 0.0 * a]), duration, 4)
    assert_array_equal(found.found, [True, False, False, True])
    crossed = 0.5 * np.arccos(0.5)
    assert_allclose(found.time[[0, 3]], crossed, rtol=0, atol=2e-3)
    assert_array_equal(found.resolved, [True, False, True, True])
