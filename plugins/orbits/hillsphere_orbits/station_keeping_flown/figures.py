"""Figures of station-keeping that was flown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.constants import DAY_S, HOUR_S
from hillsphere.presentation import PALETTE
from hillsphere_orbits.station_keeping_flown.products import StationKeepingFlown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MOST_ORBITS", "UNCORRECTED", "draw_cost", "draw_survival"]

_MARKS = ("o", "s", "^", "D", "v", "P", "X")
_COLOURS = ("blue", "vermillion", "green", "purple", "orange", "sky")
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
MOST_ORBITS = 12
"""Orbits of the figure of the cost; of more, as many are taken evenly."""
_MOST_CELLS = 160
"""Cells of a panel up to which each is written into."""


def draw_survival(figure: Figure, product: StationKeepingFlown) -> None:
    """Draw the survival probability over orbits and intervals, a strategy per panel."""
    rows, most = len(product.labels), len(product.intervals)
    panels = figure.subplots(
        1, 1 + len(product.strategies), sharey=True, squeeze=False,
        width_ratios=[1.4, *[max(3, most)] * len(product.strategies)],
    )[0]  # fmt: skip
    free = product.uncorrected_survival[:, None]
    shown = [(UNCORRECTED, ["never"], free, np.isfinite(free))] + [
        (name, list(product.intervals), product.survival[:, s], product.flown[:, s])
        for s, name in enumerate(product.strategies)
    ]
    for axes, (name, ticks, survival, flown) in zip(panels, shown, strict=True):
        columns = len(ticks)
        part = np.ma.masked_invalid(survival)
        mesh = axes.pcolormesh(
            np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, part, cmap="cividis",
            vmin=0.0, vmax=1.0, edgecolors="white", linewidth=0.8,
        )  # fmt: skip
        if rows * most <= _MOST_CELLS:
            for i, j in np.ndindex(rows, columns):
                value = survival[i, j]
                text = "lost" if value == 0.0 else f"{100 * value:.0f} %"
                if not flown[i, j]:
                    there = product.stable[i] and np.isfinite(product.interval_s[i, j])
                    text = "stable" if there else "–"
                dark = flown[i, j] and value < 0.55
                axes.text(j, i, text, ha="center", va="center", fontsize=7,
                          color="white" if dark else "black")  # fmt: skip
        axes.set_xticks(range(columns), ticks, fontsize=8)
        axes.set_xlabel("corrected" if name == UNCORRECTED else "time between corrections")
        axes.set_title(name, fontsize=9)
        axes.set_facecolor("#dddddd")
    panels[0].set_yticks(range(rows), product.labels, fontsize=8)
    panels[0].set_ylim(rows - 0.5, -0.5)
    panels[0].set_ylabel("orbit")
    figure.colorbar(mesh, ax=list(panels), label="survival probability", aspect=18, pad=0.02)


def draw_cost(figure: Figure, product: StationKeepingFlown) -> None:
    """Draw the cost of survivors against the interval, a strategy per panel."""
    panels = figure.subplots(1, len(product.strategies), sharey=True, sharex=True, squeeze=False)[0]
    from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator

    survival, hours = product.survival, product.interval_s / HOUR_S
    total = len(product.labels)
    chosen = np.unique(np.linspace(0, total - 1, min(total, MOST_ORBITS)).round().astype(int))
    for s, axes in enumerate(panels):
        for k, i in enumerate(chosen):
            mark, ink = _MARKS[k % len(_MARKS)], PALETTE[_COLOURS[k % len(_COLOURS)]]
            order = np.argsort(hours[i])
            order = order[np.isfinite(product.cost_m_s[i, s, order])]
            # side by side, not upon each other
            aside = np.exp(_APART * (k - 0.5 * (len(chosen) - 1)))
            x, y = hours[i, order] * aside, product.cost_m_s[i, s, order]
            top = product.cost_95_m_s[i, s, order]
            held = survival[i, s, order] >= product.survival_required
            axes.plot(x, y, "-", color=ink, lw=0.8, alpha=0.6)
            axes.vlines(x, y, np.maximum(top, y), color=ink, lw=0.8, alpha=0.6)
            axes.plot(x[~held], y[~held], mark, color=ink, mfc="white", ms=5)
            # an orbit without any mark of its own still stands in the legend
            axes.plot(x[held], y[held], mark, color=ink, ms=5, label=product.labels[i])
        axes.set_xscale("log")
        axes.set_xlabel("time between corrections (h)")
        axes.set_title(product.strategies[s], fontsize=9)
        axes.grid(alpha=0.3)
    known = hours[np.isfinite(hours)]
    if known.size:
        panels[0].set_xlim(known.min() / _MARGIN, known.max() * _MARGIN)
    panels[0].xaxis.set_major_locator(FixedLocator(_TICKS))
    panels[0].xaxis.set_major_formatter(FormatStrFormatter("%g"))
    panels[0].xaxis.set_minor_locator(NullLocator())
    panels[0].set_ylim(bottom=0.0)
    panels[0].set_ylabel(f"Δv (m/s per {product.duration_s / DAY_S:g} days)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", fontsize=8)
