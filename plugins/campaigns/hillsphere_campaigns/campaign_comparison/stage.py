"""Campaigns on the same random numbers, compared case by case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri
from scipy.stats import binomtest, wilcoxon

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import LEVEL, has_ended, is_undecided, ratio_interval
from hillsphere.errors import InputError
from hillsphere.interfaces.stages import Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere_campaigns.campaign import Campaign
from hillsphere_campaigns.campaign_comparison.presentation import present_comparison, select_shown
from hillsphere_campaigns.campaign_comparison.products import CampaignComparison, PairedMetrics
from hillsphere_campaigns.campaign_comparison.specs import CampaignComparisonSpec
from hillsphere_campaigns.pairing import PlannedDraws, pair_cases
from hillsphere_campaigns.statistics import mean_interval

__all__ = [
    "CampaignComparison",
    "CampaignComparisonStage",
    "PairedFailures",
    "compare",
    "mcnemar",
    "paired_failures",
    "paired_ratio_interval",
    "planned_draws",
    "signed_rank",
]


class CampaignComparisonStage:
    """Compare campaigns with the first of them.

    Parameters
    ----------
    spec : CampaignComparisonSpec
        With its references bound.
    """

    def __init__(self, spec: CampaignComparisonSpec) -> None:
        self.spec = spec

    def check_needs(self, campaigns: Sequence[object]) -> None:
        """Refuse campaigns of which their plans tell that they will not see the same draws."""
        names = [ref.name for ref in self.spec.needs.campaigns]
        planned = [planned_draws(campaign) for campaign in campaigns]
        first, *others = zip(planned, names, strict=True)
        for draws, name in others:
            if first[0] is not None and draws is not None:
                try:
                    pair_cases(first[0], draws, first[1], name)
                except InputError as error:
                    raise InputError(f"needs.campaigns: {error}") from error

    def run(self, ctx: Context, campaigns: tuple[CaseTable, ...]) -> CampaignComparison:
        """Compare them.

        Parameters
        ----------
        ctx : Context
            Not used: it takes no time.
        campaigns : tuple of CaseTable
            Two or more.

        Returns
        -------
        CampaignComparison
            Of each of the others with the first.

        Raises
        ------
        InputError
            If they did not see the same draws, or have no metric that `show` names.
        """
        names = tuple(ref.name for ref in self.spec.needs.campaigns)
        found = compare(campaigns, names, self.spec.confidence)
        select_shown(found.metrics, self.spec.show)
        return found

    def present(
        self, product: CampaignComparison, campaigns: tuple[CaseTable, ...] = ()
    ) -> Presentation:
        """Show the differences."""
        return present_comparison(product, self.spec.show)


def planned_draws(campaign: object) -> PlannedDraws | None:
    """Return what a campaign will draw; None if that depends on products of earlier stages."""
    plan = campaign.foreseen if isinstance(campaign, Campaign) else None
    return None if plan is None else PlannedDraws.of(plan)


def compare(
    tables: tuple[CaseTable, ...], names: tuple[str, ...], level: float = LEVEL
) -> CampaignComparison:
    """Compare campaigns with the first of them, case by case.

    Parameters
    ----------
    tables : tuple of CaseTable
        Two or more; cases of the same draw at the same point are a pair.
    names : tuple of str
        Their names.
    level : float
        Confidence level.

    Returns
    -------
    CampaignComparison
        One row for each point of each comparison; metrics that only one of the two has are left
        out, and so are cases without partner.

    Raises
    ------
    InputError
        If they have no case in common, were swept over different points, or an input that both
        have differs: then they did not see the same draws.
    """
    first, *others = tables
    rows: list[tuple[str, str, int, PairedFailures]] = []
    metrics: list[PairedMetrics] = []
    for name, table in zip(names[1:], others, strict=True):
        a, b = pair_cases(first, table, names[0], name)
        for p in np.unique(first.point[a]).tolist():
            here = first.point[a] == p
            label = first.point_labels[p] if first.point_labels else ""
            i, j = a[here], b[here]
            left = int(np.count_nonzero(first.point == p) + np.count_nonzero(table.point == p))
            left -= 2 * i.size
            rows.append((name, label, left, paired_failures(first, i, table, j, level)))
            metrics += _pair_metrics(first, table, i, j, name, label, level)
    found = [row[3] for row in rows]

    def number(name: str) -> Integers:
        return np.array([getattr(one, name) for one in found], dtype=np.int64)

    def interval(name: str) -> Array:
        return np.array([getattr(one, name) for one in found]).reshape(len(rows), 2).T

    return CampaignComparison(
        baseline=names[0],
        level=level,
        campaign=tuple(row[0] for row in rows),
        point=tuple(row[1] for row in rows),
        pairs=number("pairs"),
        unpaired=np.array([row[2] for row in rows], dtype=np.int64),
        undecided=number("undecided"),
        both_failed=number("both"),
        only_baseline_failed=number("only_a"),
        only_other_failed=number("only_b"),
        difference=np.array([one.difference for one in found]),
        difference_interval=interval("interval"),
        sure_interval=interval("sure"),
        mcnemar_p=np.array([mcnemar(one.only_a, one.only_b) for one in found]),
        metrics=tuple(metrics),
    )


@dataclass(frozen=True)
class PairedFailures:
    """Failures in pairs of cases, of a campaign b against a campaign a.

    Parameters
    ----------
    pairs, undecided : int
        Pairs of which both cases are decided, and pairs that are left out since one is not.
    both, only_a, only_b : int
        Decided pairs of which both cases failed, only that of a, only that of b.
    difference : float
        Failure ratio of b less that of a.
    interval, sure : ndarray, shape (2,)
        Score interval over the decided pairs; and its lower end if the undecided cases had failed
        where that favours b the most, its upper end if where it favours a the most.
    """

    pairs: int
    undecided: int
    both: int
    only_a: int
    only_b: int
    difference: float
    interval: Array
    sure: Array


def paired_failures(
    a: CaseTable, rows_a: Integers, b: CaseTable, rows_b: Integers, level: float = LEVEL
) -> PairedFailures:
    """Return the failures in pairs of cases, see `PairedFailures`.

    Parameters
    ----------
    a, b : CaseTable
        The campaigns.
    rows_a, rows_b : ndarray of int, shape (n,)
        Row of each pair in a, in b.
    level : float
        Confidence level.

    Returns
    -------
    PairedFailures
        Of b against a.
    """
    open_a, open_b = is_undecided(a.status[rows_a]), is_undecided(b.status[rows_b])
    fa, fb = a.failed[rows_a] & ~open_a, b.failed[rows_b] & ~open_b
    left = open_a | open_b
    only_a, only_b = int((fa & ~fb & ~left).sum()), int((~fa & fb & ~left).sum())
    undecided = int(left.sum())
    pairs = left.size - undecided
    # An undecided pair may turn out as one of which only one case fails, unless the other case
    # is decided and speaks against it.
    more_a = only_a + int((left & (open_a | fa) & (open_b | ~fb)).sum())
    more_b = only_b + int((left & (open_b | fb) & (open_a | ~fa)).sum())
    return PairedFailures(
        pairs,
        undecided,
        int((fa & fb & ~left).sum()),
        only_a,
        only_b,
        (only_b - only_a) / max(pairs, 1),
        paired_ratio_interval(only_b, only_a, pairs, level),
        np.array(
            [
                paired_ratio_interval(only_b, more_a, left.size, level)[0],
                paired_ratio_interval(more_b, only_a, left.size, level)[1],
            ]
        ),
    )


def _pair_metrics(
    a: CaseTable, b: CaseTable, rows_a: Integers, rows_b: Integers, name: str, point: str,
    level: float,
) -> list[PairedMetrics]:  # fmt: skip
    made = []
    for metric in (m for m in a.metrics if m in b.metrics):
        of_a, of_b = a.metrics.index(metric), b.metrics.index(metric)
        if a.units[of_a] != b.units[of_b]:
            raise InputError(
                f"metric {metric!r} is in {a.units[of_a]!r} in one campaign, in "
                f"{b.units[of_b]!r} in {name!r}"
            )
        x, y = a.values[of_a, rows_a], b.values[of_b, rows_b]
        kept = has_ended(a)[rows_a] & has_ended(b)[rows_b] & np.isfinite(x) & np.isfinite(y)
        d = y[kept] - x[kept]
        less, more = int(np.count_nonzero(d < 0)), int(np.count_nonzero(d > 0))
        made.append(
            PairedMetrics(
                campaign=name,
                point=point,
                metric=metric,
                unit=a.units[of_a],
                pairs=d.size,
                baseline_mean=float(np.mean(x[kept])) if d.size else np.nan,
                mean=float(np.mean(d)) if d.size else np.nan,
                mean_interval=mean_interval(d, level),
                less=less,
                more=more,
                less_interval=ratio_interval(less, d.size, level),
                more_interval=ratio_interval(more, d.size, level),
                p=signed_rank(d),
                differences=d,
            )
        )
    return made


def signed_rank(differences: Array) -> float:
    """Return the p value of Wilcoxon's signed-rank test, two-sided.

    Differences of zero are left out; 1 if there are no others, NaN for no difference at all. Exact
    for at most 50 differences without ties, else the normal approximation with its corrections.
    """
    if differences.size == 0:
        return np.nan
    d = differences[differences != 0.0]
    if d.size == 0:
        return 1.0
    tied = np.unique(np.abs(d)).size < d.size
    method = "exact" if d.size <= 50 and not tied else "asymptotic"
    return float(wilcoxon(d, method=method, correction=method != "exact").pvalue)


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the p value of McNemar's exact test, from the pairs of which one case failed."""
    total = only_a + only_b
    return float(binomtest(only_b, total).pvalue) if total else 1.0


def paired_ratio_interval(only_b: int, only_a: int, pairs: int, level: float = LEVEL) -> Array:
    """Return the score interval of the difference of two failure ratios of paired cases.

    Parameters
    ----------
    only_b, only_a : int
        Pairs of which only the case of b, of a failed.
    pairs : int
        All pairs.
    level : float
        Confidence level, reached approximately, also for few failures.

    Returns
    -------
    ndarray, shape (2,)
        Of the ratio of b less that of a; (−1, 1) for no pair.

    References
    ----------
    .. [1] T. Tango (1998), Statistics in Medicine 17, 891–908.
    """
    if pairs == 0:
        return np.array([-1.0, 1.0])
    z = float(ndtri(0.5 * (1.0 + level)))
    estimate = (only_b - only_a) / pairs

    def excess(delta: float) -> float:
        """Return (b − c − nΔ)² − z² times its variance under Δ."""
        # Restricted maximum likelihood of the probability that only a fails.
        linear = -only_b - only_a + (2.0 * pairs - only_b + only_a) * delta
        constant = -only_a * delta * (1.0 - delta)
        root = np.sqrt(max(linear**2 - 8.0 * pairs * constant, 0.0))
        q = (root - linear) / (4.0 * pairs)
        variance = pairs * (2.0 * q + delta * (1.0 - delta))
        return float((only_b - only_a - pairs * delta) ** 2 - z**2 * max(variance, 0.0))

    ends = []
    for limit in (-1.0, 1.0):
        # Just beside the estimate: at zero without any failure the variance vanishes too.
        inner = estimate + 1e-9 * limit
        if abs(inner) >= 1.0 or excess(limit) <= 0.0:
            ends.append(limit)
        elif excess(inner) >= 0.0:
            ends.append(estimate)
        else:
            ends.append(float(brentq(excess, limit, inner, xtol=1e-14)))
    return np.array(ends)
