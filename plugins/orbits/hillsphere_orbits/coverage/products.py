"""What the stage ``coverage`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array

__all__ = ["Coverage"]


@dataclass(frozen=True)
class Coverage:
    """Ground tracks, altitudes and light of M orbits, S places of the year.

    The ground point is the one of the surface nearest to the spacecraft, its latitude
    planetocentric, its longitude counted eastwards from the prime meridian; where no surface is
    known it is the direction of the spacecraft, and altitudes are NaN. Means are over time; those
    with the Sun also over its longitude, independently of the place on the orbit.

    Parameters
    ----------
    labels : tuple of str, length M
        Names of the orbits.
    latitude_rad : ndarray, shape (2, M)
        Least and largest latitude.
    surface_part : ndarray, shape (M,)
        Part of the surface between them.
    cells_part : ndarray, shape (M,)
        Part of the surface in cells that the ground point meets.
    band_rad : ndarray, shape (B + 1,)
        Edges of the bands of latitude.
    band_time : ndarray, shape (B, M)
        Part of the time over each.
    altitude_m, distance_m : ndarray, shape (3, M)
        Least, mean and largest altitude above the surface and distance from the centre.
    speed_m_s : ndarray, shape (3, M)
        Least, mean and largest speed relative to the surface, which stands still in the frame.
    declination_rad : ndarray, shape (S,)
        Of the Sun over the orbit plane of the moon.
    primary_shadow : ndarray, shape (S, M)
        Mean part of the Sun's disc that the primary hides; NaN where its radius is not given.
    body_shadow : ndarray, shape (S, M)
        Part of the time in the shadow of the moon; NaN where no surface is known.
    shadow : ndarray, shape (S, M)
        Mean part of the Sun hidden by either, as far as known.
    lit_ground : ndarray, shape (S, M)
        Part of the time in which the Sun shines on the ground point from high enough; NaN where
        no surface is known.
    track_rad : ndarray, shape (2, P, M)
        Longitude in (−π, π] and latitude of the ground point along one period.
    track_altitude_m : ndarray, shape (P, M)
        Altitude along it.
    cell_rad, sun_elevation_min_rad : float
        As asked for.
    sun_longitudes : int
        Over how many the means go.
    sun_distance_m : float or None
        None for a Sun that is infinitely far.
    body : str
        Name of the moon.
    """

    labels: tuple[str, ...]
    latitude_rad: Array
    surface_part: Array
    cells_part: Array
    band_rad: Array
    band_time: Array
    altitude_m: Array
    distance_m: Array
    speed_m_s: Array
    declination_rad: Array
    primary_shadow: Array
    body_shadow: Array
    shadow: Array
    lit_ground: Array
    track_rad: Array
    track_altitude_m: Array
    cell_rad: float
    sun_elevation_min_rad: float
    sun_longitudes: int
    sun_distance_m: float | None
    body: str
