"""One tracker in passes: its predictions after each loss of signal, and their errors."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array, Integers, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.assisted_tracking.errors import (
    arc,
    larger_sigma,
    nees,
    on_the_sky,
    root_sum_square,
)
from hillsphere_tracking.assisted_tracking.searching import simulate_search
from hillsphere_tracking.assisted_tracking.specs import SearchSpec
from hillsphere_tracking.assisted_tracking.truth import PassTruth
from hillsphere_tracking.pointing.reacquisition import time_outside
from hillsphere_tracking.trackers.observation import fold_over_zenith
from hillsphere_tracking.trackers.state import JointTracker

__all__ = [
    "ERRORS", "SPREAD", "AntennaRecord", "FollowedPass", "TrackerOutcome", "follow",
]  # fmt: skip

ERRORS = ("error", "sky_error", "encoder_error")
"""Names of the errors over time; the measures ``error_max`` … are their maxima."""

SPREAD = "spread"
"""Name of the history of the larger standard deviation on the sky."""

_OF_THE_TRUE = frozenset({"error", "sky_error"})
"""Errors of the predicted true direction; the others are errors of the predicted antenna angles."""

_SHOWN = "shown"
"""Key of the predicted antenna angles among the errors that are derived from them."""

_LANES_AT_ONCE = 4096
"""Cases times samples that are predicted at once for the histories: a call then takes far longer
than its overhead, and its arrays (0.2 MB a quantity) remain in the processor's cache."""

_LEAST_SIGMA_RAD = 1e-7
"""Least standard deviation (rad) of a measurement: trackers need a positive one, also for an
antenna without noise; it is below the noise of any antenna."""


@dataclass(frozen=True, eq=False)
class AntennaRecord:
    """Measurements of an antenna during a pass, N cases.

    Parameters
    ----------
    measured_rad : ndarray, shape (2, K, N)
        Measured angles with all errors; NaN where the antenna measures nothing.
    bias_rad : ndarray, shape (2, K, N)
        Systematic part of the errors.
    stations : tuple of Station, length N or 1
        Locations of the antenna that the trackers assume.
    """

    measured_rad: Array
    bias_rad: Array
    stations: tuple[Station, ...]


@dataclass(frozen=True, eq=False)
class FollowedPass:
    """A pass that trackers follow, N cases.

    Parameters
    ----------
    truth : PassTruth
        The true pass.
    record : AntennaRecord
        Measurements of the antenna.
    """

    truth: PassTruth
    record: AntennaRecord

    @cached_property
    def true_rad(self) -> Array:
        """True angles, (2, K, 1)."""
        return self.truth.angles_rad[:, :, None]

    @cached_property
    def encoder_rad(self) -> Array:
        """Angles (2, K, N) of an antenna with its systematic errors but without noise."""
        return np.array(fold_over_zenith(*(self.true_rad + self.record.bias_rad)))


@dataclass(frozen=True, eq=False)
class TrackerOutcome:
    """Results of one tracker in one pass with L outages, N cases.

    Parameters
    ----------
    measures : list of dict of str to ndarray, length L
        Values (N,) by measure, for each outage.
    over_time : list of dict of str to ndarray, shape (K, N)
        Requested ones of `ERRORS` and `SPREAD` over the pass, for each outage.
    """

    measures: list[dict[str, Array]]
    over_time: list[dict[str, Array]]


def follow(
    tracker: Tracker[Any],
    passes: Sequence[FollowedPass],
    elements: Sequence[Array],
    epoch: Epoch,
    lock_angle_rad: float,
    search: SearchSpec | None,
    *,
    keep: Sequence[Collection[str]] | None = None,
    history_cases: int | None = None,
) -> list[TrackerOutcome]:
    """Update a tracker with the measurements of passes, and evaluate its prediction at each outage.

    The tracker processes the measurements of a pass once, up to the last outage. At each outage its
    current state predicts the rest of the pass. Passes with the same outages are followed at once
    by a `JointTracker`, as further cases: a call for few cases takes about as long as one for many.

    Parameters
    ----------
    tracker : Tracker
        The tracker.
    passes : sequence of FollowedPass, length P
        The passes, with the same N cases each.
    elements : sequence of ndarray, shape (6, N), length P
        Nominal elements at the acquisition.
    epoch : Epoch
        Origin of the times of the passes.
    lock_angle_rad : float
        Largest error at which the signal is received.
    search : SearchSpec or None
        Search after the return of the signal; None for no search.
    keep : sequence of collection of str, length P, optional
        Names from `ERRORS` and ``"spread"`` whose histories are kept, for each pass.
    history_cases : int, optional
        Histories of so many first cases suffice; by default those of all N are kept.

    Returns
    -------
    list of TrackerOutcome
        For each pass, measures as in `hillsphere_tracking.assisted_tracking.measures`, and
        histories.
    """
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, followed in enumerate(passes):
        alone = () if isinstance(tracker, JointTracker) else (i,)
        groups.setdefault((*followed.truth.begins.tolist(), -1, *alone), []).append(i)
    outcomes: dict[int, TrackerOutcome] = {}
    for group in groups.values():
        kept = sorted({name for i in group for name in keep[i]}) if keep else []
        together = _Passes(
            tracker, [passes[i] for i in group], kept, history_cases, lock_angle_rad, search
        )
        found = together.follow([elements[i] for i in group], epoch)
        outcomes.update(zip(group, found, strict=True))
    return [outcomes[i] for i in range(len(passes))]


class _Lanes:
    """Columns of all cases of several passes, or of the first few of each pass."""

    def __init__(self, cases: Sequence[int], few: int | None = None) -> None:
        self.every = few is None
        self.counts = list(cases) if few is None else [min(few, n) for n in cases]
        starts = np.cumsum([0, *cases[:-1]]).tolist()
        firsts = [first + np.arange(n) for first, n in zip(starts, self.counts, strict=True)]
        self.columns: slice | Integers = slice(None) if few is None else np.concatenate(firsts)
        ends = np.cumsum([0, *self.counts]).tolist()
        self.of_pass = [slice(a, b) for a, b in pairwise(ends)]
        self.size = ends[-1]


class _Passes:
    """Passes with the same outages, whose P·N cases a tracker follows at once."""

    def __init__(
        self,
        tracker: Tracker[Any],
        passes: Sequence[FollowedPass],
        keep: Sequence[str],
        history_cases: int | None,
        lock_angle_rad: float,
        search: SearchSpec | None,
    ) -> None:
        self._tracker, self._passes, self._keep = tracker, passes, keep
        self._lock_angle_rad, self._search = lock_angle_rad, search
        self._cases = [p.record.measured_rad.shape[2] for p in passes]
        self._joint = tracker if isinstance(tracker, JointTracker) else None
        self._begins: list[int] = passes[0].truth.begins.tolist()
        self._times = self._by_case([p.truth.t_s for p in passes])
        self._all = _Lanes(self._cases)
        few = None if self._joint is None else history_cases
        self._kept = _Lanes(self._cases, few)

    def follow(self, elements: Sequence[Array], epoch: Epoch) -> list[TrackerOutcome]:
        """Return the outcome of each pass; see `follow`."""
        last = self._begins[-1]
        state = self._initial(elements, epoch)
        # angles and deviations of all cases, sample by sample
        measured = [p.record.measured_rad[:, :last] for p in self._passes]
        azimuth, elevation = np.concatenate(measured, axis=2)
        sigmas = [np.maximum(p.truth.sigma_rad[:, :last], _LEAST_SIGMA_RAD) for p in self._passes]
        sigma = np.array([self._by_case([s[axis] for s in sigmas]) for axis in range(2)])
        outcomes = [TrackerOutcome([], []) for _ in self._passes]
        before = [{name: np.empty((last, n)) for name in self._keep} for n in self._kept.counts]
        most = 1 if self._joint is None else max(1, _LANES_AT_ONCE // self._kept.size)
        waiting: list[Any] = []  # states whose predictions of their own samples are kept
        for k in range(last + 1):
            if waiting and (len(waiting) == most or k in self._begins):
                at = slice(k - len(waiting), k)
                now = self._predict(waiting, at, self._keep, self._kept)
                for errors, there in zip(now, before, strict=True):
                    for name in self._keep:
                        there[name][at] = errors[name]
                waiting.clear()
            for begin in [b for b in self._begins if b == k]:
                self._lose(state, begin, outcomes, before)
            if k == last:
                break
            state = self._tracker.update(
                state, self._times[k], azimuth[k], elevation[k], sigma[:, k]
            )
            if self._keep:
                waiting.append(self._select(state, self._kept))
        return outcomes

    def _initial(self, elements: Sequence[Array], epoch: Epoch) -> Any:
        states = [
            self._tracker.initial(
                nominal, p.truth.t_s[:1], p.record.stations, epoch, p.truth.orientation
            )
            for nominal, p in zip(elements, self._passes, strict=True)
        ]
        if len(states) == 1:
            return states[0]
        assert self._joint is not None
        return self._joint.join(states)

    def _select(self, state: Any, lanes: _Lanes) -> Any:
        columns = lanes.columns
        if self._joint is None or isinstance(columns, slice):
            return state
        return self._joint.select(state, columns)

    def _by_case(self, rows: Sequence[Array]) -> Array:
        """Return a row of values per pass as columns (K, P·N); short rows keep their last value."""
        count = max(row.size for row in rows)
        columns = [
            np.broadcast_to(np.pad(row, (0, count - row.size), mode="edge")[:, None], (count, n))
            for row, n in zip(rows, self._cases, strict=True)
        ]
        return np.concatenate(columns, axis=1)

    def _lose(
        self,
        state: Any,
        begin: int,
        outcomes: Sequence[TrackerOutcome],
        before: Sequence[Mapping[str, Array]],
    ) -> None:
        """Add the outage that begins at a sample to the outcomes."""
        # The covariance counts at two samples: amid the outage, and at the signal's return.
        looks = [self._looks(p.truth.t_s[begin:]) for p in self._passes]
        rows = [p.truth.t_s[begin + look] for p, look in zip(self._passes, looks, strict=True)]
        *_, covariance = self._tracker.predict(state, self._by_case(rows))
        at = slice(begin, None)
        names = (*ERRORS, *self._keep) if self._kept.every else ERRORS
        later = list(self._predict([state], at, names, self._all))
        kept = later
        if self._keep and not self._kept.every:
            few = self._select(state, self._kept)
            kept = list(self._predict([few], at, self._keep, self._kept))
        for i, (p, outcome) in enumerate(zip(self._passes, outcomes, strict=True)):
            amid = covariance[..., self._all.of_pass[i]]
            outcome.measures.append(self._measures(p, begin, later[i], looks[i], amid))
            outcome.over_time.append(
                {name: np.concatenate([before[i][name][:begin], kept[i][name]])
                 for name in self._keep}
            )  # fmt: skip

    def _looks(self, times_s: Array) -> Integers:
        """Return the samples amid an outage and at the return of the signal, if it is before K."""
        middle = back = times_s.size // 2
        if self._search is not None:
            back = int(np.searchsorted(times_s - times_s[0], self._search.signal_back_s))
        return np.array([middle, back if back < times_s.size else middle])

    def _predict(
        self, states: Sequence[Any], at: slice, names: Collection[str], lanes: _Lanes
    ) -> Iterator[dict[str, Array]]:
        """Yield, pass by pass, the named errors (K, n) of predictions for the samples `at`.

        There is one state of the cases `lanes` for all samples, or one for each. With
        ``encoder_error`` the predicted angles (2, K, n) come too, as `_SHOWN`.
        """
        times = self._times[at][:, lanes.columns]
        grid, state = times, states[0]
        if len(states) > 1:
            assert self._joint is not None
            grid, state = times.reshape(1, -1), self._joint.join(states)
        shown, true = (q.reshape(2, *times.shape) for q in self._point(state, grid))
        covariance = np.empty(0)
        if SPREAD in names:
            covariance = self._tracker.predict(state, grid)[2].reshape(2, 2, *times.shape)
        for p, own, n in zip(self._passes, lanes.of_pass, lanes.counts, strict=True):
            count = p.truth.t_s[at].size
            errors = {}
            if not _OF_THE_TRUE.isdisjoint(names):
                there, aim = true[:, :count, own], p.true_rad[:, at]
                if "error" in names:
                    errors["error"] = root_sum_square(there, aim)
                if "sky_error" in names:
                    errors["sky_error"] = arc(there, aim)
            if "encoder_error" in names:
                aim = p.encoder_rad[:, at, :n]
                errors[_SHOWN] = shown[:, :count, own]
                errors["encoder_error"] = root_sum_square(errors[_SHOWN], aim)
            if SPREAD in names:
                errors[SPREAD] = larger_sigma(covariance[:, :, :count, own])
            yield errors

    def _point(self, state: Any, times_s: Array) -> tuple[Array, Array]:
        """Return the predicted azimuth and elevation (2, K, P·N), with and without biases."""
        if self._joint is not None:
            return self._joint.point(state, times_s)
        shown, true = (self._tracker.predict(state, times_s, biased=b)[:2] for b in (True, False))
        return np.array(shown), np.array(true)

    def _measures(
        self,
        p: FollowedPass,
        begin: int,
        errors: Mapping[str, Array],
        looks: Integers,
        covariance: Array,
    ) -> dict[str, Array]:
        """Return the measures of an outage that begins at sample `begin`, each of shape (N,).

        `covariance` (2, 2, 2, N) is that of the samples `looks`.
        """
        times = p.truth.t_s[begin:] - p.truth.t_s[begin]
        shown, encoder = errors[_SHOWN], p.encoder_rad[:, begin:]
        middle, back = looks.tolist()
        measures = {f"{name}_max": errors[name].max(axis=0) for name in ERRORS}
        measures["time_outside"] = time_outside(times, arc(shown, encoder), self._lock_angle_rad)
        measures["nees"] = nees(
            on_the_sky(encoder[:, middle], shown[:, middle]), covariance[:, :, 0]
        )
        if self._search is not None and times[back] >= self._search.signal_back_s:
            off = on_the_sky(encoder[:, back:], shown[:, back:])
            again = simulate_search(
                self._search, self._lock_angle_rad, times[back:], off, covariance[:, :, 1]
            )
            measures["time_to_reacquire"] = again.time_s
            measures["found"], measures["found_at_once"] = again.found, again.at_once
        return measures
