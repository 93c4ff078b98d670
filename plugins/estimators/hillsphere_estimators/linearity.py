r"""Curvature of motion and measurements over a belief, and the first update that is too curved.

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.checks import Check
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.linearisation import predict_measurement, sensitivity, transition
from hillsphere_estimators.roots import lower_root
from hillsphere_estimators.smoother import link

__all__ = [
    "CURVED",
    "MotionCurvature",
    "NonlinearUpdate",
    "UpdateCurvature",
    "curvature_checks",
    "curved_cases",
    "first_nonlinear",
    "measure_curvatures",
    "motion_curvature",
    "update_curvature",
]

CURVED = 0.5
"""Root mean square remainder, in standard deviations of the noise, above which an update counts as
curved: the variance of the noise that a linear update assumes is then too small by a quarter. For
motion the unit is the predicted standard deviation."""


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
    own = _remainders(model, after, layout)[1]

    def over_noise(values: Array) -> Array:
        return np.asarray(np.where(used, np.sqrt(np.mean(values**2, axis=1)) / sigma, 0.0))

    # on both sets of points the columns of the root reach √n: P = S Sᵀ is their mean square
    linear = np.sum(span**2, axis=2).T
    spread = np.sqrt(linear + sigma**2)
    mean = np.mean(rho, axis=1)
    n = len(before.x)
    points = _directions(n)
    image = np.einsum("Nmj,jk->mkN", span, points) + rho
    variance = np.mean((image - image.mean(axis=1, keepdims=True)) ** 2, axis=1) + sigma**2
    cross = np.einsum("mkN,jk->mjN", rho, points) / points.shape[1]
    # a step that leaves the range of the rows' angles has a remainder like any other
    z = predict_measurement(model, before, layout)
    end = layout.difference(predict_measurement(model, after, layout), z)
    step = (after.x - before.x).T[:, :, None]
    path = np.abs(end - (slopes @ step)[:, :, 0].T) / sigma
    return UpdateCurvature(
        over_noise(rho),
        over_noise(own),
        np.where(used, path, 0.0),
        np.where(used, np.abs(mean) / spread, 0.0),
        np.where(used, variance / spread**2, 1.0),
        np.where(used, np.linalg.norm(cross, axis=1) / spread, 0.0),
        used,
    )


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
        In units of the predicted root; a direction without variance is compared with rounding.
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
    noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
    root = lower_root(np.swapaxes(np.concatenate([phi @ belief.root, noise], axis=2), 1, 2))
    # a state without variance is compared with the rounding of the states
    least = 1e-12 * np.maximum(np.abs(middle), 1e-300).T
    root = root + np.where(
        np.eye(n, dtype=bool), np.where(root == 0.0, least[:, :, None], 0.0), 0.0
    )
    white = np.linalg.solve(root, rho.transpose(2, 0, 1))
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
    return slopes, rho, slopes @ belief.root


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


@dataclass(frozen=True)
class NonlinearUpdate:
    """The first update, or the first motion, that is too curved for a linear filter.

    Parameters
    ----------
    index : int
        Its set of measurements, from 0.
    time_s : float
        Its time, s, in the first case to which it happens.
    channel : str
        Name of the measured channel with the largest curvature; "motion" for the motion that ends
        at this time.
    row : int
        Row of the measurements; −1 for motion.
    size : float
        Largest root mean square remainder over the belief before it, in standard deviations of the
        noise; for motion of the predicted belief.
    ratio : float
        Variance of the innovation by sigma points over that by linearisation; 1 for motion.
    shift : float
        Mean of the remainder, in standard deviations of the innovation or of the predicted belief.
    cases : int
        Number of cases that are as curved at this update.
    """

    index: int
    time_s: float
    channel: str
    row: int
    size: float
    ratio: float
    shift: float
    cases: int

    def __str__(self) -> str:
        if self.row < 0:
            return (
                f"the motion to t = {self.time_s:g} s departs from its linearisation by "
                f"{self.size:.3g} standard deviations of the predicted states (limit {CURVED:g})"
            )
        return (
            f"the update at t = {self.time_s:g} s with {self.channel}: curvature over the belief "
            f"is {self.size:.3g} standard deviations of the noise (limit {CURVED:g})"
        )


def measure_curvatures(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    before: Sequence[Belief] | None,
) -> tuple[list[UpdateCurvature], Array]:
    """Measure the curvature of each update of a run, and of the motion to it.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets.
    after : sequence of Belief
        K: the filter's beliefs after each.
    innovations : sequence of Innovation
        K: their rows `used` count.
    controls : sequence of ndarray, shape (p, N)
        K: before each set.
    before : sequence of Belief, optional
        K: the beliefs before each set; predicted by linearisation by default.

    Returns
    -------
    updates : list of UpdateCurvature
        K of them.
    motions : ndarray, shape (K, N)
        Root mean square remainders of the motion, 0 without motion.
    """
    curves, motions = [], []
    for k, measured in enumerate(measurements):
        start = prior if not k else after[k - 1]
        moves = bool(k) or not np.array_equal(prior.t_s, measured.t_s)
        if before is not None:
            at = before[k]
        else:
            at = link(model, start, measured.t_s, controls[k]).predicted if moves else prior
        curves.append(update_curvature(model, at, after[k], measured, innovations[k].used))
        motions.append(
            motion_curvature(model, start, measured.t_s, controls[k]).rms
            if moves
            else np.zeros(len(prior.t_s))
        )
    return curves, np.array(motions)


def curved_cases(curves: Sequence[UpdateCurvature], motions: Array) -> NDArray[np.bool_]:
    """Return the cases in which an update or the motion is curved.

    Parameters
    ----------
    curves : sequence of UpdateCurvature
        K updates of N cases.
    motions : ndarray, shape (K, N)
        Root mean square remainders of the motion to each.

    Returns
    -------
    ndarray of bool, shape (N,)
        Whether any is beyond `CURVED`.
    """
    sizes = np.array([curve.prior.max(axis=0, initial=0.0) for curve in curves])
    return np.asarray(((sizes > CURVED) | (motions > CURVED)).any(axis=0))


def first_nonlinear(
    curves: Sequence[UpdateCurvature], motions: Array, measurements: Sequence[MeasurementSet]
) -> NonlinearUpdate | None:
    """Return the first motion or update that is curved in any case.

    Parameters
    ----------
    curves : sequence of UpdateCurvature
        K updates of N cases.
    motions : ndarray, shape (K, N)
        Root mean square remainders of the motion to each.
    measurements : sequence of MeasurementSet
        K sets, for times and names of channels.

    Returns
    -------
    NonlinearUpdate or None
        None if no case is beyond `CURVED`.
    """
    for k, (curve, measured) in enumerate(zip(curves, measurements, strict=True)):
        far = motions[k] > CURVED
        if far.any():
            case = int(np.nanargmax(motions[k]))
            return NonlinearUpdate(
                k, float(measured.t_s[case]), "motion", -1, float(motions[k, case]), 1.0, np.nan,
                int(far.sum()),
            )  # fmt: skip
        bent = curve.prior > CURVED
        if bent.any():
            place = np.unravel_index(int(np.nanargmax(curve.prior)), curve.prior.shape)
            row, case = int(place[0]), int(place[1])
            names = [
                channel.name
                for block in measured.blocks
                for channel in block
                for _ in range(channel.rows)
            ]
            return NonlinearUpdate(
                k, float(measured.t_s[case]), names[row], row, float(curve.prior[row, case]),
                float(curve.ratio[row, case]), float(curve.shift[row, case]),
                int(bent.any(axis=0).sum()),
            )  # fmt: skip
    return None


def curvature_checks(curves: Sequence[UpdateCurvature], motions: Array) -> dict[str, Check]:
    """Return the largest curvatures over a run.

    Parameters
    ----------
    curves : sequence of UpdateCurvature
        K updates of N cases.
    motions : ndarray, shape (K, N)
        Root mean square remainders of the motion to each.

    Returns
    -------
    dict of str to Check
        ``curvature``, ``path``, ``posterior_curvature`` and ``motion`` with the limit `CURVED`.
    """

    def largest(name: str) -> Array:
        each = [getattr(curve, name).max(axis=0, initial=0.0) for curve in curves]
        return np.asarray(np.max(each, axis=0))

    over = "remainder of a measurement, in sigmas of its noise,"
    sizes = {
        "curvature": (f"largest {over} over the belief before", largest("prior")),
        "path": (f"largest {over} along an update", largest("path")),
        "posterior_curvature": (
            f"{over} over the last belief", curves[-1].posterior.max(axis=0, initial=0.0),
        ),
        "motion": ("largest remainder of the motion, in predicted sigmas", motions.max(axis=0)),
    }  # fmt: skip
    return {
        name: Check(name, says, float(np.nanmax(each)), 0.0, CURVED, each, np.zeros(len(each)),
                    np.full(len(each), CURVED))
        for name, (says, each) in sizes.items()
    }  # fmt: skip
