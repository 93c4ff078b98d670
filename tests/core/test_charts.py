"""Figures as data: both renderers draw every mark, from the same values."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from dataclasses import replace
from typing import Any, get_args
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from hillsphere.presentation import (
    Area,
    Arrows,
    Axis,
    Band,
    Bars,
    Boxes,
    Chart,
    Cloud,
    ColourScale,
    Curve,
    Map,
    Mark,
    Mesh,
    Note,
    Panel,
    Path,
    Points,
    Rule,
    Segments,
    Sky,
    Solid,
    Space,
    Span,
    Surface,
)
from hillsphere.show.charts import even_indices
from hillsphere.show.colours import PALETTE
from hillsphere.show.drawing import draw
from hillsphere.show.plotly_renderer import plotly_figure

SCALE = ColourScale("slope", "deg", 0.0, 40.0)
ANGLE = np.linspace(0.0, 2.0 * np.pi, 21)
RING = np.array([np.cos(ANGLE), np.sin(ANGLE), 0.0 * ANGLE])
GLOBE = np.array(
    [np.outer(np.cos(ANGLE), np.sin(ANGLE / 2)), np.outer(np.sin(ANGLE), np.sin(ANGLE / 2)),
     np.outer(np.ones(21), np.cos(ANGLE / 2))]
)  # fmt: skip
MARKS: tuple[Mark, ...] = (
    Curve([0.0, 1.0, math.nan, 2.0], [1.0, 2.0, 3.0, 4.0], "curve", dash="dashed", marker="dot"),
    Points([0.0, 1.0], [1.0, 2.0], "points", names=["a", "b"], rows=[3, 4]),
    Points([0.0, 1.0], [1.0, 2.0], values=[0.0, 40.0], scale=SCALE),
    Band([0.0, 1.0], [0.5, 0.5], [1.0, 2.0], "band"),
    Area([0.0, 1.0, 1.0], [0.0, 0.0, 1.0], "area"),
    Rule("y", 1.5, "limit"),
    Span("x", 0.2, 0.4, "outage"),
    Bars([0.0, 1.0], [1.0, 2.0], base=0.5, label="bars", rows=[0, 1]),
    Bars([0.0, 1.0], [1.0, 2.0], "x", label="lying bars"),
    Segments([0.0, 1.0], [0.5, 0.6], [1.5, 2.6], label="intervals", has_caps=True, rows=[0, 1]),
    Boxes([0.5], [[1.0], [2.0], [3.0], [4.0], [5.0]], label="box"),
    Map([0.0, 1.0, 2.0], [0.0, 1.0], [[math.nan, 7.0]], replace(SCALE, power=0.5), True),
    Note("in a corner"),
    Note("at a point", 1.0, 1.0, "bottom left"),
)
SOLIDS: tuple[Solid, ...] = (
    Path(RING, "path", times=ANGLE, rows=2),
    Cloud(RING, "cloud", values=40.0 * np.abs(RING[0]), scale=SCALE),
    Surface(GLOBE, "surface"),
    Surface(GLOBE, values=40.0 * np.abs(GLOBE[0]), scale=SCALE),
    Mesh(np.eye(3), [[0, 1, 2]], "mesh"),
    Mesh(np.eye(3), [[0, 1, 2]], values=[3.0], scale=SCALE),
    Arrows(np.zeros((3, 1)), np.ones((3, 1)), "arrow"),
)


def panel(*marks: Mark, **changes: Any) -> Chart:
    return Chart("T", [Panel(Axis("x", "km"), Axis("y", "m/s"), marks, **changes)])


def unpack(packed: dict[str, Any]) -> list[float]:
    values: list[float] = np.frombuffer(b64decode(packed["bdata"]), packed["dtype"]).tolist()
    return values


def texts(svg: bytes) -> str:
    """Return the comments of an SVG, which hold the texts that are drawn as paths."""
    return "\n".join(re.findall(r"<!-- (.*?) -->", svg.decode()))


def test_every_kind_of_mark_is_tried() -> None:
    assert {type(mark) for mark in MARKS} == set(get_args(Mark))
    assert {type(solid) for solid in SOLIDS} == set(get_args(Solid))


@pytest.mark.parametrize("mark", MARKS, ids=lambda mark: type(mark).__name__)
def test_a_mark_is_drawn_by_both(mark: Mark) -> None:
    chart = panel(mark)
    ET.fromstring(draw(chart).svg)
    figure = plotly_figure(chart)
    json.dumps(figure, allow_nan=False)
    layout = figure["layout"]
    assert figure["data"] or layout.get("shapes") or layout.get("annotations")
    label = getattr(mark, "label", "")
    entries = [item for item in (*figure["data"], *layout.get("shapes", ())) if item.get("name")]
    assert [item["name"] for item in entries] == [label] * bool(label)


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
def test_a_solid_is_drawn_by_both(solid: Solid) -> None:
    chart = Chart("T", [Space([solid], time=Axis("time", "h"))])
    ET.fromstring(draw(chart).svg)
    figure = plotly_figure(chart)
    json.dumps(figure, allow_nan=False)
    assert figure["data"][0]["scene"] == "scene"
    assert figure["layout"]["scene"]["aspectmode"] == "data"
    if isinstance(solid, Path):
        assert figure["data"][0]["meta"] == {"rows": 2, "times": ANGLE.tolist()}


def test_values_are_those_that_were_given() -> None:
    x = np.linspace(0.0, 1.0, 50)
    (trace,) = plotly_figure(panel(Curve(x, x**2)))["data"]
    assert trace["x"]["dtype"] == "f4"
    np.testing.assert_allclose(unpack(trace["y"]), x**2, atol=1e-7)
    # a small change of a large number needs double precision
    (trace,) = plotly_figure(panel(Curve(1e9 + x, x)))["data"]
    assert trace["x"]["dtype"] == "f8"
    assert unpack(trace["x"]) == (1e9 + x).tolist()


def test_rows_of_marks_are_kept_for_the_page() -> None:
    by_kind = {type(m).__name__: plotly_figure(panel(m))["data"] for m in MARKS if
               getattr(m, "rows", None) is not None}  # fmt: skip
    assert by_kind["Points"][0]["meta"] == {"rows": [3, 4]}
    assert by_kind["Bars"][0]["meta"] == {"rows": [0, 1]}
    assert by_kind["Segments"][0]["meta"] == {"rows": [0, 0, 0, 1, 1, 1]}


def test_axes() -> None:
    x = Axis("amplitude", "km", "log", 1.0, 100.0)
    y = Axis("orbit", ticks=[(0.0, "first"), (1.0, "second")], is_reversed=True)
    chart = Chart("T", [Panel(x, y, [Curve([1.0, 10.0], [0.0, 1.0])], is_equal=False)])
    layout = plotly_figure(chart)["layout"]
    assert layout["xaxis"]["range"] == [0.0, 2.0]
    assert layout["xaxis"]["title"]["text"] == "amplitude (km)"
    assert layout["yaxis"]["ticktext"] == ["first", "second"]
    assert layout["yaxis"]["autorange"] == "reversed"
    shown = texts(draw(chart).svg)
    for text in ("amplitude (km)", "first", "second", "orbit"):
        assert text in shown


def test_texts_and_ticks_of_a_logarithmic_axis() -> None:
    marks = [Note("here", 100.0, 3.0, "centre"), Note("corner")]
    x = Axis("error", "m", "log", 60.0, 150.0, ticks=[(70.0, "seventy")])
    chart = Chart("C", [Panel(x, Axis("time", "h", low=0.0, high=6.0), marks)])
    here, corner = plotly_figure(chart)["layout"]["annotations"]
    assert (here["x"], here["y"], here["yanchor"], here["yshift"]) == (2.0, 3.0, "middle", 0)
    assert (corner["x"], corner["xref"]) == (0.98, "x domain")
    shown = texts(draw(chart).svg).split("\n")
    assert "seventy" in shown
    assert not {"60", "80", "100"} & set(shown)


def test_panels_share_axes_and_one_legend() -> None:
    one = Panel(Axis("x"), Axis("y"), [Curve([0, 1], [0, 1], "same")], "upper")
    chart = Chart("T", [one] * 4, columns=2, share_x=True, share_y=True, shared_legend=True)
    figure = plotly_figure(chart)
    layout = figure["layout"]
    assert [layout[f"xaxis{n}"].get("matches") for n in ("", "2", "3", "4")] == [
        None, None, "x", "x2",
    ]  # fmt: skip
    assert [layout[f"yaxis{n}"].get("matches") for n in ("", "2", "3", "4")] == [
        None, "y", None, "y3",
    ]  # fmt: skip
    assert [trace["showlegend"] for trace in figure["data"]] == [True, False, False, False]
    domains = [(layout[f"xaxis{n}"]["domain"], layout[f"yaxis{n}"]["domain"])
               for n in ("", "2", "3", "4")]  # fmt: skip
    assert domains[0][0][1] < domains[1][0][0]
    assert domains[0][1][0] > domains[2][1][1]
    assert all(0.0 <= end <= 1.0 for pair in domains for ends in pair for end in ends)
    # on a narrow page they stand below one another, each over the whole width
    narrow = figure["narrow"]
    assert [narrow["layout"][f"xaxis{n}"]["domain"] for n in ("", "2")] == [[0.0, 1.0]] * 2
    assert len(narrow["annotations"]) == 4
    assert texts(draw(chart).svg).split("\n").count("same") == 1


def test_a_sky_has_north_above_and_east_at_the_right() -> None:
    sky = Sky([Curve([0.0, 90.0], [90.0, 0.0]), Band([0.0, 360.0], [80.0, 80.0], [90.0, 90.0])],
              "ISS", "at noon")  # fmt: skip
    figure = plotly_figure(Chart("T", [sky]))
    assert figure["layout"]["polar"]["angularaxis"]["direction"] == "clockwise"
    assert unpack(figure["data"][0]["theta"]) == [0.0, 90.0]
    assert "ISS" in texts(draw(Chart("T", [sky])).svg)


def test_one_colour_bar_for_panels_with_the_same_scale() -> None:
    one = Panel(Axis("x"), Axis("y"), [Points([0.0], [0.0], values=[1.0], scale=SCALE)])
    figure = plotly_figure(Chart("T", [one, one], columns=2))
    assert [key for key in figure["layout"] if key.startswith("coloraxis")] == ["coloraxis"]
    assert texts(draw(Chart("T", [one, one], columns=2)).svg).count("slope (deg)") == 1


def test_the_colour_bar_of_one_panel_stands_beside_it() -> None:
    maps = [
        Panel(Axis("x"), Axis("y"), [Map([0, 1, 2], [0, 1], [[n, 1.23456]], replace(SCALE, high=n),
                                         has_numbers=True)])
        for n in (2.0, 3.0)
    ]  # fmt: skip
    figure = plotly_figure(Chart("T", maps, columns=2))
    for layout in (figure["layout"], figure["narrow"]["layout"]):
        for number in ("", "2"):
            bar = layout[f"coloraxis{number}"]["colorbar"]
            assert bar["x"] == layout[f"xaxis{number}"]["domain"][1] < 1.0
            low, high = layout[f"yaxis{number}"]["domain"]
            assert (bar["y"], bar["len"]) == (pytest.approx(0.5 * (low + high)), high - low)
    assert figure["data"][1]["text"] == [["3", "1.235"]]


def test_long_scenes_are_seen_whole() -> None:
    def distance(sides: list[float]) -> float:
        space = Space([Path(np.outer(sides, [0.0, 1.0])), Arrows([[0.0]] * 3, [[1.0]] * 3)])
        return math.hypot(*plotly_figure(Chart("T", [space]))["layout"]["scene"]["camera"]["eye"]
                          .values())  # fmt: skip

    assert distance([5.0, 5.0, 5.0]) == distance([0.0, 0.0, 0.0]) < distance([1.0, 9.0, 1.0])


def test_indices_are_even_and_hold_both_ends() -> None:
    assert even_indices(5, 9).tolist() == [0, 1, 2, 3, 4]
    assert even_indices(9, 3).tolist() == [0, 4, 8]
    assert even_indices(0, 3).size == 0


def test_colour_scales() -> None:
    assert SCALE.colour(0.0) == SCALE.stops[0]
    assert SCALE.colour(40.0) == SCALE.colour(99.0) == SCALE.stops[-1]
    assert replace(SCALE, reversed=True).colour(0.0) == SCALE.stops[-1]
    assert SCALE.fraction(20.0) == 0.5
    assert replace(SCALE, power=0.5).fraction(10.0) == 0.5
    assert SCALE.colour(math.nan) not in SCALE.stops
    assert ColourScale("flat", low=1.0, high=1.0).fraction(1.0) == 0.5


def test_colours_follow_the_palette() -> None:
    curves = [Curve([0, 1], [0, i]) for i in range(8)]
    data = plotly_figure(panel(*curves))["data"]
    used = [trace["line"]["color"] for trace in data]
    names = [name for name in PALETTE if name != "yellow"]
    assert used == [PALETTE[name] for name in (*names, names[0])]


def test_a_chart_is_the_same_every_time() -> None:
    chart = panel(*MARKS)
    assert draw(chart, png=True) == draw(chart, png=True)
    assert plotly_figure(chart) == plotly_figure(chart)
