r"""The pre-slewed ramp through a keyhole: the course with the least largest error.

Near its keyhole (the zenith of an azimuth-elevation mount) the primary axis cannot keep up. If it
waits until it cannot, it falls behind and the error peaks after the culmination. If it leaves early
it is ahead at first and behind later, and the peak is about half.

With an error of at most ε the primary axis must stay within :math:`\arcsin(\sin ε/\sin ρ)` of its
angle on target, ρ being the distance from the keyhole; within ε of the keyhole it is free. That is
a corridor. The least ε whose corridor holds a course that keeps the limits of rate and acceleration
is found by bisection; each trial is a linear programme. Of the courses that reach it, the one that
is nearest to the target on the whole is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.mounts import AxisLimits

__all__ = ["Ramp", "best_ramp", "corridor", "least_error_by_rate"]

_SLACK = 1.02
"""The course is smoothed within this much more than the least largest error."""
_TOLERANCE = 0.01
"""Relative width at which the bisection for the least error ends. Each trial is a linear programme,
and one percent of an error is less than predictions are known to."""
_SMALLEST = 1e-7
"""First guess (rad) of the least error: below any antenna's accuracy, so that a pass which needs no
ramp is told at once."""


@dataclass(frozen=True)
class Ramp:
    """A course of the primary axis through a keyhole.

    Parameters
    ----------
    primary_rad : ndarray, shape (K,)
        Angles.
    error_rad : float
        Largest error that the primary's lag costs, with the best secondary angle.
    """

    primary_rad: Array
    error_rad: float


def corridor(reference_rad: Array, distance_rad: Array, error_rad: float) -> tuple[Array, Array]:
    """Return between which primary angles the error stays small.

    Parameters
    ----------
    reference_rad : ndarray, shape (K,)
        Primary angles on target.
    distance_rad : ndarray, shape (K,)
        Of the target from the keyhole, in [0, π/2].
    error_rad : float
        Largest error.

    Returns
    -------
    lower_rad, upper_rad : ndarray, shape (K,)
        ∓∞ where any angle will do.
    """
    ratio = np.sin(error_rad) / np.maximum(np.sin(distance_rad), 1e-300)
    half = np.where(
        (error_rad >= distance_rad) | (ratio >= 1.0), np.inf, np.arcsin(np.minimum(ratio, 1.0))
    )
    return reference_rad - half, reference_rad + half


def least_error_by_rate(
    times_s: Array, reference_rad: Array, distance_rad: Array, limits: AxisLimits
) -> float:
    """Return the least largest error of any course that keeps the stops and the rate limit.

    A course through the corridor exists if, and only if, no two of its gates lie so far apart that
    the axis cannot get from one to the other in time; a lower bound with limited acceleration.

    Parameters
    ----------
    times_s, reference_rad, distance_rad : ndarray, shape (K,)
        Times, primary angles on target and distances of the target from the keyhole.
    limits : AxisLimits
        Stops and rate.

    Returns
    -------
    float
        Error, rad, to one percent; π/2 at most.
    """
    drift = limits.rate_rad_s * times_s

    def passable(error: float) -> bool:
        low, high = corridor(reference_rad, distance_rad, error)
        low, high = np.maximum(low, limits.lower_rad), np.minimum(high, limits.upper_rad)
        return bool(
            np.all(low <= high)
            and np.all(low - drift <= np.minimum.accumulate(high - drift))
            and np.all(np.maximum.accumulate(low + drift) <= high + drift)
        )

    return _bisect_error(passable, _SMALLEST)


def best_ramp(
    times_s: Array,
    reference_rad: Array,
    distance_rad: Array,
    limits: AxisLimits,
    held: tuple[bool, bool] = (True, True),
) -> Ramp | None:
    """Return the course with the least largest error.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Evenly spaced, K ≥ 5.
    reference_rad, distance_rad : ndarray, shape (K,)
        Primary angles on target and distances of the target from the keyhole.
    limits : AxisLimits
        Stops, rate and acceleration.
    held : tuple of bool
        Whether the first two and the last two angles must be those on target, or at the stop
        before it.

    Returns
    -------
    Ramp or None
        None if the ends that are held leave no course at all.

    Raises
    ------
    ConvergenceError
        If the last programme, which has a solution, is not solved.
    """
    pinned = np.zeros(times_s.size, dtype=bool)
    pinned[:2], pinned[-2:] = held[0], held[1]
    within = np.clip(reference_rad, limits.lower_rad, limits.upper_rad)

    def bounds(error: float) -> tuple[Array, Array]:
        low, high = corridor(reference_rad, distance_rad, error)
        low = np.where(pinned, within, np.maximum(low, limits.lower_rad))
        high = np.where(pinned, within, np.minimum(high, limits.upper_rad))
        return low, high

    matrix, room = _motion(times_s, limits)

    def passable(error: float) -> bool:
        low, high = bounds(error)
        return bool(np.all(low <= high)) and _solve(matrix, room, low, high) is not None

    if not passable(0.5 * pi):
        return None
    least = _bisect_error(
        passable, least_error_by_rate(times_s, reference_rad, distance_rad, limits)
    )
    least = min(least * _SLACK, 0.5 * pi)
    course = _solve(matrix, room, *bounds(least), reference_rad, np.sin(distance_rad))
    if course is None:
        raise ConvergenceError(
            f"no course through the keyhole at {times_s[0]:g}…{times_s[-1]:g} s was found with an"
            f" error of {np.degrees(least):.3g}°, though one exists; widen the axis limits a little"
        )
    return Ramp(course, least)


def _bisect_error(passable: Callable[[float], bool], start: float) -> float:
    """Return the least passable error, found upwards from a first guess; π/2 always passes."""
    low, high = 0.0, start
    while high < 0.5 * pi and not passable(high):
        low, high = high, min(2.0 * high, 0.5 * pi)
    if high == start:
        return start
    while high - low > _TOLERANCE * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if passable(middle) else (middle, high)
    return high


def _motion(times: Array, limits: AxisLimits) -> tuple[sparse.csr_array, Array]:
    """Return the matrix and right side, A q ≤ b, of the limits on rate and acceleration.

    Each row is divided by its limit: the solver's tolerance is then a small part of it.
    """
    count, step = times.size, float(times[1] - times[0])
    rate, change = limits.rate_rad_s * step, limits.acceleration_rad_s2 * step**2
    first = sparse.diags_array([-1.0 / rate, 1.0 / rate], offsets=[0, 1], shape=(count - 1, count))
    second = sparse.diags_array(
        [1.0 / change, -2.0 / change, 1.0 / change],
        offsets=[0, 1, 2],
        shape=(count - 2, count),
    )
    matrix = sparse.csr_array(sparse.vstack([first, -first, second, -second]))
    return matrix, np.ones(matrix.shape[0])


def _solve(
    matrix: sparse.csr_array,
    room: Array,
    low: Array,
    high: Array,
    reference: Array | None = None,
    weight: Array | None = None,
) -> Array | None:
    """Return a course within bounds, the nearest to a reference if one is given."""
    count = low.size
    cost = np.zeros(count)
    limits = np.column_stack([low, high])
    if reference is not None and weight is not None:
        # |q − r| ≤ s, and the weighted sum of s least
        unit = sparse.eye_array(count)
        empty = sparse.csr_array((matrix.shape[0], count))
        matrix = sparse.csr_array(
            sparse.vstack(
                [
                    sparse.hstack([matrix, empty]),
                    sparse.hstack([unit, -unit]),
                    sparse.hstack([-unit, -unit]),
                ]
            )
        )
        room = np.concatenate([room, reference, -reference])
        cost = np.concatenate([cost, weight])
        limits = np.vstack([limits, np.column_stack([np.zeros(count), np.full(count, np.inf)])])
    found = linprog(cost, A_ub=matrix, b_ub=room, bounds=limits, method="highs")
    return np.asarray(found.x[:count]) if found.status == 0 else None
