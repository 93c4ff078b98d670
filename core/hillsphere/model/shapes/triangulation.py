"""Triangulation of any shape."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.sphere import icosphere

__all__ = ["Radial", "triangulate"]


@runtime_checkable
class Radial(Contract, Protocol):
    """A shape with a known radius along each ray from the centre."""

    def radius_array(self, directions: Array) -> Array:
        """Return the distances (N,), m, along directions (3, N) of any length."""
        ...


def triangulate(shape: Radial, subdivisions: int) -> Mesh:
    """Return a mesh whose corners lie on the surface of a shape.

    Parameters
    ----------
    shape : Radial
        The shape.
    subdivisions : int
        k, the number of times that each of the 20 faces of an icosahedron is divided into four.

    Returns
    -------
    Mesh
        The mesh. Its faces lie inside convex parts of the surface, so that its volume is too small
        by a relative error of order 4^−k.
    """
    directions, faces = icosphere(subdivisions)
    radii = shape.radius_array(np.ascontiguousarray(directions.T))
    return Mesh(radii[:, None] * directions, faces)
