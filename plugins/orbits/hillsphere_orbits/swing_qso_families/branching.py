"""Branches of orbits of n revolutions from their parent, for every symmetry.

At the bifurcating orbit the equations of n revolutions, F(z) = 0 in the unknowns of a shooting
problem, have besides the tangent t of the parent family further null vectors: the kernel of the
n-revolution map. It is one direction where a mirror is kept (perpendicular crossings of the x axis,
of the y axis, orbits that leave the plane) and two where none is. Members of the new family are

    z = z_b + ε b + O(ε²),   b = α t + κ,   κ in the kernel with zero period component,

where α follows from the algebraic bifurcation equation: with the left null vectors W of dF/dz and
Q(u, v) = W·(d²F/dz² u) v, it is 2 α Q(t, κ) + Q(κ, κ) = 0. For n ≥ 4 that gives α = 0 (the period
is stationary); for n = 3 the branches cross the parent at an angle.

References
----------
.. [1] Keller, H. B., Numerical solution of bifurcation and nonlinear eigenvalue problems, in
   Applications of Bifurcation Theory, Academic Press, 1977, p. 359 (the algebraic bifurcation
   equation).
.. [2] Meyer, K. R., Generic bifurcation of periodic points, Trans. Amer. Math. Soc. 149, 1970,
   p. 95 (n = 3, n = 4 and n ≥ 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.correction import Problem, correct, on_planes

__all__ = ["BranchPoint", "branch_point", "first_members"]

_NULL = 1e-6  # of the largest singular value: smaller ones count as zero
_STEP = 1e-4  # of the differences that give Q: dF/dz is good to 1e-11
_DISTANCES = (0.06, 0.03, 0.015, 0.0075, 0.004)
"""Distances ε from the branch point at which first members are sought, the largest first: farther
out the branches differ more clearly. Too far out Newton's method reaches other orbits, so that
nearer ones follow, halved each time."""
_CLOSE = 2.0  # distance from z_b, in ε, beyond which Newton has gone elsewhere
_APART = 0.03  # from the parent, in ε, below which it has gone back to it
_TOLERANCE = 1e-10
"""Newton's tolerance for first members: far below 1e-4, their least distance from the parent."""


@dataclass(frozen=True)
class BranchPoint:
    """A member of a family at which others branch off.

    Parameters
    ----------
    z : ndarray, shape (m,)
        The member, in the unknowns of the n-revolution problem.
    tangent : ndarray, shape (m,)
        Unit tangent of the parent family there.
    kernel : ndarray, shape (m, r)
        Orthonormal null vectors of zero period component; r may be 0.
    directions : ndarray, shape (m, K)
        Unit directions b in which branches are sought: ± for r = 1, around the circle for r = 2.
    """

    z: Array
    tangent: Array
    kernel: Array
    directions: Array


def branch_point(
    problem: Problem, z: Array, tangent: Array, *, around: int = 24, null: float = _NULL
) -> BranchPoint:
    """Analyse a member of a family of which others branch off.

    Parameters
    ----------
    problem : Problem
        The n-revolution problem; its last unknown is a time.
    z : ndarray, shape (m,)
        Member at the bifurcation, to rounding.
    tangent : ndarray, shape (m,)
        Tangent of the parent family in the same unknowns.
    around : int
        Directions on the circle of a kernel of two.
    null : float
        Singular values below this part of the largest one are null.

    Returns
    -------
    BranchPoint
        With an empty kernel if nothing branches off in these unknowns.

    Raises
    ------
    PropagationError
        If the orbit is outside the domain of the equations.
    """
    tangent = tangent / np.linalg.norm(tangent)
    _, slopes = problem.residual(z[:, None])
    # null vectors of F' (kernel) and of its transpose (cokernel)
    left, size, right = np.linalg.svd(slopes[:, :, 0])
    rank = int(np.count_nonzero(size > null * size[0]))
    cokernel = left[:, rank:]
    kernel = _without_period(right[rank:].T, tangent)
    if not kernel.shape[1]:
        return BranchPoint(z, tangent, kernel, kernel)
    if kernel.shape[1] == 1:
        kappa = np.concatenate([kernel, -kernel], axis=1)
    else:
        angle = 2.0 * np.pi * np.arange(around) / around
        kappa = kernel[:, :2] @ np.array([np.cos(angle), np.sin(angle)])
    ways = np.concatenate([tangent[:, None], kernel], axis=1)
    both = np.concatenate([z[:, None] + _STEP * ways, z[:, None] - _STEP * ways], axis=1)
    _, around_z = problem.residual(both)
    # second derivatives Q of F along the tangent and the kernel, by central differences
    second = (around_z[:, :, : ways.shape[1]] - around_z[:, :, ways.shape[1] :]) / (2.0 * _STEP)
    # bifurcation equation, projected on the cokernel: 2α Q(t, κ) + Q(κ, κ) = 0
    along_t = cokernel.T @ second[:, :, 0] @ kappa
    weights = kernel.T @ kappa
    along_k = np.einsum("ck,cmr,mj,rj->kj", cokernel, second[:, :, 1:], kappa, weights)
    # more equations than unknowns (an integral makes one redundant): least squares
    alpha = -0.5 * np.sum(along_t * along_k, axis=0) / np.sum(along_t**2, axis=0)
    directions = alpha * tangent[:, None] + kappa
    return BranchPoint(z, tangent, kernel, directions / np.linalg.norm(directions, axis=0))


def _without_period(null: Array, tangent: Array) -> Array:
    """Return an orthonormal basis of the null vectors whose last component is zero.

    Where the period of the parent is stationary all null vectors have none, and the tangent is
    taken out instead.
    """
    out = null[-1] if abs(tangent[-1]) > 1e-6 else tangent @ null
    if null.shape[1] < 2 or not np.linalg.norm(out):
        return null[:, :0]
    mixed = np.linalg.svd(out[None])[2][1:].T
    return np.asarray(null @ mixed)


def first_members(
    problem: Problem, point: BranchPoint, apart: Callable[[Array], Array]
) -> tuple[Array, NDArray[np.bool_]]:
    """Find a first member in every direction of a branch point.

    The nearer to the bifurcation, the less the branches can be told apart; the farther, the less
    the direction holds. The largest distance ε is taken from which Newton, held at ε along b,
    neither falls back to the parent nor wanders off.

    Parameters
    ----------
    problem : Problem
        The n-revolution problem.
    point : BranchPoint
        From `branch_point`.
    apart : callable
        z (m, N) → (N,), how far members are from the parent family; zero on it.

    Returns
    -------
    z : ndarray, shape (m, K)
        One member per direction.
    exists : ndarray of bool, shape (K,)
        Whether there is one; columns without are NaN.
    """
    count = point.directions.shape[1]
    z = np.full((point.z.size, count), np.nan)
    exists = np.zeros(count, dtype=bool)
    for distance in _DISTANCES:
        left = np.flatnonzero(~exists)
        if not left.size:
            break
        b = point.directions[:, left]
        guess = point.z[:, None] + distance * b
        try:
            tried = correct(problem, guess, on_planes(b, guess), tolerance=_TOLERANCE)
        except PropagationError:
            continue  # so far off an orbit meets a singularity: nearer
        near = np.linalg.norm(tried.z - point.z[:, None], axis=0) < _CLOSE * distance
        good = tried.converged & near
        good[good] &= apart(tried.z[:, good]) > _APART * distance
        z[:, left[good]] = tried.z[:, good]
        exists[left[good]] = True
    return z, exists
