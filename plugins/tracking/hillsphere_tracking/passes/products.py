"""Product of the stage ``passes``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape

__all__ = ["SUN_IN_BEAM", "PassList"]

SUN_IN_BEAM = "Sun in beam"
"""Reason that is given for intervals in which the Sun is within the antenna's beam."""


@dataclass(frozen=True)
class PassList:
    """P passes of N satellites over S stations, in the order of station and time.

    Elevations are apparent if `refracted` is true, else geometric. Times count from `start`.
    """

    stations: Annotated[tuple[str, ...], Shape("stations"), Label("station")]
    """Names of the stations."""
    satellites: Annotated[tuple[str, ...], Shape("satellites"), Label("satellite")]
    """Names of the satellites."""
    start: str
    """Beginning of the search, date and time in UTC."""
    refracted: bool
    """Whether elevations are apparent."""
    place_rad: Annotated[Array, Shape(2, "stations")]
    """Geodetic latitude and longitude of each station."""
    mask_rad: Annotated[Array, Shape(361, "stations")]
    """Horizon mask of each station at azimuths of 0°, 1° … 360°."""
    searched_s: Annotated[Array, Shape("satellites")]
    """Length of the search for each satellite."""
    end_reasons: Annotated[tuple[str, ...], Shape("satellites")]
    """Reason why the search ended early; ``""`` if it did not."""
    visibility: Annotated[NDArray[np.str_], Shape("stations", "satellites"), Label("visible")]
    """``"always"``, ``"never"`` or ``"passes"``."""
    highest_s: Annotated[Array, Shape("stations", "satellites")]
    """Time of each satellite's highest elevation."""
    highest_rad: Annotated[
        Array, Shape("stations", "satellites"), Label("highest elevation", 5, "deg")
    ]
    """Each satellite's highest elevation, also if it never rises."""
    station: Annotated[Integers, Shape("passes")]
    """Index of the station of each pass."""
    satellite: Annotated[Integers, Shape("passes")]
    """Index of the satellite of each pass."""
    revolution: Annotated[Integers, Shape("passes"), Label("revolution")]
    """Revolution in which the pass culminates; the first lasts from the start to the first
    ascending node."""
    ascending: Annotated[NDArray[np.bool_], Shape("passes")]
    """Whether the satellite moves northwards at the culmination."""
    rise_s: Annotated[Array, Shape("passes")]
    """Time of the rise."""
    culmination_s: Annotated[Array, Shape("passes")]
    """Time of the highest elevation."""
    set_s: Annotated[Array, Shape("passes")]
    """Time of the set."""
    begun: Annotated[NDArray[np.bool_], Shape("passes")]
    """Whether the pass was under way at the start of the search."""
    unfinished: Annotated[NDArray[np.bool_], Shape("passes")]
    """Whether the pass was under way at the end of the search."""
    highest_azimuth_rad: Annotated[Array, Shape("passes"), Label("azimuth when highest", 5, "deg")]
    """Azimuth at the culmination."""
    elevation_max_rad: Annotated[Array, Shape("passes"), Label("highest elevation", 5, "deg")]
    """Elevation at the culmination."""
    peak_azimuth_rate_rad_s: Annotated[Array, Shape("passes"), Label("fastest azimuth", 4, "deg_s")]
    """Largest azimuth rate."""
    keyhole: Annotated[NDArray[np.bool_], Shape("passes"), Label("through the keyhole")]
    """Whether the pass rises into the keyhole of the mount."""
    sunlit_part: Annotated[Array, Shape("passes"), Label("part in sunlight", 4)]
    """Fraction of the pass during which the satellite is outside the Earth's umbra."""
    t_s: Annotated[Array, Shape("samples", "passes")]
    """Times along each pass, from rise to set at equal steps."""
    azimuth_rad: Annotated[Array, Shape("samples", "passes")]
    """Azimuths at these times, in [0, 2π)."""
    elevation_rad: Annotated[Array, Shape("samples", "passes")]
    """Elevations at these times."""
    range_m: Annotated[Array, Shape("samples", "passes")]
    """Distances from the station at these times."""
    range_rate_m_s: Annotated[Array, Shape("samples", "passes")]
    """Range rates at these times, positive for a receding satellite."""
    sun_rad: Annotated[Array, Shape(2, "passes")]
    """Azimuth and elevation of the Sun at the culmination."""
    span_pass: Annotated[Integers, Shape("spans")]
    """Pass of each disturbed interval."""
    span_reason: Annotated[NDArray[np.str_], Shape("spans"), Label("what disturbs")]
    """``"Sun in beam"``, or the reason of a blind sector."""
    span_s: Annotated[Array, Shape(2, "spans")]
    """Beginning and end of each interval."""
    eclipse_satellite: Annotated[Integers, Shape("eclipses")]
    """Satellite of each eclipse."""
    eclipse_s: Annotated[Array, Shape(2, "eclipses")]
    """Beginning and end of each eclipse."""
    ground_s: Annotated[Array, Shape("points", "satellites")]
    """Times of the ground tracks, one day at most; NaN after their ends."""
    ground: Annotated[Array, Shape(3, "points", "satellites")]
    """Geodetic latitude and longitude, rad, and height, m."""
    warnings: tuple[str, ...]
    """Sentences for the verdict."""
