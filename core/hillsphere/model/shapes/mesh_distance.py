"""Distance of points from the surface of a mesh."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.model.shapes.mesh import Mesh

__all__ = ["surface_distances"]

_CHUNK = 100_000
"""Pairs of a face and a point that are evaluated at once, which bounds the memory."""


def surface_distances(mesh: Mesh, r: Array) -> Array:
    """Return the distances (N,), m, of points r (3, N) from the nearest triangle of a mesh.

    The nearest point of a triangle is the foot of the perpendicular to its plane if that lies
    inside the triangle; otherwise it lies on one of the sides.
    """
    distances = np.empty(r.shape[1])
    width = max(1, _CHUNK // len(mesh.faces))
    for first in range(0, r.shape[1], width):
        part = r[:, None, first : first + width]
        corners = mesh.corners[..., None]
        normals = mesh.normals[..., None]
        inside = np.ones((len(mesh.faces), part.shape[2]), dtype=bool)
        least = np.full(inside.shape, np.inf)
        for k in range(3):
            start, side = corners[k], corners[(k + 1) % 3] - corners[k]
            # The nearest point of a side: the foot of the perpendicular, clipped to the side.
            to = part - start
            along = np.sum(to * side, axis=0) / np.sum(side * side, axis=0)
            gap = to - np.clip(along, 0.0, 1.0) * side
            least = np.fmin(least, np.sum(gap * gap, axis=0))
            # The foot in the plane lies on the inner side of this side of the triangle.
            inside &= np.sum(np.cross(side, to, axis=0) * normals, axis=0) >= 0.0
        height = np.sum((part - corners[0]) * normals, axis=0)
        least = np.where(inside, height * height, least)
        lost = ~np.isfinite(part[:, 0]).all(axis=0)
        distances[first : first + width] = np.where(lost, np.nan, np.sqrt(least.min(axis=0)))
    return distances
