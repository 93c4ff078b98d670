r"""Recursive least squares on mean elements, with biases: an extended Kalman filter.

The state is some of the mean elements (at the time of the last measurement), the biases of azimuth
and elevation, and a bias of the time tags. Between measurements the elements move by their secular
rates; what is seen of them contains, if asked, the short-period terms.

A measurement is compared on the sky: with the unit vectors a, b of rising azimuth and elevation at
the direction measured, freed of the biases, and the direction u(x) expected,

.. math::

    ν = -\begin{pmatrix} a·u \\ b·u \end{pmatrix}, \quad
    H = \begin{pmatrix} a·\partial u & \cos h & 0 \\ b·\partial u & 0 & 1 \end{pmatrix}, \quad
    R = \mathrm{diag}(σ_A^2 \cos^2 h, σ_h^2),

so that nothing is singular at the zenith. The covariance is updated in Joseph's form [1]_; a
measurement that moves the state far is linearised again where it leads [2]_.

References
----------
.. [1] Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, Academic
   Press, section II.6.
.. [2] Bell, B. M., Cathey, F. W. (1993), The iterated Kalman filter update as a Gauss-Newton
   method, IEEE Trans. Automatic Control 38, 294-297.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.earth.geodetic import Station
from hillsphere.earth.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.mean_elements import sense_of
from hillsphere_tracking.trackers.charts import Chart, Equinoctials, Selected
from hillsphere_tracking.trackers.observation import advance, compared
from hillsphere_tracking.trackers.specs import LeastSquaresSpec
from hillsphere_tracking.trackers.state import (
    OrbitState,
    field_of,
    measured,
    seen_covariance,
    start,
)

__all__ = ["LeastSquares", "LeastSquaresState"]

_LARGE = 3e-3
"""Correction on the sky, rad, above which a measurement is linearised again; what its square
neglects, 1e-5, is below any antenna's noise."""
_LEAST_SIGMA = 1e-7
"""Least standard deviation on the sky, rad: at the zenith an azimuth tells nothing, exactly."""


@dataclass(frozen=True)
class LeastSquaresState(OrbitState):
    """An orbit with the covariance of what is estimated.

    Parameters
    ----------
    time_bias_s : ndarray, shape (N,)
        True time of a measurement minus its tag.
    covariance : ndarray, shape (m, m, N)
        Of the m quantities: elements (or equinoctial ones), angle biases, time bias.
    sense : ndarray, shape (N,)
        ±1, of the equinoctial elements.
    outliers : ndarray, shape (N,)
        How many measurements lost weight.
    """

    time_bias_s: Array
    covariance: Array
    sense: Array
    outliers: Array


@dataclass(frozen=True)
class _Correction:
    """What one linearisation makes of a measurement; the last but one axes are those of H."""

    step: Array
    gain: Array
    slopes: Array
    variances: Array
    weight: Array
    shift: Array


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
        charts: dict[str, Chart] = {
            "node_anomaly": Selected((3, 5)),
            "size_node_anomaly": Selected((0, 3, 5)),
            "all": Equinoctials(),
        }
        self._chart = charts[spec.parameters]
        n = self._chart.count
        self._biases = slice(n, n + 2) if spec.angle_biases else None
        self._clock = n + 2 * spec.angle_biases if spec.time_bias else None
        self.size = n + 2 * spec.angle_biases + spec.time_bias
        self._unit = np.eye(self.size)

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
        sense = sense_of(state.elements)
        found = self._chart.settled(state.elements, sense)
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
        zero = np.zeros(cases)
        kept = vars(state) | {"elements": found}
        return LeastSquaresState(**kept, time_bias_s=zero, covariance=covariance.transpose(1, 2, 0),
                                 sense=sense, outliers=zero)  # fmt: skip

    def with_biases(
        self, state: LeastSquaresState, biases_rad: Array, covariance: Array
    ) -> LeastSquaresState:
        """Return a state that begins with a station's biases, as earlier passes left them.

        Parameters
        ----------
        state : LeastSquaresState
            Before the first measurement.
        biases_rad : ndarray, shape (2,) or (2, N)
            Of azimuth and elevation, measured minus true.
        covariance : ndarray, shape (2, 2)
            Of them, rad².

        Returns
        -------
        LeastSquaresState
            With them.

        Raises
        ------
        InputError
            If the tracker estimates no angle biases.
        """
        if self._biases is None:
            raise InputError("this tracker estimates no biases; set angle_biases = true")
        total = state.covariance.copy()
        total[self._biases, :] = total[:, self._biases] = 0.0
        total[self._biases, self._biases] = np.asarray(covariance, dtype=float)[:, :, None]
        given = np.asarray(biases_rad, dtype=float).reshape(2, -1)
        biases = np.broadcast_to(given, state.biases_rad.shape).copy()
        return LeastSquaresState(**(vars(state) | {"biases_rad": biases, "covariance": total}))

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
        t_s, azimuth, elevation = measured(state, t_s, az_rad, el_rad)
        noise = _variances(sigma_rad, t_s.size)
        good = np.isfinite(azimuth + elevation)
        every = bool(good.all())
        if not every:
            azimuth, elevation = np.where(good, azimuth, 0.0), np.where(good, elevation, 0.0)
        before, prior = self._carried(state, t_s)

        at = (before, state.biases_rad, state.time_bias_s)
        last = first = self._correction(state, at, prior, t_s, azimuth, elevation, noise, None)
        outlying = (first.weight > 1.0) & good
        step = first.step if every else np.where(good[:, None], first.step, 0.0)
        shift = first.shift if every else np.where(good, first.shift, 0.0)
        at = self._moved(state, before, step)
        for _ in range(self.spec.relinearisations):
            moving = shift > _LARGE
            if not moving.any():
                break
            again = self._correction(
                state, at, prior, t_s, azimuth, elevation, noise, (step, first.weight)
            )
            last = _where(moving, again, last)
            step = np.where(moving[:, None], again.step, step)
            shift = np.where(moving, again.shift, 0.0)
            at = self._moved(state, before, step)
        rest = self._unit - last.gain @ last.slopes
        covariance = rest @ prior @ rest.transpose(0, 2, 1)
        covariance += (last.gain * last.variances[:, None, :]) @ last.gain.transpose(0, 2, 1)
        if not every:
            covariance = np.where(good[:, None, None], covariance, prior)
        covariance = 0.5 * (covariance.transpose(1, 2, 0) + covariance.transpose(2, 1, 0))
        return LeastSquaresState(
            state.site, t_s, at[0], at[1], state.count + good, at[2], covariance, state.sense,
            state.outliers + outlying,
        )  # fmt: skip

    def predict(self, state: LeastSquaresState, times_s: Array) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N)."""
        n = self._chart.count + 2 * self.spec.angle_biases
        return seen_covariance(
            state,
            times_s,
            self._field,
            self._chart.columns(state.elements, state.sense),
            state.covariance.transpose(2, 0, 1)[:, :n, :n],
            self._chart.walk(state.elements, self.spec.drift_m),
            short_period=self.spec.short_period,
        )

    def _carried(self, state: LeastSquaresState, t_s: Array) -> tuple[Array, Array]:
        """Return the elements (6, N) and the covariance (N, m, m) at the measurement's time."""
        n, dt = self._chart.count, t_s - state.t_s
        after, slopes = advance(state.elements, dt, self._field)
        transition = np.empty((t_s.size, self.size, self.size))
        transition[:] = self._unit
        transition[:, :n, :n] = self._chart.carried(state.elements, after, slopes, state.sense)
        covariance = state.covariance.transpose(2, 0, 1).copy()
        # the walk at once, before the interval: what it does to the rates of Ω, ω, M then counts
        diagonal = covariance.reshape(t_s.size, -1)[:, :: self.size + 1]
        diagonal[:, :n] += self._chart.walk(state.elements, self.spec.drift_m) * np.abs(dt)[:, None]
        covariance = transition @ covariance @ transition.transpose(0, 2, 1)
        return after, covariance

    def _correction(
        self,
        state: LeastSquaresState,
        at: tuple[Array, Array, Array],
        prior: Array,
        t_s: Array,
        azimuth: Array,
        elevation: Array,
        noise: Array,
        known: tuple[Array, Array] | None,
    ) -> _Correction:
        """Return the step from the state before the measurement, linearised at another one.

        `known` are the step from the state before to that one, and the outliers' weight: None for
        none, and for a weight to be found.
        """
        elements, biases, clock = at
        n, spec = self._chart.count, self.spec
        off, by, cos_el = compared(
            elements, clock, t_s + clock, state.site, azimuth - biases[0], elevation - biases[1],
            self._field, short_period=spec.short_period,
        )  # fmt: skip
        by = by.transpose(2, 0, 1)
        slopes = np.zeros((t_s.size, 2, self.size))
        slopes[:, :, :n] = self._chart.sliced(by, elements, state.sense)
        if self._biases is not None:
            slopes[:, 0, n] = cos_el
            slopes[:, 1, n + 1] = 1.0
        if self._clock is not None:
            slopes[:, :, self._clock] = by[:, :, 6]
        # what the state before would have left, to this linearisation
        left = -off.T[:, :, None]
        if known is not None:
            left = left + slopes @ known[0][:, :, None]
        variances = noise.copy()
        variances[:, 0] *= cos_el * cos_el
        variances += _LEAST_SIGMA**2
        crossed = prior @ slopes.transpose(0, 2, 1)
        expected = slopes @ crossed
        inverse = _inverse(expected, variances)
        if known is None:
            distance = (left * (inverse @ left)).sum(axis=(1, 2))
            weight = np.maximum(distance / spec.gate**2, 1.0)
        else:
            weight = known[1]
        if weight.max() > 1.0:
            variances *= weight[:, None]
            inverse = _inverse(expected, variances)
        gain = crossed @ inverse
        step = gain @ left
        moved = step if known is None else step - known[0][:, :, None]
        shift = np.abs(slopes @ moved).max(axis=(1, 2))
        return _Correction(step[:, :, 0], gain, slopes, variances, weight, shift)

    def _moved(
        self, state: LeastSquaresState, before: Array, step: Array
    ) -> tuple[Array, Array, Array]:
        """Return elements, biases and time bias after a step (N, m)."""
        n = self._chart.count
        elements = self._chart.moved(before, step[:, :n].T, state.sense)
        biases, clock = state.biases_rad, state.time_bias_s
        if self._biases is not None:
            biases = biases + step[:, self._biases].T
        if self._clock is not None:
            clock = clock + step[:, self._clock]
        return elements, biases, clock


def _inverse(expected: Array, variances: Array) -> Array:
    """Return the inverses (N, 2, 2) of the innovation's covariance."""
    p, q = expected[:, 0, 0] + variances[:, 0], expected[:, 1, 1] + variances[:, 1]
    r = expected[:, 0, 1]
    one = 1.0 / (p * q - r * r)
    made = np.empty_like(expected)
    made[:, 0, 0] = q * one
    made[:, 1, 1] = p * one
    made[:, 0, 1] = made[:, 1, 0] = -r * one
    return made


def _variances(sigma_rad: Array, cases: int) -> Array:
    """Return the variances (N, 2) of azimuth and elevation."""
    sigma = np.asarray(sigma_rad, dtype=float)
    if sigma.shape not in ((), (cases,), (2, 1), (2, cases)) or not (sigma > 0.0).all():
        raise InputError(
            f"sigma_rad must be > 0, of shape (), ({cases},) or (2, {cases}); got shape "
            f"{sigma.shape}, least {sigma.min(initial=np.inf):.6g}"
        )
    made = np.empty((cases, 2))
    made[:] = (sigma * sigma).T if sigma.ndim == 2 else (sigma * sigma).reshape(-1, 1)
    return made


def _where(choice: NDArray[np.bool_], new: _Correction, old: _Correction) -> _Correction:
    """Return the new correction in the cases chosen, else the old."""

    def one(name: str) -> Array:
        this, that = getattr(new, name), getattr(old, name)
        return np.asarray(np.where(choice.reshape(-1, *(1,) * (this.ndim - 1)), this, that))

    return _Correction(*(one(name) for name in vars(new)))
