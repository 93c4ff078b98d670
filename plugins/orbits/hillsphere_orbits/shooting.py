"""Periodic orbits as boundary-value problems, solved by single shooting.

Two problems for `hillsphere_orbits.continuation`, for any plant whose compiled flow gives the state
transition matrix. Both work in the units of the step map's system (normalised for continuation)
and carry independent orbits in the last axis.

References
----------
.. [1] Hénon, M., Generating Families in the Restricted Three-Body Problem, Springer, 1997
   (symmetric periodic orbits from two perpendicular crossings).
.. [2] Doedel, E. J., et al., Computation of periodic solutions of conservative systems with
   application to the 3-body problem, Int. J. Bifurcation and Chaos 13, 2003, p. 1353 (phase
   condition, the redundant equation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, OrbitProblem
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.stability import monodromy_of_half

__all__ = ["DoublySymmetricShooting", "PeriodicShooting", "Shooting", "SymmetricShooting"]


class Shooting(OrbitProblem, Protocol):
    """Interface of a shooting problem, beyond that of an orbit family's problem."""

    @property
    def flow(self) -> Flow:
        """The compiled flow."""
        ...

    @property
    def steps(self) -> int:
        """Sub-steps of the time of flight."""
        ...

    def unknowns_at(self, x: Array, period: Array) -> Array:
        """Return z for initial states (n, N) and full periods (N,); the inverse of both."""
        ...

    def monodromy(self, z: Array) -> Array:
        """Return the state transition matrices over one period (n, n, N)."""
        ...

    def with_steps(self, steps: int) -> Shooting:
        """Return the same problem with another number of sub-steps."""
        ...


@dataclass(frozen=True)
class SymmetricShooting:
    """Half a period between two perpendicular crossings of a mirror.

    If the equations are unchanged under t → −t, x → S x with S = diag(±1), an orbit that starts
    and ends half a period later in the fixed space of S is periodic. Unknowns are the states with
    sign +1 and the half-period; residuals the states with sign −1 at its end.

    Parameters
    ----------
    flow : Flow
        With the state transition matrix.
    mirror : tuple of int
        Diagonal of S.
    frozen : tuple of str
        States that stay zero because the orbits lie in an invariant space (``z`` and ``vz`` of a
        planar family).
    steps : int
        Sub-steps of the half-period.
    """

    flow: Flow
    mirror: tuple[int, ...]
    frozen: tuple[str, ...] = ()
    steps: int = 64

    def __post_init__(self) -> None:
        names = self.flow.names
        if len(self.mirror) != len(names) or set(self.mirror) - {1, -1}:
            raise InputError(f"a mirror has one sign per state {names}, got {self.mirror}")
        _check_names(self.frozen, names)
        if len(self._free) != len(self._zero) or not self._free:
            raise InputError(
                f"the mirror leaves {len(self._free)} unknown states for {len(self._zero)} "
                "conditions; symmetric shooting needs as many as there are conditions"
            )

    @property
    def _free(self) -> list[int]:
        return self._with_sign(1)

    @property
    def _zero(self) -> list[int]:
        return self._with_sign(-1)

    def _with_sign(self, sign: int) -> list[int]:
        pairs = enumerate(zip(self.flow.names, self.mirror, strict=True))
        return [i for i, (name, s) in pairs if s == sign and name not in self.frozen]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the free states, then ``half_period``."""
        return (*(self.flow.names[i] for i in self._free), "half_period")

    def state(self, z: Array) -> Array:
        """Return the initial states (n, N)."""
        x = np.zeros((len(self.flow.names), z.shape[1]))
        x[self._free] = z[:-1]
        return x

    def period(self, z: Array) -> Array:
        """Return the full periods (N,)."""
        return np.asarray(2.0 * z[-1])

    def unknowns_at(self, x: Array, period: Array) -> Array:
        """Return z for initial states (n, N) and full periods (N,)."""
        return np.concatenate([x[self._free], 0.5 * np.asarray(period)[None]])

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return the states with sign −1 at half the period, and their exact derivatives."""
        start = self.state(z)
        end, phi = self.flow.with_matrix(start, z[-1], self.steps)
        return self.conditions(start, end, phi, self.flow.rate(end))

    def conditions(self, start: Array, end: Array, phi: Array, rate: Array) -> tuple[Array, Array]:
        """Return F and dF/dz from the flow over z[-1]; derivatives by parameters follow dF/dz.

        `phi` is (n, n + k, N): by the initial states, then by k parameters.
        """
        rows = phi[self._zero]
        # dF/dz: columns of Φ for the free initial states, dx/dt at the end for the half period
        slopes = [rows[:, self._free], rate[self._zero, None], rows[:, len(end) :]]
        return end[self._zero], np.concatenate(slopes, axis=1)

    def monodromy(self, z: Array) -> Array:
        """Return M (n, n, N) = S M_h⁻¹ S M_h, from the half-period's matrix M_h."""
        _, half = self.flow.with_matrix(self.state(z), z[-1], self.steps)
        return monodromy_of_half(half, self.mirror)

    def with_steps(self, steps: int) -> SymmetricShooting:
        """Return the same problem with another number of sub-steps."""
        return replace(self, steps=steps)


@dataclass(frozen=True)
class DoublySymmetricShooting(SymmetricShooting):
    """A quarter of a period between perpendicular crossings of two mirrors.

    Unknowns are those of `SymmetricShooting` with the first mirror; residuals the states with sign
    −1 in the second one after half of the half-period. Orbits that keep one mirror only are no
    solutions, so that these equations are regular where such a family branches off.

    Parameters
    ----------
    second : tuple of int
        Diagonal of the mirror that is met after a quarter of a period.
    """

    second: tuple[int, ...] = ()

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return the states with sign −1 at a quarter of the period, and their derivatives."""
        zero = [
            i for i, (name, sign) in enumerate(zip(self.flow.names, self.second, strict=True))
            if sign == -1 and name not in self.frozen
        ]  # fmt: skip
        end, phi = self.flow.with_matrix(self.state(z), 0.5 * z[-1], (self.steps + 1) // 2)
        slopes = [phi[zero][:, self._free], 0.5 * self.flow.rate(end)[zero, None]]
        return end[zero], np.concatenate(slopes, axis=1)


@dataclass(frozen=True)
class PeriodicShooting:
    """A full period with a phase condition, for equations without a mirror.

    Unknowns are the states on a section (one state held at zero) and the period; residuals are
    the closure of every state. In a conservative system the integral makes one of these
    redundant, so the equations are solved by least squares.

    Parameters
    ----------
    flow : Flow
        With the state transition matrix.
    section : str
        State that is zero at the start.
    frozen : tuple of str
        States that stay zero because the orbits lie in an invariant space.
    steps : int
        Sub-steps of the period.
    """

    flow: Flow
    section: str
    frozen: tuple[str, ...] = ()
    steps: int = 128

    def __post_init__(self) -> None:
        _check_names((self.section, *self.frozen), self.flow.names)

    @property
    def _free(self) -> list[int]:
        held = {self.section, *self.frozen}
        return [i for i, name in enumerate(self.flow.names) if name not in held]

    @property
    def _closing(self) -> list[int]:
        return [i for i, name in enumerate(self.flow.names) if name not in self.frozen]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the states besides the section's, then ``period``."""
        return (*(self.flow.names[i] for i in self._free), "period")

    def state(self, z: Array) -> Array:
        """Return the initial states (n, N)."""
        x = np.zeros((len(self.flow.names), z.shape[1]))
        x[self._free] = z[:-1]
        return x

    def period(self, z: Array) -> Array:
        """Return the full periods (N,)."""
        return np.array(z[-1])

    def unknowns_at(self, x: Array, period: Array) -> Array:
        """Return z for initial states (n, N) and full periods (N,)."""
        return np.concatenate([x[self._free], np.asarray(period)[None]])

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return x(T) − x(0) and its exact derivatives."""
        start = self.state(z)
        end, phi = self.flow.with_matrix(start, z[-1], self.steps)
        return self.conditions(start, end, phi, self.flow.rate(end))

    def conditions(self, start: Array, end: Array, phi: Array, rate: Array) -> tuple[Array, Array]:
        """Return F and dF/dz from the flow over z[-1]; derivatives by parameters follow dF/dz.

        `phi` is (n, n + k, N): by the initial states, then by k parameters.
        """
        closing, free = self._closing, self._free
        # dF/dz of x(T) − x(0): Φ − I for the free initial states, dx/dt at the end for the period
        slopes = phi[np.ix_(closing, free)] - np.eye(len(start))[np.ix_(closing, free)][:, :, None]
        more = [slopes, rate[closing, None], phi[closing][:, len(end) :]]
        return (end - start)[closing], np.concatenate(more, axis=1)

    def monodromy(self, z: Array) -> Array:
        """Return M (n, n, N)."""
        return self.flow.with_matrix(self.state(z), z[-1], self.steps)[1]

    def with_steps(self, steps: int) -> PeriodicShooting:
        """Return the same problem with another number of sub-steps."""
        return replace(self, steps=steps)


def _check_names(wanted: Sequence[str], names: Sequence[str]) -> None:
    if unknown := [name for name in wanted if name not in names]:
        raise InputError(f"the plant has no state {unknown[0]!r}; it has {', '.join(names)}")
