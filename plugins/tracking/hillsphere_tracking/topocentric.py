"""Topocentric coordinates: azimuth, elevation, range and their rates, and the inverse conversion.

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
"""Apparent elevation (deg) below which refraction is held constant: Bennett's formula has a pole at
−4.4° and is not meant for negative elevations."""


def line_of_sight(station: Station, r_ecef_m: Array) -> Array:
    """Return the line of sight from a station: relative positions along its local axes.

    Parameters
    ----------
    station : Station
        The observing station.
    r_ecef_m : ndarray, shape (3, N)
        Earth-fixed positions, m.

    Returns
    -------
    ndarray, shape (3, N)
        East, north, up, m.

    Raises
    ------
    InputError
        If the array does not have the shape above.
    """
    r = np.asarray(r_ecef_m, dtype=float)
    if r.ndim != 2 or r.shape[0] != 3:
        raise InputError(f"positions must be (3, N), got {r.shape}")
    return np.asarray(station.axes @ (r - station.ecef_m[:, None]))


def angles(station: Station, r_ecef_m: Array) -> tuple[Array, Array, Array]:
    """Convert Earth-fixed positions to azimuth, elevation and range ([1]_, algorithm 27).

    Parameters
    ----------
    station : Station
        The observing station.
    r_ecef_m : ndarray, shape (3, N)
        Earth-fixed positions, m.

    Returns
    -------
    azimuth_rad : ndarray, shape (N,)
        Azimuth from north eastwards, in [0, 2π); 0 exactly at the zenith.
    elevation_rad : ndarray, shape (N,)
        Geometric elevation, in [−π/2, π/2].
    range_m : ndarray, shape (N,)
        Distance from the station.

    Raises
    ------
    InputError
        If the array does not have the shape above.
    """
    east, north, up = line_of_sight(station, r_ecef_m)
    level = np.hypot(east, north)
    return _azimuth(east, north), np.arctan2(up, level), np.hypot(level, up)


def rates(station: Station, x_ecef: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Convert Earth-fixed states to azimuth, elevation, range and their rates.

    Parameters
    ----------
    station : Station
        The observing station.
    x_ecef : ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.

    Returns
    -------
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        As `angles` returns them.
    azimuth_rate_rad_s, elevation_rate_rad_s : ndarray, shape (N,)
        Time derivatives. The azimuth rate is unbounded near the zenith; exactly at the zenith it is
        set to 0, and the elevation rate is the rate of departure from the zenith.
    range_rate_m_s : ndarray, shape (N,)
        Range rate, positive for a receding satellite.

    Raises
    ------
    InputError
        If the array does not have the shape above.
    """
    x = np.asarray(x_ecef, dtype=float)
    if x.ndim != 2 or x.shape[0] != 6:
        raise InputError(f"states must be (6, N), got {x.shape}")
    east, north, up = line_of_sight(station, x[:3])
    d_east, d_north, d_up = station.axes @ x[3:]
    level = np.hypot(east, north)
    distance = np.hypot(level, up)
    # The horizontal distance is not differentiable at the zenith: divide by it only elsewhere.
    aside = level > 0.0
    safe = np.where(aside, level, 1.0)
    d_level = np.where(aside, (east * d_east + north * d_north) / safe, np.hypot(d_east, d_north))
    # derivatives of atan2(east, north), atan2(up, level) and of the distance
    return (
        _azimuth(east, north),
        np.arctan2(up, level),
        distance,
        np.where(aside, (d_east * north - east * d_north) / safe**2, 0.0),
        (d_up * level - up * d_level) / distance**2,
        (level * d_level + up * d_up) / distance,
    )


def direction_cosines(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Convert azimuth and elevation to unit vectors.

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Direction in the sky; azimuth from north eastwards.

    Returns
    -------
    ndarray, shape (3, N)
        Components along the local east, north and up axes.
    """
    level = np.cos(elevation_rad)
    return np.array(
        [np.sin(azimuth_rad) * level, np.cos(azimuth_rad) * level, np.sin(elevation_rad)]
    )


def satellite_positions(
    station: Station, azimuth_rad: Array, elevation_rad: Array, range_m: Array
) -> Array:
    """Convert azimuth, elevation and range to Earth-fixed positions: the inverse of `angles`.

    Parameters
    ----------
    station : Station
        The observing station.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        Geometric angles and distance.

    Returns
    -------
    ndarray, shape (3, N)
        Earth-fixed positions, m.
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
    """Convert topocentric coordinates and rates to Earth-fixed states: the inverse of `rates`.

    Parameters
    ----------
    station : Station
        The observing station.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (N,)
        Geometric angles and distance.
    azimuth_rate_rad_s, elevation_rate_rad_s, range_rate_m_s : ndarray, shape (N,)
        Time derivatives of these.

    Returns
    -------
    ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.
    """
    # velocity = ρ̇ û + ρ (ḣ e_h + Ȧ cos h e_A), with unit vectors e_h of rising elevation and e_A of
    # rising azimuth
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
    """Return the refraction, the difference of apparent and geometric elevation, by Bennett [2]_.

    The refraction is cot(h + 7.31/(h + 4.4)) arc minutes with h in degrees, 0.165° at 5°. The
    formula holds for visible light from objects far above the atmosphere, to 0.07′ for stars. Below
    an apparent elevation of −1° the value is held constant. Humid air bends radio waves somewhat
    more.

    Parameters
    ----------
    apparent_rad : ndarray, shape (N,)
        Apparent elevations.
    pressure_hpa, temperature_c : float
        Pressure and temperature of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Apparent minus geometric elevation, rad, never negative.
    """
    h = np.maximum(np.asarray(apparent_rad) / _DEGREE, _LOWEST)
    minutes = 1.0 / np.tan((h + 7.31 / (h + 4.4)) * _DEGREE)
    # density of the air relative to Bennett's standard, 1010 hPa and 10 °C
    air = pressure_hpa / 1010.0 * 283.0 / (273.0 + temperature_c)
    # The argument exceeds 90° above h = 89.92°; the cotangent is then −0.1″ at most.
    return np.maximum(minutes, 0.0) * (air * _DEGREE / 60.0)


def apparent_elevation(
    elevation_rad: Array, pressure_hpa: float = 1010.0, temperature_c: float = 10.0
) -> Array:
    """Convert geometric to apparent elevations: the inverse of `geometric_elevation`.

    Parameters
    ----------
    elevation_rad : ndarray, shape (N,)
        Geometric elevations.
    pressure_hpa, temperature_c : float
        Pressure and temperature of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Apparent elevations, rad.
    """
    true = np.asarray(elevation_rad, dtype=float)
    apparent = true + refraction(true, pressure_hpa, temperature_c)
    # g(h) = h − refraction(h) has a slope of 1.0 to 1.35. The iteration h ← h + 0.8 (true − g(h))
    # multiplies the error by 1 − 0.8 g′, at most 0.2 in magnitude, so that 30 steps reach rounding.
    for _ in range(30):
        change = true - geometric_elevation(apparent, pressure_hpa, temperature_c)
        apparent = apparent + 0.8 * change
        if np.max(np.abs(change), initial=0.0) < 1e-15:
            break
    return apparent


def geometric_elevation(
    apparent_rad: Array, pressure_hpa: float = 1010.0, temperature_c: float = 10.0
) -> Array:
    """Convert apparent to geometric elevations: subtract the refraction.

    Parameters
    ----------
    apparent_rad : ndarray, shape (N,)
        Apparent elevations.
    pressure_hpa, temperature_c : float
        Pressure and temperature of the air at the station.

    Returns
    -------
    ndarray, shape (N,)
        Geometric elevations, rad.
    """
    apparent = np.asarray(apparent_rad, dtype=float)
    return apparent - refraction(apparent, pressure_hpa, temperature_c)


def _azimuth(east: Array, north: Array) -> Array:
    azimuth = np.remainder(np.arctan2(east, north), _TURN)
    # a tiny negative azimuth rounds to a full turn, which is outside [0, 2π)
    return np.where(azimuth >= _TURN, 0.0, azimuth)
