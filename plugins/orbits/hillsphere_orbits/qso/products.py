"""Product of the stage ``qso_family``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.products.fields import Label, Shape

__all__ = ["QsoFamily"]


@dataclass(frozen=True)
class QsoFamily(OrbitSet):
    """A family of quasi-satellite orbits: the curve, and the members that were asked for.

    The members are those of the orbits asked for that the family has, in that order.
    """

    curve: PeriodicOrbits
    """Orbits from the largest amplitude to the smallest, equally spaced in arclength relative to
    distance."""
    member_indices: Annotated[Array, Shape(2, "members")]
    """Planar and vertical stability index; NaN where they are complex."""
    curve_indices: Annotated[Array, Shape(2, "curve")]
    """The same along the curve."""
    y_max_m: Annotated[Array, Shape("members"), Label("largest y", 9, "km")]
    """Largest y of each member."""
    vx_at_y_max_m_s: Annotated[Array, Shape("members")]
    """vx there."""
    tracks_m: Annotated[Array, Shape(3, "points", "members")]
    """Positions of the members along one revolution."""
    nearest_m: float
    """Least distance of any orbit of the curve from the moon's centre."""
    drift: Annotated[Array, Shape("members")]
    """Largest change of the integral over `drift_revolutions`, natural units."""
    drift_revolutions: int
    """Revolutions."""
    name: str
    """Name of the family in a legend: its gravity model or its label."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""
    primary_distance_m: float | None
    """Distance of the primary, by which the Hill approximation is judged; None if the equations are
    not Hill's or nothing is known of it."""
    series_radius_m: float | None
    """Radius inside which the gravity is a series without guarantee of convergence."""
    method: str
    """How the orbits were found."""
    check: str
    """How closure and drift were measured."""
    ends: tuple[str, str]
    """Why the curve stops at its largest and its smallest amplitude."""
    missing: tuple[str, ...] = ()
    """Requested orbits that the family does not have, with the nearest that it has."""
    gravity_error: float | None = None
    """Largest relative error of a series that stands for the gravity of a shape, along the curve,
    by the shape's exact gravity; None if the gravity is no such series."""
