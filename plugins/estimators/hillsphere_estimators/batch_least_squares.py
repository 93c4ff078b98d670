"""Batch least squares: the states at the start that fit a prior and all measurements best.

A Gauss-Newton iteration with halved steps; the motion has no process noise. The measurements enter
one time after the other by QR decomposition, so that memory does not grow with their number and the
normal equations are never formed [1]_. The unknowns are z with x = x̄ + S z, x̄ and S mean and root
of the prior: states that are known exactly are left as they are.

Considered states take part in the fit, so that their uncertainty weighs the measurements, but keep
mean and covariance of the prior: this is Schmidt's update [2]_ by all measurements at once. With
the gain K of the other states and the derivatives H of all measurements by the considered ones, of
covariance P_cc, the covariance of the others is that without them plus (K H) P_cc (K H)ᵀ.

References
----------
.. [1] Tapley, Schutz, Born (2004), Statistical orbit determination, sections 4.3 and 5.6.
.. [2] Schmidt (1966), Application of state-space methods to navigation problems, Advances in
   Control Systems 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.casewise import mark_failed, replace_failed
from hillsphere_estimators.convergence import freeze_converged, step_in_sigmas
from hillsphere_estimators.gauss_newton import (
    MOST_HALVINGS,
    NEVER_HALVED_SIGMAS,
    linearise_measurements,
)
from hillsphere_estimators.innovations import usable, whiten
from hillsphere_estimators.linearisation import predict_measurement, transition
from hillsphere_estimators.roots import lower_root, solve_root, upper_triangle
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.state_angles import state_angles, wrap_differences, wrap_means

__all__ = ["Fit", "GiveUp", "batch_least_squares"]

GiveUp: TypeAlias = Callable[[Array, Array, Array], NDArray[np.bool_]]
"""Sums of squares before and after a step, and the share of it that was taken → cases to leave."""
EPSILON = float(np.finfo(np.float64).eps)
"""Relative distance of neighbouring doubles, twice the largest relative error of an operation."""
_ROUNDINGS = 1.0
"""Rounding of a state and of a row, in ε. One operation errs by ε/2 at most; those in which a state
is stored, moved and measured have either sign, and partly cancel."""
_ROUNDED_SUM = 64.0 * EPSILON
"""Relative rise of the sum of squares that is rounding: it is a sum of up to some thousand terms,
whose errors add up like the root of their number."""


@dataclass(frozen=True)
class Fit:
    """The best fit of N cases.

    Parameters
    ----------
    belief : Belief
        States at the start, given all measurements; considered states as in the prior. NaN in a
        case that has failed: its model is no number where something was measured.
    squares : ndarray, shape (N,)
        Sum of the squared residuals, with those of the prior, in units of their noise. For a
        correct model it is χ² distributed with as many degrees of freedom as rows were used.
    rows : ndarray of int, shape (N,)
        Number of measured rows that were used.
    iterations : ndarray of int, shape (N,)
        Number of steps.
    settled : ndarray of bool, shape (N,)
        Whether the last step was shorter than the tolerance, or than the rounding; False
        in a case that has failed.
    rounding : ndarray, shape (N,)
        Length of a step, in standard deviations, that the rounding of states and measurements may
        cause by itself. Where it is not small the states are not determined to their standard
        deviations in double precision, and the case is not settled.
    """

    belief: Belief
    squares: Array
    rows: Integers
    iterations: Integers
    settled: NDArray[np.bool_]
    rounding: Array


def batch_least_squares(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array] | None = None,
    *,
    start: Array | None = None,
    iterations: int = 30,
    tolerance_sigmas: float = 1e-6,
    give_up: GiveUp | None = None,
) -> Fit:
    """Fit the states at the start of N cases.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements; its process noise is not used.
    prior : Belief
        States at the start; wide where little is known.
    measurements : sequence of MeasurementSet
        At K times, in order.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each time.
    start : ndarray, shape (n, N), optional
        States at which the iteration begins; the prior means by default.
    iterations : int
        Steps at most.
    tolerance_sigmas : float
        A case has converged when a step is shorter, in standard deviations. Steps that rounding
        alone may cause count as shorter too, see `Fit.rounding`.
    give_up : callable, optional
        Called after each step with the sums of squares before and after it, and the share of the
        Gauss-Newton step that was taken, (N,) each; returns the cases (N,) that make no step more
        and have not converged.

    Returns
    -------
    Fit
        Result of each case.

    Raises
    ------
    InputError
        If there is not one control for each time, or a single case is no number.
    """
    cases = len(prior.t_s)
    if controls is None:
        controls = [np.zeros((0, cases))] * len(measurements)
    if len(controls) != len(measurements):
        raise InputError(
            f"there must be one control before each of {len(measurements)} times, got "
            f"{len(controls)}"
        )
    prior, failed, _ = replace_failed(prior)
    free = update_mask(model, len(prior.x))
    if start is not None:
        # angles the short way from the prior, from which the fit counts their turns
        angles = state_angles(model, len(prior.x))
        start = prior.x + wrap_differences(start - prior.x, angles)
    now = prior if start is None else Belief(start, prior.root, prior.t_s)
    moving = np.ones(cases, dtype=bool)
    left = np.zeros(cases, dtype=bool)
    count, rounding = np.zeros(cases, dtype=np.int64), np.zeros(cases)
    squares = _squares(model, prior, now.x, measurements, controls)
    for _ in range(iterations):
        there, rounded = _step(model, prior, now, measurements, controls)
        # a case without a step has failed, and stays where it is
        lost = moving & ~there.finite
        failed, moving = failed | lost, moving & ~lost
        there = freeze_converged(~lost, there, now)
        far = step_in_sigmas(there, now)
        # a longer error by rounding than this would hide steps that matter
        least = np.where(rounded <= NEVER_HALVED_SIGMAS, rounded, 0.0)
        rounding = np.where(moving, rounded, rounding)
        # halve the steps of cases whose sum of squares rises
        share, x = np.ones(cases), there.x
        for _ in range(MOST_HALVINGS):
            reached = _squares(model, prior, x, measurements, controls)
            bad = (
                moving & (far > NEVER_HALVED_SIGMAS) & ~(reached <= squares * (1.0 + _ROUNDED_SUM))
            )
            if not bad.any():
                break
            share = np.where(bad, 0.5 * share, share)
            x = np.where(share < 1.0, now.x + share * (there.x - now.x), there.x)
        hopeless = np.zeros(cases, dtype=bool)
        if give_up is not None:
            hopeless = moving & give_up(squares, reached, share)
        now = freeze_converged(moving, Belief(x, there.root, prior.t_s), now)
        squares, count = np.where(moving, reached, squares), count + moving
        moving &= far > np.maximum(tolerance_sigmas, least)
        left |= moving & hopeless
        moving &= ~left
        if not moving.any():
            break
    rows = sum(usable(m)[1].sum(axis=0) for m in measurements)
    if free is not None:
        now = _hold_considered(model, prior, now, measurements, controls, free)
    failed |= ~now.finite
    if failed.any() and cases == 1:
        raise InputError(
            "the fit is not finite: near the mean of the prior, "
            f"{prior.x[:, 0].tolist()}, the model predicts no number for a row that was measured"
        )
    now = wrap_means(mark_failed(now, failed), state_angles(model, len(prior.x)))
    return Fit(
        now, squares, np.asarray(rows, dtype=np.int64), count, ~moving & ~failed & ~left, rounding
    )


def _triangle(
    model: EstimationModel,
    prior: Belief,
    at: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> tuple[Array, Array, Array]:
    """Return U (N, n, n) and its right-hand side (N, n, 1) for the change of z at a belief.

    The third result (N,) is the sum of squares of the sizes of measured rows, for their rounding.
    """
    n, cases = at.x.shape
    # the triangle [1 | z̄ − z] of the prior; each time adds rows [HΦS | ν]
    off = solve_root(prior.root, (prior.x - at.x).T[:, :, None])
    upper = np.concatenate([np.broadcast_to(np.eye(n), (cases, n, n)), off], axis=2)
    phi = prior.root
    # differences take the prior's standard deviations for their steps, at every time
    now = Belief(at.x, prior.root, prior.t_s)
    rounded = np.zeros(cases)
    for measured, control in zip(measurements, controls, strict=True):
        x, step = transition(model, now, measured.t_s, control)
        phi, now = step @ phi, Belief(x, prior.root, measured.t_s)
        layout, used = usable(measured)
        expected = linearise_measurements(model, now, layout, measured, used)
        # of each row, in units of its noise: |H| |x| at its own time, and its value
        size = np.sum(np.abs(expected.linear) * np.abs(x).T[:, :, None], axis=1)
        size += (
            np.where(used, np.abs(measured.values), 0.0) / np.where(used, measured.sigma, 1.0)
        ).T
        rounded += np.sum(size**2, axis=1)
        # derivatives by z at the start: H Φ S
        rows = np.swapaxes(expected.linear, 1, 2) @ phi
        more = np.concatenate([rows, expected.residual[:, :, None]], axis=2)
        upper = upper_triangle(np.concatenate([upper, more], axis=1))
    return upper[:, :n, :n], upper[:, :n, n:], rounded


def _step(
    model: EstimationModel,
    prior: Belief,
    at: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> tuple[Belief, Array]:
    """Return the solution of the least squares problem linearised about states at the start.

    The second result (N,) is the length of a step by rounding, in standard deviations. In the
    orthonormal coordinates of the triangle a step in standard deviations is Qᵀ ν. A perturbation
    of the residuals thus moves it by no more than its own length, and rows z = h(x) of states x are
    rounded by about ε (|z| + |H| |x|).
    """
    upper, ends, rounded = _triangle(model, prior, at, measurements, controls)
    step = (prior.root @ np.linalg.solve(upper, ends))[:, :, 0]
    # P = (S U⁻¹) (S U⁻¹)ᵀ of the final triangle U
    root = np.swapaxes(prior.root @ np.linalg.inv(upper), 1, 2)
    # the states themselves are rounded too: |R ε x| with R = U S⁻¹
    information = solve_root(prior.root, np.swapaxes(upper, 1, 2), transposed=True)
    own = np.swapaxes(np.abs(information), 1, 2) @ np.abs(at.x).T[:, :, None]
    rounded = _ROUNDINGS * EPSILON * np.sqrt(rounded + np.sum(own**2, axis=(1, 2)))
    return Belief(at.x + step.T, lower_root(root), prior.t_s), rounded


def _hold_considered(
    model: EstimationModel,
    prior: Belief,
    fit: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    free: Array,
) -> Belief:
    """Return a fit with the considered states, 0 in `free` (n,), as in the prior.

    Schmidt's covariance is that of the fit of all states, S U⁻¹ U⁻ᵀ Sᵀ, but for the block of the
    considered ones, which lacks what the fit has taken from it. With U = A diag(w) Bᵀ this is that
    block of E Eᵀ, E = S B diag(1 − 1/w²)^(1/2), where w ≥ 1, since UᵀU is the unit matrix and the
    information of the measurements. So the covariance is a sum of squares again.
    """
    upper, _, _ = _triangle(model, prior, fit, measurements, controls)
    sound: NDArray[np.bool_] = np.asarray(np.isfinite(upper).all(axis=(1, 2)))
    upper = np.where(sound[:, None, None], upper, np.eye(len(free)))
    _, values, turned = np.linalg.svd(upper)
    share = np.sqrt(np.maximum(1.0 - 1.0 / np.maximum(values, 1.0) ** 2, 0.0))
    taken = share[:, :, None] * turned @ np.swapaxes(prior.root, 1, 2) * (1.0 - free)
    solved = np.swapaxes(prior.root @ np.linalg.inv(upper), 1, 2)
    x = np.where(free[:, None] > 0.0, fit.x, prior.x)
    root = lower_root(np.concatenate([solved, taken], axis=1))
    return mark_failed(Belief(x, root, prior.t_s), ~sound)


def _squares(
    model: EstimationModel,
    prior: Belief,
    x: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> Array:
    """Return the sum of squares (N,) of prior and measurements for states x at the start."""
    off = solve_root(prior.root, (x - prior.x).T[:, :, None])[:, :, 0]
    total = np.sum(off**2, axis=1)
    t_s, case = prior.t_s, np.arange(x.shape[1])
    for measured, control in zip(measurements, controls, strict=True):
        x = model.advance(x, t_s, measured.t_s, control, case)
        t_s = measured.t_s
        layout, used = usable(measured)
        none = np.zeros((len(t_s), 0, layout.rows))
        z = predict_measurement(model, Belief(x, prior.root, t_s), layout)
        residual = whiten(layout, measured, used, z, 0.0, none, none).residual
        total = total + np.sum(residual**2, axis=1)
    return np.asarray(total)
