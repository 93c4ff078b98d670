"""Intersection of rays from the centre with a star-shaped mesh, by a table of cells."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from hillsphere.base.arrays import Array, Integers
from hillsphere.model.shapes.mesh import Mesh

__all__ = ["RayTable"]

_WIDEST = 1.4
"""Largest half-angle, rad, of a cone that contains every triangle whose corners it contains."""


class RayTable:
    """Table of the faces that rays may meet, for every cell of a cube about the origin.

    The cube has about as many cells as the mesh has faces, so that a look-up tests only a few
    faces, whatever the size of the mesh.

    Parameters
    ----------
    mesh : Mesh
        Star-shaped.
    """

    def __init__(self, mesh: Mesh) -> None:
        corners = mesh.corners / np.linalg.norm(mesh.corners, axis=1, keepdims=True)
        axes = corners.sum(axis=0)
        self._axes = axes / np.linalg.norm(axes, axis=0)
        self._half = np.max(_angles(corners, self._axes), axis=0)
        self._sides = _side_planes(mesh)
        self._narrow = bool(self._half.max() <= _WIDEST)
        self._cells = max(1, int(np.sqrt(len(mesh.faces) / 6.0))) if self._narrow else 1

    def faces(self, directions: Array) -> Integers:
        """Return the face (N,) that the ray along each direction (3, N) meets.

        At an edge or a vertex this is one of the adjacent faces, also in the presence of rounding.
        """
        candidates = self._table[self._cell(directions)]
        # A ray meets a face if it lies on the inner side of all three planes. The face with the
        # largest minimum is taken, so that rounding at an edge cannot exclude all candidates.
        inside = np.einsum("skFn,kF->sFn", self._sides[:, :, candidates], directions).min(axis=0)
        best = np.argmax(inside, axis=1)
        return np.asarray(candidates[np.arange(len(best)), best])

    def _cell(self, directions: Array) -> Integers:
        # The cell of the cube's side that the ray meets, by central projection on that side.
        size = np.abs(directions)
        axis = np.argmax(size, axis=0)
        lanes = np.arange(directions.shape[1])
        along = directions[axis, lanes]
        u, v = directions[(axis + 1) % 3, lanes], directions[(axis + 2) % 3, lanes]
        with np.errstate(divide="ignore", invalid="ignore"):
            place = np.nan_to_num(np.stack([u, v]) / np.abs(along))
        i, j = np.clip(((place + 1.0) * 0.5 * self._cells).astype(np.int64), 0, self._cells - 1)
        side = 2 * axis + (along < 0.0)
        return np.asarray((side * self._cells + i) * self._cells + j)

    @cached_property
    def _table(self) -> Integers:
        """Return the faces of each cell (cells, K); short rows repeat their first face."""
        axes, half = self._axes, self._half
        if not self._narrow:
            return np.tile(np.arange(len(half)), (6, 1))
        middle, width = self._cones()
        # The cones of a cell and of a face overlap if their axes are closer than the sum of the
        # half-angles. The tree searches with the largest half-angle of a face, as a chord.
        near = cKDTree(axes.T).query_ball_point(
            middle.T, 2.0 * np.sin(0.5 * np.minimum(np.pi, width + half.max()))
        )
        rows = []
        for cell, close in enumerate(near):
            faces = np.array(sorted(close), dtype=np.int64)
            apart = _angles(axes[:, faces], middle[:, cell, None])
            rows.append(faces[apart <= width[cell] + half[faces] + 1e-9])
        table = np.empty((len(rows), max(map(len, rows))), dtype=np.int64)
        for row, faces in zip(table, rows, strict=True):
            row[:] = faces[0]
            row[: len(faces)] = faces
        return table

    def _cones(self) -> tuple[Array, Array]:
        """Return axes (3, cells) and half-angles (cells,) of cones that contain the cells."""
        edges = np.linspace(-1.0, 1.0, self._cells + 1)
        corners = []
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            u, v = np.meshgrid(
                edges[i : i + self._cells], edges[j : j + self._cells], indexing="ij"
            )
            one = np.stack([np.ones_like(u), u, v]).reshape(3, -1)
            sides = [
                np.roll(one * np.array([[sign], [1.0], [1.0]]), axis, axis=0)
                for axis in range(3)
                for sign in (1.0, -1.0)
            ]
            corners.append(np.concatenate(sides, axis=1))
        vectors = np.array(corners)
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        middle = vectors.sum(axis=0)
        middle /= np.linalg.norm(middle, axis=0)
        return middle, np.max(_angles(vectors, middle), axis=0)


def _side_planes(mesh: Mesh) -> Array:
    """Return unit normals of the planes through the origin and each side of each face, (3, 3, F).

    They point inward, towards the face.
    """
    a, b, c = mesh.corners
    sides = np.stack([np.cross(p, q, axis=0) for p, q in ((a, b), (b, c), (c, a))])
    return np.asarray(sides / np.linalg.norm(sides, axis=1, keepdims=True))


def _angles(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors, whose components are on the last axis but one."""
    chord = np.linalg.norm(a - b, axis=-2)
    return np.asarray(2.0 * np.arcsin(np.minimum(1.0, 0.5 * chord)))
