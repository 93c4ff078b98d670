"""Gravity of a polyhedron with many faces: series of distant clusters, exact sums of near ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil, log10

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.model.shapes.mesh import Mesh
from hillsphere_gravity.mesh_harmonics import gauss_on_triangle
from hillsphere_gravity.polyhedron_sums import OpenPart, OpenParts, Sums
from hillsphere_gravity.solid_harmonics import (
    Complex,
    differentiate_irregular,
    differentiate_regular,
    irregular_harmonics,
    pack,
    regular_harmonics,
    unpack,
)
from hillsphere_gravity.surface_clusters import make_clusters

__all__ = ["Choice", "Pairs", "PolyhedronTree"]

_DEGREE_AT_ONE, _DEGREE_PER_DIGIT = 4.0, 1.8
"""Degree of the series: 15 for an error of 1e-6, 26 for 1e-12. Higher degrees serve from nearer on,
so that fewer clusters are needed, each at a cost of the square of the degree; the product is flat
about its least, where the degree is about 2 ln(1/e) for clusters of a surface."""
_LEAST_LEAF = 16
"""Faces of a cluster that is not divided, at least."""
_POINTS = 16_384
"""Points whose clusters are chosen at once: 100 to 200 MB for them and what their series give."""
_PAIRS = 128
"""Pairs of a cluster and a point whose harmonics are computed at once, to stay in the cache."""
_LANES = 8
"""Columns of which the products of BLAS are computed alike wherever they stand (AVX-512)."""
_REMEMBERED = 4096
"""Most points whose clusters are kept, as of `PolyhedronSums`."""
_POTENTIAL, _PULL, _GRADIENT = slice(0, 2), slice(1, 8), slice(8, 14)
"""Rows of a cluster: H₁; H₂, ∇H₂, ∇H₁; then the six elements of the gradient."""
_ELEMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Those of a symmetric matrix, in the order of `Sums`."""


class PolyhedronTree:
    r"""The sums over faces with distant clusters of faces replaced by series.

    The potential is a sum over faces, :math:`U=\tfrac12\sum_f h_f\Phi_f` for Gρ = 1, see
    `OpenParts`. That of a cluster is biharmonic, and about its centre

    .. math::

        U_C = H_1(\rho) + \rho^2 H_2(\rho), \qquad
        H_1 = \sum_{n,m} \frac{I_n^m(\rho)}{2(2n+3)}\int_C n\cdot\nabla(|y|^2\overline{R_n^m})\,dS,
        \qquad
        H_2 = -\sum_{n,m} \frac{I_n^m(\rho)}{2(2n-1)}\int_C n\cdot\nabla\overline{R_n^m}\,dS

    with the harmonics of `hillsphere_gravity.solid_harmonics`, because
    :math:`h\,/|y-\rho| = n\cdot\nabla_y|y-\rho|`. The integrals over faces are computed by
    Gauss's rule, whose error is part of the bound. Of the whole surface, which is closed, H₂
    vanishes.

    The acceleration is the exact derivative of this potential, and of that of the near faces. The
    gradient is the sum of :math:`-n\nabla\Phi_f`, made symmetric, of series of the single layers,
    which is the second derivative of the exact potential.

    Parameters
    ----------
    mesh : Mesh
        F faces.
    relative_error : float
        Bound of what the series leave out: of GM/s of the potential, GM/s² of the acceleration and
        GM/s³ of the gradient at the distance r from the origin, with s = max(r, R) and the distance
        R of the farthest vertex. See `make_clusters`.
    """

    def __init__(self, mesh: Mesh, relative_error: float) -> None:
        self._mesh = mesh
        self.unit = mesh.largest_radius_m
        self.degree = ceil(_DEGREE_AT_ONE - _DEGREE_PER_DIGIT * log10(relative_error))
        # summing a leaf's faces is as dear as the series of a few clusters
        leaf = max(_LEAST_LEAF, (self.degree + 2) ** 2 // 6)
        self._clusters = make_clusters(mesh, leaf, self.degree, relative_error)
        count = len(self._clusters.first)
        self._rows = np.empty((count, 14, (self.degree + 2) ** 2))
        self._is_made = np.zeros(count, dtype=bool)
        self._parts: dict[int, OpenPart] = {}
        self._last = _Field(self, np.empty((3, 0)))

    def __call__(self, r: Array) -> _Field:
        """Return the field at points r (3, N), m; the clusters of the last points are kept."""
        last = self._last
        if not np.array_equal(last.r, r):
            last = _Field(self, r.copy())
            if r.shape[1] <= _REMEMBERED:
                self._last = last
        return last

    def choose(self, r: Array) -> Choice:
        """Return which clusters serve for points r (3, N), m."""
        clusters = self._clusters
        place = r / self.unit
        # the terms fall at least as (p + 3)-rd powers where GM/s³ falls as the third
        farther = np.maximum(np.sum(place * place, axis=0), 1.0) ** (3.0 / (self.degree + 3))
        squares = clusters.distances**2
        cluster = np.zeros(r.shape[1], dtype=np.intp)
        point = np.arange(r.shape[1])
        far: list[tuple[Integers, Integers]] = []
        near: list[tuple[Integers, Integers]] = []
        while cluster.size:
            way = place.take(point, axis=1)
            way -= clusters.centres.take(cluster, axis=1)
            way *= way
            is_far = way.sum(axis=0) >= squares[cluster] * farther[point]
            far.append((cluster[is_far], point[is_far]))
            cluster, point = cluster[~is_far], point[~is_far]
            children = clusters.children[cluster]
            is_leaf = children[:, 0] < 0
            near.append((cluster[is_leaf], point[is_leaf]))
            cluster = children[~is_leaf].T.ravel()
            point = np.tile(point[~is_leaf], 2)
        return Choice(Pairs.of(far), Pairs.of(near))

    def series(self, choice: Choice, r: Array, rows: slice) -> tuple[Array, Array]:
        """Return rows (·, P) of the series of P pairs, and the vectors (3, P) from their centres.

        The unit of length is that of the clusters.
        """
        cluster, point, starts = choice.far.cluster, choice.far.point, choice.far.starts()
        self._make(cluster[starts])
        rho = (r / self.unit).take(point, axis=1)
        rho -= self._clusters.centres.take(cluster, axis=1)
        harmonics = irregular_harmonics(self.degree + 1)
        values = np.empty((rows.stop - rows.start, point.size))
        bounds = np.union1d(np.append(starts, point.size), np.arange(0, point.size, _PAIRS))
        terms = np.empty((3, 0))
        for begin, end in pairwise(bounds.tolist()):
            block = begin - begin % _PAIRS
            if begin == block:
                terms = harmonics(rho[:, block : block + _PAIRS])
            here = terms[:, begin - block : end - block]
            values[:, begin:end] = self._rows[cluster[begin], rows] @ here
        return values, rho

    def near(self, choice: Choice, r: Array) -> Array:
        """Return the rows (11, N) of `Sums` of all near faces."""
        total = np.zeros((11, r.shape[1]))
        near = choice.near
        for begin, end in pairwise([*near.starts().tolist(), near.point.size]):
            some = near.point[begin:end]
            rows = self._part(int(near.cluster[begin])).rows(r[:, some])
            count = end - begin - int(near.is_extra[end - _LANES : end].sum())
            total[:, some[:count]] += rows[:, :count]
        return total

    def _part(self, cluster: int) -> OpenPart:
        if cluster not in self._parts:
            self._parts[cluster] = self._open_parts.part(self._faces_of(cluster))
        return self._parts[cluster]

    @cached_property
    def _open_parts(self) -> OpenParts:
        return OpenParts(self._mesh)

    def _faces_of(self, cluster: int) -> Integers:
        tree = self._clusters
        return tree.order[tree.first[cluster] : tree.last[cluster]]

    def _make(self, clusters: Integers) -> None:
        """Compute the coefficients of those clusters that have none yet."""
        needed = clusters[~self._is_made[clusters]]
        for first in range(0, needed.size, 64):
            some = needed[first : first + 64]
            self._rows[some] = _rows_of(
                unpack(np.array([self._moments(int(k)) for k in some])),
                is_closed=some == 0,
            )
            self._is_made[some] = True

    def _moments(self, cluster: int) -> Array:
        """Return ∫ R over a cluster, times n, |y|² n and the height h: (7, (p + 1)²)."""
        faces = self._faces_of(cluster)
        a, b, c = (
            corner[:, faces] / self.unit - self._clusters.centres[:, cluster, None]
            for corner in self._mesh.corners
        )
        u, v, weights = gauss_on_triangle(int(self._clusters.nodes[cluster]))
        y = a[:, None] + (b - a)[:, None] * u[:, None] + (c - a)[:, None] * v[:, None]
        areas = 0.5 * self._mesh.doubled_areas[faces] / self.unit**2
        normals = self._mesh.normals[:, faces]
        heights = np.sum(normals * a, axis=0)
        squares = np.sum(y * y, axis=0)
        factors = np.empty((7, *squares.shape))
        factors[:3] = normals[:, None]
        factors[3:6] = normals[:, None] * squares
        factors[6] = heights
        factors *= weights[:, None] * areas
        moments = np.zeros((7, (self.degree + 1) ** 2))
        y, factors = y.reshape(3, -1), factors.reshape(7, -1)
        harmonics = regular_harmonics(self.degree)
        for first in range(0, y.shape[1], _PAIRS):
            some = slice(first, first + _PAIRS)
            moments += factors[:, some] @ harmonics(y[:, some]).T
        return moments


@dataclass(frozen=True)
class Pairs:
    """Pairs of a cluster and a point, those of each cluster beside each other.

    Their number is a multiple of eight for each cluster, by repetition of the last: BLAS adds in
    another order for columns beyond that, and the bits of a point would depend on its neighbours.
    """

    cluster: Integers
    point: Integers
    is_extra: NDArray[np.bool_]

    @classmethod
    def of(cls, pairs: list[tuple[Integers, Integers]]) -> Pairs:
        """Return pairs in order."""
        cluster = np.concatenate([one for one, _ in pairs])
        order = np.argsort(cluster, kind="stable")
        cluster = cluster[order]
        point = np.concatenate([other for _, other in pairs])[order]
        starts = np.flatnonzero(np.diff(cluster, prepend=-1))
        counts = np.diff(starts, append=cluster.size)
        widths = -(-counts // _LANES) * _LANES
        place = np.arange(widths.sum()) - np.repeat(np.cumsum(widths) - widths, widths)
        counted = np.repeat(counts, widths)
        some = np.repeat(starts, widths) + np.minimum(place, counted - 1)
        return cls(cluster[some], point[some], place >= counted)

    def starts(self) -> Integers:
        """Return where another cluster begins."""
        return np.flatnonzero(np.diff(self.cluster, prepend=-1))


@dataclass(frozen=True)
class Choice:
    """Pairs whose series serves, and pairs of a leaf and a point whose faces are summed."""

    far: Pairs
    near: Pairs


class _Field:
    """The field at points; quantities for Gρ = 1, as of `Sums`."""

    def __init__(self, tree: PolyhedronTree, r: Array) -> None:
        self.r = r
        self._tree = tree
        self._blocks = [slice(k, k + _POINTS) for k in range(0, r.shape[1], _POINTS)]

    @cached_property
    def _choices(self) -> list[Choice]:
        return [self._tree.choose(self.r[:, some]) for some in self._blocks]

    @cached_property
    def _near(self) -> list[Sums]:
        return [
            Sums(self.r[:, some], self._tree.near(choice, self.r[:, some]))
            for some, choice in zip(self._blocks, self._choices, strict=True)
        ]

    def potential(self) -> Array:
        """Return U (N,), m²."""
        parts = [np.empty(0)]
        for some, choice, near in zip(self._blocks, self._choices, self._near, strict=True):
            (first, second), rho = self._tree.series(choice, self.r[:, some], _POTENTIAL)
            second *= np.sum(rho * rho, axis=0)
            total = _sum_up((first + second)[None], choice, near.r.shape[1])[0]
            parts.append(near.potential() + self._tree.unit**2 * total)
        return np.concatenate(parts)

    def acceleration(self) -> Array:
        """Return ∇U (3, N), m."""
        parts = [np.empty((3, 0))]
        for some, choice, near in zip(self._blocks, self._choices, self._near, strict=True):
            rows, rho = self._tree.series(choice, self.r[:, some], _PULL)
            # ∇(H₁ + ρ²H₂)
            rows[1:4] *= np.sum(rho * rho, axis=0)
            rows[4:] += rows[1:4] + 2.0 * rows[0] * rho
            total = _sum_up(rows[4:], choice, near.r.shape[1])
            parts.append(near.acceleration() + self._tree.unit * total)
        return np.concatenate(parts, axis=1)

    def gradient(self) -> Array:
        """Return ∇∇U (3, 3, N)."""
        parts = [np.empty((3, 3, 0))]
        for some, choice, near in zip(self._blocks, self._choices, self._near, strict=True):
            rows, _ = self._tree.series(choice, self.r[:, some], _GRADIENT)
            far = np.zeros((11, near.r.shape[1]))
            far[4:10] = _sum_up(rows, choice, near.r.shape[1])
            parts.append(near.gradient() + Sums(near.r, far).gradient())
        return np.concatenate(parts, axis=2)

    def laplacian(self) -> Array:
        """Return ∇²U (N,)."""
        return np.asarray(np.einsum("iiN->N", self.gradient()))


def _sum_up(values: Array, choice: Choice, points: int) -> Array:
    """Return the sums (·, N) over the pairs of each point, of values (·, P)."""
    pairs = choice.far
    values[:, pairs.is_extra] = 0.0
    return np.array([np.bincount(pairs.point, row, minlength=points) for row in values])


def _rows_of(moments: Complex, is_closed: NDArray[np.bool_]) -> Array:
    """Return the rows (C, 14, (p + 2)²) of clusters from their moments (C, 7, p + 1, p + 1)."""
    layers, weighted, heights = moments[:, :3], moments[:, 3:6], moments[:, 6]
    n = np.arange(moments.shape[-1])[:, None]
    flux = differentiate_regular(np.moveaxis(layers, 1, 0))
    first = 2.0 * heights + differentiate_regular(np.moveaxis(weighted, 1, 0))
    first /= 2.0 * (2 * n + 3)
    second = -flux / (2.0 * (2 * n - 1))
    # what vanishes for the whole surface, but for rounding that grows with the distance
    second[is_closed] = 0.0
    layers[is_closed, :, 0, 0] = 0.0
    pull, shear = differentiate_irregular(first), differentiate_irregular(second)
    slopes = differentiate_irregular(np.moveaxis(layers, 1, 0))
    elements = [-0.5 * (slopes[j, i] + slopes[i, j]) for i, j in _ELEMENTS]
    wide = np.zeros((2, *pull.shape[1:]), dtype=complex)
    wide[0, :, :-1, :-1], wide[1, :, :-1, :-1] = first, second
    return pack(np.stack([*wide, *shear, *pull, *elements], axis=1))
