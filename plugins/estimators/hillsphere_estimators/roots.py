"""Triangular roots of many small covariances at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["fix_signs", "lower_root", "triangularise", "unit", "upper_triangle"]


def upper_triangle(rows: Array) -> Array:
    """Return the upper triangular U with Uᵀ U = Aᵀ A, its diagonal not negative.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A; k may be less than n.

    Returns
    -------
    ndarray, shape (N, n, n)
        By Householder's method: squares of A are never formed, so that U keeps what is small.
    """
    return np.swapaxes(lower_root(rows), 1, 2)


def lower_root(rows: Array) -> Array:
    """Return the lower triangular S with S Sᵀ = Aᵀ A, its diagonal not negative.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A.

    Returns
    -------
    ndarray, shape (N, n, n)
        That of Cholesky's method, if Aᵀ A is positive definite; contiguous.
    """
    missing = rows.shape[2] - rows.shape[1]
    if missing > 0:
        rows = np.concatenate([rows, np.zeros((len(rows), missing, rows.shape[2]))], axis=1)
    return fix_signs(triangularise(rows)[:, :, : rows.shape[2]])


def triangularise(rows: Array) -> Array:
    """Return the lower triangular S with S Sᵀ = Aᵀ A as LAPACK leaves it.

    Parameters
    ----------
    rows : ndarray, shape (N, k, n)
        A.

    Returns
    -------
    ndarray, shape (N, n, k)
        In its first columns and below their diagonal S, whose columns may have any sign; above it
        what the reflections are made of.
    """
    return np.asarray(np.linalg.qr(rows, mode="raw")[0])


def fix_signs(raw: Array) -> Array:
    """Return the triangle in a square block (N, n, n) of `triangularise` with its signs.

    Parameters
    ----------
    raw : ndarray, shape (N, n, n)
        On the diagonal.

    Returns
    -------
    ndarray, shape (N, n, n)
        Zero above its diagonal, which is not negative; contiguous.
    """
    lower = raw * _triangle(raw.shape[2])
    lower *= np.copysign(1.0, raw.diagonal(axis1=1, axis2=2))[:, None]
    return np.asarray(lower)


@lru_cache(maxsize=64)
def unit(n: int) -> Array:
    """Return the unit matrix (n, n); not to be written to."""
    found = np.eye(n)
    found.flags.writeable = False
    return found


@lru_cache(maxsize=64)
def _triangle(n: int) -> Array:
    return np.tri(n)
