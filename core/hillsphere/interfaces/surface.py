"""Surface of a body: an implicit function, its normals and its extent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Vec3

__all__ = ["ArraySurface", "Enclosed", "SlopedSurface", "Surface"]


@runtime_checkable
class SlopedSurface(Contract, Protocol):
    """A surface whose function is Lipschitz continuous: contact with it can be proved."""

    @property
    def steepest_per_m(self) -> float:
        """Lipschitz constant of the surface function, 1/m, everywhere off the centre."""
        ...


@runtime_checkable
class Surface(Contract, Protocol):
    """A body with a surface: positive outside, zero on it, negative inside."""

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
        """Return the unit outward normals (3, N) where the rays from the centre through r pass."""
        ...

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return half the extent along x, y, z, m, of a box about the centre that holds all."""
        ...


@runtime_checkable
class Enclosed(Contract, Protocol):
    """A surface of which is known how far from the centre it reaches, in whatever direction."""

    @property
    def largest_radius_m(self) -> float:
        """Radius of the smallest sphere about the centre that holds the body, m."""
        ...
