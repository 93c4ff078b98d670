"""A mesh divided into clusters of faces, and how far away each may be seen as a series."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.model.shapes.mesh import Mesh

__all__ = ["Clusters", "make_clusters"]

_LARGEST_RATIO = 0.7
"""Largest ratio of a cluster's radius to the distance of a point for which its series is taken: the
tail is summed up to this, and where the bound needs less it decides."""
_RATIOS = 281
"""Ratios for which the bound of a tail is tabulated, 0.0025 apart."""
_QUADRATURE = 0.01
"""Part of the error that is left to the integrals over faces."""
_TAIL = 400
"""Degrees of a tail that are summed: the rest, 0.7 to the power 400, is below all rounding."""


@dataclass(frozen=True)
class Clusters:
    r"""A binary tree of clusters of faces; lengths in units of the body's largest radius R.

    Parameters
    ----------
    order : ndarray of int, shape (F,)
        Faces, those of each cluster beside each other.
    first, last : ndarray of int, shape (C,)
        Places in `order` where the faces of a cluster begin and end. Cluster 0 is the whole.
    children : ndarray of int, shape (C, 2)
        Clusters into which one is divided; −1 for a leaf.
    centres : ndarray, shape (3, C)
        About which the series are expanded.
    radii : ndarray, shape (C,)
        Distances of the farthest corners from them.
    distances : ndarray, shape (C,)
        From which on the series of a cluster is accurate enough for points within the sphere of R;
        see `make_clusters`.
    nodes : ndarray of int, shape (C,)
        Points of Gauss's rule in each direction of a face with which the series are computed; what
        it errs by is a hundredth of the bound.
    """

    order: Integers
    first: Integers
    last: Integers
    children: Integers
    centres: Array
    radii: Array
    distances: Array
    nodes: Integers


def make_clusters(mesh: Mesh, leaf: int, degree: int, relative_error: float) -> Clusters:
    r"""Divide a mesh until clusters have few faces, and bound the error of their series.

    A cluster of area S contributes :math:`\tfrac12\int_S n\cdot\nabla_y|y-\rho|\,dS` to the
    potential for Gρ = 1, and

    .. math::

        |y-\rho| = \sum_n\Big(\frac{|y|^{n+2}}{2n+3}\frac1{\rho^{n+1}} -
        \frac{|y|^n}{2n-1}\frac1{\rho^{n-1}}\Big) P_n(\cos\gamma) .

    A homogeneous harmonic polynomial of degree n that is at most M on the unit sphere has there a
    gradient of at most nM: along each great circle it is a trigonometric polynomial, for which
    :math:`f'^2 + n^2f^2\le n^2M^2` [1]_. Likewise those of :math:`|y|^2` times it,
    of :math:`I_n` and of :math:`\rho^2 I_n` are at most (n + 2)M, (n + 1)M and nM. So the terms of
    degree n of the acceleration are, for each unit of area, at most

    .. math::

        \frac12\Big[\frac{(n+2)(n+1)}{2n+3}\frac{|y|^{n+1}}{\rho^{n+2}} +
        \frac{n^2}{2n-1}\frac{|y|^{n-1}}{\rho^n}\Big],

    those of the potential with one factor n + 1 or n and one power of ρ less, and those of the
    gradient, which is the derivative of the single layers of `hillsphere_gravity.polyhedron_tree`,
    :math:`(n+1)|y|^n/\rho^{n+2}`. With the mean of :math:`|y|^p` over the cluster and its radius a,
    the mean of :math:`|y|^n` is at most :math:`a^{n-p}` times that. The distance is where the sum
    over all n > p, p being the degree of the series, is the cluster's share, by its area, of
    ``relative_error`` times V/s, V/s² and V/s³, with s = max(r, R) and the volume V.

    Parameters
    ----------
    mesh : Mesh
        F faces.
    leaf : int
        Most faces of a cluster that is not divided.
    degree : int
        p, of the series; at least 3.
    relative_error : float
        Of all clusters together.

    Returns
    -------
    Clusters
        Those of R = `mesh.largest_radius_m`.

    References
    ----------
    .. [1] G. Szegő (1928), Über einen Satz des Herrn Serge Bernstein, Schriften der Königsberger
       Gelehrten Gesellschaft 5(4), 59-70.
    """
    unit = mesh.largest_radius_m
    corners = mesh.corners / unit
    a, b, c = corners
    sides = np.sqrt(np.max([np.sum(s * s, axis=0) for s in (b - a, c - b, a - c)], axis=0))
    order, first, last, children = _divide(corners.mean(axis=0), leaf)
    corners, sides = corners[:, :, order], sides[order]
    areas = 0.5 * mesh.doubled_areas[order] / unit**2
    lows, highs = corners.min(axis=0), corners.max(axis=0)
    count = len(first)
    centres = np.empty((3, count))
    radii, means, longest = np.empty((3, count))
    for k, (start, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        here = slice(start, end)
        centre = 0.5 * (lows[:, here].min(axis=1) + highs[:, here].max(axis=1))
        reach = np.sqrt(np.sum((corners[:, :, here] - centre[:, None]) ** 2, axis=1))
        centres[:, k], radii[k] = centre, reach.max()
        longest[k] = sides[here].max()
        # the mean over a face is at most that of the corners: |y| to a power is convex
        share = areas[here]
        power = np.mean((reach / radii[k]) ** degree, axis=0)
        means[k] = (power @ share) / share.sum()
    allowed = relative_error * (mesh.volume_m3 / unit**3) / areas.sum()
    distances = _distances(radii, means, degree, (1.0 - _QUADRATURE) * allowed)
    # The rule is exact for the lowest degrees; what it errs by falls at least as GM/s³, so that the
    # least distance is the worst. That of the potential is at most ρ, that of the gradient at most
    # 4/ρ times that of the acceleration, term by term.
    near = np.where(np.isfinite(distances), distances, 1.0)
    farthest = np.maximum(1.0, near + np.linalg.norm(centres, axis=0))
    share = np.minimum(1.0, np.minimum(0.25 * near, 1.0 / near)) / farthest**3
    nodes = _count_nodes(
        0.5 * longest / radii, radii / distances, degree, _QUADRATURE * allowed * share * near
    )
    return Clusters(order, first, last, children, centres, radii, distances, nodes)


def _divide(middles: Array, leaf: int) -> tuple[Integers, Integers, Integers, Integers]:
    """Return order, first, last and children: halves along the longest side of the middles' box."""
    order = np.arange(middles.shape[1])
    spans, children = [(0, len(order))], []
    for start, end in spans:  # grows
        if end - start <= leaf:
            children.append((-1, -1))
            continue
        some = order[start:end]
        here = middles[:, some]
        axis = int(np.argmax(np.ptp(here, axis=1)))
        half = (end - start) // 2
        order[start:end] = some[np.argpartition(here[axis], half)]
        children.append((len(spans), len(spans) + 1))
        spans += [(start, start + half), (start + half, end)]
    first, last = np.array(spans).T
    return order, first, last, np.array(children)


def _distances(radii: Array, means: Array, degree: int, allowed: float) -> Array:
    """Return from which distances the tails are below a share, see `make_clusters`."""
    p = degree
    n = np.arange(p + 1, p + 1 + _TAIL, dtype=float)[:, None]
    x = np.linspace(0.0, _LARGEST_RATIO, _RATIOS)[1:]
    inner, outer = x ** (n - p + 1), x ** (n - p - 1)
    # each times the mean of |y/a|^p and x^p; then over a power of the distance, in units of a
    potential = 0.5 * np.sum((n + 2) / (2 * n + 3) * inner + n / (2 * n - 1) * outer, axis=0)
    pull = 0.5 * np.sum(
        (n + 2) * (n + 1) / (2 * n + 3) * inner + n * n / (2 * n - 1) * outer, axis=0
    )
    gradient = np.sum((n + 1) * x ** (n - p), axis=0)
    base = means[:, None] * x**p
    ratio = x / radii[:, None]
    met = (
        (base * potential <= allowed)
        & (base * ratio * pull <= allowed)
        & (base * ratio**2 * gradient <= allowed)
    )
    # all rise with x: the last that is met
    count = met.sum(axis=1)
    return np.where(count > 0, radii / x[np.maximum(count - 1, 0)], np.inf)


def _count_nodes(half_sides: Array, ratios: Array, degree: int, allowed: Array) -> Integers:
    r"""Return how many points of Gauss's rule serve in each direction of the faces of clusters.

    On a side of half the length h, radii of the cluster, a homogeneous harmonic polynomial of
    degree n is at most (1 + hz)ⁿ times its bound on the sphere where its argument is in the ellipse
    of Bernstein with the semi-axes' sum z, see `hillsphere_gravity.mesh_harmonics`, and so are its
    gradient and the terms of `make_clusters`. Their sum over all degrees of the series bounds the
    error of the rule with k points: 128/15 of it over z^{2k} (1 − z⁻²).

    Parameters
    ----------
    half_sides : ndarray, shape (C,)
        h.
    ratios : ndarray, shape (C,)
        Of the radii to the least distances of points; 0 for clusters that have no series.
    degree : int
        p.
    allowed : ndarray, shape (C,)
        Error of the acceleration for each unit of area, over the distance.

    Returns
    -------
    ndarray of int, shape (C,)
        At most as many as are exact for polynomials.
    """
    exact = degree // 2 + 2
    z = np.geomspace(1.5, 1e4, 60)
    reach = ratios[:, None] * (1.0 + half_sides[:, None] * z)
    total = np.zeros_like(reach)
    for n in range(degree + 1):
        total += (n + 2) * (n + 1) / (4 * n + 6) * reach ** (n + 1)
        if n:
            total += n * n / (4 * n - 2) * reach ** (n - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.log(128.0 / 15.0 * total / (1.0 - z**-2.0) / allowed[:, None])
        count = np.ceil(needed / (2.0 * np.log(z))).min(axis=1)
    return np.asarray(np.clip(np.nan_to_num(count, nan=exact), 1, exact).astype(np.int64))
