"""Report of a campaign: verdict, metrics, tables and figures of bounded size."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.matching import match_names
from hillsphere.cases.case_classes import (
    LEVEL,
    UNDECIDED,
    decided_failures,
    has_ended,
    is_undecided,
    ratio_at_points,
    ratio_of,
)
from hillsphere.presentation import Axis, Chart, Metric, Presentation, Table
from hillsphere.products import CaseTable
from hillsphere_campaigns.band_figures import band_chart
from hillsphere_campaigns.convergence import convergence_of_failures, convergence_of_mean
from hillsphere_campaigns.explanatory import explanatory
from hillsphere_campaigns.figures import (
    Shown,
    convergence_chart,
    correlation_chart,
    cumulative_chart,
    grid_chart,
    histogram_chart,
    input_words,
    quantity_axis,
    scatter_chart,
    sobol_chart,
)
from hillsphere_campaigns.headlines import failure_sentences, strongest_correlations, worst_points
from hillsphere_campaigns.result_tables import (
    class_table,
    correlation_table,
    extreme_table,
    failed_table,
    percentile,
    point_statistics_table,
    point_table,
    sobol_table,
    statistics_table,
    undecided_table,
)
from hillsphere_campaigns.sensitivity import (
    RankCorrelations,
    SobolIndices,
    independent_cases,
    rank_correlations,
    sobol_of,
)
from hillsphere_campaigns.statistics import MetricStatistics, metric_statistics
from hillsphere_campaigns.sweep_figures import PointValues, layout_points, sweep_panels

__all__ = ["present_campaign"]

_PANELS = 6
"""Panels of a figure; a campaign has a dozen figures at most, however many metrics it has."""

_BARS = 20
"""Bars of correlations at most: with more their labels overlap in a figure of one page."""

_INPUTS = 10
"""Inputs in a panel of Sobol indices at most: with more their names overlap."""

_METRICS = 20
"""Metrics of the campaign that enter the summary of the run at most; the tables hold all."""

_CAVEATS = {
    "latin_hypercube": "The cases of a Latin hypercube are more even than random ones: the "
    "intervals are mostly too wide.",
    "sobol": "The cases of a Sobol sequence are more even than random ones: the intervals are "
    "mostly too wide.",
    "sobol_indices": "Over the first of the design's samples, which is a Sobol sequence: the "
    "intervals are mostly too wide.",
    "grid": "The cases of a grid were not drawn: the intervals are those of as many random ones.",
    "list": "The cases of a list were not drawn: the intervals are those of as many random ones.",
}


def present_campaign(
    table: CaseTable,
    *,
    level: float = LEVEL,
    levels: Sequence[float] = (0.05, 0.5, 0.95),
    show: Sequence[str] = (),
) -> Presentation:
    """Show a campaign.

    Parameters
    ----------
    table : CaseTable
        The cases.
    level : float
        Confidence level of all intervals.
    levels : sequence of float
        Levels of the quantiles.
    show : sequence of str
        Names or patterns of the metrics that are shown, in this order; none for all.

    Returns
    -------
    Presentation
        Tables ``campaign_classes``, ``campaign_failed`` (if any did), ``campaign_undecided`` (if
        any is), ``campaign_extremes``,
        ``campaign_correlations`` and ``campaign_sobol`` (if the design allows it); for random cases
        ``campaign_statistics`` with figures of distributions and convergence; for the points of a
        sweep ``sweep_failures`` and ``sweep_statistics`` with figures over what was swept; figure
        ``campaign_bands`` of the quantiles over time.

    Raises
    ------
    InputError
        If a pattern finds no metric, though the campaign has some.
    """
    levels, table = tuple(levels), _with_metrics(table, show)
    sets = table.points is not None and table.points.shape[1] > 1
    repeated = sets and table.case.size > np.unique(table.point).size
    figures: dict[str, Chart] = {}
    # Of other cases than independent ones a ratio has no interval.
    drawn = not repeated and table.design in ("random", "latin_hypercube", "sobol")
    tables: dict[str, Table] = {"campaign_classes": class_table(table, level, drawn)}
    metrics = _counts(table, level, drawn)
    verdict = failure_sentences(table, level, drawn)
    if decided_failures(table).any():
        tables["campaign_failed"] = failed_table(table)
    if is_undecided(table.status).any():
        tables["campaign_undecided"] = undecided_table(table)
    if not repeated:
        usable = independent_cases(table)
        found = metric_statistics(table, usable, level=level, levels=levels)
        caveat = _CAVEATS.get(table.design, "")
        tables["campaign_statistics"] = statistics_table(found, levels, level, caveat)
        metrics |= _metric_values(found, level)
        if table.design != "list":  # worst cases, say: they were chosen, not drawn
            figures |= _distributions(table, found, level)
    if sets:
        tables["sweep_failures"] = point_table(table, level)
        tables["sweep_statistics"] = point_statistics_table(table, levels, level)
        figures |= _over_points(table, level, repeated)
        verdict += worst_points(table, level) if repeated else []
    if table.bands is not None:
        figures["campaign_bands"] = band_chart(table.bands)
    tables["campaign_extremes"] = extreme_table(table)
    correlations = rank_correlations(table, level)
    if correlations.strongest() and table.design != "list":  # of chosen cases ρ says nothing
        tables["campaign_correlations"] = correlation_table(correlations, level)
        figures |= _sensitivities(table, correlations, level)
        verdict += strongest_correlations(correlations, level, input_words(table))
    if table.design == "sobol_indices":
        indices = sobol_of(table, level=level)
        if isinstance(indices, str):
            verdict.append(f"{indices}.")
        else:
            tables["campaign_sobol"] = sobol_table(indices, level)
            figures |= _sobol(indices)
    return Presentation(metrics=metrics, tables=tables, figures=figures, verdict=verdict)


def _with_metrics(table: CaseTable, show: Sequence[str]) -> CaseTable:
    """Return the campaign with the metrics that are shown."""
    if not show or not table.metrics:
        return table
    names = match_names(show, table.metrics, f"show: stage {table.stage!r}", "metric")
    rows = [table.metrics.index(name) for name in names]
    return replace(
        table, metrics=names, units=tuple(table.units[i] for i in rows), values=table.values[rows]
    )


def _counts(table: CaseTable, level: float, drawn: bool) -> dict[str, Metric]:
    found, total = ratio_of(table, level), table.case.size
    computation = [word for word, reason in UNDECIDED.items() if reason == "computation"]
    lost = int(np.count_nonzero(np.isin(table.status, computation)))
    made = {
        "campaign_cases": Metric(total),
        "campaign_failures": Metric(int(found.failures)),
        "campaign_undecided": Metric(int(found.undecided)),
        "campaign_not_computed": Metric(lost),
        "campaign_failure_ratio": Metric(float(found.value)),
    }
    if drawn:
        low, high = map(float, found.interval)
        ratio = Metric(float(found.value), interval=(low, high), confidence=level)
        made["campaign_failure_ratio"] = ratio
        made["campaign_failure_ratio_low"] = Metric(float(found.interval[0]))
        made["campaign_failure_ratio_high"] = Metric(float(found.interval[1]))
    if found.undecided:
        made["campaign_failure_ratio_least"] = Metric(float(found.range[0]))
        made["campaign_failure_ratio_most"] = Metric(float(found.range[1]))
    return made


def _metric_values(found: Sequence[MetricStatistics], level: float) -> dict[str, Metric]:
    made: dict[str, Metric] = {}
    for one in found[:_METRICS]:
        stem = "campaign_" + re.sub(r"[^a-z0-9]+", "_", one.name.lower()).strip("_")[:60]
        while f"{stem}_mean" in made:
            stem += "_"
        unit = one.unit or "-"
        low, high = map(float, one.mean_interval)
        made[f"{stem}_mean"] = Metric(one.mean, unit, (low, high), level)
        if one.levels:
            i = one.levels.index(max(one.levels))
            low, high = map(float, one.quantile_intervals[:, i])
            made[f"{stem}_{percentile(one.levels[i])}"] = Metric(
                float(one.quantiles[i]), unit, (low, high), level
            )
    return made


def _distributions(
    table: CaseTable, found: Sequence[MetricStatistics], level: float
) -> dict[str, Chart]:
    usable = independent_cases(table) & has_ended(table)

    def read(row: int) -> Array:
        values = np.asarray(table.values[row])
        kept: Array = values[usable & np.isfinite(values)]
        return kept

    varied = [
        Shown(partial(read, row), one, row)
        for row, one in enumerate(found)
        if one.count > 1 and one.least < one.largest
    ]
    shown = varied[:_PANELS]
    left = f" The first {_PANELS} of {len(varied)} metrics." if len(varied) > _PANELS else ""
    made: dict[str, Chart] = {}
    if shown:
        made["campaign_histograms"] = histogram_chart(shown, left)
        made["campaign_distributions"] = cumulative_chart(shown, level, left)
    rows = independent_cases(table)
    if table.case.size > 1 and rows.any():
        failed = decided_failures(table)[rows]
        undecided = is_undecided(table.status)[rows]
        failures = convergence_of_failures(failed, undecided, level=level)
        traces = [(Axis("failure ratio"), failures)]
        for one in varied[: _PANELS - 1]:
            values = np.asarray(table.values[one.row])
            kept = (usable & np.isfinite(values))[rows]
            axis = replace(one.axis, label=f"mean {one.axis.label}")
            traces.append((axis, convergence_of_mean(values[rows], kept, level=level)))
        made["campaign_convergence"] = convergence_chart(traces, level)
    return made


def _over_points(table: CaseTable, level: float, repeated: bool) -> dict[str, Chart]:
    assert table.points is not None
    layout, count = layout_points(table), table.points.shape[1]
    if not layout.axes and count > table.case.size // 2 and len(table.swept) > 2:
        return {}  # scattered points, one case each: the scatter plots show them
    left = "" if (layout.places[0] >= 0).all() else f" The first {len(layout.ticks[0])} points."
    made: dict[str, Chart] = {}
    if repeated:
        found = ratio_at_points(table, table.point, count, level)
        low, high = found.sure
        of_failures = [PointValues(Axis("failure ratio"), found.value, low, high)]
        if layout.is_map:
            of_failures.append(PointValues(Axis("failure ratio, at most"), high))
        interval = f"{100 * level:g} % interval"
        made["sweep_failures"] = grid_chart(
            "Failures over the sweep",
            sweep_panels(layout, of_failures, interval, "failure ratio"),
            "Over decided cases. Clopper–Pearson intervals, each by itself, from where none of the "
            "undecided cases had failed to where all had." + left,
            "sweep_failures",
            is_map=layout.is_map,
        )
    medians = _medians(table, count, repeated)
    if medians:
        what = "Value"
        if repeated:
            what = "Median" if layout.is_map else "Median, 5 % and 95 %"
        made["sweep_metrics"] = grid_chart(
            "Metrics over the sweep",
            sweep_panels(
                layout, medians, "5 % to 95 % of the cases", "median" if repeated else "value"
            ),
            f"{what} over the cases that came to their end.{left}",
            "sweep_failures",
            is_map=layout.is_map,
        )
    return made


def _medians(table: CaseTable, count: int, repeated: bool) -> list[PointValues]:
    """Return median, 5 % and 95 % of the first metrics at every point."""
    order = np.argsort(table.point, kind="stable")
    parts = np.split(order, np.searchsorted(table.point[order], np.arange(1, count)))
    made, sound = [], has_ended(table)
    for name, unit, values in zip(table.metrics, table.units, table.values, strict=True):
        ends = np.full((3, count), np.nan)
        for p, rows in enumerate(parts):
            kept = values[rows][sound[rows] & np.isfinite(values[rows])]
            if kept.size:
                ends[:, p] = np.quantile(kept, [0.05, 0.5, 0.95])
        known = ends[1][np.isfinite(ends[1])]
        if known.size > 1 and np.nanmin(ends) < np.nanmax(ends):
            beside = (ends[0], ends[2]) if repeated else ()
            made.append(PointValues(quantity_axis(name, unit), ends[1], *beside))
        if len(made) == _PANELS:
            break
    return made


def _sensitivities(table: CaseTable, found: RankCorrelations, level: float) -> dict[str, Chart]:
    pairs, words = found.strongest(), input_words(table)
    return {
        "campaign_correlations": correlation_chart(pairs[:_BARS], found, level, len(pairs), words),
        "campaign_scatter": scatter_chart(pairs[:_PANELS], explanatory(table), found, table, words),
    }


def _sobol(found: SobolIndices) -> dict[str, Chart]:
    known = [j for j in range(len(found.metrics)) if np.isfinite(found.total[:, j]).all()]
    left = f" The first {_PANELS} of {len(known)} metrics." if len(known) > _PANELS else ""
    if not known:
        return {}
    return {"campaign_sobol": sobol_chart(found, known[:_PANELS], _INPUTS, left)}
