"""Closed meshes of triangles, with checks and the geometry that contact and gravity need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError

__all__ = ["Mesh"]

_FLAT = 1e-12
"""Least ratio of height to longest side of a triangle: below it rounding determines the normal."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface of F triangles, each anticlockwise as seen from outside.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        Corners, body-fixed, m.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`.

    Raises
    ------
    InputError
        If a face is degenerate or refers to a missing vertex, an edge does not belong to exactly
        two faces (a hole, a fin), two neighbours are oriented differently, or all faces are
        oriented inward.
    """

    vertices: Array
    faces: Integers

    def __post_init__(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1:] != (3,):
            raise InputError(f"vertices must be (V, 3), got {self.vertices.shape}")
        if self.faces.ndim != 2 or self.faces.shape[1:] != (3,) or len(self.faces) < 4:
            raise InputError(f"a closed mesh has at least four triangles, got {self.faces.shape}")
        if not np.isfinite(self.vertices).all():
            raise InputError("vertices must be finite")
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise InputError(
                f"faces name vertices 1 to {len(self.vertices)}, got {self.faces.min() + 1} to "
                f"{self.faces.max() + 1}"
            )
        self._check_triangles()
        self._check_edges()
        if not self.volume_m3 > 0.0:
            raise InputError(
                "the faces look inward (the volume is negative); name the vertices of each "
                "anticlockwise as seen from outside"
            )

    @cached_property
    def corners(self) -> Array:
        """Corners of the faces, shape (3, 3, F): corner, component, face; m."""
        return np.ascontiguousarray(np.moveaxis(self.vertices[self.faces], 0, 2))

    @cached_property
    def doubled_areas(self) -> Array:
        """Twice the areas of the faces (F,), m²."""
        return np.asarray(np.linalg.norm(self._products, axis=0))

    @cached_property
    def normals(self) -> Array:
        """Outward unit normals of the faces, shape (3, F)."""
        return np.asarray(self._products / self.doubled_areas)

    @cached_property
    def heights(self) -> Array:
        """Distances of the planes of the faces from the origin, signed (F,): n·r on them, m."""
        return np.asarray(np.sum(self.normals * self.corners.mean(axis=0), axis=0))

    @cached_property
    def volume_m3(self) -> float:
        """Volume, m³."""
        return float(np.sum(self._pyramids))

    @cached_property
    def centroid_m(self) -> Array:
        """Centre of the volume, shape (3,), m."""
        weighted = self._pyramids * self.corners.sum(axis=0) / 4.0
        return np.asarray(weighted.sum(axis=1) / self.volume_m3)

    @cached_property
    def edges(self) -> tuple[Integers, Integers]:
        """Edges (E, 2) as vertex numbers, and their faces (E, 2).

        The first face traverses the edge from its first to its second vertex, the second face in
        the opposite direction.
        """
        sides, owner = self._sides()
        forward = sides[:, 0] < sides[:, 1]
        order = np.lexsort(sides[forward].T[::-1])
        back = np.lexsort(sides[~forward].T)
        return sides[forward][order], np.stack(
            [owner[forward][order], owner[~forward][back]], axis=1
        )

    @cached_property
    def largest_radius_m(self) -> float:
        """Distance of the farthest vertex from the origin, m."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def is_star_shaped(self) -> bool:
        """Whether every ray from the origin meets the surface once."""
        return bool((self.heights > 0.0).all())

    @cached_property
    def component_volumes_m3(self) -> Array:
        """Volumes of the closed surfaces that have no edge in common, m³, the largest first.

        That of a cavity, whose faces look into it, is negative.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        _, faces = self.edges
        count = len(self.faces)
        links = coo_array((np.ones(len(faces), dtype=bool), faces.T), shape=(count, count))
        _, labels = connected_components(links, directed=False)
        return np.asarray(np.sort(np.bincount(labels, weights=self._pyramids))[::-1])

    @cached_property
    def _products(self) -> Array:
        a, b, c = self.corners
        return np.cross(b - a, c - a, axis=0)

    @cached_property
    def _pyramids(self) -> Array:
        """Signed volumes (F,) of the pyramids over the faces with apex at the origin."""
        return np.asarray(self.heights * self.doubled_areas / 6.0)

    def _sides(self) -> tuple[Integers, Integers]:
        """Directed sides (3F, 2) of the faces, and the face of each."""
        f = self.faces
        sides = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
        return sides, np.tile(np.arange(len(f)), 3)

    def _check_triangles(self) -> None:
        a, b, c = self.corners
        longest = np.max([np.linalg.norm(s, axis=0) for s in (b - a, c - b, a - c)], axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = ~(np.linalg.norm(self._products, axis=0) > _FLAT * longest**2)
        if flat.any():
            more = f" (as are {flat.sum() - 1} more)" if flat.sum() > 1 else ""
            raise InputError(
                f"face {int(np.argmax(flat)) + 1} is degenerate{more}: two of its corners coincide "
                "or all three lie on a line; remove it"
            )

    def _check_edges(self) -> None:
        sides, owner = self._sides()
        many = len(self.vertices)
        keys = sides[:, 0] * many + sides[:, 1]
        order = np.argsort(keys, kind="stable")
        doubled = np.flatnonzero(keys[order][1:] == keys[order][:-1])
        if doubled.size:
            at = order[doubled[0]]
            i, j = (sides[at] + 1).tolist()
            one, other = (owner[order[doubled[0] : doubled[0] + 2]] + 1).tolist()
            if set(self.faces[one - 1].tolist()) == set(self.faces[other - 1].tolist()):
                raise InputError(
                    f"faces {one} and {other} have the same corners, in the same direction; "
                    "remove one"
                )
            raise InputError(
                f"two faces traverse the edge from vertex {i} to vertex {j} in the same "
                "direction: neighbours are oriented differently, or more than two faces meet "
                "there; orient all anticlockwise as seen from outside"
            )
        keys = keys[order]
        turned = sides[:, 1] * many + sides[:, 0]
        open_ = keys[~np.isin(keys, turned)]
        if open_.size:
            i, j = divmod(int(open_[0]), many)
            raise InputError(
                f"the mesh is not closed: {len(open_)} edges belong to one face only, first that "
                f"between vertices {i + 1} and {j + 1}; close the holes, merge vertices that "
                "are listed twice"
            )
