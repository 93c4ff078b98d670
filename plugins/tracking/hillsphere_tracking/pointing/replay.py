"""A logged pass played again to trackers: how well each would have pointed after a loss.

The measure is the one of assisted tracking: measurements for so long, then prediction to the end of
the pass, against what was measured there. That is the encoder's own frame, biases and all: what
counts for finding the signal again.

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
    """How a tracker did after one loss.

    Parameters
    ----------
    tracker : str
        Its name.
    locked_s : float
        For how long it had measurements.
    measurements, predictions : int
        How many it had, and how many its predictions were compared to.
    largest_rad, rms_rad : float
        Largest and root-mean-square error on the sky of the prediction to the end of the pass.
    outside_s : float
        For how long the prediction was out of the beam.
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
        Any.
    state : Any
        Its state before the pass, as its ``initial`` gives it, times counting from `log.epoch`.
    log : PassLog
        The pass; only its lines with lock count.
    locked_s : float
        From the first measurement to the loss.

    Returns
    -------
    times_s, error_rad : ndarray, shape (M,)
        After the loss.

    Raises
    ------
    InputError
        If nothing was measured before the loss, or nothing after it.
    """
    times = log.times_s[log.locked]
    azimuth, elevation = log.azimuth_rad[log.locked], log.elevation_rad[log.locked]
    sigma = log.sigma_rad[log.locked]
    # a hair more, so that 60 s at 1 Hz are 60 measurements and rounding does not make it 61
    had = int(np.searchsorted(times, times[0] + locked_s - 1e-6)) if times.size else 0
    if not 0 < had < times.size:
        raise InputError(
            f"a loss {locked_s:g} s into a pass with {times.size} measurements leaves {had} before"
            f" and {times.size - had} after it; choose it so that both exist"
        )
    for k in range(had):
        here = slice(k, k + 1)
        state = tracker.update(state, times[here], azimuth[here], elevation[here], sigma[here])
    seen = tracker.predict(state, times[had:])
    error = separation(
        direction_cosines(np.reshape(seen[0], -1), np.reshape(seen[1], -1)),
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
        Losses, each counted from the first measurement: one replay each.
    beam_rad : float
        Radius of the beam: the lock angle.

    Returns
    -------
    list of Score
        By loss, then by tracker.

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
