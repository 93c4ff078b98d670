"""One tracker through one pass: what it predicts after each loss, and how far it is off."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array, Tracker
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

__all__ = ["ERRORS", "SPREAD", "AntennaRecord", "TrackerOutcome", "follow"]

ERRORS = ("error", "sky_error", "encoder_error")
"""Names of the errors over time, as in the measures ``error_max`` …"""

SPREAD = "spread"
"""Name of the larger standard deviation on the sky over time."""

_LEAST_SIGMA_RAD = 1e-7
"""Least standard deviation that a tracker is told: of a perfect antenna."""


@dataclass(frozen=True, eq=False)
class AntennaRecord:
    """What an antenna shows of a pass, N cases.

    Parameters
    ----------
    measured_rad : ndarray, shape (2, K, N)
        With all errors; NaN where there is no measurement.
    bias_rad : ndarray, shape (2, K, N)
        Systematic errors.
    stations : tuple of Station, length N or 1
        Where the trackers believe that it stands.
    """

    measured_rad: Array
    bias_rad: Array
    stations: tuple[Station, ...]


@dataclass(frozen=True, eq=False)
class TrackerOutcome:
    """What came of one tracker in one pass with L outages, N cases.

    Parameters
    ----------
    measures : list of dict of str to ndarray, length L
        Values (N,) by measure, for each outage.
    over_time : list of dict of str to ndarray, shape (K, N)
        What was to be kept of `ERRORS` and `SPREAD`, over the pass, for each outage.
    """

    measures: list[dict[str, Array]]
    over_time: list[dict[str, Array]]


def follow(
    tracker: Tracker[Any],
    truth: PassTruth,
    seen: AntennaRecord,
    elements: Array,
    epoch: Epoch,
    lock_angle_rad: float,
    search: SearchSpec | None,
    *,
    keep: Collection[str] = (),
) -> TrackerOutcome:
    """Give a tracker the measurements up to each outage, and judge what it then predicts.

    Parameters
    ----------
    tracker : Tracker
        Which.
    truth : PassTruth
        The pass.
    seen : Seen
        What is measured of it.
    elements : ndarray, shape (6, N)
        Nominal elements at the acquisition.
    epoch : Epoch
        From which the pass's times count.
    lock_angle_rad : float
        Error up to which the signal is received.
    search : SearchSpec or None
        Search after the signal's return; None for none.
    keep : collection of str
        Which of `ERRORS` and ``"spread"`` are kept over time.

    Returns
    -------
    Followed
        Measures as in `hillsphere_tracking.assisted_tracking.measures`.
    """
    cases = elements.shape[1]
    outages = truth.begins.tolist()
    sigma = np.maximum(truth.sigma_rad, _LEAST_SIGMA_RAD)
    state = tracker.initial(elements, truth.t_s[:1], seen.stations, epoch, truth.orientation)
    before = {name: np.empty((outages[-1], cases)) for name in keep}
    measures: list[dict[str, Array]] = []
    over_time: list[dict[str, Array]] = []
    for k in range(outages[-1] + 1):
        for begin in [b for b in outages if b == k]:
            found = _predict(tracker, state, truth.t_s[begin:])
            measures.append(_outage_measures(found, truth, seen, begin, lock_angle_rad, search))
            after = _errors(found, truth, seen, slice(begin, None), keep)
            over_time.append(
                {name: np.concatenate([before[name][:begin], after[name]]) for name in keep}
            )
        if k == outages[-1]:
            break
        shown = seen.measured_rad[:, k]
        when = np.full(cases, truth.t_s[k])
        state = tracker.update(state, when, shown[0], shown[1], sigma[:, k : k + 1])
        if keep:
            now = _predict(tracker, state, truth.t_s[k : k + 1], keep)
            for name, value in _errors(now, truth, seen, slice(k, k + 1), keep).items():
                before[name][k] = value[0]
    return TrackerOutcome(measures, over_time)


@dataclass(frozen=True, eq=False)
class _Prediction:
    """What the antenna will show, where the satellite will be (2, K, N), and the former's P."""

    shown: Array
    true: Array
    covariance: Array


_OF_THE_TRUE = frozenset({"error", "sky_error"})
"""Errors of where the satellite will be; the others are of what the antenna will show."""


def _predict(
    tracker: Tracker[Any], state: Any, times_s: Array, keep: Collection[str] = (*ERRORS, SPREAD)
) -> _Prediction:
    """Return what a state predicts, as far as what is kept needs it (the rest stays empty)."""
    shown = true = covariance = np.empty((2, 0, 0))
    if not _OF_THE_TRUE.issuperset(keep):
        azimuth, elevation, covariance = tracker.predict(state, times_s)
        shown = np.array([azimuth, elevation])
    if not _OF_THE_TRUE.isdisjoint(keep):
        true = np.array(tracker.predict(state, times_s, biased=False)[:2])
    return _Prediction(shown, true, covariance)


def _errors(
    found: _Prediction, truth: PassTruth, seen: AntennaRecord, at: slice, keep: Collection[str]
) -> dict[str, Array]:
    """Return what is kept (K, N) of predictions for these samples."""
    true = truth.angles_rad[:, at, None]
    made: dict[str, Callable[[], Array]] = {
        "error": lambda: root_sum_square(found.true, true),
        "sky_error": lambda: arc(found.true, true),
        "encoder_error": lambda: root_sum_square(found.shown, _encoder(truth, seen, at)),
        SPREAD: lambda: larger_sigma(found.covariance),
    }
    return {name: made[name]() for name in keep}


def _encoder(truth: PassTruth, seen: AntennaRecord, at: slice) -> Array:
    """Return what an antenna without noise shows (2, K, N)."""
    return np.array(fold_over_zenith(*(truth.angles_rad[:, at, None] + seen.bias_rad[:, at])))


def _outage_measures(
    found: _Prediction,
    truth: PassTruth,
    seen: AntennaRecord,
    begin: int,
    lock_angle_rad: float,
    search: SearchSpec | None,
) -> dict[str, Array]:
    """Return the measures of an outage."""
    times = truth.t_s[begin:] - truth.t_s[begin]
    true = truth.angles_rad[:, begin:, None]
    encoder = _encoder(truth, seen, slice(begin, None))
    middle = times.size // 2
    made = {
        "error_max": root_sum_square(found.true, true).max(axis=0),
        "sky_error_max": arc(found.true, true).max(axis=0),
        "encoder_error_max": root_sum_square(found.shown, encoder).max(axis=0),
        "time_outside": time_outside(times, arc(found.shown, encoder), lock_angle_rad),
        "nees": nees(
            on_the_sky(encoder[:, middle], found.shown[:, middle]), found.covariance[:, :, middle]
        ),
    }
    if (
        search is not None
        and (back := int(np.searchsorted(times, search.signal_back_s))) < times.size
    ):
        off = on_the_sky(encoder[:, back:], found.shown[:, back:])
        again = simulate_search(
            search, lock_angle_rad, times[back:], off, found.covariance[:, :, back]
        )
        made["time_to_reacquire"] = again.time_s
        made["found"], made["found_at_once"] = again.found, again.at_once
    return made
