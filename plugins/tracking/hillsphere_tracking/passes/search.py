"""When a smooth function of time is positive: every interval, even a grazing one.

Samples alone miss what happens between them. Here each step between two samples is judged by the
cubic through values and slopes at its ends, with the middle as a check of how far the cubic can be
trusted; it is halved until the function is known to keep its sign or to turn at most once. Then the
extrema are found, and between them the zeros are bracketed.
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
"""Value (N,) and derivative (N,) at times (N,), s."""

_TOLERANCE_S = 1e-7
"""Accuracy (s) of zeros and extrema: a low satellite moves by 1 mm. Rounding of a sine of
elevation, 1e-16 over a slope of 1e-3/s, is far below it."""
_HALVINGS = 12
"""Halvings of a step at most: of a minute then 15 ms are left. A function that is not resolved
there touches zero for less than that, or is not smooth; without the limit it would be halved for
ever."""


@dataclass(frozen=True)
class Curve:
    """A function known at times between which it turns at no place but those times.

    Parameters
    ----------
    t_s, value, slope : ndarray, shape (K,)
        Times, rising, with the function's extrema among them.
    """

    t_s: Array
    value: Array
    slope: Array


def sample_curve(function: Function, times_s: Array) -> Curve:
    """Sample a function so that nothing happens between the samples.

    Parameters
    ----------
    function : callable
        Value and derivative at times.
    times_s : ndarray, shape (K,)
        Where to begin with, rising, K ≥ 2: close enough that the function bends a few times at most
        between two of them.

    Returns
    -------
    Curve
        With the extrema of the function; those where it is far from zero for as long as a whole
        step may be missing.
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
        off = np.abs(m[1] - (0.5 * (a[1] + b[1]) + h * (a[2] - b[2]) / 8.0))
        off_slope = np.abs(m[2] - (1.5 * (b[1] - a[1]) / h - 0.25 * (a[2] + b[2])))
        # the halves, each with the misfit of the whole, sixteen and eight times what to expect
        a, b = np.concatenate([a, m], axis=1), np.concatenate([m, b], axis=1)
        open_ = ~_is_resolved(a, b, np.tile(off, 2), np.tile(off_slope, 2))
        a, b = a[:, open_], b[:, open_]
    t, f, d = (np.concatenate([node[i] for node in nodes]) for i in range(3))
    order = np.argsort(t, kind="stable")
    return _with_extrema(function, Curve(t[order], f[order], d[order]))


def _is_resolved(a: Array, b: Array, off: Array, off_slope: Array) -> NDArray[np.bool_]:
    """Whether a step needs no further samples: rows of a, b are time, value, slope."""
    h = b[0] - a[0]
    chord = (b[1] - a[1]) / h
    # slope of the cubic at s in [0, 1]: d0 + c1 s + c2 s², extreme within at s*
    c1 = 6.0 * chord - 4.0 * a[2] - 2.0 * b[2]
    c2 = 3.0 * (a[2] + b[2]) - 6.0 * chord
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where(np.abs(c2) > 0.0, -c1 / (2.0 * c2), 0.0)
    turn = np.clip(np.nan_to_num(turn), 0.0, 1.0)
    bend = a[2] + c1 * turn + c2 * turn**2
    steepest = np.max(np.abs([a[2], b[2], bend]), axis=0)
    # how far the cubic can leave the chord's ends is bounded by slope and length
    reach = off + 0.5 * h * steepest
    low, high = np.minimum(a[1], b[1]) - reach, np.maximum(a[1], b[1]) + reach
    far = (low > 0.0) | (high < 0.0)
    signs = np.sign([a[2], b[2], bend])
    sure = np.min(np.abs([a[2], b[2], bend]), axis=0) > off_slope
    monotone = sure & (np.abs(signs.sum(axis=0)) == 3.0)
    # one turn: the slopes at the ends differ in sign, and the cubic's slope is nearly a line
    one_turn = (signs[0] != signs[1]) & (np.abs(c2) < 0.5 * np.abs(c1)) & (
        off_slope < 0.05 * np.abs(b[2] - a[2])
    )  # fmt: skip
    return np.asarray(far | monotone | one_turn)


def _with_extrema(function: Function, known: Curve) -> Curve:
    t, f, d = known.t_s, known.value, known.slope
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
    """Return where a function changes sign.

    Parameters
    ----------
    function : callable
        Value and derivative at times.
    known : Curve
        The same function as `sample_curve` gives it.

    Returns
    -------
    ndarray, shape (M,)
        Times, rising, s, to 1e-7 s (but rounding of the function over its slope).
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
        Value and derivative at times.
    known : Curve
        The same function as `sample_curve` gives it.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s, as precise as `zeros`; at the ends of the curve where the function
        is positive there.
    """
    edges = zeros(function, known)
    if known.value[0] > 0.0:
        edges = np.concatenate([known.t_s[:1], edges])
    if known.value[-1] > 0.0:
        edges = np.concatenate([edges, known.t_s[-1:]])
    return edges.reshape(-1, 2).T


def intersect_spans(one: Array, other: Array) -> Array:
    """Return where two sets of intervals overlap.

    Parameters
    ----------
    one, other : ndarray, shape (2, M) and (2, L)
        Beginnings and ends, in order, without overlap within a set.

    Returns
    -------
    ndarray, shape (2, K)
        The common parts, in order.
    """
    begins = np.maximum(one[0][:, None], other[0][None, :])
    ends = np.minimum(one[1][:, None], other[1][None, :])
    there = ends > begins
    return np.array([begins[there], ends[there]])


def merge_spans(spans: Array, gap_s: float = 1e-6) -> Array:
    """Return intervals with those made one that touch.

    Parameters
    ----------
    spans : ndarray, shape (2, M)
        Beginnings and ends, in order.
    gap_s : float
        Largest gap that is closed.

    Returns
    -------
    ndarray, shape (2, K)
        In order.
    """
    if spans.shape[1] < 2:
        return spans
    apart = spans[0, 1:] - spans[1, :-1] > gap_s
    return np.array(
        [spans[0][np.concatenate([[True], apart])], spans[1][np.concatenate([apart, [True]])]]
    )
