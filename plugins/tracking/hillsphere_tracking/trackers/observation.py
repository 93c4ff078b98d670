"""Measurement model: direction from an antenna to a satellite on mean elements, with derivatives.

Directions are unit vectors in the antenna's east, north and up axes. They and their derivatives are
regular at the zenith and for circular and equatorial orbits, whereas azimuth is singular at the
zenith.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi, sin

import numpy as np

from hillsphere import symbolic as sy
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import EarthOrientation
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
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
    "join_sites",
    "measurement_columns",
    "propagate_and_compare",
    "propagation_of",
    "select_site",
    "site_of",
    "tangents",
]

_RATE = ROTATION_RATES_RAD_S["teme"]
_LOWEST = 2.0 * pi / 180.0
"""Elevation (rad) below which cot h is held constant: it is unbounded at the horizon, where
antennas do not measure."""


@dataclass(frozen=True)
class Site:
    """Antennas on the rotating Earth, in axes fixed to its rotation axis and prime meridian.

    Parameters
    ----------
    place : ndarray, shape (12, N) or (12, 1)
        Position, m, then the axes east, north and up, row by row.
    angle_rad : float or ndarray, shape (N,)
        Rotation angle of the Earth at t_s = 0 in the frame of the elements; it grows at a constant
        rate.
    """

    place: Array
    angle_rad: float | Array


def site_of(stations: Sequence[Station], epoch: Epoch, orientation: EarthOrientation) -> Site:
    """Return the antennas in the axes of the trackers.

    UT1 and polar motion are held at their values of the epoch: within a day they change by less
    than 1e-8 rad.

    Parameters
    ----------
    stations : sequence of Station
        One station for all cases, or one per case.
    epoch : Epoch
        Origin of the times.
    orientation : EarthOrientation
        UT1 and polar motion of the Earth.

    Returns
    -------
    Site
        In the true equator and mean equinox of date (TEME).
    """
    if not stations:
        raise InputError("a tracker needs a station: one for all cases, or one for each")
    angle = float(earth_angle("teme", epoch, np.zeros(1), orientation)[0])
    # The rotation to Earth-fixed axes is polar motion after the rotation by `angle`: divide it out.
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    pole = earth_fixed("teme", epoch, np.zeros(1), orientation)[:, :, 0] @ turn.T
    place = [np.concatenate([pole.T @ s.ecef_m, (s.axes @ pole).ravel()]) for s in stations]
    return Site(np.array(place).T.copy(), angle)


def join_sites(sites: Sequence[Site], cases: Sequence[int]) -> Site:
    """Return the antennas of several sites, each with so many cases, one after the other."""
    pairs = list(zip(sites, cases, strict=True))
    places = [np.broadcast_to(site.place, (12, n)) for site, n in pairs]
    turns = [np.broadcast_to(site.angle_rad, n) for site, n in pairs]
    return Site(np.concatenate(places, axis=1), np.concatenate(turns))


def select_site(site: Site, cases: Integers) -> Site:
    """Return the antennas of some cases (n,)."""
    place, turn = site.place, site.angle_rad
    return Site(
        place[:, cases] if place.shape[1] > 1 else place,
        turn[cases] if isinstance(turn, np.ndarray) else turn,
    )


def angles(direction: Array) -> tuple[Array, Array]:
    """Return azimuth in [0, 2π) from north eastwards, and elevation, of vectors (3, ...)."""
    east, north, up = direction
    return (
        np.remainder(np.arctan2(east, north), 2.0 * pi),
        np.arctan2(up, np.hypot(east, north)),
    )


def fold_over_zenith(azimuth_rad: Array, elevation_rad: Array) -> tuple[Array, Array]:
    """Return equal directions with azimuth in [0, 2π) and elevation in [−π/2, π/2].

    An elevation h > π/2, which a bias can cause, becomes π − h at the opposite azimuth.
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
    """Return cot h, held constant below h = 2°."""
    return np.asarray(1.0 / np.tan(np.maximum(elevation_rad, _LOWEST)))


def directions(
    elements: Array, dt_s: Array, t_s: Array, site: Site, field: ZonalField, *, short_period: bool
) -> Array:
    """Return the directions from antennas to satellites.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements a, e, i, Ω, ω, M at the times ``t_s − dt_s``.
    dt_s, t_s : ndarray, shape (N,)
        Interval from the elements to the observation, and time of the observation after the epoch
        of the site.
    site : Site
        The antennas.
    field : ZonalField
        Gravity field of the planet.
    short_period : bool
        Add the short-period terms of J2.

    Returns
    -------
    ndarray, shape (3, N)
        Unit vectors in east, north, up, also below the horizon.
    """
    return _compile_directions(field, short_period, False)(_columns(elements, dt_s, t_s, site))


def derivatives(
    elements: Array, dt_s: Array, t_s: Array, site: Site, field: ZonalField, *, short_period: bool
) -> tuple[Array, Array]:
    """Return `directions` (3, N) and their derivatives (3, 7, N).

    The derivatives are by the six earlier elements, then by the time of the observation.
    """
    outputs = _compile_directions(field, short_period, True)(_columns(elements, dt_s, t_s, site))
    return outputs[:3], outputs[3:].reshape(3, 7, -1)


def compare_directions(
    elements: Array,
    dt_s: Array,
    t_s: Array,
    site: Site,
    measured: Array,
    field: ZonalField,
    *,
    short_period: bool,
) -> tuple[Array, Array, Array]:
    """Return the residuals of measured directions on the sky, with their derivatives.

    Parameters
    ----------
    elements, dt_s, t_s, site, field, short_period
        As for `directions`.
    measured : ndarray, shape (5, N)
        Measured azimuth and elevation, their biases, and the horizon bias (factor of cot h in the
        bias of the elevation), all rad; biases are measured minus true.

    Returns
    -------
    off : ndarray, shape (2, N)
        Components of the predicted directions along rising azimuth and rising elevation at the
        measured directions, with the biases removed: −ν of `least_squares`.
    level2 : ndarray, shape (N,)
        cos² h of the measured elevation, with the biases removed.
    slopes : ndarray, shape (2, 10, N)
        Derivatives of the angles on the sky by the six elements, the biases of azimuth and
        elevation, the time of the observation, and the horizon bias.
    """
    columns = np.empty((25, elements.shape[1]))
    measurement_columns(elements, dt_s, t_s, site, measured, columns)
    return _split(_compile_comparison(field, short_period)(columns))


def propagate_and_compare(
    elements: Array,
    dt_s: Array,
    clock_s: Array,
    t_s: Array,
    site: Site,
    measured: Array,
    field: ZonalField,
    *,
    short_period: bool,
) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Propagate mean elements to a measurement and return its residuals.

    One call instead of two saves time if an antenna takes measurements one at a time.

    Parameters
    ----------
    elements, dt_s
        Elements (6, N), and interval from them to the time tag of the measurement.
    clock_s : ndarray, shape (N,)
        Time bias: true time minus time tag.
    t_s, site, measured, field, short_period
        As for `compare_directions`, at the true time of the measurement.

    Returns
    -------
    after : ndarray, shape (6, N)
        Elements at the time tag.
    slopes : ndarray, shape (3, 3, N)
        Derivatives of the later Ω, ω, M by a, e, i.
    comparison : tuple of ndarray
        Result of `compare_directions`, with derivatives by the later elements.
    """
    columns = np.empty((26, elements.shape[1]))
    measurement_columns(elements, clock_s, t_s, site, measured, columns)
    columns[25] = dt_s
    outputs = _compile_propagation(field, short_period)(columns)
    return outputs[:6], outputs[6:15].reshape(3, 3, -1), _split(outputs[15:])


def measurement_columns(
    elements: Array, dt_s: Array, t_s: Array, site: Site, measured: Iterable[Array], out: Array
) -> None:
    """Write the inputs of a comparison to the first 25 rows of an array (≥ 25, N).

    The other arguments are those of `compare_directions`.
    """
    out[:6] = elements
    out[6] = dt_s
    out[7] = site.angle_rad + _RATE * t_s
    out[8:20] = site.place
    out[20], out[21], out[22], out[23], out[24] = measured


def _split(outputs: Array) -> tuple[Array, Array, Array]:
    return outputs[:2], outputs[2], outputs[3:].reshape(2, 10, -1)


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
    later, slopes, compared, inputs = propagation_of(field, short_period)
    return ArrayFunction([*later, *(q for row in slopes for q in row), *compared], inputs)


def propagation_of(
    field: ZonalField, short_period: bool
) -> tuple[tuple[Expr, ...], list[tuple[Expr, ...]], list[Expr], tuple[Expr, ...]]:
    """Return the outputs of `propagate_and_compare` as expressions, and its 26 inputs.

    The outputs are the later elements, the derivatives of Ω, ω, M by a, e, i, row by row, and those
    of the comparison: two residuals, cos² h, two rows of ten derivatives.
    """
    outputs, inputs = _comparison(field, short_period)
    elements, dt = inputs[:6], sy.variable("interval")
    later = at_time(elements, dt, field)
    slopes = [tuple(row) for row in sy.jacobian(later[3:], elements[:3])]
    compared = list(sy.substitute(outputs, dict(zip(elements[3:], later[3:], strict=True))))
    return tuple(later), slopes, compared, (*inputs, dt)


def _comparison(field: ZonalField, short_period: bool) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
    """Return the outputs of `compare_directions`, row by row, and its inputs, as expressions."""
    inputs, shift, (east, north, up) = _direction(field, short_period)
    azimuth, elevation = sy.variables("azimuth", "elevation")
    ca, sa, ce, se = sy.cos(azimuth), sy.sin(azimuth), sy.cos(elevation), sy.sin(elevation)
    # a·u and b·u of `least_squares`
    off = (ca * east - sa * north, ce * up - se * (sa * east + ca * north))
    slopes = sy.jacobian(off, (*inputs[:6], shift))
    measured = sy.variables("shown0", "shown1", "bias0", "bias1", "horizon")
    risen = measured[1] - measured[3]
    # cot h is taken at the predicted elevation: at the measured one, noise and unknown biases would
    # correlate with the horizon bias. Its dependence on the orbit's error is neglected.
    fall = sy.sqrt(east * east + north * north) / sy.maximum(up, sin(_LOWEST))
    none = sy.constant(0.0)
    # rows of H: elements, biases of azimuth and elevation, time, horizon bias
    outputs: list[Expr] = [*off, ce * ce]
    for row, (biases, last) in zip(
        slopes, (((ce, none), none), ((none, sy.constant(1.0)), fall)), strict=True
    ):
        outputs.extend([*row[:6], *biases, row[6], last])
    # the tangent directions a, b belong to the measured direction with the biases removed
    freed = {azimuth: measured[0] - measured[2], elevation: risen - measured[4] * fall}
    return sy.substitute(sy.substitute(outputs, freed), {shift: 0.0}), (*inputs, *measured)


def _direction(
    field: ZonalField, short_period: bool
) -> tuple[tuple[Expr, ...], Expr, tuple[Expr, Expr, Expr]]:
    """Return the 20 inputs, the shift of the observation's time, and the predicted direction."""
    names = ("a", "e", "i", "node", "perigee", "mean", "dt", "angle")
    inputs = sy.variables(*names, *(f"site{k}" for k in range(12)))
    elements, (dt, angle), site = inputs[:6], inputs[6:8], inputs[8:]
    sense = sy.select(sy.less(sy.cos(elements[2]), RETROGRADE), -1.0, 1.0)
    # A shift of the observation's time moves the satellite and rotates the Earth.
    shift = sy.variable("shift")
    now = at_time(elements, dt + shift, field)
    orbit = osculating_equinoctial(now, sense, field, short_period=short_period)
    # to Earth-fixed axes, relative to the antenna, and to east, north, up
    x, y, z = position(orbit, sense)
    turn = angle + _RATE * shift
    c, s = sy.cos(turn), sy.sin(turn)
    away = (c * x + s * y - site[0], c * y - s * x - site[1], z - site[2])
    east, north, up = (sy.dot(site[3 + 3 * row : 6 + 3 * row], away) for row in range(3))
    near = 1.0 / sy.norm((east, north, up))
    return inputs, shift, (near * east, near * north, near * up)
