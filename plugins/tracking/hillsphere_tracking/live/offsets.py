"""Offsets of a satellite from its nominal track: time along it, angle across it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Offsets", "offsets_of"]

_STEP_S = 0.5
"""Half the interval (s) of the central differences along a track: the tangent bends by far less
than a microsecond in it, and rounding is as small."""
_STEPS = 20
"""Steps to the nearest time at most. Two suffice as a rule; more are needed where a satellite is
minutes off."""
_DONE_S = 1e-4
"""Last step (s) below which the time counts as found: a tenth of what is shown."""
_FARTHEST_S = 300.0
"""Largest step (s): a satellite at the other end of the sky is beside the tangent by its length at
most."""


class Offsets(NamedTuple):
    """Time by which the satellite is early (s), and arc by which it is left of its track (rad)."""

    early_s: float
    left_rad: float


def offsets_of(
    track: Callable[[Array], tuple[Array, Array]], now: tuple[float, float], t_s: float
) -> Offsets:
    """Return the offsets of a direction from a track on the sky.

    Parameters
    ----------
    track : callable
        Times (K,) → azimuths and elevations (K,) of the track.
    now : tuple of two floats
        Actual azimuth and elevation.
    t_s : float
        Time of the direction.

    Returns
    -------
    Offsets
        Time after `t_s` at which the track is nearest to the direction, and the angle between them
        there (left as seen from the station, looking along the motion).
    """
    direction = direction_cosines(np.array([now[0]]), np.array([now[1]]))[:, 0]
    nearest = t_s
    for _ in range(_STEPS):
        around = nearest + _STEP_S * np.array([-1.0, 0.0, 1.0])
        before, at, after = direction_cosines(*track(around)).T
        # tangent of the track by central differences
        rate = (after - before) / (2.0 * _STEP_S)
        speed = float(np.linalg.norm(rate))
        along = rate / speed
        step = float(np.arctan2(direction @ along, direction @ at)) / speed
        nearest += float(np.clip(step, -_FARTHEST_S, _FARTHEST_S))
        if abs(step) < _DONE_S:
            break
    left = np.cross(along, at)  # left of an observer who looks there with the motion upwards
    across = float(np.arcsin(np.clip((direction - at) @ left, -1.0, 1.0)))
    return Offsets(nearest - t_s, across)
