"""Surface functions and normals on arrays, whether a shape writes expressions or not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array, ArraySurface, Surface
from hillsphere.symbolic import gradient, variables

__all__ = ["level_of", "normals_of"]

_PLAIN = variables("level:x", "level:y", "level:z")


def level_of(shape: Surface | ArraySurface) -> Callable[[Array], Array]:
    """Return the surface function of a shape as (3, N) → (N,).

    Parameters
    ----------
    shape : Surface or ArraySurface
        The shape.

    Returns
    -------
    callable
        At body-fixed positions, m: positive outside, zero on the surface, negative inside.
    """
    if not isinstance(shape, Surface):
        return shape.surface_array
    x, y, z = _PLAIN
    compiled = ArrayFunction([shape.surface((x, y, z))], _PLAIN)

    def level(r: Array) -> Array:
        found: Array = compiled(np.ascontiguousarray(r))[0]
        return found

    return level


def normals_of(shape: Surface | ArraySurface) -> Callable[[Array], Array]:
    """Return the unit outward normals of a shape as (3, N) → (3, N).

    Parameters
    ----------
    shape : Surface or ArraySurface
        The shape.

    Returns
    -------
    callable
        At body-fixed positions on the surface, m: those that the shape gives, such as a face's, or
        the slope of its surface function, exact.
    """
    if isinstance(shape, ArraySurface):
        return shape.normal_array
    x, y, z = _PLAIN
    compiled = ArrayFunction(gradient(shape.surface((x, y, z)), _PLAIN), _PLAIN)

    def normals(r: Array) -> Array:
        slope: Array = compiled(np.ascontiguousarray(r))
        return np.asarray(slope / np.linalg.norm(slope, axis=0))

    return normals
