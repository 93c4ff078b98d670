"""What a summary of campaigns yields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.base.arrays import Array, Integers
from hillsphere.products.fields import Shape

__all__ = ["CampaignSummary", "PairedTest"]


@dataclass(frozen=True)
class PairedTest:
    """The difference of two campaigns, or of all pairs of two groups of them."""

    of: str
    """A metric, ``"failures"`` or ``"worst"``."""
    campaign: str
    """The campaign, or the pattern of its group."""
    against: str
    """The campaign whose value is subtracted; ``""`` for the random cases of the same one."""
    difference: float
    """Of a metric the mean difference over pairs, of failures the difference of their ratios; of
    groups the median over their pairs."""
    interval: Annotated[Array, Shape(2)]
    """Interval of it, as wide as undecided cases leave it; both ends equal where nothing is
    random. Of groups it holds the intervals of all pairs."""
    unit: str
    """Its unit."""
    pairs: int
    """Number of pairs, or of chosen cases."""


@dataclass(frozen=True)
class CampaignSummary:
    """Campaigns side by side."""

    labels: Annotated[tuple[str, ...], Shape("campaigns")]
    """Names of the campaigns."""
    level: float
    """Confidence level of all intervals."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics that all campaigns have."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units, SI."""
    count: Annotated[Integers, Shape("metrics", "campaigns")]
    """Cases that came to their end with a value."""
    mean: Annotated[Array, Shape("metrics", "campaigns")]
    """Mean over them."""
    deviation: Annotated[Array, Shape("metrics", "campaigns")]
    """Standard deviation over them."""
    mean_interval: Annotated[Array, Shape(2, "metrics", "campaigns")]
    """Interval of the mean."""
    deviation_interval: Annotated[Array, Shape(2, "metrics", "campaigns")]
    """Interval of the standard deviation."""
    cases: Annotated[Integers, Shape("campaigns")]
    """Decided random cases."""
    failures: Annotated[Integers, Shape("campaigns")]
    """Failures among them."""
    undecided: Annotated[Integers, Shape("campaigns")]
    """Undecided random cases."""
    worst_cases: Annotated[Integers, Shape("campaigns")]
    """Decided chosen cases; zero if there are none."""
    worst_failures: Annotated[Integers, Shape("campaigns")]
    """Failures among them."""
    worst_undecided: Annotated[Integers, Shape("campaigns")]
    """Undecided chosen cases."""
    tests: tuple[PairedTest, ...]
    """The differences that were asked for."""
