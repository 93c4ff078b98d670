"""Intervals in which smooth functions of time are positive, including grazing ones.

Samples alone can miss a short interval between them. Each step between two samples is therefore
represented by the Hermite cubic through values and slopes at its ends; the misfit at the midpoint
measures the error of the cubic. A step is halved until the function provably keeps its sign, or has
at most one extremum. The extrema are then located, and the zeros between them are bracketed.

Many functions are searched at once: each is a lane of the arrays, so that a step, a halving or an
iteration is one call for all of them. A lane's result does not depend on the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers

__all__ = [
    "Curve",
    "Function",
    "LaneFunction",
    "intersect_spans",
    "merge_lanes",
    "merge_spans",
    "positive_spans",
    "positive_spans_of_lanes",
    "sample_curve",
    "sample_lanes",
    "zeros",
    "zeros_of_lanes",
]

Function: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Function of times (N,), s, that returns values (N,) and time derivatives (N,)."""
LaneFunction: TypeAlias = Callable[[Array, Integers], tuple[Array, Array]]
"""Functions of time: times (N,), s, and the lanes (N,) they belong to → values and derivatives."""

_TOLERANCE_S = 1e-7
"""Accuracy (s) of zeros and extrema: a low satellite moves by 1 mm. Rounding of a sine of
elevation, 1e-16 over a slope of 1e-3/s, is far below it."""
_HALVINGS = 12
"""Halvings of a step at most: of a minute then 15 ms are left. A function that is not resolved
there touches zero for less than that, or is not smooth; without the limit it would be halved for
ever."""
_MOST = 100
"""Evaluations for a root at most. Newton's method takes three; bisection of an hour's bracket, to
which it falls back, reaches the tolerance after 35."""
_CUBIC_STEPS = 5
"""Newton steps on the cubic of a bracket: from the secant's error, a tenth of the bracket, they
reach 1e-6 of it, below the misfit of the cubic."""


@dataclass(frozen=True)
class Curve:
    """Samples of functions that include their extrema: each is monotonic between its samples.

    Parameters
    ----------
    lane : ndarray of int, shape (K,)
        Function of each sample; not decreasing.
    t_s, value, slope : ndarray, shape (K,)
        Times, in increasing order within a lane, values and derivatives.
    """

    lane: Integers
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
    start = Curve(np.zeros(t.size, dtype=np.int64), t, *function(t))
    return sample_lanes(lambda times, _: function(times), start)


def sample_lanes(function: LaneFunction, start: Curve) -> Curve:
    """Sample functions so that all their extrema near zero are among the samples.

    Parameters
    ----------
    function : callable
        Returns values and derivatives at times of lanes.
    start : Curve
        Initial samples, at least two of each lane, with at most a few extrema between two of them.

    Returns
    -------
    Curve
        As `sample_curve`.
    """
    nodes = [np.array([start.t_s, start.value, start.slope])]
    lanes = [start.lane]
    steps = np.flatnonzero(start.lane[1:] == start.lane[:-1])
    a, b, lane = nodes[0][:, steps], nodes[0][:, steps + 1], start.lane[steps]
    for _ in range(_HALVINGS):
        if lane.size == 0:
            break
        middle = 0.5 * (a[0] + b[0])
        m = np.array([middle, *function(middle, lane)])
        nodes.append(m)
        lanes.append(lane)
        h = b[0] - a[0]
        # misfit of the cubic and of its slope at the midpoint
        off = np.abs(m[1] - (0.5 * (a[1] + b[1]) + h * (a[2] - b[2]) / 8.0))
        off_slope = np.abs(m[2] - (1.5 * (b[1] - a[1]) / h - 0.25 * (a[2] + b[2])))
        # Both halves keep the misfit of the whole step, which is an upper estimate: halving reduces
        # the error of the cubic by 16 and the error of its slope by 8.
        a, b = np.concatenate([a, m], axis=1), np.concatenate([m, b], axis=1)
        open_ = ~_is_resolved(a, b, np.tile(off, 2), np.tile(off_slope, 2))
        a, b, lane = a[:, open_], b[:, open_], np.tile(lane, 2)[open_]
    return _with_extrema(function, _sort(np.concatenate(lanes), np.concatenate(nodes, axis=1)))


def _sort(lane: Integers, samples: Array) -> Curve:
    """Return samples (3, K) in the order of lane and time."""
    order = np.lexsort((samples[0], lane))
    return Curve(lane[order], *samples[:, order])


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


def _with_extrema(function: LaneFunction, known: Curve) -> Curve:
    d = known.slope
    # extrema: zeros of the derivative between samples with slopes of different sign
    turns = np.flatnonzero((d[:-1] * d[1:] < 0.0) & (known.lane[:-1] == known.lane[1:]))
    if turns.size == 0:
        return known
    samples = np.array([known.t_s, known.value, known.slope])
    found = _refine(function, 1, samples[:, turns], samples[:, turns + 1], known.lane[turns])
    samples = np.insert(samples, turns + 1, found, axis=1)
    return Curve(np.insert(known.lane, turns + 1, known.lane[turns]), *samples)


def _refine(function: LaneFunction, order: int, a: Array, b: Array, lane: Integers) -> Array:
    """Return a zero of each function (order 0) or of its derivative (order 1) in a bracket.

    Newton's method, with the exact derivative or the secant's, begins at the zero of the Hermite
    cubic; a step out of the bracket is replaced by a bisection.

    Parameters
    ----------
    function : callable
        Values and derivatives at times of lanes.
    order : int
        0 or 1.
    a, b : ndarray, shape (3, N)
        Time, value and slope at the ends of the brackets; row 1 + `order` has opposite signs.
    lane : ndarray of int, shape (N,)
        Lanes of the brackets.

    Returns
    -------
    ndarray, shape (3, N)
        Times, to 1e-7 s, with the last values and slopes on the way there.
    """
    low, high = a[0].copy(), b[0].copy()
    sign = np.sign(a[1 + order])
    x, slope = _cubic_zero(order, a, b)
    found = np.empty((3, lane.size))
    active = np.arange(lane.size)
    before: tuple[Array, Array] | None = None
    for _ in range(_MOST):
        value = function(x, lane[active])
        g = value[order]
        if order == 0:
            slope = value[1]
        elif before is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = (g - before[1]) / (x - before[0])
        left = np.sign(g) == sign[active]
        low[active] = np.where(left, x, low[active])
        high[active] = np.where(left, high[active], x)
        with np.errstate(divide="ignore", invalid="ignore"):
            better = x - g / slope
        lowest, highest = low[active], high[active]
        done = (
            (np.abs(better - x) <= _TOLERANCE_S) | (g == 0.0) | (highest - lowest <= _TOLERANCE_S)
        )
        # an extremum is told with the value that was computed for it, a zero by Newton's last step
        at = np.where((order == 1) | (g == 0.0), x, np.clip(better, lowest, highest))
        found[:, active] = np.array([np.where(np.isfinite(at), at, x), *value])
        if done.all():
            break
        inside = (better > lowest) & (better < highest)
        better = np.where(inside, better, 0.5 * (lowest + highest))
        before, x, active = (x[~done], g[~done]), better[~done], active[~done]
    return found


def _cubic_zero(order: int, a: Array, b: Array) -> tuple[Array, Array]:
    """Return the zero of the Hermite cubic (or of its derivative) in brackets, and the slope there.

    Arguments are those of `_refine`.
    """
    h = b[0] - a[0]
    c = [a[1], h * a[2], 3.0 * (b[1] - a[1]) - h * (2.0 * a[2] + b[2]),
         2.0 * (a[1] - b[1]) + h * (a[2] + b[2])]  # fmt: skip
    if order == 1:
        c = [c[1], 2.0 * c[2], 3.0 * c[3], np.zeros_like(h)]
    sign = np.sign(c[0])
    low, high = np.zeros_like(h), np.ones_like(h)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.nan_to_num(c[0] / (c[0] - (c[0] + c[1] + c[2] + c[3])), nan=0.5)
        for _ in range(_CUBIC_STEPS):
            s = np.clip(s, low, high)
            p = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
            rate = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3])
            left = np.sign(p) == sign
            low, high = np.where(left, s, low), np.where(left, high, s)
            s = s - p / rate
            s = np.where((s >= low) & (s <= high), s, 0.5 * (low + high))
        scale = h if order == 0 else h * h
        return a[0] + s * h, (c[1] + s * (2.0 * c[2] + s * 3.0 * c[3])) / scale


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
    return zeros_of_lanes(lambda times, _: function(times), known)[1]


def zeros_of_lanes(function: LaneFunction, known: Curve) -> tuple[Integers, Array]:
    """Return the zeros of functions at which they change sign.

    Parameters
    ----------
    function : callable
        Returns values and derivatives at times of lanes.
    known : Curve
        Samples of the same functions, from `sample_lanes`.

    Returns
    -------
    lane : ndarray of int, shape (M,)
        Functions that are zero.
    t_s : ndarray, shape (M,)
        Times, in the order of lane and time, as accurate as those of `zeros`.
    """
    up = known.value > 0.0
    change = np.flatnonzero((up[:-1] != up[1:]) & (known.lane[:-1] == known.lane[1:]))
    samples = np.array([known.t_s, known.value, known.slope])
    lane = known.lane[change]
    return lane, _refine(function, 0, samples[:, change], samples[:, change + 1], lane)[0]


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
    return positive_spans_of_lanes(lambda times, _: function(times), known)[1]


def positive_spans_of_lanes(function: LaneFunction, known: Curve) -> tuple[Integers, Array]:
    """Return the intervals in which functions are positive.

    Parameters
    ----------
    function : callable
        Returns values and derivatives at times of lanes.
    known : Curve
        Samples of the same functions, from `sample_lanes`.

    Returns
    -------
    lane : ndarray of int, shape (M,)
        Function of each interval; not decreasing.
    spans : ndarray, shape (2, M)
        As `positive_spans`, in increasing order within a lane.
    """
    lane, edges = zeros_of_lanes(function, known)
    first = np.flatnonzero(np.diff(known.lane, prepend=-1))
    last = np.flatnonzero(np.diff(known.lane, append=-1))
    under_way = np.concatenate([first[known.value[first] > 0.0], last[known.value[last] > 0.0]])
    if under_way.size:
        lane = np.concatenate([lane, known.lane[under_way]])
        edges = np.concatenate([edges, known.t_s[under_way]])
        order = np.lexsort((edges, lane))
        lane, edges = lane[order], edges[order]
    return lane[::2], edges.reshape(-1, 2).T


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
    return merge_lanes(np.zeros(spans.shape[1], dtype=np.int64), spans, gap_s)[1]


def merge_lanes(lane: Integers, spans: Array, gap_s: float = 1e-6) -> tuple[Integers, Array]:
    """Merge adjacent intervals of lanes (M,), which do not decrease; see `merge_spans`."""
    if lane.size < 2:
        return lane, spans
    apart = (spans[0, 1:] - spans[1, :-1] > gap_s) | (lane[1:] != lane[:-1])
    first, last = np.append(True, apart), np.append(apart, True)
    return lane[first], np.array([spans[0][first], spans[1][last]])
