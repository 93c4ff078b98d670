"""Presentation of the comparison of trackers."""

from __future__ import annotations

from functools import partial

import numpy as np

from hillsphere.presentation import Figure, Metric, Presentation, Printed
from hillsphere.products.products import Bands
from hillsphere.show.reference import ReferenceTable
from hillsphere_tracking.tracking_comparison.figures import (
    draw_ages,
    draw_bands,
    draw_consistency,
    draw_outages,
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

_PANELS = 18
"""Outages in the figure over time at most, six rows of three: its caption says how many there
are."""


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
        "tracking_outages": Figure(
            "Largest error after each outage",
            partial(
                draw_outages, product=product,
                published=published if product.measure == "error_max" else {},
            ),
            f"Medians and 5 % to 95 % of {product.ended} cases. Dashed: half-width of the beam."
            + (" Black: published values, one random draw each." if published else ""),
            size_in=(max(6.0, 1.6 + 0.62 * len(product.outages)), 5.0),
        )
    }  # fmt: skip
    said = comparison_verdict(product, reference, published)
    said += [*cover_verdict(product), *reacquisition_verdict(product)]
    if product.ages is not None:
        searched = bool(np.isfinite(product.ages.reacquire_s).any())
        label = f"{product.ages.name.replace('_', ' ')} ({product.ages.unit})"
        styles = (*product.trackers, *product.ages.trackers)
        tables["tracking_ages"] = age_table(product.ages, product.level)
        figures["tracking_ages"] = Figure(
            f"Trackers over {product.ages.name.replace('_', ' ')}",
            partial(draw_ages, product=product.ages, styles=styles, label=label),
            "Mean over the outages of the median over the cases, at each point."
            + (
                " Below: time to reacquire in cases that are found, from the median to 95 %."
                if searched
                else ""
            ),
            size_in=(7.0, 8.0 if searched else 5.2),
        )
        said += age_verdict(product.ages)
    if product.consistency is not None:
        tables["tracking_nees"] = nees_table(product.consistency, product.level)
        tables["tracking_consistency"] = knowing_table(product.consistency, product.level)
        figures["tracking_consistency"] = Figure(
            "Consistency of the trackers",
            partial(draw_consistency, product=product.consistency, level=product.level),
            "Normalised estimation error squared (NEES) of predictions. Above the band the tracker "
            "is overconfident, below the band it is too cautious.",
            size_in=(max(6.0, 1.6 + 0.5 * len(product.consistency.outages)), 4.4),
        )
        said += knowing_verdict(product.consistency, product.level)
    figures |= _band_figures(product, bands)
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


def _band_figures(product: TrackingComparison, bands: Bands | None) -> dict[str, Figure]:
    if bands is None:
        return {}
    rows = {name: row for row, name in enumerate(bands.names)}
    panels = []
    for k, (pass_, outage) in enumerate(zip(product.passes, product.outages, strict=True)):
        own = {t: rows[name] for t in product.trackers
               if (name := f"{pass_}.{outage}.{t}.error") in rows}  # fmt: skip
        if own:
            title = f"{pass_}, lost after {product.loss_s[k] / 60.0:g} min"
            panels.append((title, float(product.loss_s[k]), own))
    if not panels:
        return {}
    shown = panels[:_PANELS]
    low, high = (100.0 * level for level in (bands.levels[0], bands.levels[-1]))
    left = f" The first {_PANELS} of {len(panels)} outages." if len(panels) > _PANELS else ""
    return {
        "tracking_bands": Figure(
            "Errors over time, over all cases",
            partial(
                draw_bands, bands=bands, panels=shown, styles=product.trackers,
                lock_angle_rad=product.lock_angle_rad,
            ),
            f"Median and {low:g} % to {high:g} % of the cases at each time. Shaded: the signal is "
            f"received. Dashed: half-width of the beam.{left}",
            size_in=(1.0 + 3.3 * min(3, len(shown)), 0.9 + 2.3 * -(-len(shown) // 3)),
        )
    }  # fmt: skip
