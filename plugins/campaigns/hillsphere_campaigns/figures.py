"""Figures of a campaign: distributions, convergence, sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.presentation import PALETTE
from hillsphere_campaigns.convergence import Convergence
from hillsphere_campaigns.sensitivity import Explanatory, RankCorrelations, SobolIndices
from hillsphere_campaigns.statistics import MetricStatistics

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "Shown",
    "axis_label",
    "draw_convergence",
    "draw_correlations",
    "draw_cumulative",
    "draw_histograms",
    "draw_scatter",
    "draw_sobol",
    "grid_of",
    "grid_size",
    "legend_below",
    "remark",
]

_MOST_DOTS = 2000
"""Dots of a scatter plot at most: more of them merge into an area and slow the drawing down."""

_MOST_STEPS = 500
"""Steps of a distribution function at most: a panel is some 400 pixels wide."""

_FENCE = 8.0
"""Interquartile ranges beyond the quartiles from which on values are not drawn but counted."""


@dataclass(frozen=True)
class Shown:
    """A metric that is drawn: its values over the cases that came to their end."""

    values: Array
    statistics: MetricStatistics

    @property
    def label(self) -> str:
        """Axis label."""
        return axis_label(self.statistics.name, self.statistics.unit)


def axis_label(name: str, unit: str) -> str:
    """Return ``"name (unit)"``, a long name shortened, without the unit if there is none."""
    short = name if len(name) <= 34 else f"{name[:12]}…{name[-21:]}"
    return f"{short} ({unit})" if unit not in ("", "-") else short


def grid_size(count: int) -> tuple[float, float]:
    """Return the size of a figure of so many panels, inches."""
    columns = min(max(count, 1), 3)
    return (1.0 + 3.2 * columns, 0.8 + 2.7 * -(-count // columns))


def grid_of(figure: Figure, count: int) -> list[Axes]:
    """Return the axes of so many panels, at most three side by side."""
    columns = min(count, 3)
    cells = figure.subplots(-(-count // columns), columns, squeeze=False).ravel().tolist()
    for cell in cells[count:]:
        cell.remove()
    return cells[:count]


def _within(values: Array) -> tuple[Array, str]:
    """Return the values that are drawn, and the number of outliers that are not."""
    low, high = np.quantile(values, [0.25, 0.75])
    reach = _FENCE * (high - low)
    kept = values if reach == 0.0 else values[(values >= low - reach) & (values <= high + reach)]
    away = values.size - kept.size
    return kept, f"{away} farther out" if away else ""


def remark(axes: Axes, text: str) -> None:
    """Write a short text into the upper right corner of a panel."""
    if text:
        axes.text(
            0.98, 0.96, text, transform=axes.transAxes, ha="right", va="top", fontsize=7.5,
            color="#444444", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )  # fmt: skip


def draw_histograms(figure: Figure, shown: Sequence[Shown]) -> None:
    """Draw a histogram of each metric, its mean and quantiles."""
    for axes, one in zip(grid_of(figure, len(shown)), shown, strict=True):
        values, away = _within(one.values)
        bins = np.histogram_bin_edges(values, bins="auto")
        if bins.size > 61:
            bins = np.linspace(bins[0], bins[-1], 61)
        count, edges = np.histogram(values, bins=bins)
        axes.stairs(count, edges, fill=True, color=PALETTE["sky"], alpha=0.8)
        statistics = one.statistics
        axes.axvline(statistics.mean, color=PALETTE["black"], lw=1.4, label="mean")
        inside = statistics.quantiles[
            (statistics.quantiles >= edges[0]) & (statistics.quantiles <= edges[-1])
        ]
        for i, value in enumerate(inside):
            axes.axvline(value, color=PALETTE["vermillion"], lw=1.1, ls="--",
                         label="quantiles" if i == 0 else None)  # fmt: skip
        axes.set_xlabel(one.label)
        axes.set_ylabel("cases")
        remark(axes, away)
    legend_below(figure)


def draw_cumulative(figure: Figure, shown: Sequence[Shown], level: float) -> None:
    """Draw the empirical distribution function of each metric, and its quantiles' intervals."""
    for axes, one in zip(grid_of(figure, len(shown)), shown, strict=True):
        n = one.values.size
        ordered = np.sort(one.values)
        share = np.arange(1, n + 1) / n
        at = np.unique(np.linspace(0, n - 1, min(n, _MOST_STEPS)).round().astype(int))
        # Dvoretzky, Kiefer and Wolfowitz (1956), with Massart's constant (1990).
        reach = np.sqrt(np.log(2.0 / (1.0 - level)) / (2.0 * n))
        axes.fill_between(
            ordered[at], np.maximum(share[at] - reach, 0.0), np.minimum(share[at] + reach, 1.0),
            step="post", color=PALETTE["sky"], alpha=0.35, lw=0, label=f"{100 * level:g} % band",
        )  # fmt: skip
        axes.step(ordered[at], share[at], where="post", color=PALETTE["blue"], label="cases")
        statistics = one.statistics
        low, high = np.clip(statistics.quantile_intervals, ordered[0], ordered[-1])
        axes.hlines(statistics.levels, low, high, color=PALETTE["vermillion"], lw=2.2)
        axes.plot(statistics.quantiles, statistics.levels, "o", ms=3.5,
                  color=PALETTE["vermillion"], label="quantiles, intervals")  # fmt: skip
        kept, away = _within(one.values)
        if away:
            margin = 0.05 * float(np.ptp(kept))
            axes.set_xlim(kept.min() - margin, kept.max() + margin)
        axes.set_ylim(-0.02, 1.02)
        axes.set_xlabel(one.label)
        axes.set_ylabel("share of cases below")
        remark(axes, away)
    legend_below(figure)


def draw_convergence(
    figure: Figure, traces: Sequence[tuple[str, Convergence]], level: float
) -> None:
    """Draw the convergence of estimates and their intervals with the number of cases."""
    for axes, (label, trace) in zip(grid_of(figure, len(traces)), traces, strict=True):
        low, high = trace.interval
        axes.fill_between(trace.cases, low, high, color=PALETTE["sky"], alpha=0.4, lw=0,
                          label=f"{100 * level:g} % interval")  # fmt: skip
        axes.plot(trace.cases, trace.value, color=PALETTE["blue"], label="estimate")
        axes.axhline(trace.value[-1], color=PALETTE["black"], lw=0.8, ls=":", label="at the end")
        axes.set_xscale("log")
        # The first few cases say next to nothing; their intervals would fill the panel.
        late = trace.cases >= min(20, int(trace.cases[-1]))
        ends = np.concatenate([low[late], high[late], trace.value[late]])
        ends = ends[np.isfinite(ends)]
        if ends.size and np.ptp(ends) > 0:
            margin = 0.05 * float(np.ptp(ends))
            axes.set_ylim(ends.min() - margin, ends.max() + margin)
        axes.set_xlabel("cases")
        axes.set_ylabel(label)
    legend_below(figure)


def draw_scatter(
    figure: Figure,
    pairs: Sequence[tuple[int, int]],
    given: Explanatory,
    found: RankCorrelations,
    values: Array,
    units: Sequence[str],
    failed: NDArray[np.bool_],
) -> None:
    """Draw metrics and failures against the inputs with the strongest rank correlation."""
    for axes, (i, j) in zip(grid_of(figure, len(pairs)), pairs, strict=True):
        x = given.values[i]
        axes.set_xlabel(axis_label(given.names[i], given.units[i]))
        axes.set_title(f"rank correlation {found.rho[i, j]:+.2f}", fontsize=9)
        if j >= len(values):
            for colour, which, label in (
                ("blue", ~failed, "not failed"), ("vermillion", failed, "failed"),
            ):  # fmt: skip
                ordered = np.sort(x[which])
                at = np.unique(np.linspace(0, ordered.size - 1, _MOST_STEPS).round().astype(int))
                axes.step(ordered[at], (at + 1) / ordered.size, where="post",
                          color=PALETTE[colour], label=label)  # fmt: skip
            axes.set_ylabel("share of these cases below")
            axes.legend(fontsize=8)
            continue
        rows = np.flatnonzero(np.isfinite(values[j]))
        rows = rows[np.unique(np.linspace(0, rows.size - 1, _MOST_DOTS).round().astype(int))]
        axes.plot(x[rows], values[j, rows], ".", ms=2.5, color=PALETTE["blue"], rasterized=True)
        axes.set_ylabel(axis_label(found.metrics[j], units[j]))


def draw_correlations(
    figure: Figure, pairs: Sequence[tuple[int, int]], found: RankCorrelations, level: float
) -> None:
    """Draw rank correlations as bars."""
    axes = figure.add_subplot()
    rows = np.arange(len(pairs))
    rho = np.array([found.rho[i, j] for i, j in pairs])
    chance = np.array([found.p_holm[i, j] for i, j in pairs])
    for label, which, colour in (
        (f"by chance in less than {100 * (1 - level):.2g} %", chance < 1.0 - level, "blue"),
        ("may be chance", chance >= 1.0 - level, "sky"),
        ("not judged: cases share their draws", np.isnan(chance), "green"),
    ):
        if which.any():
            axes.barh(rows[which], rho[which], color=PALETTE[colour], height=0.7, label=label)
    low, high = np.array([found.interval[:, i, j] for i, j in pairs]).T
    axes.hlines(rows, low, high, color=PALETTE["black"], lw=1.2)
    axes.axvline(0.0, color=PALETTE["black"], lw=0.8)
    names = [f"{axis_label(found.inputs[i], '')} → {found.metrics[j]}" for i, j in pairs]
    axes.set_yticks(rows, names, fontsize=8)
    axes.set_ylim(rows.size - 0.4, -0.6)
    axes.set_xlim(-1.05, 1.05)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("rank correlation (line: its interval)")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)


def draw_sobol(figure: Figure, found: SobolIndices, metrics: Sequence[int], most: int) -> None:
    """Draw first and total indices, the inputs with the largest total ones, a panel per metric."""
    for axes, j in zip(grid_of(figure, len(metrics)), metrics, strict=True):
        order = np.argsort(-found.total[:, j], kind="stable")[:most]
        rows = np.arange(order.size)
        for shift, colour, index, interval, label in (
            (-0.2, "blue", found.first, found.first_interval, "first: alone"),
            (0.2, "orange", found.total, found.total_interval, "total: with others"),
        ):
            axes.barh(rows + shift, index[order, j], height=0.38, color=PALETTE[colour],
                      label=label)  # fmt: skip
            axes.hlines(rows + shift, *interval[:, order, j], color=PALETTE["black"], lw=1.0)
        axes.set_yticks(rows, [axis_label(found.inputs[i], "") for i in order], fontsize=7)
        axes.set_ylim(rows.size - 0.4, -0.6)
        axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(f"share of the variance of {axis_label(found.metrics[j], '')}", fontsize=8)
    legend_below(figure)


def legend_below(figure: Figure) -> None:
    """Put one legend below all panels: they show the same things."""
    handles: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=4, fontsize=8
    )
