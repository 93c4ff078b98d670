"""Tables of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.case_classes import (
    case_class,
    decided_failures,
    has_ended,
    is_undecided,
    ratio_at_points,
    undecided_sentence,
    what_left_it_undecided,
)
from hillsphere.presentation import Table
from hillsphere.products import CaseTable
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    finite_or_blank,
    tabulate,
    text_column,
)
from hillsphere_campaigns.sensitivity import (
    LEAST_FOR_CORRELATION,
    RankCorrelations,
    SobolIndices,
    too_few_failures,
)
from hillsphere_campaigns.statistics import MetricStatistics, classes, point_statistics

__all__ = [
    "MOST_ROWS",
    "class_table",
    "correlation_table",
    "extreme_table",
    "failed_table",
    "first_rows",
    "gather",
    "gather_intervals",
    "interval_columns",
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


def gather(items: Sequence[Any], *names: str) -> list[list[Any]]:
    """Return a list for each of these attributes, with its value of every item."""
    return [[getattr(one, name) for one in items] for name in names]


def gather_intervals(items: Sequence[Any], name: str) -> Array:
    """Return the intervals (2, K) of K items, of which each has one of shape (2,)."""
    return np.reshape([getattr(one, name) for one in items], (-1, 2)).T


def first_rows(total: int, what: str) -> str:
    """Say that a table has the first of so many rows only; ``""`` if it has all."""
    if total <= MOST_ROWS:
        return ""
    return f" The first {MOST_ROWS} of {total} {what}; the key show chooses metrics."


def percentile(q: float) -> str:
    """Return the name of a quantile's column: ``"p99_73"``."""
    return "p" + f"{100.0 * q:.10g}".replace(".", "_").replace("-", "_")


def interval_columns(
    stem: str, label: str, values: ArrayLike, interval: ArrayLike, digits: int = 5,
    before: str | None = None, level: float | None = None,
) -> list[FilledColumn]:  # fmt: skip
    """Return columns of numbers (K,) and of the ends of their intervals (2, K).

    Parameters
    ----------
    stem, label : str
        Name and heading of the first column; the others are called ``STEM_low`` and ``STEM_high``.
    values, interval : array_like
        Numbers without unit; those that are not finite become blank.
    digits : int
        Significant digits.
    before : str, optional
        Words before “at least” and “at most” in the headings; by default the label and a comma.
    level : float, optional
        Confidence level of the intervals, so that requirements can be judged by them.
    """
    before = f"{label}, " if before is None else before
    low, high = np.asarray(interval)
    ends = () if level is None else (f"{stem}_low", f"{stem}_high")
    return [
        column(
            stem, finite_or_blank(values), label, digits, unit="-", interval=ends, confidence=level
        ),
        column(f"{stem}_low", finite_or_blank(low), f"{before}at least", digits, unit="-"),
        column(f"{stem}_high", finite_or_blank(high), f"{before}at most", digits, unit="-"),
    ]


def _statistics_columns(
    found: Sequence[MetricStatistics], levels: Sequence[float], level: float
) -> list[FilledColumn]:
    names, units, count, mean, deviation, least, largest, note = gather(
        found, "name", "unit", "count", "mean", "deviation", "least", "largest", "note"
    )
    shape = len(found), len(levels)
    quantiles = np.reshape([one.quantiles for one in found], shape)
    ends = np.reshape([one.quantile_intervals.T for one in found], (*shape, 2))
    return [
        text_column("metric", names, "metric"),
        text_column("unit", units, "unit"),
        column("cases", count, "cases that came to their end"),
        *interval_columns(
            "mean", "mean", mean, gather_intervals(found, "mean_interval"), level=level
        ),
        *interval_columns(
            "deviation", "standard deviation", deviation,
            gather_intervals(found, "deviation_interval"), level=level,
        ),
        column("least", least, "least", 5),
        *(
            one
            for i, q in enumerate(levels)
            for one in interval_columns(
                percentile(q), f"{100 * q:g} %", quantiles[:, i], ends[:, i].T, level=level
            )
        ),
        column("largest", largest, "largest", 5),
        text_column("note", note, "note"),
    ]  # fmt: skip


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
    columns = _statistics_columns(found[:MOST_ROWS], levels, level)
    table = tabulate("Statistics", columns, [*notes, *([caveat] if caveat else [])])
    return replace(table, total=len(found))


def class_table(table: CaseTable, level: float, drawn: bool) -> Table:
    """Return how the cases ended, with the first case of each class and what it has to say.

    `drawn` says whether the cases are independent.
    """
    found = classes(table, level=level)
    status, cause, failed, count, share, first, message = gather(
        found, "status", "cause", "failed", "count", "share", "first_case", "message"
    )
    columns = [
        text_column("status", status, "status"),
        text_column("cause", cause, "cause"),
        text_column("class", map(case_class, status, failed), "class"),
        column("cases", count, "cases"),
        *interval_columns("share", "share", share, gather_intervals(found, "interval"), 4),
        column("first_case", first, "first case"),
        text_column("message", message, "message"),
    ]
    notes = [_INTERVALS.format(level=100 * level) + " Shares by Clopper and Pearson."]
    if told := undecided_sentence(table):
        notes.append(told)
        notes.append("Shares of successes and failures are of decided cases, others of all.")
    notes += _step_error_notes(table)
    if not drawn:
        notes.append("The cases are no independent draws: they are those of as many random ones.")
    return tabulate("How the cases ended", columns, notes).first(MOST_ROWS)


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
    some = which[:MOST_ROWS]
    columns = [
        column("case", table.case[some], "case"),
        *_point_column(table, some),
        text_column("status", table.status[some], "status"),
        text_column("cause", table.cause[some], "cause"),
        *([] if errors is None
          else [column("step_error", finite_or_blank(errors[some]), "step error", 2)]),
        text_column("message", [said.get(n, "") for n in table.case[some].tolist()], "message"),
    ]  # fmt: skip
    more = f"The first {MOST_ROWS} of {which.size}. " if which.size > MOST_ROWS else ""
    notes = [more + "`hillsphere rerun RUN --case NUMBER` repeats one with its history."]
    return tabulate(title, columns, [*notes, *more_notes])


def _point_column(table: CaseTable, rows: Integers) -> list[FilledColumn]:
    """Return the column of the points of some cases; none without a sweep."""
    if not table.point_labels:
        return []
    labels = [table.point_labels[p] for p in table.point[rows].tolist()]
    return [text_column("point", labels, "point")]


def extreme_table(table: CaseTable, each: int = 3) -> Table:
    """Return the cases with the least and the largest values of every metric."""
    picked: list[tuple[int, str, int, float]] = []
    ended = has_ended(table)
    for m, values in enumerate(table.values):
        kept = np.flatnonzero(ended & np.isfinite(values))
        if kept.size < 2 or np.ptp(values[kept]) == 0.0:
            continue
        order = kept[np.argsort(values[kept], kind="stable")]
        for end, some_rows in (("least", order[:each]), ("largest", order[::-1][:each])):
            picked += [(m, end, i, values[i]) for i in some_rows.tolist()]
    some = picked[:MOST_ROWS]
    metrics, rows = (np.array([one[k] for one in some], dtype=np.int64) for k in (0, 2))
    columns = [
        text_column("metric", [table.metrics[m] for m in metrics], "metric"),
        text_column("unit", [table.units[m] for m in metrics], "unit"),
        text_column("end", [one[1] for one in some], "end"),
        column("case", table.case[rows], "case"),
        *_point_column(table, rows),
        column("value", np.array([one[3] for one in some]), "value", 6),
    ]
    notes = [
        "Of the cases that came to their end. `hillsphere rerun RUN --case NUMBER` repeats one "
        "with its history." + first_rows(len(picked), "rows")
    ]
    return tabulate("Extreme cases", columns, notes)


def correlation_table(found: RankCorrelations, level: float) -> Table:
    """Return the rank correlations, those least likely by chance first."""
    pairs = found.strongest()
    i, j = np.array(pairs[:MOST_ROWS], dtype=np.int64).reshape(-1, 2).T
    columns = [
        text_column("input", [found.inputs[k] for k in i], "input"),
        text_column("metric", [found.metrics[k] for k in j], "metric"),
        column("cases", found.count[j], "cases"),
        *interval_columns("rho", "rank correlation", found.rho[i, j], found.interval[:, i, j], 3),
        column("p", found.p[i, j], "p", 2),
        column("p_holm", found.p_holm[i, j], "p, for all comparisons", 2),
    ]
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
    return tabulate("Rank correlations", columns, notes)


def sobol_table(found: SobolIndices, level: float) -> Table:
    """Return the Sobol indices of every metric."""
    of = FieldColumns(found, "metrics", "inputs")

    def shares(stem: str, values: Array, interval: Array) -> list[FilledColumn]:
        rows = [of.spread(part, "inputs", "metrics") for part in (values, *interval)]
        return interval_columns(stem, stem, rows[0], rows[1:], 3)

    columns = [
        of("metrics", "metric"),
        of("inputs", "input"),
        *shares("first", found.first, found.first_interval),
        *shares("total", found.total, found.total_interval),
    ]
    notes = [
        f"From {len(found.inputs) + 2} samples of {found.samples} cases: share of the metric's "
        "variance that is due to the input alone (first), and with all that it does together with "
        "others (total). " + _INTERVALS.format(level=100 * level) + " Bootstrap."
    ]
    return tabulate("Sobol indices", columns, notes).first(MOST_ROWS)


def _swept_columns(table: CaseTable, points: slice) -> list[FilledColumn]:
    """Return columns of the swept numbers at some points."""
    assert table.points is not None
    taken = ("number", "point", "cases", "failures", "undecided", "ratio")
    keys = [f"{name}_swept" if name in taken else name for name in table.swept]
    return [
        column(key, values[points], key, 6, unit=unit, is_si=False)
        for key, unit, values in zip(keys, table.swept_units, table.points, strict=True)
        if unit
    ]


def point_table(table: CaseTable, level: float) -> Table:
    """Return the failure ratio at each point of a sweep."""
    assert table.points is not None
    count, some = table.points.shape[1], slice(MOST_ROWS)
    found = ratio_at_points(table, table.point, count, level)
    columns = [
        column("number", np.arange(count)[some], "number"),
        text_column("point", table.point_labels[some], "point"),
        *_swept_columns(table, some),
        column("cases", np.bincount(table.point, minlength=count)[some], "cases"),
        column("failures", found.failures[some], "failures"),
        *interval_columns(
            "ratio", "failure ratio", found.value[some], found.interval[:, some], 4, level=level
        ),
    ]
    if found.undecided.any():
        least, most = found.range[:, some]
        columns += [
            column("undecided", found.undecided[some], "undecided"),
            column("least", least, "ratio if none of these had failed", 4),
            column("most", most, "ratio if all of these had failed", 4),
        ]
    more = f"The first {MOST_ROWS} of {count} points. " if count > MOST_ROWS else ""
    notes = [
        more
        + _INTERVALS.format(level=100 * level)
        + " Ratios by Clopper and Pearson, over decided cases."
    ]
    return replace(tabulate("Failures over the sweep", columns, notes), total=count)


def point_statistics_table(table: CaseTable, levels: Sequence[float], level: float) -> Table:
    """Return the statistics of every metric at each point of a sweep."""
    assert table.points is not None
    count, metrics = table.points.shape[1], len(table.metrics)
    room = max(1, MOST_ROWS // max(1, metrics))
    labels: list[str] = []
    found: list[MetricStatistics] = []
    for label, here in zip(
        table.point_labels[:room],
        point_statistics(table, min(room, count), level=level, levels=levels),
        strict=True,
    ):
        labels += [label] * len(here[:MOST_ROWS])
        found += here[:MOST_ROWS]
    more = f"The first {room} of {count} points. " if count > room else ""
    notes = [
        more + "Over the cases that came to their end; each number in the unit of its row. "
        + _INTERVALS.format(level=100 * level) + first_rows(metrics, "metrics")
    ]  # fmt: skip
    columns = [text_column("point", labels, "point"), *_statistics_columns(found, levels, level)]
    return replace(tabulate("Statistics over the sweep", columns, notes), total=count * metrics)
