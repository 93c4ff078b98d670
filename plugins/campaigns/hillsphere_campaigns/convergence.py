"""Convergence of the estimates of a campaign with the number of cases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import LEVEL, failure_ratio

__all__ = ["Convergence", "convergence_of_failures", "convergence_of_mean"]


@dataclass(frozen=True)
class Convergence:
    """An estimate as the campaign grows, in the order of the cases' numbers.

    Parameters
    ----------
    cases : ndarray of int, shape (K,)
        Numbers of cases, failed ones among them.
    value : ndarray, shape (K,)
        The estimate from so many; NaN where there is none yet.
    interval : ndarray, shape (2, K)
        Its interval, each by itself: that all of them hold at once is less probable.
    """

    cases: Integers
    value: Array
    interval: Array


def _steps(total: int, steps: int) -> Integers:
    return np.unique(np.geomspace(1, max(total, 1), steps).round().astype(np.int64))[
        : max(total, 0)
    ]


def convergence_of_failures(
    failed: NDArray[np.bool_],
    undecided: NDArray[np.bool_] | None = None,
    *,
    level: float = LEVEL,
    steps: int = 200,
) -> Convergence:
    """Return the failure ratio of the first 1 … N cases, at about so many steps.

    Parameters
    ----------
    failed : ndarray of bool, shape (N,)
        Decided cases that failed.
    undecided : ndarray of bool, shape (N,), optional
        Cases that are not decided. The ratio is over the others; the interval reaches from where it
        would be if none of them had failed to where if all had.
    level : float
        Confidence level.
    steps : int
        At most so many.

    Returns
    -------
    Convergence
        One value per step.
    """
    at = _steps(failed.size, steps)
    left = np.zeros(failed.size, dtype=bool) if undecided is None else undecided
    open_cases = np.cumsum(left)[at - 1]
    found = failure_ratio(np.cumsum(failed & ~left)[at - 1], at - open_cases, open_cases, level)
    return Convergence(at, found.value, found.sure)


def convergence_of_mean(
    values: Array, kept: NDArray[np.bool_], *, level: float = LEVEL, steps: int = 200
) -> Convergence:
    """Return the mean of values (N,) over the first 1 … N cases, those that are kept (N,)."""
    at = _steps(values.size, steps)
    # Sums about the mean of all: those of the squares would lose the digits of a small spread.
    centre = float(np.mean(values[kept])) if kept.any() else 0.0
    about = np.where(kept, values - centre, 0.0)
    n = np.cumsum(kept)[at - 1].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.cumsum(about)[at - 1] / n
        square = np.maximum(np.cumsum(about**2)[at - 1] - n * mean**2, 0.0)
        half = stdtrit(np.maximum(n - 1.0, 1.0), 0.5 * (1.0 + level)) * np.sqrt(
            square / (n - 1.0) / n
        )
    half = np.where(n > 1, half, np.nan)
    value = np.where(n > 0, centre + mean, np.nan)
    return Convergence(at, value, np.array([value - half, value + half]))
