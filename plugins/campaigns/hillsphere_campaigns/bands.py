"""Quantiles over the cases of a campaign, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.errors import StageError
from hillsphere.interfaces.cases import Histories
from hillsphere.products.products import Bands, Lines, LinesToEnds

__all__ = ["Parts", "bands_of", "lines_of"]

Parts = Callable[[], Iterable[tuple[Integers, Histories]]]
"""Yields numbers of cases (n,) and their histories, part by part, each time that it is called; a
case that two parts hold is the same in both."""

ROOM_BYTES = 1 << 28
"""Memory for values of all cases; if there are more, the parts are read several times."""


def bands_of(
    parts: Parts, cases: Integers, levels: Sequence[float], *, room_bytes: int = ROOM_BYTES
) -> Bands | None:
    """Return the quantiles of histories over cases, at each sample.

    Parameters
    ----------
    parts : callable
        The histories, see `Parts`; those of further cases are left out.
    cases : ndarray of int, shape (N,)
        Numbers of the cases that count, ascending.
    levels : sequence of float
        Levels of the quantiles, in (0, 1).
    room_bytes : int
        Memory for values; any size gives the same bits.

    Returns
    -------
    Bands or None
        Exact, interpolated linearly between the values as those of metrics; None if no case has a
        sample.

    Raises
    ------
    StageError
        If the cases were not sampled at the same times after their first sample, or parts hold
        different quantities.
    """
    grid = _Grid()
    for numbers, histories in parts():
        here, _ = _places(numbers, cases)
        grid.add(numbers[here], histories, here)
    if grid.known is None or not grid.time_s.size:
        return None
    names, units = grid.known
    samples, q = grid.time_s.size, len(names)
    ordered = tuple(sorted(set(levels)))
    values = np.full((len(ordered), q, samples), np.nan)
    count = np.zeros((q, samples), dtype=np.int64)
    step = max(1, room_bytes // (8 * q * cases.size))
    for begin in range(0, samples, step):
        some = _gather_samples(parts, cases, q, slice(begin, min(begin + step, samples)))
        for i, k in np.ndindex(some.shape[:2]):
            there = some[i, k][np.isfinite(some[i, k])]
            count[i, begin + k] = there.size
            if there.size:
                values[:, i, begin + k] = np.quantile(there, ordered)
        del some  # before the next one takes its memory
    return Bands(names, units, ordered, grid.time_s, values, count)


def lines_of(parts: Parts, cases: Integers) -> Lines | None:
    """Return the histories of cases one by one.

    Parameters
    ----------
    parts : callable
        As for `bands_of`.
    cases : ndarray of int, shape (N,)
        Numbers of the cases, ascending.

    Returns
    -------
    Lines or None
        None if no case has a sample; `LinesToEnds` if a case has an end after its last one.

    Raises
    ------
    StageError
        As for `bands_of`.
    """
    grid = _Grid()
    for numbers, histories in parts():
        here, _ = _places(numbers, cases)
        grid.add(numbers[here], histories, here)
    if grid.known is None or not grid.time_s.size:
        return None
    names, units = grid.known
    whole = _gather_samples(parts, cases, len(names), slice(0, grid.time_s.size))
    end_s, end_values = _ends(parts, cases, len(names))
    if not np.isfinite(end_s).any():
        return Lines(names, units, cases, grid.time_s, whole)
    return LinesToEnds(names, units, cases, grid.time_s, whole, end_s, end_values)


def _places(numbers: Integers, cases: Integers) -> tuple[Integers, Integers]:
    """Return the places of `numbers` that are cases, and their places among `cases`."""
    if not cases.size:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    place = np.minimum(np.searchsorted(cases, numbers), cases.size - 1)
    here = np.flatnonzero(cases[place] == numbers)
    return here, place[here]


def _gather_samples(parts: Parts, cases: Integers, q: int, samples: slice) -> Array:
    """Return the values (q, k, N) of all cases at some samples, NaN where a case has none."""
    found = np.full((q, samples.stop - samples.start, cases.size), np.nan)
    for numbers, histories in parts():
        here, place = _places(numbers, cases)
        flies = np.isfinite(histories.time_s[samples][:, here])
        found[:, : len(flies), place] = np.where(
            flies, histories.values[:, samples][:, :, here], np.nan
        )
    return found


def _ends(parts: Parts, cases: Integers, q: int) -> tuple[Array, Array]:
    """Return when cases ended after their last samples (N,), and their values then (q, N)."""
    end_s, end_values = np.full(cases.size, np.nan), np.full((q, cases.size), np.nan)
    for numbers, histories in parts():
        here, place = _places(numbers, cases)
        if histories.end_s is not None and histories.end_values is not None and here.size:
            end_s[place] = histories.end_s[here] - histories.time_s[0, here]
            end_values[:, place] = histories.end_values[:, here]
    return end_s, end_values


class _Grid:
    """Times of the samples after the first one: those of the longest case, which all share."""

    def __init__(self) -> None:
        self.known: tuple[tuple[str, ...], tuple[str, ...]] | None = None
        self.time_s: Array = np.empty(0)
        self._case = -1
        self._slack_s = 0.0

    def add(self, numbers: Integers, histories: Histories, here: Integers) -> None:
        """Take up the times of cases of these numbers (n,), in these columns of the histories."""
        told = histories.names, histories.units
        if self.known is None:
            self.known = told
        elif told != self.known:
            raise StageError(
                f"run_cases kept histories of {', '.join(told[0])} for some cases, but of "
                f"{', '.join(self.known[0])} for others; they must be the same for every block"
            )
        if not len(histories.time_s):
            return
        time_s = histories.time_s[:, here]
        count = np.isfinite(time_s).sum(axis=0)
        after = time_s - time_s[0]
        # The longest first, of these the first case: whatever the parts, the times are its own.
        for j in np.lexsort((numbers, -count)).tolist():
            self._take(int(numbers[j]), after[: count[j], j], np.abs(time_s[: count[j], j]))

    def _take(self, case: int, after: Array, size: Array) -> None:
        if not after.size:
            return
        # Times that were summed up are half a unit in the last place off with every sample.
        slack = after.size * float(np.spacing(size.max()))
        shared = min(after.size, self.time_s.size)
        apart = np.abs(after[:shared] - self.time_s[:shared])
        if not (apart <= slack + self._slack_s).all() or not np.isfinite(after).all():
            raise StageError(
                f"bands need samples at common times, but those of case {case} differ from those "
                f"of case {self._case}, counted from the first sample of each; leave bands out"
            )
        longer = after.size - self.time_s.size
        if longer > 0 or (longer == 0 and case < self._case):
            self.time_s, self._case, self._slack_s = after, case, slack
