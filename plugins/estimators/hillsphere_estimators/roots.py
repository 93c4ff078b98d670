"""Triangular roots of many small covariances at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["lower_root", "upper_triangle"]


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
    n = rows.shape[2]
    # LAPACK's own result, transposed: the triangle, and what the reflections are made of
    raw, _ = np.linalg.qr(rows, mode="raw")
    lower = raw[:, :, :n] * _triangle(n)
    lower *= np.where(np.diagonal(lower, axis1=1, axis2=2) < 0.0, -1.0, 1.0)[:, None]
    return np.asarray(lower)


@lru_cache(maxsize=64)
def _triangle(n: int) -> Array:
    return np.tri(n)
