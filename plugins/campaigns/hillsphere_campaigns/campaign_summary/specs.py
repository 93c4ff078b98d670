"""What the stage ``campaign_summary`` can be told."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.spec import DataPath, Ref, Spec, StageSpec, data_path, need, option, rule

__all__ = ["CampaignSummarySpec", "ClaimSpec", "SummaryNeeds"]

WITHOUT_WORST = "of = 'worst' needs campaigns with chosen cases, needs.worst"
"""What is said of a claim about chosen cases where there are none."""


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


class ClaimSpec(Spec):
    """A statement of a publication that the campaigns confirm, refute or leave open."""

    examples = (
        {"text": "B needs less fuel than A", "of": "dv", "less": "b", "than": "a"},
        {"text": "chosen cases show what random ones miss", "of": "worst", "above_random": "a"},
    )

    text: str = option("the statement, as it stands in the report", min_length=1)
    of: str = option(
        "what it is about: a metric (its mean over pairs of cases), 'failures' (their ratio, over "
        "pairs), or 'worst' (the ratio of failures among the chosen cases)"
    )
    less: str = option(
        "label of the campaign that is said to have less of it, or a pattern ('*' is any "
        "characters): then each of those with each of 'than'",
        default="",
    )
    than: str = option("label of the one that is said to have more, likewise", default="")
    above_random: str = option(
        "for 'worst', instead: label of the campaign whose chosen cases are said to fail more "
        "often than its random ones",
        default="",
    )

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if bool(self.less) != bool(self.than):
            raise rule("than" if self.less else "less", "less and than belong together")
        if bool(self.above_random) == bool(self.less):
            raise rule("less", "give either less and than, or above_random")
        if self.above_random and self.of != "worst":
            raise rule("above_random", "is for of = 'worst'")
        if self.of == "worst" and "*" in self.less + self.than + self.above_random:
            raise rule("of", "'worst' is about single campaigns: give labels without '*'")
        return self


class CampaignSummarySpec(StageSpec):
    """Campaigns side by side: mean and deviation of metrics, failures, beside published ones."""

    produces = "hillsphere_campaigns.campaign_summary.products:CampaignSummary"
    examples = (
        {"needs": {"campaigns": ["calm", "rough"]}},
        {
            "needs": {"campaigns": ["calm", "rough"]},
            "labels": ["A", "B"],
            "claims": [{"text": "B fails less", "of": "failures", "less": "B", "than": "A"}],
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
    claims: tuple[ClaimSpec, ...] = option("statements that are answered", default=())
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
        if not self.needs.worst and any(claim.of == "worst" for claim in self.claims):
            raise rule("claims", WITHOUT_WORST)
        return self
