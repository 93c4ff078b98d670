"""One tracker in one pass: its predictions after each loss of signal, and their errors."""

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
"""Names of the errors over time; the measures ``error_max`` … are their maxima."""

SPREAD = "spread"
"""Name of the history of the larger standard deviation on the sky."""

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
    truth: PassTruth,
    record: AntennaRecord,
    elements: Array,
    epoch: Epoch,
    lock_angle_rad: float,
    search: SearchSpec | None,
    *,
    keep: Collection[str] = (),
) -> TrackerOutcome:
    """Update a tracker with the measurements of a pass, and evaluate its prediction at each outage.

    The tracker processes the measurements once, up to the last outage. At each outage its current
    state predicts the rest of the pass.

    Parameters
    ----------
    tracker : Tracker
        The tracker.
    truth : PassTruth
        The true pass.
    record : AntennaRecord
        Measurements of the antenna.
    elements : ndarray, shape (6, N)
        Nominal elements at the acquisition.
    epoch : Epoch
        Origin of the times of the pass.
    lock_angle_rad : float
        Largest error at which the signal is received.
    search : SearchSpec or None
        Search after the return of the signal; None for no search.
    keep : collection of str
        Names from `ERRORS` and ``"spread"`` whose histories are kept.

    Returns
    -------
    TrackerOutcome
        Measures as in `hillsphere_tracking.assisted_tracking.measures`, and histories.
    """
    cases = elements.shape[1]
    outages = truth.begins.tolist()
    sigma = np.maximum(truth.sigma_rad, _LEAST_SIGMA_RAD)
    state = tracker.initial(elements, truth.t_s[:1], record.stations, epoch, truth.orientation)
    before = {name: np.empty((outages[-1], cases)) for name in keep}
    measures: list[dict[str, Array]] = []
    over_time: list[dict[str, Array]] = []
    for k in range(outages[-1] + 1):
        for begin in [b for b in outages if b == k]:
            prediction = _predict(tracker, state, truth.t_s[begin:])
            measures.append(
                _outage_measures(prediction, truth, record, begin, lock_angle_rad, search)
            )
            after = _errors(prediction, truth, record, slice(begin, None), keep)
            over_time.append(
                {name: np.concatenate([before[name][:begin], after[name]]) for name in keep}
            )
        if k == outages[-1]:
            break
        angles = record.measured_rad[:, k]
        when = np.full(cases, truth.t_s[k])
        state = tracker.update(state, when, angles[0], angles[1], sigma[:, k : k + 1])
        if keep:
            now = _predict(tracker, state, truth.t_s[k : k + 1], keep)
            for name, value in _errors(now, truth, record, slice(k, k + 1), keep).items():
                before[name][k] = value[0]
    return TrackerOutcome(measures, over_time)


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Predicted angles of the antenna and true angles (2, K, N), and covariance of the former."""

    shown: Array
    true: Array
    covariance: Array


_OF_THE_TRUE = frozenset({"error", "sky_error"})
"""Errors of the predicted true direction; the others are errors of the predicted antenna angles."""


def _predict(
    tracker: Tracker[Any], state: Any, times_s: Array, keep: Collection[str] = (*ERRORS, SPREAD)
) -> _Prediction:
    """Predict from a state; arrays that the names in `keep` do not need remain empty."""
    shown = true = covariance = np.empty((2, 0, 0))
    if not _OF_THE_TRUE.issuperset(keep):
        azimuth, elevation, covariance = tracker.predict(state, times_s)
        shown = np.array([azimuth, elevation])
    if not _OF_THE_TRUE.isdisjoint(keep):
        true = np.array(tracker.predict(state, times_s, biased=False)[:2])
    return _Prediction(shown, true, covariance)


def _errors(
    prediction: _Prediction,
    truth: PassTruth,
    record: AntennaRecord,
    at: slice,
    keep: Collection[str],
) -> dict[str, Array]:
    """Return the errors (K, N) named by `keep`, of predictions for the samples `at`."""
    true = truth.angles_rad[:, at, None]
    compute: dict[str, Callable[[], Array]] = {
        "error": lambda: root_sum_square(prediction.true, true),
        "sky_error": lambda: arc(prediction.true, true),
        "encoder_error": lambda: root_sum_square(prediction.shown, _encoder(truth, record, at)),
        SPREAD: lambda: larger_sigma(prediction.covariance),
    }
    return {name: compute[name]() for name in keep}


def _encoder(truth: PassTruth, record: AntennaRecord, at: slice) -> Array:
    """Return the angles (2, K, N) of an antenna with its systematic errors but without noise."""
    return np.array(fold_over_zenith(*(truth.angles_rad[:, at, None] + record.bias_rad[:, at])))


def _outage_measures(
    prediction: _Prediction,
    truth: PassTruth,
    record: AntennaRecord,
    begin: int,
    lock_angle_rad: float,
    search: SearchSpec | None,
) -> dict[str, Array]:
    """Return the measures of an outage that begins at sample `begin`, each of shape (N,)."""
    times = truth.t_s[begin:] - truth.t_s[begin]
    true = truth.angles_rad[:, begin:, None]
    encoder = _encoder(truth, record, slice(begin, None))
    middle = times.size // 2
    measures = {
        "error_max": root_sum_square(prediction.true, true).max(axis=0),
        "sky_error_max": arc(prediction.true, true).max(axis=0),
        "encoder_error_max": root_sum_square(prediction.shown, encoder).max(axis=0),
        "time_outside": time_outside(times, arc(prediction.shown, encoder), lock_angle_rad),
        "nees": nees(
            on_the_sky(encoder[:, middle], prediction.shown[:, middle]),
            prediction.covariance[:, :, middle],
        ),
    }
    if (
        search is not None
        and (back := int(np.searchsorted(times, search.signal_back_s))) < times.size
    ):
        off = on_the_sky(encoder[:, back:], prediction.shown[:, back:])
        again = simulate_search(
            search, lock_angle_rad, times[back:], off, prediction.covariance[:, :, back]
        )
        measures["time_to_reacquire"] = again.time_s
        measures["found"], measures["found_at_once"] = again.found, again.at_once
    return measures
