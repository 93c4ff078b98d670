"""Figures of the comparison of trackers: outages, sweep, consistency, errors over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere.products.products import Bands
from hillsphere_tracking.assisted_tracking.figures import logarithmic, tracker_style
from hillsphere_tracking.tracking_comparison.products import (
    AgeComparison,
    Consistency,
    TrackingComparison,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

__all__ = ["draw_ages", "draw_bands", "draw_consistency", "draw_outages"]

_MARKS = ("o", "s", "^", "D", "v", "P", "X")
_AGE_LINES = ("-", "--", ":", "-.")
_FLOOR_DEG = 1e-3
"""Errors below this are drawn here, so that a logarithmic axis keeps its room for those that
matter: no antenna of this study measures a thousandth of a degree."""


def draw_outages(
    figure: Figure, product: TrackingComparison, published: Mapping[tuple[str, str], float]
) -> None:
    """Draw median and 5–95 % of the error of each outage and tracker, with published values."""
    axes = figure.add_subplot()
    m = product.measures.index(product.measure)
    places = np.arange(len(product.outages), dtype=float)
    low, middle, high = np.degrees(product.quantiles[:, m])
    count = len(product.trackers)
    for t, name in enumerate(product.trackers):
        x = places + 0.8 * ((t + 0.5) / count - 0.5)
        colour, _ = tracker_style(t)
        axes.vlines(x, low[t], high[t], color=colour, lw=1.6, alpha=0.7)
        axes.plot(x, middle[t], _MARKS[t % len(_MARKS)], color=colour, ms=4, label=name)
    keys = list(zip(product.passes, product.outages, strict=True))
    reference = np.array([published.get(key, np.nan) for key in keys])
    if np.isfinite(reference).any():
        axes.plot(places, reference, "_", color=PALETTE["black"], ms=22, mew=1.6, label="published")
    for place in places[1:]:
        axes.axvline(place - 0.5, color="#dddddd", lw=0.6)
    axes.axhline(np.degrees(product.lock_angle_rad), color=PALETTE["black"], ls="--", lw=0.9,
                 label="beam")  # fmt: skip
    names = [
        f"{name}\n{loss / 60.0:g} min"
        for name, loss in zip(product.passes, product.loss_s, strict=True)
    ]
    axes.set_xticks(places, names, fontsize=7.5)
    axes.set_xlim(-0.5, places[-1] + 0.5)
    axes.grid(visible=False, axis="x")
    logarithmic(axes)
    axes.set_xlabel("pass, signal lost after")
    axes.set_ylabel("largest error of the prediction (deg)")
    figure.legend(loc="outside lower center", ncols=5, fontsize=8)


def draw_ages(figure: Figure, product: AgeComparison, styles: Sequence[str], label: str) -> None:
    """Draw the mean of the medians of each tracker, and the time to reacquire, over a swept number.

    `styles` are the trackers in the order of their colours; `label` is the label of the axis.
    """
    searched = bool(np.isfinite(product.reacquire_s).any())
    cells = figure.subplots(1 + searched, squeeze=False, sharex=True)[:, 0].tolist()
    groups = tuple(dict.fromkeys(product.group))
    for t, name in enumerate(product.trackers):
        colour, _ = tracker_style(styles.index(name))
        for g, group in enumerate(groups):
            here = np.flatnonzero([one == group for one in product.group])
            here = here[np.argsort(product.value[here], kind="stable")]
            x, mark, line = product.value[here], _MARKS[g % len(_MARKS)], _AGE_LINES[g % 4]
            cells[0].plot(
                x, np.degrees(product.mean_median_rad[t, here]), mark, ls=line, color=colour,
                label=f"{name}, {group}" if group else name,
            )  # fmt: skip
            if searched:
                median, most = product.reacquire_s[:, t, here]
                cells[1].plot(x, median, mark, ls=line, color=colour)
                cells[1].vlines(x, median, most, color=colour, lw=0.9, alpha=0.7)
    axes = cells[-1]
    positive = product.value[product.value > 0.0]
    if positive.size and product.value.min() >= 0.0 and positive.max() > 10.0 * positive.min():
        # a logarithmic axis cannot show zero: linear up to the smallest positive value
        axes.set_xscale("symlog", linthresh=float(positive.min()))
        ticks = np.unique(product.value)
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    for cell in cells:
        logarithmic(cell)
    axes.set_xlabel(label)
    cells[0].set_ylabel("mean over the outages of the\nmedian largest error (deg)")
    if searched:
        axes.set_ylabel("time to reacquire\nof those found (s)")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)


def draw_consistency(figure: Figure, product: Consistency, level: float) -> None:
    """Draw the mean NEES of each outage and tracker, with the band of a consistent tracker."""
    axes = figure.add_subplot()
    places = np.arange(len(product.outages), dtype=float)
    count = len(product.trackers)
    low, high = product.interval[0].max(axis=0), product.interval[1].min(axis=0)
    for place, a, b in zip(places, low, high, strict=True):
        axes.fill_between([place - 0.5, place + 0.5], a, b, color="#dddddd", lw=0,
                          label=f"{100.0 * level:g} % band" if place == 0 else None)  # fmt: skip
    for t, name in enumerate(product.trackers):
        colour, _ = tracker_style(t)
        x = places + 0.6 * ((t + 0.5) / count - 0.5)
        axes.plot(x, product.mean[t], _MARKS[t % len(_MARKS)], color=colour, ms=5, label=name)
    axes.axhline(2.0, color=PALETTE["black"], lw=0.9, ls="--", label="expected")
    names = [f"{p}\n{o}" for p, o in zip(product.passes, product.outages, strict=True)]
    axes.set_xticks(places, names, fontsize=7.5)
    axes.set_xlim(-0.5, places[-1] + 0.5)
    axes.grid(visible=False, axis="x")
    logarithmic(axes)
    axes.set_xlabel("pass, signal lost after")
    axes.set_ylabel("mean NEES (–)")
    figure.legend(loc="outside lower center", ncols=5, fontsize=8)


def draw_bands(
    figure: Figure,
    bands: Bands,
    panels: Sequence[tuple[str, float, Mapping[str, int]]],
    styles: Sequence[str],
    lock_angle_rad: float,
) -> None:
    """Draw quantiles of errors over time.

    Each panel consists of a title, the time of the loss (s), and the rows of the bands by tracker.
    """
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    cells = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel().tolist()
    for axes in cells[len(panels) :]:
        axes.remove()
    minutes = bands.time_s / 60.0
    middle = int(np.argmin(np.abs(np.array(bands.levels) - 0.5)))
    known: dict[str, Artist] = {}
    for k, (axes, (title, loss_s, of_tracker)) in enumerate(zip(cells, panels, strict=False)):
        for name, row in of_tracker.items():
            colour, _ = tracker_style(styles.index(name))
            values = np.maximum(np.degrees(bands.values[:, row]), _FLOOR_DEG)
            there = np.isfinite(values[middle])
            axes.fill_between(minutes[there], values[0, there], values[-1, there], color=colour,
                              alpha=0.25, lw=0)  # fmt: skip
            (line,) = axes.plot(minutes[there], values[middle, there], color=colour, lw=1.2)
            known.setdefault(name, line)
        end = loss_s / 60.0
        axes.axvspan(0.0, end, color="#eeeeee", lw=0, zorder=0)
        axes.axvline(end, color="#888888", lw=0.9)
        axes.axhline(np.degrees(lock_angle_rad), color=PALETTE["black"], ls="--", lw=0.9)
        logarithmic(axes)
        axes.set_title(title, fontsize=9)
        if k % columns == 0:
            axes.set_ylabel("error √(ΔA² + Δh²) (deg)")
        if k >= len(panels) - columns:
            axes.set_xlabel("after acquisition (min)")
    figure.legend(list(known.values()), list(known), loc="outside lower center", ncols=4,
                  fontsize=8)  # fmt: skip
