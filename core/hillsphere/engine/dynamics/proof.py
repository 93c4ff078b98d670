r"""Proof of where events happen within a step, or that they do not.

An event g is known at both ends of a piece of length w, and bounds of its first two derivatives
along the flight, :math:`a \le \dot g \le b` and :math:`c \le \ddot g \le d`, over the piece.

- No zero, for g positive at both ends: the lines :math:`g_0 + a\tau` and :math:`g_1 - b(w-\tau)`
  lie below g, and meet above zero if :math:`g_0/|a| + g_1/b > w`; or the chord, from which g
  departs downward by at most :math:`d\,w^2/8`, stays above zero.
- One zero at most: the derivative keeps its sign. By the mean value theorem it is also within
  :math:`w\max(|c|,|d|)` of the chord's slope.

A piece of which neither holds is halved, by partial steps of the same formula. Where the halves
reach their smallest size the event just touches zero, but for rounding: it is not resolved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers

__all__ = [
    "DEPTH",
    "MARGIN",
    "ROUNDING",
    "FirstCrossings",
    "Pieces",
    "Slopes",
    "count_crossings",
    "decide",
    "halve_pieces",
    "leading",
    "pad_pieces",
    "search",
]

Flags: TypeAlias = NDArray[np.bool_]
Slopes: TypeAlias = tuple[Array, Array, Array, Array]
"""Bounds a, b of the first and c, d of the second derivative, each (E, K), per unit of time."""

DEPTH = 20
"""Halvings of a sub-step: a piece of a step of 60 s is then 57 µs, over which a flight that
accelerates by 1 cm/s² departs from its chord by 4e-12 m, a rounding error of its position."""
_MOST_PIECES = 4096
"""Undecided pieces of one lane beyond which its search is given up. A touch leaves two or three in
each round of halvings if the second derivative is bounded. If only a slope L is, an approach to e
with curvature κ leaves L √(8/(κ e)): 4096 resolve 1e-6 of a value of order one. The count is each
lane's own, so that no lane depends on its neighbours."""
_AT_ONCE = 8192
"""Undecided pieces of all lanes beyond which half of the lanes wait for the others, which bounds
what the arrays of a search take to some megabytes."""
ROUNDING = 1e-13
"""What an event's value, of order one or larger, may be off by rounding, relative to its size or
one: some hundred roundings."""
MARGIN = 0.1
"""Value above which an event that offers no bound is taken for far from zero, unless it says
otherwise. Events are without dimension and of order one: a tenth is 5 % of the radius of a body."""
_BLUR = 13
"""Halvings after which undecided pieces that lead to a change of sign may stay undecided."""
_LEADING = 2.0**-7
"""Part of a sub-step that may lead undecided to a change of sign, and count as part of the
crossing: its time is known to this, and exactly if the event falls throughout. At `_BLUR` it is
enough for bounds 64 times too steep, at the last halvings for ones 4096 times too steep."""
_WIDTH = 64
"""Pieces are filled up to a multiple of this, so that no piece's last bits depend on how many
others there are."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """K parts of the sub-steps of some lanes.

    Parameters
    ----------
    lane : ndarray of int, shape (K,)
        Whose they are.
    begin, end : ndarray, shape (K,)
        Times since the sub-step began; their difference has the sign of the step.
    y0, y1 : ndarray, shape (rows, K)
        States there.
    g0, g1 : ndarray, shape (E, K)
        Events there.
    """

    lane: Integers
    begin: Array
    end: Array
    y0: Array
    y1: Array
    g0: Array
    g1: Array

    def taken(self, which: Integers | Flags) -> Pieces:
        """Return some of them."""
        return Pieces(
            self.lane[which], self.begin[which], self.end[which],
            self.y0[:, which], self.y1[:, which], self.g0[:, which], self.g1[:, which],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FirstCrossings:
    """What a search found, by event and lane.

    Parameters
    ----------
    begin, end : ndarray, shape (E, N)
        Bracket of the first crossing that counts, as time since the sub-step began; NaN if none.
    open_at : ndarray, shape (E, N)
        Beginning of the first piece that could not be decided; infinite if none. In a backward
        step times are counted along the flight, positive.
    """

    begin: Array
    end: Array
    open_at: Array


def count_crossings(before: Array, after: Array, direction: int, from_zero: bool = True) -> Flags:
    """Say where a change of sign counts: falling (−1), rising (1), or both (0).

    With `from_zero` what begins at zero and goes on to the other side has crossed.
    """
    falling, rising = (before > 0) & (after <= 0), (before < 0) & (after >= 0)
    if from_zero:
        falling |= (before == 0) & (after < 0)
        rising |= (before == 0) & (after > 0)
    if direction == 0:
        return falling | rising
    return falling if direction < 0 else rising


def decide(
    g0: Array, g1: Array, w: Array, slopes: Slopes, direction: int, from_zero: bool = True
) -> tuple[Flags, Flags]:
    """Decide events of pieces.

    Parameters
    ----------
    g0, g1 : ndarray, shape (E, K)
        Values at the ends.
    w : ndarray, shape (K,)
        Lengths, positive; with the flight.
    slopes : Slopes
        Bounds along the flight.
    direction, from_zero
        Which crossings count, see `count_crossings`.

    Returns
    -------
    clear : ndarray of bool, shape (E, K)
        Where no crossing that counts lies inside.
    single : ndarray of bool, shape (E, K)
        Where exactly one does, and no other zero.
    """
    a, b, c, d = slopes
    small = ROUNDING * np.maximum(1.0, np.maximum(np.abs(g0), np.abs(g1)))
    chord = (g1 - g0) / w
    bend = w * np.maximum(np.abs(c), np.abs(d)) + 2.0 * small / w
    a, b = np.fmax(a, chord - bend), np.fmin(b, chord + bend)
    rises, falls = a >= 0.0, b <= 0.0
    one = rises | falls
    changes = count_crossings(g0, g1, direction, from_zero) & one
    positive, negative = (g0 > small) & (g1 > small), (g0 < -small) & (g1 < -small)
    p, q = np.abs(g0) - small, np.abs(g1) - small
    # g₀/|a| + g₁/b > w, multiplied out; for g below zero the same of −g, whose slopes are −b, −a.
    above = -a * b * w < b * p - a * q
    below = -a * b * w < -a * p + b * q
    sag = np.minimum(p, q)
    above |= sag > np.maximum(d, 0.0) * (w * w * 0.125)
    below |= sag > np.maximum(-c, 0.0) * (w * w * 0.125)
    free = (positive & (above | one)) | (negative & (below | one))
    return free | (one & ~changes), changes


def search(
    pieces: Pieces,
    lanes: int,
    bounds: Callable[[Pieces], Slopes],
    halve: Callable[[Integers, Array], tuple[Array, Array]],
    direction: int,
    wanted: Flags,
    from_zero: bool = True,
) -> FirstCrossings:
    """Find the first crossing of each event in the sub-steps of some lanes.

    Parameters
    ----------
    pieces : Pieces
        One for each lane that is looked at.
    lanes : int
        N.
    bounds : callable
        Pieces → slopes along the clock.
    halve : callable
        Lanes (K,) and times (K,) since the sub-step began → states and events there.
    direction, from_zero
        Which crossings count, see `count_crossings`.
    wanted : ndarray of bool, shape (E, K)
        Which events of which pieces are not certain yet.

    Returns
    -------
    FirstCrossings
        Brackets and what stays open.
    """
    events = len(pieces.g0)
    begin = np.full((events, lanes), np.nan)
    end = np.full((events, lanes), np.nan)
    open_at = np.full((events, lanes), np.inf)
    waiting = wanted.copy()

    def keep(row: int, which: Flags, now: Pieces, sure: bool) -> None:
        # Of several pieces of one lane the earliest counts: written last.
        for k in np.flatnonzero(which)[::-1].tolist():
            lane = now.lane[k]
            at = abs(now.begin[k])
            if sure and not at >= abs(begin[row, lane]):
                begin[row, lane], end[row, lane] = now.begin[k], now.end[k]
            elif not sure and at < open_at[row, lane]:
                open_at[row, lane] = at

    # How long the sub-steps are.
    whole = np.zeros(lanes)
    whole[pieces.lane] = np.abs(pieces.end - pieces.begin)
    turns = [(0, pieces, wanted.copy())]
    while turns:
        depth, pieces, waiting = turns.pop()
        if not len(pieces.lane):
            continue
        filled = pad_pieces(pieces)
        slopes = bounds(filled)
        sense = np.where(filled.end >= filled.begin, 1.0, -1.0)
        clear, single = decide(
            filled.g0, filled.g1, np.abs(filled.end - filled.begin),
            _along(slopes, sense), direction, from_zero,
        )  # fmt: skip
        count = len(pieces.lane)
        clear, single = clear[:, :count], single[:, :count]
        for row in range(events):
            keep(row, single[row] & waiting[row], pieces, True)
        waiting = waiting & ~clear & ~single
        for row in range(events):
            rest = waiting[row]
            if not rest.any():
                continue
            crosses = rest & count_crossings(pieces.g0[row], pieces.g1[row], direction, from_zero)
            # There is a crossing in such a piece: the first one is not after it.
            until = np.full(lanes, np.inf)
            np.minimum.at(until, pieces.lane[crosses], np.abs(pieces.begin[crosses]))
            rest &= np.abs(pieces.begin) <= until[pieces.lane]
            crosses &= rest
            if depth < _BLUR and depth < DEPTH:
                continue
            leads = crosses | leading(rest, crosses, pieces, _LEADING * whole)
            if depth == DEPTH:
                keep(row, crosses, pieces, True)
                keep(row, rest & ~leads, pieces, False)
                rest[:] = False
            else:
                # Where all that is left leads to the crossing, nothing more can be learnt of it.
                known = np.isfinite(until)
                known[pieces.lane[rest & ~leads]] = False
                done = rest & known[pieces.lane]
                keep(row, crosses & done, pieces, True)
                rest &= ~done
        if depth == DEPTH:
            continue
        # Nothing after a lane's first sure crossing of the same event matters.
        waiting &= ~(np.abs(pieces.begin) >= np.abs(begin[:, pieces.lane]))
        undecided = np.bincount(pieces.lane, np.count_nonzero(waiting, axis=0), lanes)
        given_up = (undecided > _MOST_PIECES)[pieces.lane]
        if given_up.any():
            # A change of sign across a piece this wide is perhaps not the first in it.
            for row in range(events):
                keep(row, waiting[row] & given_up, pieces, False)
            waiting &= ~given_up
        left: Flags = np.asarray(waiting.any(axis=0))
        turns += _share_halves(depth + 1, pieces.taken(left), waiting[:, left], halve)
    return FirstCrossings(begin, end, open_at)


def _share_halves(
    depth: int,
    pieces: Pieces,
    waiting: Flags,
    halve: Callable[[Integers, Array], tuple[Array, Array]],
) -> list[tuple[int, Pieces, Flags]]:
    """Return the halves of undecided pieces: one turn, or several of some of the lanes each."""
    if not len(pieces.lane):
        return []
    mine = np.unique(pieces.lane)
    if len(pieces.lane) > _AT_ONCE and len(mine) > 1:
        first = pieces.lane < mine[len(mine) // 2]
        return [
            turn
            for part in (first, ~first)
            for turn in _share_halves(depth, pieces.taken(part), waiting[:, part], halve)
        ]
    return [(depth, halve_pieces(pieces, halve), np.repeat(waiting, 2, axis=1))]


def leading(rest: Flags, crosses: Flags, pieces: Pieces, longest: Array) -> Flags:
    """Say which undecided pieces lead without a gap to one in which the event changes its sign.

    A bound that does not know the sign of the derivative leaves some pieces beside every crossing
    undecided, in proportion to how loose it is. They only blur the time of the crossing, if they
    begin no longer than `longest`, by lane, before the piece in which it is.
    """
    leads = np.zeros(len(rest), dtype=bool)
    if not crosses.any():
        return leads
    order = np.lexsort((np.abs(pieces.begin), pieces.lane))
    until = 0.0
    for before, after in zip(order[-2::-1].tolist(), order[:0:-1].tolist(), strict=True):
        lane = pieces.lane[before]
        joined = lane == pieces.lane[after] and pieces.end[before] == pieces.begin[after]
        if crosses[after]:
            until = abs(pieces.begin[after])
        leads[before] = (
            rest[before]
            and joined
            and (crosses[after] or leads[after])
            and until - abs(pieces.begin[before]) <= longest[lane]
        )
    return leads


def halve_pieces(pieces: Pieces, halve: Callable[[Integers, Array], tuple[Array, Array]]) -> Pieces:
    """Return both halves of each piece, side by side."""
    filled = pad_pieces(pieces)
    count = len(pieces.lane)
    middle = 0.5 * (filled.begin + filled.end)
    y, g = halve(filled.lane, middle)
    y, g, middle = y[:, :count], g[:, :count], middle[:count]

    def pairs(first: Array, second: Array) -> Array:
        return np.stack([first, second], axis=-1).reshape(*first.shape[:-1], 2 * count)

    return Pieces(
        np.repeat(pieces.lane, 2),
        pairs(pieces.begin, middle),
        pairs(middle, pieces.end),
        pairs(pieces.y0, y),
        pairs(y, pieces.y1),
        pairs(pieces.g0, g),
        pairs(g, pieces.g1),
    )


def pad_pieces(pieces: Pieces) -> Pieces:
    """Return the pieces, the last one repeated up to a whole number of widths."""
    count = len(pieces.lane)
    total = -(-count // _WIDTH) * _WIDTH
    return pieces if total == count else pieces.taken(np.minimum(np.arange(total), count - 1))


def _along(slopes: Slopes, sense: Array) -> Slopes:
    """Return slopes along the clock as slopes along flights that may run backward."""
    a, b, c, d = slopes
    if (sense > 0).all():
        return slopes
    back = sense < 0
    return np.where(back, -b, a), np.where(back, -a, b), c, d
