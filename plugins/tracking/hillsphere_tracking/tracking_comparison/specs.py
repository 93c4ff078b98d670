"""Spec of the stage ``tracking_comparison``."""

from __future__ import annotations

from typing import Literal

from hillsphere.spec import DataPath, Ref, ResultNames, Spec, StageSpec, data_path, need, option

__all__ = ["TrackingComparisonNeeds", "TrackingComparisonSpec"]


class TrackingComparisonNeeds(Spec):
    """The campaigns that are compared, and the stage that they repeat."""

    examples = (
        {"tracking": "track", "campaign": "verify"},
        {"tracking": "track", "campaign": "verify", "ages": "ages", "consistency": "consistency"},
    )

    tracking: Ref = need(
        "hillsphere_tracking.assisted_tracking.products:AssistedTracking",
        "stage that the campaign repeats",
    )
    campaign: Ref = need(
        "hillsphere.products:CaseTable", "cases of this stage, by monte_carlo, for the comparison"
    )
    ages: Ref | None = need(
        "hillsphere.products:CaseTable",
        "a sweep of such a stage over a number, such as the age of the elements",
        default=None,
    )
    consistency: Ref | None = need(
        "hillsphere.products:CaseTable",
        "cases, by monte_carlo, of such a stage whose true errors are the assumed errors of a "
        "tracker: tests the consistency of the trackers",
        default=None,
    )


class TrackingComparisonSpec(StageSpec):
    """Comparison of trackers over a campaign, with a baseline and published values."""

    results = ResultNames(
        metrics=(
            "*_mean_error_true",
            "*_mean_error_sky",
            "*_mean_error_encoder",
            "*_worst_error_true",
            "*_worst_error_sky",
            "*_worst_error_encoder",
            "*_over_*",
        ),
        tables={
            "tracking_outages": (),
            "tracking_trackers": (),
            "tracking_ages": (),
            "tracking_nees": (),
            "tracking_consistency": (),
        },
    )
    produces = "hillsphere_tracking.tracking_comparison.products:TrackingComparison"
    examples = ({"needs": TrackingComparisonNeeds.examples[0]},)

    needs: TrackingComparisonNeeds = option("products of earlier stages")
    baseline: str = option(
        "tracker to which the others are compared", default="table", min_length=1, max_length=60
    )
    consistent: tuple[str, ...] = option(
        "trackers of the campaign needs.consistency whose assumed error statistics are the true "
        "ones; default: all",
        default=(),
        max_length=60,
    )
    measure: Literal["error_max", "sky_error_max", "encoder_error_max"] = option(
        "largest error of a prediction that is compared: √(ΔA² + Δh²) of the true direction, the "
        "arc on the sky, or √(ΔA² + Δh²) at the encoders",
        default="error_max",
    )
    confidence: float = option("confidence level of all intervals", default=0.95, gt=0.5, lt=1)
    resamples: int = option(
        "number of bootstrap resamples for the intervals of means and ratios",
        default=1000,
        ge=100,
        le=100_000,
    )
    reference: DataPath | None = data_path(
        "published values, shown beside ours: a CSV file with the columns pass, outage, "
        "error_max_deg, and determination_s, prediction_s, note if there are any",
        default=None,
    )
