"""Product of the stage ``orbit_family``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.products.fields import Label, Shape

__all__ = ["FollowedFamily"]


@dataclass(frozen=True)
class FollowedFamily(OrbitSet):
    """A family of periodic orbits, its requested members, and their continuation in parameters.

    Where parameters change, the members are those that arrived, at the end of their way.
    """

    curve: PeriodicOrbits
    """Orbits along the family, of the plant as it is."""
    member_indices: Annotated[Array, Shape(2, "members")]
    """Stability indices: planar and vertical of planar orbits, the larger and the smaller of those
    in space; NaN where they are complex."""
    curve_indices: Annotated[Array, Shape(2, "curve")]
    """The same along the curve."""
    member_amplitude_m: Annotated[Array, Shape("members")]
    """As the family measures it."""
    curve_amplitude_m: Annotated[Array, Shape("curve")]
    """The same along the curve."""
    member_clearance: Annotated[Array, Shape("members")]
    """Least value of the plant's impact function along the orbit, negative inside the body as the
    plant declares it; NaN without a surface."""
    asked: Annotated[tuple[str, ...], Shape("asked"), Label("orbit")]
    """Names of the requested orbits."""
    status: Annotated[tuple[str, ...], Shape("asked"), Label("status")]
    """``"reached"``, or why it is not among the members."""
    held: tuple[str, ...]
    """Quantity held as the parameters changed, per requested orbit; empty if none changed."""
    held_value: Array
    """That value, natural units."""
    parameters: Annotated[tuple[str, ...], Shape("parameters"), Label("parameter")]
    """Names of the parameters that change."""
    parameter_start: Annotated[Array, Shape("parameters"), Label("from (SI)", 12)]
    """Their first values, SI."""
    parameter_end: Annotated[Array, Shape("parameters"), Label("to (SI)", 12)]
    """Their last values, SI."""
    way_orbit: Annotated[Integers, Shape("way")]
    """Number of the requested orbit to which each step of the continuation belongs."""
    way_fraction: Annotated[Array, Shape("way")]
    """Part of the change of the parameters there."""
    way_x0: Annotated[Array, Shape("states", "way")]
    """State at the start, SI."""
    way_period_s: Annotated[Array, Shape("way")]
    """Period."""
    way_integral: Annotated[Array, Shape("way")]
    """Integral of motion, natural units."""
    tracks_m: Annotated[Array, Shape(3, "points", "members")]
    """Positions of the members along one period."""
    method: str
    """How orbits were found."""
    check: str
    """How closure was measured."""
    ends: tuple[str, str]
    """Why the curve begins and stops where it does."""
    body: str
    """Name of the body; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""
