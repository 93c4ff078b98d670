"""A tri-axial ellipsoid as the shape of a body."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.model.shapes.specs import EllipsoidShapeSpec
from hillsphere.symbolic.expressions import Expr, Vec3, sum_of

__all__ = ["EllipsoidShape"]


class EllipsoidShape:
    """A tri-axial ellipsoid, x²/a² + y²/b² + z²/c² = 1.

    Parameters
    ----------
    spec : EllipsoidShapeSpec
        Its axes.
    """

    is_ellipsoid = True
    """The semi-axes define the shape completely; see `hillsphere_sensors.body_surface`."""

    def __init__(self, spec: EllipsoidShapeSpec) -> None:
        self._axes = spec.axes_m

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the semi-axes, m."""
        return self._axes

    @property
    def largest_radius_m(self) -> float:
        """The longest semi-axis, m."""
        return max(self._axes)

    def surface(self, r: Vec3) -> Expr:
        """Return x²/a² + y²/b² + z²/c² − 1."""
        return sum_of([*(q * q / (a * a) for q, a in zip(r, self._axes, strict=True)), -1.0])

    def radius_array(self, directions: Array) -> Array:
        """Return the distance of the surface (N,), m, along directions (3, N) of any length."""
        scaled = directions / np.array(self._axes)[:, None]
        return np.asarray(
            np.sqrt(np.sum(directions**2, axis=0) / np.sum(scaled**2, axis=0)), dtype=float
        )
