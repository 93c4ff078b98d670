"""Problems and families of periodic orbits."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.plant import Plant

__all__ = ["OrbitFamily", "OrbitProblem"]


class OrbitProblem(Protocol):
    """Equations F(z) = 0 whose solutions are the periodic orbits of one family.

    dF/dz has rank m − 1 for m unknowns z, so that the solutions form a curve, which continuation
    follows.
    """

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the m unknowns, in order; their values are of order one."""
        ...

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return F (k, N) and dF/dz (k, m, N) at z (m, N), with k ≥ m − 1."""
        ...

    def state(self, z: Array) -> Array:
        """Return the initial states (n, N), normalised."""
        ...

    def period(self, z: Array) -> Array:
        """Return the full periods (N,), normalised."""
        ...


@runtime_checkable
class OrbitFamily(Contract, Protocol):
    """A one-parameter family of periodic orbits of a plant."""

    @property
    def plant(self) -> Plant:
        """Equations of motion."""
        ...

    @property
    def problem(self) -> tuple[OrbitProblem, str]:
        """The equations of a member, and a sentence that justifies them."""
        ...
