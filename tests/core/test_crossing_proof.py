"""The first crossing of an event that only just happens, or just does not, within long steps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy.optimize import brentq
from tests.core.test_dynamics_step_map import OSCILLATOR, Equations

from hillsphere.dynamics import StepMap, system
from hillsphere.interfaces import Array
from hillsphere.symbolic import exp, sin

LANES = 60
PLANES = Equations(
    OSCILLATOR.law,
    OSCILLATOR.states,
    OSCILLATOR.values,
    OSCILLATOR.controls,
    {
        "steady": lambda x, t: x[0] - 0.125 * (t - 4.0),
        "shaken": lambda x, t: x[0] - 0.125 * (t - 4.0) - 0.25 * sin(5.0 * t),
    },
)
"""Planes that move, the second not evenly: its own slope changes within a step."""
SHAKEN = {"steady": 0.0, "shaken": 0.25}


def plane(t: Array, shaken: float) -> tuple[Array, Array, Array]:
    """Return where a plane is, and its first two derivatives."""
    s, c = shaken * np.sin(5.0 * t), shaken * np.cos(5.0 * t)
    return 0.125 * (t - 4.0) + s, 0.125 + 5.0 * c, -25.0 * s


def level(tau: Array | float, x0: Array, t0: float, shaken: float) -> Array:
    """Return the height above a plane with ẍ = −4x, in closed form."""
    x = x0[0] * np.cos(2.0 * tau) + 0.5 * x0[1] * np.sin(2.0 * tau)
    return np.asarray(x - plane(np.asarray(t0 + tau), shaken)[0])


def touch(at: Array, gap: Array, t0: Array, shaken: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return the states at t0 of flights that are `gap` above the plane a time `at` later.

    Their heights have no slope there; the second output says where it is a minimum.
    """
    height, slope, bend = plane(t0 + at, shaken)
    x, half = height + gap, 0.5 * slope
    c, s = np.cos(2.0 * at), np.sin(2.0 * at)
    return np.array([x * c - half * s, 2.0 * (x * s + half * c)]), -4.0 * x - bend > 0.5


def first_fall(x0: Array, t0: float, at: float, end: float, shaken: float) -> float:
    """Return when the height first falls through zero along the flight; NaN if it does not."""
    grid = np.append(np.linspace(0.0, end, 4001), at)
    grid = grid[np.argsort(np.abs(grid))]
    g = level(grid, x0, t0, shaken)
    falls = np.flatnonzero((g[:-1] > 0.0) & (g[1:] <= 0.0))
    if not len(falls):
        return float("nan")
    k = int(falls[0])
    ends = grid[k], grid[k + 1]
    return float(brentq(lambda tau: float(level(tau, x0, t0, shaken)), *ends, xtol=1e-15))


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("steps", [4, 40])
@pytest.mark.parametrize("event", SHAKEN)
def test_a_moving_plane_that_is_just_touched(event: str, steps: int, sense: float) -> None:
    rng, shaken = np.random.default_rng(5), SHAKEN[event]
    end = 2.0 * sense
    t0 = rng.uniform(-1.0, 1.5, 4 * LANES)
    at = end * rng.uniform(0.1, 0.9, 4 * LANES)
    gap = rng.choice([-1.0, 1.0], 4 * LANES) * 10.0 ** rng.uniform(-5.0, -1.0, 4 * LANES)
    x0, touches = touch(at, gap, t0, shaken)
    some = np.flatnonzero(touches)[:LANES]
    x0, t0, at = x0[:, some], t0[some], at[some]
    expected = np.array(
        [first_fall(x0[:, i], float(t0[i]), float(at[i]), end, shaken) for i in range(len(some))]
    )
    assert 10 < np.count_nonzero(np.isfinite(expected)) < len(some) - 10
    found = StepMap(system(PLANES)).locate(event, x0, end, steps, t0=t0)
    assert found.resolved.all()
    assert_array_equal(found.found, np.isfinite(expected))
    # At the end of the flight the formula errs by 2.4e-7 in four steps, and by 1e-15 in forty.
    # Where the height has a slope of √(2 · 1e-5 · 0.5) that is a time three hundred times as large.
    assert_allclose(found.time, t0 + expected, rtol=0, atol=8e-5 if steps == 4 else 1e-12)


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
