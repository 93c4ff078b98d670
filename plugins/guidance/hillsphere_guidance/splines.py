"""Clamped B-splines on an interval, and Gauss nodes between their knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from hillsphere.interfaces import Array

__all__ = ["ClampedSpline", "gauss_nodes"]


@dataclass(frozen=True)
class ClampedSpline:
    """A basis of B-splines that end in their first and last control points [1]_.

    Parameters
    ----------
    duration : float
        Length of the interval, which begins at zero.
    control_points : int
        Number n of control points, more than the degree; the knots are uniform.
    degree : int
        Degree of the polynomials.

    References
    ----------
    .. [1] C. de Boor (1978), A Practical Guide to Splines, Springer, chapters IX-X.
    """

    duration: float
    control_points: int
    degree: int = 5

    @property
    def breaks(self) -> Array:
        """Ends of the polynomial pieces, from 0 to the duration."""
        return np.linspace(0.0, self.duration, self.control_points - self.degree + 1)

    @property
    def reach(self) -> float:
        """Distance between the two outer control points of an end, per unit of slope there."""
        return self.duration / (self.control_points - self.degree) / self.degree

    def basis(self, t: Array, derivative: int = 0) -> Array:
        """Return the basis functions or their derivative, shape (K, n), at times t (K,)."""
        breaks = self.breaks
        ends = np.full(self.degree, breaks[0]), np.full(self.degree, breaks[-1])
        knots = np.concatenate([ends[0], breaks, ends[1]])
        spline = BSpline(knots, np.eye(self.control_points), self.degree)
        within = np.clip(t, 0.0, self.duration)
        return np.asarray(spline(within, nu=derivative))


def gauss_nodes(breaks: Array, count: int) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss-Legendre quadrature, piece by piece.

    Parameters
    ----------
    breaks : ndarray, shape (P + 1,)
        Ends of the P pieces.
    count : int
        Nodes in each.

    Returns
    -------
    t, weights : ndarray, shape (P · count,)
        Rising; the weights are those of the integral over all pieces.
    """
    place, weight = np.polynomial.legendre.leggauss(count)
    half = 0.5 * np.diff(breaks)[:, None]
    middle = 0.5 * (breaks[1:] + breaks[:-1])[:, None]
    return (middle + half * place).ravel(), (half * weight).ravel()
