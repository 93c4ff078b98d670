r"""Remainders of motion and measurements over a belief: what a linear filter leaves out.

A filter treats a function h as linear over the spread of a belief with the mean x̄ and the root S.
What it leaves out is the remainder

.. math:: ρ(x) = h(x) - h(\bar x) - H (x - \bar x),

H the derivatives at the mean. The root mean square of ρ over the belief, in units of the noise of
the measurement, says how much of what a linear filter takes for noise is curvature: with the
value c it believes in a variance that is too small by the factor 1 + c². The mean of ρ and the
covariance of h in units of the innovation's root compare the linear moments with those by sigma
points. The remainder at the updated mean, ρ(x̂), is the relative curvature of Bates and Watts [1]_
along the step that the update has taken.

Moments are taken over two sets of 2n sigma points, along the columns of S and along those of S Q,
Q a rotation. The first alone does not see a product of two states.

References
----------
.. [1] Bates, Watts (1980), Relative curvature measures of nonlinearity, J. Royal Statistical
   Society B 42(1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.linearisation import predict_measurement, sensitivity, transition
from hillsphere_estimators.roots import lower_root, solve_root
from hillsphere_estimators.state_angles import state_angles, wrap_differences

__all__ = [
    "CURVED",
    "MotionCurvature",
    "UpdateCurvature",
    "measurement_curvature",
    "motion_curvature",
    "update_curvature",
]

CURVED = 0.5
"""Root mean square remainder, in standard deviations of the noise, above which an update counts as
curved: the variance of the noise that a linear update assumes is then too small by a quarter. For
motion the unit is the predicted standard deviation."""

_ROUNDING_STATE = 1e-9
"""Remainder of a state without variance, over its size, that is rounding: a motion of some thousand
steps loses some digits of sixteen."""
_ROUNDING_SIGMAS = 1e-6
"""Remainder of a combination of states without variance, in standard deviations of the states, that
is the error of derivatives by differences."""


@dataclass(frozen=True)
class UpdateCurvature:
    """Curvature of m measured rows of N cases at one update; zero in rows that were not used.

    Parameters
    ----------
    prior, posterior : ndarray, shape (m, N)
        Root mean square of the remainder over the belief before and after the update, in standard
        deviations of the noise.
    path : ndarray, shape (m, N)
        Size of the remainder at the updated mean, linearised at the mean before, likewise.
    shift : ndarray, shape (m, N)
        Mean of the remainder over the belief before, in standard deviations of the innovation.
    ratio : ndarray, shape (m, N)
        Variance of the predicted measurement with its noise by sigma points, over that by
        linearisation; 1 in rows that were not used.
    cross : ndarray, shape (m, N)
        Length of the difference of both covariances with the states, in units of the roots of the
        states and of the innovation.
    used : ndarray of bool, shape (m, N)
        Rows that were used.
    """

    prior: Array
    posterior: Array
    path: Array
    shift: Array
    ratio: Array
    cross: Array
    used: NDArray[np.bool_]


@dataclass(frozen=True)
class MotionCurvature:
    """Curvature of the motion of N cases between two times.

    Parameters
    ----------
    rms : ndarray, shape (N,)
        Root mean square of the remainder over the belief, as a length in standard deviations of
        the linearly predicted belief.
    shift : ndarray, shape (N,)
        Length of the mean of the remainder, likewise.
    """

    rms: Array
    shift: Array


def update_curvature(
    model: EstimationModel,
    before: Belief,
    after: Belief,
    measurements: MeasurementSet,
    used: NDArray[np.bool_] | None = None,
) -> UpdateCurvature:
    """Return the curvature of the measurements at an update.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    before, after : Belief
        Beliefs of N cases before and after the update.
    measurements : MeasurementSet
        Measurements of m rows at that time; their values do not matter.
    used : ndarray of bool, shape (m, N), optional
        Rows that were used; all that are present by default.

    Returns
    -------
    UpdateCurvature
        One number a row and case.

    Raises
    ------
    InputError
        If the model has another number of rows than the measurements.
    """
    layout, there = usable(measurements)
    used = there if used is None else there & used
    sigma = np.where(used, measurements.sigma, 1.0)
    slopes, rho, span = _remainders(model, before, layout)
    # on both sets of points the columns of the root reach √n: P = S Sᵀ is their mean square
    linear = np.sum(span**2, axis=2).T
    spread = np.sqrt(linear + sigma**2)
    mean = np.mean(rho, axis=1)
    n = len(before.x)
    points = _directions(n)
    image = np.einsum("Nmj,jk->mkN", span, points) + rho
    variance = np.mean((image - image.mean(axis=1, keepdims=True)) ** 2, axis=1) + sigma**2
    cross = np.einsum("mkN,jk->mjN", rho, points) / points.shape[1]
    z = predict_measurement(model, before, layout)
    end = layout.difference(predict_measurement(model, after, layout), z)
    step = wrap_differences(after.x - before.x, state_angles(model, n)).T[:, :, None]
    path = np.abs(_wrap_rows(end - (slopes @ step)[:, :, 0].T, layout)) / sigma
    return UpdateCurvature(
        _over_noise(rho, sigma, used),
        measurement_curvature(model, after, measurements, used)[0],
        np.where(used, path, 0.0),
        np.where(used, np.abs(mean) / spread, 0.0),
        np.where(used, variance / spread**2, 1.0),
        np.where(used, np.linalg.norm(cross, axis=1) / spread, 0.0),
        used,
    )


def measurement_curvature(
    model: EstimationModel,
    belief: Belief,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Return the root mean square remainders of measurements over a belief, and their means.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    belief : Belief
        Belief of N cases.
    measurements : MeasurementSet
        Of m rows at its time.
    used : ndarray of bool, shape (m, N)
        Rows that were used.

    Returns
    -------
    rms, mean : ndarray, shape (m, N)
        In standard deviations of the noise; zero in rows that were not used. The mean is a size.
    """
    sigma = np.where(used, measurements.sigma, 1.0)
    rho = _remainders(model, belief, usable(measurements)[0])[1]
    mean = np.where(used, np.abs(np.mean(rho, axis=1)) / sigma, 0.0)
    return _over_noise(rho, sigma, used), mean


def _over_noise(rho: Array, sigma: Array, used: NDArray[np.bool_]) -> Array:
    """Return the root mean squares (m, N) of remainders (m, 4n, N) in units of the noise."""
    return np.asarray(np.where(used, np.sqrt(np.mean(rho**2, axis=1)) / sigma, 0.0))


def _wrap_rows(off: Array, layout: Layout) -> Array:
    """Return differences of measurements (m, ...) with those of angles the short way round."""
    return wrap_differences(off, layout.angles)


def motion_curvature(
    model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
) -> MotionCurvature:
    """Return the curvature of the motion from a belief to later times.

    Parameters
    ----------
    model : EstimationModel
        Motion model.
    belief : Belief
        Belief of N cases.
    t_to_s : ndarray, shape (N,)
        Later times, s.
    control : ndarray, shape (p, N)
        Controls.

    Returns
    -------
    MotionCurvature
        In units of the predicted root; directions that are predicted exactly do not count.
    """
    n, cases = belief.x.shape
    middle, phi = transition(model, belief, t_to_s, control)
    points, offs = _points(belief)
    each = points.shape[1]
    there = model.advance(
        points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(t_to_s, each),
        np.tile(control, each), np.tile(np.arange(cases), each),
    ).reshape(n, each, cases)  # fmt: skip
    rho = there - middle[:, None] - np.einsum("Nij,jkN->ikN", phi, offs)
    rho = wrap_differences(rho, state_angles(model, n))
    noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
    root = lower_root(np.swapaxes(np.concatenate([phi @ belief.root, noise], axis=2), 1, 2))
    turned = rho.transpose(2, 0, 1)
    white = solve_root(root, turned)
    # a remainder in a direction that the linear prediction knows exactly is beyond any measure
    odd = np.abs(turned - root @ white)
    rounding = _ROUNDING_STATE * np.abs(middle).T + _ROUNDING_SIGMAS * np.linalg.norm(root, axis=2)
    white = np.where((odd > rounding[:, :, None]).any(axis=1, keepdims=True), np.inf, white)
    rms = np.sqrt(np.mean(np.sum(white**2, axis=1), axis=1))
    return MotionCurvature(rms, np.linalg.norm(white.mean(axis=2), axis=1))


def _remainders(
    model: EstimationModel, belief: Belief, layout: Layout
) -> tuple[Array, Array, Array]:
    """Return derivatives (N, m, n), remainders ρ (m, 4n, N) at the points, and H S (N, m, n)."""
    n, cases = belief.x.shape
    z, slopes = sensitivity(model, belief, layout)
    points, offs = _points(belief)
    each = points.shape[1]
    shown = layout.fitting(
        model.observe(
            points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(np.arange(cases), each)
        )
    ).reshape(-1, each, cases)
    rho = layout.difference(shown, z[:, None]) - np.einsum("Nmj,jkN->mkN", slopes, offs)
    return slopes, _wrap_rows(rho, layout), slopes @ belief.root


def _points(belief: Belief) -> tuple[Array, Array]:
    """Return the sigma points (n, 4n, N), and their deviations from the mean."""
    offs = np.einsum("Nij,jk->ikN", belief.root, _directions(len(belief.x)))
    return np.ascontiguousarray(belief.x[:, None] + offs), offs


@lru_cache(maxsize=64)
def _directions(n: int) -> Array:
    """Return 4n points (n, 4n) of unit covariance, ±√n along the axes and along rotated ones.

    The rotation is the discrete cosine transform, none of whose columns is along an axis for n > 1.
    """
    half = np.concatenate([np.eye(n), dct(np.eye(n), norm="ortho", axis=0)], axis=1)
    points: Array = np.sqrt(n) * np.concatenate([half, -half], axis=1)
    points.flags.writeable = False
    return points
