"""Any shape as a mesh of triangles."""

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
    """A shape that tells how far out its surface lies along a ray from the centre."""

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
        How often each of the 20 faces of an icosahedron is divided into four.

    Returns
    -------
    Mesh
        It lies inside of convex parts: its volume is too small by a part of order 4^−k.
    """
    directions, faces = icosphere(subdivisions)
    radii = shape.radius_array(np.ascontiguousarray(directions.T))
    return Mesh(radii[:, None] * directions, faces)
