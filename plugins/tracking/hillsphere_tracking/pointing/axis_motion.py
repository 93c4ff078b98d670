r"""Motion of an axis that follows a target in discrete time, within its limits.

The axis moves at a constant rate v during each period T, and v changes by at most aT from one
period to the next. Relative to a target of constant rate, the time-optimal approach [1]_ is full
acceleration followed by full deceleration. Braking from
:math:`v = (m + f)\,aT` with a whole m and 0 ≤ f < 1 takes the rates v, v − aT, … f aT, over

.. math:: d = aT^2\left(\tfrac12 m(m + 1) + (m + 1) f\right).

Its inverse v(d) is the largest rate at which the axis may approach from a distance d.

The same bound, with d the distance to a stop, keeps the axis from hitting the stop: a rate within
the bound can always be reduced to the bound of the next period. The continuous-time law √(2ad)
would overshoot by up to the motion of one period, and chatter.

References
----------
.. [1] J. Han (2009), From PID to Active Disturbance Rejection Control, IEEE Transactions on
   Industrial Electronics 56(3), 900-906 (time-optimal feedback in discrete time).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.mounts import AxisLimits

__all__ = ["AxisState", "advance", "at_rest", "braking_rate", "follow"]


@dataclass(frozen=True)
class AxisState:
    """Angle and rate of an axis, for N cases.

    Parameters
    ----------
    angle_rad : ndarray, shape (N,)
        Last commanded angle.
    rate_rad_s : ndarray, shape (N,)
        Rate during the last period.
    """

    angle_rad: Array
    rate_rad_s: Array


def at_rest(angle_rad: Array | float) -> AxisState:
    """Return the state of an axis at rest at an angle, rad, a number or an array (N,)."""
    angle = np.atleast_1d(np.asarray(angle_rad, dtype=float))
    return AxisState(angle, np.zeros_like(angle))


def braking_rate(distance_rad: Array, acceleration_rad_s2: float, period_s: float) -> Array:
    """Return the largest rate of the next period from which the axis can brake within a distance.

    Parameters
    ----------
    distance_rad : ndarray, shape (N,)
        Distance; negative distances count as 0.
    acceleration_rad_s2, period_s : float
        Largest deceleration, and length of a period.

    Returns
    -------
    ndarray, shape (N,)
        Rates, rad/s, ≥ 0.
    """
    # Inverse of d(v): m = ⌊√(1/4 + 2 d/(aT²)) − 1/2⌋, f from the rest, v = (m + f) aT.
    unit = acceleration_rad_s2 * period_s**2
    room = np.maximum(distance_rad, 0.0) / unit
    whole = np.floor(np.sqrt(0.25 + 2.0 * room) - 0.5)
    part = (room - 0.5 * whole * (whole + 1.0)) / (whole + 1.0)
    return np.asarray((whole + part) * (unit / period_s))


def advance(
    state: AxisState, target_rad: Array, next_rad: Array, period_s: float, limits: AxisLimits
) -> AxisState:
    """Move an axis towards its target for one period.

    An axis on its target stays on it while the limits permit. An axis behind its target approaches
    it as fast as the limits permit, without overshoot if the target has a constant rate.

    Parameters
    ----------
    state : AxisState
        Current state, within the stops and able to brake before them.
    target_rad, next_rad : ndarray, shape (N,)
        Target now and after one period. Targets beyond a stop are clipped to it.
    period_s : float
        Length of the period, equal in all calls.
    limits : AxisLimits
        Stops, rate and acceleration.

    Returns
    -------
    AxisState
        State after one period.

    Raises
    ------
    InputError
        If the period is not positive or a target is not finite.
    """
    if not period_s > 0.0:
        raise InputError(f"the period between commands must be > 0 s, got {period_s:g}")
    now = np.clip(target_rad, limits.lower_rad, limits.upper_rad)
    then = np.clip(next_rad, limits.lower_rad, limits.upper_rad)
    if not (np.isfinite(now).all() and np.isfinite(then).all()):
        raise InputError("an axis's targets must be finite, got nan")
    angle, rate = state.angle_rad, state.rate_rad_s
    # largest change of rate between two periods
    change = limits.acceleration_rad_s2 * period_s
    # rate of the target plus the rate of approach
    behind = now - angle
    closing = braking_rate(np.abs(behind), limits.acceleration_rad_s2, period_s)
    wanted = (then - now) / period_s + np.copysign(closing, behind)
    # First the bound of the stops, then the limits of acceleration and rate. The second cannot
    # violate the first: the old rate obeyed the bound of the old distance.
    wanted = np.clip(
        wanted,
        -braking_rate(angle - limits.lower_rad, limits.acceleration_rad_s2, period_s),
        braking_rate(limits.upper_rad - angle, limits.acceleration_rad_s2, period_s),
    )
    reached = np.clip(
        np.clip(wanted, rate - change, rate + change), -limits.rate_rad_s, limits.rate_rad_s
    )
    return AxisState(angle + reached * period_s, reached)


def follow(
    targets_rad: Array, period_s: float, limits: AxisLimits, start: AxisState | None = None
) -> tuple[Array, Array]:
    """Follow a sequence of targets.

    Parameters
    ----------
    targets_rad : ndarray, shape (K,) or (K, N)
        Targets, one period apart.
    period_s : float
        Interval between targets.
    limits : AxisLimits
        Stops, rate and acceleration.
    start : AxisState, optional
        State at the time of the first target; by default at rest on it.

    Returns
    -------
    angle_rad, rate_rad_s : ndarray, shape of `targets_rad`
        Angles at the times of the targets, and rates of the periods that end then.

    Raises
    ------
    InputError
        As for `advance`.
    """
    targets = np.asarray(targets_rad, dtype=float)
    courses = targets.reshape(targets.shape[0], -1)
    state = start or at_rest(np.clip(courses[0], limits.lower_rad, limits.upper_rad))
    angle, rate = np.empty_like(courses), np.empty_like(courses)
    angle[0], rate[0] = state.angle_rad, state.rate_rad_s
    for k in range(1, courses.shape[0]):
        state = advance(state, courses[k - 1], courses[k], period_s, limits)
        angle[k], rate[k] = state.angle_rad, state.rate_rad_s
    return angle.reshape(targets.shape), rate.reshape(targets.shape)
