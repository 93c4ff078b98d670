"""Spec of the stage ``tracking_comparison``: what a mission may write."""

from __future__ import annotations

from typing import Literal

from hillsphere.spec import DataPath, Ref, Spec, StageSpec, data_path, need, option

__all__ = ["TrackingComparisonNeeds", "TrackingComparisonSpec"]


class TrackingComparisonNeeds(Spec):
    """The campaigns that are judged, and the stage that they repeat."""

    examples = (
        {"tracking": "track", "campaign": "verify"},
        {"tracking": "track", "campaign": "verify", "ages": "ages", "consistency": "consistency"},
    )

    tracking: Ref = need(
        "hillsphere_tracking.assisted_tracking.products:AssistedTracking",
        "stage that the campaign repeats",
    )
    campaign: Ref = need(
        "hillsphere.products:CaseTable", "many cases of it, by monte_carlo: compares the trackers"
    )
    ages: Ref | None = need(
        "hillsphere.products:CaseTable",
        "a sweep of such a stage over a number, such as the age of the elements",
        default=None,
    )
    consistency: Ref | None = need(
        "hillsphere.products:CaseTable",
        "many cases, by monte_carlo, of such a stage whose truth is what a tracker expects: tells "
        "whether the trackers know how good they are",
        default=None,
    )


class TrackingComparisonSpec(StageSpec):
    """Trackers compared over the outages of a campaign, against a baseline and published values."""

    produces = "hillsphere_tracking.tracking_comparison.products:TrackingComparison"
    examples = ({"needs": TrackingComparisonNeeds.examples[0]},)

    needs: TrackingComparisonNeeds = option("products of earlier stages")
    baseline: str = option(
        "tracker that the others are compared with", default="table", min_length=1, max_length=60
    )
    consistent: tuple[str, ...] = option(
        "trackers of the campaign needs.consistency that expect errors as they truly are there; "
        "the others are said to expect others; left out: all",
        default=(),
        max_length=60,
    )
    measure: Literal["error_max", "sky_error_max", "encoder_error_max"] = option(
        "largest error of a prediction that is compared: √(ΔA² + Δh²) against the true place, the "
        "arc on the sky, or √(ΔA² + Δh²) against the encoders",
        default="error_max",
    )
    confidence: float = option("of all intervals", default=0.95, gt=0.5, lt=1)
    resamples: int = option(
        "how often the cases are drawn anew for the intervals of means and ratios (bootstrap)",
        default=1000,
        ge=100,
        le=100_000,
    )
    reference: DataPath | None = data_path(
        "published values, shown beside ours: a CSV file with the columns pass, outage, "
        "error_max_deg, and determination_s, prediction_s, note if there are any",
        default=None,
    )
