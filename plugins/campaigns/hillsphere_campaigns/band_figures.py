"""Figure of a campaign's quantiles over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE, Figure
from hillsphere.products.products import Bands
from hillsphere.show.history import time_unit
from hillsphere_campaigns.figures import axis_label, grid_of, grid_size, legend_below, remark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["MOST_PANELS", "band_figure", "draw_bands"]

MOST_PANELS = 9
"""Panels of the figure: a page."""

_MOST_SAMPLES = 1000
"""Samples drawn per line at most: a panel is narrower than 1000 pixels, more would not be seen."""

_SHADES = (0.35, 0.65, 0.9)
"""Opacity of the bands, from the outermost inwards."""


def band_figure(bands: Bands) -> Figure:
    """Return a figure of the quantiles over time, a panel for each of the first quantities.

    Parameters
    ----------
    bands : Bands
        What is shown.
    """
    total, samples = len(bands.names), bands.time_s.size
    count = min(total, MOST_PANELS)
    caption = "Over the cases that came to their end, at times after the first sample of each."
    if count < total:
        caption += f" The first {count} of {total} quantities; the other {total - count} are "
        caption += "stored and exported."
    if samples > _MOST_SAMPLES:
        caption += f" At most {_MOST_SAMPLES} of {samples} samples are drawn."
    return Figure(
        "Quantiles over time", lambda figure: _draw(figure, bands, count), caption, grid_size(count)
    )


def _draw(figure: Canvas, bands: Bands, count: int) -> None:
    for quantity, axes in enumerate(grid_of(figure, count)):
        _panel(axes, bands, quantity)
    legend_below(figure)


def _panel(axes: Axes, bands: Bands, quantity: int) -> None:
    unit, scale = time_unit(float(bands.time_s[-1]))
    draw_bands(axes, bands, quantity, scale)
    axes.set_xlabel(f"time ({unit})")
    axes.set_ylabel(axis_label(bands.names[quantity], bands.units[quantity]))
    some = bands.count[quantity][bands.count[quantity] > 0]
    if some.size and some.min() < some.max():
        remark(axes, f"{some[0]} to {some[-1]} cases")


def draw_bands(axes: Axes, bands: Bands, quantity: int, scale: float) -> None:
    """Draw the quantiles of one quantity over time in units of so many seconds."""
    last = bands.time_s.size - 1
    at = np.unique(np.linspace(0, last, min(last + 1, _MOST_SAMPLES)).round().astype(int))
    time, values = bands.time_s[at] / scale, bands.values[:, quantity, at]
    many = len(bands.levels)
    # The outermost levels are a band, so are the next ones; one that is left over is a line.
    for i in range(many // 2):
        low, high = bands.levels[i], bands.levels[many - 1 - i]
        axes.fill_between(
            time, values[i], values[many - 1 - i], color=PALETTE["sky"], lw=0,
            alpha=_SHADES[min(i, len(_SHADES) - 1)],
            label=f"{100 * low:.4g} % to {100 * high:.4g} %",
        )  # fmt: skip
    if many % 2:
        middle = bands.levels[many // 2]
        name = "median" if middle == 0.5 else f"{100 * middle:.4g} %"
        axes.plot(time, values[many // 2], color=PALETTE["blue"], label=name)
