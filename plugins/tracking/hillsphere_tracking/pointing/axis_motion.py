r"""How an axis follows its target, one period at a time, without ever exceeding its limits.

The axis moves at a constant rate v during each period T, and v changes by at most aT from one
period to the next. Relative to a target that moves evenly, the shortest way to be at rest on it is
to close in at full acceleration and to brake at full deceleration. Braking from
:math:`v = (m + f)\,aT` with a whole m and 0 ≤ f < 1 takes the rates v, v − aT, … f aT, over

.. math:: d = aT^2\left(\tfrac12 m(m + 1) + (m + 1) f\right).

Its inverse v(d) is the largest rate at which the axis may close in from a distance d.

The same bound, with the distance to a stop, keeps an axis from running into it: a rate within the
bound now can be reduced to within it in the next period. (A continuous-time law, √(2ad), would
overshoot by up to one period's motion and chatter.)

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
    """Where an axis stands and how it moves, for N cases.

    Parameters
    ----------
    angle_rad : ndarray, shape (N,)
        Angle commanded last.
    rate_rad_s : ndarray, shape (N,)
        Rate of the last period.
    """

    angle_rad: Array
    rate_rad_s: Array


def at_rest(angle_rad: Array | float) -> AxisState:
    """Return an axis that stands at an angle, rad, a number or shape (N,)."""
    angle = np.atleast_1d(np.asarray(angle_rad, dtype=float))
    return AxisState(angle, np.zeros_like(angle))


def braking_rate(distance_rad: Array, acceleration_rad_s2: float, period_s: float) -> Array:
    """Return the largest rate for the next period that can still be braked within a distance.

    Parameters
    ----------
    distance_rad : ndarray, shape (N,)
        How far it is; nothing is left of a negative one.
    acceleration_rad_s2, period_s : float
        Largest deceleration and the period.

    Returns
    -------
    ndarray, shape (N,)
        Rates, rad/s, ≥ 0.
    """
    unit = acceleration_rad_s2 * period_s**2
    room = np.maximum(distance_rad, 0.0) / unit
    whole = np.floor(np.sqrt(0.25 + 2.0 * room) - 0.5)
    part = (room - 0.5 * whole * (whole + 1.0)) / (whole + 1.0)
    return np.asarray((whole + part) * (unit / period_s))


def advance(
    state: AxisState, target_rad: Array, next_rad: Array, period_s: float, limits: AxisLimits
) -> AxisState:
    """Move an axis for one period towards its target.

    An axis on its target stays on it as long as the limits let it; one that has fallen behind
    closes in as fast as they allow, and stops without overshoot on a target that moves evenly.

    Parameters
    ----------
    state : AxisState
        Now, within the stops and with a rate that can be braked before them.
    target_rad, next_rad : ndarray, shape (N,)
        Where it should be now and one period on. Targets beyond a stop count as at it.
    period_s : float
        Length of the period, the same at every call.
    limits : AxisLimits
        Stops, rate and acceleration.

    Returns
    -------
    AxisState
        One period on.

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
    change = limits.acceleration_rad_s2 * period_s
    behind = now - angle
    closing = braking_rate(np.abs(behind), limits.acceleration_rad_s2, period_s)
    wanted = (then - now) / period_s + np.copysign(closing, behind)
    # what can be reached in one period, then what the stops permit: see the module's text
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
    """Follow a whole course of targets.

    Parameters
    ----------
    targets_rad : ndarray, shape (K,) or (K, N)
        One period apart.
    period_s : float
        Between targets.
    limits : AxisLimits
        Stops, rate and acceleration.
    start : AxisState, optional
        At the first target's time; at rest on the first target by default.

    Returns
    -------
    angle_rad, rate_rad_s : ndarray, shape of `targets_rad`
        Angles at the targets' times, and the rates of the periods that end then.

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
