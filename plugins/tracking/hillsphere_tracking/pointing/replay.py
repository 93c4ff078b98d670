"""Scores of trackers on a logged pass: errors of the prediction after a loss of signal.

A tracker receives the measurements up to a loss and then predicts to the end of the pass, as in
assisted tracking [1]_ (eq. 26). The errors are relative to the measurements, in the frame of the
encoders with all their biases: these decide whether the signal is found again.

References
----------
.. [1] H. K. Kuga, V. Carrara (1990), Assisted tracking of satellites, 1st Brazilian Symposium on
   Aerospace Technology, São José dos Campos (eq. 26).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere_tracking.pointing.pass_log import PassLog
from hillsphere_tracking.pointing.reacquisition import time_outside
from hillsphere_tracking.pointing.sky import separation
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Score", "prediction_errors", "score"]


@dataclass(frozen=True)
class Score:
    """Score of a tracker after one loss.

    Parameters
    ----------
    tracker : str
        Name of the tracker.
    locked_s : float
        Time from the first measurement to the loss.
    measurements, predictions : int
        Number of measurements before the loss, and of compared predictions after it.
    largest_rad, rms_rad : float
        Largest and root-mean-square error on the sky, from the loss to the end of the pass.
    outside_s : float
        Time for which the prediction was outside the beam.
    """

    tracker: str
    locked_s: float
    measurements: int
    predictions: int
    largest_rad: float
    rms_rad: float
    outside_s: float


def prediction_errors(
    tracker: Tracker[Any], state: Any, log: PassLog, locked_s: float
) -> tuple[Array, Array]:
    """Return the errors on the sky of the prediction after a loss.

    Parameters
    ----------
    tracker : Tracker
        The tracker.
    state : Any
        State of the tracker before the pass, from its ``initial``, with times after `log.epoch`.
    log : PassLog
        The pass; only lines with lock are used.
    locked_s : float
        Time from the first measurement to the loss.

    Returns
    -------
    times_s, error_rad : ndarray, shape (M,)
        Times after the loss, and errors at them.

    Raises
    ------
    InputError
        If nothing was measured before the loss, or nothing after it.
    """
    times = log.times_s[log.locked]
    azimuth, elevation = log.azimuth_rad[log.locked], log.elevation_rad[log.locked]
    sigma = log.sigma_rad[log.locked]
    # The margin of 1 µs makes 60 s at 1 Hz 60 measurements: rounding must not make them 61.
    had = int(np.searchsorted(times, times[0] + locked_s - 1e-6)) if times.size else 0
    if not 0 < had < times.size:
        raise InputError(
            f"a loss after {locked_s:g} s of a pass with {times.size} measurements has {had}"
            f" before and {times.size - had} after it; choose a loss with measurements on both"
            " sides"
        )
    for k in range(had):
        here = slice(k, k + 1)
        state = tracker.update(state, times[here], azimuth[here], elevation[here], sigma[here])
    predicted = tracker.predict(state, times[had:])
    error = separation(
        direction_cosines(np.reshape(predicted[0], -1), np.reshape(predicted[1], -1)),
        direction_cosines(azimuth[had:], elevation[had:]),
    )
    return times[had:], error


def score(
    trackers: Mapping[str, tuple[Tracker[Any], Any]],
    log: PassLog,
    losses_s: Iterable[float],
    beam_rad: float,
) -> list[Score]:
    """Score trackers on a logged pass.

    Parameters
    ----------
    trackers : mapping of str to (Tracker, state)
        Trackers by name, each with its state before the pass.
    log : PassLog
        The pass.
    losses_s : iterable of float
        Losses, in seconds after the first measurement; each is a separate replay.
    beam_rad : float
        Radius of the beam (the lock angle).

    Returns
    -------
    list of Score
        Scores in the order of the losses, then of the trackers.

    Raises
    ------
    InputError
        As for `prediction_errors`.
    """
    count = int(np.count_nonzero(log.locked))
    scores = []
    for locked_s in losses_s:
        for name, (tracker, state) in trackers.items():
            times, error = prediction_errors(tracker, state, log, locked_s)
            scores.append(
                Score(
                    name,
                    locked_s,
                    count - times.size,
                    times.size,
                    float(error.max()),
                    float(np.sqrt(np.mean(error**2))),
                    float(time_outside(times, error, beam_rad)),
                )
            )
    return scores
