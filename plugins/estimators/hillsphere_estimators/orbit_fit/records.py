"""Recorded values of observables, as sets of measurements for estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import MeasurementSet
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.orbit_fit.observables import Observable

__all__ = ["Arc", "Record", "arrange", "labels_of"]


@dataclass(frozen=True)
class Record:
    """All values of one observable in N cases; recorded data are one case.

    Parameters
    ----------
    observable : Observable
        What was measured.
    t_s : ndarray, shape (K,)
        Time tags, rising.
    values : ndarray, shape (r, K, N)
        Values, SI; NaN where there is none.
    sigma : ndarray, shape (r, K)
        Standard deviations.
    """

    observable: Observable
    t_s: Array
    values: Array
    sigma: Array


@dataclass(frozen=True)
class Arc:
    """Sets of measurements in order of time, and where their rows come from.

    Parameters
    ----------
    sets : tuple of MeasurementSet
        One for each time.
    record, row, number : ndarray of int, shape (M,)
        Of each value: its record, its row of the set, and its number in the record. The order is
        that of the sets and of their rows.
    at : ndarray of int, shape (M,)
        Its set.
    sigma : ndarray, shape (M,)
        Its standard deviation, SI.
    active : dict of float to tuple of int
        Time → numbers of the observables measured then.
    """

    sets: tuple[MeasurementSet, ...]
    record: Integers
    row: Integers
    number: Integers
    at: Integers
    sigma: Array
    active: dict[float, tuple[int, ...]]

    def only(self, used: NDArray[np.bool_]) -> tuple[MeasurementSet, ...]:
        """Return the sets with the values of a mask (M,) alone; empty ones are left out."""
        kept = []
        ends = np.searchsorted(self.at, np.arange(len(self.sets) + 1))
        for k, one in enumerate(self.sets):
            own = slice(ends[k], ends[k + 1])
            present = one.present.copy()
            present[self.row[own]] &= used[own][:, None]
            if present.any():
                kept.append(replace(one, present=present))
        return tuple(kept)


def arrange(records: Sequence[Record]) -> Arc:
    """Return the sets of measurements of records; record k is observable k.

    Parameters
    ----------
    records : sequence of Record
        In the order of the rows.
    """
    blocks = tuple(record.observable.channels for record in records)
    sizes = [len(block) for block in blocks]
    first = np.cumsum([0, *sizes])
    times = np.unique(np.concatenate([record.t_s for record in records]))
    cases = records[0].values.shape[2]
    values = np.full((len(times), first[-1], cases), np.nan)
    sigma = np.ones((len(times), first[-1]))
    number = np.full((len(times), first[-1]), -1)
    active: dict[float, tuple[int, ...]] = {float(t): () for t in times}
    for k, record in enumerate(records):
        own = slice(first[k], first[k + 1])
        place = np.searchsorted(times, record.t_s)
        values[place, own] = np.moveaxis(record.values, 1, 0)
        sigma[place, own] = record.sigma.T
        number[place, own] = np.arange(len(record.t_s))[:, None]
        for t in record.t_s.tolist():
            active[t] = (*active[t], k)
    sets = tuple(
        MeasurementSet(
            np.full(cases, t), np.where(np.isnan(values[j]), 0.0, values[j]),
            np.repeat(sigma[j][:, None], cases, axis=1), blocks, ~np.isnan(values[j]),
        )
        for j, t in enumerate(times)
    )  # fmt: skip
    at, row = np.nonzero(~np.isnan(values[:, :, 0]))
    of_row = np.repeat(np.arange(len(records)), sizes)
    return Arc(sets, of_row[row], row, number[at, row], at, sigma[at, row], active)


def labels_of(records: Sequence[Record]) -> list[str]:
    """Return names of the rows, for sentences and tables."""
    return [f"{r.observable.label}, {name}" for r in records for name in r.observable.names]
