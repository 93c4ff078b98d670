"""Tables of the comparison of trackers over a sweep, and of their consistency."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Table
from hillsphere.show.tables import FieldColumns, column, tabulate, text_column
from hillsphere_tracking.tracking_comparison.products import AgeComparison, Consistency
from hillsphere_tracking.tracking_comparison.tables import blank_infinite, reacquisition_columns
from hillsphere_tracking.tracking_comparison.verdict import inside_band

__all__ = ["age_table", "knowing_table", "nees_table"]


def age_table(ages: AgeComparison, level: float) -> Table:
    """Return the table of the trackers at the points of a sweep."""
    key = f"{ages.name.lower()}_{ages.unit.replace('/', '_')}" if ages.unit != "-" else ages.name
    of = FieldColumns(ages, "points", "trackers")

    def spread(values: Array) -> Array:
        return of.spread(blank_infinite(values), "trackers", "points")

    low, high = ages.mean_interval_rad
    # in degrees, as the columns are: the ratio of rounded values
    mean = np.degrees(ages.mean_median_rad)
    ratio = mean / mean[ages.trackers.index(ages.baseline)]
    outage = [
        f"{ages.passes[k]} {ages.outages[k]}"
        for k in of.spread(ages.worst_ratio_outage, "trackers", "points").tolist()
    ]
    columns = [
        column(key, of.spread(ages.value, "points"), ages.name.replace("_", " "), 6,
               unit=ages.unit, is_si=False)
    ]  # fmt: skip
    if any(ages.group):
        columns.append(of("group", "also"))
    columns += [
        of("trackers", "tracker"),
        of("count", "cases"),
        column("mean_deg", spread(ages.mean_median_rad), "mean of medians", 4),
        column("mean_low_deg", spread(low), "at least", 4),
        column("mean_high_deg", spread(high), "at most", 4),
        column("worst_deg", spread(ages.worst_median_rad), "worst median", 4),
        column("ratio", spread(ratio), f"mean over that of {ages.baseline}", 4),
        column(
            "worst_ratio", spread(ages.worst_ratio),
            f"worst median over that of {ages.baseline} there", 4,
        ),
        text_column("worst_ratio_outage", outage, "in outage"),
    ]  # fmt: skip
    if np.isfinite(ages.reacquired).any():
        columns += reacquisition_columns(
            np.array([spread(q) for q in ages.reacquired]),
            np.array([spread(q) for q in ages.reacquire_s]),
        )
    notes = [
        f"Sweep of stage {ages.stage}: medians over the cases at each point. At least, at most: "
        f"{100 * level:g} % bootstrap intervals over the cases. The ratio of the worst median is "
        f"the largest ratio over the outages to the median of {ages.baseline} in the same outage."
    ]
    if np.isfinite(ages.reacquired).any():
        notes.append(
            "Shares and times are over all cases and outages together; the time to reacquire is of "
            "cases that are found."
        )
    return tabulate(f"Trackers over {ages.name.replace('_', ' ')}", columns, notes)


def nees_table(consistency: Consistency, level: float) -> Table:
    """Return the table of the mean NEES of each outage."""
    of = FieldColumns(consistency, "outages", "trackers")

    def spread(values: Array) -> Array:
        return of.spread(values, "trackers", "outages")

    low, high = consistency.interval
    columns = [
        of("passes", "pass"),
        of("outages", "outage"),
        of("trackers", "tracker"),
        of("count", "cases"),
        column("nees", spread(blank_infinite(consistency.mean)), "mean NEES", 4),
        column("nees_low", spread(low), "band from", 4),
        column("nees_high", spread(high), "to", 4),
        text_column("inside", spread(inside_band(consistency)), "inside"),
    ]
    return tabulate("Normalised estimation errors squared", columns, [_band_note(level)])


def _band_note(level: float) -> str:
    return (
        "Mean over N cases of the normalised estimation error squared (NEES) in the middle of the "
        f"outage, with two degrees of freedom. The {100 * level:g} % band is from χ² with 2N "
        "degrees of freedom, divided by N. Outages of the same pass are not independent."
    )


def knowing_table(consistency: Consistency, level: float) -> Table:
    """Return the table of each tracker's consistency over all outages."""
    of = FieldColumns(consistency, "trackers")
    inside = inside_band(consistency)
    right = [tracker in consistency.consistent for tracker in consistency.trackers]
    nees_low, nees_high = blank_infinite(consistency.overall_interval)
    ratio_low, ratio_high = blank_infinite(consistency.error_ratio_interval)
    columns = [
        of("trackers", "tracker"),
        text_column("consistent", right, "expects errors as they are"),
        column("inside", [int(q.sum()) for q in inside], "outages inside the band"),
        column("outages", [len(consistency.outages)] * len(right), "of"),
        column("nees", blank_infinite(consistency.overall), "mean NEES", 4),
        column("nees_low", nees_low, "at least", 4),
        column("nees_high", nees_high, "at most", 4),
        column("least", blank_infinite(consistency.mean.min(axis=1)), "least of an outage", 4),
        column("largest", blank_infinite(consistency.mean.max(axis=1)), "largest", 4),
        column(
            "mean_deg", blank_infinite(consistency.mean_median_rad), "mean of median errors", 4
        ),
        column(
            "ratio", blank_infinite(consistency.error_ratio),
            "over that of the first that is right", 4,
        ),
        column("ratio_low", ratio_low, "at least", 4),
        column("ratio_high", ratio_high, "at most", 4),
    ]  # fmt: skip
    notes = [
        _band_note(level),
        f"At least, at most: {100 * level:g} % bootstrap intervals over the cases, each drawn with "
        "all its outages.",
    ]
    return tabulate("Consistency of the trackers", columns, notes)
