"""Tables of the comparison of trackers: by outage beside published values, and by tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Printed, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_tracking.tracking_comparison.products import COVERED, TrackingComparison

__all__ = [
    "Twins", "blank_infinite", "outage_table", "reacquisition_columns", "tracker_table", "twins_of",
]  # fmt: skip

Twins: TypeAlias = Mapping[tuple[str, str], Mapping[str, Printed | str | None]]
"""Published rows by pass and outage."""

_FRAMES = (("true", "true"), ("sky", "sky"), ("encoder", "encoders"))


def blank_infinite(values: Array) -> Array:
    """Return values with NaN, a blank cell, in place of infinite ones."""
    return np.where(np.isfinite(values), values, np.nan)


def twins_of(product: TrackingComparison, reference: ReferenceTable | None) -> Twins:
    """Return the published row of each outage that has one."""
    keys = set(zip(product.passes, product.outages, strict=True))
    rows = reference.rows if reference is not None else ()
    published = {(str(row["pass"]), str(row["outage"])): row for row in rows}
    return {key: row for key, row in published.items() if key in keys}


def outage_table(
    product: TrackingComparison, reference: ReferenceTable | None, twins: Twins
) -> Table:
    """Return the table of the trackers by outage, beside published values if there are any."""
    of = FieldColumns(product, "outages", "trackers")
    rows = [twins.get(key, {}) for key in zip(product.passes, product.outages, strict=True)]

    def published(name: str) -> list[Printed | str | None]:
        values: list[Printed | str | None] = [row.get(name) for row in rows]
        return list(of.spread(tuple(values), "outages"))

    def quantile(measure: str, level: int) -> Array:
        values = product.quantiles[level, product.measures.index(measure)]
        return of.spread(blank_infinite(values), "trackers", "outages")

    filled = [of("passes", "pass"), of("outages", "outage"), of("loss_s", "determination_s")]
    filled.append(of("prediction_s"))
    if any("prediction_s" in row for row in rows):
        filled.append(
            column("prediction_s_paper", published("prediction_s"), unit="s", is_si=False)
        )
    filled.append(of("trackers", "tracker"))
    for measure, words in (
        ("error_max", "√(ΔA² + Δh²)"),
        ("sky_error_max", "√((ΔA cos h)² + Δh²)"),
    ):
        filled.append(column(f"{measure}_p05_deg", quantile(measure, 0), "5 %", 4))
        filled.append(column(f"{measure}_deg", quantile(measure, 1), f"median largest {words}", 4))
        if measure == "error_max" and twins:
            printed = [q if isinstance(q, Printed) else None for q in published("error_max_deg")]
            filled.append(column("error_max_deg_paper", printed, unit="deg", is_si=False))
            filled.append(_inside_column(of, product, printed))
        filled.append(column(f"{measure}_p95_deg", quantile(measure, 2), "95 %", 4))
    filled.append(column("nees", quantile("nees", 1), "median NEES", 4))
    uncovered = of.spread(blank_infinite(product.uncovered), "trackers", "outages")
    filled.append(column("uncovered", uncovered, "P(error not covered)", 4))
    if any(row.get("note") for row in rows):
        filled.append(text_column("note", published("note"), "note"))
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
    return tabulate("Trackers, outage by outage", filled, notes)


def _inside_column(
    of: FieldColumns, product: TrackingComparison, printed: Sequence[Printed | None]
) -> FilledColumn:
    """Return whether each published error lies between the 5 % and the 95 % quantile."""
    quantiles = np.degrees(product.quantiles[[0, 2], product.measures.index("error_max")])
    low, high = (of.spread(q, "trackers", "outages") for q in quantiles)
    inside = [
        None if value is None else bool(a <= value <= b)
        for a, value, b in zip(low, printed, high, strict=True)
    ]
    return text_column("paper_inside", inside, "paper within 5–95 %")


def _cover_note(product: TrackingComparison) -> str:
    return (
        f"An error is not covered if its NEES exceeds {product.nees_limit:.3g}; with a correct "
        f"covariance this happens in {100 * (1 - COVERED):.2g} % of the cases."
    )


def tracker_table(product: TrackingComparison) -> Table:
    """Return the table of the trackers over all outages."""
    of = FieldColumns(product, "trackers")
    outside = product.pooled[:, product.measures.index("time_outside")]
    nees = product.quantiles[1, product.measures.index("nees")]
    filled = [of("trackers", "tracker")]
    for k, (frame, label) in enumerate(_FRAMES):
        low, high = product.mean_interval_rad[:, k]
        for which, word, values in (
            ("mean", "mean of medians, ", product.mean_median_rad[k]),
            ("mean_low", "at least, ", low),
            ("mean_high", "at most, ", high),
            ("worst", "worst median, ", product.worst_median_rad[k]),
        ):
            name = f"{which}_{frame}_deg"
            filled.append(column(name, blank_infinite(values), f"{word}{label}", 4))
    for k, (frame, label) in enumerate(_FRAMES):
        share = blank_infinite(np.array([np.mean(q) for q in product.locked[k]]))
        filled.append(column(f"locked_{frame}", share, f"P(ε < lock), {label}", 4))
    filled += [
        column("outside_s", blank_infinite(outside[1]), "time outside the beam, median", 4),
        column("outside_p95_s", blank_infinite(outside[2]), "95 %", 4),
        *reacquisition_columns(product.reacquired, product.reacquire_s),
        column(
            "uncovered", blank_infinite(np.array([np.mean(q) for q in product.uncovered])),
            "P(error not covered)", 4,
        ),
        column(
            "uncovered_outages",
            [
                int(np.sum(q > product.nees_limit)) if np.isfinite(q).any() else None
                for q in nees
            ],
            "outages whose median is not covered",
        ),
        column("ratio", blank_infinite(product.ratio), "error over the baseline's", 4),
        column("ratio_low", blank_infinite(product.ratio_interval[0]), "at least", 4),
        column("ratio_high", blank_infinite(product.ratio_interval[1]), "at most", 4),
    ]  # fmt: skip
    filled = [c for c in filled if any(cell is not None for cell in c.cells)]
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
    return tabulate("Trackers", filled, notes)


def reacquisition_columns(shares: Array, times_s: Array) -> list[FilledColumn]:
    """Return the columns of reacquisition, one row per item.

    Shares (3, K): found at once, found by the search, not found. Times (2, K): median and 95 %
    quantile of the time to reacquire.
    """
    at_once, by_search, not_found = blank_infinite(shares)
    median, most = blank_infinite(times_s)
    return [
        column("found_at_once", at_once, "found at once", 4),
        column("found_by_search", by_search, "by the search", 4),
        column("not_found", not_found, "not found", 4),
        column("reacquire_s", median, "time to reacquire if found, median", 4),
        column("reacquire_p95_s", most, "95 %", 4),
    ]
