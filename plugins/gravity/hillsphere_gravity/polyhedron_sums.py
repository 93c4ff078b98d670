"""Sums over the edges and faces of a mesh, from which its gravity follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.model.shapes.mesh import Mesh

__all__ = ["OpenPart", "OpenParts", "PolyhedronSums", "Sums"]

_FACES = 512
"""Most faces of a part of the mesh: with the edges its arrays stay in the processor's cache."""
_PAIRS = 12_288
"""Pairs of a face and a point that are computed at once, for the same reason: 96 kB an array."""
_BELOW_ONE = 1.0 - np.finfo(float).eps
"""Largest ratio e/(a+b): on the edge itself the logarithm stays finite, and is multiplied by 0."""
_ROWS = 11
"""See `PolyhedronSums`: K, three of A, six of G, and the trace of G."""
_REMEMBERED = 4096
"""Most points whose sums are kept: flights have fewer lanes, and maps need no second look."""


class PolyhedronSums:
    r"""The polyhedron's potential and its derivatives, all from one pass over edges and faces.

    With the logarithms L_e and solid angles ω_f of `hillsphere_gravity.polyhedron`, the middles m
    of the edges, the heights h of the faces over the origin and r_e = m − r, n·r_f = h − n·r, the
    sums are polynomials of the point r:

    .. math::

        G = \sum_e E L - \sum_f nn\,\omega, \quad A = \sum_e Em\,L - \sum_f nh\,\omega, \quad
        K = \sum_e m\cdot Em\,L - \sum_f h^2\omega,

    .. math::

        U = \tfrac12 G\rho\,(K - 2r\cdot A + r\cdot Gr), \quad \nabla U = G\rho\,(Gr - A), \quad
        \nabla\nabla U = G\rho\,G .

    So one matrix of eleven rows is applied to L and ω. The solid angle [1]_ has, with the distances
    d of the corners and the squares q of the opposite sides,

    .. math::

        \tan\frac\omega2 = \frac{4Ah}
        {(d_1+d_2)(d_2+d_3)(d_3+d_1) - d_1q_1 - d_2q_2 - d_3q_3} ,

    the denominator being twice that of [1]_, as 2 r_i·r_j = d_i² + d_j² − q_k, and A, h area and
    height over the point.

    Parameters
    ----------
    mesh : Mesh
        F faces.

    References
    ----------
    .. [1] A. van Oosterom, J. Strackee (1983), The solid angle of a plane triangle, IEEE
       Transactions on Biomedical Engineering BME-30(2), 125-126.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._vertices = np.ascontiguousarray(mesh.vertices.T)
        self._parts = _parts(mesh)
        self._width = max(1, _PAIRS // min(len(mesh.faces), _FACES))
        self._last = Sums(np.empty((3, 0)), np.empty((_ROWS, 0)))

    def __call__(self, r: Array) -> Sums:
        """Return the sums at points r (3, N), m.

        Those of the last points are kept: a flight with variations asks for acceleration and
        gradient at the same place, one after the other.
        """
        last = self._last
        if not np.array_equal(last.r, r):
            last = Sums(r.copy(), self._compute(r))
            if r.shape[1] <= _REMEMBERED:
                self._last = last
        return last

    def _compute(self, r: Array) -> Array:
        rows = np.empty((_ROWS, r.shape[1]))
        for first in range(0, r.shape[1], self._width):
            some = slice(first, first + self._width)
            rows[:, some] = self._block(np.ascontiguousarray(r[:, some]))
        return rows

    def _block(self, r: Array) -> Array:
        distances = _distances(self._vertices, r)
        total = np.zeros((_ROWS, r.shape[1]))
        for part in self._parts:
            total += part.of_edges @ _half_logarithms(part, distances)
            total += part.of_faces @ _half_angles(part, distances, r)
        return total


class OpenParts:
    r"""Sums over some of a mesh's faces.

    A face contributes :math:`\tfrac12 h\,\Phi` to the potential for Gρ = 1, with its height h over
    the point and the potential Φ of a single layer on it. By

    .. math::

        \Phi = \sum_e n_e\cdot r_e\,L_e - h\,\omega, \quad \nabla\Phi = -\sum_e n_e L_e + n\,\omega,

    these are the sums of `PolyhedronSums` with half of each edge's dyad, that of n and the normal
    n_e of the edge in the plane of this face; and Gr − A is the exact derivative of this potential
    too, as E is symmetric there. The second derivative is not G but where all faces are summed.

    Parameters
    ----------
    mesh : Mesh
        F faces.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._ends, self._owners, self._lengths, middle, dyads = _half_edges(mesh)
        self._halves = [2.0 * _matrix(half, middle) for half in dyads]
        self._faces = _of_faces(mesh)
        # each face owns three sides
        self._sides = np.argsort(self._owners.ravel(), kind="stable").reshape(-1, 3) // 2

    def part(self, faces: Integers) -> OpenPart:
        """Return the part of these faces (M,)."""
        corners = self._mesh.faces[faces]
        vertices = np.unique(corners)
        edges = np.unique(self._sides[faces])
        mine = np.isin(self._owners[edges], faces)
        of_edges = sum(
            half[:, edges] * is_mine for half, is_mine in zip(self._halves, mine.T, strict=True)
        )
        ends = np.searchsorted(vertices, self._ends[edges]).T
        part = Part(
            (np.ascontiguousarray(ends[0]), np.ascontiguousarray(ends[1])),
            self._lengths[edges, None],
            np.ascontiguousarray(of_edges),
            *self._faces.take(faces, np.searchsorted(vertices, corners)),
        )
        return OpenPart(np.ascontiguousarray(self._mesh.vertices[vertices].T), part)


@dataclass(frozen=True)
class OpenPart:
    """Some faces of a mesh, with the vertices (3, V) that they need."""

    vertices: Array
    part: Part

    def rows(self, r: Array) -> Array:
        """Return their sums at points r (3, N), m, as rows of `Sums`."""
        total = np.empty((_ROWS, r.shape[1]))
        width = max(8, _PAIRS // len(self.part.normals) // 8 * 8)
        for first in range(0, r.shape[1], width):
            some = np.ascontiguousarray(r[:, first : first + width])
            distances = _distances(self.vertices, some)
            block = self.part.of_edges @ _half_logarithms(self.part, distances)
            block += self.part.of_faces @ _half_angles(self.part, distances, some)
            total[:, first : first + width] = block
        return total


def _distances(vertices: Array, r: Array) -> Array:
    """Return the distances (V, N) of points r (3, N) from vertices (3, V)."""
    # In place where it can be: new arrays would take as long as the arithmetic.
    along = vertices[:, :, None] - r[:, None, :]
    along *= along
    distances: Array = along[0]
    distances += along[1]
    distances += along[2]
    return np.sqrt(distances, out=distances)


@dataclass(frozen=True)
class Sums:
    """Sums at points; quantities for Gρ = 1."""

    r: Array
    rows: Array

    def potential(self) -> Array:
        """Return U (N,), m²."""
        way = self.rows[1:4] - 0.5 * self._gradient_times_r()
        return np.asarray(0.5 * self.rows[0] - np.sum(self.r * way, axis=0))

    def acceleration(self) -> Array:
        """Return ∇U (3, N), m."""
        return np.asarray(self._gradient_times_r() - self.rows[1:4])

    def gradient(self) -> Array:
        """Return ∇∇U (3, 3, N)."""
        xx, yy, zz, xy, xz, yz = self.rows[4:10]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def laplacian(self) -> Array:
        """Return ∇²U (N,)."""
        return np.asarray(self.rows[10])

    def _gradient_times_r(self) -> Array:
        xx, yy, zz, xy, xz, yz = self.rows[4:10]
        x, y, z = self.r
        return np.array(
            [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z]
        )


@dataclass(frozen=True)
class Part:
    """Some faces of a mesh and as many of its edges as are theirs, in columns."""

    ends: tuple[Integers, Integers]
    lengths: Array
    of_edges: Array
    corners: tuple[Integers, Integers, Integers]
    squares: tuple[Array, Array, Array]
    normals: Array
    heights: Array
    of_faces: Array


@dataclass(frozen=True)
class _Faces:
    """What the solid angles of faces need, in the order of the fields of `Part`."""

    squares: list[Array]
    normals: Array
    heights: Array
    matrix: Array

    def take(self, some: slice | Integers, corners: Integers) -> tuple[Any, ...]:
        """Return the fields of `Part` from `corners` on, for some of the faces."""
        c1, c2, c3 = (np.ascontiguousarray(i) for i in corners.T)
        q1, q2, q3 = (q[some, None] for q in self.squares)
        return (
            (c1, c2, c3),
            (q1, q2, q3),
            np.ascontiguousarray(self.normals[:, some].T),
            self.heights[some, None],
            np.ascontiguousarray(self.matrix[:, some]),
        )


def _of_faces(mesh: Mesh) -> _Faces:
    # of a face the point is the foot of the origin's perpendicular, h n: n n·h n = h n
    dyads = _dyads(mesh.normals, mesh.normals)
    matrix = -2.0 * _matrix(dyads, mesh.heights * mesh.normals)
    a, b, c = mesh.corners
    squares = [np.sum(s * s, axis=0) for s in (c - b, a - c, b - a)]
    # four areas times the height: the numerator, see `PolyhedronSums`
    scale = 2.0 * mesh.doubled_areas
    return _Faces(squares, scale * mesh.normals, scale * mesh.heights, matrix)


def _half_edges(mesh: Mesh) -> tuple[Integers, Integers, Array, Array, tuple[Array, Array]]:
    """Return edges and owners, lengths, middles (3, E), and the dyads of both owners (3, 3, E)."""
    ends, owners = mesh.edges
    first, second = mesh.vertices[ends.T]
    side = second - first
    lengths = np.linalg.norm(side, axis=1)
    middle = (0.5 * (first + second)).T
    way = (side / lengths[:, None]).T
    # Each face runs anticlockwise: way × normal points out of it, for the second face back.
    one, other = mesh.normals[:, owners[:, 0]], mesh.normals[:, owners[:, 1]]
    dyads = (
        _dyads(one, np.cross(way, one, axis=0)),
        _dyads(other, np.cross(-way, other, axis=0)),
    )
    return ends, owners, lengths, middle, dyads


def _parts(mesh: Mesh) -> tuple[Part, ...]:
    ends, owners, lengths, middle, (one, other) = _half_edges(mesh)
    of_edges = 2.0 * _matrix(one + other, middle)
    of_faces = _of_faces(mesh)
    parts = []
    for start in range(0, len(mesh.faces), _FACES):
        here = slice(start, start + _FACES)
        mine = (owners[:, 0] >= start) & (owners[:, 0] < start + _FACES)
        parts.append(
            Part(
                (np.ascontiguousarray(ends[mine, 0]), np.ascontiguousarray(ends[mine, 1])),
                lengths[mine, None],
                np.ascontiguousarray(of_edges[:, mine]),
                *of_faces.take(here, mesh.faces[here]),
            )
        )
    return tuple(parts)


def _matrix(dyads: Array, places: Array) -> Array:
    """Return the eleven rows (11, M) of symmetric dyads D (3, 3, M) at places m (3, M).

    m·Dm, Dm, the six elements of D, and its trace.
    """
    arm = np.einsum("ijM,jM->iM", dyads, places)
    elements = [dyads[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    trace = np.einsum("iiM->M", dyads)
    return np.array([np.sum(places * arm, axis=0), *arm, *elements, trace])


def _dyads(a: Array, b: Array) -> Array:
    """Return the symmetric parts of the dyads of columns (3, M), shape (3, 3, M)."""
    product = a[:, None, :] * b[None, :, :]
    return np.asarray(0.5 * (product + product.swapaxes(0, 1)))


def _half_logarithms(part: Part, distances: Array) -> Array:
    """Return ½ ln((a+b+e)/(a+b−e)) = artanh(e/(a+b)) of the edges (E, N) of a part."""
    first, second = part.ends
    ratio = distances.take(first, axis=0)
    ratio += distances.take(second, axis=0)
    np.divide(part.lengths, ratio, out=ratio)
    np.minimum(ratio, _BELOW_ONE, out=ratio)
    return np.arctanh(ratio, out=ratio)


def _half_angles(part: Part, distances: Array, r: Array) -> Array:
    """Return half the signed solid angles (F, N) of the faces of a part."""
    d1, d2, d3 = (distances.take(i, axis=0) for i in part.corners)
    denominator = d1 + d2
    pair = d2 + d3
    denominator *= pair
    np.add(d3, d1, out=pair)
    denominator *= pair
    for distance, square in zip((d1, d2, d3), part.squares, strict=True):
        distance *= square
        denominator -= distance
    numerator = np.matmul(part.normals, r, out=pair)
    np.subtract(part.heights, numerator, out=numerator)
    # arctan takes a third of the time of arctan2, and serves where the denominator is positive:
    # everywhere but near the surface
    if denominator.min(initial=1.0) > 0.0:
        numerator /= denominator
        return np.arctan(numerator, out=numerator)
    near = ~(denominator > 0.0)
    angles = np.arctan(numerator / np.where(near, 1.0, denominator))
    angles[near] = np.arctan2(numerator[near], denominator[near])
    return np.asarray(angles)
