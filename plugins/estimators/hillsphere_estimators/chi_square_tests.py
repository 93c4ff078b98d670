"""Tests of χ² numbers and of means with their limits, of all cases together and of each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

from hillsphere.interfaces import Array, Integers

__all__ = [
    "Check",
    "expected_check",
    "inapplicable_check",
    "most_extreme_check",
    "one_sided_check",
    "two_sided_check",
]

_LEAST_MIXED = 20
"""Cases of mixtures below which the mean of squares is not tested: the mean of fewer skew numbers
is not near to Student's distribution."""


@dataclass(frozen=True)
class Check:
    """Result of one test, of all cases together and of each of N cases.

    Parameters
    ----------
    name : str
        Its name.
    says : str
        What its statistic is.
    value, low, high : float
        Statistic of all cases, and the limits between which it passes.
    each, each_low, each_high : ndarray, shape (N,)
        The same of each case; NaN where it does not apply.
    reason : str
        Why the test does not apply, "" if it does.
    """

    name: str
    says: str
    value: float
    low: float
    high: float
    each: Array
    each_low: Array
    each_high: Array
    reason: str = ""

    @property
    def above(self) -> bool:
        """Whether the statistic of all cases is above its limit."""
        return bool(self.value > self.high)

    @property
    def below(self) -> bool:
        """Whether it is below its limit."""
        return bool(self.value < self.low)

    @property
    def each_above(self) -> NDArray[np.bool_]:
        """Whether that of a case is above its limit, (N,)."""
        return np.asarray(self.each > self.each_high)

    @property
    def each_below(self) -> NDArray[np.bool_]:
        """Whether that of a case is below its limit, (N,)."""
        return np.asarray(self.each < self.each_low)

    def __str__(self) -> str:
        if self.reason:
            return f"{self.name}: not applicable, {self.reason}"
        band = (
            f"at most {self.high:.3g}" if self.low <= 0.0 else f"{self.low:.3g} to {self.high:.3g}"
        )
        return f"{self.name}: {self.says} {self.value:.3g} (limit {band})"


def two_sided_check(name: str, says: str, squares: Array, dof: Array, share: float) -> Check:
    """Return a test of χ² numbers that large and small values fail.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    squares, dof : ndarray, shape (N,)
        The numbers of the cases, and their degrees of freedom.
    share : float
        Probability with which a consistent filter fails each limit.

    Returns
    -------
    Check
        Numbers and limits per degree of freedom, of each case and of all together.
    """
    total, degrees = float(squares.sum()), float(dof.sum())
    some = np.maximum(dof, 1.0)
    low, high = chi2.ppf(share, some) / some, chi2.isf(share, some) / some
    blank = dof > 0.0
    if not degrees:
        return inapplicable_check(name, says, len(dof), "there is nothing to test")
    return Check(
        name, says, total / degrees, float(chi2.ppf(share, degrees)) / degrees,
        float(chi2.isf(share, degrees)) / degrees, np.where(blank, squares / some, np.nan),
        np.where(blank, low, np.nan), np.where(blank, high, np.nan),
    )  # fmt: skip


def expected_check(
    name: str, says: str, squares: Array, dof: Array, share: float, mixed: NDArray[np.bool_]
) -> Check:
    """Test squares of errors, or of innovations, whose mean is their degrees of freedom.

    Those of normal distributions are χ² distributed. Of mixtures only the mean is known: the mean
    over the cases is then compared with its spread among them by Student's distribution, or with
    the limits of χ² where these are wider, and no case is judged by itself.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    squares, dof : ndarray, shape (N,)
        Squares and their degrees of freedom, 0 in cases that do not count.
    share : float
        Probability with which a consistent filter fails each limit.
    mixed : ndarray of bool, shape (N,)
        Cases whose beliefs are mixtures.

    Returns
    -------
    Check
        Numbers and limits per degree of freedom.
    """
    check = two_sided_check(name, says, squares, dof, share)
    counted = dof > 0.0
    if check.reason:
        return check
    if not (mixed & counted).any():
        return check
    many = int(counted.sum())
    if many < _LEAST_MIXED:
        return inapplicable_check(
            name, says, len(dof), f"{many} cases of mixtures are too few for a mean"
        )
    each = squares[counted] / dof[counted].mean()
    width = float(student.isf(share, many - 1)) * float(np.std(each, ddof=1)) / np.sqrt(many)
    # means given all measurements spread less than χ²; their fit is not as accurate as that
    low, high = min(check.low, max(1.0 - width, 0.0)), max(check.high, 1.0 + width)
    nothing = np.where(mixed, np.nan, 1.0)
    return Check(
        name, f"{says} (of mixtures)", float(each.mean()), low, high, check.each * nothing,
        check.each_low, check.each_high,
    )  # fmt: skip


def one_sided_check(
    name: str, says: str, value: float, degrees: float, each: Array, dof: Array, share: float
) -> Check:
    """Return a test of χ² numbers that only large values fail.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    value, degrees : float
        The number of all cases, and its degrees of freedom.
    each, dof : ndarray, shape (N,)
        The same of each case.
    share : float
        Probability with which a consistent filter fails.

    Returns
    -------
    Check
        Numbers and limits per degree of freedom.
    """
    if not degrees:
        return inapplicable_check(name, says, len(each), "too few rows follow one another")
    some = np.maximum(dof, 1)
    there = dof > 0
    return Check(
        name, says, value / degrees, 0.0, float(chi2.isf(share, degrees)) / degrees,
        np.where(there, each / some, np.nan), np.zeros(len(each)),
        np.where(there, chi2.isf(share, some) / some, np.nan),
    )  # fmt: skip


def most_extreme_check(checks: list[Check]) -> Check:
    """Return one test of several: of all cases and of each the one farthest beyond its limit.

    Parameters
    ----------
    checks : list of Check
        At least one, of the same name.

    Returns
    -------
    Check
        Values with their own limits. One above its limit comes before one below.
    """

    def choose(value: Array, low: Array, high: Array) -> Integers:
        over = np.where(np.isfinite(value), value / np.maximum(high, 1e-300), -np.inf)
        under = np.where(np.isfinite(value), low / np.maximum(value, 1e-300), -np.inf)
        top = np.argmax(over, axis=0)
        above = np.take_along_axis(over, top[None], axis=0)[0] > 1.0
        return np.asarray(np.where(above, top, np.argmax(np.maximum(over, under), axis=0)))

    pooled = choose(
        *(np.array([[getattr(c, k)] for c in checks]) for k in ("value", "low", "high"))
    )
    fields = [np.array([getattr(c, k) for c in checks]) for k in ("each", "each_low", "each_high")]
    own = choose(*fields)
    case = np.arange(len(own))
    return replace(
        checks[int(pooled[0])], each=fields[0][own, case], each_low=fields[1][own, case],
        each_high=fields[2][own, case],
    )  # fmt: skip


def inapplicable_check(name: str, says: str, cases: int, reason: str) -> Check:
    """Return a test that does not apply.

    Parameters
    ----------
    name, says : str
        Its name, and what its statistic is.
    cases : int
        Number of cases.
    reason : str
        Why it does not apply.

    Returns
    -------
    Check
        Its numbers are NaN.
    """
    none = np.full(cases, np.nan)
    return Check(name, says, np.nan, np.nan, np.nan, none, none, none, reason)
