"""Triangular roots of many small covariance matrices at once, by Householder's QR decomposition.

A covariance P = Aᵀ A is given by the rows of A. With A = Q U the root is S = Uᵀ, and P is never
formed: its small eigenvalues keep their relative accuracy, which squaring would halve.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["fix_signs", "lower_root", "triangularise", "unit", "upper_triangle"]


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
