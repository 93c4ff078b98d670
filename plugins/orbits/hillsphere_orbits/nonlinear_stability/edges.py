"""Edges of survival along given directions: the first loss as an offset grows.

The set of offsets that survive has no smooth border: islands of survivors lie beyond the first
loss, and thin tongues of lost ones may lie before it. What is found here is therefore the first
loss that a scan of stated density meets: offsets that double, then offsets equally spaced below
the loss so found, then equally spaced ones within the last gap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.nonlinear_stability.survival import Fate, Fates

__all__ = ["Edges", "Judge", "first_losses"]

Judge: TypeAlias = Callable[[NDArray[np.intp], Array], Fates]
"""(rows (N,), offsets (N,)) → fates of the flights."""

_AT_ONCE = 4  # offsets of a row flown together: beyond a loss the larger ones were for nothing
_SECTIONS = 4
"""Equal parts into which a round divides the gap; its three inner offsets fly in one batch."""
_ROUNDS = 2
"""Rounds: the gap shrinks to a sixteenth, which the docstring of `first_losses` promises."""


@dataclass(frozen=True, eq=False)
class Edges:
    """First losses of R rows, each an orbit and a direction.

    Parameters
    ----------
    survived : ndarray, shape (R,)
        Largest offset tried below the first loss; 0 if there is none.
    lost : ndarray, shape (R,)
        Offset of the first loss; infinite if no offset was lost.
    fate : ndarray of int, shape (R,)
        Its fate.
    time : ndarray, shape (R,)
        When; normalised.
    flights : int
        How many were flown.
    """

    survived: Array
    lost: Array
    fate: NDArray[np.int64]
    time: Array
    flights: int


def first_losses(judge: Judge, largest: Array, doublings: int, scan: int) -> Edges:
    """Find the first loss of every row.

    Parameters
    ----------
    judge : callable
        See `Judge`; an offset in the unit of `largest`.
    largest : ndarray, shape (R,)
        Where the search ends.
    doublings : int
        The smallest offset tried at first is the largest one halved so often.
    scan : int
        Number of equal parts into which the offsets below the first loss found by doubling (or
        below the largest) are then divided.

    Returns
    -------
    Edges
        The gap between `survived` and `lost` is a sixteenth of such a part, or of the gap in which
        the loss lay if that was narrower.
    """
    search = _Search(judge, largest.size)
    every = np.arange(largest.size)
    powers = 0.5 ** np.arange(doublings, -1, -1.0)
    # upwards by factors of two, from the smallest
    search.sweep(every, largest[:, None] * powers)
    # losses need not begin at one edge: scan evenly below the first one found
    top = np.minimum(search.edges().lost, largest)
    search.sweep(every, top[:, None] * (np.arange(1, scan) / scan))
    inner = np.arange(1, _SECTIONS) / _SECTIONS
    for _ in range(_ROUNDS):
        edges = search.edges()
        with_loss = np.flatnonzero(np.isfinite(edges.lost))
        low, high = edges.survived[with_loss], edges.lost[with_loss]
        search.sweep(with_loss, low[:, None] + (high - low)[:, None] * inner)
    return search.edges()


class _Search:
    """Fates of all offsets flown so far, and the edges that follow from them."""

    def __init__(self, judge: Judge, rows: int) -> None:
        self._judge, self._rows = judge, rows
        self._row = np.empty(0, dtype=np.intp)
        self._offset, self._time = np.empty(0), np.empty(0)
        self._fate = np.empty(0, dtype=np.int64)

    def sweep(self, rows: NDArray[np.intp], offsets: Array) -> None:
        """Fly offsets (R, K) of the rows, in rising order, each row until its first loss."""
        for begin in range(0, offsets.shape[1], _AT_ONCE):
            if not rows.size:
                return
            tried = offsets[:, begin : begin + _AT_ONCE]
            row = np.repeat(rows, tried.shape[1])
            fates = self._judge(row, tried.ravel())
            self._row = np.concatenate([self._row, row])
            self._offset = np.concatenate([self._offset, tried.ravel()])
            self._fate = np.concatenate([self._fate, fates.fate])
            self._time = np.concatenate([self._time, fates.time])
            going = ~fates.lost.reshape(tried.shape).any(axis=1)
            rows, offsets = rows[going], offsets[going]

    def edges(self) -> Edges:
        """Return the edges found so far."""
        lost = self._fate != Fate.SURVIVES
        least = np.full(self._rows, np.inf)
        np.minimum.at(least, self._row[lost], self._offset[lost])
        # a survivor beyond the first loss is an island
        below = ~lost & (self._offset < least[self._row])
        most = np.zeros(self._rows)
        np.maximum.at(most, self._row[below], self._offset[below])
        fate, time = np.zeros(self._rows, dtype=np.int64), np.full(self._rows, np.nan)
        first = lost & (self._offset == least[self._row])
        fate[self._row[first]], time[self._row[first]] = self._fate[first], self._time[first]
        return Edges(most, least, fate, time, self._row.size)
