"""Triangular roots of many small covariance matrices at once, by Householder's QR decomposition.

A covariance P = Aᵀ A is given by the rows of A. With A = Q U the root is S = Uᵀ, and P is never
formed: its small eigenvalues keep their relative accuracy, which squaring would halve.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["fix_signs", "lower_root", "sort_roots", "triangularise", "unit", "upper_triangle"]

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
