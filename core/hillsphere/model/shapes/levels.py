"""Surface functions and normals on arrays, for shapes of expressions and of arrays alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.intervals import EVERYTHING
from hillsphere.interfaces.surface import ArraySurface, SlopedSurface, Surface
from hillsphere.symbolic.expressions import Expr, Vec3, gradient, sqrt, sum_of, variables

__all__ = ["level_of", "level_within", "normals_of"]

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
        Function of body-fixed positions, m: positive outside, zero on the surface, negative inside.
    """
    if not isinstance(shape, Surface):
        return shape.surface_array
    x, y, z = _PLAIN
    compiled = ArrayFunction([shape.surface((x, y, z))], _PLAIN)

    def level(r: Array) -> Array:
        values: Array = compiled(np.ascontiguousarray(r))[0]
        return values

    return level


def level_within(shape: Surface | ArraySurface, place: Vec3) -> Expr:
    """Bound the time derivative of a surface function along flights through a box.

    Parameters
    ----------
    shape : Surface or ArraySurface
        The shape.
    place : Vec3
        Body-fixed position and its rates, `hillsphere.engine.dynamics.bounds.Bound`.

    Returns
    -------
    Expr
        A bound from the shape's Lipschitz constant and the speed, or from its expression; infinite
        for a shape with neither.
    """
    if isinstance(shape, SlopedSurface):
        rates = [Bound.of(q).rate for q in place]
        squares = [Bound(rate) ** 2 for rate in rates if rate is not None]
        if not squares:
            return cast(Expr, Bound(EVERYTHING))
        speed = sqrt(sum_of(cast("list[Expr]", squares)))
        most = Bound.of(shape.steepest_per_m * speed).value[1]
        return cast(Expr, Bound(EVERYTHING, (-most, most), EVERYTHING))
    if isinstance(shape, Surface):
        return shape.surface(place)
    return cast(Expr, Bound(EVERYTHING, EVERYTHING, EVERYTHING))


def normals_of(shape: Surface | ArraySurface) -> Callable[[Array], Array]:
    """Return the unit outward normals of a shape as (3, N) → (3, N).

    Parameters
    ----------
    shape : Surface or ArraySurface
        The shape.

    Returns
    -------
    callable
        Function of body-fixed positions on the surface, m: the shape's own normals, such as those
        of faces, or the exact gradient of its surface function, normalised.
    """
    if isinstance(shape, ArraySurface):
        return shape.normal_array
    x, y, z = _PLAIN
    compiled = ArrayFunction(gradient(shape.surface((x, y, z)), _PLAIN), _PLAIN)

    def normals(r: Array) -> Array:
        slope: Array = compiled(np.ascontiguousarray(r))
        return np.asarray(slope / np.linalg.norm(slope, axis=0))

    return normals
