"""Angles of lines of sight, as antennas and telescopes measure them.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, keyword ANGLE_TYPE.
.. [2] Seidelmann, P. K. (ed.), Explanatory Supplement to the Astronomical Almanac, 1992, section
   3.252 (aberration).
"""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import SPEED_OF_LIGHT_M_S
from hillsphere.interfaces import Array

__all__ = ["HORIZON", "aberrate", "line_angles"]

HORIZON = ("AZEL", "XEYN", "XSYE")
"""Types of angles in the horizon of the station; RADEC are angles among the stars."""


def line_angles(line: Array, kind: str) -> Array:
    """Return both angles of lines of sight.

    Parameters
    ----------
    line : ndarray, shape (3, N)
        Along east, north and up for the types of `HORIZON`, along the axes of the reference frame
        for ``"RADEC"``; of any length.
    kind : str
        ``"AZEL"``: azimuth from north eastwards, in [0, 2π), and elevation. ``"XEYN"``: X from the
        zenith to the east about the north-south axis, Y towards the north. ``"XSYE"``: X from the
        zenith to the south about the east-west axis, Y towards the east [1]_. ``"RADEC"``: right
        ascension, in [0, 2π), and declination.

    Returns
    -------
    ndarray, shape (2, N)
        First and second angle, rad.
    """
    x, y, z = line
    if kind == "AZEL":
        return np.array([np.arctan2(x, y) % (2.0 * np.pi), np.arctan2(z, np.hypot(x, y))])
    if kind == "XEYN":
        return np.array([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])
    if kind == "XSYE":
        return np.array([np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z))])
    return np.array([np.arctan2(y, x) % (2.0 * np.pi), np.arctan2(z, np.hypot(x, y))])


def aberrate(line: Array, velocity_m_s: Array) -> Array:
    """Return the directions in which an observer that moves sees lines of sight [2]_.

    Parameters
    ----------
    line : ndarray, shape (3, N)
        Lines from the observer, in inertial axes.
    velocity_m_s : ndarray, shape (3, N)
        Velocity of the observer.

    Returns
    -------
    ndarray, shape (3, N)
        Unit vectors, by the exact formula of special relativity.
    """
    unit = line / np.sqrt(np.sum(line * line, axis=0))
    beta = velocity_m_s / SPEED_OF_LIGHT_M_S
    root = np.sqrt(1.0 - np.sum(beta * beta, axis=0))
    along = np.sum(unit * beta, axis=0)
    return np.asarray((root * unit + (1.0 + along / (1.0 + root)) * beta) / (1.0 + along))
