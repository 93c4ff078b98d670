"""What a comparison of campaigns yields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.base.arrays import Array, Integers
from hillsphere.products.fields import Label, Shape

__all__ = ["CampaignComparison", "PairedMetrics"]


@dataclass(frozen=True)
class PairedMetrics:
    """A metric of a campaign less that of the first one, over pairs of which no case failed."""

    campaign: str
    """Name of the other campaign."""
    point: str
    """Name of the point of a sweep."""
    metric: str
    """Name of the metric."""
    unit: str
    """Its unit."""
    pairs: int
    """Number of pairs."""
    baseline_mean: float
    """Mean of the first campaign, over these pairs."""
    mean: float
    """Mean difference."""
    mean_interval: Annotated[Array, Shape(2)]
    """Student's interval of it."""
    less: int
    """Pairs in which the other campaign has the smaller value."""
    more: int
    """Pairs in which it has the larger value."""
    less_interval: Annotated[Array, Shape(2)]
    """Clopper–Pearson interval of the share of `less`."""
    more_interval: Annotated[Array, Shape(2)]
    """Clopper–Pearson interval of the share of `more`."""
    p: float
    """p value of Wilcoxon's signed-rank test."""
    differences: Annotated[Array, Shape("pairs")]
    """All differences."""


@dataclass(frozen=True)
class CampaignComparison:
    """Campaigns compared with the first one, case by case; one row for each other and point."""

    baseline: str
    """Name of the first campaign."""
    level: float
    """Confidence level of all intervals."""
    campaign: Annotated[tuple[str, ...], Shape("rows"), Label("campaign")]
    """Name of the other campaign."""
    point: Annotated[tuple[str, ...], Shape("rows"), Label("point")]
    """Name of the point of a sweep."""
    pairs: Annotated[Integers, Shape("rows"), Label("pairs")]
    """Pairs of which both cases are decided."""
    unpaired: Annotated[Integers, Shape("rows"), Label("cases without partner")]
    """Cases of either campaign without partner."""
    undecided: Annotated[Integers, Shape("rows"), Label("pairs with an undecided case")]
    """Pairs with an undecided case, which are left out."""
    both_failed: Annotated[Integers, Shape("rows")]
    """Pairs of which both cases failed."""
    only_baseline_failed: Annotated[Integers, Shape("rows"), Label("only the first failed")]
    """Pairs of which only the case of the first campaign failed."""
    only_other_failed: Annotated[Integers, Shape("rows"), Label("only this failed")]
    """Pairs of which only the case of the other campaign failed."""
    difference: Annotated[Array, Shape("rows")]
    """Failure ratio of the other campaign less that of the first."""
    difference_interval: Annotated[Array, Shape(2, "rows")]
    """Score interval of the difference (Tango, 1998)."""
    sure_interval: Annotated[Array, Shape(2, "rows")]
    """Ends of that interval with the undecided pairs added such that each is farthest out."""
    mcnemar_p: Annotated[Array, Shape("rows"), Label("p (McNemar, exact)", 2)]
    """p value of McNemar's exact test."""
    metrics: tuple[PairedMetrics, ...]
    """The metrics."""
