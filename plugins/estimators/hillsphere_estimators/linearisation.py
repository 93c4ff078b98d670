"""Derivatives of motion and measurements: exact if the model has them, else finite differences.

All cases and all points of the differences are evaluated in one call of the model.
"""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel, Integers, LinearisedModel
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.state_angles import state_angles, wrap_differences

__all__ = [
    "DIFFERENCE_SIGMAS",
    "noise_between",
    "predict_measurement",
    "sensitivity",
    "transition",
]

DIFFERENCE_SIGMAS = 0.03
"""Step of the differences in standard deviations of the belief. Their error is of fourth order: the
fifth derivative times 0.03⁴, about 1e-6, which is small beside the linearisation itself. A much
smaller step would lose the difference in the rounding of the states."""
_STENCIL = np.array([[1.0, -1.0, 2.0, -2.0], [2.0 / 3.0, -2.0 / 3.0, -1.0 / 12.0, 1.0 / 12.0]])
"""Offsets in steps, and weights, of the central first difference of fourth order."""


def transition(
    model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
) -> tuple[Array, Array]:
    """Move the means of a belief to other times, and return the transition matrices.

    Parameters
    ----------
    model : EstimationModel
        Motion model; a `LinearisedModel` has exact derivatives.
    belief : Belief
        Belief of N cases of n states.
    t_to_s : ndarray, shape (N,)
        Times to which they move, s.
    control : ndarray, shape (p, N)
        Controls.

    Returns
    -------
    x : ndarray, shape (n, N)
        Means at these times, SI.
    phi : ndarray, shape (N, n, n)
        Transition matrices Φ, the derivatives of these by the means before.
    """
    n, cases = belief.x.shape
    case = np.arange(cases)
    if isinstance(model, LinearisedModel):
        there = model.advance(belief.x, belief.t_s, t_to_s, control, case)
        return there, model.transition(belief.x, belief.t_s, t_to_s, control)
    points, steps = _points(belief)
    each = points.shape[1]
    moved = model.advance(
        points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(t_to_s, each),
        np.tile(control, each), np.tile(case, each),
    ).reshape(n, each, cases)  # fmt: skip
    off = wrap_differences(moved[:, 1:] - moved[:, :1], state_angles(model, n))
    return moved[:, 0], _slopes(off, steps)


def noise_between(model: EstimationModel, belief: Belief, t_to_s: Array, control: Array) -> Array:
    """Return the roots of the process noise from the times of a belief to others.

    Parameters
    ----------
    model : EstimationModel
        Motion model.
    belief : Belief
        Belief of N cases.
    t_to_s : ndarray, shape (N,)
        Times of the prediction, s.
    control : ndarray, shape (p, N)
        Controls.

    Returns
    -------
    ndarray, shape (N, n, r)
        G with Q = G Gᵀ.

    Raises
    ------
    InputError
        If a case is predicted backward over process noise. Its states before are correlated with
        the noise since, so that adding Q would be wrong in either direction.
    """
    back = np.asarray(t_to_s) < belief.t_s
    if not back.any():
        return model.process_noise(belief.x, belief.t_s, t_to_s, control)
    # models may take roots of negative times here: what is no number is not zero
    with np.errstate(invalid="ignore"):
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
    noisy = back & (noise != 0.0).any(axis=(1, 2))
    if noisy.any():
        case = int(np.argmax(noisy))
        raise InputError(
            f"case {case} would be predicted backward, from {belief.t_s[case]:.12g} s to "
            f"{t_to_s[case]:.12g} s, over process noise; smooth earlier beliefs instead, or insert "
            "a late measurement with FixedLag"
        )
    return noise


def predict_measurement(model: EstimationModel, belief: Belief, layout: Layout) -> Array:
    """Return the measurements (m, N) that perfect sensors would give of the means, SI.

    Raises
    ------
    InputError
        If the model has another number of rows than the layout.
    """
    return layout.fitting(model.observe(belief.x, belief.t_s, np.arange(len(belief.t_s))))


def sensitivity(
    model: EstimationModel, belief: Belief, layout: Layout, case: Integers | None = None
) -> tuple[Array, Array]:
    """Return the predicted measurements of the means, and their derivatives by the states.

    Parameters
    ----------
    model : EstimationModel
        Measurement model; a `LinearisedModel` has exact derivatives.
    belief : Belief
        Belief of N cases of n states.
    layout : Layout
        Kinds of the m rows.
    case : ndarray of int, shape (N,), optional
        Numbers of the cases in the model, by default 0 to N − 1. With them derivatives are
        differences: those of a `LinearisedModel` are of all cases in their order.

    Returns
    -------
    z : ndarray, shape (m, N)
        Predicted measurements, SI.
    slopes : ndarray, shape (N, m, n)
        Derivatives H of their differences (`Layout.difference`) by the states.
    """
    if case is None and isinstance(model, LinearisedModel):
        z = predict_measurement(model, belief, layout)
        return z, layout.tangent(model.sensitivity(belief.x, belief.t_s), z)
    n, cases = belief.x.shape
    points, steps = _points(belief)
    each = points.shape[1]
    case = np.arange(cases) if case is None else case
    z = layout.fitting(
        model.observe(points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(case, each))
    ).reshape(-1, each, cases)
    return z[:, 0], _slopes(layout.difference(z[:, 1:], z[:, :1]), steps)


def _points(belief: Belief) -> tuple[Array, Array]:
    """Return the points of the differences and their steps.

    Returns
    -------
    points : ndarray, shape (n, 4n + 1, N)
        The means; then, offset by offset of `_STENCIL`, n points in each of which one state
        differs.
    steps : ndarray, shape (n, N)
        Steps of the states.
    """
    n, cases = belief.x.shape
    sigma = belief.sigma
    # a state of zero variance still needs a step: 1e-3 of its size
    steps = DIFFERENCE_SIGMAS * np.where(
        sigma > 0.0, sigma, 1e-3 * np.maximum(np.abs(belief.x), 1.0)
    )
    # at least 64 roundings of the state; the step is then what is truly added, after rounding
    steps = (belief.x + np.maximum(steps, 64.0 * np.spacing(np.abs(belief.x)))) - belief.x
    points = np.repeat(belief.x[:, None], 4 * n + 1, axis=1)
    off = points[:, 1:].reshape(n, 4, n, cases)
    own = np.arange(n)
    # point j of each offset moves state j
    off[own, :, own] += _STENCIL[0][None, :, None] * steps[:, None]
    return np.concatenate([points[:, :1], off.reshape(n, 4 * n, cases)], axis=1), steps


def _slopes(off: Array, steps: Array) -> Array:
    """Return derivatives (N, m, n) of differences (m, 4n, N) in the order of `_points`."""
    n, cases = steps.shape
    weighted = np.einsum("mkjN,k->mjN", off.reshape(-1, 4, n, cases), _STENCIL[1])
    return np.ascontiguousarray((weighted / steps).transpose(2, 0, 1))
