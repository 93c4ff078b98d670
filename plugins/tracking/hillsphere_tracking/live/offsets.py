"""Offsets of a satellite from its nominal track: time along it, angle across it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Offsets", "offsets_of"]


class Offsets(NamedTuple):
    """Time by which the satellite is early (s), and arc by which it is left of its track (rad)."""

    early_s: float
    left_rad: float


def offsets_of(nominal: tuple[Array, Array], now: tuple[float, float], step_s: float) -> Offsets:
    """Return the offsets of a direction from a nominal track on the sky.

    Parameters
    ----------
    nominal : tuple of two ndarray, shape (3,)
        Azimuths and elevations of the nominal orbit one step before now, now, and one step later.
    now : tuple of two floats
        Actual azimuth and elevation.
    step_s : float
        Length of the step.

    Returns
    -------
    Offsets
        Offset along the track as a time, and across it as an angle (left as seen from the station,
        looking along the motion). Large offsets are measured along the tangent of the track.
    """
    before, at, after = direction_cosines(*nominal).T
    # tangent of the track by central differences
    rate = (after - before) / (2.0 * step_s)
    speed = float(np.linalg.norm(rate))
    direction = direction_cosines(np.array([now[0]]), np.array([now[1]]))[:, 0]
    apart = direction - at
    along = rate / speed
    left = np.cross(along, at)  # left of an observer who looks there with the motion upwards
    across = float(np.arcsin(np.clip(apart @ left, -1.0, 1.0)))
    return Offsets(float(apart @ along) / speed, across)
