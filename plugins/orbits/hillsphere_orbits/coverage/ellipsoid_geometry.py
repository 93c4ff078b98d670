"""Geometry of a tri-axial ellipsoid: the nearest point, its normal, areas, rays that meet it.

Positions are body-fixed, (3, …), along the semi-axes (a, b, c).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = ["cell_areas", "is_hidden", "nearest_point", "normals"]

_MOST = 60
"""Most steps of Newton's method. It starts within a factor √3 of the root and rises to it, so that
a handful are enough; the bound only excludes an endless loop."""
_NODES = 8
"""Gauss-Legendre nodes of a cell in each direction: exact for polynomials of degree 15, so that
areas of cells of a few degrees are right to rounding."""


def nearest_point(r: Array, axes: Array) -> Array:
    """Return the points of the surface nearest to points on or outside it.

    The nearest point q has its normal along r − q, so that q_i = a_i² r_i/(a_i² + t) with the one
    t ≥ 0 for which q lies on the surface [1]_. That condition is a falling convex function of t:
    Newton's method from below the root climbs to it and never passes it.

    Parameters
    ----------
    r : ndarray, shape (3, N)
        Positions.
    axes : ndarray, shape (3,)
        Semi-axes, in the same unit.

    Returns
    -------
    ndarray, shape (3, N)
        Nearest points.

    Raises
    ------
    InputError
        If a point is inside, where the nearest one need not be the only one.

    References
    ----------
    .. [1] Eberly, D., Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid,
       Geometric Tools, 2013.
    """
    squares = (axes**2)[:, None]
    inside = np.sum(r * r / squares, axis=0) < 1.0 - 1e-12
    if inside.any():
        raise InputError(f"{np.count_nonzero(inside)} of {inside.size} points are inside the body")
    reach = axes[:, None] * r
    # each term alone is no more than the whole sum: where one is 1 the sum is 1 or more
    t = np.maximum(np.max(np.abs(reach) - squares, axis=0), 0.0)
    for _ in range(_MOST):
        # Σ (a_i r_i/(a_i² + t))² − 1 and half its slope, with the sign reversed
        part = reach / (squares + t)
        value = np.sum(part * part, axis=0) - 1.0
        step = 0.5 * value / np.sum(part * part / (squares + t), axis=0)
        t = t + np.maximum(step, 0.0)
        if np.all(step <= 4.0 * np.finfo(float).eps * (t + squares[0])):
            break
    return np.asarray(squares * r / (squares + t))


def normals(q: Array, axes: Array) -> Array:
    """Return the outward unit normals (3, N) at points of the surface."""
    out = q / (axes**2)[:, None]
    return np.asarray(out / np.linalg.norm(out, axis=0))


def is_hidden(r: Array, direction: Array, axes: Array) -> NDArray[np.bool_]:
    """Whether the body stands before something infinitely far away.

    Parameters
    ----------
    r : ndarray, shape (3, N)
        Positions outside.
    direction : ndarray, shape (3, N, K)
        Unit vectors to it.
    axes : ndarray, shape (3,)
        Semi-axes.

    Returns
    -------
    ndarray of bool, shape (N, K)
        Exact: stretched to a unit sphere, the ray meets it ahead.
    """
    p, d = r / axes[:, None], direction / axes[:, None, None]
    along = np.einsum("in,ink->nk", p, d)
    gap = np.sum(p * p, axis=0)[:, None] - 1.0
    return np.asarray((along < 0.0) & (along**2 >= gap * np.sum(d * d, axis=0)))


def cell_areas(latitudes: Array, longitudes: Array, axes: Array) -> Array:
    """Return the parts of the surface in cells of planetocentric latitude and longitude.

    Parameters
    ----------
    latitudes, longitudes : ndarray, shape (B + 1,), (L + 1,)
        Edges in rising order, rad, close enough (tens of degrees) for a rule of eight nodes.
    axes : ndarray, shape (3,)
        Semi-axes.

    Returns
    -------
    ndarray, shape (B, L)
        Areas in the unit of the axes squared. What the solid angle dω in the direction u sees of
        the surface is r² dω/(n·u), with the radius r and the normal n there.
    """
    # in sin(latitude) the solid angle is even
    z, along = _nodes(np.sin(latitudes))
    turn, across = _nodes(longitudes)
    ring = np.sqrt(1.0 - z * z)
    u = np.array(
        [np.outer(ring, np.cos(turn)), np.outer(ring, np.sin(turn)),
         np.repeat(z[:, None], turn.size, axis=1)]
    )  # fmt: skip
    normal = u / (axes**2)[:, None, None]
    square = 1.0 / np.sum(u * normal, axis=0)  # the radius squared
    lean = np.sum(u * normal, axis=0) / np.sqrt(np.sum(normal * normal, axis=0))
    area = np.outer(along, across) * square / lean
    return np.asarray(area.reshape(latitudes.size - 1, _NODES, -1, _NODES).sum(axis=(1, 3)))


def _nodes(edges: Array) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes and weights of each interval in turn, (K·8,)."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    half = 0.5 * np.diff(edges)[:, None]
    middle = 0.5 * (edges[1:] + edges[:-1])[:, None]
    return (middle + half * nodes).ravel(), (half * weights).ravel()
