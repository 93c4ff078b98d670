"""Places of panels, axes, titles and legends of a figure of plotly.js."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from hillsphere.show.charts import Axis, Chart, Panel, Sky, Space
from hillsphere.show.plotly_renderer.builder import Builder

__all__ = [
    "LINE_PX", "MARGINS_PX", "PIXELS_PER_INCH", "WIDTH_PX", "Domain", "add_title", "axes_to_follow",
    "axis_layout", "hide_labels", "legend_px", "most_lines", "panel_domains", "place_narrow",
    "stack_panels",
]  # fmt: skip

Domain: TypeAlias = tuple[list[float], list[float]]
"""Part of the figure's width, and of its height, that a panel takes."""
PIXELS_PER_INCH = 75.0
"""Height of a figure on the page per inch of the printed one: a page is read from farther away."""
_GAP_PX = 80.0
"""Gap between panels side by side, in pixels: room for the labels of the axes."""
_LABELS_PX = (18.0, 56.0)
"""Room below a panel without and with labels of its horizontal axis, in pixels."""
LINE_PX = 16.0
"""Height of a line of a panel's title, in pixels."""
MARGINS_PX = (18.0, 52.0)
"""Margins above and below the panels and their titles, in pixels."""
WIDTH_PX = (1000.0, 380.0)
"""Width of a figure in the report at 1280 pixels and on a telephone, for gaps and legends."""
_ENTRY_PX = (44.0, 6.6)
"""Width of a legend's entry in pixels without its text, and per character of that."""


def stack_panels(chart: Chart) -> Chart:
    """Return the chart with its panels below one another, for a narrow page."""
    height = chart.size[1] * len(chart.panels) / chart.rows
    return replace(
        chart, columns=1, heights=(), widths=(), size_in=(chart.size[0], height), share_x=False,
        share_y=False,
    )  # fmt: skip


def most_lines(panels: Sequence[Panel | Sky | Space]) -> int:
    """Return the number of lines of the longest title; a sky has letters above and below."""
    return max(
        sum(map(bool, (panel.title, panel.note))) + 2
        if isinstance(panel, Sky)
        else len(panel.title.splitlines())
        for panel in panels
    )


def legend_px(labels: Collection[str], width_px: float) -> float:
    """Return the height of a legend of these entries."""
    own, per_character = _ENTRY_PX
    whole = sum(own + per_character * len(label) for label in labels)
    return 19.0 * math.ceil(whole / width_px)


def hide_labels(made: Builder, number: str, index: int) -> None:
    """Remove the labels of an axis that has the same below it, or to the left of it.

    They are kept for a narrow page, where the panels stand below one another.
    """
    chart = made.chart
    for name, is_hidden in (
        (f"xaxis{number}", chart.share_x and index + chart.columns < len(chart.panels)),
        (f"yaxis{number}", chart.share_y and index % chart.columns > 0),
    ):
        if is_hidden:
            axis = made.layout[name]
            made.hidden[name] = {"title": axis.pop("title", {}), "showticklabels": True}
            axis["showticklabels"] = False


def place_narrow(
    narrow: dict[str, Any], made: Builder, panel: Panel | Sky | Space, number: str,
    domain: Domain,
) -> None:  # fmt: skip
    """Add the place of a panel, and of its title, on a narrow page."""
    if isinstance(panel, Panel):
        for name, span in zip((f"xaxis{number}", f"yaxis{number}"), domain, strict=True):
            narrow["layout"][name] = {"domain": span, **made.hidden.get(name, {})}
    else:
        narrow["layout"][made.subplot] = {"domain": {"x": domain[0], "y": domain[1]}}
    if panel.title or getattr(panel, "note", ""):
        last = len(made.layout["annotations"]) - 1
        narrow["annotations"][str(last)] = {"x": sum(domain[0]) / 2.0, "y": domain[1][1]}


def axes_to_follow(chart: Chart, axes: Sequence[str], index: int) -> tuple[str | None, str | None]:
    """Return the x and y axes that those of a panel follow, None for none."""
    row, column = divmod(index, chart.columns)
    x = f"x{axes[column]}" if chart.share_x and row else None
    y = f"y{axes[row * chart.columns]}" if chart.share_y and column else None
    return x, y


def panel_domains(chart: Chart) -> list[Domain]:
    """Return the part of the figure's width and height that each panel takes."""
    spans = []
    height = max(PIXELS_PER_INCH * chart.size[1] - sum(MARGINS_PX), 1.0)
    titles = most_lines(chart.panels[chart.columns :]) if chart.rows > 1 else 0
    has_labels = not chart.share_x and any(isinstance(panel, Panel) for panel in chart.panels)
    gap_px = _LABELS_PX[has_labels] + LINE_PX * titles
    for count, ratios, gap in (
        (chart.columns, chart.widths, _GAP_PX / WIDTH_PX[0]),
        (chart.rows, chart.heights, gap_px / height),
    ):
        sizes = np.array(ratios or np.ones(count), dtype=float)
        # Panels keep a tenth of the figure's width or height among them, however many there are.
        sizes *= max(1.0 - gap * (count - 1), 0.1) / sizes.sum()
        starts = np.concatenate([[0.0], np.cumsum(sizes + gap)[:-1]])
        ends = np.minimum(starts + sizes, 1.0)
        spans.append(list(zip(np.minimum(starts, ends).tolist(), ends.tolist(), strict=True)))
    made = []
    for index in range(len(chart.panels)):
        row, column = divmod(index, chart.columns)
        low, high = spans[1][row]
        made.append((list(spans[0][column]), [1.0 - high, 1.0 - low]))
    return made


def add_title(made: Builder, text: str, domain: Domain, shift_px: float = 0.0) -> None:
    """Add the title above a panel, so many pixels higher."""
    made.annotate(
        text.replace("\n", "<br>"), sum(domain[0]) / 2.0, domain[1][1], xref="paper", yref="paper",
        xanchor="center", yanchor="bottom", yshift=shift_px, font={"size": 12},
    )  # fmt: skip


def axis_layout(axis: Axis, domain: list[float], anchor: str) -> dict[str, Any]:
    """Return the keys of an axis on its part of the figure."""
    made: dict[str, Any] = {"domain": domain, "anchor": anchor, "automargin": True}
    if axis.text:
        made["title"] = {"text": axis.text.replace("\n", "<br>"), "standoff": 8}
    ends: list[float | None] = [axis.low, axis.high]
    if axis.scale == "log":
        made |= {"type": "log", "exponentformat": "power", "dtick": 1 if _is_short(ends) else None}
        ends = [None if end is None or end <= 0.0 else math.log10(end) for end in ends]
    if axis.ticks:
        places, texts = zip(*axis.ticks, strict=True)
        made |= {"tickvals": list(map(float, places)), "ticktext": list(texts), "showgrid": False}
    elif axis.step is not None:
        made["dtick"] = axis.step
    if axis.is_reversed:
        ends.reverse()
    if any(end is not None for end in ends):
        made["range"] = ends
    if axis.is_reversed:
        made["autorange"] = "reversed" if None in ends else False
    return {key: value for key, value in made.items() if value is not None}


def _is_short(ends: Sequence[float | None]) -> bool:
    low, high = ends
    return bool(low and high and low > 0.0 and math.log10(high / low) < 8.0)
