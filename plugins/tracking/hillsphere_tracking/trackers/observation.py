"""What an antenna sees of a satellite on mean elements: directions and their exact derivatives.

Directions are unit vectors in the antenna's east, north and up. They and their derivatives are
regular everywhere, at the zenith as for circular and equatorial orbits; azimuth is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi, sin

import numpy as np

from hillsphere import symbolic as sy
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import EarthOrientation
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S, earth_angle, earth_fixed
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
    "angles",
    "compare_directions",
    "cotangent",
    "derivatives",
    "directions",
    "fold_over_zenith",
    "propagate_and_compare",
    "site_of",
    "tangents",
]

_RATE = ROTATION_RATES_RAD_S["teme"]
_LOWEST = 2.0 * pi / 180.0


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


def fold_over_zenith(azimuth_rad: Array, elevation_rad: Array) -> tuple[Array, Array]:
    """Return the same directions with azimuth in [0, 2π) and elevation in [−π/2, π/2].

    An elevation that a bias carries beyond the zenith is on the other side of it.
    """
    over = np.abs(elevation_rad) > 0.5 * pi
    elevation = np.where(over, np.copysign(pi, elevation_rad) - elevation_rad, elevation_rad)
    return np.remainder(azimuth_rad + pi * over, 2.0 * pi), elevation


def tangents(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return the unit vectors of rising azimuth and of rising elevation, (2, 3, ...)."""
    ca, sa = np.cos(azimuth_rad), np.sin(azimuth_rad)
    ce, se = np.cos(elevation_rad), np.sin(elevation_rad)
    return np.array([[ca, -sa, np.zeros_like(ca)], [-se * sa, -se * ca, ce]])


def cotangent(elevation_rad: Array) -> Array:
    """Return cot h, below 2° as at 2°: antennas do not measure there."""
    return np.asarray(1.0 / np.tan(np.maximum(elevation_rad, _LOWEST)))


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
    return _compile_directions(field, short_period, False)(_columns(elements, dt_s, t_s, site))


def derivatives(
    elements: Array, dt_s: Array, t_s: Array, site: Site, field: ZonalField, *, short_period: bool
) -> tuple[Array, Array]:
    """Return `directions` (3, N) and their derivatives (3, 7, N).

    By the six elements (at the earlier time) and by the time of looking, in this order.
    """
    made = _compile_directions(field, short_period, True)(_columns(elements, dt_s, t_s, site))
    return made[:3], made[3:].reshape(3, 7, -1)


def compare_directions(
    elements: Array,
    dt_s: Array,
    t_s: Array,
    site: Site,
    shown: Array,
    field: ZonalField,
    *,
    short_period: bool,
) -> tuple[Array, Array, Array]:
    """Return how far directions lie from measured ones, on the sky.

    Parameters
    ----------
    elements, dt_s, t_s, site, field, short_period
        As for `directions`.
    shown : ndarray, shape (5, N)
        Azimuth and elevation as measured, their biases, and the factor of cot h in the elevation's
        bias, all rad: measured minus true.

    Returns
    -------
    off : ndarray, shape (2, N)
        Components of the directions along rising azimuth and rising elevation at those measured,
        freed of the biases.
    level2 : ndarray, shape (N,)
        Square of the cosine of the elevation, freed of its biases.
    slopes : ndarray, shape (2, 10, N)
        Derivatives of what is measured, on the sky, by the six elements, by the biases of azimuth
        and elevation, by the time of looking, and by the factor of cot h.
    """
    columns = np.empty((25, elements.shape[1]))
    columns[:6] = elements
    columns[6] = dt_s
    columns[7] = site.angle_rad + _RATE * t_s
    columns[8:20] = site.place
    columns[20:] = shown
    return _split(_compile_comparison(field, short_period)(columns))


def propagate_and_compare(
    elements: Array,
    dt_s: Array,
    clock_s: Array,
    t_s: Array,
    site: Site,
    shown: Array,
    field: ZonalField,
    *,
    short_period: bool,
) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return mean elements a time later, and how far what is then seen lies from a measurement.

    In one call what else takes two, for antennas measurement by measurement.

    Parameters
    ----------
    elements, dt_s
        Elements (6, N) and how much later a measurement is made.
    clock_s : ndarray, shape (N,)
        By how much later than it says.
    t_s, site, shown, field, short_period
        As for `compare_directions`, of the measurement.

    Returns
    -------
    after : ndarray, shape (6, N)
        Elements at the time that the measurement says.
    moved : ndarray, shape (3, 3, N)
        Derivatives of the later Ω, ω, M by a, e, i.
    seen : tuple of ndarray
        What `compare_directions` returns, the derivatives by the later elements.
    """
    columns = np.empty((26, elements.shape[1]))
    columns[:6] = elements
    columns[6] = clock_s
    columns[7] = site.angle_rad + _RATE * t_s
    columns[8:20] = site.place
    columns[20:25] = shown
    columns[25] = dt_s
    made = _compile_propagation(field, short_period)(columns)
    return made[:6], made[6:15].reshape(3, 3, -1), _split(made[15:])


def _split(made: Array) -> tuple[Array, Array, Array]:
    return made[:2], made[2], made[3:].reshape(2, 10, -1)


def _columns(elements: Array, dt_s: Array, t_s: Array, site: Site) -> Array:
    columns = np.empty((20, elements.shape[1]))
    columns[:6] = elements
    columns[6] = dt_s
    columns[7] = site.angle_rad + _RATE * t_s
    columns[8:20] = site.place
    return columns


@lru_cache(maxsize=32)
def _compile_directions(field: ZonalField, short_period: bool, slopes: bool) -> ArrayFunction:
    inputs, shift, direction = _direction(field, short_period)
    outputs = list(direction)
    if slopes:
        for row in sy.jacobian(direction, (*inputs[:6], shift)):
            outputs.extend(row)
    return ArrayFunction(sy.substitute(outputs, {shift: 0.0}), inputs)


@lru_cache(maxsize=32)
def _compile_comparison(field: ZonalField, short_period: bool) -> ArrayFunction:
    outputs, inputs = _comparison(field, short_period)
    return ArrayFunction(outputs, inputs)


@lru_cache(maxsize=16)
def _compile_propagation(field: ZonalField, short_period: bool) -> ArrayFunction:
    outputs, inputs = _comparison(field, short_period)
    elements, dt = inputs[:6], sy.variable("interval")
    later = at_time(elements, dt, field)
    slopes = [slope for row in sy.jacobian(later[3:], elements[:3]) for slope in row]
    seen = sy.substitute(outputs, dict(zip(elements[3:], later[3:], strict=True)))
    return ArrayFunction([*later, *slopes, *seen], (*inputs, dt))


def _comparison(field: ZonalField, short_period: bool) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
    """Return the outputs of `compare_directions`, row by row, and its inputs."""
    inputs, shift, (east, north, up) = _direction(field, short_period)
    azimuth, elevation = sy.variables("azimuth", "elevation")
    ca, sa, ce, se = sy.cos(azimuth), sy.sin(azimuth), sy.cos(elevation), sy.sin(elevation)
    off = (ca * east - sa * north, ce * up - se * (sa * east + ca * north))
    slopes = sy.jacobian(off, (*inputs[:6], shift))
    shown = sy.variables("shown0", "shown1", "bias0", "bias1", "horizon")
    risen = shown[1] - shown[3]
    # cot h of the predicted elevation: that of a measured one would tie its noise, and what is not
    # known of the biases, to the factor; what the orbit's error does to cot h is left out
    fall = sy.sqrt(east * east + north * north) / sy.maximum(up, sin(_LOWEST))
    none = sy.constant(0.0)
    outputs: list[Expr] = [*off, ce * ce]
    for row, (biases, last) in zip(
        slopes, (((ce, none), none), ((none, sy.constant(1.0)), fall)), strict=True
    ):
        outputs.extend([*row[:6], *biases, row[6], last])
    freed = {azimuth: shown[0] - shown[2], elevation: risen - shown[4] * fall}
    return sy.substitute(sy.substitute(outputs, freed), {shift: 0.0}), (*inputs, *shown)


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
