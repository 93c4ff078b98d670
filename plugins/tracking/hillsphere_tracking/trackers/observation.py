"""What an antenna sees of a satellite on mean elements: directions and their exact derivatives.

Directions are unit vectors in the antenna's east, north and up. They and their derivatives are
regular everywhere, at the zenith as for circular and equatorial orbits; azimuth is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi

import numpy as np

from hillsphere import symbolic as sy
from hillsphere.dynamics import ArrayFunction
from hillsphere.earth.geodetic import Station
from hillsphere.earth.orientation import EarthOrientation
from hillsphere.earth.rotation import ROTATION_RATES_RAD_S, earth_angle, earth_fixed
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr
from hillsphere.time import Epoch
from hillsphere_tracking.dynamics_brouwer import (
    ZonalField,
    at_time,
    osculating_equinoctial,
    position,
)
from hillsphere_tracking.mean_elements import RETROGRADE

__all__ = [
    "Site",
    "advance",
    "angles",
    "compared",
    "derivatives",
    "directions",
    "site_of",
    "tangents",
]

_RATE = ROTATION_RATES_RAD_S["teme"]


@dataclass(frozen=True)
class Site:
    """Antennas on the turning Earth, fixed to its axis and prime meridian.

    Parameters
    ----------
    place : ndarray, shape (12, N) or (12, 1)
        Position, m, then the axes east, north and up, row by row.
    angle_rad : float
        Angle by which the Earth has turned in the frame of the elements when t_s = 0; from there
        it turns evenly.
    """

    place: Array
    angle_rad: float


def site_of(stations: Sequence[Station], epoch: Epoch, orientation: EarthOrientation) -> Site:
    """Return the antennas as trackers see them.

    UT1 and polar motion are those of the epoch: within a day they change by less than 1e-8 rad.

    Parameters
    ----------
    stations : sequence of Station
        One for all cases, or one each.
    epoch : Epoch
        From which times count.
    orientation : EarthOrientation
        Gives UT1 and polar motion.

    Returns
    -------
    Site
        In the true equator and mean equinox of date (TEME).
    """
    if not stations:
        raise InputError("a tracker needs a station: one for all cases, or one for each")
    angle = float(earth_angle("teme", epoch, np.zeros(1), orientation)[0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    pole = earth_fixed("teme", epoch, np.zeros(1), orientation)[:, :, 0] @ turn.T
    place = [np.concatenate([pole.T @ s.ecef_m, (s.axes @ pole).ravel()]) for s in stations]
    return Site(np.array(place).T.copy(), angle)


def angles(direction: Array) -> tuple[Array, Array]:
    """Return azimuth in [0, 2π), from north over east, and elevation of directions (3, ...)."""
    east, north, up = direction
    return (
        np.remainder(np.arctan2(east, north), 2.0 * pi),
        np.arctan2(up, np.hypot(east, north)),
    )


def tangents(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return the unit vectors of rising azimuth and of rising elevation, (2, 3, ...)."""
    ca, sa = np.cos(azimuth_rad), np.sin(azimuth_rad)
    ce, se = np.cos(elevation_rad), np.sin(elevation_rad)
    return np.array([[ca, -sa, np.zeros_like(ca)], [-se * sa, -se * ca, ce]])


def directions(
    elements: Array, dt_s: Array, t_s: Array, site: Site, field: ZonalField, *, short_period: bool
) -> Array:
    """Return where satellites are seen.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements a, e, i, Ω, ω, M a time `dt_s` before they are looked at.
    dt_s, t_s : ndarray, shape (N,)
        That time, and the instant at which they are looked at, after the epoch of the site.
    site : Site
        The antennas.
    field : ZonalField
        Of the planet.
    short_period : bool
        Whether the short-period terms are added.

    Returns
    -------
    ndarray, shape (3, N)
        Unit vectors in east, north, up; the Earth is transparent.
    """
    return _seen(field, short_period, False)(_columns(elements, dt_s, t_s, site))


def derivatives(
    elements: Array, dt_s: Array, t_s: Array, site: Site, field: ZonalField, *, short_period: bool
) -> tuple[Array, Array]:
    """Return `directions` (3, N) and their derivatives (3, 7, N).

    By the six elements (at the earlier time) and by the time of looking, in this order.
    """
    made = _seen(field, short_period, True)(_columns(elements, dt_s, t_s, site))
    return made[:3], made[3:].reshape(3, 7, -1)


def compared(
    elements: Array,
    dt_s: Array,
    t_s: Array,
    site: Site,
    azimuth_rad: Array,
    elevation_rad: Array,
    field: ZonalField,
    *,
    short_period: bool,
) -> tuple[Array, Array, Array]:
    """Return how far directions lie from measured ones, on the sky.

    Parameters
    ----------
    elements, dt_s, t_s, site, field, short_period
        As for `directions`.
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Measured angles.

    Returns
    -------
    off : ndarray, shape (2, N)
        Components of the directions along rising azimuth and rising elevation at those measured.
    slopes : ndarray, shape (2, 7, N)
        Their derivatives, as of `derivatives`.
    cos_elevation : ndarray, shape (N,)
        Of the elevation measured.
    """
    columns = np.empty((22, elements.shape[1]))
    columns[20] = azimuth_rad
    columns[21] = elevation_rad
    made = _compared(field, short_period)(_columns(elements, dt_s, t_s, site, columns))
    return made[:2], made[3:].reshape(2, 7, -1), made[2]


def advance(elements: Array, dt_s: Array, field: ZonalField) -> tuple[Array, Array]:
    """Return mean elements (6, N) a time later, and the slopes (3, 3, N) of Ω, ω, M by a, e, i."""
    made = _advance(field)(np.concatenate([elements, dt_s[None]]))
    return np.concatenate([elements[:3], made[:3]]), made[3:].reshape(3, 3, -1)


def _columns(
    elements: Array, dt_s: Array, t_s: Array, site: Site, columns: Array | None = None
) -> Array:
    if columns is None:
        columns = np.empty((20, elements.shape[1]))
    columns[:6] = elements
    columns[6] = dt_s
    columns[7] = site.angle_rad + _RATE * t_s
    columns[8:20] = site.place
    return columns


@lru_cache(maxsize=32)
def _seen(field: ZonalField, short_period: bool, slopes: bool) -> ArrayFunction:
    inputs, shift, direction = _direction(field, short_period)
    outputs = list(direction)
    if slopes:
        for row in sy.jacobian(direction, (*inputs[:6], shift)):
            outputs.extend(row)
    return ArrayFunction(sy.substitute(outputs, {shift: 0.0}), inputs)


@lru_cache(maxsize=32)
def _compared(field: ZonalField, short_period: bool) -> ArrayFunction:
    inputs, shift, (east, north, up) = _direction(field, short_period)
    azimuth, elevation = sy.variables("azimuth", "elevation")
    ca, sa, ce, se = sy.cos(azimuth), sy.sin(azimuth), sy.cos(elevation), sy.sin(elevation)
    off = (ca * east - sa * north, ce * up - se * (sa * east + ca * north))
    outputs: list[Expr] = [*off, ce]
    for row in sy.jacobian(off, (*inputs[:6], shift)):
        outputs.extend(row)
    return ArrayFunction(sy.substitute(outputs, {shift: 0.0}), (*inputs, azimuth, elevation))


def _direction(
    field: ZonalField, short_period: bool
) -> tuple[tuple[Expr, ...], Expr, tuple[Expr, Expr, Expr]]:
    """Return the 20 inputs, the shift of the time of looking, and the direction."""
    names = ("a", "e", "i", "node", "perigee", "mean", "dt", "angle")
    inputs = sy.variables(*names, *(f"site{k}" for k in range(12)))
    elements, (dt, angle), site = inputs[:6], inputs[6:8], inputs[8:]
    sense = sy.select(sy.less(sy.cos(elements[2]), RETROGRADE), -1.0, 1.0)
    # a shift of the time of looking moves the satellite and turns the Earth
    shift = sy.variable("shift")
    now = at_time(elements, dt + shift, field)
    orbit = osculating_equinoctial(now, sense, field, short_period=short_period)
    x, y, z = position(orbit, sense)
    turn = angle + _RATE * shift
    c, s = sy.cos(turn), sy.sin(turn)
    away = (c * x + s * y - site[0], c * y - s * x - site[1], z - site[2])
    east, north, up = (sy.dot(site[3 + 3 * row : 6 + 3 * row], away) for row in range(3))
    near = 1.0 / sy.norm((east, north, up))
    return inputs, shift, (near * east, near * north, near * up)


@lru_cache(maxsize=16)
def _advance(field: ZonalField) -> ArrayFunction:
    inputs = sy.variables("a", "e", "i", "node", "perigee", "mean", "dt")
    later = at_time(inputs[:6], inputs[6], field)[3:]
    slopes = [slope for row in sy.jacobian(later, inputs[:3]) for slope in row]
    return ArrayFunction([*later, *slopes], inputs)
