"""The Gaussian copula: correlation between quantities of any distribution."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["copula_covariance", "correlated_factor", "covariance_factor"]

_TERMS = 64
"""Terms of Mehler's series. The rest falls at least as fast as ρ^64, which is 1e-10 at |ρ| = 0.7;
the Hermite coefficients of smooth functions fall as well."""
_GRID = np.linspace(-10.0, 10.0, 2001)
"""Points of the quadrature, in standard deviations: beyond ±10 the normal density is below 1e-21,
and at a spacing of 0.01 the trapezoidal rule is exact to rounding for smooth functions."""


def correlated_factor(correlation: Array) -> Array:
    """Return a lower triangular L with L Lᵀ = the correlation matrix.

    Parameters
    ----------
    correlation : ndarray, shape (k, k)
        Symmetric with unit diagonal; it may be singular.

    Returns
    -------
    ndarray, shape (k, k)
        L z has this correlation if the rows of z are independent standard normal numbers.

    Raises
    ------
    InputError
        If the matrix has a negative eigenvalue, so that it is not a correlation matrix.
    """
    values, vectors = np.linalg.eigh(correlation)
    if values[0] < -1e-9 * len(values):
        raise InputError(
            f"correlation: the matrix has the eigenvalue {values[0]:.3g}, but a correlation matrix "
            "has none below zero; reduce the largest entries"
        )
    # A triangular factor also of a singular matrix, where Cholesky's method fails: with A = B Bᵀ
    # and Bᵀ = Q R the factor is L = Rᵀ.
    _, upper = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)
    lower = upper.T * np.where(np.diagonal(upper) < 0.0, -1.0, 1.0)
    return np.asarray(lower / np.linalg.norm(lower, axis=1)[:, None])


def covariance_factor(covariance: Array) -> Array:
    """Return a lower triangular L with L Lᵀ = a covariance, which may be singular.

    Parameters
    ----------
    covariance : ndarray, shape (k, k)
        Symmetric, with variances above zero.

    Returns
    -------
    ndarray, shape (k, k)
        The factor, in the units of the states.

    Raises
    ------
    InputError
        If the matrix is no covariance: a variance is not positive, or an eigenvalue of the
        correlation is negative.
    """
    variance = np.diag(covariance)
    if not (np.isfinite(covariance).all() and (variance > 0.0).all()):
        raise InputError(
            f"covariance: expected finite numbers with variances above zero, got {variance.min():g}"
        )
    sigma = np.sqrt(variance)
    correlation = covariance / np.outer(sigma, sigma)
    return np.asarray(sigma[:, None] * correlated_factor(0.5 * (correlation + correlation.T)))


def copula_covariance(at: Callable[[Array], Array], correlation: Array) -> Array:
    """Return the covariance of quantities that are functions of correlated normal numbers.

    Parameters
    ----------
    at : callable
        z (k, n) → values (k, n), each row a function of the same row of z alone.
    correlation : ndarray, shape (k, k)
        Correlation of the normal numbers.

    Returns
    -------
    ndarray, shape (k, k)
        Σ a_i a_j ρ_ij^m over m = 1 … 64, a the coefficients of each function in normalised Hermite
        polynomials (Mehler's formula). Off the diagonal it is exact to about ten digits for
        functions as smooth as the quantiles of a truncated normal or a uniform distribution, less
        at a kink and for correlations near ±1; take the diagonal from closed forms.
    """
    z = np.broadcast_to(_GRID, (len(correlation), len(_GRID)))
    # Values times the weights of the quadrature, φ(z) dz. Without the mean, rounding is smaller.
    weighted = at(np.ascontiguousarray(z))
    weighted = (weighted - weighted.mean(axis=1, keepdims=True)) * np.exp(-0.5 * _GRID**2)
    weighted *= (_GRID[1] - _GRID[0]) / sqrt(2.0 * pi)
    before, now = np.zeros_like(_GRID), np.ones_like(_GRID)
    total, power = np.zeros_like(correlation), np.ones_like(correlation)
    for m in range(1, _TERMS + 1):
        # Recurrence of the normalised Hermite polynomials: h_m = (z h_{m−1} − √(m−1) h_{m−2})/√m.
        before, now = now, (_GRID * now - sqrt(m - 1) * before) / sqrt(m)
        power = power * correlation
        coefficient = weighted @ now
        total += np.outer(coefficient, coefficient) * power
    return total
