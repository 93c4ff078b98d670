"""Presentation of the comparison of trackers."""

from __future__ import annotations

from hillsphere.presentation import Metric, Presentation, Printed
from hillsphere.products.products import Bands
from hillsphere.show.reference import ReferenceTable
from hillsphere_tracking.tracking_comparison.figures import (
    age_chart,
    band_chart,
    consistency_chart,
    outage_chart,
)
from hillsphere_tracking.tracking_comparison.products import TrackingComparison
from hillsphere_tracking.tracking_comparison.side_tables import age_table, knowing_table, nees_table
from hillsphere_tracking.tracking_comparison.tables import outage_table, tracker_table, twins_of
from hillsphere_tracking.tracking_comparison.verdict import (
    age_verdict,
    comparison_verdict,
    cover_verdict,
    knowing_verdict,
    reacquisition_verdict,
)

__all__ = ["present_tracking"]


def present_tracking(
    product: TrackingComparison, reference: ReferenceTable | None, bands: Bands | None
) -> Presentation:
    """Return tables, figures, metrics and verdict of the comparison.

    Parameters
    ----------
    product : TrackingComparison
        The comparison.
    reference : ReferenceTable or None
        Published values with the columns ``pass``, ``outage``, ``error_max_deg``, and optionally
        ``determination_s``, ``prediction_s`` and ``note``.
    bands : Bands or None
        Quantiles of the campaign over time.

    Returns
    -------
    Presentation
        Tables ``tracking_outages``, ``tracking_trackers``, optionally ``tracking_ages``,
        ``tracking_nees`` and ``tracking_consistency``, and figures with the same names.
    """
    twins = twins_of(product, reference)
    tables = {
        "tracking_outages": outage_table(product, reference, twins),
        "tracking_trackers": tracker_table(product),
    }
    published = {key: float(row["error_max_deg"]) for key, row in twins.items()
                 if isinstance(row["error_max_deg"], Printed)}  # fmt: skip
    figures = {
        "tracking_outages": outage_chart(
            product, published if product.measure == "error_max" else {}, "tracking_outages"
        )
    }
    said = comparison_verdict(product, reference, published)
    said += [*cover_verdict(product), *reacquisition_verdict(product)]
    if product.ages is not None:
        styles = (*product.trackers, *product.ages.trackers)
        tables["tracking_ages"] = age_table(product.ages, product.level)
        figures["tracking_ages"] = age_chart(product.ages, styles, "tracking_ages")
        said += age_verdict(product.ages)
    if product.consistency is not None:
        tables["tracking_nees"] = nees_table(product.consistency, product.level)
        tables["tracking_consistency"] = knowing_table(product.consistency, product.level)
        figures["tracking_consistency"] = consistency_chart(
            product.consistency, product.level, "tracking_nees"
        )
        said += knowing_verdict(product.consistency, product.level)
    if bands is not None and (chart := band_chart(product, bands)) is not None:
        figures["tracking_bands"] = chart
    metrics = {
        f"{tracker}_{name}_{what}".lower().replace("-", "_"): Metric(float(values[frame, t]), unit)
        for t, tracker in enumerate(product.trackers)
        for frame, what in enumerate(("true", "sky", "encoder"))
        for name, values, unit in (
            ("mean_error", product.mean_median_rad, "rad"),
            ("worst_error", product.worst_median_rad, "rad"),
        )
    } | {
        f"{tracker}_over_{product.baseline}".lower().replace("-", "_"): Metric(
            float(product.ratio[t])
        )
        for t, tracker in enumerate(product.trackers)
        if tracker != product.baseline
    }
    return Presentation(metrics=metrics, tables=tables, figures=figures, verdict=said)
