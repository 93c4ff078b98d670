"""Biases of a station before and after a pass: from its memory to a tracker's state, and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeGuard, cast, runtime_checkable

import numpy as np

from hillsphere.base.constants import DAY_S
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
"""Measurements of a pass at least for it to change the memory: fewer say little of the biases, and
a wrong estimate would disturb all later passes."""
_SIGNS = np.array([1.0, 1.0, -1.0])
"""Signs between memory and tracker: the time offset of a memory is tag minus true time, the time
bias of a tracker is true time minus tag."""


def begin_with_calibration(
    tracker: LeastSquares, state: LeastSquaresState, calibration: Calibration
) -> LeastSquaresState:
    """Return an initial state with the biases of a calibration.

    Parameters
    ----------
    tracker : LeastSquares
        Tracker that estimates biases.
    state : LeastSquaresState
        State before the first measurement.
    calibration : Calibration
        Calibration of the station, propagated to the present.

    Returns
    -------
    LeastSquaresState
        State with the calibrated values of the biases that the tracker estimates.
    """
    rows = _bias_indices(tracker)
    covariance = calibration.covariance * np.outer(_SIGNS, _SIGNS)
    return tracker.with_biases(
        state, (_SIGNS * calibration.mean)[rows], covariance[np.ix_(rows, rows)]
    )


def calibration_after_pass(
    tracker: LeastSquares, state: LeastSquaresState, epoch: Epoch, before: Calibration | None
) -> Calibration:
    """Return the calibration of a station after a pass.

    Parameters
    ----------
    tracker : LeastSquares
        Tracker that estimates biases.
    state : LeastSquaresState
        State after the pass, one case.
    epoch : Epoch
        Time of the result.
    before : Calibration or None
        Calibration with which the state began, propagated to `epoch`; None if the tracker began
        with its own prior.

    Returns
    -------
    Calibration
        Estimated biases; biases that the tracker does not estimate keep their value.
    """
    spec, kept = tracker.spec, _bias_indices(tracker)
    if before is None:
        own: Array = np.array([spec.bias_sigma_rad] * 2 + [spec.time_bias_sigma_s])
        before = Calibration(epoch, np.zeros(3), np.diag(own**2), 0)
    # Estimated biases are replaced together with their correlations to the others.
    mean, covariance = before.mean.copy(), before.covariance.copy()
    covariance[kept, :] = covariance[:, kept] = 0.0
    biases = np.concatenate([state.biases_rad[:, 0], state.time_bias_s])
    mean[kept] = (_SIGNS * biases)[kept]
    rows, signs = tracker.bias_rows, _SIGNS[kept]
    covariance[np.ix_(kept, kept)] = state.covariance[rows, rows, 0] * np.outer(signs, signs)
    return Calibration(epoch, mean, covariance, before.passes + 1)


@dataclass(frozen=True)
class StationMemory:
    """Memory of one station during a session.

    Parameters
    ----------
    path : Path
        File of the memory, which need not exist.
    station : str
        Name of the station.
    walk : RandomWalk
        Random walk of the biases between passes.
    say : callable
        Receives a line when the memory is used, changed, or not used.
    """

    path: Path
    station: str
    walk: RandomWalk
    say: Callable[[str], None]

    def begin(self, tracker: Tracker[Any], state: Any, start: Epoch) -> Any:
        """Return the initial state of a session, with the biases of the memory.

        Raises
        ------
        InputError
            If the memory cannot be read.
        """
        known = read_memory(self.path).get(self.station)
        if not _estimates(tracker):
            self.say(
                f"{self.path} is not used: this tracker estimates no biases, least_squares does"
            )
            return state
        if known is None:
            self.say(f"{self.path} has no entry for {self.station} yet")
            return state
        if not _is_of_earlier(known, start):
            self._tell_later(known)
            return state
        now = age_calibration(known, start, self.walk)
        sigma = np.degrees(np.sqrt(np.diag(now.covariance)[:2]))
        mean = np.degrees(now.mean[:2])
        self.say(
            f"biases of {self.station} from {known.passes} passes: azimuth {mean[0]:+.3f}° "
            f"±{sigma[0]:.3f}°, elevation {mean[1]:+.3f}° ±{sigma[1]:.3f}°"
        )
        return begin_with_calibration(tracker, state, now)

    def end(self, tracker: Tracker[Any], state: Any, start: Epoch, t_s: float) -> None:
        """Store the biases that a session has estimated.

        Parameters
        ----------
        tracker : Tracker
            Tracker of the session.
        state : object
            State of the tracker after the session.
        start : Epoch
            Start of the session.
        t_s : float
            Time of the last measurement after `start`.

        Raises
        ------
        InputError
            If the memory is damaged or cannot be written.
        """
        if not _estimates(tracker):
            return
        count, outliers = float(state.count[0]), float(state.outliers[0])
        if count < _ENOUGH or outliers > 0.5 * count:
            self.say(
                f"{self.path} is not changed: {count:.0f} measurements with {outliers:.0f} "
                f"outliers do not suffice (at least {_ENOUGH}, at most half of them outliers)"
            )
            return
        known = read_memory(self.path).get(self.station)
        if known is not None and not _is_of_earlier(known, start):
            self._tell_later(known)
            return
        tai = start.to("TAI")
        epoch = Epoch(tai.day, tai.fraction + t_s / DAY_S, "TAI").to("UTC")
        before = None if known is None else age_calibration(known, epoch, self.walk)
        try:
            remember(self.path, self.station, calibration_after_pass(tracker, state, epoch, before))
        except OSError as error:
            raise InputError(
                f"the station memory {self.path} cannot be written: {error.strerror or error}"
            ) from error
        self.say(f"biases of {self.station} stored in {self.path}")

    def _tell_later(self, known: Calibration) -> None:
        when = known.epoch.to("UTC").isot(np.zeros(1), 0)[0]
        self.say(
            f"{self.path} is neither used nor changed: its entry for {self.station} is of {when} "
            "UTC, after the beginning of this pass; it may already contain this pass"
        )


@runtime_checkable
class _BiasEstimator(Contract, Protocol):
    """A tracker that can estimate biases of its station, like `LeastSquares`."""

    spec: Any
    with_biases: Any


def _estimates(tracker: Tracker[Any]) -> TypeGuard[LeastSquares]:
    return isinstance(tracker, _BiasEstimator) and bool(_bias_indices(cast(LeastSquares, tracker)))


def _bias_indices(tracker: LeastSquares) -> list[int]:
    """Return the indices of the estimated ones of azimuth bias, elevation bias and time offset."""
    return [0, 1] * tracker.spec.angle_biases + [2] * tracker.spec.time_bias


def _is_of_earlier(known: Calibration, start: Epoch) -> bool:
    return known.epoch.seconds_since(start) <= 0.0
