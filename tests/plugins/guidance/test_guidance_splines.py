"""Clamped B-splines and Gauss quadrature between their knots."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere_guidance.splines import ClampedSpline, gauss_nodes


def test_basis_reproduces_quintics() -> None:
    spline = ClampedSpline(10.0, 9)
    t = np.linspace(0.0, 10.0, 40)
    polynomial = np.polynomial.Polynomial([3.0, -1.0, 0.5, 0.2, -0.03, 0.001])
    points = np.linalg.lstsq(spline.basis(t), polynomial(t), rcond=None)[0]
    for order in range(3):
        wanted = polynomial.deriv(order)(t) if order else polynomial(t)
        np.testing.assert_allclose(spline.basis(t, order) @ points, wanted, rtol=0, atol=1e-10)


def test_outer_points_are_the_ends() -> None:
    spline = ClampedSpline(10.0, 12)
    points = np.random.default_rng(1).normal(size=12)
    ends = np.array([0.0, 10.0])
    np.testing.assert_allclose(spline.basis(ends) @ points, points[[0, -1]], rtol=0, atol=1e-14)
    slopes = np.array([points[1] - points[0], points[-1] - points[-2]]) / spline.reach
    np.testing.assert_allclose(spline.basis(ends, 1) @ points, slopes, rtol=1e-12)


def test_quadrature_is_exact_for_polynomials() -> None:
    t, weights = gauss_nodes(np.array([0.0, 1.0, 4.0]), 4)
    assert (np.diff(t) > 0.0).all()
    assert weights @ t**7 == pytest.approx(4.0**8 / 8.0, rel=1e-13)
