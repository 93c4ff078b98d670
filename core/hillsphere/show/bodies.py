"""Surfaces of bodies for figures in three dimensions."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array

__all__ = ["ellipsoid_points"]


def ellipsoid_points(a: float, b: float, c: float, meridians: int = 37) -> Array:
    """Return points (3, meridians // 2 + 1, meridians) of an ellipsoid on circles of latitude.

    Parameters
    ----------
    a, b, c : float
        Semi-axes along x, y and z, in the unit of the result.
    meridians : int
        Number of meridians; the first is repeated as the last, which closes the surface.
    """
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, meridians // 2 + 1)[:, None]
    longitude = np.linspace(0.0, 2.0 * np.pi, meridians)
    return np.array(
        [
            a * np.cos(latitude) * np.cos(longitude),
            b * np.cos(latitude) * np.sin(longitude),
            c * np.sin(latitude) * np.ones_like(longitude),
        ]
    )
