"""What the stage ``campaign_comparison`` can be told."""

from __future__ import annotations

from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, need, option

__all__ = ["CampaignComparisonSpec", "CampaignsNeeds"]


class CampaignsNeeds(Spec):
    """The campaigns that are compared."""

    examples = ({"campaigns": ["before", "after"]},)

    campaigns: tuple[Ref, ...] = need(
        "hillsphere.products:CaseTable",
        "campaigns on the same random numbers (their draws_as equal); each of the others is "
        "compared with the first",
        min_length=2,
        max_length=20,
    )


class CampaignComparisonSpec(StageSpec):
    """Campaigns on the same random numbers, compared case by case."""

    results = ResultNames(
        metrics=("comparison_pairs",),
        tables={
            "comparison_failures": (),
            "comparison_metrics": (),
        },
    )
    produces = "hillsphere_campaigns.campaign_comparison.products:CampaignComparison"
    examples = ({"needs": {"campaigns": ["before", "after"]}},)

    needs: CampaignsNeeds = option("products of earlier stages")
    confidence: float = option("of all intervals", default=0.95, gt=0.5, lt=1)
    show: tuple[str, ...] = option(
        "metrics that tables and figures show, by name or pattern ('*' is any characters); left "
        "out: all; what is stored has all metrics in any case",
        default=(),
    )
