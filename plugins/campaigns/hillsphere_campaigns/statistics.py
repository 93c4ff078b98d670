"""Statistics of a campaign, each with its confidence interval.

Means, deviations and quantiles of a metric are those of the cases that came to their end, whether
or not they met what is required (`has_ended`), and say how many these were: the final error of a
flight that was lost on the way says nothing about flights, nor does that of a case that numerics
left undecided (`hillsphere.cases.case_classes`). All intervals are two-sided and take the cases
for independent draws. For a Latin hypercube or a Sobol sequence they are usually too wide; for a
grid or a list they mean nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit
from scipy.stats import binom, trim_mean

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import LEVEL, has_ended, is_undecided, ratio_interval
from hillsphere.products import CaseTable

__all__ = [
    "LEVEL",
    "QUANTILES",
    "CaseClass",
    "MetricStatistics",
    "classes",
    "describe",
    "deviation_interval",
    "mean_interval",
    "metric_statistics",
    "point_statistics",
    "quantile_interval",
    "ratio_interval",
]

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.9973)
"""Levels of the quantiles; the last is the probability within three standard deviations of a
normal distribution."""

LEAST_FOR_DEVIATION = 10
"""Values below which a standard deviation is given no interval: the kurtosis is not known."""


def mean_interval(values: Array, level: float = LEVEL) -> Array:
    """Return Student's interval of the mean of values (n,): (2,), NaN for fewer than two."""
    n = values.size
    if n < 2:
        return np.full(2, np.nan)
    mean, deviation = _moments(values)
    half = float(stdtrit(n - 1, 0.5 * (1.0 + level))) * deviation / np.sqrt(n)
    return np.array([mean - half, mean + half])


def _moments(values: Array) -> tuple[float, float]:
    """Return mean and standard deviation; of equal values exactly that value and zero."""
    if values.size == 0:
        return np.nan, np.nan
    about = values - values[0]
    mean = float(values[0] + np.mean(about))
    if values.size == 1:
        return mean, np.nan
    # Scaled, as the square of a very small spread would vanish.
    scale = float(np.max(np.abs(about))) or 1.0
    return mean, scale * float(np.std(about / scale, ddof=1))


def deviation_interval(values: Array, level: float = LEVEL) -> Array:
    """Return an interval of the standard deviation that does not suppose a normal distribution.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Independent values.
    level : float
        Confidence level, reached approximately: with heavy tails and few values it is less.

    Returns
    -------
    ndarray, shape (2,)
        Lower and upper end; NaN for fewer than ten values.

    Notes
    -----
    Bonett's interval [1]_: ln s² is normal with a variance that follows from the kurtosis, which
    is taken about a trimmed mean. The common χ² interval is exact for normal values only; for
    exponential ones it covers the truth in about two cases of three, however many there are.

    References
    ----------
    .. [1] D. G. Bonett (2006), Computational Statistics & Data Analysis 50, 775–782.
    """
    n = values.size
    if n < LEAST_FOR_DEVIATION:
        return np.full(2, np.nan)
    mean, deviation = _moments(values)
    if deviation == 0.0:
        return np.zeros(2)
    z = float(ndtri(0.5 * (1.0 + level)))
    centre = trim_mean(values, 0.5 / np.sqrt(n - 4.0))
    scaled = (values - mean) / deviation
    kurtosis = n * np.sum(((values - centre) / deviation) ** 4) / np.sum(scaled**2) ** 2
    spread = n / (n - z)
    error = spread * np.sqrt(max(kurtosis - (n - 3.0) / n, 0.0) / (n - 1.0))
    factor: Array = np.sqrt(spread * np.exp(np.array([-z, z]) * error))
    return deviation * factor


def quantile_interval(ordered: Array, q: float, level: float = LEVEL) -> Array:
    """Return an interval of a quantile that supposes no distribution.

    Parameters
    ----------
    ordered : ndarray, shape (n,)
        Independent values, ascending.
    q : float
        Level of the quantile, in (0, 1).
    level : float
        Confidence level; the coverage is never less.

    Returns
    -------
    ndarray, shape (2,)
        Two of the values: the number of values below the quantile is binomial. An infinity where
        there are too few values to bound it on that side.

    References
    ----------
    .. [1] W. J. Conover (1999), Practical Nonparametric Statistics, 3rd ed., section 3.2.
    """
    n = ordered.size
    if n == 0:
        return np.full(2, np.nan)
    tail = 0.5 * (1.0 - level)
    # Ranks counted from 1: P(B < low) <= tail and P(B >= high) <= tail for B binomial (n, q).
    low = int(binom.ppf(tail, n, q))
    high = int(binom.ppf(1.0 - tail, n, q)) + 1
    return np.array(
        [ordered[low - 1] if low >= 1 else -np.inf, ordered[high - 1] if high <= n else np.inf]
    )


@dataclass(frozen=True)
class MetricStatistics:
    """One metric over the cases that came to their end.

    Parameters
    ----------
    name, unit : str
        The metric.
    count : int
        Number of these cases.
    mean, deviation : float
        Mean, and standard deviation with divisor count − 1.
    mean_interval, deviation_interval : ndarray, shape (2,)
        See `mean_interval`, `deviation_interval`.
    least, largest : float
        Extremes.
    least_case, largest_case : int
        The cases that reached them, the first if several did; −1 if there is none.
    levels : tuple of float
        Levels of the quantiles.
    quantiles : ndarray, shape (q,)
        Interpolated linearly between the values.
    quantile_intervals : ndarray, shape (2, q)
        See `quantile_interval`.
    note : str
        Why something is NaN; ``""`` if nothing is.
    """

    name: str
    unit: str
    count: int
    mean: float
    mean_interval: Array
    deviation: float
    deviation_interval: Array
    least: float
    largest: float
    least_case: int
    largest_case: int
    levels: tuple[float, ...]
    quantiles: Array
    quantile_intervals: Array
    note: str


def describe(
    name: str,
    unit: str,
    values: Array,
    cases: Integers,
    *,
    level: float = LEVEL,
    levels: Sequence[float] = QUANTILES,
) -> MetricStatistics:
    """Return the statistics of values (n,) of the cases of these numbers (n,)."""
    n = values.size
    ordered = np.sort(values)
    known = n > 0
    mean, deviation = _moments(values)
    return MetricStatistics(
        name=name,
        unit=unit,
        count=n,
        mean=mean,
        mean_interval=mean_interval(values, level),
        deviation=deviation,
        deviation_interval=deviation_interval(values, level),
        least=float(ordered[0]) if known else np.nan,
        largest=float(ordered[-1]) if known else np.nan,
        least_case=int(cases[np.argmin(values)]) if known else -1,
        largest_case=int(cases[np.argmax(values)]) if known else -1,
        levels=tuple(levels),
        quantiles=np.quantile(ordered, levels) if known else np.full(len(levels), np.nan),
        quantile_intervals=np.array([quantile_interval(ordered, q, level) for q in levels]).T,
        note=_note(n),
    )


def _note(n: int) -> str:
    if n == 0:
        return "no case came to its end"
    if n == 1:
        return "one case only: no spread"
    if n < LEAST_FOR_DEVIATION:
        return f"fewer than {LEAST_FOR_DEVIATION} cases: no interval of the standard deviation"
    return ""


def metric_statistics(
    table: CaseTable,
    rows: NDArray[np.bool_] | None = None,
    *,
    level: float = LEVEL,
    levels: Sequence[float] = QUANTILES,
) -> tuple[MetricStatistics, ...]:
    """Return the statistics of every metric of a campaign.

    Parameters
    ----------
    table : CaseTable
        The cases.
    rows : ndarray of bool, shape (N,), optional
        Those that are looked at; all if left out.
    level : float
        Confidence level.
    levels : sequence of float
        Levels of the quantiles.

    Returns
    -------
    tuple of MetricStatistics
        One per metric.
    """
    kept = has_ended(table) if rows is None else has_ended(table) & rows
    made = []
    for name, unit, values in zip(table.metrics, table.units, table.values, strict=True):
        which = kept & np.isfinite(values)
        made.append(
            describe(name, unit, values[which], table.case[which], level=level, levels=levels)
        )
    return tuple(made)


def point_statistics(
    table: CaseTable, points: int, *, level: float = LEVEL, levels: Sequence[float] = QUANTILES
) -> list[list[MetricStatistics]]:
    """Return the statistics of every metric at each of the first points of a sweep."""
    ended = has_ended(table)
    rows = [np.flatnonzero(ended & (table.point == p)) for p in range(points)]
    found: list[list[MetricStatistics]] = [[] for _ in rows]
    for name, unit, values in zip(table.metrics, table.units, table.values, strict=True):
        for which, at_point in zip(rows, found, strict=True):
            kept = which[np.isfinite(values[which])]
            at_point.append(
                describe(name, unit, values[kept], table.case[kept], level=level, levels=levels)
            )
    return found


@dataclass(frozen=True)
class CaseClass:
    """Cases that ended in the same way.

    Parameters
    ----------
    status, cause : str
        How they ended.
    failed : bool
        Whether that counts as a failure; never of an undecided class.
    undecided : bool
        Whether it is one.
    count : int
        How many.
    share : float
        Of the decided cases; of an undecided class, of all.
    interval : ndarray, shape (2,)
        Of the share, see `ratio_interval`.
    first_case : int
        The first of them.
    message : str
        What the first of them of which there is more to say has to say.
    """

    status: str
    cause: str
    failed: bool
    undecided: bool
    count: int
    share: float
    interval: Array
    first_case: int
    message: str


def classes(
    table: CaseTable, rows: NDArray[np.bool_] | None = None, level: float = LEVEL
) -> tuple[CaseClass, ...]:
    """Return the classes of the cases (or of some `rows` of them), the largest first."""
    which = np.arange(table.case.size) if rows is None else np.flatnonzero(rows)
    if which.size == 0:
        return ()
    names, status = np.unique(table.status[which], return_inverse=True)
    causes, cause = np.unique(table.cause[which], return_inverse=True)
    open_words = is_undecided(names)
    left = open_words[status]
    decided = int(np.count_nonzero(~left))
    key = (status * causes.size + cause) * 2 + (table.failed[which] & ~left)
    keys, first, count = np.unique(key, return_index=True, return_counts=True)
    said = np.searchsorted(table.case[which], table.message_case)
    said = np.minimum(said, which.size - 1)
    known = table.case[which][said] == table.message_case
    of_key: dict[int, str] = {}
    for row, message in zip(said[known], np.flatnonzero(known), strict=True):
        of_key.setdefault(int(key[row]), table.messages[message])
    found = []
    for k, i, m in zip(keys.tolist(), first, count, strict=True):
        undecided = bool(open_words[k // 2 // causes.size])
        among = which.size if undecided else decided
        found.append(
            CaseClass(
                status=str(names[k // 2 // causes.size]),
                cause=str(causes[k // 2 % causes.size]),
                failed=bool(k % 2),
                undecided=undecided,
                count=int(m),
                share=int(m) / among,
                interval=ratio_interval(m, among, level),
                first_case=int(table.case[which[i]]),
                message=of_key.get(int(k), ""),
            )
        )
    return tuple(sorted(found, key=lambda one: (-one.count, one.first_case)))
