"""Consistency of a filter: normalised errors and innovations (NEES, NIS), and their χ² bands.

A filter is consistent if its errors are as large as its covariance states.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from hillsphere.errors import InputError
from hillsphere.estimation import Innovation
from hillsphere.interfaces import Array
from hillsphere_estimators.nees import nees, nees_dof
from hillsphere_estimators.verdict import verdict

__all__ = ["MeanNis", "chi_square_band", "mean_nis", "nees", "nees_dof", "verdict"]


def chi_square_band(dof: ArrayLike, runs: ArrayLike = 1, probability: float = 0.999) -> Array:
    """Return the band in which the mean of χ² numbers lies with a given probability.

    Parameters
    ----------
    dof : array_like
        Degrees of freedom of each number.
    runs : array_like
        Number of independent ones in the mean.
    probability : float
        That the mean lies in the band; the rest is divided equally between both sides.

    Returns
    -------
    ndarray, shape (2, ...)
        Lower and upper limit.

    Raises
    ------
    InputError
        If the probability is not between 0 and 1, or a mean is over no number.
    """
    if not 0.0 < probability < 1.0:
        raise InputError(f"probability must lie between 0 and 1, got {probability:g}")
    if not (np.asarray(runs) > 0).all():
        raise InputError(f"runs must be above zero, got {np.min(runs):g}")
    tail = 0.5 * (1.0 - probability)
    # the sum of independent χ² numbers is χ² with the sum of their degrees of freedom
    total = np.multiply(dof, runs)
    ends = np.array([chi2.ppf(tail, total), chi2.isf(tail, total)])
    return np.asarray(ends / np.asarray(runs, dtype=float), dtype=float)


@dataclass(frozen=True)
class MeanNis:
    """Mean normalised innovation squared over all cases, per degree of freedom, with its band.

    Parameters
    ----------
    mean : ndarray, shape (K,)
        At each of K times the sum of the NIS of all cases over the sum of their degrees of freedom,
        1 on average for a consistent filter; NaN where nothing was used, infinite if an innovation
        is no number.
    low, high : ndarray, shape (K,)
        Limits of the band.
    """

    mean: Array
    low: Array
    high: Array

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the mean lies in the band (K,), True where nothing was used."""
        return np.isnan(self.mean) | ((self.mean >= self.low) & (self.mean <= self.high))


def mean_nis(
    innovations: list[Innovation], rows: slice = slice(None), probability: float = 0.999
) -> MeanNis:
    """Return the mean normalised innovation squared over all cases, at each time.

    Parameters
    ----------
    innovations : list of Innovation
        At K times.
    rows : slice
        Rows that count, for instance those of one sensor.
    probability : float
        That of the band.

    Returns
    -------
    MeanNis
        Over N cases, whose measurements may differ in number.
    """
    total, dof = np.zeros(len(innovations)), np.zeros(len(innovations))
    for k, brought in enumerate(innovations):
        used = brought.used[rows]
        residual = np.where(used, brought.residual[rows], 0.0).T[:, :, None]
        # rows that are not used have the covariance 1 and the residual 0: they add nothing
        solved = np.linalg.solve(brought.covariance[:, rows, rows], residual)
        squares, dof[k] = np.sum(solved * residual), used.sum()
        total[k] = np.inf if np.isnan(squares) else squares
    some = np.maximum(dof, 1.0)
    low, high = chi_square_band(some, 1, probability) / some
    return MeanNis(np.where(dof > 0, total / some, np.nan), low, high)
