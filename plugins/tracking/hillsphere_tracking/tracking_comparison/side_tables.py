"""Tables of the comparison of trackers beside the campaign itself: a sweep, and consistency."""

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
    """Return the trackers at the points of a sweep."""
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
        f"Campaign on stage {ages.stage}: medians over the cases at each point. At least, at most: "
        f"{100 * level:g} % intervals by bootstrap over the cases. Worst median over that of "
        f"{ages.baseline} there: the largest of these ratios over the outages, and in which."
    ]
    if np.isfinite(ages.reacquired).any():
        notes.append(
            "Shares found over cases and outages together; the time to reacquire is that of those "
            "found."
        )
    return Table(f"Trackers over {ages.name.replace('_', ' ')}", columns, rows, notes)


def nees_table(found: Consistency, level: float) -> Table:
    """Return the mean NEES outage by outage."""
    inside = inside_band(found)
    rows: list[dict[str, Cell]] = [
        {
            "pass": found.passes[k],
            "outage": found.outages[k],
            "tracker": tracker,
            "cases": int(found.count[t, k]),
            "nees": number(found.mean[t, k]),
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


def knowing_table(found: Consistency, level: float) -> Table:
    """Return how well each tracker knows how good it is."""
    inside = inside_band(found)
    rows: list[dict[str, Cell]] = [
        {
            "tracker": tracker,
            "consistent": tracker in found.consistent,
            "inside": int(inside[t].sum()),
            "outages": len(found.outages),
            "nees": number(found.overall[t]),
            "nees_low": number(found.overall_interval[0, t]),
            "nees_high": number(found.overall_interval[1, t]),
            "least": number(float(np.min(found.mean[t]))),
            "largest": number(float(np.max(found.mean[t]))),
            "mean_deg": number(np.degrees(found.mean_median_rad[t])),
            "ratio": number(found.error_ratio[t]),
            "ratio_low": number(found.error_ratio_interval[0, t]),
            "ratio_high": number(found.error_ratio_interval[1, t]),
        }
        for t, tracker in enumerate(found.trackers)
    ]
    notes = [
        _band_note(level),
        f"At least, at most: {100 * level:g} % intervals by bootstrap over the cases, which takes "
        "all outages of a case together.",
    ]
    return Table("Whether trackers know how good they are", _KNOWS, rows, notes)
