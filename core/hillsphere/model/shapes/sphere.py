"""Directions on the unit sphere: grids of latitude and longitude, and icospheres."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array, Integers

__all__ = ["icosphere", "unit_vectors"]


def unit_vectors(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> Array:
    """Return unit vectors (3, L·M) for all latitudes and longitudes; longitudes vary fastest.

    Parameters
    ----------
    latitude_deg : array_like, shape (L,)
        Planetocentric latitudes.
    longitude_deg : array_like, shape (M,)
        East longitudes.

    Returns
    -------
    ndarray, shape (3, L·M)
        Unit vectors in the body-fixed frame.
    """
    lat, lon = np.meshgrid(np.radians(latitude_deg), np.radians(longitude_deg), indexing="ij")
    vectors = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return np.array(vectors).reshape(3, -1)


def icosphere(subdivisions: int) -> tuple[Array, Integers]:
    """Return a unit sphere of 20·4^k nearly equal triangles.

    Parameters
    ----------
    subdivisions : int
        k, the number of times that each triangle of the icosahedron is divided into four.

    Returns
    -------
    vertices : ndarray, shape (10·4^k + 2, 3)
        Unit vectors.
    faces : ndarray of int, shape (20·4^k, 3)
        Anticlockwise as seen from outside.
    """
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = [
        (-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0),
        (0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden),
        (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1),
    ]  # fmt: skip
    vertices = np.array(corners, dtype=float) / np.hypot(1.0, golden)
    faces = np.array([
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11),
        (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
        (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9),
        (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ], dtype=np.int64)  # fmt: skip
    for _ in range(subdivisions):
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]))
        edges, place = np.unique(sides, axis=0, return_inverse=True)
        middle = vertices[edges].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1)[:, None]
        ab, bc, ca = place.reshape(3, -1) + len(vertices)
        a, b, c = faces.T
        vertices = np.concatenate([vertices, middle])
        faces = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
    return vertices, faces
