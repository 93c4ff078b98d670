"""Stone Soup's Kalman filters on a scenario of estimation, one draw after the other.

Stone Soup (MIT) is no dependency of the project: ``pip install stonesoup``. Its filters are driven
as its tutorials do, with the scenario's motion and measurements behind its interfaces.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel, TimeVariantModel
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater
from wide_priors import Scenario

from hillsphere.interfaces import EstimationModel

Array = NDArray[np.float64]
_BEGIN = datetime(2000, 1, 1)
"""Its times are dates; any will do."""


class Motion(TransitionModel, GaussianModel, TimeVariantModel):
    """The motion of a model."""

    model: Any = Property(doc="The model")
    ndim_state: int = Property(doc="Number of states")

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """Return the states after the interval; noise is only in the covariance."""
        x = np.asarray(state.state_vector, dtype=float)
        start, end = _times(state, kwargs["time_interval"], x.shape[1])
        return _vectors(self.model.advance(x, start, end, *_nothing(x)))

    def covar(self, time_interval: timedelta, **kwargs: Any) -> Array:
        """Return the covariance of the process noise."""
        x = np.asarray(kwargs["begin"].state_vector, dtype=float)[:, :1]
        start, end = _times(kwargs["begin"], time_interval, 1)
        factor = self.model.process_noise(x, start, end, np.zeros((0, 1)))[0]
        return np.asarray(factor @ factor.T)


class Measurement(NonLinearGaussianMeasurement):
    """Some rows of the measurements of a model."""

    model: Any = Property(doc="The model")
    rows: Any = Property(doc="Rows that are measured")

    @property
    def ndim_meas(self) -> int:
        """Number of rows."""
        return len(self.rows)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """Return the predicted measurement, its angles as Stone Soup's bearings."""
        x = np.asarray(state.state_vector, dtype=float)
        t = _times(state, timedelta(0), x.shape[1])[0]
        return _bearings(self.model, self.rows, self.model.observe(x, t, _nothing(x)[1]))

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        """Return derivatives by central differences.

        Its own differences do not wrap angles; its models of bearings bring exact derivatives.
        """
        x = np.asarray(state.state_vector, dtype=float)
        step = _STEP * np.maximum(np.abs(x), 1.0) * np.eye(len(x))
        t = _times(state, timedelta(0), 2 * len(x))[0]
        moved = np.concatenate([x + step, x - step], axis=1)
        shown = self.model.observe(moved, t, _nothing(moved)[1])[self.rows]
        off = shown[:, : len(x)] - shown[:, len(x) :]
        angles = _angles(self.model, self.rows)
        off[angles] = np.mod(off[angles] + np.pi, 2.0 * np.pi) - np.pi
        return np.asarray(off / (2.0 * np.diag(step)))


_STEP = 1e-6
"""Relative step of differences: the third root of the machine's precision, about."""


def _nothing(x: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return no controls, and the case of each column."""
    return np.zeros((0, x.shape[1])), np.zeros(x.shape[1], dtype=np.int64)


def _times(state: Any, interval: timedelta, columns: int) -> tuple[Array, Array]:
    start = (state.timestamp - _BEGIN).total_seconds()
    return np.full(columns, start), np.full(columns, start + interval.total_seconds())


def _vectors(values: Array) -> Any:
    return values.view(StateVectors) if values.shape[1] > 1 else StateVector(values)


def _angles(model: Any, rows: NDArray[np.int64]) -> list[bool]:
    """Return which rows are angles."""
    channels = [channel for block in model.blocks for channel in block]
    return [channels[row].kind == "angle" for row in rows]


def _bearings(model: EstimationModel, rows: NDArray[np.int64], values: Array) -> Any:
    """Return measurements as its vectors, with angles of its type."""
    angles = _angles(model, rows)
    if not any(angles):
        return _vectors(values[rows])
    made = [
        [Bearing(v) for v in values[row]] if angle else list(values[row])
        for row, angle in zip(rows, angles, strict=True)
    ]
    return _vectors(np.array(made, dtype=object))


def run(scenario: Scenario, draws: int, unscented: bool) -> tuple[Array, Array]:
    """Return means (n, draws) and covariances (draws, n, n) at the last time."""
    model, n = scenario.model, len(scenario.prior.x)
    motion = Motion(model=model, ndim_state=n)
    predictor = (UnscentedKalmanPredictor if unscented else ExtendedKalmanPredictor)(motion)
    updater = (UnscentedKalmanUpdater if unscented else ExtendedKalmanUpdater)(None)
    means, covariances = [], []
    for k in range(draws):
        state: Any = GaussianState(
            scenario.prior.x[:, k : k + 1], scenario.prior.covariance[k], timestamp=_BEGIN
        )
        for measured in scenario.sets:
            at = _BEGIN + timedelta(seconds=float(measured.t_s[k]))
            state = predictor.predict(state, timestamp=at, begin=state)
            rows = np.flatnonzero(measured.present[:, k])
            sigma = np.broadcast_to(measured.sigma, measured.values.shape)[rows, k]
            seen = Measurement(
                ndim_state=n, mapping=tuple(range(n)), noise_covar=np.diag(sigma**2), model=model,
                rows=rows,
            )  # fmt: skip
            found = _bearings(model, rows, measured.values[:, k : k + 1])
            state = updater.update(
                SingleHypothesis(state, Detection(found, timestamp=at, measurement_model=seen))
            )
        means.append(np.asarray(state.mean, dtype=float)[:, 0])
        covariances.append(np.asarray(state.covar, dtype=float))
    return np.array(means).T, np.array(covariances)
