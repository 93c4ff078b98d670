"""Tables of a campaign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.cases.case_classes import (
    case_class,
    decided_failures,
    has_ended,
    is_undecided,
    ratio_at_points,
    undecided_sentence,
    what_left_it_undecided,
)
from hillsphere.presentation import Cell, Column, Table
from hillsphere.products import CaseTable
from hillsphere_campaigns.sensitivity import (
    LEAST_FOR_CORRELATION,
    RankCorrelations,
    SobolIndices,
    too_few_failures,
)
from hillsphere_campaigns.statistics import MetricStatistics, classes, metric_statistics

__all__ = [
    "MOST_ROWS",
    "class_table",
    "correlation_table",
    "extreme_table",
    "failed_table",
    "first_rows",
    "number",
    "percentile",
    "point_statistics_table",
    "point_table",
    "sobol_table",
    "statistics_table",
    "undecided_table",
]

MOST_ROWS = 500
"""Rows of the tables that grow with the campaign; the export has all of it."""

_INTERVALS = (
    "“At least” and “at most” are the ends of {level:g} % confidence intervals, each by itself "
    "(columns _low and _high of the CSV file)."
)


def number(value: float) -> float | None:
    """Return a table's cell: None for a number that is not finite."""
    return float(value) if np.isfinite(value) else None


def first_rows(total: int, what: str) -> str:
    """Say that a table has the first of so many rows only; ``""`` if it has all."""
    if total <= MOST_ROWS:
        return ""
    return f" The first {MOST_ROWS} of {total} {what}; the key show chooses metrics."


def percentile(q: float) -> str:
    """Return the name of a quantile's column: ``"p99_73"``."""
    return "p" + f"{100.0 * q:.10g}".replace(".", "_").replace("-", "_")


def _between(stem: str, label: str, unit: str = "-", digits: int = 5) -> tuple[Column, ...]:
    return (
        Column(stem, unit, label, digits),
        Column(f"{stem}_low", unit, f"{label}, at least", digits),
        Column(f"{stem}_high", unit, f"{label}, at most", digits),
    )


def _cells(stem: str, value: float, interval: Sequence[float] | np.ndarray) -> dict[str, Cell]:
    return {
        stem: number(value),
        f"{stem}_low": number(float(interval[0])),
        f"{stem}_high": number(float(interval[1])),
    }


def _statistics_columns(levels: Sequence[float]) -> tuple[Column, ...]:
    return (
        Column("metric", "", "metric"),
        Column("unit", "", "unit"),
        Column("cases", "-", "cases that came to their end"),
        *_between("mean", "mean"),
        *_between("deviation", "standard deviation"),
        Column("least", "-", "least", 5),
        *(c for q in levels for c in _between(percentile(q), f"{100 * q:g} %")),
        Column("largest", "-", "largest", 5),
        Column("note", "", "note"),
    )


def _statistics_row(one: MetricStatistics) -> dict[str, Cell]:
    row: dict[str, Cell] = {
        "metric": one.name,
        "unit": one.unit,
        "cases": one.count,
        **_cells("mean", one.mean, one.mean_interval),
        **_cells("deviation", one.deviation, one.deviation_interval),
        "least": number(one.least),
        "largest": number(one.largest),
        "note": one.note,
    }
    for i, q in enumerate(one.levels):
        row |= _cells(percentile(q), one.quantiles[i], one.quantile_intervals[:, i])
    return row


def statistics_table(
    found: Sequence[MetricStatistics], levels: Sequence[float], level: float, caveat: str
) -> Table:
    """Return mean, standard deviation, extremes and quantiles of every metric."""
    notes = [
        "Over the cases that came to their end; each number in the unit of its row. "
        + _INTERVALS.format(level=100 * level)
        + " An end that is missing would need more cases."
        + first_rows(len(found), "metrics"),
        "Intervals: Student's for the mean, Bonett's (2006) for the standard deviation, two of the "
        "values themselves for a quantile.",
    ]
    rows = [_statistics_row(one) for one in found[:MOST_ROWS]]
    return Table(
        "Statistics", _statistics_columns(levels), rows, [*notes, *([caveat] if caveat else [])]
    )


def class_table(table: CaseTable, level: float, drawn: bool) -> Table:
    """Return how the cases ended, with the first case of each class and what it has to say.

    `drawn` says whether the cases are independent.
    """
    rows: list[dict[str, Cell]] = [
        {
            "status": one.status,
            "cause": one.cause,
            "class": case_class(one.status, one.failed),
            "cases": one.count,
            **_cells("share", one.share, one.interval),
            "first_case": one.first_case,
            "message": one.message,
        }
        for one in classes(table, level=level)
    ]
    columns = (
        Column("status", "", "status"),
        Column("cause", "", "cause"),
        Column("class", "", "class"),
        Column("cases", "-", "cases"),
        *_between("share", "share", digits=4),
        Column("first_case", "-", "first case"),
        Column("message", "", "message"),
    )
    notes = [_INTERVALS.format(level=100 * level) + " Shares by Clopper and Pearson."]
    if told := undecided_sentence(table):
        notes.append(told)
        notes.append("Shares of successes and failures are of decided cases, others of all.")
    notes += _step_error_notes(table)
    if not drawn:
        notes.append("The cases are no independent draws: they are those of as many random ones.")
    return Table("How the cases ended", columns, rows[:MOST_ROWS], notes)


def _step_error_notes(table: CaseTable) -> list[str]:
    """Return a note on the size of the step errors."""
    errors = table.step_error
    if errors is None or not (known := np.flatnonzero(np.isfinite(errors))).size:
        return []
    worst = int(known[np.argmax(errors[known])])
    return [
        f"Estimated step error, in the plant's natural units: median "
        f"{np.median(errors[known]):.2g}, largest {errors[worst]:.2g} (case {table.case[worst]})."
    ]


def failed_table(table: CaseTable) -> Table:
    """Return the first failed cases with the numbers by which they can be repeated."""
    why = too_few_failures(table)
    return _cases_table("Failed cases", table, decided_failures(table), [why] if why else [])


def undecided_table(table: CaseTable) -> Table:
    """Return the first undecided cases with the reasons."""
    left = is_undecided(table.status)
    notes = [
        "Neither successes nor failures: no ratio and no statistics counts them.",
        f"What the statuses mean: {what_left_it_undecided(table.status)}.",
    ]
    return _cases_table("Undecided cases", table, left, notes)


def _cases_table(
    title: str, table: CaseTable, chosen: NDArray[np.bool_], more_notes: Sequence[str]
) -> Table:
    said = dict(zip(table.message_case.tolist(), table.messages, strict=True))
    which, errors = np.flatnonzero(chosen), table.step_error
    rows: list[dict[str, Cell]] = [
        {
            "case": int(table.case[i]),
            **_at(table, int(i)),
            "status": str(table.status[i]),
            "cause": str(table.cause[i]),
            **({} if errors is None else {"step_error": number(float(errors[i]))}),
            "message": said.get(int(table.case[i]), ""),
        }
        for i in which[:MOST_ROWS]
    ]
    columns = (
        Column("case", "-", "case"),
        *_point_column(table),
        Column("status", "", "status"),
        Column("cause", "", "cause"),
        *(() if errors is None else (Column("step_error", "-", "step error", 2),)),
        Column("message", "", "message"),
    )
    more = f"The first {MOST_ROWS} of {which.size}. " if which.size > MOST_ROWS else ""
    notes = [more + "`hillsphere rerun RUN --case NUMBER` repeats one with its history."]
    return Table(title, columns, rows, [*notes, *more_notes])


def _point_column(table: CaseTable) -> tuple[Column, ...]:
    return (Column("point", "", "point"),) if table.point_labels else ()


def _at(table: CaseTable, row: int) -> dict[str, Cell]:
    return {"point": table.point_labels[table.point[row]]} if table.point_labels else {}


def extreme_table(table: CaseTable, each: int = 3) -> Table:
    """Return the cases with the least and the largest values of every metric."""
    rows: list[dict[str, Cell]] = []
    for name, unit, values in zip(table.metrics, table.units, table.values, strict=True):
        kept = np.flatnonzero(has_ended(table) & np.isfinite(values))
        if kept.size < 2 or np.ptp(values[kept]) == 0.0:
            continue
        order = kept[np.argsort(values[kept], kind="stable")]
        ends = [("least", i) for i in order[:each]] + [("largest", i) for i in order[::-1][:each]]
        rows += [
            {
                "metric": name,
                "unit": unit,
                "end": end,
                "case": int(table.case[i]),
                **_at(table, int(i)),
                "value": float(values[i]),
            }
            for end, i in ends
        ]
    columns = (
        Column("metric", "", "metric"),
        Column("unit", "", "unit"),
        Column("end", "", "end"),
        Column("case", "-", "case"),
        *_point_column(table),
        Column("value", "-", "value", 6),
    )
    notes = [
        "Of the cases that came to their end. `hillsphere rerun RUN --case NUMBER` repeats one "
        "with its history." + first_rows(len(rows), "rows")
    ]
    return Table("Extreme cases", columns, rows[:MOST_ROWS], notes)


def correlation_table(found: RankCorrelations, level: float) -> Table:
    """Return the rank correlations, those least likely by chance first."""
    pairs = found.strongest()
    rows: list[dict[str, Cell]] = [
        {
            "input": found.inputs[i],
            "metric": found.metrics[j],
            "cases": int(found.count[j]),
            **_cells("rho", found.rho[i, j], found.interval[:, i, j]),
            "p": number(found.p[i, j]),
            "p_holm": number(found.p_holm[i, j]),
        }
        for i, j in pairs[:MOST_ROWS]
    ]
    columns = (
        Column("input", "", "input"),
        Column("metric", "", "metric"),
        Column("cases", "-", "cases"),
        *_between("rho", "rank correlation", digits=3),
        Column("p", "-", "p", 2),
        Column("p_holm", "-", "p, for all comparisons", 2),
    )
    notes = [
        "Spearman's coefficient over the cases that came to their end; with “failed” the "
        "rank-biserial one over all decided cases. " + _INTERVALS.format(level=100 * level),
        f"p: probability of such a coefficient by chance; corrected by Holm for "
        f"{len(pairs)} comparisons. Inputs that are drawn together share their correlations.",
    ]
    notes.append(
        f"From at least {LEAST_FOR_CORRELATION} cases, with failure as many failed and as many "
        "others: from fewer large coefficients come by chance."
    )
    if len(pairs) > MOST_ROWS:
        notes.append(f"The {MOST_ROWS} clearest of {len(pairs)}.")
    if found.dependent:
        notes.append(
            "The points of the sweep saw the same random numbers: no p values and intervals, which "
            "need independent cases."
        )
    return Table("Rank correlations", columns, rows, notes)


def sobol_table(found: SobolIndices, level: float) -> Table:
    """Return the Sobol indices of every metric."""
    rows: list[dict[str, Cell]] = [
        {
            "metric": metric,
            "input": name,
            **_cells("first", found.first[i, j], found.first_interval[:, i, j]),
            **_cells("total", found.total[i, j], found.total_interval[:, i, j]),
        }
        for j, metric in enumerate(found.metrics)
        for i, name in enumerate(found.inputs)
    ]
    columns = (
        Column("metric", "", "metric"),
        Column("input", "", "input"),
        *_between("first", "first", digits=3),
        *_between("total", "total", digits=3),
    )
    notes = [
        f"From {len(found.inputs) + 2} samples of {found.samples} cases: share of the metric's "
        "variance that is due to the input alone (first), and with all that it does together with "
        "others (total). " + _INTERVALS.format(level=100 * level) + " Bootstrap."
    ]
    return Table("Sobol indices", columns, rows[:MOST_ROWS], notes)


def _swept_columns(table: CaseTable) -> tuple[list[Column], list[str]]:
    """Return columns for the swept numbers, and their names."""
    columns, names = [], []
    for name, unit in zip(table.swept, table.swept_units, strict=True):
        key = (
            name
            if name not in ("number", "point", "cases", "failures", "undecided", "ratio")
            else f"{name}_swept"
        )
        names.append(key if unit else "")
        if unit:
            columns.append(Column(key, unit, key, 6))
    return columns, names


def point_table(table: CaseTable, level: float) -> Table:
    """Return the failure ratio at each point of a sweep."""
    assert table.points is not None
    count = table.points.shape[1]
    cases = np.bincount(table.point, minlength=count)
    found = ratio_at_points(table, table.point, count, level)
    columns, names = _swept_columns(table)
    open_cases = bool(found.undecided.any())
    rows: list[dict[str, Cell]] = [
        {
            "number": p,
            "point": table.point_labels[p],
            **{key: float(table.points[d, p]) for d, key in enumerate(names) if key},
            "cases": int(cases[p]),
            "failures": int(found.failures[p]),
            **_cells("ratio", float(found.value[p]), found.interval[:, p]),
            **(
                {
                    "undecided": int(found.undecided[p]),
                    "least": float(found.range[0, p]),
                    "most": float(found.range[1, p]),
                }
                if open_cases
                else {}
            ),
        }
        for p in range(min(count, MOST_ROWS))
    ]
    more = f"The first {MOST_ROWS} of {count} points. " if count > MOST_ROWS else ""
    return Table(
        "Failures over the sweep",
        (
            Column("number", "-", "number"),
            Column("point", "", "point"),
            *columns,
            Column("cases", "-", "cases"),
            Column("failures", "-", "failures"),
            *_between("ratio", "failure ratio", digits=4),
            *(
                (
                    Column("undecided", "-", "undecided"),
                    Column("least", "-", "ratio if none of these had failed", 4),
                    Column("most", "-", "ratio if all of these had failed", 4),
                )
                if open_cases
                else ()
            ),
        ),
        rows,
        [
            more
            + _INTERVALS.format(level=100 * level)
            + " Ratios by Clopper and Pearson, over decided cases."
        ],
    )


def point_statistics_table(table: CaseTable, levels: Sequence[float], level: float) -> Table:
    """Return the statistics of every metric at each point of a sweep."""
    assert table.points is not None
    count = table.points.shape[1]
    room = max(1, MOST_ROWS // max(1, len(table.metrics)))
    rows: list[dict[str, Cell]] = [
        {"point": table.point_labels[p], **_statistics_row(one)}
        for p in range(min(count, room))
        for one in metric_statistics(table, table.point == p, level=level, levels=levels)[
            :MOST_ROWS
        ]
    ]
    more = f"The first {room} of {count} points. " if count > room else ""
    return Table(
        "Statistics over the sweep",
        (Column("point", "", "point"), *_statistics_columns(levels)),
        rows,
        [
            more + "Over the cases that came to their end; each number in the unit of its row. "
            + _INTERVALS.format(level=100 * level) + first_rows(len(table.metrics), "metrics")
        ],
    )  # fmt: skip
