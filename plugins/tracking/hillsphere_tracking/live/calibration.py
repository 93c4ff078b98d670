"""A station's biases before and after a pass: from its memory to a tracker's state, and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeGuard, cast, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.memory import (
    Calibration,
    RandomWalk,
    age_calibration,
    read_memory,
    remember,
)
from hillsphere_tracking.trackers.least_squares import LeastSquares, LeastSquaresState

__all__ = ["StationMemory", "begin_with_calibration", "calibration_after_pass"]

_ENOUGH = 20
"""Least number of measurements from which a pass changes a memory."""
_SIGNS = np.array([1.0, 1.0, -1.0])
"""A memory's time offset is tag minus true time, a tracker's bias true time minus tag."""


def begin_with_calibration(
    tracker: LeastSquares, state: LeastSquaresState, calibration: Calibration
) -> LeastSquaresState:
    """Return a state that begins with what is known of the station.

    Parameters
    ----------
    tracker : LeastSquares
        One that estimates biases.
    state : LeastSquaresState
        Before the first measurement.
    calibration : Calibration
        Aged to now.

    Returns
    -------
    LeastSquaresState
        With those of the biases that the tracker estimates.
    """
    kept = _bias_indices(tracker)
    covariance = calibration.covariance * np.outer(_SIGNS, _SIGNS)
    return tracker.with_biases(
        state, (_SIGNS * calibration.mean)[kept], covariance[np.ix_(kept, kept)]
    )


def calibration_after_pass(
    tracker: LeastSquares, state: LeastSquaresState, epoch: Epoch, before: Calibration | None
) -> Calibration:
    """Return what is known of the station after a pass.

    Parameters
    ----------
    tracker : LeastSquares
        One that estimates biases.
    state : LeastSquaresState
        After the pass, one case.
    epoch : Epoch
        Of the pass.
    before : Calibration or None
        With what the state began, aged to the same epoch; None if with the tracker's own prior.

    Returns
    -------
    Calibration
        Biases that the tracker does not estimate are as before.
    """
    spec, kept = tracker.spec, _bias_indices(tracker)
    if before is None:
        own: Array = np.array([spec.bias_sigma_rad] * 2 + [spec.time_bias_sigma_s])
        before = Calibration(epoch, np.zeros(3), np.diag(own**2), 0)
    mean, covariance = before.mean.copy(), before.covariance.copy()
    covariance[kept, :] = covariance[:, kept] = 0.0
    found = np.concatenate([state.biases_rad[:, 0], state.time_bias_s])
    mean[kept] = (_SIGNS * found)[kept]
    rows, signs = tracker.bias_rows, _SIGNS[kept]
    covariance[np.ix_(kept, kept)] = state.covariance[rows, rows, 0] * np.outer(signs, signs)
    return Calibration(epoch, mean, covariance, before.passes + 1)


@dataclass(frozen=True)
class StationMemory:
    """One station's memory during a session.

    Parameters
    ----------
    path : Path
        The file; it need not exist.
    station : str
        Name of the station.
    forgetting : Forgetting
        How fast its biases wander.
    say : callable
        Is given a line when a memory is used, changed, or left as it is.
    """

    path: Path
    station: str
    forgetting: RandomWalk
    say: Callable[[str], None]

    def begin(self, tracker: Tracker[Any], state: Any, start: Epoch) -> Any:
        """Return the state with which a session begins.

        Raises
        ------
        InputError
            If the memory cannot be read.
        """
        known = read_memory(self.path).get(self.station)
        if not _estimates(tracker):
            self.say(
                f"this tracker estimates no biases: {self.path} is not used; least_squares does"
            )
            return state
        if known is None:
            self.say(f"{self.path} knows nothing of {self.station} yet")
            return state
        if not _is_of_earlier(known, start):
            self._tell_later(known)
            return state
        now = age_calibration(known, start, self.forgetting)
        sigma = np.degrees(np.sqrt(np.diag(now.covariance)[:2]))
        mean = np.degrees(now.mean[:2])
        self.say(
            f"biases of {self.station} from {known.passes} passes: azimuth {mean[0]:+.3f}° "
            f"±{sigma[0]:.3f}°, elevation {mean[1]:+.3f}° ±{sigma[1]:.3f}°"
        )
        return begin_with_calibration(tracker, state, now)

    def end(self, tracker: Tracker[Any], state: Any, start: Epoch, t_s: float) -> None:
        """Remember what a session found out.

        Parameters
        ----------
        tracker : Tracker
            Of the session.
        state : object
            After it.
        start : Epoch
            Of the session.
        t_s : float
            Time of its last measurement.

        Raises
        ------
        InputError
            If the memory has been damaged meanwhile, or cannot be written.
        """
        if not _estimates(tracker):
            return
        count, outliers = float(state.count[0]), float(state.outliers[0])
        if count < _ENOUGH or outliers > 0.5 * count:
            self.say(
                f"{self.path} is left as it is: {count:.0f} measurements, {outliers:.0f} of them "
                f"outliers, say too little (at least {_ENOUGH}, most of them good)"
            )
            return
        known = read_memory(self.path).get(self.station)
        if known is not None and not _is_of_earlier(known, start):
            self._tell_later(known)
            return
        tai = start.to("TAI")
        epoch = Epoch(tai.day, tai.fraction + t_s / 86400.0, "TAI").to("UTC")
        before = None if known is None else age_calibration(known, epoch, self.forgetting)
        try:
            remember(self.path, self.station, calibration_after_pass(tracker, state, epoch, before))
        except OSError as error:
            raise InputError(
                f"the station memory {self.path} cannot be written: {error.strerror or error}"
            ) from error
        self.say(f"biases of {self.station} remembered in {self.path}")

    def _tell_later(self, known: Calibration) -> None:
        when = known.epoch.to("UTC").isot(np.zeros(1), 0)[0]
        self.say(
            f"{self.path} is not used and left as it is: it knows {self.station} from {when} UTC, "
            "after this pass began; it may contain this very pass"
        )


@runtime_checkable
class _BiasEstimator(Contract, Protocol):
    """A tracker that estimates biases of its station, as `LeastSquares`."""

    spec: Any
    with_biases: Any


def _estimates(tracker: Tracker[Any]) -> TypeGuard[LeastSquares]:
    return isinstance(tracker, _BiasEstimator) and bool(_bias_indices(cast(LeastSquares, tracker)))


def _bias_indices(tracker: LeastSquares) -> list[int]:
    """Return which of azimuth bias, elevation bias and time offset are estimated."""
    return [0, 1] * tracker.spec.angle_biases + [2] * tracker.spec.time_bias


def _is_of_earlier(known: Calibration, start: Epoch) -> bool:
    return known.epoch.seconds_since(start) <= 0.0
