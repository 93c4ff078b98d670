"""A chart as a figure of plotly.js: its panels, their axes and the whole layout."""

from __future__ import annotations

import math
from itertools import cycle
from typing import Any

import numpy as np

from hillsphere.show.charts import Axis, Chart, Panel, Sky, Space
from hillsphere.show.colours import LINE_COLOURS
from hillsphere.show.plotly_renderer.builder import Builder
from hillsphere.show.plotly_renderer.colour_bars import BAR_PARTS, add_colour_bars, own_scales
from hillsphere.show.plotly_renderer.layout import (
    LINE_PX,
    MARGINS_PX,
    PIXELS_PER_INCH,
    WIDTH_PX,
    Domain,
    add_title,
    axes_to_follow,
    axis_layout,
    hide_labels,
    legend_px,
    most_lines,
    panel_domains,
    place_narrow,
    stack_panels,
)
from hillsphere.show.plotly_renderer.marks import ADD_MARK
from hillsphere.show.plotly_renderer.solids import ADD_SOLID

__all__ = ["plotly_figure"]

_SCENE_MARGINS_PX = {"l": 0, "r": 0, "b": 0}
"""Margins of a figure of scenes only: labels of axes are within the scene, which would cut them."""
_CENTRE_Z = -0.12
"""Height of the point that a scene is seen at, in half extents: the labels of its axes hang below
its centre, so that the lower part needs the room."""


def plotly_figure(chart: Chart) -> dict[str, Any]:
    """Return a chart as a figure of plotly.js.

    Parameters
    ----------
    chart : Chart
        What is drawn.

    Returns
    -------
    dict
        ``data``, ``layout`` and ``height`` (CSS pixels), of JSON types.
    """
    made = Builder(chart)
    domains, stacked = panel_domains(chart), panel_domains(stack_panels(chart))
    for index in own_scales(chart).values():
        for places, part in ((domains, BAR_PARTS[0]), (stacked, BAR_PARTS[1])):
            places[index][0][1] -= part
    counts = {"": 0, "scene": 0, "polar": 0}
    axes: list[str] = []
    narrow: dict[str, Any] = {"layout": {}, "annotations": {}}
    for index, panel in enumerate(chart.panels):
        made.colours = cycle(LINE_COLOURS)
        kind = {Sky: "polar", Space: "scene"}.get(type(panel), "")
        counts[kind] += 1
        number = str(counts[kind]) if counts[kind] > 1 else ""
        axes.append(number if not kind else "")
        if isinstance(panel, Panel):
            made.x, made.y, made.subplot = f"x{number}", f"y{number}", ""
            shared = axes_to_follow(chart, axes, index)
            _panel(made, panel, number, domains[index], *shared)
            hide_labels(made, number, index)
        elif isinstance(panel, Sky):
            made.subplot = f"polar{number}"
            _sky(made, panel, domains[index])
        else:
            made.subplot = f"scene{number}"
            _space(made, panel, domains[index])
        place_narrow(narrow, made, panel, number, stacked[index])
    add_colour_bars(made, domains, stacked, narrow["layout"])
    legends_px = [legend_px(made.named, width) for width in WIDTH_PX]
    titles_px = LINE_PX * most_lines(chart.panels[: chart.columns])
    layout = made.layout | {
        "showlegend": any(getattr(panel, "legend", "") != "none" for panel in chart.panels),
        # The legend begins at the upper edge, and the titles of the first panels are below it.
        "legend": {
            "orientation": "h", "x": 0.0, "xanchor": "left",
            "yref": "container", "y": 1.0, "yanchor": "top",
        },
        "margin": {
            "l": 64, "r": 16, "t": MARGINS_PX[0] + legends_px[0] + titles_px, "b": MARGINS_PX[1],
        } | (_SCENE_MARGINS_PX if all(isinstance(p, Space) for p in chart.panels) else {}),
        "hovermode": "closest",
    }  # fmt: skip
    height = round(PIXELS_PER_INCH * chart.size[1] + legends_px[0] + titles_px)
    figure = {"data": made.traces, "layout": layout, "height": height}
    if chart.columns > 1:
        titles_px = LINE_PX * most_lines(chart.panels[:1])
        narrow["layout"]["margin"] = {"t": MARGINS_PX[0] + legends_px[1] + titles_px}
        height = round(PIXELS_PER_INCH * stack_panels(chart).size[1] + legends_px[1] + titles_px)
        figure["narrow"] = narrow | {"height": height}
    return figure


def _panel(
    made: Builder, panel: Panel, number: str, domain: Domain,
    share_x: str | None, share_y: str | None,
) -> None:  # fmt: skip
    made.scales = (panel.x.scale, panel.y.scale)
    for mark in panel.marks:
        ADD_MARK[type(mark)](made, mark)
    x, y = (
        axis_layout(panel.x, domain[0], f"y{number}"),
        axis_layout(panel.y, domain[1], f"x{number}"),
    )
    if panel.y.scale == "log":
        y["nticks"] = 4  # more would crowd low panels with small digits between the powers
    if share_x:
        x["matches"] = share_x
    if share_y:
        y["matches"] = share_y
    if panel.is_equal:
        y |= {"scaleanchor": f"x{number}", "constrain": "domain"}
        x["constrain"] = "domain"
    made.layout |= {f"xaxis{number}": x, f"yaxis{number}": y}
    if panel.title:
        add_title(made, panel.title, domain)


def _sky(made: Builder, panel: Sky, domain: Domain) -> None:
    for mark in panel.marks:
        ADD_MARK[type(mark)](made, mark)
    made.layout[made.subplot] = {
        "domain": {"x": domain[0], "y": domain[1]},
        "angularaxis": {
            "direction": "clockwise", "rotation": 90, "tickvals": [0, 90, 180, 270],
            "ticktext": ["N", "E", "S", "W"],
        },
        "radialaxis": {
            "range": [0, 90], "tickvals": [30, 60, 90], "ticktext": ["60°", "30°", ""], "angle": 90,
            "tickangle": 90,
        },
    }  # fmt: skip
    text = "<br>".join(line for line in (panel.title, panel.note) if line)
    add_title(made, text, domain, 1.3 * LINE_PX)  # above the letter N


def _space(made: Builder, panel: Space, domain: Domain) -> None:
    for solid in panel.solids:
        ADD_SOLID[type(solid)](made, solid)
    azimuth, elevation = math.radians(panel.azimuth_deg), math.radians(panel.elevation_deg)
    # In half extents: the whole scene and the labels of its axes are seen. Of a long one the near
    # end alone would touch the border, so that the square root is enough.
    distance = 2.1 * math.sqrt(_elongation(panel))
    eye = {
        "x": distance * math.cos(elevation) * math.cos(azimuth),
        "y": distance * math.cos(elevation) * math.sin(azimuth),
        "z": distance * math.sin(elevation),
    }
    scene: dict[str, Any] = {
        "domain": {"x": domain[0], "y": domain[1]}, "aspectmode": "data",
        "camera": {"eye": eye, "center": {"x": 0, "y": 0, "z": _CENTRE_Z}},
    }  # fmt: skip
    for name in "xyz":
        axis: Axis = getattr(panel, name)
        made_axis: dict[str, Any] = {"title": {"text": axis.text}}
        if axis.low is not None and axis.high is not None:
            made_axis["range"] = [axis.low, axis.high]
        scene[f"{name}axis"] = made_axis
    made.layout[made.subplot] = scene
    if panel.time is not None:
        made.layout["meta"] = {"time": panel.time.text}
    if panel.title:
        add_title(made, panel.title, domain)


def _elongation(panel: Space) -> float:
    """Return the longest side of a scene over the geometric mean of all, by which it is scaled."""
    points = [
        np.reshape(points, (3, -1))
        for solid in panel.solids
        for name in ("points", "vertices", "start")
        if (points := getattr(solid, name, None)) is not None
    ]
    if not points:
        return 1.0
    every = np.concatenate(points, axis=1)
    every = every[:, np.isfinite(every).all(axis=0)]
    sides = np.ptp(every, axis=1) if every.size else np.ones(3)
    longest = float(sides.max())
    return float(1.0 / np.prod(np.maximum(sides / longest, 0.1)) ** (1 / 3)) if longest else 1.0
