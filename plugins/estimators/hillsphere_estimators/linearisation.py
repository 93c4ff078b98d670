"""Derivatives of models: exact where a model knows them, else by differences, all in one call."""

from __future__ import annotations

import numpy as np

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel, LinearisedModel
from hillsphere_estimators.differences import Layout

__all__ = ["sensitivity", "shown", "transition"]

_STEP = 1e-3
"""Of a difference, in standard deviations of the belief: there a model is straight."""


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
    each = 2 * n + 1
    moved = model.advance(
        points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(t_to_s, each),
        np.tile(control, each), np.tile(case, each),
    ).reshape(n, each, cases)  # fmt: skip
    slopes = (moved[:, 1 : n + 1] - moved[:, n + 1 :]) / (2.0 * steps)
    return moved[:, 0], slopes.transpose(2, 0, 1)


def shown(model: EstimationModel, belief: Belief) -> Array:
    """Return what sensors would show of the means (m, N), SI."""
    return model.observe(belief.x, belief.t_s, np.arange(len(belief.t_s)))


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
        z = shown(model, belief)
        return z, layout.tangent(model.sensitivity(belief.x, belief.t_s), z)
    n, cases = belief.x.shape
    points, steps = _points(belief)
    each = 2 * n + 1
    z = model.observe(
        points.reshape(n, -1), np.tile(belief.t_s, each), np.tile(np.arange(cases), each)
    ).reshape(-1, each, cases)
    off = layout.difference(z[:, 1:], z[:, :1])
    slopes = (off[:, :n] - off[:, n:]) / (2.0 * steps)
    return z[:, 0], slopes.transpose(2, 0, 1)


def _points(belief: Belief) -> tuple[Array, Array]:
    """Return points (n, 2n + 1, N) about the means, one state off in each, and steps (n, N)."""
    n = len(belief.x)
    sigma = belief.sigma
    # a state that is known exactly still has a derivative
    steps = _STEP * np.where(sigma > 0.0, sigma, 1e-3 * np.maximum(np.abs(belief.x), 1.0))
    points = np.repeat(belief.x[:, None], 2 * n + 1, axis=1)
    own = np.arange(n)
    points[own, 1 + own] += steps
    points[own, n + 1 + own] -= steps
    # what was truly added, rounding and all
    return points, 0.5 * (points[own, 1 + own] - points[own, n + 1 + own])
