"""Figure of a campaign's quantiles over time."""

from __future__ import annotations

from hillsphere.presentation import Axis, Band, Chart, Curve, Mark, Note, Panel
from hillsphere.products.products import Bands
from hillsphere.show.charts import even_indices
from hillsphere.show.history import time_unit
from hillsphere_campaigns.figures import MOST_STEPS, grid_chart, quantity_axis

__all__ = ["MOST_PANELS", "band_chart", "band_marks"]

MOST_PANELS = 9
"""Panels of the figure: a page."""

_SHADES = (0.35, 0.65, 0.9)
"""Opacity of the bands, from the outermost inwards."""


def band_chart(bands: Bands) -> Chart:
    """Return the quantiles over time, a panel for each of the first quantities.

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
    if samples > MOST_STEPS:
        caption += f" At most {MOST_STEPS} of {samples} samples are drawn."
    unit, scale = time_unit(float(bands.time_s[-1]))
    panels = []
    for quantity in range(count):
        marks = band_marks(bands, quantity, scale)
        some = bands.count[quantity][bands.count[quantity] > 0]
        if some.size and some.min() < some.max():
            marks.append(Note(f"{some[0]} to {some[-1]} cases"))
        axis = quantity_axis(bands.names[quantity], bands.units[quantity])
        panels.append(Panel(Axis("time", unit), axis, marks))
    return grid_chart("Quantiles over time", panels, caption)


def band_marks(bands: Bands, quantity: int, scale: float) -> list[Mark]:
    """Return the quantiles of one quantity over time in units of so many seconds."""
    at = even_indices(bands.time_s.size, MOST_STEPS)
    time, values = bands.time_s[at] / scale, bands.values[:, quantity, at]
    many = len(bands.levels)
    # The outermost levels are a band, so are the next ones; one that is left over is a line.
    marks: list[Mark] = []
    for i in range(many // 2):
        low, high = bands.levels[i], bands.levels[many - 1 - i]
        marks.append(
            Band(time, values[i], values[many - 1 - i], f"{100 * low:.4g} % to {100 * high:.4g} %",
                 opacity=_SHADES[min(i, len(_SHADES) - 1)])
        )  # fmt: skip
    if many % 2:
        middle = bands.levels[many // 2]
        name = "median" if middle == 0.5 else f"{100 * middle:.4g} %"
        marks.append(Curve(time, values[many // 2], name, "blue"))
    return marks
