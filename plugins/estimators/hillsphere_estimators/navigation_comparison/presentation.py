"""Tables, figures and verdict of the stage ``navigation_comparison``."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Curve,
    Dash,
    Mark,
    Metric,
    Panel,
    Points,
    Presentation,
    Rule,
    Segments,
    Span,
    Table,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.figures import hours_or_days, nees_axis
from hillsphere_estimators.navigation.presentation import judge_consistency
from hillsphere_estimators.navigation_comparison.products import NavigationComparison
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec

__all__ = ["present_comparison"]

_PUBLISHED = ("draw_m", "draw_mm_s")
_OVER_SETS = ("sets", "points", "spacecraft")
_LEAST, _MOST = 0.85, 1.2
"""Range of an rms error over its bound for a filter that is as good as possible. The statistical
error of 64 to 200 flights is 0.03 to 0.05, so that a ratio below 0.85 means a wrong bound."""
_DASHES: tuple[Dash, ...] = ("solid", "dotted", "dashdot")
"""Kinds of lines, one after the other once all colours are taken; dashed ones have a meaning."""


def present_comparison(
    product: NavigationComparison, spec: NavigationComparisonSpec
) -> Presentation:
    """Show sets of sensors side by side.

    Parameters
    ----------
    product : NavigationComparison
        Product of the stage.
    spec : NavigationComparisonSpec
        Label, confidence and requirement.

    Returns
    -------
    Presentation
        Tables ``navigation_comparison`` and ``navigation_ratios``; figures
        ``navigation_comparison`` (a campaign), ``navigation_courses`` and
        ``navigation_consistency`` (flights).
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    tables: dict[str, Table] = {}
    figures: dict[str, Chart] = {}
    metrics: dict[str, Metric] = {}
    verdict: list[str] = []
    if product.cases.size:
        published = bool(np.isfinite(product.paper_position_m).any())
        notes = ["Errors are lengths of vectors, over the flights that were not lost.",
                 "The bound is the root mean square of the posterior Cramér-Rao bounds of the "
                 "flights, each along its planned path.",
                 "It does not account for measurements that a gate rejects."]  # fmt: skip
        if published:
            notes.append("A published draw is the error of one flight, not a median; the paper "
                         "does not state its interval between measurements.")  # fmt: skip
        tables[named("navigation_comparison")] = tabulate(
            "Errors at the end of the flights", _set_columns(product, published), notes
        )
        figures[named("navigation_comparison")] = _set_chart(
            product, spec.required_position_m, named("navigation_comparison")
        )
        inside = _consistent(product)
        verdict += _criteria(product, inside)
        metrics[named("navigation_consistent_share")] = Metric(float(np.mean(inside)))
    if product.ratio.size:
        tables[named("navigation_ratios")] = tabulate(
            "Errors of each set over those of the one before",
            _ratio_columns(product, spec.confidence),
            [f"Ratio of rms position errors on the same draws, {100 * spec.confidence:g} % "
             "interval of a paired bootstrap; none where a flight was lost."],
        )  # fmt: skip
    if product.lightest:
        metrics[named("navigation_lightest")] = Metric(product.lightest)
        verdict.append(
            f"Lightest set of sensors with rms position errors of at most "
            f"{spec.required_position_m:g} m and no lost flight: {product.lightest}."
        )
    if product.time_s.size:
        tables[named("navigation_flights")] = tabulate(
            "Flights of the stages", _flight_columns(product)
        )
        figures[named("navigation_courses")] = _history_chart(product, named("navigation_flights"))
        figures[named("navigation_consistency")] = _nees_chart(product)
    return Presentation(metrics=metrics, tables=tables, figures=figures, verdict=verdict)


def _consistent(product: NavigationComparison) -> np.ndarray:
    """Return where the mean NEES is in its band and no flight was lost, (C, P)."""
    return np.asarray(
        (product.nees >= product.nees_low) & (product.nees <= product.nees_high)
        & (product.lost == 0)
    )  # fmt: skip


def _criteria(product: NavigationComparison, inside: np.ndarray) -> list[str]:
    """Return the sentences on bounds, bands and losses."""
    ratio, error = product.bound_ratio.reshape(2, -1)
    good = (ratio >= _LEAST) & (ratio <= _MOST)
    near = np.abs(ratio - np.clip(ratio, _LEAST, _MOST)) <= 2.0 * error
    said = [
        f"Rms position errors are {np.nanmin(ratio):.3g} to {np.nanmax(ratio):.3g} times their "
        f"Cramér-Rao bound; {int(good.sum())} of {ratio.size} lie within {_LEAST:g} to {_MOST:g}"
        + (f", {int((near & ~good).sum())} more within two standard errors of it."
           if (near & ~good).any() else "."),
        f"In {int(inside.sum())} of {inside.size} sets and points the mean NEES lies in its 99.9 % "
        "band and no flight is lost.",
    ] if np.isfinite(ratio).any() else []  # fmt: skip
    if product.lost.any():
        worst = ", ".join(
            f"{label} {int(gone.sum())} of {int(every.sum())}"
            for label, gone, every in zip(product.labels, product.lost, product.cases, strict=True)
            if gone.any()
        )
        said.append(f"Flights were lost: {worst}. Statistics over the survivors prove nothing.")
    return said


def _flight_columns(product: NavigationComparison) -> list[FilledColumn]:
    """Return the columns of the single stages, one row per stage and spacecraft."""
    of = FieldColumns(product, "sets", "spacecraft")
    runs, lost = product.flight_runs.astype(int), product.flight_lost.astype(int)
    states = product.flight_states.astype(int)
    last = [mean[np.isfinite(t)][-1:] for mean, t in zip(product.mean_nees, product.time_s,
                                                         strict=True)]  # fmt: skip
    means = np.array([float(one[0]) if one.size else np.nan for one in last])
    answers = [judge_consistency(*one)[0]
               for one in zip(means.tolist(), states.tolist(), runs.tolist(), lost.tolist(),
                              strict=True)]  # fmt: skip
    return [
        of("labels", "set", "flights"),
        of("spacecraft"),
        column("count", of.spread(runs, "sets"), "number"),
        column("lost", of.spread(lost, "sets"), "lost"),
        of("flight_rms_m", "rms_m"),
        column("nees", of.spread(means, "sets"), "mean NEES", 4),
        text_column("answer", of.spread(tuple(answers), "sets"), "the filter is"),
    ]


def _set_columns(product: NavigationComparison, published: bool) -> list[FilledColumn]:
    """Return the columns of the campaign, one row per set, point and spacecraft.

    The published errors of single flights stand beside ours if there are any.
    """
    of = FieldColumns(product, "sets", "points", "spacecraft")
    low, median, high = (of.spread(q, *_OVER_SETS) for q in product.position_m)
    ratio, error = (of.spread(one, *_OVER_SETS) for one in product.bound_ratio)
    inside = np.where(_consistent(product), "yes", "no")
    paper = [np.where(np.isfinite(one), one, np.nan)
             for one in (product.paper_position_m, product.paper_velocity_m_s)]  # fmt: skip
    position, velocity = (of.spread(one, "sets", "spacecraft") for one in paper)
    columns = [
        of("labels", "set"),
        of("points", "point"),
        of("spacecraft"),
        column("cases", of.spread(product.cases.astype(int), "sets", "points"), "flights"),
        column("lost", of.spread(product.lost.astype(int), "sets", "points"), "lost"),
        column("median_m", median, "median error", 4),
        column("low_m", low, "5 %", 4),
        column("high_m", high, "95 %", 4),
        column("draw_m", position, "published draw", 5),
        of("velocity_m_s", "velocity_mm_s"),
        column("draw_mm_s", velocity, "published draw", 5),
        of("rms_m"),
        of("bound_m"),
        column("ratio", ratio, "rms over bound", 4),
        column("ratio_se", error, "its standard error", 2),
        of("nees"),
        text_column("consistent", of.spread(inside, "sets", "points"), "within the band"),
    ]
    return [one for one in columns if published or one.name not in _PUBLISHED]


def _ratio_columns(product: NavigationComparison, confidence: float) -> list[FilledColumn]:
    """Return the columns of the ratios of neighbouring sets, one row per pair and point."""
    of = FieldColumns(product, "neighbours", "points")
    low, value, high = (of.spread(part, "neighbours", "points") for part in product.ratio)
    return [
        text_column("set", of.spread(product.labels[1:], "neighbours"), "set"),
        text_column("against", of.spread(product.labels[:-1], "neighbours"), "against"),
        of("points", "point"),
        column("ratio", value, "ratio of rms", 4, interval=("ratio_low", "ratio_high"),
               confidence=confidence),
        column("ratio_low", low, "at least", 4),
        column("ratio_high", high, "at most", 4),
    ]  # fmt: skip


def _set_chart(
    product: NavigationComparison, required_m: float | None, table: str
) -> Chart:  # fmt: skip
    """Return the errors at the end of each set and point, a panel per spacecraft."""
    sets, points, crafts = len(product.labels), len(product.points), len(product.spacecraft)
    published = bool(np.isfinite(product.paper_position_m).any())
    panels = []
    for s, craft in enumerate(product.spacecraft):
        marks: list[Mark] = []
        for p, point in enumerate(product.points):
            place = np.arange(sets) + 0.7 * ((p + 0.5) / points - 0.5)
            rows = ((np.arange(sets) * points + p) * crafts + s).tolist()
            low, median, high = product.position_m[:, :, p, s]
            colour = LINE_COLOURS[p % len(LINE_COLOURS)]
            name = _format_point(point) or "median"
            marks += [
                Segments(place, low, high, "x", "", colour, has_caps=True, rows=rows),
                Points(median, place, name, colour, rows=rows),
                Points(product.bound_m[:, p, s], place, "", colour, "bar", 14.0, rows=rows),
                Points(product.rms_m[:, p, s], place, "", colour, "square", is_filled=False,
                       rows=rows),
            ]  # fmt: skip
        paper = product.paper_position_m[:, s]
        if np.isfinite(paper).any():
            marks.append(Points(paper, np.arange(sets), "published", "black", "cross", 8.0))
        if required_m is not None:
            marks.append(Rule("x", required_m, "rms allowed", "black", "dashed"))
        names = Axis(ticks=list(enumerate(product.labels)), is_reversed=True)
        panels.append(Panel(Axis("position error", "m", "log"), names, marks, craft))
    return Chart(
        "Position errors at the end", panels,
        "Dots: median and 5 to 95 %; squares: rms; bars: its Cramér-Rao bound"
        + ("; crosses: published." if published else "."),
        columns=crafts, share_y=True, shared_legend=True,
        size_in=(8.0, max(4.2, 1.5 + 0.3 * sets)), table=table,
    )  # fmt: skip


def _format_point(point: str) -> str:
    """Return the name of a point for a legend: 10 min instead of 10min."""
    return re.sub(
        r"\b(\d+)(?:p(\d+))?(h|min|s)\b",
        lambda m: f"{m[1]}{'.' + m[2] if m[2] else ''} {m[3]}",
        point,
    )


def _history_chart(product: NavigationComparison, table: str) -> Chart:
    """Return the errors over time, a panel per spacecraft; `table` lists sets and spacecraft."""
    panels, crafts = [], len(product.spacecraft)
    for s, craft in enumerate(product.spacecraft):
        marks, axis = [], Axis("time", "h")
        for c, name in enumerate(product.labels):
            there = np.isfinite(product.time_s[c])
            time, axis = hours_or_days(product.time_s[c, there])
            style = _style(c) | {"rows": c * crafts + s}
            marks.append(Curve(time, product.error_m[c, s, there], name, **style))
            style |= {"dash": "dashed", "width": 1.0}
            marks.append(Curve(time, 3.0 * product.sigma_m[c, s, there], "", **style))
        panels.append(Panel(axis, Axis("position error", "m", "log"), marks, craft))
    return Chart(
        "Errors of the estimated positions", panels,
        "The first flight of each; dashed: three standard deviations by its filter.",
        share_x=True, shared_legend=True, size_in=(8.0, 2.6 + 2.2 * crafts), table=table,
    )  # fmt: skip


def _nees_chart(product: NavigationComparison) -> Chart:
    """Return the mean normalised errors squared with their band."""
    flown = np.maximum(product.flight_runs - product.flight_lost, 1.0)
    band = np.array(chi_square_band(product.flight_states, flown))
    high = float(band[1].max())
    # one band if all stages have as many flights, else the widest, that of the fewest
    label = "99.9 % band" + ("" if np.ptp(flown) == 0 else ", fewest flights")
    marks: list[Mark] = [Span("y", float(band[0].min()), high, label, "body")]
    axis = Axis("time", "h")
    for c, name in enumerate(product.labels):
        there = np.isfinite(product.time_s[c])
        time, axis = hours_or_days(product.time_s[c, there])
        marks.append(Curve(time, product.mean_nees[c, there], name, **_style(c)))
    label = f"mean NEES of {int(product.flight_states[0])} states"
    return Chart(
        "Normalised errors squared",
        [Panel(axis, nees_axis(label, product.mean_nees, high), marks)],
        "Mean over the flights of each stage; grey: 99.9 % band of this mean for a consistent "
        "filter.",
        shared_legend=True,
    )


def _style(number: int) -> dict[str, Any]:
    """Return the style of a set: a colour, and another kind of line once all are taken."""
    lap, colour = divmod(number, len(LINE_COLOURS))
    return {"colour": LINE_COLOURS[colour], "dash": _DASHES[lap % len(_DASHES)]}
