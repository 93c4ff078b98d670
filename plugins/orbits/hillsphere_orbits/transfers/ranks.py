"""Rank correlation of a cost with possible explanations."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from scipy.stats import rankdata, spearmanr

from hillsphere.interfaces import Array

__all__ = ["rank_correlation", "rank_correlations"]

_EXACT = 8  # pairs up to which every permutation is looked at


def rank_correlation(a: Array, b: Array) -> tuple[float, float]:
    """Spearman's rank correlation and its two-sided p-value.

    The p-value is the share of all permutations that correlate as strongly where there are at most
    eight pairs; otherwise that of Student's distribution.

    Parameters
    ----------
    a, b : ndarray, shape (N,)
        Pairs of numbers.

    Returns
    -------
    rho, p : float
        NaN for fewer than three pairs, or if one of the two is constant.
    """
    if a.size < 3 or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return float("nan"), float("nan")
    result = spearmanr(a, b)
    rho = float(result.statistic)
    if a.size > _EXACT:
        return rho, float(result.pvalue)
    first, second = (rankdata(v) - 0.5 * (v.size + 1) for v in (a, b))
    every = second[np.array(list(permutations(range(a.size))))] @ first
    p = np.mean(np.abs(every) >= abs(float(first @ second)) - 1e-9)
    return rho, float(p)


def rank_correlations(cost: Array, angle: Array, integral: Array) -> list[tuple[float, float]]:
    """Return ρ and p of the cost with the angle and with the integral."""
    return [rank_correlation(cost, angle), rank_correlation(cost, integral)]
