"""Azimuth, elevation, range and their rates as a station sees them, and back.

Azimuth counts from north eastwards, elevation from the plane normal to the ellipsoid's normal.
Angles are geometric, along the straight line from the station to the satellite at one instant:
light time is neglected, and refraction is added only by `apparent_elevation`.

References
----------
.. [1] D. A. Vallado (2013), Fundamentals of Astrodynamics and Applications, 4th ed., Microcosm,
   section 4.4 (topocentric horizon coordinates; algorithm 27).
.. [2] G. G. Bennett (1982), The Calculation of Astronomical Refraction in Marine Navigation,
   Journal of Navigation 35(2), 255-259.
"""

from __future__ import annotations

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = [
    "angles",
    "apparent_elevation",
    "direction_cosines",
    "geometric_elevation",
    "line_of_sight",
    "rates",
    "refraction",
    "satellite_positions",
    "satellite_states",
]  # fmt: skip

_TURN = 2.0 * np.pi
_DEGREE = np.pi / 180.0
_LOWEST = -1.0
"""Apparent elevation, deg, below which refraction is held: the formula has a pole at −4.4°."""


def line_of_sight(station: Station, r_ecef_m: Array) -> Array:
    """Return positions relative to the station along its local axes.

    Parameters
    ----------
    station : Station
        Where from.
    r_ecef_m : ndarray, shape (3, N)
        Earth-fixed positions, m.

    Returns
    -------
    ndarray, shape (3, N)
        East, north, up, m.

    Raises
    ------
    InputError
        If the shape is another one.
    """
    r = np.asarray(r_ecef_m, dtype=float)
    if r.ndim != 2 or r.shape[0] != 3:
        raise InputError(f"positions must be (3, N), got {r.shape}")
    return np.asarray(station.axes @ (r - station.ecef_m[:, None]))


def angles(station: Station, r_ecef_m: Array) -> tuple[Array, Array, Array]:
    """Return where the station sees positions.

    Parameters
    ----------
    station : Station
        Where from.
    r_ecef_m : ndarray, shape (3, N)
        Earth-fixed positions, m.

    Returns
    -------
    azimuth_rad : ndarray, shape (N,)
        From north eastwards, in [0, 2π); 0 at the very zenith.
    elevation_rad : ndarray, shape (N,)
        Geometric, in [−π/2, π/2].
    range_m : ndarray, shape (N,)
        Distance.

    Raises
    ------
    InputError
        If the shape is another one.
    """
    east, north, up = line_of_sight(station, r_ecef_m)
    level = np.hypot(east, north)
    return _azimuth(east, north), np.arctan2(up, level), np.hypot(level, up)


def rates(station: Station, x_ecef: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return where the station sees states, and how fast that changes.

    Parameters
    ----------
    station : Station
        Where from.
    x_ecef : ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.

    Returns
    -------
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        As `angles` gives them.
    azimuth_rate_rad_s, elevation_rate_rad_s : ndarray, shape (N,)
        Their derivatives. Towards the zenith the azimuth's grows beyond bounds; at the very zenith
        it is given as 0, and the elevation's as that of leaving it.
    range_rate_m_s : ndarray, shape (N,)
        Positive for a satellite that recedes.

    Raises
    ------
    InputError
        If the shape is another one.
    """
    x = np.asarray(x_ecef, dtype=float)
    if x.ndim != 2 or x.shape[0] != 6:
        raise InputError(f"states must be (6, N), got {x.shape}")
    east, north, up = line_of_sight(station, x[:3])
    d_east, d_north, d_up = station.axes @ x[3:]
    level = np.hypot(east, north)
    distance = np.hypot(level, up)
    aside = level > 0.0
    safe = np.where(aside, level, 1.0)
    d_level = np.where(aside, (east * d_east + north * d_north) / safe, np.hypot(d_east, d_north))
    return (
        _azimuth(east, north),
        np.arctan2(up, level),
        distance,
        np.where(aside, (d_east * north - east * d_north) / safe**2, 0.0),
        (d_up * level - up * d_level) / distance**2,
        (level * d_level + up * d_up) / distance,
    )


def direction_cosines(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return unit vectors east, north, up of directions in the sky, shape (3, N).

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Where to.

    Returns
    -------
    ndarray, shape (3, N)
        Along the station's local axes.
    """
    level = np.cos(elevation_rad)
    return np.array(
        [np.sin(azimuth_rad) * level, np.cos(azimuth_rad) * level, np.sin(elevation_rad)]
    )


def satellite_positions(
    station: Station, azimuth_rad: Array, elevation_rad: Array, range_m: Array
) -> Array:
    """Return the positions that a station sees: the inverse of `angles`.

    Parameters
    ----------
    station : Station
        Where from.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        Geometric angles and distance.

    Returns
    -------
    ndarray, shape (3, N)
        Earth-fixed, m.
    """
    sight = range_m * direction_cosines(azimuth_rad, elevation_rad)
    return np.asarray(station.ecef_m[:, None] + station.axes.T @ sight)


def satellite_states(
    station: Station,
    azimuth_rad: Array,
    elevation_rad: Array,
    range_m: Array,
    azimuth_rate_rad_s: Array,
    elevation_rate_rad_s: Array,
    range_rate_m_s: Array,
) -> Array:
    """Return the states that a station sees: the inverse of `rates`.

    Parameters
    ----------
    station : Station
        Where from.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        Geometric angles and distance.
    azimuth_rate_rad_s, elevation_rate_rad_s, range_rate_m_s : ndarray, shape (N,)
        Their derivatives.

    Returns
    -------
    ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.
    """
    along = direction_cosines(azimuth_rad, elevation_rad)
    sine, level = np.sin(elevation_rad), np.cos(elevation_rad)
    upwards = np.array([-np.sin(azimuth_rad) * sine, -np.cos(azimuth_rad) * sine, level])
    zero = np.zeros_like(np.asarray(level))
    rightwards = np.array([np.cos(azimuth_rad), -np.sin(azimuth_rad), zero])
    speed = range_rate_m_s * along + range_m * (
        elevation_rate_rad_s * upwards + azimuth_rate_rad_s * level * rightwards
    )
    place = station.ecef_m[:, None] + station.axes.T @ (range_m * along)
    return np.concatenate([place, station.axes.T @ speed])


def refraction(
    apparent_rad: Array, pressure_hpa: float = 1010.0, temperature_c: float = 10.0
) -> Array:
    """Return by how much the atmosphere lifts what is seen at apparent elevations.

    Bennett's formula, cot(h + 7.31/(h + 4.4)) arc minutes with h in degrees, for visible light and
    what is far above the atmosphere (0.165° at 5°) [2]_; good to 0.07′ for stars. Held below an
    apparent −1°. Humid air bends radio waves somewhat more.

    Parameters
    ----------
    apparent_rad : ndarray, shape (N,)
        Elevations at which something appears.
    pressure_hpa, temperature_c : float
        Of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Apparent less geometric elevation, rad, never negative.
    """
    h = np.maximum(np.asarray(apparent_rad) / _DEGREE, _LOWEST)
    minutes = 1.0 / np.tan((h + 7.31 / (h + 4.4)) * _DEGREE)
    air = pressure_hpa / 1010.0 * 283.0 / (273.0 + temperature_c)
    # the argument passes 90° at 89.92°, where the cotangent turns negative by a tenth of a second
    return np.maximum(minutes, 0.0) * (air * _DEGREE / 60.0)


def apparent_elevation(
    elevation_rad: Array, pressure_hpa: float = 1010.0, temperature_c: float = 10.0
) -> Array:
    """Return the apparent elevations of geometric ones: the inverse of `geometric_elevation`.

    Parameters
    ----------
    elevation_rad : ndarray, shape (N,)
        Geometric.
    pressure_hpa, temperature_c : float
        Of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Apparent elevations, rad.
    """
    true = np.asarray(elevation_rad, dtype=float)
    seen = true + refraction(true, pressure_hpa, temperature_c)
    # Apparent less its refraction has a slope of 1.0 to 1.35: the secant contracts everywhere.
    for _ in range(30):
        change = true - geometric_elevation(seen, pressure_hpa, temperature_c)
        seen = seen + 0.8 * change
        if np.max(np.abs(change), initial=0.0) < 1e-15:
            break
    return seen


def geometric_elevation(
    apparent_rad: Array, pressure_hpa: float = 1010.0, temperature_c: float = 10.0
) -> Array:
    """Return the geometric elevations of apparent ones.

    Parameters
    ----------
    apparent_rad : ndarray, shape (N,)
        Elevations at which something appears.
    pressure_hpa, temperature_c : float
        Of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Geometric elevations, rad.
    """
    seen = np.asarray(apparent_rad, dtype=float)
    return seen - refraction(seen, pressure_hpa, temperature_c)


def _azimuth(east: Array, north: Array) -> Array:
    azimuth = np.remainder(np.arctan2(east, north), _TURN)
    # a hair west of north rounds to a full turn
    return np.where(azimuth >= _TURN, 0.0, azimuth)
