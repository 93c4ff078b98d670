"""Commands to the axes of an antenna, one at a time or for a whole pass.

Each step interpolates the newest prediction to the present and to one period later, adds the offset
of a search, converts the direction to axis angles by the plan of the pass, and moves the axes
towards these angles within their limits.
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
"""Search offset: function of times (s) that returns arcs (rad) to the right and up."""


@dataclass(frozen=True)
class PointingState:
    """Last command of an antenna.

    Parameters
    ----------
    time_s : float
        Time for which the command is meant.
    primary, secondary : AxisState
        States of both axes, one case.
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
        Times of the commands, one period apart.
    primary_rad, secondary_rad : ndarray, shape (N,)
        Axis angles within the limits of stops, rate and acceleration.
    error_rad : ndarray, shape (N,)
        Angle on the sky between the commanded and the desired direction.
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
        Plan of the pass.
    time_s : float
        Present time.
    primary_rad, secondary_rad : float
        Angles of the axes.

    Returns
    -------
    PointingState
        State at rest at these angles.

    Raises
    ------
    InputError
        If an axis is beyond its stops.
    """
    for name, angle, limits in (
        ("primary", primary_rad, plan.mount.primary),
        ("secondary", secondary_rad, plan.mount.secondary),
    ):
        if not limits.lower_rad <= angle <= limits.upper_rad:
            raise InputError(
                f"the {name} axis is at {np.degrees(angle):.6g}°, beyond its stops at"
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
        Plan of the pass: turn, flips and ramps.
    state : PointingState
        The previous command.
    prediction : tuple of three ndarray, shape (K,)
        Times, azimuths and elevations, s and rad, from `state.time_s` or before to one period later
        or beyond.
    period_s : float
        Interval between commands, equal in all calls.
    beside : callable, optional
        Search offsets beside the prediction, see `search.Search.at`.

    Returns
    -------
    PointingState
        The command one period later.

    Raises
    ------
    InputError
        If the prediction does not cover the period, or the period is not positive.
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
    """Return the commands of a whole prediction; the antenna begins at rest on the first one.

    Parameters
    ----------
    plan : PassPlan
        Plan of the pass: turn, flips and ramps.
    prediction : tuple of three ndarray, shape (K,)
        Times, azimuths and elevations, s and rad.
    period_s : float
        Interval between commands.
    beside : callable, optional
        Search offsets beside the prediction, see `search.Search.at`.

    Returns
    -------
    Commands
        Commands from the first predicted time to the last.

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
