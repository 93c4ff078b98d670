"""Surface of a body: an implicit function, its normals and its extent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Vec3

__all__ = ["ArraySurface", "Described", "Enclosed", "SlopedSurface", "Surface"]


@runtime_checkable
class Described(Contract, Protocol):
    """A shape or gravity model that tells by what a wrong file or unit is noticed."""

    def describe(self) -> tuple[str, ...]:
        """Return sentences for the report, such as extent, volume and density."""
        ...


@runtime_checkable
class SlopedSurface(Contract, Protocol):
    """A surface with a Lipschitz continuous function, by which contact can be proved."""

    @property
    def steepest_per_m(self) -> float:
        """Lipschitz constant of the surface function outside the centre, 1/m."""
        ...


@runtime_checkable
class Surface(Contract, Protocol):
    """A surface as an implicit function: positive outside, zero on it, negative inside."""

    def surface(self, r: Vec3) -> Expr:
        """Return the implicit surface function at the body-fixed position r, m."""
        ...

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the semi-axes of the (bounding) ellipsoid along x, y, z, m."""
        ...


@runtime_checkable
class ArraySurface(Contract, Protocol):
    """A `Surface` that cannot be written as an expression (a polyhedron, a grid of radii)."""

    def surface_array(self, r: Array) -> Array:
        """Return the implicit surface function (N,) at body-fixed positions r (3, N), m.

        Without dimension, of order one about the body and continuous.
        """
        ...

    def normal_array(self, r: Array) -> Array:
        """Return the unit outward normals (3, N) where the rays from the centre to r exit."""
        ...

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the half-lengths along x, y, z, m, of a box about the centre around the body."""
        ...


@runtime_checkable
class Enclosed(Contract, Protocol):
    """A surface with a known bounding sphere about the centre."""

    @property
    def largest_radius_m(self) -> float:
        """Radius of the smallest sphere about the centre that holds the body, m."""
        ...
