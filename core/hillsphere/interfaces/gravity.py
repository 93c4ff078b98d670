"""Gravity of one body: as expressions, or as functions of arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.quantities import Parameter

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Params, Vec3

__all__ = [
    "ArrayGravityModel",
    "BoundedGravity",
    "BoundedSeries",
    "GravityModel",
    "Piecewise",
    "SeriesGravity",
]


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
    """Gravity as a series, whose convergence is guaranteed only outside a sphere."""

    @property
    def series_radius_m(self) -> float | None:
        """Radius of that sphere about the centre, m; None if the model has no series."""
        ...


@runtime_checkable
class BoundedSeries(Contract, Protocol):
    """A series that stands for a gravity that can be evaluated exactly, from a distance on."""

    holds_from_m: float
    """Distance from the centre, m, from which the error is bounded."""

    def acceleration_error(self, r: Array) -> Array:
        """Return the relative error (N,) of the acceleration at r (3, N), m, by exact values."""
        ...


@runtime_checkable
class BoundedGravity(Contract, Protocol):
    """A gravity model, of expressions or arrays, with a bound of its acceleration.

    The proof of events needs the bound (`hillsphere.engine.dynamics.enclosures`) if the model
    differentiates a potential; for a `GravityModel` in plain arithmetic it is derived from the
    expressions.
    """

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², over all directions at a distance from the centre.

        The distance, m, and the values of `p` are intervals. Write the bound with the functions of
        `hillsphere.symbolic`.
        """
        ...


@runtime_checkable
class Piecewise(Contract, Protocol):
    """A `GravityModel` whose expressions change branch (`hillsphere.symbolic.select`)."""

    def switches(self, r: Vec3, p: Params) -> tuple[Expr, ...]:
        """Return switching functions of the body-fixed position r, m, zero where a branch changes.

        They are without dimension, of order one near the body, and have non-zero slope at their
        zeros. The position may be any expression: do not differentiate by it.
        """
        ...
