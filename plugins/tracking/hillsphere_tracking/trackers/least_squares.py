r"""Recursive least squares on mean elements, with biases: an extended Kalman filter.

The state consists of selected mean elements (at the time of the last measurement), the biases of
azimuth and elevation, a bias of the time tags, and the horizon bias: a part of the elevation bias
that is proportional to cot h. Between measurements the elements follow their secular rates; the
predicted directions optionally include the short-period terms.

The residual of a measurement is formed on the sky. The unit vectors a, b point along rising azimuth
and elevation at the measured direction, with the biases removed; u(x) is the predicted direction:

.. math::

    ν = -\begin{pmatrix} a·u \\ b·u \end{pmatrix}, \quad
    H = \begin{pmatrix} a·\partial u & \cos h & 0 & a·\dot u & 0 \\
                       b·\partial u & 0 & 1 & b·\dot u & \cot h \end{pmatrix}, \quad
    R = \mathrm{diag}(σ_A^2 \cos^2 h, σ_h^2),

so that nothing is singular at the zenith. `correction` contains the update. A measurement that
changes the state strongly is linearised again at the result (iterated Kalman filter [1]_). If more
measurements were outliers than agreed with the estimated orbit, the estimation restarts from the
nominal orbit: it may have begun with an outlier, or on a side lobe of the antenna. A burst of
outliers after many good measurements does not cause a restart.

References
----------
.. [1] Bell, B. M., Cathey, F. W. (1993), The iterated Kalman filter update as a Gauss-Newton
   method, IEEE Trans. Automatic Control 38, 294-297.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.mean_elements import retrograde_sign
from hillsphere_tracking.trackers.charts import Chart, EquinoctialElements, SelectedElements
from hillsphere_tracking.trackers.correction import Correction, correct_estimate, select_correction
from hillsphere_tracking.trackers.observation import compare_directions, propagate_and_compare
from hillsphere_tracking.trackers.one_call import compile_update, predict_and_correct
from hillsphere_tracking.trackers.specs import LeastSquaresSpec
from hillsphere_tracking.trackers.state import (
    JointCases,
    OrbitState,
    field_of,
    point_antenna,
    predict_angles,
    start,
    validate_measurement,
)

__all__ = ["LeastSquares", "LeastSquaresState"]

_LARGE = 3e-3
"""Correction on the sky (rad) above which a measurement is linearised again. The neglected second
order is about its square, 1e-5 rad, below the noise of any antenna. A larger value leaves errors of
linearisation, a smaller one costs iterations."""
_MOST_RESTARTS = 5
"""Restarts of a case at most: if the given noise is far too small all measurements are outliers,
and no restart helps."""
_LEAST_SIGMA = 1e-7
"""Least standard deviation on the sky (rad). At the zenith the azimuth's standard deviation times
cos h vanishes, and S would be singular without it; it is below the noise of any antenna."""


@dataclass(frozen=True)
class LeastSquaresState(OrbitState):
    """State of the filter: estimated orbit and biases, with their covariance.

    Parameters
    ----------
    time_bias_s : ndarray, shape (N,)
        Time bias: true time of a measurement minus its tag.
    horizon_rad : ndarray, shape (N,)
        Horizon bias: factor of cot h in the bias of the elevation.
    covariance : ndarray, shape (m, m, N)
        Covariance of the m estimated quantities: coordinates of the elements, angle biases, time
        bias, horizon bias.
    sense : ndarray, shape (N,)
        Retrograde sign ±1 of the equinoctial elements.
    outliers : ndarray, shape (N,)
        Number of outliers, including the measurements that a restart discarded.
    agreed : ndarray, shape (N,)
        Number of agreeing measurements minus number of outliers, at least −1.
    restarts : ndarray, shape (N,)
        Number of restarts.
    beginning : LeastSquaresState or None
        State before the first measurement; None if this state is the first one.
    """

    time_bias_s: Array
    horizon_rad: Array
    covariance: Array
    sense: Array
    outliers: Array
    agreed: Array
    restarts: Array
    beginning: LeastSquaresState | None = None


class LeastSquares(JointCases):
    """Recursive least-squares tracker, an extended Kalman filter (see the module).

    Parameters
    ----------
    spec : LeastSquaresSpec
        Parameters from the mission.
    """

    def __init__(self, spec: LeastSquaresSpec) -> None:
        self.spec = spec
        self._field = field_of(spec)
        self.short_period: bool = spec.short_period
        charts: dict[str, Chart] = {
            "node_anomaly": SelectedElements((3, 5)),
            "size_node_anomaly": SelectedElements((0, 3, 5)),
            "all": EquinoctialElements(),
        }
        self._chart = charts[spec.parameters]
        n = self._chart.count
        self._biases = slice(n, n + 2) if spec.angle_biases else None
        self._clock = n + 2 * spec.angle_biases if spec.time_bias else None
        self.bias_rows = slice(n, n + 2 * spec.angle_biases + spec.time_bias)
        """Rows of the covariance of the biases that persist beyond a pass."""
        self._horizon = self.bias_rows.stop if spec.horizon_bias else None
        self.size = self.bias_rows.stop + spec.horizon_bias
        # columns of the measurement's derivatives (`compare_directions`) by the estimated biases
        self._bias_slopes = (
            [6, 7] * spec.angle_biases + [8] * spec.time_bias + [9] * spec.horizon_bias
        )
        # rows of the estimated quantities among the coordinates and all four biases (`predict`)
        self._prediction_rows = np.array([*range(n), *(row - 6 + n for row in self._bias_slopes)])

    def __getstate__(self) -> dict[str, object]:
        """Return what is pickled: without the compiled function, which a copy makes again."""
        return {name: value for name, value in vars(self).items() if name != "_one_call"}

    @cached_property
    def _one_call(self) -> ArrayFunction | None:
        """Prediction and correction at once, of selected elements, which are simple enough."""
        if not isinstance(self._chart, SelectedElements):
            return None
        return compile_update(
            self._field, self.short_period, tuple(self._chart.rows), tuple(self._bias_slopes),
            self.spec.drift_m, self.spec.gate, _LEAST_SIGMA,
        )  # fmt: skip

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> LeastSquaresState:
        """Return the nominal orbit and its covariance; see `hillsphere.interfaces.Tracker`."""
        state = start(elements, t_s, stations, epoch, orientation)
        spec, n, cases = self.spec, self._chart.count, state.t_s.size
        sense = retrograde_sign(state.elements)
        regular = self._chart.regularise(state.elements, sense)
        sigmas = np.array(
            [
                spec.semi_major_axis_sigma_m,
                spec.eccentricity_sigma,
                spec.inclination_sigma_rad,
                spec.node_sigma_rad,
                0.0,
                spec.mean_anomaly_sigma_rad,
            ]
        )
        covariance = np.zeros((cases, self.size, self.size))
        covariance[:, :n, :n] = self._chart.prior(regular, sigmas, sense)
        if self._biases is not None:
            covariance[:, self._biases, self._biases] = spec.bias_sigma_rad**2 * np.eye(2)
        if self._clock is not None:
            covariance[:, self._clock, self._clock] = spec.time_bias_sigma_s**2
        if self._horizon is not None:
            covariance[:, self._horizon, self._horizon] = spec.horizon_bias_sigma_rad**2
        zero = np.zeros(cases)
        fields = vars(state) | {"elements": regular}
        return LeastSquaresState(**fields, time_bias_s=zero, horizon_rad=zero,
                                 covariance=covariance.transpose(1, 2, 0), sense=sense,
                                 outliers=zero, agreed=zero - 1.0, restarts=zero)  # fmt: skip

    def with_biases(
        self, state: LeastSquaresState, biases: Array, covariance: Array
    ) -> LeastSquaresState:
        """Return an initial state with biases from earlier passes.

        Parameters
        ----------
        state : LeastSquaresState
            State before the first measurement.
        biases : ndarray, shape (k,) or (k, N)
            The estimated ones of: azimuth and elevation bias, measured minus true, rad, and time
            bias, true time minus tag, s. The horizon bias changes with the weather and is not set.
        covariance : ndarray, shape (k, k)
            Covariance of the biases.

        Returns
        -------
        LeastSquaresState
            State with these biases, uncorrelated with the elements.

        Raises
        ------
        InputError
            If the tracker estimates no biases, or another number of biases.
        """
        own, given = self.bias_rows, np.asarray(biases, dtype=float)
        count = own.stop - own.start
        if count == 0:
            raise InputError("this tracker estimates no biases; set angle_biases = true")
        if given.shape[:1] != (count,):
            raise InputError(f"this tracker estimates {count} biases, got {given.shape}")
        total = state.covariance.copy()
        total[own, :] = total[:, own] = 0.0
        total[own, own] = np.asarray(covariance, dtype=float)[:, :, None]
        given = np.broadcast_to(given.reshape(count, -1), (count, state.t_s.size))
        angles = given[:2].copy() if self.spec.angle_biases else state.biases_rad
        clock = given[-1].copy() if self.spec.time_bias else state.time_bias_s
        fields = vars(state) | {"biases_rad": angles, "time_bias_s": clock, "covariance": total}
        return LeastSquaresState(**fields)

    def update(
        self,
        state: LeastSquaresState,
        t_s: Array,
        az_rad: Array,
        el_rad: Array,
        sigma_rad: Array,
    ) -> LeastSquaresState:
        """Update the estimate with one measurement per case.

        Parameters
        ----------
        state : LeastSquaresState
            State before the measurement.
        t_s, az_rad, el_rad : ndarray, shape (N,)
            Time, azimuth and elevation; a case with angles that are not finite has no measurement.
        sigma_rad : ndarray, shape (), (N,), (2, 1) or (2, N)
            Standard deviation of both angles, or of azimuth and of elevation.

        Returns
        -------
        LeastSquaresState
            State at the time of the measurement.

        Raises
        ------
        InputError
            If the shapes do not match, a time is not finite, or a sigma is not positive.
        """
        t_s, azimuth, elevation = validate_measurement(state, t_s, az_rad, el_rad)
        noise = _variances(sigma_rad, t_s.size)
        good = np.isfinite(azimuth + elevation)
        # counting takes a tenth of the time of `all` and `any`, which counts with a single antenna
        every = np.count_nonzero(good) == good.size
        if not every:
            azimuth, elevation = np.where(good, azimuth, 0.0), np.where(good, elevation, 0.0)
        angles = (azimuth, elevation)
        first_update = self._process(state, t_s, angles, noise)
        # count outliers, and restart cases whose orbit they contradict
        outlying = (first_update.correction.weight > 1.0) & good
        outliers, restarts = state.outliers + outlying, state.restarts
        agreed = state.agreed + good
        if np.count_nonzero(outlying):
            agreed = np.where(outlying, np.maximum(state.agreed - 1.0, -1.0), agreed)
            anew, first_update = self._restart_outlying(
                state, outlying, first_update, t_s, angles, noise
            )
            agreed = np.where(anew, 0.0, agreed)
            outliers = np.where(anew, state.count, outliers)
            restarts = restarts + anew

        # iterated update (Gauss-Newton [1]_): relinearise only where the correction is large
        before, prior, first = first_update
        last = first
        step = first.step if every else np.where(good, first.step, 0.0)
        shift = first.shift if every else np.where(good, first.shift, 0.0)
        at = self._apply_step(before, step, state.sense)
        for _ in range(self.spec.relinearisations):
            moving = shift > _LARGE
            if not np.count_nonzero(moving):
                break
            comparison = compare_directions(
                at.elements, at.clock, t_s + at.clock, state.site,
                np.array([*angles, *at.biases, at.horizon]), self._field,
                short_period=self.short_period,
            )  # fmt: skip
            again = self._correction(
                at, comparison, prior, noise, state.sense, (step, first.weight)
            )
            last = select_correction(moving, again, last)
            step = np.where(moving, again.step, step)
            shift = np.where(moving, again.shift, 0.0)
            at = self._apply_step(before, step, state.sense)
        covariance = last.covariance if every else np.where(good, last.covariance, prior)
        return LeastSquaresState(
            state.site, t_s, at.elements, at.biases, state.count + good, at.clock, at.horizon,
            covariance, state.sense, outliers, agreed, restarts, state.beginning or state,
        )  # fmt: skip

    def point(self, state: LeastSquaresState, times_s: Array) -> tuple[Array, Array]:
        """Return azimuth and elevation (2, K, N) as `predict` does, with and without biases."""
        return point_antenna(
            state, times_s, self._field, short_period=self.short_period,
            clock_s=state.time_bias_s, horizon_rad=state.horizon_rad,
        )  # fmt: skip

    def predict(
        self, state: LeastSquaresState, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N).

        `times_s` are times of the station's clock, or true times if `biased` is False.
        """
        n = self._chart.count
        covariance = np.zeros((state.t_s.size, n + 4, n + 4))
        covariance[:, self._prediction_rows[:, None], self._prediction_rows] = (
            state.covariance.transpose(2, 0, 1)
        )
        return predict_angles(
            state,
            times_s,
            self._field,
            self._chart.columns(state.elements, state.sense),
            covariance,
            self._chart.walk(state.elements, self.spec.drift_m),
            short_period=self.short_period,
            biased=biased,
            clock_s=state.time_bias_s,
            horizon_rad=state.horizon_rad,
        )

    def _process(
        self, state: LeastSquaresState, t_s: Array, angles: tuple[Array, Array], noise: Array
    ) -> _Update:
        """Propagate the estimate to the time of a measurement and compute the first correction."""
        dt = t_s - state.t_s
        if self._one_call is not None:
            after, prior, correction = predict_and_correct(
                self._one_call, state.elements, dt, state.time_bias_s, t_s + state.time_bias_s,
                state.site, (*angles, *state.biases_rad, state.horizon_rad), state.covariance,
                noise,
            )  # fmt: skip
            at = _Estimate(after, state.biases_rad, state.time_bias_s, state.horizon_rad)
            return _Update(at, prior, correction)
        after, slopes, comparison = propagate_and_compare(
            state.elements, dt, state.time_bias_s, t_s + state.time_bias_s, state.site,
            np.array([*angles, *state.biases_rad, state.horizon_rad]), self._field,
            short_period=self.short_period,
        )  # fmt: skip
        prior = state.covariance.copy()
        if self.spec.drift_m > 0.0:
            # The random walk is added before the propagation: a change of a then also changes the
            # angles, through the rates of Ω, ω and M.
            diagonal = prior.reshape(-1, t_s.size)[:: self.size + 1]
            walk = self._chart.walk(state.elements, self.spec.drift_m)
            diagonal[: self._chart.count] += walk.T * np.abs(dt)
        self._chart.carry(prior, state.elements, after, slopes, state.sense)
        at = _Estimate(after, state.biases_rad, state.time_bias_s, state.horizon_rad)
        return _Update(at, prior, self._correction(at, comparison, prior, noise, state.sense, None))

    def _restart_outlying(
        self,
        state: LeastSquaresState,
        outlying: NDArray[np.bool_],
        update: _Update,
        t_s: Array,
        angles: tuple[Array, Array],
        noise: Array,
    ) -> tuple[NDArray[np.bool_], _Update]:
        """Return the cases that restart from the nominal orbit, and the update that then holds.

        A case restarts if outliers outnumber agreeing measurements, and the new measurement is less
        of an outlier for the nominal orbit than for the estimated one.
        """
        doubtful = outlying & (state.agreed <= 0.0) & (state.restarts < _MOST_RESTARTS)
        if state.beginning is None or not doubtful.any():
            return np.zeros_like(doubtful), update
        other = self._process(state.beginning, t_s, angles, noise)
        anew = doubtful & (other.correction.weight < update.correction.weight)
        if not anew.any():
            return anew, update
        point = _Estimate(*(np.where(anew, a, b) for a, b in zip(other.at, update.at, strict=True)))
        prior = np.where(anew, other.prior, update.prior)
        return anew, _Update(
            point, prior, select_correction(anew, other.correction, update.correction)
        )

    def _correction(
        self,
        at: _Estimate,
        comparison: tuple[Array, Array, Array],
        prior: Array,
        noise: Array,
        sense: Array,
        known: tuple[Array, Array] | None,
    ) -> Correction:
        """Return the correction of the prior state, linearised at `at` (see `correct_estimate`)."""
        off, level2, by = comparison
        # H in the coordinates of the chart, with the columns of the estimated biases
        slopes = self._chart.project_slopes(by, self._bias_slopes, at.elements, sense)
        # on the sky an error of azimuth counts by cos h
        variances = noise + _LEAST_SIGMA**2
        variances[0] = noise[0] * level2 + _LEAST_SIGMA**2
        return correct_estimate(prior, slopes, off, variances, self.spec.gate, known)

    def _apply_step(self, before: _Estimate, step: Array, sense: Array) -> _Estimate:
        """Add a step (m, N) to an estimate."""
        elements = self._chart.apply_step(before.elements, step[: self._chart.count], sense)
        biases, clock, horizon = before.biases, before.clock, before.horizon
        if self._biases is not None:
            biases = biases + step[self._biases]
        if self._clock is not None:
            clock = clock + step[self._clock]
        if self._horizon is not None:
            horizon = horizon + step[self._horizon]
        return _Estimate(elements, biases, clock, horizon)


class _Estimate(NamedTuple):
    """Estimated quantities: elements (6, N), angle biases (2, N), time and horizon bias (N,)."""

    elements: Array
    biases: Array
    clock: Array
    horizon: Array


class _Update(NamedTuple):
    """Propagated estimate at a measurement's time, its covariance (m, m, N), and the correction."""

    at: _Estimate
    prior: Array
    correction: Correction


def _variances(sigma_rad: Array, cases: int) -> Array:
    """Return the variances (2, N) of azimuth and elevation."""
    sigma = np.asarray(sigma_rad, dtype=float)
    if sigma.shape not in ((), (cases,), (2, 1), (2, cases)) or (
        np.count_nonzero(sigma > 0.0) < sigma.size
    ):
        raise InputError(
            f"sigma_rad must be > 0, of shape (), ({cases},) or (2, {cases}); got shape "
            f"{sigma.shape}, least {sigma.min(initial=np.inf):.6g}"
        )
    variances = np.empty((2, cases))
    variances[:] = sigma * sigma
    return variances
