"""Tables, figures and sentences of the stage ``navigation_comparison``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.presentation import PALETTE, Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.figures import COLOURS, hours_or_days
from hillsphere_estimators.navigation.presentation import judge_consistency
from hillsphere_estimators.navigation_comparison.products import NavigationComparison
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["present_comparison"]

_COLUMNS = [
    Column("set", "", "sensors"),
    Column("point", "", "at"),
    Column("spacecraft", "", "spacecraft"),
    Column("cases", "-", "flights"),
    Column("lost", "-", "lost"),
    Column("median_m", "m", "median error", 4),
    Column("low_m", "m", "5 %", 4),
    Column("high_m", "m", "95 %", 4),
    Column("draw_m", "m", "published draw", 5),
    Column("velocity_mm_s", "mm/s", "median velocity error", 4),
    Column("draw_mm_s", "mm/s", "published draw", 5),
    Column("rms_m", "m", "rms", 4),
    Column("bound_m", "m", "bound", 4),
    Column("ratio", "-", "rms over bound", 4),
    Column("ratio_se", "-", "its standard error", 2),
    Column("nees", "-", "mean NEES", 4),
    Column("consistent", "", "within the band"),
]
_PUBLISHED = ("draw_m", "draw_mm_s")
_LEAST, _MOST = 0.85, 1.2
"""Of an rms error over its bound, for a filter that is as good as it can be."""
_FLIGHTS = [
    Column("set", "", "flights"),
    Column("spacecraft", "", "spacecraft"),
    Column("count", "-", "number"),
    Column("lost", "-", "lost"),
    Column("rms_m", "m", "rms error at the end", 4),
    Column("nees", "-", "mean NEES", 4),
    Column("answer", "", "the filter is"),
]
_MARKS = "osD^v"
_INSIDE = 6
"""Entries of a legend that leaves room for curves."""
_ORDER = [
    Column("claim", "", "less error"),
    Column("point", "", "at"),
    Column("ratio", "-", "ratio of rms", 4),
    Column("low", "-", "lower limit", 4),
    Column("high", "-", "upper limit", 4),
    Column("answer", "", "answer"),
]


def present_comparison(
    product: NavigationComparison, spec: NavigationComparisonSpec
) -> Presentation:
    """Show sets of sensors side by side.

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
        notes = ["Errors are lengths of vectors, of the flights that were not lost.",
                 "The bound is the posterior Cramér-Rao bound, each flight's own along its planned "
                 "path, and the root of their mean square.",
                 "It leaves out that a filter with a gate rejects some measurements."]  # fmt: skip
        if published:
            notes.append("A published draw is one flight, not a median, and its interval between "
                         "measurements is not printed.")  # fmt: skip
        tables[named("navigation_comparison")] = Table(
            "Errors at the end of the flights",
            [one for one in _COLUMNS if published or one.name not in _PUBLISHED],
            _rows(product, published),
            notes,
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
        rows, sentences = _order(product, spec.confidence)
        tables[named("navigation_order")] = Table(
            "Do the errors fall from set to set?", _ORDER, rows,
            [f"Ratio of rms position errors on the same draws, {100 * spec.confidence:g} % "
             "interval of a paired bootstrap."],
        )  # fmt: skip
        metrics[named("navigation_order")] = Metric(sentences[0])
        verdict += sentences[1:]
    if product.lightest:
        metrics[named("navigation_lightest")] = Metric(product.lightest)
        verdict.append(
            f"The lightest set of sensors with rms position errors of at most "
            f"{spec.required_position_m:g} m, and none lost: {product.lightest}."
        )
    if product.time_s.size:
        tables[named("navigation_flights")] = Table(
            "Flights of the stages", _FLIGHTS, _flights(product)
        )
        figures[named("navigation_courses")] = Figure(
            "Errors of the estimated positions",
            lambda figure: _draw_histories(figure, product),
            "The first flight of each; dashed: three standard deviations as its filter believes.",
            (8.0, 2.6 + 2.2 * len(product.spacecraft)),
        )
        figures[named("navigation_consistency")] = Figure(
            "Normalised errors squared",
            lambda figure: _draw_nees(figure, product),
            "Mean over the flights of each stage; grey: where 99.9 % of such means of a "
            "consistent filter lie.",
        )
    return Presentation(metrics=metrics, tables=tables, figures=figures, verdict=verdict)


def _consistent(product: NavigationComparison) -> np.ndarray:
    """Return where (C, P) the mean NEES is in its band and no flight was lost."""
    return np.asarray(
        (product.nees >= product.nees_low) & (product.nees <= product.nees_high)
        & (product.lost == 0)
    )  # fmt: skip


def _criteria(product: NavigationComparison, inside: np.ndarray) -> list[str]:
    """Return what is said of bounds, bands and losses."""
    ratio, error = product.bound_ratio.reshape(2, -1)
    good = (ratio >= _LEAST) & (ratio <= _MOST)
    near = np.abs(ratio - np.clip(ratio, _LEAST, _MOST)) <= 2.0 * error
    said = [
        f"Rms position errors are {np.nanmin(ratio):.3g} to {np.nanmax(ratio):.3g} times their "
        f"Cramér-Rao bound; {int(good.sum())} of {ratio.size} lie within {_LEAST:g} to {_MOST:g}"
        + (f", {int((near & ~good).sum())} more within two standard errors of it."
           if (near & ~good).any() else "."),
        f"The mean NEES lies in its 99.9 % band, and no flight is lost, in {int(inside.sum())} of "
        f"{inside.size} sets and points.",
    ] if np.isfinite(ratio).any() else []  # fmt: skip
    if product.lost.any():
        worst = ", ".join(
            f"{label} {int(gone.sum())} of {int(every.sum())}"
            for label, gone, every in zip(product.labels, product.lost, product.cases, strict=True)
            if gone.any()
        )
        said.append(f"Flights were lost: {worst}; what is left of these proves nothing.")
    return said


def _flights(product: NavigationComparison) -> list[Mapping[str, Cell]]:
    rows: list[Mapping[str, Cell]] = []
    for c, label in enumerate(product.labels):
        runs, lost = int(product.flight_runs[c]), int(product.flight_lost[c])
        last = product.mean_nees[c, np.isfinite(product.time_s[c])]
        mean = float(last[-1]) if last.size else float("nan")
        answer = judge_consistency(mean, int(product.flight_states[c]), runs, lost)[0]
        for s, craft in enumerate(product.spacecraft):
            rows.append(
                {
                    "set": label,
                    "spacecraft": craft,
                    "count": runs,
                    "lost": lost,
                    "rms_m": float(product.flight_rms_m[c, s]),
                    "nees": mean,
                    "answer": answer,
                }
            )
    return rows


def _rows(product: NavigationComparison, published: bool) -> list[Mapping[str, Cell]]:
    consistent = _consistent(product)
    rows: list[Mapping[str, Cell]] = []
    for c, label in enumerate(product.labels):
        for p, point in enumerate(product.points):
            nees = float(product.nees[c, p])
            for s, craft in enumerate(product.spacecraft):
                low, median, high = product.position_m[:, c, p, s].tolist()
                rms, bound = float(product.rms_m[c, p, s]), float(product.bound_m[c, p, s])
                draw, speed = product.paper_position_m[c, s], product.paper_velocity_m_s[c, s]
                ratio, error = product.bound_ratio[:, c, p, s].tolist()
                row: dict[str, Cell] = {
                    "set": label,
                    "point": point,
                    "spacecraft": craft,
                    "cases": int(product.cases[c, p]),
                    "lost": int(product.lost[c, p]),
                    "median_m": median,
                    "low_m": low,
                    "high_m": high,
                    "draw_m": _none_if_nan(draw),
                    "velocity_mm_s": 1e3 * float(product.velocity_m_s[c, p, s]),
                    "draw_mm_s": _none_if_nan(1e3 * speed),
                    "rms_m": rms,
                    "bound_m": bound,
                    "ratio": ratio,
                    "ratio_se": error,
                    "nees": nees,
                    "consistent": "yes" if consistent[c, p] else "no",
                }
                rows.append({k: v for k, v in row.items() if published or k not in _PUBLISHED})
    return rows


def _order(
    product: NavigationComparison, confidence: float
) -> tuple[list[Mapping[str, Cell]], list[str]]:
    """Return the rows of the table, and the summary with sentences for the head of the report."""
    rows: list[Mapping[str, Cell]] = []
    answers = iter(product.answers)
    for c in range(len(product.labels) - 1):
        for p, point in enumerate(product.points):
            low, value, high = product.ratio[:, c, p].tolist()
            rows.append(
                {
                    "claim": f"{product.labels[c + 1]} than {product.labels[c]}",
                    "point": point,
                    "ratio": value,
                    "low": low,
                    "high": high,
                    "answer": next(answers),
                }
            )
    kinds = set(product.answers)
    summary = (
        "confirmed" if kinds == {"confirmed"} else "refuted" if "refuted" in kinds else "undecided"
    )
    sentence = (
        f"Errors fall from {' to '.join(product.labels)}: {summary} at {100 * confidence:g} % "
        f"confidence on the same draws ({sum(a == 'confirmed' for a in product.answers)} of "
        f"{len(product.answers)} steps confirmed)."
    )
    return rows, [summary, sentence]


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
    """Return a point's name for a legend: times as they are written, 10 min instead of 10min."""
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
    # one grey for all, where they do not differ; else the widest says what all must keep to
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
    """Return the colour of a curve, and marks once all colours are taken."""
    colour, lap = PALETTE[COLOURS[number % len(COLOURS)]], number // len(COLOURS)
    if not lap:
        return colour, {}
    every = max(points // 8, 1)
    # a step later for each, so that marks of curves that coincide stand side by side
    start = number % len(COLOURS) * every // len(COLOURS)
    mark = _MARKS[(lap - 1) % len(_MARKS)]
    return colour, {"marker": mark, "markevery": (start, every), "markersize": 5}


def _legend(figure: MatplotlibFigure, axes: Axes) -> None:
    """Set the legend inside, or below where it would cover curves."""
    handles, names = axes.get_legend_handles_labels()
    if len(names) <= _INSIDE:
        axes.legend(loc="best")
    else:
        figure.legend(handles, names, loc="outside lower center", ncols=3)


def _none_if_nan(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
