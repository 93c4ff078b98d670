"""Product of the stage ``coverage``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape

__all__ = ["Coverage"]


@dataclass(frozen=True)
class Coverage:
    """Ground tracks, altitudes and light of orbits, over the seasons of a year.

    The ground point is the one of the surface nearest to the spacecraft, its latitude
    planetocentric, its longitude counted eastwards from the prime meridian; where no surface is
    known it is the direction of the spacecraft, and altitudes are NaN. Means are over time; those
    with the Sun also over its longitude, independently of the place on the orbit.
    """

    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    """Names of the orbits."""
    latitude_rad: Annotated[Array, Shape(2, "orbits"), Label("latitude", 5, "deg")]
    """Least and largest latitude."""
    surface_part: Annotated[Array, Shape("orbits"), Label("surface between", 4)]
    """Part of the surface between them."""
    cells_part: Annotated[Array, Shape("orbits"), Label("surface in cells met", 4)]
    """Part of the surface in cells that the ground point meets."""
    band_rad: Annotated[Array, Shape("bands + 1")]
    """Edges of the bands of latitude."""
    band_time: Annotated[Array, Shape("bands", "orbits")]
    """Part of the time over each."""
    altitude_m: Annotated[Array, Shape(3, "orbits"), Label("altitude", 5, "km")]
    """Least, mean and largest altitude above the surface."""
    distance_m: Annotated[Array, Shape(3, "orbits"), Label("distance", 5, "km")]
    """Least, mean and largest distance from the centre."""
    speed_m_s: Annotated[Array, Shape(3, "orbits"), Label("speed", 4)]
    """Least, mean and largest speed relative to the surface, which stands still in the frame."""
    declination_rad: Annotated[
        Array, Shape("seasons"), Label("elevation of the Sun over the orbit plane", 4, "deg")
    ]
    """Of the Sun over the orbit plane of the moon."""
    primary_shadow: Annotated[Array, Shape("seasons", "orbits"), Label("by the primary", 4)]
    """Mean part of the Sun's disc that the primary hides; NaN where its radius is not given."""
    body_shadow: Annotated[Array, Shape("seasons", "orbits"), Label("by the moon", 4)]
    """Part of the time in the shadow of the moon; NaN where no surface is known."""
    shadow: Annotated[Array, Shape("seasons", "orbits"), Label("eclipsed", 4)]
    """Mean part of the Sun hidden by either, as far as known."""
    lit_ground: Annotated[Array, Shape("seasons", "orbits"), Label("ground lit", 4)]
    """Part of the time in which the Sun shines on the ground point from high enough; NaN where no
    surface is known."""
    track_rad: Annotated[Array, Shape(2, "points", "orbits")]
    """Longitude in (−π, π] and latitude of the ground point along one period."""
    track_altitude_m: Annotated[Array, Shape("points", "orbits")]
    """Altitude along it."""
    cell_rad: float
    """Width of the cells, as requested."""
    min_sun_elevation_rad: float
    """Elevation of the Sun from which ground counts as lit, as requested."""
    sun_longitudes: int
    """Over how many longitudes of the Sun the means go."""
    sun_distance_m: float | None
    """None for a Sun that is infinitely far."""
    body: str
    """Name of the moon."""
