"""Figures of one case of assisted tracking: errors over time, standard deviations, sky plots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import PALETTE
from hillsphere_tracking.assisted_tracking.products import AssistedTracking

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "ROWS_PER_FIGURE",
    "SKIES_PER_FIGURE",
    "draw_errors",
    "draw_skies",
    "draw_spread",
    "logarithmic",
    "tracker_style",
]

ROWS_PER_FIGURE = 3
"""Passes in one figure of errors; with more a page cannot show it whole."""
SKIES_PER_FIGURE = 12
"""Skies in one figure, in rows of three; with more a page cannot show it whole."""

_COLOURS = tuple(
    PALETTE[name] for name in ("blue", "vermillion", "green", "purple", "orange", "black", "sky")
)
_LINES = ("-", "--", ":")
_FLOOR_DEG = 1e-3
"""Errors below this are drawn here, so that a logarithmic axis keeps its room for those that
matter: no antenna of this study measures a thousandth of a degree."""
_MEASURED = 60
"""Measurements of a pass that are drawn in the sky, about: more dots merge into a line."""


def tracker_style(number: int) -> tuple[str, str]:
    """Return colour and line style of a tracker by its number, the same in every figure."""
    return _COLOURS[number % len(_COLOURS)], _LINES[number // len(_COLOURS) % len(_LINES)]


def logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    # One decade or two need more ticks than its powers of ten.
    steps = (1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=steps))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def draw_errors(figure: Figure, product: AssistedTracking, chosen: Integers, columns: int) -> None:
    """Draw the errors √(ΔA² + Δh²) over time, one panel per outage of the chosen passes."""
    rows: list[list[int]] = []
    for p in chosen:
        own = np.flatnonzero(product.outage_pass == p).tolist()
        rows += [own[k : k + columns] for k in range(0, len(own), columns)]
    cells = figure.subplots(len(rows), columns, squeeze=False, sharey=True)
    for line, row in zip(cells, rows, strict=True):
        for axes in line[len(row) :]:
            axes.remove()
        for axes, k in zip(line, row, strict=False):
            _errors(axes, product, k)
        line[0].set_ylabel("error √(ΔA² + Δh²) (deg)")
    for axes in cells[-1][: len(rows[-1])]:
        axes.set_xlabel("after acquisition (min)")
    handles, names = cells[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(len(names), 4), fontsize=8)


def _errors(axes: Axes, product: AssistedTracking, outage: int) -> None:
    p = int(product.outage_pass[outage])
    minutes = product.t_s[:, p] / 60.0
    for t, name in enumerate(product.trackers):
        colour, line = tracker_style(t)
        error = np.degrees(product.error_rad[t, outage])
        axes.plot(minutes, np.maximum(error, _FLOOR_DEG), color=colour, ls=line, lw=1.2, label=name)
    _shade_lock(axes, product, outage)
    axes.axhline(np.degrees(product.lock_angle_rad), color=PALETTE["black"], ls="--", lw=0.9)
    logarithmic(axes)
    axes.set_title(_title(product, outage), fontsize=9)


def _shade_lock(axes: Axes, product: AssistedTracking, outage: int) -> None:
    """Shade the time before the loss of signal."""
    end = product.outage_s[outage] / 60.0
    axes.axvspan(0.0, end, color="#eeeeee", lw=0, zorder=0)
    axes.axvline(end, color="#888888", lw=0.9)


def _title(product: AssistedTracking, outage: int) -> str:
    name = product.passes[int(product.outage_pass[outage])]
    return f"{name}, lost after {product.outage_s[outage] / 60.0:g} min"


def draw_spread(figure: Figure, product: AssistedTracking, outage: int, chosen: Integers) -> None:
    """Draw the error on the sky with its standard deviation, one panel per chosen tracker."""
    columns = min(3, chosen.size)
    rows = -(-chosen.size // columns)
    cells = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    p = int(product.outage_pass[outage])
    minutes = product.t_s[:, p] / 60.0
    flat = cells.ravel().tolist()
    for axes in flat[chosen.size :]:
        axes.remove()
    for axes, t in zip(flat, chosen, strict=False):
        spread = np.degrees(product.spread_rad[t, outage])
        for sigmas, shade in ((3, 0.18), (2, 0.22), (1, 0.28)):
            axes.fill_between(minutes, _FLOOR_DEG, sigmas * spread, color=PALETTE["sky"],
                              alpha=shade, lw=0, label=f"{sigmas}σ")  # fmt: skip
        error = np.degrees(product.sky_error_rad[t, outage])
        axes.plot(minutes, np.maximum(error, _FLOOR_DEG), color=PALETTE["blue"], lw=1.2,
                  label="error on the sky")  # fmt: skip
        _shade_lock(axes, product, outage)
        logarithmic(axes)
        axes.set_title(product.trackers[int(t)], fontsize=9)
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("after acquisition (min)")
    for line in cells:
        line[0].set_ylabel("angle (deg)")
    handles, names = flat[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8)


def draw_skies(figure: Figure, product: AssistedTracking, chosen: Integers) -> None:
    """Draw polar sky plots of passes, with the zenith in the centre."""
    columns = min(3, chosen.size)
    rows = -(-chosen.size // columns)
    for place, p in enumerate(chosen):
        axes = figure.add_subplot(rows, columns, place + 1, projection="polar")
        # theta runs from north eastwards, the radius is the distance from the zenith
        axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
        axes.set_theta_direction(-1)  # type: ignore[attr-defined]
        there = np.isfinite(product.t_s[:, p])
        azimuth, zenith = _sky(product.true_rad[:, there, p])
        axes.plot(azimuth, zenith, color="#888888", lw=1.2, label="true path")
        axes.plot(azimuth[-1], zenith[-1], "s", color="#888888", ms=5, label="set")
        losses = product.outage_s[product.outage_pass == p]
        t_s = product.t_s[there, p]
        used = t_s <= losses.min()
        step = max(1, int(np.count_nonzero(used)) // _MEASURED)
        azimuth, zenith = _sky(product.measured_rad[:, there, p][:, used][:, ::step])
        axes.plot(azimuth, zenith, ".", color=PALETTE["blue"], ms=3, label="measured")
        lost = np.searchsorted(t_s, losses)
        azimuth, zenith = _sky(product.true_rad[:, there, p][:, np.minimum(lost, t_s.size - 1)])
        axes.plot(azimuth, zenith, "D", color=PALETTE["vermillion"], ms=5, ls="none",
                  label="signal lost")  # fmt: skip
        axes.set_ylim(0.0, 90.0)
        axes.set_yticks([30.0, 60.0, 90.0], ["60°", "30°", ""], fontsize=7)
        axes.set_xticks(np.radians([0.0, 90.0, 180.0, 270.0]), ["N", "E", "S", "W"])
        axes.tick_params(pad=0)
        axes.set_title(f"{product.passes[int(p)]}, {product.stations[int(p)]}", fontsize=9)
        top = np.degrees(product.elevation_max_rad[p])
        axes.set_xlabel(f"{product.directions[int(p)]}, up to {top:.1f}°", fontsize=8)
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8)


def _sky(angles: Array) -> tuple[Array, Array]:
    """Return azimuth (rad) and distance from the zenith (deg) of angles (2, n)."""
    return angles[0], 90.0 - np.degrees(angles[1])
