r"""Pre-slewed ramp through a keyhole: the course of the primary axis with the least maximum error.

Near its keyhole (the zenith of an azimuth-elevation mount) the primary axis is too slow for the
target. An axis that follows as long as it can falls behind, and the error peaks after the
culmination. An axis that leaves the target early is ahead at first and behind later, and the peak
is about half as large.

For an error of at most ε the primary angle must be within :math:`\arcsin(\sin ε/\sin ρ)` of the
angle on target, where ρ is the distance of the target from the keyhole; for ρ ≤ ε it is free. These
bounds form a corridor. The least ε whose corridor contains a course within the limits of rate and
acceleration is found by bisection; each trial is a linear programme. Among the courses with this
ε, the one with the least weighted mean distance from the target is taken.
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
"""Factor of the least error within which the final course is optimised: at exactly the least error
the corridor contains a single course, and rounding could exclude it. More would give away error."""
_TOLERANCE = 0.01
"""Relative width at which the bisection for the least error ends. Each trial is a linear programme,
and one percent of an error is less than predictions are known to."""
_SMALLEST = 1e-7
"""First guess (rad) of the least error: below any antenna's accuracy, so that a pass which needs no
ramp is told at once."""


@dataclass(frozen=True)
class Ramp:
    """Course of the primary axis through a keyhole.

    Parameters
    ----------
    primary_rad : ndarray, shape (K,)
        Angles of the primary axis.
    error_rad : float
        Largest error on the sky, with the best secondary angle.
    """

    primary_rad: Array
    error_rad: float


def corridor(reference_rad: Array, distance_rad: Array, error_rad: float) -> tuple[Array, Array]:
    """Return the bounds of the primary angle for a given largest error.

    Parameters
    ----------
    reference_rad : ndarray, shape (K,)
        Primary angles on target.
    distance_rad : ndarray, shape (K,)
        Distance of the target from the keyhole, in [0, π/2].
    error_rad : float
        Largest error.

    Returns
    -------
    lower_rad, upper_rad : ndarray, shape (K,)
        Bounds; ∓∞ where the primary angle is free.
    """
    # Law of sines: a primary angle off by δ moves the beam's meridian to a distance ε from the
    # target, with sin ε = sin ρ sin δ.
    ratio = np.sin(error_rad) / np.maximum(np.sin(distance_rad), 1e-300)
    half = np.where(
        (error_rad >= distance_rad) | (ratio >= 1.0), np.inf, np.arcsin(np.minimum(ratio, 1.0))
    )
    return reference_rad - half, reference_rad + half


def least_error_by_rate(
    times_s: Array, reference_rad: Array, distance_rad: Array, limits: AxisLimits
) -> float:
    """Return the least maximum error of courses within the stops and the rate limit.

    A course exists exactly if, for every pair of times, the axis can move from the corridor at the
    one to the corridor at the other in time. Without the limit of acceleration this is a lower
    bound of the error of `best_ramp`.

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

    # For times s < t: low(t) − high(s) ≤ rate (t − s) and low(s) − high(t) ≤ rate (t − s), for all
    # pairs at once by running minima and maxima.
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
    """Return the course with the least maximum error (see the module).

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Evenly spaced, K ≥ 5.
    reference_rad, distance_rad : ndarray, shape (K,)
        Primary angles on target and distances of the target from the keyhole.
    limits : AxisLimits
        Stops, rate and acceleration.
    held : tuple of bool
        Whether the first two and the last two angles are fixed at the angles on target (clipped to
        the stops), so that angle and rate are continuous there.

    Returns
    -------
    Ramp or None
        None if no course satisfies the fixed ends.

    Raises
    ------
    ConvergenceError
        If the solver fails on the last programme, which has a solution.
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
            f"the solver found no course through the keyhole at {times_s[0]:g}…{times_s[-1]:g} s"
            f" with an error of {np.degrees(least):.3g}°, although one exists; widen the axis"
            " limits slightly"
        )
    return Ramp(course, least)


def _bisect_error(passable: Callable[[float], bool], start: float) -> float:
    """Return the least error that is `passable`, by doubling from `start` and then bisection.

    An error of π/2 always passes. The result exceeds the least error by at most `_TOLERANCE` of it.
    """
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
    """Return A and b of the limits A q ≤ b on rate and acceleration (first, second differences).

    Each row is divided by its limit, so that the solver's tolerance is relative to it.
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
    """Return a feasible course within bounds, or None.

    With a reference r and weights w the course minimises Σ w |q − r|.
    """
    count = low.size
    cost = np.zeros(count)
    limits = np.column_stack([low, high])
    if reference is not None and weight is not None:
        # slack variables s with q − r ≤ s and r − q ≤ s; minimise the weighted sum of s
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
    solution = linprog(cost, A_ub=matrix, b_ub=room, bounds=limits, method="highs")
    return np.asarray(solution.x[:count]) if solution.status == 0 else None
