"""Starts of Newton's iteration for members between known ones.

Each known member comes with the derivatives of its equations, so that the tangent of its family is
known too. Four members and their tangents determine a polynomial of degree seven along the family;
its error is a few digits smaller than that of a cubic, which saves an evaluation of half an orbit
with its matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["null_vectors", "predict_members"]

_NODES = 4
"""Known members of one prediction. With more, the unequal distances of a branch's members let the
polynomial oscillate, and rounding in their tangents counts for more."""
_LEAST_COSINE = 0.5
"""Of the angle between a tangent and the plane's normal. Beyond 60° the family hardly passes
through the plane, and distance from it is no parameter along the family."""
_FARTHEST = 0.1
"""Largest distance of a prediction from the guess, in distances of the two nearest members. The
guess lies far nearer than that; where the known members lie on two curves, the polynomial does
not."""


def null_vectors(slopes: Array) -> Array:
    """Return unit tangents (m, N), of either sense, from dF/dz (m − 1, m, N)."""
    # the right singular vector of the smallest singular value spans the null space
    return np.asarray(np.linalg.svd(np.moveaxis(slopes, 2, 0))[2][:, -1, :].T)


def predict_members(
    known: tuple[NDArray[np.intp], Array, Array, Array],
    wanted: tuple[NDArray[np.intp], Array],
    guess: Array,
    normals: Array,
) -> Array:
    """Predict where families pass through planes.

    Parameters
    ----------
    known : tuple of ndarray, shapes (K,), (K,), (m, K), (m, K)
        Numbers of families, positions along them, members there and tangents, by family and
        position. Tangents may have either sense.
    wanted : tuple of ndarray, shapes (N,), (N,)
        Numbers of families and positions along them.
    guess, normals : ndarray, shape (m, N)
        A point of each plane, near the family, and the plane's unit normal.

    Returns
    -------
    ndarray, shape (m, N)
        Points of the planes; the guess where the known members determine no better one.
    """
    made = guess.copy()
    for f in np.unique(wanted[0]):
        own, lanes = np.flatnonzero(known[0] == f), np.flatnonzero(wanted[0] == f)
        count = min(_NODES, own.size)
        if count < 2:
            continue
        after = np.searchsorted(known[1][own], wanted[1][lanes])
        first = np.clip(after - count // 2, 0, own.size - count)
        nodes = own[first + np.arange(count)[:, None]]  # (count, lanes)
        z, tangent = known[2][:, nodes], known[3][:, nodes]
        normal, point = normals[:, lanes], guess[:, lanes]
        # the distance from the plane is the parameter: the prediction is where it vanishes
        s = np.einsum("ik,ijk->jk", normal, z - point[:, None])
        cosine = np.einsum("ik,ijk->jk", normal, tangent)
        with np.errstate(divide="ignore", invalid="ignore"):
            place = _interpolate_at_zero(s, z, tangent / cosine)
        step = np.diff(s, axis=0)
        inner = np.clip(after - 1 - first, 0, count - 2)
        size = np.abs(step[inner, np.arange(lanes.size)])
        # NaN compares as false and keeps the guess
        good = np.all(step * step[0] > 0.0, axis=0) & np.all(np.abs(cosine) > _LEAST_COSINE, axis=0)
        good &= np.linalg.norm(place - point, axis=0) <= _FARTHEST * size
        made[:, lanes[good]] = place[:, good]
    return made


def _interpolate_at_zero(s: Array, z: Array, slope: Array) -> Array:
    """Return at s = 0 the polynomials through z (m, K, N) with slopes dz/ds at s (K, N).

    Hermite's interpolation by Newton's divided differences: every node counts twice, and the first
    difference between both is the slope.
    """
    node, row = np.repeat(s, 2, axis=0), np.repeat(z, 2, axis=1)
    value, factor = row[:, 0].copy(), np.ones_like(node[0])
    for order in range(1, len(node)):
        row = np.diff(row, axis=1) / (node[order:] - node[:-order])
        if order == 1:
            row[:, ::2] = slope
        factor = factor * -node[order - 1]
        value += factor * row[:, 0]
    return value
