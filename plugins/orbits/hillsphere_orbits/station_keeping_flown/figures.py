"""Figures of station-keeping that was flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.base.constants import DAY_S, HOUR_S
from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    ColourScale,
    Curve,
    Map,
    Mark,
    Note,
    Panel,
    Points,
    Segments,
)
from hillsphere_orbits.scenes import MARKERS, name_axis
from hillsphere_orbits.station_keeping_flown.products import StationKeepingFlown

__all__ = ["UNCORRECTED", "cost_chart", "survival_chart"]

_APART = 0.03
"""Shift of the marks of neighbouring orbits, in the logarithm of the interval: just visible beside
each other, far less than the distance of two intervals."""
_MARGIN = 1.5
"""Factor by which the axis goes beyond the shortest and longest interval, so that no mark is
cut."""
_TICKS = (0.25, 0.5, 1, 2, 3, 6, 12, 24, 48, 96, 192, 384, 768)
"""Intervals with a tick, hours: whole, halved and doubled days instead of powers of ten."""
UNCORRECTED = "none"
"""How flights without any correction are called beside the strategies."""
_MOST_ORBITS = 12
"""Orbits of the figure of the cost; of more, as many are taken evenly."""
_MOST_CELLS = 160
"""Cells of a panel up to which each is written into."""
_SURVIVAL = ColourScale("survival probability", "%", 0.0, 100.0)


def _strategy_title(name: str) -> str:
    return name.replace("_", " ").replace("lqr", "LQR")


def survival_chart(product: StationKeepingFlown) -> Chart:
    """Return the survival probability over orbits and intervals, a strategy per panel."""
    rows, most = len(product.labels), len(product.intervals)
    free = product.uncorrected_survival[:, None]
    is_written = rows * most <= _MOST_CELLS
    panels = [_survival_panel(product, UNCORRECTED, ("never",), free, is_written)]
    panels += [
        _survival_panel(product, name, product.intervals, product.survival[:, s], is_written)
        for s, name in enumerate(product.strategies)
    ]
    strategies, width = len(product.strategies), max(3, most)
    return Chart(
        f"Survival of {product.duration_s / DAY_S:g} days", panels,
        "Part of the flights that survived: without any correction, and by time between "
        "corrections, a strategy per panel. A stable orbit has no unstable component to correct.",
        columns=len(panels), share_y=True, widths=(1.4, *[width] * strategies),
        size_in=(3.6 + 0.75 * width * strategies, 1.9 + 0.32 * max(rows, 2)),
    )  # fmt: skip


def _survival_panel(
    product: StationKeepingFlown, name: str, intervals: tuple[str, ...], survival: Array,
    is_written: bool,
) -> Panel:  # fmt: skip
    rows, columns = survival.shape
    marks: list[Mark] = [
        Map(np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, 100.0 * survival, _SURVIVAL,
            has_numbers=is_written)
    ]  # fmt: skip
    if is_written:
        for i, j in np.argwhere(np.isnan(survival)).tolist():
            is_stable = product.stable[i] and np.isfinite(product.interval_s[i, j])
            marks.append(Note("stable" if is_stable else "–", j, i, "centre"))
    what = "corrected" if name == UNCORRECTED else "interval"
    return Panel(
        Axis(what, ticks=list(enumerate(intervals))),
        name_axis(product.labels, 0.5),
        marks, _strategy_title(name),
    )  # fmt: skip


def cost_chart(product: StationKeepingFlown, table: str) -> Chart:
    """Return the cost of survivors against the interval, a strategy per panel.

    `table` lists the orbits without any correction, then every combination.
    """
    hours, total = product.interval_s / HOUR_S, len(product.labels)
    chosen = np.unique(np.linspace(0, total - 1, min(total, _MOST_ORBITS)).round().astype(int))
    known = hours[np.isfinite(hours)]
    x = Axis("interval", "h", "log", ticks=[(tick, f"{tick:g}") for tick in _TICKS])
    if known.size:
        x = replace(x, low=known.min() / _MARGIN, high=known.max() * _MARGIN)
    y = Axis(f"Δv in {product.duration_s / DAY_S:g} days", "m/s", low=0.0)
    panels = []
    for s, name in enumerate(product.strategies):
        marks: list[Mark] = []
        for k, i in enumerate(chosen.tolist()):
            # Side by side, not upon each other.
            aside = np.exp(_APART * (k - 0.5 * (len(chosen) - 1)))
            marks += _cost_marks(product, i, s, k, hours[i] * aside)
        panels.append(Panel(x, y, marks, _strategy_title(name)))
    caption = (
        "Mean Δv of the flights that survived, and its 95th percentile (bar), against the time "
        f"between corrections. Full marks: at least {100 * product.survival_required:g} % "
        "survived; open marks: fewer did, so that the cost is of a favourable selection."
    )
    if total > _MOST_ORBITS:
        caption += f" {_MOST_ORBITS} of the {total} orbits."
    return Chart(
        f"Cost of {product.duration_s / DAY_S:g} days", panels, caption, columns=len(panels),
        share_y=True, shared_legend=True,
        size_in=(9.0, 3.8 + 0.06 * min(max(total, 2), _MOST_ORBITS)), table=table,
    )  # fmt: skip


def _cost_marks(product: StationKeepingFlown, i: int, s: int, k: int, hours: Array) -> list[Mark]:
    """Return the marks of an orbit i with a strategy s, the k-th of the panel."""
    colour, marker, label = (
        LINE_COLOURS[k % len(LINE_COLOURS)],
        MARKERS[k % len(MARKERS)],
        product.labels[i],
    )
    order = np.argsort(hours)
    order = order[np.isfinite(product.cost_m_s[i, s, order])]
    x, y = hours[order], product.cost_m_s[i, s, order]
    first = len(product.labels) + (i * len(product.strategies) + s) * len(product.intervals)
    is_held = product.survival[i, s, order] >= product.survival_required
    marks: list[Mark] = [
        Curve(x, y, "", colour, width=0.8, opacity=0.6),
        Segments(x, y, np.maximum(product.cost_95_m_s[i, s, order], y), "y", "", colour, 0.8, 0.6),
    ]
    for own, is_filled in ((is_held, True), (~is_held, False)):
        # An orbit without any full mark still stands in the legend.
        if own.any() or is_filled:
            at, cost = (x[own], y[own]) if own.any() else ([np.nan], [np.nan])
            marks.append(Points(at, cost, label, colour, marker, is_filled=is_filled,
                                rows=(first + order[own]).tolist()))  # fmt: skip
    return marks
