"""Geodetic coordinates and stations on a reference ellipsoid.

References
----------
.. [1] IERS Conventions (2010), IERS Technical Note 36, section 4.2.6 (geodetic coordinates).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import cos, inf, isfinite, pi, sin

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["WGS84", "Ellipsoid", "Station", "ecef", "geodetic"]


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid of revolution about the Earth-fixed z axis.

    Parameters
    ----------
    equatorial_radius_m : float
        Semi-major axis a.
    inverse_flattening : float
        1/f; ``inf`` for a sphere.

    Raises
    ------
    InputError
        If the radius is not positive and finite or 1/f is not above 1.
    """

    equatorial_radius_m: float
    inverse_flattening: float

    def __post_init__(self) -> None:
        a, inverse = self.equatorial_radius_m, self.inverse_flattening
        if not (isfinite(a) and a > 0.0):
            raise InputError(f"an ellipsoid's equatorial radius must be > 0 m, got {a}")
        if not inverse > 1.0:
            raise InputError(
                f"an ellipsoid's inverse flattening must be > 1, got {inverse}; a sphere has inf"
            )

    @property
    def flattening(self) -> float:
        """Flattening f = (a − b)/a."""
        return 0.0 if self.inverse_flattening == inf else 1.0 / self.inverse_flattening


WGS84 = Ellipsoid(6378137.0, 298.257223563)
"""World Geodetic System 1984."""


def ecef(
    latitude_rad: Array, longitude_rad: Array, height_m: Array, ellipsoid: Ellipsoid = WGS84
) -> Array:
    """Return Earth-fixed positions of geodetic coordinates.

    Parameters
    ----------
    latitude_rad, longitude_rad, height_m : ndarray, shape (N,)
        Geodetic latitude, longitude east of the prime meridian, height above the ellipsoid.
    ellipsoid : Ellipsoid
        The ellipsoid of these coordinates.

    Returns
    -------
    ndarray, shape (3, N)
        Positions, m.

    Raises
    ------
    InputError
        If a latitude is not within ±90° or anything is not finite.
    """
    latitude, longitude, height = np.broadcast_arrays(
        *(
            np.atleast_1d(np.asarray(q, dtype=float))
            for q in (latitude_rad, longitude_rad, height_m)
        )
    )
    if not all(np.isfinite(q).all() for q in (latitude, longitude, height)):
        raise InputError("geodetic coordinates must be finite, got nan or inf")
    if np.abs(latitude).max(initial=0.0) > 0.5 * pi:
        worst = np.degrees(latitude[np.argmax(np.abs(latitude))])
        raise InputError(f"geodetic latitudes must be within ±90°, got {worst:.6g}°")
    places = erfa.gd2gce(
        ellipsoid.equatorial_radius_m, ellipsoid.flattening, longitude, latitude, height
    )
    return np.ascontiguousarray(places.T)


def geodetic(r_ecef_m: Array, ellipsoid: Ellipsoid = WGS84) -> tuple[Array, Array, Array]:
    """Return geodetic coordinates of Earth-fixed positions.

    Parameters
    ----------
    r_ecef_m : ndarray, shape (3, N)
        Positions, m.
    ellipsoid : Ellipsoid
        The ellipsoid of the coordinates.

    Returns
    -------
    latitude_rad, longitude_rad, height_m : ndarray, shape (N,)
        Geodetic latitude, longitude in (−π, π] and height above the ellipsoid.

    Raises
    ------
    InputError
        If the shape is not (3, N) or a position is not finite.
    """
    r = np.asarray(r_ecef_m, dtype=float)
    if r.ndim != 2 or r.shape[0] != 3:
        raise InputError(f"positions must be (3, N), got {r.shape}")
    if not np.isfinite(r).all():
        raise InputError("positions must be finite, got nan or inf")
    longitude, latitude, height = erfa.gc2gde(
        ellipsoid.equatorial_radius_m, ellipsoid.flattening, np.ascontiguousarray(r.T)
    )
    return latitude, longitude, height


@dataclass(frozen=True)
class Station:
    """A ground station, given by its geodetic coordinates.

    Parameters
    ----------
    name : str
        For tables and messages.
    latitude_rad, longitude_rad : float
        Geodetic; longitude east of the prime meridian.
    height_m : float
        Above the ellipsoid.
    ellipsoid : Ellipsoid
        To which these refer.

    Raises
    ------
    InputError
        If the latitude is not within ±90° or anything is not finite.
    """

    name: str
    latitude_rad: float
    longitude_rad: float
    height_m: float = 0.0
    ellipsoid: Ellipsoid = field(default=WGS84)

    def __post_init__(self) -> None:
        try:
            _ = self.ecef_m
        except InputError as error:
            raise InputError(f"station {self.name!r}: {error}") from None

    @cached_property
    def ecef_m(self) -> Array:
        """Earth-fixed position, m, shape (3,), read-only."""
        place = ecef(
            np.array([self.latitude_rad]),
            np.array([self.longitude_rad]),
            np.array([self.height_m]),
            self.ellipsoid,
        )[:, 0]
        place.setflags(write=False)
        return place

    @cached_property
    def axes(self) -> Array:
        """Local axes, shape (3, 3), read-only: rows are east, north and up (ellipsoid normal).

        ``axes @ d`` resolves an Earth-fixed difference d along these axes.
        """
        sin_lat, cos_lat = sin(self.latitude_rad), cos(self.latitude_rad)
        sin_lon, cos_lon = sin(self.longitude_rad), cos(self.longitude_rad)
        axes = np.array(
            [
                [-sin_lon, cos_lon, 0.0],
                [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
            ]
        )
        axes.setflags(write=False)
        return axes

    @classmethod
    def at(cls, name: str, r_ecef_m: Array, ellipsoid: Ellipsoid = WGS84) -> Station:
        """Return the station at an Earth-fixed position.

        Parameters
        ----------
        name : str
            For tables and messages.
        r_ecef_m : ndarray, shape (3,)
            Position, m.
        ellipsoid : Ellipsoid
            To which its coordinates shall refer.

        Returns
        -------
        Station
            The station.
        """
        place = np.asarray(r_ecef_m, dtype=float).reshape(-1, 1)
        latitude, longitude, height = geodetic(place, ellipsoid)
        return cls(name, float(latitude[0]), float(longitude[0]), float(height[0]), ellipsoid)
