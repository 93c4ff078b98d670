"""What the comparison of trackers shows: published values beside bands, trackers side by side."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Printed, Table
from hillsphere.products import Bands
from hillsphere.reference import ReferenceTable
from hillsphere_tracking.assisted.comparison_figures import (
    draw_ages,
    draw_bands,
    draw_consistency,
    draw_outages,
)
from hillsphere_tracking.assisted.comparison_products import (
    AgeComparison,
    Consistency,
    TrackingComparison,
)
from hillsphere_tracking.assisted.comparison_verdict import (
    age_verdict,
    comparison_verdict,
    inside_band,
    knowing_verdict,
)

__all__ = ["present_tracking"]

_PANELS = 18
_WHO = (
    Column("pass", "", "pass"),
    Column("outage", "", "outage"),
    Column("determination_s", "s", "signal lost after", 5),
    Column("prediction_s", "s", "prediction", 5),
)
_BETWEEN = (
    Column("error_max_p05_deg", "deg", "5 %", 4),
    Column("error_max_deg", "deg", "median largest √(ΔA² + Δh²)", 4),
    Column("error_max_p95_deg", "deg", "95 %", 4),
    Column("sky_error_max_p05_deg", "deg", "5 %", 4),
    Column("sky_error_max_deg", "deg", "median largest √((ΔA cos h)² + Δh²)", 4),
    Column("sky_error_max_p95_deg", "deg", "95 %", 4),
)
_TRACKERS = (
    Column("tracker", "", "tracker"),
    *(
        Column(f"{which}_{frame}_deg", "deg", f"{word}, {label}", 4)
        for frame, label in (("true", "true"), ("sky", "sky"), ("encoder", "encoders"))
        for which, word in (("mean", "mean of medians"), ("worst", "worst median"))
    ),
    *(
        Column(f"locked_{frame}", "-", f"P(ε < lock), {label}", 4)
        for frame, label in (("true", "true"), ("sky", "sky"), ("encoder", "encoders"))
    ),
    Column("outside_s", "s", "time outside the beam, median", 4),
    Column("outside_p95_s", "s", "95 %", 4),
    Column("reacquire_s", "s", "time to reacquire, median", 4),
    Column("reacquire_p95_s", "s", "95 %", 4),
    Column("ratio", "-", "error over the baseline's", 4),
    Column("ratio_low", "-", "at least", 4),
    Column("ratio_high", "-", "at most", 4),
)
_NEES = (
    Column("pass", "", "pass"),
    Column("outage", "", "outage"),
    Column("tracker", "", "tracker"),
    Column("cases", "-", "cases"),
    Column("nees", "-", "mean NEES", 4),
    Column("nees_low", "-", "band from", 4),
    Column("nees_high", "-", "to", 4),
    Column("inside", "", "inside"),
)
_KNOWS = (
    Column("tracker", "", "tracker"),
    Column("inside", "-", "outages inside the band"),
    Column("outages", "-", "of"),
    Column("nees", "-", "mean NEES", 4),
    Column("least", "-", "least of an outage", 4),
    Column("largest", "-", "largest", 4),
)


def present_tracking(
    product: TrackingComparison, reference: ReferenceTable | None, bands: Bands | None
) -> Presentation:
    """Show the comparison.

    Parameters
    ----------
    product : TrackingComparison
        What is shown.
    reference : ReferenceTable or None
        Published values: columns ``pass``, ``outage``, ``error_max_deg``, perhaps
        ``determination_s``, ``prediction_s`` and ``note``.
    bands : Bands or None
        Quantiles over time of the campaign.

    Returns
    -------
    Presentation
        Tables ``tracking_outages``, ``tracking_trackers``, perhaps ``tracking_ages``,
        ``tracking_nees`` and ``tracking_consistency``, and figures of like names.
    """
    twins = _twins(product, reference)
    tables = {
        "tracking_outages": _outage_table(product, reference, twins),
        "tracking_trackers": _tracker_table(product, twins),
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
            f"Medians and 5 to 95 % of {product.ended} cases; dashed: the beam."
            + (" Black: published values, one draw each." if published else ""),
            size_in=(max(6.0, 1.6 + 0.62 * len(product.outages)), 5.0),
        )
    }  # fmt: skip
    said = comparison_verdict(product, reference, published)
    if product.ages is not None:
        label = f"{product.ages.name.replace('_', ' ')} ({product.ages.unit})"
        styles = (*product.trackers, *product.ages.trackers)
        tables["tracking_ages"] = _age_table(product.ages, product.baseline)
        figures["tracking_ages"] = Figure(
            f"Trackers over {product.ages.name.replace('_', ' ')}",
            partial(draw_ages, product=product.ages, styles=styles, label=label),
            "Mean over the outages of the medians over the cases at each point.",
            size_in=(7.0, 5.2),
        )
        said += age_verdict(product.ages, product.baseline)
    if product.consistency is not None:
        tables["tracking_nees"] = _nees_table(product.consistency, product.level)
        tables["tracking_consistency"] = _knowing_table(product.consistency, product.level)
        figures["tracking_consistency"] = Figure(
            "Whether trackers know how good they are",
            partial(draw_consistency, product=product.consistency, level=product.level),
            "Normalised errors squared of predictions: above the band the tracker thinks itself "
            "better than it is, below it worse.",
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


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _twins(
    product: TrackingComparison, reference: ReferenceTable | None
) -> dict[tuple[str, str], Mapping[str, Printed | str | None]]:
    """Return the published row of each outage that has one."""
    keys = set(zip(product.passes, product.outages, strict=True))
    rows = reference.rows if reference is not None else ()
    found = {(str(row["pass"]), str(row["outage"])): row for row in rows}
    return {key: row for key, row in found.items() if key in keys}


def _outage_table(
    product: TrackingComparison,
    reference: ReferenceTable | None,
    twins: Mapping[tuple[str, str], Mapping[str, Printed | str | None]],
) -> Table:
    columns: list[Column] = []
    for column in (*_WHO, Column("tracker", "", "tracker"), *_BETWEEN):
        columns.append(column)
        if column.name == "error_max_deg" and twins:
            columns.append(Column("error_max_deg_paper", "deg"))
            columns.append(Column("paper_inside", "", "paper within 5–95 %"))
        elif column.name == "prediction_s" and any("prediction_s" in row for row in twins.values()):
            columns.append(Column("prediction_s_paper", "s"))
    if any(row.get("note") for row in twins.values()):
        columns.append(Column("note", "", "note"))
    names = {column.name for column in columns}
    rows: list[dict[str, Cell]] = []
    for k, key in enumerate(zip(product.passes, product.outages, strict=True)):
        twin = twins.get(key, {})
        printed = twin.get("error_max_deg")
        for t, tracker in enumerate(product.trackers):
            row: dict[str, Cell] = {
                "pass": key[0],
                "outage": key[1],
                "determination_s": float(product.loss_s[k]),
                "prediction_s": float(product.prediction_s[k]),
                "prediction_s_paper": twin.get("prediction_s"),
                "tracker": tracker,
                "note": twin.get("note"),
            }
            for measure in ("error_max", "sky_error_max"):
                low, middle, high = np.degrees(
                    product.quantiles[:, product.measures.index(measure), t, k]
                )
                row[f"{measure}_p05_deg"] = _number(low)
                row[f"{measure}_deg"] = _number(middle)
                row[f"{measure}_p95_deg"] = _number(high)
                if measure == "error_max" and isinstance(printed, Printed):
                    row["error_max_deg_paper"] = printed
                    row["paper_inside"] = bool(low <= printed <= high)
            rows.append({name: cell for name, cell in row.items() if name in names})
    notes = [
        f"Over the {product.ended} of {product.cases} cases that came to their end: median, 5 % "
        "and 95 % of the largest error of the prediction."
    ]
    if reference is not None and twins:
        notes.append(
            f"Paper: {reference.source}. Its values are one draw of the errors each, by its own "
            "tracker; they stand beside every tracker. A difference of a median from one draw is "
            "no disagreement: see whether the draw lies within 5–95 %."
        )
    return Table("Trackers, outage by outage", columns, rows, notes)


def _tracker_table(product: TrackingComparison, twins: Mapping[tuple[str, str], object]) -> Table:
    outside = product.pooled[:, product.measures.index("time_outside")]
    back = product.pooled[:, product.measures.index("time_to_reacquire")]
    rows: list[dict[str, Cell]] = []
    for t, tracker in enumerate(product.trackers):
        row: dict[str, Cell] = {"tracker": tracker}
        for k, frame in enumerate(("true", "sky", "encoder")):
            row[f"mean_{frame}_deg"] = _number(np.degrees(product.mean_median_rad[k, t]))
            row[f"worst_{frame}_deg"] = _number(np.degrees(product.worst_median_rad[k, t]))
            row[f"locked_{frame}"] = _number(float(np.mean(product.locked[k, t])))
        row |= {
            "outside_s": _number(outside[1, t]),
            "outside_p95_s": _number(outside[2, t]),
            "reacquire_s": _number(back[1, t]),
            "reacquire_p95_s": _number(back[2, t]),
            "ratio": _number(product.ratio[t]),
            "ratio_low": _number(product.ratio_interval[0, t]),
            "ratio_high": _number(product.ratio_interval[1, t]),
        }
        rows.append(row)
    columns = [c for c in _TRACKERS if any(row[c.name] is not None for row in rows)]
    names = {c.name for c in columns}
    rows = [{name: cell for name, cell in row.items() if name in names} for row in rows]
    notes = [
        f"Over {len(product.outages)} outages and {product.ended} cases. Errors √(ΔA² + Δh²) "
        "against where the satellite truly is; on the sky, √((ΔA cos h)² + Δh²) for small ones; "
        "and √(ΔA² + Δh²) against what the encoders would show, which is what reacquisition needs. "
        f"P: share of cases whose largest error is within the beam of "
        f"{np.degrees(product.lock_angle_rad):g}°, mean over the outages. Times over all cases and "
        "outages together.",
        f"Ratios: of the mean of the medians to that of {product.baseline}, with "
        f"{100 * product.level:g} % intervals by bootstrap over the cases.",
    ]
    return Table("Trackers", columns, rows, notes)


def _age_table(ages: AgeComparison, baseline: str) -> Table:
    middle = np.degrees(ages.mean_median_rad)
    key = f"{ages.name.lower()}_{ages.unit.replace('/', '_')}" if ages.unit != "-" else ages.name
    first = ages.trackers.index(baseline) if baseline in ages.trackers else None
    columns = [Column(key, ages.unit, ages.name.replace("_", " "), 6)]
    if any(ages.group):
        columns.append(Column("also", "", "also swept"))
    columns += [
        Column("tracker", "", "tracker"),
        Column("cases", "-", "cases"),
        Column("mean_deg", "deg", "mean of medians", 4),
        Column("worst_deg", "deg", "worst median", 4),
    ]
    if first is not None:
        columns.append(Column("ratio", "-", f"mean over that of {baseline}", 4))
    rows: list[dict[str, Cell]] = []
    for p in range(ages.value.size):
        for t, tracker in enumerate(ages.trackers):
            row: dict[str, Cell] = {key: float(ages.value[p]), "tracker": tracker}
            if any(ages.group):
                row["also"] = ages.group[p]
            row |= {
                "cases": int(ages.count[p]),
                "mean_deg": _number(middle[t, p]),
                "worst_deg": _number(np.degrees(ages.worst_median_rad[t, p])),
            }
            if first is not None:
                row["ratio"] = _number(middle[t, p] / middle[first, p])
            rows.append(row)
    return Table(
        f"Trackers over {ages.name.replace('_', ' ')}", columns, rows,
        [f"Campaign on stage {ages.stage}: medians over the cases at each point."],
    )  # fmt: skip


def _nees_table(found: Consistency, level: float) -> Table:
    inside = inside_band(found)
    rows: list[dict[str, Cell]] = [
        {
            "pass": found.passes[k],
            "outage": found.outages[k],
            "tracker": tracker,
            "cases": int(found.count[t, k]),
            "nees": _number(found.mean[t, k]),
            "nees_low": float(found.interval[0, t, k]),
            "nees_high": float(found.interval[1, t, k]),
            "inside": bool(inside[t, k]),
        }
        for k in range(len(found.outages))
        for t, tracker in enumerate(found.trackers)
    ]
    return Table("Normalised errors squared", _NEES, rows, [_band_note(level)])


def _band_note(level: float) -> str:
    return (
        "Mean over N cases of the normalised error squared, two degrees of freedom, in the middle "
        f"of the outage; its {100 * level:g} % band is that of χ² with 2N degrees of freedom, over "
        "N. Outages of the same pass are not independent."
    )


def _knowing_table(found: Consistency, level: float) -> Table:
    inside = inside_band(found)
    rows: list[dict[str, Cell]] = [
        {
            "tracker": tracker,
            "inside": int(inside[t].sum()),
            "outages": len(found.outages),
            "nees": _number(float(np.mean(found.mean[t]))),
            "least": _number(float(np.min(found.mean[t]))),
            "largest": _number(float(np.max(found.mean[t]))),
        }
        for t, tracker in enumerate(found.trackers)
    ]
    return Table("Whether trackers know how good they are", _KNOWS, rows, [_band_note(level)])


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
            f"Median and {low:g} to {high:g} % at each time, not the course of a case. Shaded: "
            f"the signal is there. Dashed: the beam.{left}",
            size_in=(1.0 + 3.3 * min(3, len(shown)), 0.9 + 2.3 * -(-len(shown) // 3)),
        )
    }  # fmt: skip
