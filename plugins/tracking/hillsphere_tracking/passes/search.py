"""Intervals in which a smooth function of time is positive, including grazing ones.

Samples alone can miss a short interval between them. Each step between two samples is therefore
represented by the Hermite cubic through values and slopes at its ends; the misfit at the midpoint
measures the error of the cubic. A step is halved until the function provably keeps its sign, or has
at most one extremum. The extrema are then located, and the zeros between them are bracketed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.engine.dynamics.root_finding import bracketed_roots
from hillsphere.interfaces import Array

__all__ = [
    "Curve",
    "Function",
    "intersect_spans",
    "merge_spans",
    "positive_spans",
    "sample_curve",
    "zeros",
]

Function: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Function of times (N,), s, that returns values (N,) and time derivatives (N,)."""

_TOLERANCE_S = 1e-7
"""Accuracy (s) of zeros and extrema: a low satellite moves by 1 mm. Rounding of a sine of
elevation, 1e-16 over a slope of 1e-3/s, is far below it."""
_HALVINGS = 12
"""Halvings of a step at most: of a minute then 15 ms are left. A function that is not resolved
there touches zero for less than that, or is not smooth; without the limit it would be halved for
ever."""


@dataclass(frozen=True)
class Curve:
    """Samples of a function that include its extrema, so that it is monotonic between them.

    Parameters
    ----------
    t_s, value, slope : ndarray, shape (K,)
        Times in increasing order, values and derivatives.
    """

    t_s: Array
    value: Array
    slope: Array


def sample_curve(function: Function, times_s: Array) -> Curve:
    """Sample a function so that all its extrema near zero are among the samples.

    Parameters
    ----------
    function : callable
        Returns value and derivative at times.
    times_s : ndarray, shape (K,)
        Initial times in increasing order, K ≥ 2, with at most a few extrema between two of them.

    Returns
    -------
    Curve
        Samples with the extrema of the function. Extrema may be missing in steps throughout which
        the function is far from zero.
    """
    t = np.asarray(times_s, dtype=float)
    f, d = function(t)
    nodes = [(t, f, d)]
    a = np.array([t[:-1], f[:-1], d[:-1]])
    b = np.array([t[1:], f[1:], d[1:]])
    for _ in range(_HALVINGS):
        if a.shape[1] == 0:
            break
        middle = 0.5 * (a[0] + b[0])
        m = np.array([middle, *function(middle)])
        nodes.append((m[0], m[1], m[2]))
        h = b[0] - a[0]
        # misfit of the cubic and of its slope at the midpoint
        off = np.abs(m[1] - (0.5 * (a[1] + b[1]) + h * (a[2] - b[2]) / 8.0))
        off_slope = np.abs(m[2] - (1.5 * (b[1] - a[1]) / h - 0.25 * (a[2] + b[2])))
        # Both halves keep the misfit of the whole step, which is an upper estimate: halving reduces
        # the error of the cubic by 16 and the error of its slope by 8.
        a, b = np.concatenate([a, m], axis=1), np.concatenate([m, b], axis=1)
        open_ = ~_is_resolved(a, b, np.tile(off, 2), np.tile(off_slope, 2))
        a, b = a[:, open_], b[:, open_]
    t, f, d = (np.concatenate([node[i] for node in nodes]) for i in range(3))
    order = np.argsort(t, kind="stable")
    return _with_extrema(function, Curve(t[order], f[order], d[order]))


def _is_resolved(a: Array, b: Array, off: Array, off_slope: Array) -> NDArray[np.bool_]:
    """Return which steps need no further samples; rows of a, b are time, value and slope.

    A step is resolved if the cubic, with its error, keeps its sign (`far`), is monotonic, or has
    exactly one extremum.
    """
    h = b[0] - a[0]
    chord = (b[1] - a[1]) / h
    # Slope of the cubic at s in [0, 1]: d0 + c1 s + c2 s², whose extremum is at s = −c1/(2 c2).
    c1 = 6.0 * chord - 4.0 * a[2] - 2.0 * b[2]
    c2 = 3.0 * (a[2] + b[2]) - 6.0 * chord
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(np.abs(c2) > 0.0, -c1 / (2.0 * c2), 0.0)
    turn = np.clip(np.nan_to_num(turn), 0.0, 1.0)
    bend = a[2] + c1 * turn + c2 * turn**2
    steepest = np.max(np.abs([a[2], b[2], bend]), axis=0)
    # Within the step the cubic leaves the range of its end values by at most h/2 · max |slope|.
    reach = off + 0.5 * h * steepest
    low, high = np.minimum(a[1], b[1]) - reach, np.maximum(a[1], b[1]) + reach
    far = (low > 0.0) | (high < 0.0)
    signs = np.sign([a[2], b[2], bend])
    sure = np.min(np.abs([a[2], b[2], bend]), axis=0) > off_slope
    monotone = sure & (np.abs(signs.sum(axis=0)) == 3.0)
    # One extremum: the slopes at the ends differ in sign, and the slope is nearly linear in between
    # (c2 small against c1) and accurate to 5 % of its change.
    one_turn = (signs[0] != signs[1]) & (np.abs(c2) < 0.5 * np.abs(c1)) & (
        off_slope < 0.05 * np.abs(b[2] - a[2])
    )  # fmt: skip
    return np.asarray(far | monotone | one_turn)


def _with_extrema(function: Function, known: Curve) -> Curve:
    t, f, d = known.t_s, known.value, known.slope
    # extrema: zeros of the derivative between samples with slopes of different sign
    turns = np.flatnonzero(d[:-1] * d[1:] < 0.0)
    if turns.size == 0:
        return known
    when = bracketed_roots(
        lambda s: function(s)[1],
        t[turns], t[turns + 1], d[turns], d[turns + 1], np.full(turns.size, _TOLERANCE_S),
    )  # fmt: skip
    value, slope = function(when)
    return Curve(
        np.insert(t, turns + 1, when), np.insert(f, turns + 1, value),
        np.insert(d, turns + 1, slope),
    )  # fmt: skip


def zeros(function: Function, known: Curve) -> Array:
    """Return the zeros of a function at which it changes sign.

    Parameters
    ----------
    function : callable
        Returns value and derivative at times.
    known : Curve
        Samples of the same function, from `sample_curve`.

    Returns
    -------
    ndarray, shape (M,)
        Times in increasing order, s, accurate to 1e-7 s or to the rounding error of the function
        divided by its slope, whichever is larger.
    """
    t, f = known.t_s, known.value
    up = f > 0.0
    change = np.flatnonzero(up[:-1] != up[1:])
    return bracketed_roots(
        lambda s: function(s)[0],
        t[change], t[change + 1], f[change], f[change + 1], np.full(change.size, _TOLERANCE_S),
    )  # fmt: skip


def positive_spans(function: Function, known: Curve) -> Array:
    """Return the intervals in which a function is positive.

    Parameters
    ----------
    function : callable
        Returns value and derivative at times.
    known : Curve
        Samples of the same function, from `sample_curve`.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s, with the accuracy of `zeros`. An interval that is under way at an
        end of the samples begins or ends there.
    """
    edges = zeros(function, known)
    if known.value[0] > 0.0:
        edges = np.concatenate([known.t_s[:1], edges])
    if known.value[-1] > 0.0:
        edges = np.concatenate([edges, known.t_s[-1:]])
    return edges.reshape(-1, 2).T


def intersect_spans(one: Array, other: Array) -> Array:
    """Return the intersection of two sets of intervals.

    Parameters
    ----------
    one, other : ndarray, shape (2, M) and (2, L)
        Beginnings and ends in increasing order; the intervals of a set do not overlap.

    Returns
    -------
    ndarray, shape (2, K)
        Intervals that belong to both sets, in increasing order.
    """
    begins = np.maximum(one[0][:, None], other[0][None, :])
    ends = np.minimum(one[1][:, None], other[1][None, :])
    there = ends > begins
    return np.array([begins[there], ends[there]])


def merge_spans(spans: Array, gap_s: float = 1e-6) -> Array:
    """Merge adjacent intervals.

    Parameters
    ----------
    spans : ndarray, shape (2, M)
        Beginnings and ends in increasing order.
    gap_s : float
        Largest gap that is closed.

    Returns
    -------
    ndarray, shape (2, K)
        Merged intervals in increasing order.
    """
    if spans.shape[1] < 2:
        return spans
    apart = spans[0, 1:] - spans[1, :-1] > gap_s
    return np.array(
        [spans[0][np.concatenate([[True], apart])], spans[1][np.concatenate([apart, [True]])]]
    )
