"""Largest values of polynomials between the ends of sub-steps, by Bernstein control points."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array, Integers

__all__ = ["hermite_points", "largest_square", "slope_points"]

_CLOSE = 1e-10
"""Relative difference of squares to which a maximum is found: 5e-11 of the value itself."""

_HALVINGS = 40
"""Halvings at most. The gap between a cubic and its control points shrinks fourfold with every
halving, so that some 17 halvings reach `_CLOSE`; after 40 an interval is as short as rounding."""


def hermite_points(r0: Array, v0: Array, r1: Array, v1: Array, h: Array) -> Array:
    """Return the Bernstein control points (4, ...) of the cubic with these ends and slopes.

    Parameters
    ----------
    r0, v0, r1, v1 : ndarray, shape (...)
        Values and rates at the start and at the end.
    h : ndarray, shape (...)
        Time between them.
    """
    third = h / 3.0
    return np.array([r0, r0 + third * v0, r1 - third * v1, r1])


def slope_points(points: Array, v0: Array, v1: Array, h: Array) -> Array:
    """Return the control points (3, ...) of the slope of a cubic; its ends are given (...)."""
    inner = np.divide(3.0 * (points[2] - points[1]), h, out=0.5 * (v0 + v1), where=h > 0.0)
    return np.array([v0, inner, v1])


def largest_square(points: Array, lane: Integers, least: Array) -> Array:
    r"""Return the largest squared lengths of vector polynomials, by lane.

    Parameters
    ----------
    points : ndarray, shape (d + 1, axes, M)
        Bernstein control points of M vector polynomials on their intervals.
    lane : ndarray of int, shape (M,)
        Lane of each polynomial.
    least : ndarray, shape (B,)
        Lower bounds of the squares by lane, known beforehand.

    Returns
    -------
    ndarray, shape (B,)
        At least `least`.

    Notes
    -----
    A polynomial lies in the hull of its control points, so that none exceeds the largest of their
    norms. Intervals whose bound does not exceed what is reached already are dropped, the others
    halved by de Casteljau's algorithm (Farin, 2002, chapter 4).
    """
    best = least.copy()
    # Branch and bound: the end points are values of the polynomial and give lower bounds, the
    # largest control point gives the upper bound of an interval.
    for _ in range(_HALVINGS):
        if not lane.size:
            break
        squares = np.einsum("kam,kam->km", points, points)
        np.maximum.at(best, lane, np.maximum(squares[0], squares[-1]))
        left = squares.max(axis=0) > best[lane] * (1.0 + _CLOSE)
        points, lane = points[:, :, left], lane[left]
        # De Casteljau at 1/2: the first and the last points of each row of averages are the
        # control points of the two halves.
        halves, row = [points[0]], points
        other = [points[-1]]
        while len(row) > 1:
            row = 0.5 * (row[:-1] + row[1:])
            halves.append(row[0])
            other.append(row[-1])
        points = np.concatenate([np.array(halves), np.array(other[::-1])], axis=2)
        lane = np.concatenate([lane, lane])
    return best
