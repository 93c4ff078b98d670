"""Problems and families of periodic orbits."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.plant import Plant

__all__ = ["OrbitFamily", "OrbitProblem"]


class OrbitProblem(Protocol):
    """Equations whose solutions are the periodic orbits of one family.

    m unknowns z satisfy F(z) = 0, where F has rank m − 1: a curve of orbits, which continuation
    follows on any plant.
    """

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the m unknowns, in order; scaled to be of order one."""
        ...

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return F (k, N) and dF/dz (k, m, N) at z (m, N); k ≥ m − 1, of rank m − 1 if F = 0."""
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
        """The equations that a member solves, and in words why these."""
        ...
