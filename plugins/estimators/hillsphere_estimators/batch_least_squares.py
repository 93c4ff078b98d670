"""Batch least squares: the states at the start that fit a prior and all measurements best.

A Gauss-Newton iteration with halved steps; the motion has no process noise. The measurements enter
one time after the other by QR decomposition, so that memory does not grow with their number and the
normal equations are never formed [1]_.

References
----------
.. [1] Tapley, Schutz, Born (2004), Statistical orbit determination, sections 4.3 and 5.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.convergence import freeze_converged, step_in_sigmas
from hillsphere_estimators.gauss_newton import (
    MOST_HALVINGS,
    NEVER_HALVED_SIGMAS,
    linearise_measurements,
)
from hillsphere_estimators.information import information_root
from hillsphere_estimators.innovations import usable, whiten
from hillsphere_estimators.linearisation import predict_measurement, transition
from hillsphere_estimators.roots import lower_root, upper_triangle

__all__ = ["Fit", "batch_least_squares"]

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
        States at the start, given all measurements.
    squares : ndarray, shape (N,)
        Sum of the squared residuals, with those of the prior, in units of their noise. For a
        correct model it is χ² distributed with as many degrees of freedom as rows were used.
    rows : ndarray of int, shape (N,)
        Number of measured rows that were used.
    iterations : ndarray of int, shape (N,)
        Number of steps.
    settled : ndarray of bool, shape (N,)
        Whether the last step was shorter than the tolerance, or than the rounding.
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

    Returns
    -------
    Fit
        Result of each case.

    Raises
    ------
    InputError
        If there is not one control for each time, or the prior covariance is singular.
    """
    cases = len(prior.t_s)
    if controls is None:
        controls = [np.zeros((0, cases))] * len(measurements)
    if len(controls) != len(measurements):
        raise InputError(
            f"there must be one control before each of {len(measurements)} times, got "
            f"{len(controls)}"
        )
    known = information_root(prior)
    now = prior if start is None else Belief(start, prior.root, prior.t_s)
    moving = np.ones(cases, dtype=bool)
    count, rounding = np.zeros(cases, dtype=np.int64), np.zeros(cases)
    squares = _squares(model, prior, known, now.x, measurements, controls)
    for _ in range(iterations):
        there, rounded = _step(model, prior, known, now, measurements, controls)
        far = step_in_sigmas(there, now)
        # a longer error by rounding than this would hide steps that matter
        least = np.where(rounded <= NEVER_HALVED_SIGMAS, rounded, 0.0)
        rounding = np.where(moving, rounded, rounding)
        # halve the steps of cases whose sum of squares rises
        share, x = np.ones(cases), there.x
        for _ in range(MOST_HALVINGS):
            reached = _squares(model, prior, known, x, measurements, controls)
            bad = (
                moving & (far > NEVER_HALVED_SIGMAS) & ~(reached <= squares * (1.0 + _ROUNDED_SUM))
            )
            if not bad.any():
                break
            share = np.where(bad, 0.5 * share, share)
            x = np.where(share < 1.0, now.x + share * (there.x - now.x), there.x)
        now = freeze_converged(moving, Belief(x, there.root, prior.t_s), now)
        squares, count = np.where(moving, reached, squares), count + moving
        moving &= far > np.maximum(tolerance_sigmas, least)
        if not moving.any():
            break
    rows = sum(usable(m)[1].sum(axis=0) for m in measurements)
    return Fit(now, squares, np.asarray(rows, dtype=np.int64), count, ~moving, rounding)


def _step(
    model: EstimationModel,
    prior: Belief,
    known: Array,
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
    n, cases = at.x.shape
    # the triangle [R | R (x̄ − x)] of the prior; each time adds rows [HΦ | ν]
    upper = np.concatenate([known, known @ (prior.x - at.x).T[:, :, None]], axis=2)
    phi = np.broadcast_to(np.eye(n), (cases, n, n))
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
        # derivatives by the states at the start: H Φ
        rows = np.swapaxes(expected.linear, 1, 2) @ phi
        more = np.concatenate([rows, expected.residual[:, :, None]], axis=2)
        upper = upper_triangle(np.concatenate([upper, more], axis=1))
    root, ends = upper[:, :n, :n], upper[:, :n, n:]
    step = np.linalg.solve(root, ends)[:, :, 0]
    # P = R⁻¹ R⁻ᵀ of the final triangle R
    inverse = np.swapaxes(np.linalg.inv(root), 1, 2)
    # the states themselves are rounded too: |R ε x|
    own = np.abs(root) @ np.abs(at.x).T[:, :, None]
    rounded = _ROUNDINGS * EPSILON * np.sqrt(rounded + np.sum(own**2, axis=(1, 2)))
    return Belief(at.x + step.T, lower_root(inverse), prior.t_s), rounded


def _squares(
    model: EstimationModel,
    prior: Belief,
    known: Array,
    x: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
) -> Array:
    """Return the sum of squares (N,) of prior and measurements for states x at the start."""
    off = (known @ (x - prior.x).T[:, :, None])[:, :, 0]
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
