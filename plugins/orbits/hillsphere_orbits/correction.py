"""Newton's correction of members of a one-parameter family, and their tangents.

A family is the curve on which m unknowns z satisfy F(z) = 0, where F has rank m − 1. What the
unknowns mean is the `Problem`'s affair: nothing here knows of orbits. Arrays carry independent
cases in their last axis, so that many members are corrected in lockstep.

References
----------
.. [1] Allgower, E. L., Georg, K., Introduction to Numerical Continuation Methods, SIAM, 2003,
   chapter 3 (Moore–Penrose correction).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array

__all__ = [
    "Constraint",
    "Correction",
    "Problem",
    "Watch",
    "correct",
    "fix_component",
    "on_planes",
    "tangents",
]

_ROUNDINGS = 4.0
"""Changes of every unknown by this many roundings explain a residual that Newton's iteration cannot
make smaller: the unknowns' own rounding, and that of the equations, of which processors with other
vector widths differ by two to three in orbits whose errors grow a thousandfold."""
_MOST_ROUNDING = 100.0
"""Largest residual that rounding excuses, in units of the tolerance: equations that magnify errors
more say too little of their solution. Libration orbits in use need two."""


class Problem(Protocol):
    """Equations whose solutions form a family."""

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the m unknowns, in order; scaled to be of order one."""
        ...

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return F (k, N) and dF/dz (k, m, N) at z (m, N); k ≥ m − 1, of rank m − 1 if F = 0."""
        ...


Flags: TypeAlias = NDArray[np.bool_]
Constraint: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Further equations that single a member out: z (m, N) → G (r, N), dG/dz (r, m, N)."""

Watch: TypeAlias = Callable[[Array], None]
"""Called with unknowns (m, N) as they are found, to show progress; it may raise to stop."""


@dataclass(frozen=True)
class Correction:
    """Outcome of Newton's iteration.

    Parameters
    ----------
    z : ndarray, shape (m, N)
        Best iterate of each lane.
    error : ndarray, shape (N,)
        Largest residual of that iterate.
    converged : ndarray of bool, shape (N,)
        Whether it is within the tolerance.
    iterations : int
        Newton steps until every lane was within the tolerance (or all that were allowed).
    """

    z: Array
    error: Array
    converged: Flags
    iterations: int

    def require_converged(self, what: str, names: Sequence[str] | None = None) -> Array:
        """Return `z`, or raise `ConvergenceError` naming the lanes that failed."""
        failed = np.flatnonzero(~self.converged)
        if failed.size:
            shown = [names[i] if names else str(i) for i in failed[:5]]
            more = "" if failed.size <= 5 else f" and {failed.size - 5} more"
            raise ConvergenceError(
                f"{what}: Newton's iteration did not converge for {', '.join(shown)}{more} "
                f"(residual {self.error[failed].max():.1e})"
            )
        return self.z


def correct(
    problem: Problem,
    z: Array,
    constraint: Constraint | None = None,
    *,
    tolerance: float = 1e-12,
    iterations: int = 12,
    watch: Watch | None = None,
) -> Correction:
    """Solve F = 0 and the constraint from a guess, all lanes in lockstep.

    Once every lane is within the tolerance one more step is taken, since Newton's last step costs
    little and gains half the digits; the better iterate of each lane is kept. More equations than
    unknowns (an integral of motion makes one redundant) are solved by least squares; without a
    constraint the step is the shortest one (Moore–Penrose).

    Parameters
    ----------
    problem : Problem
        The equations.
    z : ndarray, shape (m, N)
        Guesses.
    constraint : callable, optional
        Further equations, see `Constraint`.
    tolerance : float
        Largest residual of a solution, relative to the largest unknown where that is above one. A
        residual that rounding of the unknowns explains in its own equation (`_ROUNDINGS`), up to
        100 times the tolerance, is one of a solution too.
    iterations : int
        Newton steps allowed.
    watch : callable, optional
        Called with each iterate.

    Returns
    -------
    Correction
        Lanes that failed are flagged, not raised.

    Raises
    ------
    PropagationError
        If a lane leaves the domain of the equations.
    """
    z = np.array(z, dtype=float)
    best, error = z.copy(), np.full(z.shape[1], np.inf)
    solved = np.zeros(z.shape[1], dtype=bool)
    used, polishing = iterations, False
    for count in range(iterations + 1):
        if watch is not None:
            watch(z)
        values, slopes = problem.residual(z)
        if constraint is not None:
            more, more_slopes = constraint(z)
            values = np.concatenate([values, more])
            slopes = np.concatenate([slopes, more_slopes])
        # lanes share the iterations, so that each keeps its best iterate
        size = np.max(np.abs(values), axis=0)
        better = size < error
        best[:, better], error[better] = z[:, better], size[better]
        solved[better] = _are_solved(values, slopes, z, tolerance)[better]
        if polishing:
            break
        if solved.all():
            # quadratic convergence: one more step goes from the tolerance to rounding
            used, polishing = count, True
        elif count == iterations:
            break
        z = z - _least_squares(slopes, values)
    return Correction(best, error, solved, used)


def _are_solved(values: Array, slopes: Array, z: Array, tolerance: float) -> Flags:
    """Say in which lanes (N,) every residual is within the tolerance or its own rounding."""
    within = tolerance * np.maximum(1.0, np.max(np.abs(z), axis=0))
    # Row by row: that one equation is steep excuses no other.
    rounding = _ROUNDINGS * np.finfo(float).eps * np.sum(np.abs(slopes) * np.abs(z), axis=1)
    excused = np.fmin(np.where(np.isfinite(rounding), rounding, 0.0), _MOST_ROUNDING * within)
    return np.asarray((np.abs(values) <= np.maximum(within, excused)).all(axis=0))


def _least_squares(slopes: Array, values: Array) -> Array:
    """Solve the (k, m, N) systems; returns (m, N)."""
    matrix, rhs = np.moveaxis(slopes, 2, 0), values.T[:, :, None]
    if matrix.shape[1] == matrix.shape[2]:
        try:
            return np.asarray(np.linalg.solve(matrix, rhs)[:, :, 0].T)
        except np.linalg.LinAlgError:
            pass  # one lane is singular: the pseudo-inverse below still gives a finite step
    # least squares for redundant equations, the shortest step for missing ones
    return np.asarray((np.linalg.pinv(matrix) @ rhs)[:, :, 0].T)


def fix_component(index: int, values: Array | float) -> Constraint:
    """Return the constraint z[index] = values (one value per lane, or one for all)."""

    def constraint(z: Array) -> tuple[Array, Array]:
        slopes = np.zeros((1, *z.shape))
        slopes[0, index] = 1.0
        return (z[index] - values)[None], slopes

    return constraint


def on_planes(normals: Array, points: Array) -> Constraint:
    """Return the constraint normal·(z − point) = 0, one plane per lane."""

    def constraint(z: Array) -> tuple[Array, Array]:
        return np.sum(normals * (z - points), axis=0)[None], normals[None]

    return constraint


def tangents(problem: Problem, z: Array, along: Array | None = None) -> Array:
    """Return unit tangents of the family: null vectors of dF/dz, by singular value decomposition.

    Parameters
    ----------
    problem : Problem
        The equations.
    z : ndarray, shape (m, N)
        Members.
    along : ndarray, shape (m,) or (m, N), optional
        Directions with which the tangents shall agree in sense.

    Returns
    -------
    ndarray, shape (m, N)
        Unit vectors.
    """
    _, slopes = problem.residual(z)
    vectors = np.linalg.svd(np.moveaxis(slopes, 2, 0))[2][:, -1, :].T
    if along is not None:
        sense = np.sum(vectors * np.reshape(along, (z.shape[0], -1)), axis=0)
        vectors = np.where(sense < 0.0, -vectors, vectors)
    return np.ascontiguousarray(vectors)
