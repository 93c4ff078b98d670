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
        together = _Passes(tracker, [passes[i] for i in group], kept, lock_angle_rad, search)
        found = together.follow([elements[i] for i in group], epoch)
        outcomes.update(zip(group, found, strict=True))
    return [outcomes[i] for i in range(len(passes))]


class _Passes:
    """Passes with the same outages, whose P·N cases a tracker follows at once."""

    def __init__(
        self,
        tracker: Tracker[Any],
        passes: Sequence[FollowedPass],
        keep: Sequence[str],
        lock_angle_rad: float,
        search: SearchSpec | None,
    ) -> None:
        self._tracker, self._passes, self._keep = tracker, passes, keep
        self._lock_angle_rad, self._search = lock_angle_rad, search
        self._cases = [p.record.measured_rad.shape[2] for p in passes]
        ends = np.cumsum([0, *self._cases])
        self._lanes = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self._joint = tracker if isinstance(tracker, JointTracker) else None
        self._times = self._by_case([p.truth.t_s for p in passes])
        self._begins: list[int] = passes[0].truth.begins.tolist()

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
        before = [{name: np.empty((last, n)) for name in self._keep} for n in self._cases]
        for k in range(last + 1):
            for begin in [b for b in self._begins if b == k]:
                self._lose(state, begin, outcomes, before)
            if k == last:
                break
            state = self._tracker.update(
                state, self._times[k], azimuth[k], elevation[k], sigma[:, k]
            )
            if self._keep:
                now = self._predict(state, slice(k, k + 1), self._keep)
                for errors, there in zip(now, before, strict=True):
                    for name in self._keep:
                        there[name][k] = errors[name][0]
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
        later = self._predict(state, slice(begin, None), (*ERRORS, *self._keep))
        for i, (p, errors, outcome) in enumerate(zip(self._passes, later, outcomes, strict=True)):
            measures = self._measures(p, begin, errors, looks[i], covariance[..., self._lanes[i]])
            outcome.measures.append(measures)
            outcome.over_time.append(
                {name: np.concatenate([before[i][name][:begin], errors[name]])
                 for name in self._keep}
            )  # fmt: skip

    def _looks(self, times_s: Array) -> Integers:
        """Return the samples amid an outage and at the return of the signal, if it is before K."""
        middle = back = times_s.size // 2
        if self._search is not None:
            back = int(np.searchsorted(times_s - times_s[0], self._search.signal_back_s))
        return np.array([middle, back if back < times_s.size else middle])

    def _predict(self, state: Any, at: slice, names: Collection[str]) -> Iterator[dict[str, Array]]:
        """Yield, pass by pass, the named errors (K, N) of predictions for the samples `at`.

        With ``encoder_error`` the predicted angles (2, K, N) come too, as `_SHOWN`.
        """
        times = self._times[at]
        shown = true = covariance = np.empty((2, 2, 0, times.shape[1]))
        if SPREAD in names:
            *angles, covariance = self._tracker.predict(state, times)
            shown = np.array(angles)
        elif "encoder_error" in names:
            shown = self._point(state, times, biased=True)
        if not _OF_THE_TRUE.isdisjoint(names):
            true = self._point(state, times, biased=False)
        for p, lanes in zip(self._passes, self._lanes, strict=True):
            count = p.truth.t_s[at].size
            errors = {}
            if not _OF_THE_TRUE.isdisjoint(names):
                angles, aim = true[:, :count, lanes], p.true_rad[:, at]
                if "error" in names:
                    errors["error"] = root_sum_square(angles, aim)
                if "sky_error" in names:
                    errors["sky_error"] = arc(angles, aim)
            if "encoder_error" in names:
                errors[_SHOWN] = shown[:, :count, lanes]
                errors["encoder_error"] = root_sum_square(errors[_SHOWN], p.encoder_rad[:, at])
            if SPREAD in names:
                errors[SPREAD] = larger_sigma(covariance[:, :, :count, lanes])
            yield errors

    def _point(self, state: Any, times_s: Array, *, biased: bool) -> Array:
        """Return the predicted azimuth and elevation (2, K, P·N)."""
        if self._joint is not None:
            return np.array(self._joint.point(state, times_s, biased))
        return np.array(self._tracker.predict(state, times_s, biased=biased)[:2])

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
