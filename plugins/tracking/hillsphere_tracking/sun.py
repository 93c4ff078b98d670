"""Position of the Sun as seen from the Earth, and the Earth's shadow.

References
----------
.. [1] IAU SOFA, routine epv00 (Earth's position and velocity; 14 km over 1900-2100), through ERFA.
.. [2] O. Montenbruck, E. Gill (2000), Satellite Orbits, Springer, section 3.4 (shadow).
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Literal

import erfa
import numpy as np

from hillsphere.base.constants import AU_M, DAY_S, J2000_JD
from hillsphere.base.geodetic import WGS84, Ellipsoid
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.time import Epoch

__all__ = ["SUN_RADIUS_M", "shadow_margin", "sun_earth_fixed", "sun_gcrs"]

SUN_RADIUS_M = 6.957e8
"""Nominal solar radius of IAU 2015 resolution B3."""

_NODES_PER_DAY = 8
"""Positions per day through which cubics are interpolated; the error is below 1e-11 of the
distance. Fewer nodes increase it with the fourth power, more cost evaluations of the series."""
_LIGHT_AU_PER_DAY = 173.1446326846693
"""Speed of light in astronomical units per day, with the AU of IAU 1976. With the AU of 2012 it is
smaller by 6e-11 of its value, which the aberration (1e-4 rad) does not show."""


def sun_gcrs(epoch: Epoch, t_s: Array) -> Array:
    """Return the apparent geocentric position of the Sun in the GCRS [1]_.

    Parameters
    ----------
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (N,)
        SI seconds after `epoch`.

    Returns
    -------
    ndarray, shape (3, N)
        Apparent position, m, with the aberration due to the Earth's velocity; the direction is
        accurate to 0.05″.
    """
    day, fraction = _tdb(epoch)
    # TDB; the difference to TT, 2 ms, does not matter: the Sun moves by 2e-7 rad in a second.
    place = ((day - J2000_JD) + fraction + np.atleast_1d(t_s) / DAY_S) * _NODES_PER_DAY
    cell = np.floor(place).astype(np.int64)
    u = place - cell
    nodes = np.unique(np.concatenate([cell + k for k in (-1, 0, 1, 2)]))
    at = np.searchsorted(nodes, cell)
    # Lagrange's cubic through the nodes at −1, 0, 1 and 2 steps; u in [0, 1) is between 0 and 1.
    known = _apparent(J2000_JD, nodes / _NODES_PER_DAY)
    return np.asarray(
        -u * (u - 1.0) * (u - 2.0) / 6.0 * known[:, at - 1]
        + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * known[:, at]
        - (u + 1.0) * u * (u - 2.0) / 2.0 * known[:, at + 1]
        + (u + 1.0) * u * (u - 1.0) / 6.0 * known[:, at + 2]
    )


def _apparent(day: float, days: Array) -> Array:
    """Return the Sun's apparent positions (3, N), GCRS, m, at Julian dates in TDB.

    Aberration to first order: the velocity of the Earth over that of light is added to the
    geometric direction; the neglected square is 1e-8 rad.
    """
    with warnings.catch_warnings():
        # Outside 1900-2100 the series is less exact, by far less than the Sun's radius.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        heliocentric, barycentric = erfa.epv00(day, days)
    place = -heliocentric["p"]
    distance = np.linalg.norm(place, axis=-1, keepdims=True)
    direction = place / distance + barycentric["v"] / _LIGHT_AU_PER_DAY
    return np.asarray(
        (direction / np.linalg.norm(direction, axis=-1, keepdims=True) * distance * AU_M).T
    )


def sun_earth_fixed(epoch: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC) -> Array:
    """Return the apparent position of the Sun in Earth-fixed axes.

    Parameters
    ----------
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (N,)
        SI seconds after `epoch`.
    orientation : EarthOrientation
        UT1 and polar motion; by default UT1 = UTC without polar motion.

    Returns
    -------
    ndarray, shape (3, N)
        Apparent position from the Earth's centre, m.
    """
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    turn = earth_fixed("gcrs", epoch, t_s, orientation)
    return np.asarray(np.einsum("ijn,jn->in", turn, sun_gcrs(epoch, t_s)))


def shadow_margin(
    r_ecef_m: Array,
    sun_ecef_m: Array,
    part: Literal["umbra", "penumbra"] = "umbra",
    ellipsoid: Ellipsoid = WGS84,
) -> Array:
    """Return the angular depth of positions in the Earth's shadow, for a conical shadow [2]_.

    An oblate Earth is treated by stretching all positions along its axis until the ellipsoid is a
    sphere: straight lines stay straight, and tangents stay tangents.

    Parameters
    ----------
    r_ecef_m, sun_ecef_m : ndarray, shape (3, N)
        Positions of satellite and Sun, Earth-fixed, m.
    part : {"umbra", "penumbra"}
        Umbra, where the Earth hides the whole disc of the Sun, or penumbra, where it hides a part.
    ellipsoid : Ellipsoid
        Reference ellipsoid of the Earth; the atmosphere is neglected.

    Returns
    -------
    ndarray, shape (N,)
        Angle, rad, by which the edge of the Sun's disc is below the edge of the Earth's disc:
        positive in the shadow.
    """
    # the polar radius is (1 − flattening) times the equatorial one
    stretch = np.array([1.0, 1.0, 1.0 / (1.0 - ellipsoid.flattening)])[:, None]
    r, to_sun = r_ecef_m * stretch, (sun_ecef_m - r_ecef_m) * stretch
    height, distance = np.linalg.norm(r, axis=0), np.linalg.norm(to_sun, axis=0)
    # Angle between the Earth's centre and the Sun, from its sine and cosine: an arc cosine alone
    # loses half the digits near the axis of the shadow.
    aside = np.linalg.norm(np.cross(r, to_sun, axis=0), axis=0)
    apart = np.arctan2(aside, -np.einsum("in,in->n", r, to_sun))
    # apparent radii of both discs; inside the Earth its disc is held at 90°
    earth = np.arcsin(np.minimum(ellipsoid.equatorial_radius_m / height, 1.0))
    sun = np.arcsin(SUN_RADIUS_M / distance)
    return np.asarray(earth - apart + (sun if part == "penumbra" else -sun))


@lru_cache(maxsize=64)
def _tdb(epoch: Epoch) -> tuple[float, float]:
    with warnings.catch_warnings():
        # A UTC date beyond the last leap second announced is "dubious", not wrong.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        tdb = epoch.to("TDB")
    return tdb.day, tdb.fraction
