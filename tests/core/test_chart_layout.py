"""Layout of figures of several panels: shared axes, titles and legends do not collide."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from hillsphere.presentation import Axis, Chart, Curve, Panel
from hillsphere.show.matplotlib_renderer import draw_chart
from hillsphere.show.plotly_renderer import plotly_figure

TIME = Axis("time", "s")


def panel(title: str = "", label: str = "") -> Panel:
    return Panel(TIME, Axis("gain", scale="log"), [Curve([0.0, 1.0], [0.2, 3.0], label)], title)


def test_labels_of_shared_axes_are_only_at_the_edges() -> None:
    chart = Chart("Grid", [panel() for _ in range(4)], columns=2, share_x=True, share_y=True)
    made = plotly_figure(chart)
    shown = {
        name: axis.get("showticklabels", True) and "title" in axis
        for name, axis in made["layout"].items()
        if name[1:5] == "axis"
    }
    assert [name for name, is_shown in shown.items() if is_shown] == [
        "yaxis", "xaxis3", "yaxis3", "xaxis4",
    ]  # fmt: skip
    # On a narrow page the panels are below one another: each has its labels.
    narrow = made["narrow"]["layout"]["xaxis2"]
    assert narrow["showticklabels"]
    assert narrow["title"]["text"] == "time (s)"


def test_a_long_title_has_room_between_the_rows() -> None:
    def gap_px(title: str) -> float:
        made = plotly_figure(Chart("Rows", [panel(), panel(title)]))
        margin = made["layout"]["margin"]
        height = made["height"] - margin["t"] - margin["b"]
        (_, upper), (lower, _) = (made["layout"][name]["domain"] for name in ("yaxis2", "yaxis"))
        return float((lower - upper) * height)

    assert gap_px("two\nlines") - gap_px("") == pytest.approx(32.0)


def test_a_long_legend_pushes_the_panels_down() -> None:
    def top_px(count: int) -> float:
        chart = Chart("Legend", [panel("title", f"curve number {k}") for k in range(count)])
        return float(plotly_figure(chart)["layout"]["margin"]["t"])

    assert top_px(20) > top_px(2)


def test_short_logarithmic_axes_have_plain_numbers() -> None:
    figure = Figure()
    draw_chart(figure, Chart("Gains", [panel()]))
    (axes,) = figure.axes
    figure.draw_without_rendering()
    low, high = axes.get_ylim()
    ticks = axes.get_yticklabels()
    shown = [tick.get_text() for tick in ticks if low <= tick.get_position()[1] <= high]
    assert shown == ["0.2", "0.5", "1", "2"]
    assert np.all([not label.get_text() for label in axes.get_yticklabels(minor=True)])
