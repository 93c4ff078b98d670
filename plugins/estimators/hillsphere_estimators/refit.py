r"""A filter's beliefs compared with a fit of the whole arc of measurements.

Let x_s, P_s be mean and covariance of the states at a time given all measurements, and x_f, P_f
those of the filter. The error of x_s is not correlated with anything that the measurements give,
so that the expected NEES of the filter, given the measurements, is

.. math:: E[(x_f - x)^T P_f^{-1} (x_f - x)] =
          (x_f - x_s)^T P_f^{-1} (x_f - x_s) + \mathrm{tr}(P_f^{-1} P_s).

It needs no true states and is on average the number of states for a consistent filter. For an
optimal filter it is the test of Hausman [1]_, by which x_f − x_s has the covariance P_f − P_s.
Directions of the states that the filter knows exactly have no error and are left out. Considered
states are estimated by the fit, and their errors count like those of the others.

The fit is the maximum a posteriori trajectory: without process noise by `batch_least_squares`,
with process noise by the iterated Kalman smoother [2]_. A filter and a smoother linearised about
the trajectory give P_s, the innovations of the model without the filter's own linearisation, and
the likelihood of the measurements. The fit starts from several states. If it ends in several
solutions, each counts with its likelihood; where two are about equally likely the measurements do
not decide between them, and a filter that has decided has a large expected NEES.

References
----------
.. [1] Hausman (1978), Specification tests in econometrics, Econometrica 46(6).
.. [2] Bell (1994), The iterated Kalman smoother as a Gauss–Newton method, SIAM J. Optimization
   4(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.fitted_pass import (
    AllEstimated,
    AtRest,
    FittedPass,
    pass_about,
    score_constant_errors,
)
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.nees import nees_dof
from hillsphere_estimators.roots import solve_root
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.state_angles import state_angles, wrap_differences

__all__ = ["Refit", "refit"]

_ITERATIONS = 30
"""Iterations of a fit at most. Gauss and Newton's converges in four to ten where it does; one that
needs more than thirty is reported as not settled."""
_FULL_STEPS = 10
"""Iterations of the smoother with full steps. What has not settled then mostly oscillates between
two trajectories, which half steps end."""
_SETTLED_SIGMAS = 1e-3
"""Step, in standard deviations, below which a trajectory has settled. The expected NEES then moves
by less than its square times the number of states, which no test resolves."""
_SAME_SIGMAS = 0.5
"""Distance of two solutions, in standard deviations, below which they are the same. Solutions of
the same minimum differ by the tolerance, other minima by many standard deviations."""


@dataclass(frozen=True)
class Refit:
    """Fit of the whole arc for N cases, and the beliefs of a filter in its light.

    Parameters
    ----------
    expected : ndarray, shape (K, N)
        Expected NEES of the filter's belief after each set of measurements, given all of them; NaN
        where no fit has settled.
    dof : ndarray of int, shape (K, N)
        Its degrees of freedom: states that the filter does not know exactly.
    innovations : list of Innovation
        K: of the filter linearised about the fitted trajectory.
    squares : ndarray, shape (N,)
        Sum of their NIS, which is that of the fit's residuals with those of the prior; χ²
        distributed with as many degrees of freedom as rows, if the model is right.
    rows : ndarray of int, shape (N,)
        Rows of measurements that were used.
    settled : ndarray of bool, shape (N,)
        Whether a fit has settled.
    solutions : ndarray of int, shape (N,)
        Number of solutions that count, see `LEAST_WEIGHT`.
    weight : ndarray, shape (N,)
        Weight of the most probable solution, 1 if it is the only one.
    belief : Belief
        The most probable solution after the last set of measurements.
    score : ndarray, shape (N, m)
        Gradient of the log-likelihood by constant errors of the m rows, in units of their noise,
        in the sets that are linear over the belief before them.
    information : ndarray, shape (N, m, m)
        Its covariance if there are no such errors, see `ConstantErrors`.
    curvature : ndarray, shape (N, m)
        Size of the score that the curvature of the measurements may have added.
    about : FittedPass
        Filter and smoother about the fit that starts from the filter's own trajectory.
    """

    expected: Array
    dof: Integers
    innovations: list[Innovation]
    squares: Array
    rows: Integers
    settled: NDArray[np.bool_]
    solutions: Integers
    weight: Array
    belief: Belief
    score: Array
    information: Array
    curvature: Array
    about: FittedPass


LEAST_WEIGHT = 0.01
"""Weight below which another solution does not count. Of a hundred draws less than one would lie
there, and the mean NEES that would belong to it is beyond what they could show."""


def refit(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    controls: Sequence[Array],
    *,
    many_starts: bool = True,
) -> Refit:
    """Fit the whole arc and return the filter's expected NEES.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements.
    prior : Belief
        Before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets, in order, with the rows that count as present.
    after : sequence of Belief
        K: the filter's, after each set.
    controls : sequence of ndarray, shape (p, N)
        K: before each set. The first is not used if the prior is of the time of the first set.
    many_starts : bool
        Whether the fit also starts from the prior's mean and from points of the prior, besides the
        trajectory smoothed from the filter's beliefs. Where everything is linear there is one
        solution.

    Returns
    -------
    Refit
        Of N cases.
    """
    model, angles = AllEstimated(model), state_angles(model, len(prior.x))
    steps = _steps(prior, measurements)
    noiseless = _is_noiseless(model, prior, measurements, controls, after)
    starts = [_smooth_filter(model, after, measurements, controls)]
    if many_starts:
        starts += _further_starts(model, prior, measurements, controls)
    fits: list[tuple[FittedPass, NDArray[np.bool_]]] = []
    for start in starts:
        if noiseless:
            found, settled = _fit_start(model, prior, measurements, controls, steps, start)
        else:
            found, settled = _fit_trajectory(model, prior, measurements, controls, steps, start)
        fits.append((found, settled))
    weights = _weigh(fits, angles)
    expected = np.zeros((len(after), len(prior.t_s)))
    for (found, _), weight in zip(fits, weights, strict=True):
        own = np.array([
            _expected_nees(belief, fit, angles)
            for belief, fit in zip(after, found.smoothed, strict=True)
        ])  # fmt: skip
        expected += np.where(weight > 0.0, weight * np.where(np.isfinite(own), own, np.inf), 0.0)
    settled = weights.sum(axis=0) > 0.0
    best = np.argmax(weights, axis=0)
    innovations = [
        _choose_innovation([fit.innovations[k] for fit, _ in fits], best)
        for k in range(len(measurements))
    ]
    last = [fit.smoothed[-1] for fit, _ in fits]
    case = np.arange(len(best))
    belief = Belief(
        np.stack([b.x for b in last])[best, :, case].T,
        np.stack([b.root for b in last])[best, case],
        last[0].t_s,
    )
    rows = np.sum([innovation.dof for innovation in innovations], axis=0)
    errors = [score_constant_errors(model, fit, measurements) for fit, _ in fits]
    return Refit(
        np.where(settled, expected, np.nan),
        np.array([nees_dof(b) for b in after]),
        innovations,
        np.sum([innovation.nis for innovation in innovations], axis=0),
        np.asarray(rows, dtype=np.int64),
        settled,
        np.sum(weights > 0.0, axis=0),
        weights.max(axis=0),
        belief,
        np.stack([error.score for error in errors])[best, case],
        np.stack([error.information for error in errors])[best, case],
        np.stack([error.curvature for error in errors])[best, case],
        fits[0][0],
    )


def _steps(prior: Belief, measurements: Sequence[MeasurementSet]) -> bool:
    """Return whether there is motion between the prior and the first set of measurements."""
    return not np.array_equal(prior.t_s, measurements[0].t_s)


def _is_noiseless(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    after: Sequence[Belief],
) -> bool:
    """Return whether no process noise acts between any two sets of measurements."""
    earlier = [prior, *after[:-1]]
    moved = range(0 if _steps(prior, measurements) else 1, len(measurements))
    return not any(
        model.process_noise(
            earlier[k].x, earlier[k].t_s, measurements[k].t_s, controls[k]
        ).any()
        for k in moved
    )  # fmt: skip


def _smooth_filter(
    model: EstimationModel,
    after: Sequence[Belief],
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> list[Array]:
    """Return the means of the smoother behind the filter, (n, N) at each of K times."""
    links = [
        link(model, belief, measured.t_s, control)
        for belief, measured, control in zip(after, measurements[1:], controls[1:], strict=False)
    ]
    return [belief.x for belief in smooth(after, links)]


def _propagate(
    model: EstimationModel,
    x: Array,
    t_s: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> list[Array]:
    """Return the states (n, N) at the times of K sets that follow from x at t_s without noise."""
    path, case, still = [], np.arange(x.shape[1]), AtRest(model)
    for measured, control in zip(measurements, controls, strict=True):
        x = still.advance(x, t_s, measured.t_s, control, case)
        t_s = measured.t_s
        path.append(x)
    return path


def _further_starts(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> list[list[Array]]:
    """Return trajectories from the prior: of its mean, and of four of its 2n sigma points.

    They are the one that fits best and the opposite one, and both ends of the axis along which the
    fit is worst: the prior is widest there beside what the measurements tell, and another solution
    lies on the other side of the mean, if there is one.
    """
    n = len(prior.x)
    mean = _propagate(model, prior.x, prior.t_s, measurements, controls)
    sides = np.sqrt(n) * np.concatenate([np.eye(n), -np.eye(n)])
    paths, costs = [], []
    for side in sides:
        x = prior.x + (prior.root @ side).T
        path = _propagate(model, x, prior.t_s, measurements, controls)
        paths.append(np.stack(path))
        costs.append(_misfit(model, path, measurements))
    cost = np.where(np.isfinite(costs), costs, np.inf)
    first = np.argmin(cost, axis=0)
    worst = np.argmax(cost[:n] + cost[n:], axis=0)
    every, case = np.stack(paths), np.arange(len(prior.t_s))
    chosen = (first, (first + n) % (2 * n), worst, worst + n)
    return [mean, *(list(np.moveaxis(every[own, :, :, case], 0, -1)) for own in chosen)]


def _misfit(
    model: EstimationModel, path: Sequence[Array], measurements: Sequence[MeasurementSet]
) -> Array:
    """Return the sum of squares (N,) of the residuals along a trajectory, in units of the noise."""
    total = np.zeros(path[0].shape[1])
    for x, measured in zip(path, measurements, strict=True):
        layout, used = usable(measured)
        z = layout.fitting(model.observe(x, measured.t_s, np.arange(x.shape[1])))
        off = layout.difference(np.where(used, measured.values, z), z)
        total = total + np.sum(
            np.where(used, off / np.where(used, measured.sigma, 1.0), 0.0) ** 2, axis=0
        )
    return total


def _fit_start(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    steps: bool,
    start: list[Array],
) -> tuple[FittedPass, NDArray[np.bool_]]:
    """Return the least-squares trajectory without process noise, and which cases have settled."""
    still, first = AtRest(model), start[0]
    if steps:  # the trajectory begins at the first set: its states at the prior's time
        case = np.arange(first.shape[1])
        first = model.advance(first, measurements[0].t_s, prior.t_s, controls[0], case)
    best = batch_least_squares(
        still, prior, measurements, controls, start=first, iterations=_ITERATIONS,
        tolerance_sigmas=_SETTLED_SIGMAS,
    )  # fmt: skip
    path = _propagate(model, best.belief.x, prior.t_s, measurements, controls)
    return pass_about(
        model, prior, measurements, controls, steps, path, best.belief.x
    ), best.settled


def _fit_trajectory(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    steps: bool,
    path: list[Array],
) -> tuple[FittedPass, NDArray[np.bool_]]:
    """Return the most probable trajectory with process noise, and which cases have settled."""
    origin, angles = prior.x, state_angles(model, len(prior.x))
    for count in range(_ITERATIONS):
        found = pass_about(model, prior, measurements, controls, steps, path, origin)
        offs = [
            wrap_differences(b.x - x, angles) for b, x in zip(found.smoothed, path, strict=True)
        ]
        far = np.max([_length(b, off) for b, off in zip(found.smoothed, offs, strict=True)], axis=0)
        settled = far <= _SETTLED_SIGMAS
        if settled.all():
            break
        share = 1.0 if count < _FULL_STEPS else 0.5
        path = [
            np.where(settled | ~np.isfinite(far), x, x + share * off)
            for off, x in zip(offs, path, strict=True)
        ]
    return found, settled


def _length(belief: Belief, off: Array) -> Array:
    """Return the length (N,) of differences (n, N) in standard deviations of a belief.

    Directions that are known exactly do not count.
    """
    return np.asarray(np.linalg.norm(solve_root(belief.root, off.T[:, :, None])[:, :, 0], axis=1))


def _weigh(fits: list[tuple[FittedPass, NDArray[np.bool_]]], angles: Sequence[int]) -> Array:
    """Return the weights (S, N) of S fits: their likelihoods, without those met before.

    The likelihood of a linearised filter is that of its solution's neighbourhood (Laplace).
    """
    likelihood = np.array([np.where(ok, fit.likelihood, -np.inf) for fit, ok in fits])
    likelihood = np.where(np.isfinite(likelihood), likelihood, -np.inf)
    for later in range(1, len(fits)):
        for earlier in range(later):
            same = (likelihood[earlier] > -np.inf) & (likelihood[later] > -np.inf)
            for end in (0, -1):
                one, other = fits[earlier][0].smoothed[end], fits[later][0].smoothed[end]
                off = wrap_differences(other.x - one.x, angles)
                same &= _length(one, off) < _SAME_SIGMAS
            likelihood[later] = np.where(same, -np.inf, likelihood[later])
    top = likelihood.max(axis=0)
    weight = np.exp(likelihood - np.where(np.isfinite(top), top, 0.0))
    weight = weight / np.maximum(weight.sum(axis=0), 1e-300)
    weight = np.where(weight >= LEAST_WEIGHT, weight, 0.0)
    return np.asarray(weight / np.maximum(weight.sum(axis=0), 1e-300))


def _expected_nees(belief: Belief, fit: Belief, angles: Sequence[int]) -> Array:
    """Return (x_f − x_s)ᵀ P_f⁻¹ (x_f − x_s) + tr(P_f⁻¹ P_s), (N,), where P_f has a variance."""
    off = wrap_differences(fit.x - belief.x, angles)
    both = np.concatenate([off.T[:, :, None], fit.root], axis=2)
    return np.asarray(np.sum(solve_root(belief.root, both) ** 2, axis=(1, 2)))


def _choose_innovation(each: list[Innovation], best: Integers) -> Innovation:
    """Return the innovation of the fit with the number `best` (N,), case by case."""
    case = np.arange(len(best))
    return Innovation(
        np.stack([one.residual for one in each])[best, :, case].T,
        np.stack([one.covariance for one in each])[best, case],
        each[0].used,
        np.stack([one.nis for one in each])[best, case],
    )
