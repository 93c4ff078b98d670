"""Points along a sweep at which the failure ratio exceeds a threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import is_undecided, ratio_at_points, ratio_interval
from hillsphere.presentation import Table
from hillsphere.products import CaseTable
from hillsphere.show.tables import FilledColumn, column, finite_or_blank, tabulate, text_column
from hillsphere_campaigns.result_tables import gather

__all__ = ["Crossing", "crossing_table", "crossings"]


@dataclass(frozen=True)
class Crossing:
    """Where the failure ratio first exceeds a threshold, all else at one combination of values.

    Parameters
    ----------
    others : str
        The other swept values, in words.
    low, high : float
        The two points between which it does: what happens between them nobody has looked at, and
        failures of rare cases rise steeply. NaN and the first point if it does so from there on;
        the last point and infinity if it never does.
    surely_below, surely_above : float
        Largest value up to which the interval of the ratio lies below the threshold at all points,
        NaN for none; smallest from which on a point's interval lies above it, infinite for none.
    """

    others: str
    low: float
    high: float
    surely_below: float
    surely_above: float


def crossings(
    table: CaseTable, threshold: float, level: float, *, chosen: bool
) -> tuple[str, list[Crossing]]:
    """Find the crossings along the last swept number that takes more than one value.

    Where the points are a list with a ladder, along that, for each of its groups.

    Parameters
    ----------
    table : CaseTable
        Of a sweep.
    threshold : float
        Failure ratio.
    level : float
        Confidence level of the intervals of each point.
    chosen : bool
        Whether nothing of the cases was drawn at random: then a single one says all of its point.

    Returns
    -------
    along : str
        What is followed; ``""`` if no number is swept.
    found : list of Crossing
        One for each combination of the other swept values.
    """
    points = table.points
    if points is None:
        return "", []
    if table.ladder is not None:
        name, x_all, names = table.ladder.name, table.ladder.values, table.ladder.groups
    else:
        numbers = [
            d for d, unit in enumerate(table.swept_units) if unit and np.unique(points[d]).size > 1
        ]
        if not numbers:
            return "", []
        along = numbers[-1]
        name, x_all = table.swept[along], points[along]
        names = tuple(_others(label, name) for label in table.point_labels)
    count = points.shape[1]
    cases = np.bincount(table.point, minlength=count)
    # Undecided cases widen the interval; a point of which no case is decided has no ratio.
    of_points = ratio_at_points(table, table.point, count, level)
    (low, high), ratio, decided = of_points.sure, of_points.value, of_points.decided
    group = _groups(table, None if table.ladder is not None else along)
    found = []
    for g in range(int(group.max()) + 1):
        here = np.flatnonzero((group == g) & (decided > 0))
        if not here.size:
            continue
        here = here[np.argsort(x_all[here], kind="stable")]
        x, above = x_all[here], ratio[here] > threshold
        single = np.full(len(here), chosen) & (cases[here] == 1) & (decided[here] == 1)
        first = int(np.argmax(above)) if above.any() else len(here)
        sure = np.where(single, ~above, high[here] < threshold)
        upto = len(here) if sure.all() else int(np.argmin(sure))
        beyond = np.where(single, above, low[here] > threshold)
        found.append(
            Crossing(
                others=names[int(here[0])],
                low=float(x[first - 1]) if first else np.nan,
                high=float(x[first]) if first < len(here) else np.inf,
                surely_below=float(x[upto - 1]) if upto else np.nan,
                surely_above=float(x[int(np.argmax(beyond))]) if beyond.any() else np.inf,
            )
        )
    return name, found


def _groups(table: CaseTable, along: int | None) -> Integers:
    """Return a number (P,) for each combination of what is not followed, or group of a ladder."""
    if along is None:
        assert table.ladder is not None
        order = {name: k for k, name in enumerate(dict.fromkeys(table.ladder.groups))}
        return np.array([order[name] for name in table.ladder.groups], dtype=np.int64)
    assert table.points is not None
    others = np.delete(table.points, along, axis=0)
    _, group = np.unique(others, axis=1, return_inverse=True)
    return np.asarray(group.ravel(), dtype=np.int64)


def crossing_table(
    table: CaseTable, threshold: float, level: float, *, chosen: bool
) -> Table | None:
    """Return the crossings as a table, see `crossings`; None if no number is swept."""
    along, found = crossings(table, threshold, level, chosen=chosen)
    if not along:
        return None
    ladder = table.ladder
    unit = table.swept_units[table.swept.index(along)] if ladder is None else ladder.unit
    others, *ends = gather(found, "others", "low", "high", "surely_below", "surely_above")
    low, high, below, above = map(finite_or_blank, ends)

    def number(name: str, values: Array, label: str) -> FilledColumn:
        return column(name, values, label, unit=unit, is_si=False)

    columns = [
        text_column("others", others, "at"),
        number("low", low, f"{along}, not yet at"),
        number("high", high, "but at"),
        text_column("said", map(_said, found)),
        number("surely_below", below, "surely fewer up to"),
        number("surely_above", above, "surely more from"),
    ]
    sure = f"sure by the {100 * level:g} % intervals of the points"
    notes = [f"Between two points of the sweep, with more of them the nearer; {sure}."]
    if is_undecided(table.status).any():
        notes.append(
            "Over decided cases; what is sure holds whether or not the undecided ones had failed."
        )
    most = int(np.bincount(table.point).max(initial=0))
    allowed = float(ratio_interval(np.zeros(1), np.array([most]), level)[1][0])
    if most and allowed >= threshold and not (chosen and most == 1):
        notes.append(
            f"No point can be sure to have fewer: none of {most} failed would still allow "
            f"{100 * allowed:.2g} %. More repetitions are needed to tell."
        )
    return tabulate(f"Where failures exceed {100 * threshold:g} %", columns, notes)


def _said(one: Crossing) -> str:
    if np.isnan(one.low):
        return "from the first point on"
    if np.isinf(one.high):
        return "never in this sweep"
    return f"between {one.low:g} and {one.high:g}"


def _others(label: str, along: str) -> str:
    parts = [part for part in label.split(", ") if not part.startswith(f"{along} = ")]
    return ", ".join(parts)
