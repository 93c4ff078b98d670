"""Checks of shapes: consistency of surface function, radius, normals and extent."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.engine.dynamics.root_finding import bracketed_roots
from hillsphere.interfaces import Array, ArraySurface, Enclosed, Surface
from hillsphere.model.shapes.levels import level_of
from hillsphere.model.shapes.triangulation import Radial
from hillsphere.testing.contract import check_close, derivative_by_differences, require

__all__ = ["check_shape"]

_STEP = 1e-6
"""Step of the differences, part of the distance: so small that few points lie within a step of an
edge of a mesh; rounding becomes 1e-10, below the 1e-6 that is allowed for normals."""


def check_shape(shape: Any, directions: ArrayLike, *, tol: float = 1e-9) -> None:
    """Check a shape.

    Parameters
    ----------
    shape : Surface or ArraySurface
        The shape; each ray from its centre along a direction must meet the surface once.
    directions : array_like, shape (3, N)
        Directions from the centre; best at random, away from the creases of the surface.
    tol : float
        Largest relative difference of distances.

    Raises
    ------
    ContractViolation
        Unless, along all directions,

        - the surface function is negative from near the centre up to the surface, positive beyond;
        - the surface lies in the box of ``semi_axes_m()`` and within ``largest_radius_m``, if
          given, to a thousandth (both may come from a grid);
        - normals, if given, are outward unit vectors, perpendicular to the level of the function;
        - ``radius_array``, if given, describes the same surface, and ``surface`` and
          ``surface_array`` agree if both are given.
    """
    what = type(shape).__name__
    require(
        isinstance(shape, Surface | ArraySurface),
        f"{what} must have semi_axes_m, and surface or surface_array with normal_array",
    )
    way = np.ascontiguousarray(directions, dtype=float)
    require(way.ndim == 2 and way.shape[0] == 3, f"directions must be (3, N), got {way.shape}")
    way = way / np.linalg.norm(way, axis=0)
    axes = np.array(shape.semi_axes_m(), dtype=float)
    require(axes.shape == (3,) and (axes > 0).all(), f"{what}: semi-axes must be positive")
    farthest = float(np.linalg.norm(axes))

    level = level_of(shape)
    low, high = np.full(way.shape[1], 1e-3 * axes.min()), np.full(way.shape[1], 2.0 * farthest)
    inside, outside = level(low * way), level(high * way)
    require((inside < 0).all(), f"{what}: the surface function must be negative near the centre")
    require((outside > 0).all(), f"{what}: the surface function must be positive outside")
    radius = bracketed_roots(lambda q: level(q * way), low, high, inside, outside, 1e-13 * high)
    points = radius * way
    require(
        (np.abs(points) <= 1.001 * axes[:, None]).all(),
        f"{what}: the surface leaves the box of its semi-axes {axes.tolist()}",
    )
    if isinstance(shape, Enclosed):
        most = shape.largest_radius_m
        require(
            radius.max() <= 1.001 * most,
            f"{what}: a radius of {radius.max():.6g} m exceeds the largest, {most:.6g} m",
        )
    if isinstance(shape, Radial):
        check_close(f"{what}: radius_array", shape.radius_array(3.0 * way), radius, radius, tol)
    if isinstance(shape, ArraySurface):
        if isinstance(shape, Surface):
            near = 1.1 * points
            check_close(f"{what}: surface_array", shape.surface_array(near), level(near), 1.0, tol)
        _check_normals(what, shape, level, points)


def _check_normals(what: str, shape: ArraySurface, level: Any, points: Array) -> None:
    normals = shape.normal_array(points)
    require(normals.shape == points.shape, f"{what}: normals must be {points.shape}")
    size = np.linalg.norm(normals, axis=0)
    require(np.allclose(size, 1.0, rtol=0, atol=1e-12), f"{what}: normals must be unit vectors")
    steps = np.broadcast_to(_STEP * np.linalg.norm(points, axis=0), points.shape)
    slope = derivative_by_differences(lambda x: level(x)[None], points, steps)[0]
    require((np.linalg.norm(slope, axis=0) > 0).all(), f"{what}: the surface function has no slope")
    slope = slope / np.linalg.norm(slope, axis=0)
    check_close(f"{what}: normals against the surface function", normals, slope, 1.0, 1e-6)
