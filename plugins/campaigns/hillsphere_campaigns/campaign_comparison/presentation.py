"""What a comparison of campaigns shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hillsphere.base.matching import match_names
from hillsphere.presentation import (
    Axis,
    Cell,
    Chart,
    Mark,
    Metric,
    Panel,
    Points,
    Presentation,
    Rule,
    Segments,
)
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    tabulate,
    text_column,
)
from hillsphere_campaigns.campaign_comparison.products import CampaignComparison, PairedMetrics
from hillsphere_campaigns.figures import (
    format_name,
    grid_chart,
    histogram_bars,
    name_axis,
    quantity_axis,
)
from hillsphere_campaigns.result_tables import (
    MOST_ROWS,
    gather,
    gather_intervals,
    interval_columns,
)

__all__ = ["present_comparison", "select_shown"]

_PANELS = 6
"""Panels of the figure of differences: two rows of three fill a page."""

_SENTENCES = 6
"""Comparisons told in the verdict at most; the tables hold all."""

_BARS = 40
"""Intervals of failure ratios drawn at most: with more their labels overlap on a page."""


def present_comparison(product: CampaignComparison, show: Sequence[str] = ()) -> Presentation:
    """Show how campaigns differ from the first one.

    Parameters
    ----------
    product : CampaignComparison
        What is shown.
    show : sequence of str
        Names or patterns of the metrics that are shown; none for all.

    Returns
    -------
    Presentation
        Tables ``comparison_failures`` and ``comparison_metrics``, figures of the same names.

    Raises
    ------
    InputError
        If a pattern finds no metric, though there are some.
    """
    metrics = select_shown(product.metrics, show)
    level = f"{100 * product.level:g} %"
    note = (
        f"Differences are those of a campaign less {product.baseline!r}, on the same draws; ends "
        f"are those of {level} confidence intervals, each row by itself."
    )
    tables = {
        "comparison_failures": tabulate(
            f"Failures compared with {product.baseline}",
            _failure_columns(product),
            [note + " Interval of the difference by Tango (1998).", *_undecided_notes(product)],
        ).first(MOST_ROWS),
        "comparison_metrics": tabulate(
            f"Metrics compared with {product.baseline}",
            _metric_columns(metrics),
            [
                note,
                "Over pairs that both came to their end; each number in the unit of its row.",
            ],
        ).first(MOST_ROWS, "rows"),
    }
    figures = {"comparison_failures": _failure_chart(product)}
    shown = [
        (row, one)
        for row, one in enumerate(metrics)
        if one.pairs > 1 and np.ptp(one.differences) > 0.0
    ]
    if shown:
        figures["comparison_metrics"] = _difference_chart(shown, product.baseline, level)
    return Presentation(
        metrics={"comparison_pairs": Metric(int(product.pairs.sum()))},
        tables=tables,
        figures=figures,
        verdict=_verdict(product, tables["comparison_failures"].rows, metrics),
    )


def select_shown(metrics: Sequence[PairedMetrics], show: Sequence[str]) -> Sequence[PairedMetrics]:
    """Return the metrics that are shown, see `present_comparison`."""
    if not show or not metrics:
        return metrics
    names = match_names(show, list(dict.fromkeys(one.metric for one in metrics)), "show: what is "
                    "compared", "metric")  # fmt: skip
    return [one for one in metrics if one.metric in names]


def _failure_columns(product: CampaignComparison) -> list[FilledColumn]:
    of, both = FieldColumns(product, "rows"), product.both_failed
    return [
        of("campaign"),
        of("point"),
        of("pairs"),
        of("unpaired"),
        of("undecided"),
        column("baseline_failures", both + product.only_baseline_failed, "first failed"),
        column("failures", both + product.only_other_failed, "this failed"),
        of("only_baseline_failed", "only_baseline"),
        of("only_other_failed", "only_this"),
        *interval_columns(
            "difference", "difference of the failure ratios", product.difference,
            product.difference_interval, 4, "",
        ),
        of("mcnemar_p", "p"),
    ]  # fmt: skip


def _metric_columns(shown: Sequence[PairedMetrics]) -> list[FilledColumn]:
    campaign, point, metric, unit, pairs, baseline, mean, less, more, p = gather(
        shown,
        "campaign",
        "point",
        "metric",
        "unit",
        "pairs",
        "baseline_mean",
        "mean",
        "less",
        "more",
        "p",
    )
    count = np.where(np.array(pairs) > 0, pairs, np.nan)  # no pair has no share
    return [
        text_column("campaign", campaign, "campaign"),
        text_column("point", point, "point"),
        text_column("metric", metric, "metric"),
        text_column("unit", unit, "unit"),
        column("pairs", pairs, "pairs that came to their end"),
        column("baseline_mean", baseline, "mean of the first", 5),
        *interval_columns(
            "difference", "mean difference", mean, gather_intervals(shown, "mean_interval"), 5, ""
        ),
        *interval_columns(
            "less", "share of pairs where less", less / count,
            gather_intervals(shown, "less_interval"), 4, "",
        ),
        *interval_columns(
            "more", "share of pairs where more", more / count,
            gather_intervals(shown, "more_interval"), 4, "",
        ),
        column("p", p, "p (Wilcoxon)", 2),
    ]  # fmt: skip


def _verdict(
    product: CampaignComparison,
    failures: Sequence[Mapping[str, Cell]],
    metrics: Sequence[PairedMetrics],
) -> list[str]:
    sentences: list[str] = []
    ends = 100.0 * np.array([product.difference, *product.difference_interval]).T
    for r, (row, (middle, low, high)) in enumerate(zip(failures[:_SENTENCES], ends, strict=False)):
        at = f" at {row['point']}" if row["point"] else ""
        sentences.append(
            f"{row['campaign']} against {product.baseline}{at}: {row['failures']} failures instead "
            f"of {row['baseline_failures']} in {row['pairs']} pairs, failure ratio {middle:+.3g} "
            f"percentage points ({low:+.3g} to {high:+.3g}, {100 * product.level:g} % interval; "
            f"p = {row['p']:.2g}, exact)." + _undecided_pairs(product, r)
        )
    room = _SENTENCES if len(product.campaign) == 1 else 0
    for one in metrics[:room]:
        if one.pairs > 1 and not one.less and not one.more:
            sentences.append(f"{one.metric}: the same in all {one.pairs} pairs.")
        elif one.pairs > 1:
            low, high = one.mean_interval
            unit = f" {one.unit}" if one.unit not in ("", "-") else ""
            sentences.append(
                f"{one.metric}: {one.mean:+.4g}{unit} on average ({low:+.4g} to {high:+.4g}), less "
                f"in {100 * one.less / one.pairs:.3g} % and more in "
                f"{100 * one.more / one.pairs:.3g} % of {one.pairs} pairs."
            )
    return sentences


def _undecided_notes(product: CampaignComparison) -> list[str]:
    if not product.undecided.any():
        return []
    return ["Pairs with an undecided case are left out; the figure and p are of the others."]


def _undecided_pairs(product: CampaignComparison, r: int) -> str:
    """Say how many pairs a row leaves out, and whether they could turn it; ``""`` for none."""
    count = int(product.undecided[r])
    if not count:
        return ""
    low, high = 100.0 * product.sure_interval[:, r]
    of_decided = product.difference_interval[:, r]
    differs = of_decided[0] > 0.0 or of_decided[1] < 0.0
    turns = differs and low <= 0.0 <= high
    return (
        f" {count} pair{'' if count == 1 else 's'} with an undecided case left out: with them "
        f"{low:+.3g} to {high:+.3g}"
        + (", which leaves the difference undecided." if turns else ".")
    )


def _failure_chart(product: CampaignComparison) -> Chart:
    """Return the differences of the failure ratios with their intervals."""
    total, level = len(product.campaign), f"{100 * product.level:g} %"
    rows = range(min(total, _BARS))
    low, high = 100.0 * product.difference_interval[:, rows]
    marks: list[Mark] = [
        Segments(rows, low, high, "x", f"{level} interval", "blue", 2.0, rows=rows),
        Points(100.0 * product.difference[rows], rows, "difference", "blue", rows=rows),
        Rule("x", 0.0, "", "black", "solid", 0.8),
    ]
    names = [
        format_name(f"{campaign}, {point}" if point else campaign)
        for campaign, point in zip(product.campaign, product.point, strict=True)
    ]
    label = f"failure ratio less that of {format_name(product.baseline)}"
    return Chart(
        "Difference of the failure ratios",
        [Panel(Axis(label, "percentage points"), name_axis([names[row] for row in rows]), marks)],
        f"Against {product.baseline}, with {level} intervals."
        + (f" The first {len(rows)} of {total}." if len(rows) < total else ""),
        shared_legend=True, size_in=(8.0, 1.5 + 0.3 * max(len(rows), 3)),
        table="comparison_failures",
    )  # fmt: skip


def _difference_chart(
    shown: Sequence[tuple[int, PairedMetrics]], baseline: str, level: str
) -> Chart:
    """Return histograms of the differences of metrics, each with its row in the table."""
    panels = []
    for row, one in shown[:_PANELS]:
        bars = histogram_bars(one.differences, "pairs", row)
        top = 1.06 * float(np.max(bars.values))
        low, high = one.mean_interval
        marks: list[Mark] = [
            bars,
            Rule("x", 0.0, "", "black", "solid", 0.8),
            Segments([top], [low], [high], "x", colour="vermillion", width=3.0),
            Points([one.mean], [top], "mean", "vermillion"),
        ]  # fmt: skip
        axis = quantity_axis(one.metric, one.unit)
        axis = replace(axis, label=f"difference of {axis.label}")
        title = format_name(f"{one.campaign}{f', {one.point}' if one.point else ''}")
        panels.append(Panel(axis, Axis("pairs"), marks, title))
    left = f" The first {_PANELS} of {len(shown)}." if len(shown) > _PANELS else ""
    return grid_chart(
        "Differences of the metrics, case by case", panels,
        f"Each pair's difference to {baseline}; the bar at the top is the {level} interval of the "
        "mean." + left, "comparison_metrics",
    )  # fmt: skip
