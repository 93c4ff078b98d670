r"""Covariance intersection: fusion of two beliefs whose errors have an unknown correlation.

.. math::

    P^{-1} = ω P_1^{-1} + (1 - ω) P_2^{-1}, \quad
    x = P (ω P_1^{-1} x_1 + (1 - ω) P_2^{-1} x_2),

The result is consistent whatever the correlation, if both beliefs are [1]_. With P₁ = L Lᵀ and
L⁻¹P₂L⁻ᵀ = U diag(d) Uᵀ, both covariances are diagonal in the columns of L U, with the elements 1
and d.

References
----------
.. [1] Julier, Uhlmann (1997), A non-divergent estimation algorithm in the presence of unknown
   correlations, American Control Conference.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.casewise import mark_failed, replace_failed
from hillsphere_estimators.convergence import regular_root, regular_scales
from hillsphere_estimators.roots import lower_root
from hillsphere_estimators.state_angles import check_angles, wrap_differences, wrap_means

__all__ = ["covariance_intersection"]

_BISECTIONS = 60
"""Each halves the interval [0, 1] of the weight. A double resolves 2⁻⁵³ near 1: more than 53
halvings determine the weight to rounding, far fewer would make the result depend on the first
interval."""


def covariance_intersection(
    first: Belief,
    second: Belief,
    least: Literal["determinant", "trace"] = "determinant",
    scales: Array | None = None,
    *,
    angles: ArrayLike = (),
) -> tuple[Belief, Array]:
    """Fuse two beliefs of N cases. Cases that have failed in either (NaN) have failed in both.

    Parameters
    ----------
    first, second : Belief
        Beliefs of the same states at the same times; their covariances must be regular.
    least : {"determinant", "trace"}
        Measure of the joint covariance that ω minimises: its determinant, which does not depend on
        units, or its trace in units of the scales.
    scales : ndarray, shape (n,), optional
        With the trace: size of one unit of each state, SI; 1 by default.
    angles : array_like of int, optional
        States that are angles: they differ by less than half a turn. Those of a model are its
        attribute ``angles``.

    Returns
    -------
    joined : Belief
        The fused belief.
    weight : ndarray, shape (N,)
        ω, the weight of the first.

    Raises
    ------
    InputError
        If the beliefs have other states or times, a state is known exactly, a single case has
        failed, the measure is unknown, or the scales or angles do not fit.
    """
    if least not in ("determinant", "trace"):
        raise InputError(f'least must be "determinant" or "trace", got {least!r}')
    if first.x.shape != second.x.shape or not np.array_equal(first.t_s, second.t_s):
        raise InputError(
            f"beliefs to be joined must be of the same states and times, got {first.x.shape} and "
            f"{second.x.shape}; predict the earlier one first"
        )
    rows = check_angles(angles, len(first.x))
    first, failed, _ = replace_failed(first)
    second, others, _ = replace_failed(second)
    failed = failed | others
    if failed.all():
        return mark_failed(first, failed), np.full(len(failed), np.nan)
    # singular values of L⁻¹ S₂ are the roots of d
    relative = np.linalg.solve(regular_root(first), regular_root(second))
    vectors, singular, _ = np.linalg.svd(relative)
    d = singular**2
    columns = first.root @ vectors
    if least == "determinant":
        share = np.ones_like(d)
    else:
        unit = regular_scales(np.ones(d.shape[1]) if scales is None else scales, d.shape[1])
        share = np.sum((columns / unit[:, None]) ** 2, axis=1)
    weight = _weight(d, share, 1.0 if least == "determinant" else 2.0)
    information = weight[:, None] + (1.0 - weight)[:, None] / d
    joined = lower_root(np.swapaxes(columns / np.sqrt(information)[:, None], 1, 2))
    # in the coordinates of the columns P⁻¹ is diagonal: x − x₁ = P (1 − ω) P₂⁻¹ (x₂ − x₁)
    apart = wrap_differences(second.x - first.x, rows)
    off = np.linalg.solve(columns, apart.T[:, :, None])[:, :, 0]
    step = (1.0 - weight)[:, None] / d / information * off
    x = first.x + (columns @ step[:, :, None])[:, :, 0].T
    fused = wrap_means(mark_failed(Belief(x, joined, first.t_s), failed), rows)
    return fused, np.where(failed, np.nan, weight)


def _weight(d: Array, share: Array, power: float) -> Array:
    """Return the ω in [0, 1] at which Σ share (1 − 1/d)/i^power changes sign, i = ω + (1 − ω)/d.

    That sum is minus the derivative of a convex function of ω: of log det P for the power 1 and
    share = 1, of the trace for the power 2. Without a change of sign the limit 0 or 1 is returned.
    """
    low, high = np.zeros(len(d)), np.ones(len(d))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        information = middle[:, None] + (1.0 - middle)[:, None] / d
        gain = np.sum(share * (1.0 - 1.0 / d) / information**power, axis=1)
        rising = gain > 0.0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    return 0.5 * (low + high)
