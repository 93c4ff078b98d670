r"""Recursive least squares on mean elements, with biases: an extended Kalman filter.

The state is some of the mean elements (at the time of the last measurement), the biases of azimuth
and elevation, a bias of the time tags, and the horizon bias: a part of the elevation's bias that
goes with cot h. Between measurements the elements move by their secular rates; what is seen of them
contains, if asked, the short-period terms.

A measurement is compared on the sky: with the unit vectors a, b of rising azimuth and elevation at
the direction measured, freed of the biases, and the direction u(x) expected,

.. math::

    ν = -\begin{pmatrix} a·u \\ b·u \end{pmatrix}, \quad
    H = \begin{pmatrix} a·\partial u & \cos h & 0 & a·\dot u & 0 \\
                       b·\partial u & 0 & 1 & b·\dot u & \cot h \end{pmatrix}, \quad
    R = \mathrm{diag}(σ_A^2 \cos^2 h, σ_h^2),

so that nothing is singular at the zenith. `correction` says how it is taken; one that moves the
state far is linearised again where it leads [1]_. An orbit with more outliers than measurements
that agree with it, as when it began with one or on a side lobe of the antenna, is given up for the
nominal one; a burst of outliers at the end of many good measurements does not reach that.

References
----------
.. [1] Bell, B. M., Cathey, F. W. (1993), The iterated Kalman filter update as a Gauss-Newton
   method, IEEE Trans. Automatic Control 38, 294-297.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.mean_elements import retrograde_sign
from hillsphere_tracking.trackers.charts import Chart, EquinoctialElements, SelectedElements
from hillsphere_tracking.trackers.correction import Correction, correct_estimate, select_correction
from hillsphere_tracking.trackers.observation import compare_directions, propagate_and_compare
from hillsphere_tracking.trackers.specs import LeastSquaresSpec
from hillsphere_tracking.trackers.state import (
    OrbitState,
    field_of,
    predict_angles,
    start,
    validate_measurement,
)

__all__ = ["LeastSquares", "LeastSquaresState"]

_LARGE = 3e-3
"""Correction on the sky, rad, above which a measurement is linearised again; what its square
neglects, 1e-5, is below any antenna's noise."""
_MOST_RESTARTS = 5
"""How often at most: noise told far too small makes outliers of all, and no beginning helps."""
_LEAST_SIGMA = 1e-7
"""Least standard deviation on the sky, rad: at the zenith an azimuth tells nothing, exactly."""


@dataclass(frozen=True)
class LeastSquaresState(OrbitState):
    """An orbit with the covariance of what is estimated.

    Parameters
    ----------
    time_bias_s : ndarray, shape (N,)
        True time of a measurement minus its tag.
    horizon_rad : ndarray, shape (N,)
        Factor of cot h in the elevation's bias.
    covariance : ndarray, shape (m, m, N)
        Of the m quantities: elements (or equinoctial ones), angle biases, time bias, horizon bias.
    sense : ndarray, shape (N,)
        ±1, of the equinoctial elements.
    outliers : ndarray, shape (N,)
        How many measurements lost weight, or were given up where the orbit began anew.
    agreed : ndarray, shape (N,)
        How many measurements agreed with those before, less those that did not, at least −1.
    restarts : ndarray, shape (N,)
        How often the orbit began anew.
    beginning : LeastSquaresState or None
        What stood before the first measurement; None if this is it.
    """

    time_bias_s: Array
    horizon_rad: Array
    covariance: Array
    sense: Array
    outliers: Array
    agreed: Array
    restarts: Array
    beginning: LeastSquaresState | None = None


class LeastSquares:
    """Recursive least squares (see the module).

    Parameters
    ----------
    spec : LeastSquaresSpec
        Its parameters.
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
        """Rows of the covariance of the biases that last beyond a pass."""
        self._horizon = self.bias_rows.stop if spec.horizon_bias else None
        self.size = self.bias_rows.stop + spec.horizon_bias
        # rows of the derivatives of what is measured that are not by elements
        self._bias_slopes = (
            [6, 7] * spec.angle_biases + [8] * spec.time_bias + [9] * spec.horizon_bias
        )
        # rows of what is estimated among the elements and all four biases, as `predict` wants them
        self._prediction_rows = np.array([*range(n), *(row - 6 + n for row in self._bias_slopes)])

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> LeastSquaresState:
        """Return the nominal orbit and what is known of it; see `hillsphere.interfaces.Tracker`."""
        state = start(elements, t_s, stations, epoch, orientation)
        spec, n, cases = self.spec, self._chart.count, state.t_s.size
        sense = retrograde_sign(state.elements)
        found = self._chart.regularise(state.elements, sense)
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
        covariance[:, :n, :n] = self._chart.prior(found, sigmas, sense)
        if self._biases is not None:
            covariance[:, self._biases, self._biases] = spec.bias_sigma_rad**2 * np.eye(2)
        if self._clock is not None:
            covariance[:, self._clock, self._clock] = spec.time_bias_sigma_s**2
        if self._horizon is not None:
            covariance[:, self._horizon, self._horizon] = spec.horizon_bias_sigma_rad**2
        zero = np.zeros(cases)
        kept = vars(state) | {"elements": found}
        return LeastSquaresState(**kept, time_bias_s=zero, horizon_rad=zero,
                                 covariance=covariance.transpose(1, 2, 0), sense=sense,
                                 outliers=zero, agreed=zero - 1.0, restarts=zero)  # fmt: skip

    def with_biases(
        self, state: LeastSquaresState, biases: Array, covariance: Array
    ) -> LeastSquaresState:
        """Return a state that begins with a station's biases, as earlier passes left them.

        Parameters
        ----------
        state : LeastSquaresState
            Before the first measurement.
        biases : ndarray, shape (k,) or (k, N)
            Those that are estimated: of azimuth and elevation, measured minus true, rad, then of
            time, true minus tag, s. The horizon bias, which weather changes, begins anew.
        covariance : ndarray, shape (k, k)
            Of them.

        Returns
        -------
        LeastSquaresState
            With them.

        Raises
        ------
        InputError
            If the tracker estimates no biases, or not so many.
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
        kept = vars(state) | {"biases_rad": angles, "time_bias_s": clock, "covariance": total}
        return LeastSquaresState(**kept)

    def update(
        self,
        state: LeastSquaresState,
        t_s: Array,
        az_rad: Array,
        el_rad: Array,
        sigma_rad: Array,
    ) -> LeastSquaresState:
        """Take one measurement per case.

        Parameters
        ----------
        state : LeastSquaresState
            Before it.
        t_s, az_rad, el_rad : ndarray, shape (N,)
            Time, azimuth and elevation; angles that are not finite: the case has none.
        sigma_rad : ndarray, shape (), (N,), (2, 1) or (2, N)
            Standard deviation of both angles, or of azimuth and of elevation.

        Returns
        -------
        LeastSquaresState
            At the time of the measurement.

        Raises
        ------
        InputError
            If shapes do not fit, a time is not finite, or a sigma is not positive.
        """
        t_s, azimuth, elevation = validate_measurement(state, t_s, az_rad, el_rad)
        noise = _variances(sigma_rad, t_s.size)
        good = np.isfinite(azimuth + elevation)
        every = bool(good.all())
        if not every:
            azimuth, elevation = np.where(good, azimuth, 0.0), np.where(good, elevation, 0.0)
        shown = (azimuth, elevation)
        met = self._process(state, t_s, shown, noise)
        outlying = (met.correction.weight > 1.0) & good
        outliers, restarts = state.outliers + outlying, state.restarts
        agreed = state.agreed + good
        if outlying.any():
            agreed = np.where(outlying, np.maximum(state.agreed - 1.0, -1.0), agreed)
            anew, met = self._restart_outlying(state, outlying, met, t_s, shown, noise)
            agreed = np.where(anew, 0.0, agreed)
            outliers = np.where(anew, state.count, outliers)
            restarts = restarts + anew

        before, prior, first = met
        last = first
        step = first.step if every else np.where(good, first.step, 0.0)
        shift = first.shift if every else np.where(good, first.shift, 0.0)
        at = self._apply_step(before, step, state.sense)
        for _ in range(self.spec.relinearisations):
            moving = shift > _LARGE
            if not moving.any():
                break
            seen = compare_directions(
                at.elements, at.clock, t_s + at.clock, state.site,
                np.array([*shown, *at.biases, at.horizon]), self._field,
                short_period=self.short_period,
            )  # fmt: skip
            again = self._correction(at, seen, prior, noise, state.sense, (step, first.weight))
            last = select_correction(moving, again, last)
            step = np.where(moving, again.step, step)
            shift = np.where(moving, again.shift, 0.0)
            at = self._apply_step(before, step, state.sense)
        covariance = last.covariance if every else np.where(good, last.covariance, prior)
        return LeastSquaresState(
            state.site, t_s, at.elements, at.biases, state.count + good, at.clock, at.horizon,
            covariance, state.sense, outliers, agreed, restarts, state.beginning or state,
        )  # fmt: skip

    def predict(
        self, state: LeastSquaresState, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N).

        Of times of the station's clock; not `biased`, of true times.
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
        self, state: LeastSquaresState, t_s: Array, shown: tuple[Array, Array], noise: Array
    ) -> _Update:
        """Return what is known at a measurement's time, and what the measurement makes of it."""
        dt = t_s - state.t_s
        after, slopes, seen = propagate_and_compare(
            state.elements, dt, state.time_bias_s, t_s + state.time_bias_s, state.site,
            np.array([*shown, *state.biases_rad, state.horizon_rad]), self._field,
            short_period=self.short_period,
        )  # fmt: skip
        prior = state.covariance.copy()
        if self.spec.drift_m > 0.0:
            # the walk before the interval: what it does to the rates of Ω, ω, M then counts
            diagonal = prior.reshape(-1, t_s.size)[:: self.size + 1]
            walk = self._chart.walk(state.elements, self.spec.drift_m)
            diagonal[: self._chart.count] += walk.T * np.abs(dt)
        self._chart.carry(prior, state.elements, after, slopes, state.sense)
        at = _Estimate(after, state.biases_rad, state.time_bias_s, state.horizon_rad)
        return _Update(at, prior, self._correction(at, seen, prior, noise, state.sense, None))

    def _restart_outlying(
        self,
        state: LeastSquaresState,
        outlying: NDArray[np.bool_],
        met: _Update,
        t_s: Array,
        shown: tuple[Array, Array],
        noise: Array,
    ) -> tuple[NDArray[np.bool_], _Update]:
        """Return in which cases the orbit begins anew with this measurement, and what holds then.

        Those in which nothing speaks for what was measured before, and the new measurement is less
        of an outlier to the nominal orbit.
        """
        doubtful = outlying & (state.agreed <= 0.0) & (state.restarts < _MOST_RESTARTS)
        if state.beginning is None or not doubtful.any():
            return np.zeros_like(doubtful), met
        other = self._process(state.beginning, t_s, shown, noise)
        anew = doubtful & (other.correction.weight < met.correction.weight)
        if not anew.any():
            return anew, met
        point = _Estimate(*(np.where(anew, a, b) for a, b in zip(other.at, met.at, strict=True)))
        prior = np.where(anew, other.prior, met.prior)
        return anew, _Update(
            point, prior, select_correction(anew, other.correction, met.correction)
        )

    def _correction(
        self,
        at: _Estimate,
        seen: tuple[Array, Array, Array],
        prior: Array,
        noise: Array,
        sense: Array,
        known: tuple[Array, Array] | None,
    ) -> Correction:
        """Return the step from the state before the measurement, linearised where it was `seen`."""
        off, level2, by = seen
        slopes = self._chart.project_slopes(by, self._bias_slopes, at.elements, sense)
        variances = noise + _LEAST_SIGMA**2
        variances[0] = noise[0] * level2 + _LEAST_SIGMA**2
        return correct_estimate(prior, slopes, off, variances, self.spec.gate, known)

    def _apply_step(self, before: _Estimate, step: Array, sense: Array) -> _Estimate:
        """Return what is estimated after a step (m, N)."""
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
    """What is estimated: elements (6, N), angle biases (2, N), time and horizon bias (N,)."""

    elements: Array
    biases: Array
    clock: Array
    horizon: Array


class _Update(NamedTuple):
    """What is known at a measurement's time before it, with P (m, m, N), and its correction."""

    at: _Estimate
    prior: Array
    correction: Correction


def _variances(sigma_rad: Array, cases: int) -> Array:
    """Return the variances (2, N) of azimuth and elevation."""
    sigma = np.asarray(sigma_rad, dtype=float)
    if sigma.shape not in ((), (cases,), (2, 1), (2, cases)) or not (sigma > 0.0).all():
        raise InputError(
            f"sigma_rad must be > 0, of shape (), ({cases},) or (2, {cases}); got shape "
            f"{sigma.shape}, least {sigma.min(initial=np.inf):.6g}"
        )
    made = np.empty((2, cases))
    made[:] = sigma * sigma
    return made
