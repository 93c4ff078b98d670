"""Commands to the axes, sample by sample or for a whole pass.

A step of the stream takes the newest prediction, interpolates it to now and to one period on, looks
beside it if a search is under way, lets the plan say which axis angles are meant, and moves the
axes as far towards them as their limits allow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.axis_motion import AxisState, advance, at_rest, follow
from hillsphere_tracking.pointing.interpolation import smooth
from hillsphere_tracking.pointing.pass_plan import PassPlan
from hillsphere_tracking.pointing.sky import offset
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Beside", "Commands", "PointingState", "advance_pointing", "begin", "command_pass"]

Beside: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Arcs to the right and up, rad, at times, s, by which to look beside the prediction."""


@dataclass(frozen=True)
class PointingState:
    """Where the antenna has been sent.

    Parameters
    ----------
    time_s : float
        For when the axis angles are meant.
    primary, secondary : AxisState
        Of both axes, for one case.
    """

    time_s: float
    primary: AxisState
    secondary: AxisState


@dataclass(frozen=True, eq=False)
class Commands:
    """Commands of a whole pass.

    Parameters
    ----------
    times_s : ndarray, shape (N,)
        One period apart.
    primary_rad, secondary_rad : ndarray, shape (N,)
        Axis angles: within the stops, the rates and the accelerations.
    error_rad : ndarray, shape (N,)
        Angle on the sky between the commands and what they were to point at.
    """

    times_s: Array
    primary_rad: Array
    secondary_rad: Array
    error_rad: Array


def begin(plan: PassPlan, time_s: float, primary_rad: float, secondary_rad: float) -> PointingState:
    """Return the state of an antenna at rest.

    Parameters
    ----------
    plan : PassPlan
        To be followed.
    time_s : float
        Now.
    primary_rad, secondary_rad : float
        Where its axes stand.

    Returns
    -------
    PointingState
        At rest there.

    Raises
    ------
    InputError
        If an axis stands beyond its stops.
    """
    for name, angle, limits in (
        ("primary", primary_rad, plan.mount.primary),
        ("secondary", secondary_rad, plan.mount.secondary),
    ):
        if not limits.lower_rad <= angle <= limits.upper_rad:
            raise InputError(
                f"the {name} axis stands at {np.degrees(angle):.6g}°, beyond its stops at"
                f" {np.degrees(limits.lower_rad):g}° and {np.degrees(limits.upper_rad):g}°;"
                " correct the limits, or move the axis by hand"
            )
    return PointingState(time_s, at_rest(primary_rad), at_rest(secondary_rad))


def advance_pointing(
    plan: PassPlan,
    state: PointingState,
    prediction: tuple[Array, Array, Array],
    period_s: float,
    beside: Beside | None = None,
) -> PointingState:
    """Return the next command.

    Parameters
    ----------
    plan : PassPlan
        Turn, flips and ramps.
    state : PointingState
        The command before.
    prediction : tuple of three ndarray, shape (K,)
        Times, azimuths and elevations, s and rad, from `state.time_s` or before to one period later
        or beyond.
    period_s : float
        Between commands, the same at every call.
    beside : callable, optional
        Where to look beside the prediction: `search.Search.at`.

    Returns
    -------
    PointingState
        One period on.

    Raises
    ------
    InputError
        If the prediction does not reach so far, or the period is not positive.
    """
    at = state.time_s + np.array([0.0, period_s])
    azimuth, elevation = smooth(*prediction, at)
    if beside is not None:
        azimuth, elevation = offset(azimuth, elevation, *beside(at))
    primary, secondary = plan.targets(at, azimuth, elevation)
    mount = plan.mount
    return PointingState(
        float(at[1]),
        advance(state.primary, primary[:1], primary[1:], period_s, mount.primary),
        advance(state.secondary, secondary[:1], secondary[1:], period_s, mount.secondary),
    )


def command_pass(
    plan: PassPlan,
    prediction: tuple[Array, Array, Array],
    period_s: float,
    beside: Beside | None = None,
) -> Commands:
    """Return all commands of a prediction; the antenna waits at its beginning.

    Parameters
    ----------
    plan : PassPlan
        Turn, flips and ramps.
    prediction : tuple of three ndarray, shape (K,)
        Times, azimuths and elevations, s and rad.
    period_s : float
        Between commands.
    beside : callable, optional
        Where to look beside the prediction: `search.Search.at`.

    Returns
    -------
    Commands
        From the first predicted time to the last.

    Raises
    ------
    InputError
        If the prediction is not in order or the period is not positive.
    """
    if not period_s > 0.0:
        raise InputError(f"the period between commands must be > 0 s, got {period_s:g}")
    times = np.asarray(prediction[0], dtype=float)
    count = int(np.floor((times[-1] - times[0]) / period_s + 1e-9)) + 1
    at = np.minimum(times[0] + period_s * np.arange(count), times[-1])
    azimuth, elevation = smooth(*prediction, at)
    if beside is not None:
        azimuth, elevation = offset(azimuth, elevation, *beside(at))
    wanted = plan.targets(at, azimuth, elevation)
    mount = plan.mount
    primary, _ = follow(wanted[0], period_s, mount.primary)
    secondary, _ = follow(wanted[1], period_s, mount.secondary)
    error = mount.error(direction_cosines(azimuth, elevation), primary, secondary)
    return Commands(at, primary, secondary, error)
