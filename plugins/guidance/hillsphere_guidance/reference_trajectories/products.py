"""Product of the stage ``reference_trajectories``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products import FlightSet
from hillsphere.products.fields import Label, Shape

__all__ = ["ReferenceTrajectories"]


@dataclass(frozen=True)
class ReferenceTrajectories(FlightSet):
    """Planned descents: the states of each on a grid of times, and the command held between them.

    A flight from the start under the held command meets the planned states at every second time of
    the grid, and at the end, exactly. At the times between it misses them by what a command that is
    constant over a step cannot do.

    `flights` holds the descents, NaN beyond the end of each.
    """

    command: Annotated[Array, Shape("axes", "times", "descents")]
    """Command as planned, not held, at the times of the grid, m/s²."""
    descents: Annotated[tuple[str, ...], Shape("descents")]
    """Name of each descent in the mission, without the start."""
    guidance: str
    """Name of the guidance that planned them."""
    account: Annotated[tuple[str, ...], Shape("descents"), Label("search")]
    """How the search for each ended: its number of evaluations and its residual."""
    start_distance_m: Annotated[Array, Shape("descents"), Label("start", 6, "km")]
    """Distance of the start from the centre of the plant's frame."""
    duration_s: Annotated[Array, Shape("descents"), Label("duration", 6)]
    """Length of the flight."""
    latitude_rad: Annotated[Array, Shape("descents"), Label("latitude", 6, "deg")]
    """Planetocentric latitude of the site; NaN without one."""
    longitude_rad: Annotated[Array, Shape("descents"), Label("longitude", 6, "deg")]
    """Longitude of the site on the body; NaN without one."""
    dv_m_s: Annotated[Array, Shape("descents"), Label("ΔV", 5)]
    """∫|a|dt of the command as planned."""
    dv_held_m_s: Annotated[Array, Shape("descents"), Label("ΔV, held", 5)]
    """∫|a|dt of the command as held."""
    peak_m_s2: Annotated[Array, Shape("descents"), Label("largest command", 4, "mm_s2")]
    """Largest |a| of the command as planned."""
    replay_m: Annotated[Array, Shape(2, "descents")]
    """Distance (m) and speed (m/s) from the planned end at which an independent propagator ends,
    flying the command as planned."""
    replay_held_m: Annotated[Array, Shape(2, "descents")]
    """Likewise, flying the held command."""
    height_m: Annotated[Array, Shape("times", "descents")]
    """Height above the surface along the radius, negative below; NaN without a surface."""
    surface_m: Annotated[Array | None, Shape(3, "latitudes", "longitudes")]
    """Points of the surface, in the plant's frame."""
    body: str
    """Name of the body; empty if the plant does not give it."""
    series_radius_m: float | None
    """Radius inside which the gravity is a series that may diverge."""
    compared: Annotated[tuple[str, ...], Shape("plants")]
    """Names of the plants that are compared with that of the descents."""
    difference_m_s2: Annotated[Array, Shape("plants", "times", "descents")]
    """Length of the difference of their accelerations, without a command, from those of the plant
    of the descents, along the paths."""
