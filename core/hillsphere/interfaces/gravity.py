"""Gravity of one body: as expressions, or as functions of arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.quantities import Parameter

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Params, Vec3

__all__ = ["ArrayGravityModel", "BoundedGravity", "GravityModel", "Piecewise", "SeriesGravity"]


class GravityModel(Protocol):
    """Gravity of one body as expressions, exactly differentiable.

    The engine derives array evaluators and gradients from it (`hillsphere.gravity`).
    """

    @property
    def frame(self) -> str:
        """Body-fixed frame of positions, potential and acceleration."""
        ...

    @property
    def gm_m3_s2(self) -> float:
        """Nominal gravitational parameter of the whole, m³/s²."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the numbers that may be set at run time; `p` below holds one of each."""
        ...

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        ...

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s²."""
        ...


@runtime_checkable
class ArrayGravityModel(Contract, Protocol):
    """Gravity that cannot be written as an expression (a table, a polyhedron)."""

    @property
    def frame(self) -> str:
        """Body-fixed frame."""
        ...

    @property
    def gm_m3_s2(self) -> float:
        """Nominal gravitational parameter of the whole, m³/s²."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the numbers that may be set at run time, in the order of `p` below."""
        ...

    def potential_array(self, r: Array, p: Array) -> Array:
        """Return +U, m²/s², shape (N,), at r (3, N), m, with parameters p (k, N)."""
        ...

    def acceleration_array(self, r: Array, p: Array) -> Array:
        """Return ∇U, m/s², shape (3, N)."""
        ...


@runtime_checkable
class SeriesGravity(Contract, Protocol):
    """Gravity as a series that is sure to converge only outside a sphere about the centre."""

    @property
    def series_radius_m(self) -> float | None:
        """Radius of that sphere as far as the model knows it, m; None if there is no series."""
        ...


@runtime_checkable
class BoundedGravity(Contract, Protocol):
    """A gravity model, of expressions or arrays, that bounds the size of its acceleration.

    From it events are proved (`hillsphere.engine.dynamics.enclosures`). A `GravityModel` that is
    written in plain arithmetic needs none; one that differentiates a potential does.
    """

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², wherever the distance from the centre is as given.

        The distance, m, is an interval, as what `p` holds; written with the functions of
        `hillsphere.symbolic`.
        """
        ...


@runtime_checkable
class Piecewise(Contract, Protocol):
    """A `GravityModel` whose expressions change branch (`hillsphere.symbolic.select`)."""

    def switches(self, r: Vec3, p: Params) -> tuple[Expr, ...]:
        """Return functions that vanish where the branch changes, at the body-fixed position r, m.

        Without dimension and of order one about the body, with a slope at their zeros. The
        position may be any expression: do not differentiate by it.
        """
        ...
