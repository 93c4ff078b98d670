"""What a comparison of campaigns yields."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.base.arrays import Array, Integers

__all__ = ["CampaignComparison", "PairedMetrics"]


@dataclass(frozen=True)
class PairedMetrics:
    """A metric of a campaign less that of the first one, over pairs of which no case failed.

    Parameters
    ----------
    campaign, point : str
        Name of the other campaign, of the point of a sweep.
    metric, unit : str
        The metric.
    pairs : int
        Number n of pairs.
    baseline_mean : float
        Mean of the first campaign, over these pairs.
    mean : float
        Mean difference.
    mean_interval : ndarray, shape (2,)
        Student's interval of it.
    less, more : int
        Pairs in which the other campaign has the smaller, the larger value.
    less_interval, more_interval : ndarray, shape (2,)
        Clopper–Pearson intervals of their shares.
    p : float
        Of Wilcoxon's signed-rank test.
    differences : ndarray, shape (n,)
        All differences.
    """

    campaign: str
    point: str
    metric: str
    unit: str
    pairs: int
    baseline_mean: float
    mean: float
    mean_interval: Array
    less: int
    more: int
    less_interval: Array
    more_interval: Array
    p: float
    differences: Array


@dataclass(frozen=True)
class CampaignComparison:
    """Campaigns compared with the first one, case by case; one of R rows for each other and point.

    Parameters
    ----------
    baseline : str
        Name of the first campaign.
    level : float
        Confidence level of all intervals.
    campaign, point : tuple of str
        Name of the other campaign, of the point of a sweep, per row.
    pairs, unpaired : ndarray of int, shape (R,)
        Pairs of which both cases are decided; cases of either campaign without partner.
    undecided : ndarray of int, shape (R,)
        Pairs with an undecided case, which are left out.
    both_failed, only_baseline_failed, only_other_failed : ndarray of int, shape (R,)
        Pairs by which of their cases failed.
    difference : ndarray, shape (R,)
        Failure ratio of the other campaign less that of the first.
    difference_interval : ndarray, shape (2, R)
        Its score interval (Tango, 1998).
    sure_interval : ndarray, shape (2, R)
        The ends of that interval with the undecided pairs added such that each is farthest out.
    mcnemar_p : ndarray, shape (R,)
        p value of McNemar's exact test.
    metrics : tuple of PairedMetrics
        The metrics.
    """

    baseline: str
    level: float
    campaign: tuple[str, ...]
    point: tuple[str, ...]
    pairs: Integers
    unpaired: Integers
    undecided: Integers
    both_failed: Integers
    only_baseline_failed: Integers
    only_other_failed: Integers
    difference: Array
    difference_interval: Array
    sure_interval: Array
    mcnemar_p: Array
    metrics: tuple[PairedMetrics, ...]
