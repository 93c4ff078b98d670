"""A shape whose radius is a series of spherical harmonics."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.formats.coefficients import Coefficient
from hillsphere.formats.shape_harmonics import read_shape_harmonics
from hillsphere.model.shapes.specs import METRES, HarmonicShapeSpec
from hillsphere.model.shapes.sphere import unit_vectors
from hillsphere.symbolic.expressions import (
    Expr,
    Vec3,
    gradient,
    norm,
    spherical_harmonics_potential,
    variables,
)

__all__ = ["HarmonicShape"]

_PLAIN = variables("shape:x", "shape:y", "shape:z")


class HarmonicShape:
    """The radius R = Σ P̄nm(sin φ) (C̄nm cos mλ + S̄nm sin mλ), m.

    φ and λ are planetocentric latitude and east longitude; P̄nm is 4π-normalised, without the
    Condon–Shortley phase.

    Parameters
    ----------
    spec : HarmonicShapeSpec
        Its coefficients.

    Raises
    ------
    InputError
        If the file or a row is malformed, or the radius is not positive everywhere.
    """

    def __init__(self, spec: HarmonicShapeSpec) -> None:
        rows = read_shape_harmonics(spec.file) if spec.file is not None else _rows(spec)
        known = max(row.n for row in rows)
        if spec.max_degree is not None and spec.max_degree > known:
            table = "the table" if spec.file is None else spec.file
            raise InputError(f"max_degree must be ≤ {known}, that of {table}")
        self.degree = known if spec.max_degree is None else spec.max_degree
        unit = METRES[spec.length_unit]
        self._pairs = {(row.n, row.m): (unit * row.c, unit * row.s) for row in rows}
        grid = unit_vectors(np.linspace(-90, 90, 181), np.linspace(0, 359, 360))
        radii = self.radius_array(grid)
        if not (np.isfinite(radii).all() and radii.min() > 0.0):
            where = "" if spec.file is None else f"{spec.file}: "
            raise InputError(
                f"{where}the radius of the series is not positive everywhere; check the rows"
            )
        self._least = float(radii.min())
        x, y, z = np.max(np.abs(grid * radii), axis=1).tolist()
        self._extent = (x, y, z)
        self._farthest = grid[:, int(np.argmax(radii))]

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the half-lengths of a box about the centre along x, y, z, m, from a 1° grid."""
        return self._extent

    @cached_property
    def largest_radius_m(self) -> float:
        """Largest radius, m."""
        optimum = minimize(
            lambda d: -self.radius_array(d[:, None])[0], self._farthest, method="Nelder-Mead"
        )
        return float(-optimum.fun)

    @cached_property
    def steepest_per_m(self) -> float:
        r"""Lipschitz constant of the surface function, 1/m; infinite if the series gives none.

        The gradient of \|r\|/R is 1/R along the ray and \|∇R\|/R² across it, with the gradient ∇R
        on the unit sphere. Both are evaluated on a grid. Between its points, at most an angle δ
        away, \|∇R\| is larger by at most δ times the largest second derivative, and R smaller by at
        most δ times the largest gradient. By Cauchy's inequality the second derivative is at most
        Σ √((k − 1) k (2n + 1)) (Σ C̄² + S̄²)^½ with k = n(n + 1): over the functions of a degree n
        the squared gradients sum to k(2n + 1) everywhere (addition theorem), so that by Bochner's
        formula, ½Δ\|∇Y\|² = \|∇∇Y\|² + ∇Y·∇ΔY + \|∇Y\|², the squared second derivatives sum to
        (k − 1) k (2n + 1).
        """
        squares = np.zeros(self.degree + 1)
        for (n, _), (c, s) in self._pairs.items():
            if n <= self.degree:
                squares[n] += c * c + s * s
        # Bound of the second derivatives: the sum over the degrees in the docstring.
        k = np.arange(self.degree + 1) * np.arange(1, self.degree + 2)
        each = np.maximum(k - 1, 0) * k * (2 * np.arange(self.degree + 1) + 1) * squares
        second = float(np.sum(np.sqrt(each)))
        grid = unit_vectors(np.linspace(-90, 90, 361), np.linspace(0, 359.5, 720))
        values = self._with_slopes(grid)
        away = np.radians(0.25 * np.sqrt(2.0))  # half the diagonal of half a degree, at most
        # Bounds of the gradient (above) and of the radius (below) around each point of the grid.
        slope = np.sqrt(np.sum(values[1:] ** 2, axis=0)) + away * second
        radius = values[0] - away * slope
        if not radius.min() > 0.0:
            return np.inf
        # The factor covers the rounding of the series, which is far below 1e-9.
        return float(np.hypot(1.0 / radius, slope / radius**2).max() * (1.0 + 1e-9))

    def surface(self, r: Vec3) -> Expr:
        """Return |r|/R(φ, λ) − 1."""
        distance, radius = self._radius(r)
        return distance / radius - 1.0

    def radius_array(self, directions: Array) -> Array:
        """Return the distance of the surface (N,), m, along directions (3, N) of any length."""
        radius: Array = self._compiled(directions)[0]
        return radius

    def _radius(self, r: Vec3) -> tuple[Expr, Expr]:
        """Return |r| and R(φ, λ)."""
        distance = norm(r)
        x, y, z = (q / distance for q in r)
        triangle = [(n, m) for n in range(self.degree + 1) for m in range(n + 1)]
        pairs = [self._pairs.get(place, (0.0, 0.0)) for place in triangle]
        # On the unit sphere the potential of such a series is the series itself.
        return distance, spherical_harmonics_potential((x, y, z), pairs, 1.0, 1.0)

    @cached_property
    def _compiled(self) -> ArrayFunction:
        x, y, z = _PLAIN
        return ArrayFunction([self._radius((x, y, z))[1]], _PLAIN)

    def _with_slopes(self, directions: Array) -> Array:
        """Return R and its gradient on the unit sphere, m, along unit vectors (3, N): (4, N)."""
        x, y, z = _PLAIN
        radius = self._radius((x, y, z))[1]
        # It depends on the direction alone, so that its gradient in space is that on the sphere.
        return ArrayFunction([radius, *gradient(radius, _PLAIN)], _PLAIN)(directions)


def _rows(spec: HarmonicShapeSpec) -> tuple[Coefficient, ...]:
    rows = tuple(Coefficient(*row) for row in spec.coefficients)
    places = [(row.n, row.m) for row in rows]
    for row in rows:
        if not 0 <= row.m <= row.n:
            raise InputError(f"coefficients: degree {row.n}, order {row.m} is no term of a series")
        if row.m == 0 and row.s != 0.0:
            raise InputError(f"coefficients: S of order 0 must be 0, got {row.s} in degree {row.n}")
    if len(set(places)) < len(places):
        raise InputError("coefficients: a degree and order are listed twice")
    if not any(row.n == 0 and row.c > 0.0 for row in rows):
        raise InputError("coefficients: no row [0, 0, C, 0] with the mean radius C > 0")
    return rows
