"""Closed meshes of triangles, with checks and the geometry that contact and gravity need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError

__all__ = ["Mesh"]

_FLAT = 1e-12
"""Least ratio of height to longest side of a triangle: below it rounding determines the normal."""
_BLOCK = 65_536
"""Faces whose checks and volumes are computed at once: 5 MB of corners, whatever the mesh."""
_SIDES = ((0, 1), (1, 2), (2, 0))
"""Corners between which the sides of a face lead."""


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
        return self._corners_of(slice(None))

    @cached_property
    def doubled_areas(self) -> Array:
        """Twice the areas of the faces (F,), m²."""
        return self._planes[0]

    @cached_property
    def normals(self) -> Array:
        """Outward unit normals of the faces, shape (3, F)."""
        return self._planes[1]

    @cached_property
    def heights(self) -> Array:
        """Distances of the planes of the faces from the origin, signed (F,): n·r on them, m."""
        return self._planes[2]

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
        numbers = self._side_numbers()
        order = np.argsort(numbers)
        ends = np.divmod(numbers[order[::2]] >> 1, len(self.vertices))
        return np.stack(ends, axis=1), order.reshape(-1, 2) % len(self.faces)

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
    def _planes(self) -> tuple[Array, Array, Array]:
        return _planes_of(self.corners)

    @cached_property
    def _pyramids(self) -> Array:
        """Signed volumes (F,) of the pyramids over the faces with apex at the origin."""
        volumes = np.empty(len(self.faces))
        for part in self._blocks():
            doubled_areas, _, heights = _planes_of(self._corners_of(part))
            volumes[part] = heights * doubled_areas / 6.0
        return volumes

    def _blocks(self) -> Iterator[slice]:
        """Yield the faces in blocks, so that intermediate arrays do not grow with the mesh."""
        return (slice(first, first + _BLOCK) for first in range(0, len(self.faces), _BLOCK))

    def _corners_of(self, faces: slice) -> Array:
        return np.ascontiguousarray(np.moveaxis(self.vertices[self.faces[faces]], 0, 2))

    def _side_numbers(self) -> Integers:
        """Return the numbers (3F,) of the sides: the first of all faces, the second, the third.

        That of an edge is even in the direction of rising vertex numbers, and one more in the
        other: sorted, the two sides of a sound edge stand beside each other.
        """
        f = self.faces
        numbers = np.empty((3, len(f)), dtype=np.int64)
        for row, (start, end) in zip(numbers, _SIDES, strict=True):
            np.minimum(f[:, start], f[:, end], out=row)
            row *= len(self.vertices)
            row += np.maximum(f[:, start], f[:, end])
            row *= 2
            row += f[:, start] > f[:, end]
        return numbers.reshape(-1)

    def _check_triangles(self) -> None:
        flat = np.empty(len(self.faces), dtype=bool)
        for part in self._blocks():
            a, b, c = self._corners_of(part)
            longest = np.max([np.linalg.norm(s, axis=0) for s in (b - a, c - b, a - c)], axis=0)
            area = np.linalg.norm(np.cross(b - a, c - a, axis=0), axis=0)
            flat[part] = ~(area > _FLAT * longest**2)
        if flat.any():
            more = f" (as are {flat.sum() - 1} more)" if flat.sum() > 1 else ""
            raise InputError(
                f"face {int(np.argmax(flat)) + 1} is degenerate{more}: two of its corners coincide "
                "or all three lie on a line; remove it"
            )

    def _check_edges(self) -> None:
        many, numbers = len(self.vertices), self._side_numbers()
        numbers.sort()
        doubled = numbers[1:][numbers[1:] == numbers[:-1]]
        if doubled.size:
            self._refuse_doubled(*_first_side(doubled, many))
        paired = np.zeros(len(numbers) + 1, dtype=bool)
        paired[1:-1] = (numbers[:-1] | 1) == numbers[1:]
        open_ = numbers[~(paired[1:] | paired[:-1])]
        if open_.size:
            i, j = _first_side(open_, many)
            raise InputError(
                f"the mesh is not closed: {len(open_)} edges belong to one face only, first that "
                f"between vertices {i + 1} and {j + 1}; close the holes, merge vertices that "
                "are listed twice"
            )

    def _refuse_doubled(self, i: int, j: int) -> NoReturn:
        """Refuse the mesh, of which two faces or more have the side from vertex i to vertex j."""
        f = self.faces
        owners = [np.flatnonzero((f[:, a] == i) & (f[:, b] == j)) for a, b in _SIDES]
        one, other = np.concatenate(owners)[:2].tolist()
        if set(f[one].tolist()) == set(f[other].tolist()):
            raise InputError(
                f"faces {one + 1} and {other + 1} have the same corners, in the same direction; "
                "remove one"
            )
        raise InputError(
            f"two faces traverse the edge from vertex {i + 1} to vertex {j + 1} in the same "
            "direction: neighbours are oriented differently, or more than two faces meet "
            "there; orient all anticlockwise as seen from outside"
        )


def _planes_of(corners: Array) -> tuple[Array, Array, Array]:
    """Return twice the areas (N,), unit normals (3, N) and heights (N,) of faces (3, 3, N)."""
    a, b, c = corners
    products = np.cross(b - a, c - a, axis=0)
    doubled_areas = np.linalg.norm(products, axis=0)
    normals = products / doubled_areas
    return doubled_areas, normals, np.sum(normals * corners.mean(axis=0), axis=0)


def _first_side(numbers: Integers, many: int) -> tuple[int, int]:
    """Return the side, of those with these numbers, with the lowest first and second vertex."""
    low, high = np.divmod(numbers >> 1, many)
    directed = np.where(numbers & 1, high * many + low, low * many + high)
    i, j = divmod(int(directed.min()), many)
    return i, j
