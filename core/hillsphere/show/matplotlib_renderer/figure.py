"""Drawing of a chart with matplotlib: its panels one by one."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.show.charts import Axis, Chart, Panel, Sky, Space
from hillsphere.show.colours import LINE_COLOURS
from hillsphere.show.marks import Map
from hillsphere.show.matplotlib_renderer.layout import (
    add_colour_bars,
    add_legend,
    add_legend_below,
    set_axis,
    set_log_ticks,
)
from hillsphere.show.matplotlib_renderer.marks import DRAW_MARK
from hillsphere.show.matplotlib_renderer.solids import DRAW_SOLID
from hillsphere.show.matplotlib_renderer.styles import Colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["draw_chart"]


def draw_chart(figure: MatplotlibFigure, chart: Chart) -> None:
    """Draw a chart into an empty matplotlib figure.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Empty, of the chart's size.
    chart : Chart
        What is drawn.
    """
    grid = figure.add_gridspec(
        chart.rows, chart.columns, height_ratios=chart.heights or None,
        width_ratios=chart.widths or None,
    )  # fmt: skip
    drawn: list[Axes] = []
    for index, panel in enumerate(chart.panels):
        row, column = divmod(index, chart.columns)
        kind = {Sky: "polar", Space: "3d"}.get(type(panel))
        shared: dict[str, Any] = {"projection": kind}
        if chart.share_x and row:
            shared["sharex"] = drawn[column]
        if chart.share_y and column:
            shared["sharey"] = drawn[row * chart.columns]
        axes = figure.add_subplot(grid[row, column], **shared)
        drawn.append(axes)
        _PANELS[type(panel)](axes, panel, not chart.shared_legend)
        if chart.share_x and index + chart.columns < len(chart.panels):
            axes.tick_params(axis="x", which="both", labelbottom=False)
            axes.set_xlabel("")
        if chart.share_y and column:
            axes.tick_params(axis="y", which="both", labelleft=False)
            axes.set_ylabel("")
    for axes in drawn:
        set_log_ticks(axes)
    add_colour_bars(figure, chart, drawn)
    if chart.shared_legend:
        add_legend_below(figure, drawn)


def _panel(axes: Axes, panel: Panel, has_legend: bool) -> None:
    colours = _palette()
    for mark in panel.marks:
        DRAW_MARK[type(mark)](axes, mark, colours)
    set_axis(axes, "x", panel.x)
    set_axis(axes, "y", panel.y)
    if panel.is_equal:
        axes.set_aspect("equal", adjustable="box" if _has_ends(panel) else "datalim")
    if panel.title:
        axes.set_title(panel.title, fontsize=10)
    if any(isinstance(mark, Map) for mark in panel.marks):
        axes.grid(visible=False)
    if has_legend and panel.legend != "none":
        add_legend(axes, panel.legend)


def _has_ends(panel: Panel) -> bool:
    return None not in (panel.x.low, panel.x.high, panel.y.low, panel.y.high)


def _sky(axes: Any, panel: Sky, has_legend: bool) -> None:
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    colours = _palette()
    for mark in panel.marks:
        turned = np.radians(np.asarray(mark.x, dtype=float))
        DRAW_MARK[type(mark)](axes, mark, colours, turned)
    axes.set_ylim(0.0, 90.0)
    axes.set_yticks([30.0, 60.0, 90.0], ["60°", "30°", ""], fontsize=7)
    axes.set_xticks(np.radians([0.0, 90.0, 180.0, 270.0]), ["N", "E", "S", "W"])
    axes.tick_params(pad=0)
    axes.set_title(panel.title, fontsize=9)
    axes.set_xlabel(panel.note, fontsize=8)
    if has_legend:
        add_legend(axes, "best")


def _space(axes: Any, panel: Space, has_legend: bool) -> None:
    colours = _palette()
    for solid in panel.solids:
        DRAW_SOLID[type(solid)](axes, solid, colours)
    for name in "xyz":
        axis: Axis = getattr(panel, name)
        getattr(axes, f"set_{name}label")(axis.text, labelpad=8)
        if axis.low is not None or axis.high is not None:
            getattr(axes, f"set_{name}lim")(axis.low, axis.high)
        axes.locator_params(axis=name, nbins=5)
    axes.set_aspect("equal")
    axes.view_init(elev=panel.elevation_deg, azim=panel.azimuth_deg)
    if panel.title:
        axes.set_title(panel.title, fontsize=10)
    if has_legend:
        add_legend(axes, "upper left")


_PANELS: dict[type, Callable[..., None]] = {Panel: _panel, Sky: _sky, Space: _space}


def _palette() -> Colours:
    return cycle(LINE_COLOURS)
