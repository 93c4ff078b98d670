"""Tables of the comparison of trackers: by outage beside published values, and by tracker."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from hillsphere.presentation import Cell, Column, Printed, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere_tracking.tracking_comparison.products import COVERED, TrackingComparison

__all__ = ["Twins", "number", "outage_table", "tracker_table", "twins_of"]

Twins: TypeAlias = Mapping[tuple[str, str], Mapping[str, Printed | str | None]]
"""Published rows by pass and outage."""

_FRAMES = (("true", "true"), ("sky", "sky"), ("encoder", "encoders"))
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
    Column("nees", "-", "median NEES", 4),
    Column("uncovered", "-", "P(error not covered)", 4),
)
_TRACKERS = (
    Column("tracker", "", "tracker"),
    *(
        Column(f"{which}_{frame}_deg", "deg", f"{word}{label}", 4)
        for frame, label in _FRAMES
        for which, word in (
            ("mean", "mean of medians, "), ("mean_low", "at least, "), ("mean_high", "at most, "),
            ("worst", "worst median, "),
        )
    ),
    *(Column(f"locked_{frame}", "-", f"P(ε < lock), {label}", 4) for frame, label in _FRAMES),
    Column("outside_s", "s", "time outside the beam, median", 4),
    Column("outside_p95_s", "s", "95 %", 4),
    Column("found_at_once", "-", "found at once", 4),
    Column("found_by_search", "-", "by the search", 4),
    Column("not_found", "-", "not found", 4),
    Column("reacquire_s", "s", "time to reacquire if found, median", 4),
    Column("reacquire_p95_s", "s", "95 %", 4),
    Column("uncovered", "-", "P(error not covered)", 4),
    Column("uncovered_outages", "-", "outages whose median is not covered"),
    Column("ratio", "-", "error over the baseline's", 4),
    Column("ratio_low", "-", "at least", 4),
    Column("ratio_high", "-", "at most", 4),
)  # fmt: skip


def number(value: float) -> float | None:
    """Return a number as float, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def twins_of(product: TrackingComparison, reference: ReferenceTable | None) -> Twins:
    """Return the published row of each outage that has one."""
    keys = set(zip(product.passes, product.outages, strict=True))
    rows = reference.rows if reference is not None else ()
    found = {(str(row["pass"]), str(row["outage"])): row for row in rows}
    return {key: row for key, row in found.items() if key in keys}


def outage_table(
    product: TrackingComparison, reference: ReferenceTable | None, twins: Twins
) -> Table:
    """Return the table of the trackers by outage, beside published values if there are any."""
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
                row[f"{measure}_p05_deg"] = number(low)
                row[f"{measure}_deg"] = number(middle)
                row[f"{measure}_p95_deg"] = number(high)
                if measure == "error_max" and isinstance(printed, Printed):
                    row["error_max_deg_paper"] = printed
                    row["paper_inside"] = bool(low <= printed <= high)
            row["nees"] = number(product.quantiles[1, product.measures.index("nees"), t, k])
            row["uncovered"] = number(product.uncovered[t, k])
            rows.append({name: cell for name, cell in row.items() if name in names})
    notes = [
        f"Median, 5 % and 95 % quantile of the largest error of the prediction, over "
        f"{product.ended} completed of {product.cases} cases.",
        _cover_note(product),
    ]
    if reference is not None and twins:
        notes.append(
            f"Paper: {reference.source}. Each of its values is one random draw with its own "
            "tracker; it is repeated beside every tracker. The draw should lie within 5–95 %; it "
            "need not equal the median."
        )
    return Table("Trackers, outage by outage", columns, rows, notes)


def _cover_note(product: TrackingComparison) -> str:
    return (
        f"An error is not covered if its NEES exceeds {product.nees_limit:.3g}; with a correct "
        f"covariance this happens in {100 * (1 - COVERED):.2g} % of the cases."
    )


def tracker_table(product: TrackingComparison) -> Table:
    """Return the table of the trackers over all outages."""
    outside = product.pooled[:, product.measures.index("time_outside")]
    nees = product.quantiles[1, product.measures.index("nees")]
    rows: list[dict[str, Cell]] = []
    for t, tracker in enumerate(product.trackers):
        row: dict[str, Cell] = {"tracker": tracker}
        for k, (frame, _) in enumerate(_FRAMES):
            row[f"mean_{frame}_deg"] = number(np.degrees(product.mean_median_rad[k, t]))
            row[f"mean_low_{frame}_deg"] = number(np.degrees(product.mean_interval_rad[0, k, t]))
            row[f"mean_high_{frame}_deg"] = number(np.degrees(product.mean_interval_rad[1, k, t]))
            row[f"worst_{frame}_deg"] = number(np.degrees(product.worst_median_rad[k, t]))
            row[f"locked_{frame}"] = number(float(np.mean(product.locked[k, t])))
        row |= {
            "outside_s": number(outside[1, t]),
            "outside_p95_s": number(outside[2, t]),
            "found_at_once": number(product.reacquired[0, t]),
            "found_by_search": number(product.reacquired[1, t]),
            "not_found": number(product.reacquired[2, t]),
            "reacquire_s": number(product.reacquire_s[0, t]),
            "reacquire_p95_s": number(product.reacquire_s[1, t]),
            "uncovered": number(float(np.mean(product.uncovered[t]))),
            "uncovered_outages": int(np.sum(nees[t] > product.nees_limit))
            if np.isfinite(nees[t]).any()
            else None,
            "ratio": number(product.ratio[t]),
            "ratio_low": number(product.ratio_interval[0, t]),
            "ratio_high": number(product.ratio_interval[1, t]),
        }
        rows.append(row)
    columns = [c for c in _TRACKERS if any(row[c.name] is not None for row in rows)]
    names = {c.name for c in columns}
    rows = [{name: cell for name, cell in row.items() if name in names} for row in rows]
    notes = [
        f"Over {len(product.outages)} outages and {product.ended} cases. True: errors "
        "√(ΔA² + Δh²) of the true direction. Sky: arcs, √((ΔA cos h)² + Δh²) for small errors. "
        "Encoders: errors √(ΔA² + Δh²) of the angles at the encoders, which decide about the "
        "reacquisition. P: share of cases whose largest error is within the beam of "
        f"{np.degrees(product.lock_angle_rad):g}°, mean over the outages. Times and shares are "
        "over all cases and outages together; the time to reacquire is of cases that are found.",
        f"At least, at most: {100 * product.level:g} % bootstrap intervals over the cases. Error "
        f"over the baseline's: ratio of the mean of the medians to the value of "
        f"{product.baseline}.",
        _cover_note(product),
    ]
    return Table("Trackers", columns, rows, notes)
