"""Tables of the comparison of trackers over a sweep, and of their consistency."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import Cell, Column, Table
from hillsphere_tracking.tracking_comparison.products import AgeComparison, Consistency
from hillsphere_tracking.tracking_comparison.tables import number
from hillsphere_tracking.tracking_comparison.verdict import inside_band

__all__ = ["age_table", "knowing_table", "nees_table"]

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
    Column("consistent", "", "expects errors as they are"),
    Column("inside", "-", "outages inside the band"),
    Column("outages", "-", "of"),
    Column("nees", "-", "mean NEES", 4),
    Column("nees_low", "-", "at least", 4),
    Column("nees_high", "-", "at most", 4),
    Column("least", "-", "least of an outage", 4),
    Column("largest", "-", "largest", 4),
    Column("mean_deg", "deg", "mean of median errors", 4),
    Column("ratio", "-", "over that of the first that is right", 4),
    Column("ratio_low", "-", "at least", 4),
    Column("ratio_high", "-", "at most", 4),
)
_REACQUIRED = (
    Column("found_at_once", "-", "found at once", 4),
    Column("found_by_search", "-", "by the search", 4),
    Column("not_found", "-", "not found", 4),
    Column("reacquire_s", "s", "time to reacquire if found, median", 4),
    Column("reacquire_p95_s", "s", "95 %", 4),
)


def age_table(ages: AgeComparison, level: float) -> Table:
    """Return the table of the trackers at the points of a sweep."""
    key = f"{ages.name.lower()}_{ages.unit.replace('/', '_')}" if ages.unit != "-" else ages.name
    first = ages.trackers.index(ages.baseline)
    mean = np.degrees(ages.mean_median_rad)
    low, high = np.degrees(ages.mean_interval_rad)
    columns = [Column(key, ages.unit, ages.name.replace("_", " "), 6)]
    if any(ages.group):
        columns.append(Column("also", "", "also swept"))
    columns += [
        Column("tracker", "", "tracker"),
        Column("cases", "-", "cases"),
        Column("mean_deg", "deg", "mean of medians", 4),
        Column("mean_low_deg", "deg", "at least", 4),
        Column("mean_high_deg", "deg", "at most", 4),
        Column("worst_deg", "deg", "worst median", 4),
        Column("ratio", "-", f"mean over that of {ages.baseline}", 4),
        Column("worst_ratio", "-", f"worst median over that of {ages.baseline} there", 4),
        Column("worst_ratio_outage", "", "in outage"),
    ]
    if np.isfinite(ages.reacquired).any():
        columns += _REACQUIRED
    names = {column.name for column in columns}
    rows: list[dict[str, Cell]] = []
    for p in range(ages.value.size):
        for t, tracker in enumerate(ages.trackers):
            k = int(ages.worst_ratio_outage[t, p])
            row: dict[str, Cell] = {
                key: float(ages.value[p]),
                "also": ages.group[p],
                "tracker": tracker,
                "cases": int(ages.count[p]),
                "mean_deg": number(mean[t, p]),
                "mean_low_deg": number(low[t, p]),
                "mean_high_deg": number(high[t, p]),
                "worst_deg": number(np.degrees(ages.worst_median_rad[t, p])),
                "ratio": number(mean[t, p] / mean[first, p]),
                "worst_ratio": number(ages.worst_ratio[t, p]),
                "worst_ratio_outage": f"{ages.passes[k]} {ages.outages[k]}",
                "found_at_once": number(ages.reacquired[0, t, p]),
                "found_by_search": number(ages.reacquired[1, t, p]),
                "not_found": number(ages.reacquired[2, t, p]),
                "reacquire_s": number(ages.reacquire_s[0, t, p]),
                "reacquire_p95_s": number(ages.reacquire_s[1, t, p]),
            }
            rows.append({name: cell for name, cell in row.items() if name in names})
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
    return Table(f"Trackers over {ages.name.replace('_', ' ')}", columns, rows, notes)


def nees_table(consistency: Consistency, level: float) -> Table:
    """Return the table of the mean NEES of each outage."""
    inside = inside_band(consistency)
    rows: list[dict[str, Cell]] = [
        {
            "pass": consistency.passes[k],
            "outage": consistency.outages[k],
            "tracker": tracker,
            "cases": int(consistency.count[t, k]),
            "nees": number(consistency.mean[t, k]),
            "nees_low": float(consistency.interval[0, t, k]),
            "nees_high": float(consistency.interval[1, t, k]),
            "inside": bool(inside[t, k]),
        }
        for k in range(len(consistency.outages))
        for t, tracker in enumerate(consistency.trackers)
    ]
    return Table("Normalised estimation errors squared", _NEES, rows, [_band_note(level)])


def _band_note(level: float) -> str:
    return (
        "Mean over N cases of the normalised estimation error squared (NEES) in the middle of the "
        f"outage, with two degrees of freedom. The {100 * level:g} % band is from χ² with 2N "
        "degrees of freedom, divided by N. Outages of the same pass are not independent."
    )


def knowing_table(consistency: Consistency, level: float) -> Table:
    """Return the table of each tracker's consistency over all outages."""
    inside = inside_band(consistency)
    rows: list[dict[str, Cell]] = [
        {
            "tracker": tracker,
            "consistent": tracker in consistency.consistent,
            "inside": int(inside[t].sum()),
            "outages": len(consistency.outages),
            "nees": number(consistency.overall[t]),
            "nees_low": number(consistency.overall_interval[0, t]),
            "nees_high": number(consistency.overall_interval[1, t]),
            "least": number(float(np.min(consistency.mean[t]))),
            "largest": number(float(np.max(consistency.mean[t]))),
            "mean_deg": number(np.degrees(consistency.mean_median_rad[t])),
            "ratio": number(consistency.error_ratio[t]),
            "ratio_low": number(consistency.error_ratio_interval[0, t]),
            "ratio_high": number(consistency.error_ratio_interval[1, t]),
        }
        for t, tracker in enumerate(consistency.trackers)
    ]
    notes = [
        _band_note(level),
        f"At least, at most: {100 * level:g} % bootstrap intervals over the cases, each drawn with "
        "all its outages.",
    ]
    return Table("Consistency of the trackers", _KNOWS, rows, notes)
