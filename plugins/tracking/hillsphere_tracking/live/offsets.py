"""How far a satellite is from its nominal orbit, as an operator thinks of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Offsets", "offsets_of"]


class Offsets(NamedTuple):
    """Time by which the satellite is early, s; arc by which it passes left of its track, rad."""

    early_s: float
    left_rad: float


def offsets_of(nominal: tuple[Array, Array], now: tuple[float, float], step_s: float) -> Offsets:
    """Return the offsets of a direction from a nominal track on the sky.

    Parameters
    ----------
    nominal : tuple of two ndarray, shape (3,)
        Azimuths and elevations of the nominal orbit, a step before now, now, and a step after.
    now : tuple of two floats
        Azimuth and elevation where the satellite is.
    step_s : float
        The step.

    Returns
    -------
    Offsets
        Along the track as a time, across it (left as seen along the motion, from the station) as an
        angle. Exact in the limit of small offsets; large ones count along the tangent.
    """
    before, at, after = direction_cosines(*nominal).T
    rate = (after - before) / (2.0 * step_s)
    speed = float(np.linalg.norm(rate))
    seen = direction_cosines(np.array([now[0]]), np.array([now[1]]))[:, 0]
    apart = seen - at
    along = rate / speed
    left = np.cross(along, at)  # of one who looks that way and has the motion upwards
    across = float(np.arcsin(np.clip(apart @ left, -1.0, 1.0)))
    return Offsets(float(apart @ along) / speed, across)
