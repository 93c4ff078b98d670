"""Figures of a campaign: distributions, convergence, sensitivities."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.cases.case_classes import decided_failures, has_ended, is_undecided
from hillsphere.plugins.registry import KINDS
from hillsphere.presentation import (
    Axis,
    Band,
    Bars,
    Chart,
    Column,
    Curve,
    Mark,
    Note,
    Panel,
    Points,
    Rule,
    Segments,
)
from hillsphere.products import CaseTable
from hillsphere.show.charts import even_indices
from hillsphere.show.reference import without_unit
from hillsphere_campaigns.convergence import Convergence
from hillsphere_campaigns.explanatory import Explanatory
from hillsphere_campaigns.sensitivity import RankCorrelations, SobolIndices, independent_cases
from hillsphere_campaigns.statistics import MetricStatistics

__all__ = [
    "LINE_LENGTH",
    "MOST_STEPS",
    "Shown",
    "convergence_chart",
    "correlation_chart",
    "cumulative_chart",
    "format_name",
    "grid_chart",
    "histogram_bars",
    "histogram_chart",
    "input_words",
    "name_axis",
    "quantity_axis",
    "scatter_chart",
    "sobol_chart",
]

_MOST_DOTS = 2000
"""Dots of a scatter plot at most: more of them merge into an area and slow the drawing down."""

MOST_STEPS = 500
"""Points of a line at most: a panel is some 400 pixels wide."""

_MOST_STEPS_OF_TICKS = 3.5
"""Steps between ticks along a panel of a third of a page: more of numbers such as 0.00225 would
overlap."""

_MOST_BINS = 60
"""Bins of a histogram at most: with more a bar is narrower than five pixels."""

LINE_LENGTH = 24
"""Characters of a label beside others, such as the names of bars, and of a line along a vertical
axis, whose panel may be a third of a page high."""

_KEY = re.compile(r"(?<![\w.])[A-Za-z]\w*(?:\.\w[\w-]*)+")
"""A key of a mission or a name of a metric, whose parts have dots between them."""

_FENCE = 8.0
"""Interquartile ranges beyond the quartiles from which on values are not drawn but counted."""


@dataclass(frozen=True)
class Shown:
    """A metric that is drawn, over the cases that came to their end.

    Parameters
    ----------
    read : callable
        Returns its values (n,); they may be read from files each time.
    statistics : MetricStatistics
        Its statistics.
    row : int
        Its row in their table.
    """

    read: Callable[[], Array]
    statistics: MetricStatistics
    row: int

    @property
    def axis(self) -> Axis:
        """Its axis."""
        return quantity_axis(self.statistics.name, self.statistics.unit)


def format_name(name: str) -> str:
    """Return a name in words, a long one shortened.

    Of a key the kind of its table is left out: ``"gravity.phobos.C2,0"`` is ``phobos C2,0``, and
    ``"pass.average.error_max"`` is ``pass average error max``.
    """
    words = _KEY.sub(_key_in_words, name).replace("_", " ")
    words = re.sub(r"\bdv\b", "Δv", words)
    return words if len(words) <= 34 else f"{words[:12]}…{words[-21:]}"


def _key_in_words(key: re.Match[str]) -> str:
    parts = key[0].split(".")
    return " ".join(parts[1:] if len(parts) > 2 and parts[0] in KINDS else parts)


def quantity_axis(name: str, unit: str, label: str = "") -> Axis:
    """Return the axis of a quantity of this name and unit, with a label if there is a better."""
    label = label or format_name(without_unit(Column(name, unit)))
    return Axis(label, unit.replace("s2", "s²"))


def input_words(table: CaseTable) -> dict[str, str]:
    """Return a short label of every swept or dispersed quantity of a campaign by its name."""
    labels = table.swept_labels or ("",) * len(table.swept)
    labels = tuple(label if len(label) <= LINE_LENGTH else "" for label in labels)
    names = (*table.swept, *table.inputs)
    units = (*table.swept_units, *table.input_units)
    every = (*labels, *("" for _ in table.inputs))
    return {
        name: quantity_axis(name, unit, label).label
        for name, unit, label in zip(names, units, every, strict=True)
    }


def name_axis(names: Sequence[str]) -> Axis:
    """Return an axis of names, the first on top."""
    return Axis(ticks=list(enumerate(names)), low=-0.6, high=len(names) - 0.4, is_reversed=True)


def grid_chart(
    title: str, panels: Sequence[Panel], caption: str, table: str = "", *, is_map: bool = False
) -> Chart:
    """Return a chart of panels that show the same things, at most three side by side.

    The panels of maps share the axis at the left too.
    """
    return Chart(
        title, panels, caption, columns=min(len(panels), 3), share_y=is_map,
        shared_legend=True, table=table,
    )  # fmt: skip


def _within(values: Array) -> tuple[Array, list[Mark]]:
    """Return the values that are drawn, and a note on the number of outliers that are not."""
    low, high = np.quantile(values, [0.25, 0.75])
    reach = _FENCE * (high - low)
    kept = values if reach == 0.0 else values[(values >= low - reach) & (values <= high + reach)]
    away = values.size - kept.size
    return kept, [Note(f"{away} farther out")] if away else []


def histogram_bars(values: Array, label: str = "", row: int | None = None) -> Bars:
    """Return the bars of a histogram."""
    edges = np.histogram_bin_edges(values, bins="auto")
    if edges.size > _MOST_BINS + 1:
        edges = np.linspace(edges[0], edges[-1], _MOST_BINS + 1)
    count, _ = np.histogram(values, bins=edges)
    width = np.diff(edges)
    centres = edges[:-1] + 0.5 * width
    return Bars(centres, count, width=width, label=label, colour="sky", opacity=0.8, rows=row)


def histogram_chart(shown: Sequence[Shown], left: str) -> Chart:
    """Return a histogram of each metric with mean and quantiles; `left` says what is left out."""
    panels = []
    for one in shown:
        values, notes = _within(one.read())
        marks: list[Mark] = [
            histogram_bars(values, "cases", one.row),
            Rule("x", one.statistics.mean, "mean", "black", "solid", 1.4),
        ]
        marks += [
            Rule("x", value, "quantiles", "vermillion", "dashed", 1.1)
            for value in one.statistics.quantiles.tolist()
            if values.min() <= value <= values.max()
        ]
        panels.append(Panel(one.axis, Axis("cases"), [*marks, *notes]))
    return grid_chart(
        "Distributions of the metrics", panels, "Cases that came to their end." + left,
        "campaign_statistics",
    )  # fmt: skip


def cumulative_chart(shown: Sequence[Shown], level: float, left: str) -> Chart:
    """Return the empirical distribution function of each metric, and its quantiles' intervals."""
    panels = []
    for one in shown:
        values = one.read()
        n = values.size
        at = even_indices(n, MOST_STEPS)
        x, share = np.sort(values)[at], (at + 1.0) / n
        # Dvoretzky, Kiefer and Wolfowitz (1956), with Massart's constant (1990).
        reach = np.sqrt(np.log(2.0 / (1.0 - level)) / (2.0 * n))
        of = one.statistics
        low, high = np.clip(of.quantile_intervals, x[0], x[-1])
        kept, notes = _within(values)
        axis = one.axis
        if notes:
            margin = 0.05 * float(np.ptp(kept))
            axis = Axis(axis.label, axis.unit, low=kept.min() - margin, high=kept.max() + margin)
        marks: list[Mark] = [
            Band(x, np.maximum(share - reach, 0.0), np.minimum(share + reach, 1.0),
                 f"{100 * level:g} % band", steps=True),
            Curve(x, share, "cases", "blue", steps=True, rows=one.row),
            Segments(of.levels, low, high, "x", colour="vermillion", width=2.2, rows=one.row),
            Points(of.quantiles, of.levels, "quantiles, intervals", "vermillion", size=3.5,
                   rows=one.row),
        ]  # fmt: skip
        share_axis = Axis("share of cases below", low=-0.02, high=1.02)
        panels.append(Panel(axis, share_axis, [*marks, *notes]))
    return grid_chart(
        "Cumulative distributions of the metrics", panels,
        "Share of the cases that came to their end; the band holds the whole curve with this "
        "confidence." + left, "campaign_statistics",
    )  # fmt: skip


def convergence_chart(traces: Sequence[tuple[Axis, Convergence]], level: float) -> Chart:
    """Return the convergence of estimates and their intervals with the number of cases."""
    panels = []
    for axis, trace in traces:
        low, high = trace.interval
        marks: list[Mark] = [
            Band(trace.cases, low, high, f"{100 * level:g} % interval", opacity=0.4),
            Curve(trace.cases, trace.value, "estimate", "blue"),
            Rule("y", float(trace.value[-1]), "at the end", "black", width=0.8),
        ]
        # The first few cases say next to nothing; their intervals would fill the panel.
        late = trace.cases >= min(20, int(trace.cases[-1]))
        ends = np.concatenate([low[late], high[late], trace.value[late]])
        ends = ends[np.isfinite(ends)]
        if ends.size and np.ptp(ends) > 0:
            margin = 0.05 * float(np.ptp(ends))
            axis = Axis(axis.label, axis.unit, low=ends.min() - margin, high=ends.max() + margin)
        panels.append(Panel(Axis("cases", scale="log"), axis, marks))
    return grid_chart(
        "Convergence", panels,
        "Estimates from the first cases, in the order of their numbers; each interval by itself.",
    )  # fmt: skip


def scatter_chart(
    pairs: Sequence[tuple[int, int]],
    given: Explanatory,
    found: RankCorrelations,
    table: CaseTable,
    words: Mapping[str, str],
) -> Chart:
    """Return metrics and failures against the inputs with the strongest rank correlation.

    Shown are decided independent cases, of metrics those that came to their end.
    """
    rows = independent_cases(table) & ~is_undecided(table.status)
    failed, ended = decided_failures(table)[rows], has_ended(table)[rows]
    panels = []
    for row, (i, j) in enumerate(pairs):
        x = given.column(i)[rows]
        marks: list[Mark] = []
        if j >= len(table.metrics):
            y_axis = Axis("share of these cases below")
            for colour, which, label in (
                ("blue", ~failed, "not failed"), ("vermillion", failed, "failed"),
            ):  # fmt: skip
                at = even_indices(int(which.sum()), MOST_STEPS)
                marks.append(Curve(np.sort(x[which])[at], (at + 1.0) / which.sum(), label, colour,
                                   steps=True, rows=row))  # fmt: skip
        else:
            y_axis = quantity_axis(found.metrics[j], table.units[j])
            values = table.values[j][rows]
            cases = np.flatnonzero(ended & np.isfinite(values))
            cases = cases[even_indices(cases.size, _MOST_DOTS)]
            marks.append(Points(x[cases], values[cases], "", "blue", "dot", 4.0, rows=row))
        title = f"rank correlation {found.rho[i, j]:+.2f}"
        name, unit = given.names[i], given.units[i]
        x_axis = replace(quantity_axis(name, unit, words.get(name, "")), step=_tick_step(x))
        panels.append(Panel(x_axis, y_axis, marks, title))
    return grid_chart(
        "Metrics against the inputs that they go with", panels,
        f"The clearest rank correlations; at most {_MOST_DOTS} cases are drawn.",
        "campaign_correlations",
    )  # fmt: skip


def _tick_step(values: Array) -> float | None:
    """Return a step of 1, 2 or 5 times a power of ten that makes two to four ticks."""
    span = float(np.ptp(values))
    if not span:
        return None
    power = 10.0 ** np.floor(np.log10(span / _MOST_STEPS_OF_TICKS))
    return float(next(
        step for step in power * np.array([1.0, 2.0, 5.0, 10.0])
        if step * _MOST_STEPS_OF_TICKS >= span
    ))  # fmt: skip


def correlation_chart(
    pairs: Sequence[tuple[int, int]],
    found: RankCorrelations,
    level: float,
    total: int,
    words: Mapping[str, str],
) -> Chart:
    """Return the clearest rank correlations of so many as bars; `words` are labels of inputs."""
    i, j = np.transpose(pairs)
    rows, rho, chance = np.arange(i.size), found.rho[i, j], found.p_holm[i, j]
    marks: list[Mark] = [
        Bars(rows[which], rho[which], "x", label=label, colour=colour, rows=rows[which].tolist())
        for label, which, colour in (
            (f"by chance in less than {100 * (1 - level):.2g} %", chance < 1.0 - level, "blue"),
            ("may be chance", chance >= 1.0 - level, "sky"),
            ("not judged: cases share their draws", np.isnan(chance), "green"),
        )
        if which.any()
    ]
    low, high = found.interval[:, i, j]
    marks += [
        Segments(rows, low, high, "x", width=1.2, rows=rows.tolist()),
        Rule("x", 0.0, "", "black", "solid", 0.8),
    ]
    names = [
        f"{words.get(found.inputs[a]) or format_name(found.inputs[a])} → "
        f"{format_name(found.metrics[b])}"
        for a, b in pairs
    ]
    axis = Axis("rank correlation (line: its interval)", low=-1.05, high=1.05)
    return Chart(
        "Clearest rank correlations", [Panel(axis, name_axis(names), marks)],
        f"The {len(pairs)} clearest of {total}, judged with all in view (Holm).",
        shared_legend=True, size_in=(8.0, 1.6 + 0.26 * max(len(pairs), 3)),
        table="campaign_correlations",
    )  # fmt: skip


def sobol_chart(found: SobolIndices, metrics: Sequence[int], most: int, left: str) -> Chart:
    """Return first and total indices, the inputs with the largest total ones, by metric."""
    panels = []
    for j in metrics:
        order = np.argsort(-found.total[:, j], kind="stable")[:most]
        places = np.arange(order.size)
        rows = (j * len(found.inputs) + order).tolist()
        marks: list[Mark] = []
        for shift, colour, index, interval, label in (
            (-0.2, "blue", found.first, found.first_interval, "first: alone"),
            (0.2, "orange", found.total, found.total_interval, "total: with others"),
        ):
            at, (low, high) = places + shift, interval[:, order, j]
            marks += [
                Bars(at, index[order, j], "x", width=0.38, label=label, colour=colour, rows=rows),
                Segments(at, low, high, "x", width=1.0, rows=rows),
            ]
        least = float(np.nanmin([*found.first_interval[0, order, j], found.first[order, j].min()]))
        label = f"share of the variance of {format_name(found.metrics[j])}"
        names = [format_name(found.inputs[i]) for i in order]
        panels.append(Panel(Axis(label, low=min(0.0, least)), name_axis(names), marks))
    return grid_chart(
        "Sobol indices", panels,
        "The inputs with the largest total indices; lines: bootstrap intervals." + left,
        "campaign_sobol",
    )  # fmt: skip
