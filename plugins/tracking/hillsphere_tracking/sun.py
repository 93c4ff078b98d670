"""The Sun in the sky of the Earth: its direction, its way through a beam, the Earth's shadow.

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

from hillsphere.base.geodetic import WGS84, Ellipsoid
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.time import Epoch

__all__ = ["SUN_RADIUS_M", "shadow_margin", "sun_earth_fixed", "sun_gcrs"]

SUN_RADIUS_M = 6.957e8
"""IAU 2015 resolution B3, nominal."""

_AU = 1.495978707e11
_DAY = 86400.0
_J2000 = 2451545.0
_NODES_PER_DAY = 8
"""Spacing of the positions between which cubics run; error below 1e-11 of the distance."""
_LIGHT_AU_PER_DAY = 173.1446326846693


def sun_gcrs(epoch: Epoch, t_s: Array) -> Array:
    """Return where the Sun appears from the Earth's centre.

    Parameters
    ----------
    epoch : Epoch
        From which times count.
    t_s : ndarray, shape (N,)
        SI seconds after it.

    Returns
    -------
    ndarray, shape (3, N)
        Apparent position (aberration by the Earth's velocity applied) in the GCRS, m; the direction
        is good to 0.05″ [1]_.
    """
    day, fraction = _tdb(epoch)
    # in TDB; TT, a second or two milliseconds away, would do: the Sun moves 2e-7 rad a second
    place = ((day - _J2000) + fraction + np.atleast_1d(t_s) / _DAY) * _NODES_PER_DAY
    cell = np.floor(place).astype(np.int64)
    u = place - cell
    nodes = np.unique(np.concatenate([cell + k for k in (-1, 0, 1, 2)]))
    at = np.searchsorted(nodes, cell)
    known = _apparent(_J2000, nodes / _NODES_PER_DAY)
    return np.asarray(
        -u * (u - 1.0) * (u - 2.0) / 6.0 * known[:, at - 1]
        + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * known[:, at]
        - (u + 1.0) * u * (u - 2.0) / 2.0 * known[:, at + 1]
        + (u + 1.0) * u * (u - 1.0) / 6.0 * known[:, at + 2]
    )


def _apparent(day: float, days: Array) -> Array:
    """Return the Sun's apparent positions (3, N), GCRS, m, at Julian dates in TDB."""
    with warnings.catch_warnings():
        # Outside 1900-2100 the series is less exact, by far less than the Sun's radius.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        heliocentric, barycentric = erfa.epv00(day, days)
    place = -heliocentric["p"]
    distance = np.linalg.norm(place, axis=-1, keepdims=True)
    seen = place / distance + barycentric["v"] / _LIGHT_AU_PER_DAY
    return np.asarray((seen / np.linalg.norm(seen, axis=-1, keepdims=True) * distance * _AU).T)


def sun_earth_fixed(epoch: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC) -> Array:
    """Return where the Sun appears, along Earth-fixed axes.

    Parameters
    ----------
    epoch : Epoch
        From which times count.
    t_s : ndarray, shape (N,)
        SI seconds after it.
    orientation : EarthOrientation
        Gives UT1 and polar motion; left out: UT1 := UTC and none.

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
    """Return how deep positions lie within the shadow of the Earth.

    Parameters
    ----------
    r_ecef_m, sun_ecef_m : ndarray, shape (3, N)
        Positions of satellite and Sun, Earth-fixed, m.
    part : {"umbra", "penumbra"}
        Whether all of the Sun's disc is hidden, or any.
    ellipsoid : Ellipsoid
        Of the Earth, without atmosphere.

    Returns
    -------
    ndarray, shape (N,)
        Angle, rad, by which the edge of the Sun's disc has passed below that of the Earth's:
        positive in the shadow. The Earth is stretched along its axis to a sphere, and everything
        with it, which leaves lines and tangents what they are.
    """
    stretch = np.array([1.0, 1.0, 1.0 / (1.0 - ellipsoid.flattening)])[:, None]
    r, to_sun = r_ecef_m * stretch, (sun_ecef_m - r_ecef_m) * stretch
    height, distance = np.linalg.norm(r, axis=0), np.linalg.norm(to_sun, axis=0)
    # from both sine and cosine: an arc cosine alone loses half the digits near the axis
    aside = np.linalg.norm(np.cross(r, to_sun, axis=0), axis=0)
    apart = np.arctan2(aside, -np.einsum("in,in->n", r, to_sun))
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
