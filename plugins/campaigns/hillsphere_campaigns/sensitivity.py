"""Sensitivity of the results of a campaign: rank correlations and Sobol indices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr
from scipy.stats import norm, rankdata, tiecorrect

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import LEVEL, decided_failures, has_ended, is_undecided
from hillsphere.products import CaseTable
from hillsphere.products.fields import Label, Shape
from hillsphere_campaigns.explanatory import Explanatory, explanatory

__all__ = [
    "LEAST_FOR_CORRELATION",
    "RankCorrelations",
    "SobolIndices",
    "holm",
    "independent_cases",
    "rank_correlations",
    "sobol_of",
    "too_few_failures",
]

LEAST_FOR_CORRELATION = 10
"""Cases of each kind below which no rank correlation is given.

By chance alone Spearman's coefficient of n cases has a standard deviation of 1/√(n − 1), and the
rank-biserial one of f failures among many more cases one of about 1/√(3 f). With ten they are 0.33
and 0.18; with three failures the latter is 0.33, so that every third of a dozen inputs would show
a coefficient above 0.3 that means nothing. The p values rest on a normal approximation of the rank
sum, which fails for samples smaller than about ten (Mann and Whitney, 1947, tabulate up to eight).
"""

ROOM_BYTES = 1 << 26
"""Memory for ranks of inputs, which are compared with a metric together: all inputs of a campaign
of up to some hundred thousand cases, eight of one of a million."""

SAMPLES = 1000
"""Bootstrap samples of the intervals of Sobol indices."""


@dataclass(frozen=True)
class RankCorrelations:
    """Rank correlation of every varied input with every metric, and with failure.

    Parameters
    ----------
    inputs : tuple of str
        Names of the k quantities, see `Explanatory`.
    metrics : tuple of str
        Names of the m metrics; the last may be ``"failed"``.
    count : ndarray of int, shape (m,)
        Number of cases used: those that ended regularly; for ``"failed"`` all decided ones.
    rho : ndarray, shape (k, m)
        Spearman's coefficient with a metric; with failure the rank-biserial one, which is 1 if all
        failed cases have larger values of the input than all others. NaN where either is constant.
    interval : ndarray, shape (2, k, m)
        Confidence interval of Spearman's coefficient; NaN for failure.
    p : ndarray, shape (k, m)
        Two-sided p-value of a coefficient.
    p_holm : ndarray, shape (k, m)
        p-value adjusted for all k·m comparisons, see `holm`.
    dependent : bool
        Whether cases are not independent: they shared their random numbers (the points of a sweep
        do), or no input was random; `p`, `p_holm` and `interval` are then NaN.
    """

    inputs: tuple[str, ...]
    metrics: tuple[str, ...]
    count: NDArray[np.int64]
    rho: Array
    interval: Array
    p: Array
    p_holm: Array
    dependent: bool

    def strongest(self) -> list[tuple[int, int]]:
        """Return (input, metric) of all known coefficients, those least likely by chance first.

        Size alone would not do: with a few failures large coefficients come by chance. Where there
        are no p values, and among equal ones, the larger comes first.
        """
        order = np.lexsort(
            (-np.abs(np.nan_to_num(self.rho)).ravel(), np.nan_to_num(self.p).ravel())
        )
        pairs = np.column_stack(np.unravel_index(order, self.rho.shape)).tolist()
        return [(i, j) for i, j in pairs if np.isfinite(self.rho[i, j])]


def rank_correlations(table: CaseTable, level: float = LEVEL) -> RankCorrelations:
    """Return the rank correlations of a campaign.

    Parameters
    ----------
    table : CaseTable
        The cases.
    level : float
        Confidence level of the intervals.

    Returns
    -------
    RankCorrelations
        For a design ``"sobol_indices"`` over the independent part of its cases.

    Notes
    -----
    The p values are those of Student's distribution for Spearman's coefficient and of the normal
    one (Mann and Whitney, corrected for ties) for failure; the intervals those of Fisher's
    transformation with the variance of Bonett and Wright [1]_. A correlation is no cause: of two
    inputs that are drawn together both correlate with what depends on one.

    References
    ----------
    .. [1] D. G. Bonett, T. A. Wright (2000), Psychometrika 65, 23–28.
    """
    given = explanatory(table)
    usable = independent_cases(table)
    failed, sound = decided_failures(table)[usable], has_ended(table)[usable]
    decided = ~is_undecided(table.status)[usable]
    failures = int(np.count_nonzero(failed))
    both = min(failures, int(np.count_nonzero(decided)) - failures) >= LEAST_FOR_CORRELATION
    names = table.metrics + (("failed",) if both else ())
    k, m = len(given.names), len(names)
    rho, p = np.full((k, m), np.nan), np.full((k, m), np.nan)
    interval = np.full((2, k, m), np.nan)
    count = np.zeros(m, dtype=np.int64)
    # Points of a sweep that see the same draws; a single draw is as good as a constant, but then
    # the points themselves must have come by chance.
    draws = table.draw[usable]
    least = 0 if table.design in ("grid", "list") else 1
    dependent = least < np.unique(draws).size < draws.size
    together = max(1, ROOM_BYTES // (8 * max(1, table.case.size)))
    for inputs in np.split(np.arange(k), range(together, k, together)):
        ranks_of: dict[bytes, Array] = {}
        for j in range(len(table.metrics)):
            metric = table.values[j][usable]
            rows = sound & np.isfinite(metric)
            n = count[j] = int(np.count_nonzero(rows))
            if n < LEAST_FOR_CORRELATION:
                continue
            key = sha256(rows.tobytes()).digest()
            if key not in ranks_of:
                ranks_of.clear()  # as a rule all metrics have the same cases
                ranks_of[key] = _centred_ranks(given, inputs, usable, rows)
            rho[inputs, j] = ranks_of[key] @ _centre_ranks(rankdata(metric[rows]))
    for j in np.flatnonzero(count[: len(table.metrics)] >= LEAST_FOR_CORRELATION).tolist():
        rho[:, j] = np.clip(rho[:, j], -1.0, 1.0)
        p[:, j], interval[:, :, j] = _spearman_chance(rho[:, j], int(count[j]), level)
    if both:
        count[-1] = np.count_nonzero(decided)
        for i in range(k):
            ranks = rankdata(given.column(i)[usable][decided])
            rho[i, -1], p[i, -1] = _rank_biserial(ranks, failed[decided])
    if dependent:
        p[:], interval[:] = np.nan, np.nan
    return RankCorrelations(given.names, names, count, rho, interval, p, holm(p), dependent)


def too_few_failures(table: CaseTable) -> str:
    """Explain why no correlation with failure is given; ``""`` where nothing is to explain."""
    usable = independent_cases(table) & ~is_undecided(table.status)
    failures = int(np.count_nonzero(decided_failures(table) & usable))
    others = int(np.count_nonzero(usable)) - failures
    fewer = min(failures, others)
    if not 0 < fewer < LEAST_FOR_CORRELATION:
        return ""
    what = f"failure{'' if fewer == 1 else 's'}" if failures <= others else "without failure"
    return (
        f"No correlation with failure is given: {fewer} {what}, fewer than "
        f"{LEAST_FOR_CORRELATION}, from which large coefficients come by chance."
    )


def _centred_ranks(
    given: Explanatory, inputs: Integers, usable: NDArray[np.bool_], rows: NDArray[np.bool_]
) -> Array:
    """Return centred ranks (k, n) of some inputs over the usable cases of these rows."""
    ranks = np.empty((len(inputs), int(np.count_nonzero(rows))))
    for place, i in enumerate(inputs.tolist()):
        ranks[place] = _centre_ranks(rankdata(given.column(i)[usable][rows]))
    return ranks


def _centre_ranks(ranks: Array) -> Array:
    """Return ranks (n,) minus their mean, normalised to length one; NaN if all are equal."""
    about = ranks - ranks.mean()
    size = np.sqrt(np.sum(about**2))
    return about / size if size > 0 else np.full_like(about, np.nan)


def _spearman_chance(rho: Array, n: int, level: float) -> tuple[Array, Array]:
    p, interval = np.full(rho.shape, np.nan), np.full((2, *rho.shape), np.nan)
    if n > 2:
        with np.errstate(divide="ignore"):
            t = np.abs(rho) * np.sqrt((n - 2.0) / (1.0 - rho**2))
        p = 2.0 * stdtr(n - 2, -t)
    if n > 3:
        half = ndtri(0.5 * (1.0 + level)) * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3.0))
        with np.errstate(divide="ignore"):
            z = np.arctanh(rho)
        interval = np.tanh(np.array([z - half, z + half]))
    return p, interval


def _rank_biserial(ranks: Array, failed: NDArray[np.bool_]) -> tuple[float, float]:
    n = failed.size
    n1 = int(np.count_nonzero(failed))
    n0 = n - n1
    u = float(ranks[failed].sum()) - 0.5 * n1 * (n1 + 1.0)
    ties = tiecorrect(ranks)
    if not ties > 0:
        return np.nan, np.nan
    sigma = np.sqrt(ties * n1 * n0 * (n + 1.0) / 12.0)
    z = max(abs(u - 0.5 * n1 * n0) - 0.5, 0.0) / sigma
    return 2.0 * u / (n1 * n0) - 1.0, min(2.0 * float(norm.sf(z)), 1.0)


def holm(p: Array) -> Array:
    """Return p values corrected for their number, of the same shape; NaN stays out of it.

    Below α with a probability of at most α for any of those that are chance, however they depend
    on each other.

    References
    ----------
    .. [1] S. Holm (1979), Scandinavian Journal of Statistics 6, 65–70.
    """
    flat = p.ravel()
    known = np.flatnonzero(np.isfinite(flat))
    order = known[np.argsort(flat[known], kind="stable")]
    factors = np.arange(order.size, 0, -1)
    corrected = np.full(flat.shape, np.nan)
    corrected[order] = np.minimum(np.maximum.accumulate(flat[order] * factors), 1.0)
    return corrected.reshape(p.shape)


def independent_cases(table: CaseTable) -> NDArray[np.bool_]:
    """Return which cases (N,) are independent draws.

    All, but for a design ``"sobol_indices"``: there the first of the samples. The others repeat its
    random numbers, or its inputs.
    """
    if table.design != "sobol_indices":
        return np.ones(table.case.size, dtype=bool)
    # Every sample sees the same draws. Quantities that came out constant belong to the samples too.
    size = int(table.draw.max(initial=-1)) + 1
    return np.asarray(table.case < size)


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of each metric that are due to each input."""

    inputs: Annotated[tuple[str, ...], Shape("inputs"), Label("input")]
    """Names of the inputs."""
    metrics: Annotated[tuple[str, ...], Shape("metrics"), Label("metric")]
    """Names of the metrics."""
    samples: int
    """Cases in each of the samples, which are two more than inputs."""
    first: Annotated[Array, Shape("inputs", "metrics")]
    """Shares of the input alone. NaN for a metric that is constant. Small ones may come out below
    zero."""
    total: Annotated[Array, Shape("inputs", "metrics")]
    """Shares of the input with all that it does together with others, likewise."""
    first_interval: Annotated[Array, Shape(2, "inputs", "metrics")]
    """Bootstrap interval (percentiles) of `first`."""
    total_interval: Annotated[Array, Shape(2, "inputs", "metrics")]
    """Bootstrap interval of `total`."""


def sobol_of(
    table: CaseTable, *, level: float = LEVEL, resamples: int = SAMPLES, seed: int = 0
) -> SobolIndices | str:
    """Return the Sobol indices of a campaign whose design allows it.

    Parameters
    ----------
    table : CaseTable
        Of design ``"sobol_indices"``: N cases of sample A, N of sample B, then for each input N
        cases of A with this input from B.
    level : float
        Confidence level of the intervals.
    resamples : int
        Bootstrap samples.
    seed : int
        Of the bootstrap.

    Returns
    -------
    SobolIndices or str
        The indices, or why there are none.

    Notes
    -----
    The estimators are those of `scipy.stats.sobol_indices`, which takes samples of a power of two
    only (Saltelli's of 2010 for the first, Jansen's for the total indices [1]_).

    References
    ----------
    .. [1] A. Saltelli et al. (2010), Computer Physics Communications 181, 259–270.
    """
    given = explanatory(table)
    alone = _samples(table, given)
    if isinstance(alone, str):
        return alone
    k, n = len(alone), int(table.draw.max()) + 1
    values = np.asarray(table.values)  # each bootstrap sample takes them from all metrics
    parts = values.reshape(len(table.metrics), -1, n)
    f_a, f_b, f_ab = parts[:, 0], parts[:, 1], np.moveaxis(parts[:, alone], 1, 0)
    constant = np.ptp(values, axis=1) == 0.0
    found = np.full((2, k, len(table.metrics)), np.nan)
    for j in np.flatnonzero(~constant):
        found[:, :, j] = _resample_indices(f_a[j], f_b[j], f_ab[:, j], np.full((1, n), 1.0 / n))[
            :, 0
        ]
    bounds = np.full((2, 2, k, len(table.metrics)), np.nan)
    varies = np.flatnonzero(~constant)
    samples: list[list[Array]] = [[] for _ in varies]
    for weights in _weights(n, resamples, seed):
        for kept, j in zip(samples, varies, strict=True):
            kept.append(_resample_indices(f_a[j], f_b[j], f_ab[:, j], weights))
    tails = [0.5 * (1.0 - level), 0.5 * (1.0 + level)]
    for kept, j in zip(samples, varies, strict=True):
        sample = np.concatenate(kept, axis=1)
        bounds[..., j] = np.moveaxis(np.quantile(sample, tails, axis=1), 1, 0)
    return SobolIndices(given.names, table.metrics, n, *found, *bounds)


def _weights(n: int, resamples: int, seed: int) -> Iterator[Array]:
    """Yield the weights (R, n) of n rows in bootstrap samples, a few megabytes at a time."""
    random = np.random.default_rng(np.random.SeedSequence(seed))
    left = resamples
    while left > 0:
        some = min(left, max(1, 1_000_000 // n))
        yield random.multinomial(n, np.full(n, 1.0 / n), size=some) / n
        left -= some


def _resample_indices(f_a: Array, f_b: Array, f_ab: Array, weights: Array) -> Array:
    """Return first and total indices (2, R, k) of resampled rows, by the rows' weights (R, n)."""
    centre = 0.5 * (f_a.mean() + f_b.mean())
    a, b, ab = f_a - centre, f_b - centre, f_ab - centre
    mean = 0.5 * (weights @ (a + b))
    variance = 0.5 * (weights @ (a**2 + b**2)) - mean**2
    # The mean is taken off each sample anew: it changes no expectation, but the variance.
    first = weights @ (b * (ab - a)).T - mean[:, None] * (weights @ (ab - a).T)
    whole = 0.5 * (weights @ ((a - ab) ** 2).T)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares: Array = np.array([first, whole]) / variance[:, None]
    return shares


def _samples(table: CaseTable, given: Explanatory) -> list[int] | str:
    """Return in which sample each quantity changed alone, or why there are no Sobol indices.

    Quantities that came out constant have a sample of their own as well, equal to the first.
    """
    k, total = len(given.names), table.case.size
    if table.design != "sobol_indices":
        return f"design {table.design!r} does not allow Sobol indices; use 'sobol_indices'"
    if total < table.planned:
        return f"Sobol indices need all {table.planned} cases; {total} were computed"
    lost = ~has_ended(table)
    if count := int(np.count_nonzero(lost)):
        return (
            f"Sobol indices need every case; {count} of {total} did not come to their end, the "
            f"first of them case {int(table.case[lost][0])}: smaller dispersions would do"
        )
    if not all(np.isfinite(metric).all() for metric in table.values):
        return "Sobol indices need finite metrics"
    n = int(table.draw.max(initial=-1)) + 1
    if not k or total % n or total < n * (k + 2):
        return f"{total} cases are no {k + 2} samples of equal size for {k} inputs"
    if n < 2:
        return "Sobol indices need samples of more than one case"
    # Of each input and sample after A and B: whether it has the values of A, or those of B.
    as_in = np.empty((2, k, total // n - 2), dtype=bool)
    for i in range(k):
        parts = given.column(i).reshape(-1, n)
        for sample in (0, 1):
            as_in[sample, i] = (parts[2:] == parts[sample]).all(axis=1)
    found = []
    for i in range(k):
        same = as_in[1, i] & as_in[0, np.arange(k) != i].all(axis=0)
        if not same.any():
            return (
                "Sobol indices need inputs that are independent of each other; here "
                f"{given.names[i]!r} does not change alone (correlated inputs)"
            )
        found.append(2 + int(np.argmax(same)))
    return found
