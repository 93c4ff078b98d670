"""Tables, figures and verdict of the stage ``navigation_comparison``."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.presentation import PALETTE, Figure, Metric, Presentation, Table
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.figures import COLOURS, hours_or_days
from hillsphere_estimators.navigation.presentation import judge_consistency
from hillsphere_estimators.navigation_comparison.products import NavigationComparison
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["present_comparison"]

_PUBLISHED = ("draw_m", "draw_mm_s")
_OVER_SETS = ("sets", "points", "spacecraft")
_LEAST, _MOST = 0.85, 1.2
"""Range of an rms error over its bound for a filter that is as good as possible. The statistical
error of 64 to 200 flights is 0.03 to 0.05, so that a ratio below 0.85 means a wrong bound."""
_MARKS = "osD^v"
_INSIDE = 6
"""Entries of a legend that fits inside the axes without covering curves."""


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
        Tables ``navigation_comparison`` and ``navigation_order``; figures
        ``navigation_comparison`` (a campaign), ``navigation_courses`` and
        ``navigation_consistency`` (flights).
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    tables: dict[str, Table] = {}
    figures: dict[str, Figure] = {}
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
        figures[named("navigation_comparison")] = Figure(
            "Position errors at the end",
            lambda figure: _draw_sets(figure, product, spec.required_position_m),
            "Dots: median and 5 to 95 %; squares: rms; bars: its Cramér-Rao bound"
            + ("; crosses: published." if published else "."),
            (8.0, max(4.2, 1.5 + 0.3 * len(product.labels))),
        )
        inside = _consistent(product)
        verdict += _criteria(product, inside)
        metrics[named("navigation_consistent_share")] = Metric(float(np.mean(inside)))
    if product.answers:
        summary, sentence = _judge_order(product, spec.confidence)
        tables[named("navigation_order")] = tabulate(
            "Do the errors fall from set to set?", _order_columns(product),
            [f"Ratio of rms position errors on the same draws, {100 * spec.confidence:g} % "
             "interval of a paired bootstrap."],
        )  # fmt: skip
        metrics[named("navigation_order")] = Metric(summary)
        verdict.append(sentence)
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
        figures[named("navigation_courses")] = Figure(
            "Errors of the estimated positions",
            lambda figure: _draw_histories(figure, product),
            "The first flight of each; dashed: three standard deviations by its filter.",
            (8.0, 2.6 + 2.2 * len(product.spacecraft)),
        )
        figures[named("navigation_consistency")] = Figure(
            "Normalised errors squared",
            lambda figure: _draw_nees(figure, product),
            "Mean over the flights of each stage; grey: 99.9 % band of this mean for a consistent "
            "filter.",
        )
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


def _order_columns(product: NavigationComparison) -> list[FilledColumn]:
    """Return the columns of the comparison of neighbouring sets, one row per pair and point."""
    of = FieldColumns(product, "neighbours", "points")
    claims = tuple(f"{later} than {before}" for before, later in pairwise(product.labels))
    low, value, high = (of.spread(part, "neighbours", "points") for part in product.ratio)
    return [
        text_column("claim", of.spread(claims, "neighbours"), "less error"),
        of("points", "point"),
        column("ratio", value, "ratio of rms", 4),
        column("low", low, "lower limit", 4),
        column("high", high, "upper limit", 4),
        text_column("answer", product.answers, "answer"),
    ]


def _judge_order(product: NavigationComparison, confidence: float) -> tuple[str, str]:
    """Return whether the errors fall from set to set, as one word and as a sentence."""
    kinds = set(product.answers)
    summary = (
        "confirmed" if kinds == {"confirmed"} else "refuted" if "refuted" in kinds else "undecided"
    )
    sentence = (
        f"The errors fall from {' to '.join(product.labels)}: {summary} at {100 * confidence:g} % "
        f"confidence, for paired draws ({sum(a == 'confirmed' for a in product.answers)} of "
        f"{len(product.answers)} steps confirmed)."
    )
    return summary, sentence


def _draw_sets(
    figure: MatplotlibFigure, product: NavigationComparison, required_m: float | None
) -> None:
    every = np.atleast_1d(figure.subplots(1, len(product.spacecraft), sharey=True))
    total = len(product.points)
    for s, (axes, craft) in enumerate(zip(every, product.spacecraft, strict=True)):
        for p, point in enumerate(product.points):
            place = np.arange(len(product.labels)) + 0.7 * ((p + 0.5) / total - 0.5)
            low, median, high = product.position_m[:, :, p, s]
            colour = PALETTE[COLOURS[p % len(COLOURS)]]
            axes.errorbar(median, place, xerr=[median - low, high - median], fmt="o", color=colour,
                          capsize=3, label=_format_point(point) or "median")  # fmt: skip
            axes.plot(product.bound_m[:, p, s], place, "|", color=colour, markersize=14)
            axes.plot(product.rms_m[:, p, s], place, "s", color=colour, markersize=5,
                      fillstyle="none")  # fmt: skip
        paper = product.paper_position_m[:, s]
        if np.isfinite(paper).any():
            axes.plot(paper, np.arange(len(paper)), "x", color=PALETTE["black"], markersize=8,
                      label="published")  # fmt: skip
        if required_m is not None:
            axes.axvline(required_m, color=PALETTE["black"], linestyle="--", label="rms allowed")
        axes.set_xscale("log")
        axes.set_xlabel("position error [m]")
        axes.set_title(craft)
    every[0].set_yticks(np.arange(len(product.labels)), product.labels)
    every[0].invert_yaxis()  # shared: the first set on top
    handles, names = every[-1].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5)


def _format_point(point: str) -> str:
    """Return the name of a point for a legend: 10 min instead of 10min."""
    return re.sub(
        r"\b(\d+)(?:p(\d+))?(h|min|s)\b",
        lambda m: f"{m[1]}{'.' + m[2] if m[2] else ''} {m[3]}",
        point,
    )


def _draw_histories(figure: MatplotlibFigure, product: NavigationComparison) -> None:
    every = np.atleast_1d(figure.subplots(len(product.spacecraft), 1, sharex=True))
    label = ""
    for c, name in enumerate(product.labels):
        there = np.isfinite(product.time_s[c])
        time, label = hours_or_days(product.time_s[c, there])
        colour, marks = _curve_style(c, time.size)
        for s, axes in enumerate(every):
            axes.plot(time, product.error_m[c, s, there], color=colour, label=name, **marks)
            axes.plot(time, 3.0 * product.sigma_m[c, s, there], "--", color=colour, linewidth=1.0)
    for axes, craft in zip(every, product.spacecraft, strict=True):
        axes.set_yscale("log")
        axes.set_ylabel(f"{craft}\nposition error [m]")
    every[-1].set_xlabel(label)
    _legend(figure, every[0])


def _draw_nees(figure: MatplotlibFigure, product: NavigationComparison) -> None:
    axes = figure.subplots()
    flown = np.maximum(product.flight_runs - product.flight_lost, 1.0)
    band = np.array(chi_square_band(product.flight_states, flown))
    high = float(band[1].max())
    # one band if all stages have as many flights, else the widest, that of the fewest
    label = "99.9 % band" + ("" if np.ptp(flown) == 0 else ", fewest flights")
    axes.axhspan(band[0].min(), high, color="#999999", alpha=0.4, linewidth=0, label=label)
    label = ""
    for c, name in enumerate(product.labels):
        there = np.isfinite(product.time_s[c])
        time, label = hours_or_days(product.time_s[c, there])
        colour, marks = _curve_style(c, time.size)
        axes.plot(time, product.mean_nees[c, there], color=colour, label=name, **marks)
    if np.nanmax(product.mean_nees) > 5.0 * high:
        axes.set_yscale("log")
    axes.set_ylabel(f"mean NEES of {int(product.flight_states[0])} states [-]")
    axes.set_xlabel(label)
    _legend(figure, axes)


def _curve_style(number: int, points: int) -> tuple[str, dict[str, Any]]:
    """Return colour and marks of a curve; marks only once all colours are taken."""
    colour, lap = PALETTE[COLOURS[number % len(COLOURS)]], number // len(COLOURS)
    if not lap:
        return colour, {}
    every = max(points // 8, 1)
    # a step later for each, so that marks of curves that coincide stand side by side
    start = number % len(COLOURS) * every // len(COLOURS)
    mark = _MARKS[(lap - 1) % len(_MARKS)]
    return colour, {"marker": mark, "markevery": (start, every), "markersize": 5}


def _legend(figure: MatplotlibFigure, axes: Axes) -> None:
    """Place the legend inside the axes, or below them if it would cover curves."""
    handles, names = axes.get_legend_handles_labels()
    if len(names) <= _INSIDE:
        axes.legend(loc="best")
    else:
        figure.legend(handles, names, loc="outside lower center", ncols=3)
