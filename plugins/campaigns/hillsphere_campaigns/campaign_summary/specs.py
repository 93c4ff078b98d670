"""What the stage ``campaign_summary`` can be told."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    rule,
)

__all__ = ["CampaignSummarySpec", "PairedTestSpec", "SummaryNeeds"]

WITHOUT_WORST = "of = 'worst' needs campaigns with chosen cases, needs.worst"
"""What is said of a test of chosen cases where there are none."""


class SummaryNeeds(Spec):
    """The campaigns that stand side by side."""

    examples = ({"campaigns": ["calm", "rough"]}, {"campaigns": ["calm"], "worst": ["hard"]})

    campaigns: tuple[Ref, ...] = need(
        "hillsphere.products:CaseTable",
        "campaigns with random cases; of a sweep each point stands for itself, called by its "
        "label and its values",
        min_length=1,
        max_length=40,
    )
    worst: tuple[Ref, ...] = need(
        "hillsphere.products:CaseTable",
        "campaigns with chosen cases, such as the worst that an analysis has found: one for each "
        "of 'campaigns', in their order, or none",
        default=(),
        max_length=40,
    )


class PairedTestSpec(Spec):
    """Two campaigns whose difference is tested, case by case where the cases are random."""

    examples = (
        {"of": "dv", "campaign": "b", "against": "a"},
        {"of": "worst", "campaign": "a"},
    )

    of: str = option(
        "what differs: a metric (its mean over pairs of cases), 'failures' (their ratio, over "
        "pairs), or 'worst' (the ratio of failures among the chosen cases)"
    )
    campaign: str = option(
        "label of the campaign, or a pattern ('*' is any characters): then each of those with each "
        "of 'against'",
        min_length=1,
    )
    against: str = option(
        "label of the campaign whose value is subtracted, likewise; left out, of 'worst' only: the "
        "random cases of the same campaign",
        default="",
    )

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if not self.against and self.of != "worst":
            raise rule("against", "name a campaign; only of = 'worst' can do without")
        if self.of == "worst" and "*" in self.campaign + self.against:
            raise rule("of", "'worst' is about single campaigns: give labels without '*'")
        return self


class CampaignSummarySpec(StageSpec):
    """Campaigns side by side: mean and deviation of metrics, failures, beside published ones."""

    results = ResultNames(
        metrics=(
            "summary_campaigns",
            "summary_failures",
        ),
        tables={
            "campaign_summary": (),
            "campaign_tests": (),
        },
    )
    produces = "hillsphere_campaigns.campaign_summary.products:CampaignSummary"
    examples = (
        {"needs": {"campaigns": ["calm", "rough"]}},
        {
            "needs": {"campaigns": ["calm", "rough"]},
            "labels": ["A", "B"],
            "tests": [{"of": "failures", "campaign": "B", "against": "A"}],
        },
    )

    needs: SummaryNeeds = option("products of earlier stages")
    labels: tuple[str, ...] = option(
        "name of each campaign in the tables; left out: that of its stage", default=()
    )
    show: tuple[str, ...] = option(
        "metrics that are shown, by name or pattern ('*' is any characters); left out: all",
        default=(),
    )
    units: dict[str, str] = option(
        "unit in which a metric is shown (largest_velocity_error = 'mm_s'); left out: SI",
        default={},
    )
    reference: DataPath | None = data_path(
        "cited CSV table of published values with the columns campaign, metric ('failures' and "
        "'worst_failures' in percent), mean and deviation, in the units shown",
        default=None,
    )
    tests: tuple[PairedTestSpec, ...] = option(
        "differences of campaigns, with intervals that claims can rest on", default=()
    )
    confidence: float = option("of all intervals", default=0.95, gt=0.5, lt=1)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        count = len(self.needs.campaigns)
        if self.labels and len(self.labels) != count:
            raise rule("labels", f"{len(self.labels)} labels for {count} campaigns")
        if len(set(self.labels)) < len(self.labels):
            raise rule("labels", "a label is listed twice")
        if self.needs.worst and len(self.needs.worst) != count:
            raise rule("needs", f"worst: {len(self.needs.worst)} for {count} campaigns")
        if not self.needs.worst and any(test.of == "worst" for test in self.tests):
            raise rule("tests", WITHOUT_WORST)
        return self
