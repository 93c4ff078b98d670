"""Derivatives of models: exact where a model knows them, else by differences, all in one call."""

from __future__ import annotations

import numpy as np

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel, LinearisedModel
from hillsphere_estimators.differences import Layout

__all__ = ["predict_measurement", "sensitivity", "transition"]

_STEP = 0.03
"""Of a difference, in standard deviations of the belief: there the fifth derivative of a model says
nothing, and its noise of rounding is small beside the difference."""
_STENCIL = np.array([[1.0, -1.0, 2.0, -2.0], [2.0 / 3.0, -2.0 / 3.0, -1.0 / 12.0, 1.0 / 12.0]])
"""Reach and weight of central differences of fourth order."""


def transition(
    model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
) -> tuple[Array, Array]:
    """Return where means move, and the derivatives of that.

    Parameters
    ----------
    model : EstimationModel
        How states move.
    belief : Belief
        About which.
    t_to_s : ndarray, shape (N,)
        Times, s.
    control : ndarray, shape (p, N)
        Controls.

    Returns
    -------
    x : ndarray, shape (n, N)
        Means then, SI.
    phi : ndarray, shape (N, n, n)
        Derivatives by the states.
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
    return moved[:, 0], _slopes(moved[:, 1:] - moved[:, :1], steps)


def predict_measurement(model: EstimationModel, belief: Belief, layout: Layout) -> Array:
    """Return what sensors would show of the means (m, N), SI; refused if it has other rows."""
    return layout.fitting(model.observe(belief.x, belief.t_s, np.arange(len(belief.t_s))))


def sensitivity(model: EstimationModel, belief: Belief, layout: Layout) -> tuple[Array, Array]:
    """Return what sensors would show of means, and the derivatives of that.

    Parameters
    ----------
    model : EstimationModel
        What sensors show.
    belief : Belief
        Of which.
    layout : Layout
        Kinds of the rows.

    Returns
    -------
    z : ndarray, shape (m, N)
        What they would show, SI.
    slopes : ndarray, shape (N, m, n)
        Derivatives of differences from it (`Layout.difference`) by the states.
    """
    if isinstance(model, LinearisedModel):
        z = predict_measurement(model, belief, layout)
        return z, layout.tangent(model.sensitivity(belief.x, belief.t_s), z)
    n, cases = belief.x.shape
    points, steps = _points(belief)
    each = points.shape[1]
    z = layout.fitting(
        model.observe(
            points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(np.arange(cases), each)
        )
    ).reshape(-1, each, cases)
    return z[:, 0], _slopes(layout.difference(z[:, 1:], z[:, :1]), steps)


def _points(belief: Belief) -> tuple[Array, Array]:
    """Return points (n, 4n + 1, N): the means, then one state off in each; and steps (n, N)."""
    n, cases = belief.x.shape
    sigma = belief.sigma
    # a state that is known exactly still has a derivative
    steps = _STEP * np.where(sigma > 0.0, sigma, 1e-3 * np.maximum(np.abs(belief.x), 1.0))
    # what is truly added, rounding and all
    steps = (belief.x + np.maximum(steps, 64.0 * np.spacing(np.abs(belief.x)))) - belief.x
    points = np.repeat(belief.x[:, None], 4 * n + 1, axis=1)
    off = points[:, 1:].reshape(n, 4, n, cases)
    own = np.arange(n)
    off[own, :, own] += _STENCIL[0][None, :, None] * steps[:, None]
    return np.concatenate([points[:, :1], off.reshape(n, 4 * n, cases)], axis=1), steps


def _slopes(off: Array, steps: Array) -> Array:
    """Return derivatives (N, m, n) from differences (m, 4n, N)."""
    n, cases = steps.shape
    weighted = np.einsum("mkjN,k->mjN", off.reshape(-1, 4, n, cases), _STENCIL[1])
    return np.ascontiguousarray((weighted / steps).transpose(2, 0, 1))
