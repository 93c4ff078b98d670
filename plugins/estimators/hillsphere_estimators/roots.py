"""Triangular roots of many small covariance matrices at once, by Householder's QR decomposition.

A covariance P = Aᵀ A is given by the rows of A. With A = Q U the root is S = Uᵀ, and P is never
formed: its small eigenvalues keep their relative accuracy, which squaring would halve.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = [
    "RANK",
    "find_singular",
    "fix_signs",
    "lower_root",
    "solve_root",
    "sort_roots",
    "triangularise",
    "unit",
    "upper_triangle",
]

RANK = 1e-14
"""Diagonal element of a root over the standard deviation of its state below which the state is a
function of those before it. Rounding leaves some 1e-16 times the number of states of a zero, which
must not be taken for variance; a state that is independent to a larger part must not be dropped."""
_ROUNDED = 1e7
"""Size of the linear rows of an innovation, in units of the noise, above which roots are sorted.
The rows are rounded to 1e-16 of it, so that below the noise is kept to at least nine digits."""


def upper_triangle(rows: Array) -> Array:
    """Return the upper triangular U with Uᵀ U = Aᵀ A and a diagonal that is not negative.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A; k may be less than n.

    Returns
    -------
    ndarray, shape (N, n, n)
        U.
    """
    return np.swapaxes(lower_root(rows), 1, 2)


def lower_root(rows: Array) -> Array:
    """Return the lower triangular S with S Sᵀ = Aᵀ A and a diagonal that is not negative.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A; k may be less than n.

    Returns
    -------
    ndarray, shape (N, n, n)
        S, contiguous; the Cholesky factor if Aᵀ A is positive definite.
    """
    # with fewer rows than columns the root is singular: rows of zeros complete it
    missing = rows.shape[2] - rows.shape[1]
    if missing > 0:
        rows = np.concatenate([rows, np.zeros((len(rows), missing, rows.shape[2]))], axis=1)
    return fix_signs(triangularise(rows)[:, :, : rows.shape[2]])


def find_singular(root: Array) -> NDArray[np.bool_]:
    """Return which covariances are singular: a state has no variance, or none given the others.

    Parameters
    ----------
    root : ndarray, shape (N, n, n)
        Lower triangular roots.

    Returns
    -------
    ndarray of bool, shape (N,)
        False for roots that are not finite.
    """
    variance = np.einsum("nij,nij->ni", root, root)
    diagonal = root.diagonal(axis1=1, axis2=2)
    small = (diagonal * diagonal <= RANK**2 * variance).any(axis=1)
    # the common case, in few calls: this is asked in every iteration of an update
    return small if not small.any() else np.asarray(small & np.isfinite(variance).all(axis=1))


def solve_root(root: Array, b: Array, *, transposed: bool = False) -> Array:
    """Solve S x = b, or Sᵀ x = b, with the least x where S is singular.

    Parameters
    ----------
    root : ndarray, shape (N, n, n)
        Lower triangular S.
    b : ndarray, shape (N, n, k)
        Right-hand sides. What is not in the range of a singular S is left out.
    transposed : bool
        Whether to solve with Sᵀ.

    Returns
    -------
    ndarray, shape (N, n, k)
        x.
    """
    singular = find_singular(root)
    matrix = np.swapaxes(root, 1, 2) if transposed else root
    if not singular.any():
        return np.asarray(np.linalg.solve(matrix, b))
    x = np.linalg.solve(np.where(singular[:, None, None], unit(root.shape[1]), matrix), b)
    own, right = root[singular], b[singular]
    # S = D Ŝ with rows Ŝ of length 1: the rank must not depend on units
    size = np.linalg.norm(own, axis=2)[:, :, None]
    size = np.where(size > 0.0, size, 1.0)
    inverse = np.linalg.pinv(own / size, rcond=RANK)
    if transposed:
        x[singular] = np.swapaxes(inverse, 1, 2) @ right / size
    else:
        x[singular] = inverse @ (right / size)
    return np.asarray(x)


def sort_roots(root: Array, linear: Array) -> Array | None:
    """Return roots whose columns belong to the states in the order of their uncertainty.

    The lower triangular root of a state of little uncertainty that is correlated with one of great
    uncertainty, say of 1 and 1e12, has a column with both. The measurement rows Sᵀ Hᵀ then add
    numbers of these sizes and lose the digits of the smaller one. With the most uncertain state
    first, the other's own column holds its own size only [1]_.

    Parameters
    ----------
    root : ndarray, shape (N, n, n)
        Lower triangular S.
    linear : ndarray, shape (N, n, m)
        Rows Sᵀ Hᵀ in units of the noise.

    Returns
    -------
    ndarray, shape (N, n, n), or None
        S' with S' S'ᵀ = S Sᵀ, not triangular where rows are so large that rounding matters, and S
        elsewhere; None if they nowhere are.

    References
    ----------
    .. [1] Cox, Higham (1998), Stability of Householder QR factorization for weighted least squares
       problems, Numerical Analysis 1997, Longman.
    """
    large = np.abs(linear).max(axis=(1, 2), initial=0.0) > _ROUNDED
    if not large.any():
        return None
    own = root[large]
    order = np.argsort(-np.linalg.norm(own, axis=2), axis=1, kind="stable")
    # Sᵀ with its columns, the states, in that order; the new root's rows then go back
    turned = lower_root(np.take_along_axis(np.swapaxes(own, 1, 2), order[:, None], axis=2))
    back = np.argsort(order, axis=1)
    sorted_root = root.copy()
    sorted_root[large] = np.take_along_axis(turned, back[:, :, None], axis=1)
    return sorted_root


def triangularise(rows: Array) -> Array:
    """Triangularise rows by LAPACK and return its raw result.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A.

    Returns
    -------
    ndarray, shape (N, n, k)
        S = Uᵀ on and below the diagonal of the first columns, each column with either sign. The
        elements above the diagonal are those of the reflections and must be cleared, see
        `fix_signs`.
    """
    return np.asarray(np.linalg.qr(rows, mode="raw")[0])


def fix_signs(raw: Array) -> Array:
    """Return the triangle of a raw result with a diagonal that is not negative.

    Parameters
    ----------
    raw : ndarray, shape (N, n, n)
        A square block on the diagonal of the result of `triangularise`.

    Returns
    -------
    ndarray, shape (N, n, n)
        Zero above its diagonal; contiguous.
    """
    lower = raw * _triangle(raw.shape[2])
    # a column of S may change its sign, S Sᵀ does not
    lower *= np.copysign(1.0, raw.diagonal(axis1=1, axis2=2))[:, None]
    return np.asarray(lower)


@lru_cache(maxsize=64)
def unit(n: int) -> Array:
    """Return the unit matrix (n, n), cached and read-only."""
    one = np.eye(n)
    one.flags.writeable = False
    return one


@lru_cache(maxsize=64)
def _triangle(n: int) -> Array:
    """Return ones on and below the diagonal (n, n), cached."""
    return np.tri(n)
