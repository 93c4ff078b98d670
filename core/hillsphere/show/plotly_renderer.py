"""Charts as figures of plotly.js, for the page of a run.

The result is JSON: a list of traces and a layout. Arrays are packed in base64, which plotly.js
reads as typed arrays. Colours are those of a light page; the page's script changes ink and grid on
a dark one.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.show.charts import (
    Area,
    Arrows,
    Axis,
    Band,
    Bars,
    Boxes,
    Chart,
    Cloud,
    Curve,
    Map,
    Mesh,
    Note,
    Panel,
    Path,
    Points,
    Rows,
    Rule,
    Segments,
    Sky,
    Space,
    Span,
    Surface,
    scales_of,
)
from hillsphere.show.colours import LINE_COLOURS, ColourScale, hex_colour

__all__ = ["plotly_figure"]

Trace: TypeAlias = dict[str, Any]
_Domain: TypeAlias = tuple[list[float], list[float]]
"""Part of the figure's width, and of its height, that a panel takes."""

_DASHES = {"solid": "solid", "dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_MARKERS = {
    "dot": "circle", "circle": "circle", "square": "square", "diamond": "diamond",
    "triangle": "triangle-up", "triangle-down": "triangle-down", "cross": "x-thin",
    "plus": "cross-thin", "star": "star", "bar": "line-ns",
}  # fmt: skip
_SOLID_MARKERS = {"cross": "x", "plus": "cross", "square": "square", "diamond": "diamond"}
"""Marker shapes in three dimensions, where plotly.js has only a few; others are circles."""
_THIN = ("cross", "plus", "bar")
_PIXELS = 96.0 / 72.0
"""CSS pixels per point."""
_PIXELS_PER_INCH = 75.0
"""Height of a figure on the page per inch of the printed one: a page is read from farther away."""
_GAP_PX = 80.0
"""Gap between panels side by side, in pixels: room for the labels of the axes."""
_LABELS_PX = (18.0, 56.0)
"""Room below a panel without and with labels of its horizontal axis, in pixels."""
_LINE_PX = 16.0
"""Height of a line of a panel's title, in pixels."""
_MARGINS_PX = (18.0, 52.0)
"""Margins above and below the panels and their titles, in pixels."""
_WIDTH_PX = (1000.0, 380.0)
"""Width of a figure in the report at 1280 pixels and on a telephone, for gaps and legends."""
_ENTRY_PX = (44.0, 6.6)
"""Width of a legend's entry in pixels without its text, and per character of that."""
_EXACT_PART = 1e-4
"""Smallest ratio of the range of an array to its largest value at which single precision, with a
relative error of 6e-8, shows no steps on a screen of 2000 pixels."""
_CORNERS = {
    "top right": (0.98, 0.96, "right", "top"), "top left": (0.02, 0.96, "left", "top"),
    "bottom right": (0.98, 0.04, "right", "bottom"), "bottom left": (0.02, 0.04, "left", "bottom"),
    "centre": (0.5, 0.5, "center", "middle"),
}  # fmt: skip
_BAR_PARTS = 0.06, 0.2
"""Parts of the width of a figure, and of a narrow one, that the colour bar of a panel takes."""
_SCALE_STEPS = 5
"""Ticks of a colour bar whose scale is not linear."""


@dataclass
class _Builder:
    """The figure that is being built, and the place of the current panel."""

    chart: Chart
    traces: list[Trace] = field(default_factory=list)
    layout: dict[str, Any] = field(default_factory=dict)
    named: set[str] = field(default_factory=set)
    hidden: dict[str, dict[str, Any]] = field(default_factory=dict)
    x: str = "x"
    y: str = "y"
    subplot: str = ""
    scales: tuple[str, str] = ("linear", "linear")
    colours: Iterator[str] = field(default_factory=lambda: cycle(""))

    def colour(self, name: str) -> str:
        return hex_colour(name or next(self.colours))

    def add(self, trace: Trace, label: str = "", rows: Rows = None) -> None:
        """Add a trace to the current panel; of traces with one label the first has the entry."""
        if self.subplot:
            trace["scene" if self.subplot.startswith("scene") else "subplot"] = self.subplot
        else:
            trace |= {"xaxis": self.x, "yaxis": self.y}
        trace |= self.entry(label)
        if rows is not None:
            # The page highlights these rows of the table while the pointer is on the mark.
            trace["meta"] = {"rows": rows if isinstance(rows, int) else list(map(int, rows))}
        self.traces.append(trace)

    def entry(self, label: str) -> dict[str, Any]:
        """Return the keys of a trace or shape that concern the legend."""
        if not label:
            return {"showlegend": False}
        is_first = label not in self.named
        self.named.add(label)
        return {"name": label, "legendgroup": label, "showlegend": is_first}

    def annotate(self, text: str, x: Any, y: Any, **keys: Any) -> None:
        note = {"text": text, "x": x, "y": y, "showarrow": False, "font": {"size": 11}, **keys}
        self.layout.setdefault("annotations", []).append(note)


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
    made = _Builder(chart)
    domains, stacked = _domains(chart), _domains(_stack(chart))
    for index in _own_scales(chart).values():
        for places, part in ((domains, _BAR_PARTS[0]), (stacked, _BAR_PARTS[1])):
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
            shared = _axes_to_follow(chart, axes, index)
            _panel(made, panel, number, domains[index], *shared)
            _hide_labels(made, number, index)
        elif isinstance(panel, Sky):
            made.subplot = f"polar{number}"
            _sky(made, panel, domains[index])
        else:
            made.subplot = f"scene{number}"
            _space(made, panel, domains[index])
        _place_narrow(narrow, made, panel, number, stacked[index])
    _colour_bars(made, domains, stacked, narrow["layout"])
    legends_px = [_legend_px(made.named, width) for width in _WIDTH_PX]
    titles_px = _LINE_PX * _most_lines(chart.panels[: chart.columns])
    layout = made.layout | {
        "showlegend": any(getattr(panel, "legend", "") != "none" for panel in chart.panels),
        # The legend begins at the upper edge, and the titles of the first panels are below it.
        "legend": {
            "orientation": "h", "x": 0.0, "xanchor": "left",
            "yref": "container", "y": 1.0, "yanchor": "top",
        },
        "margin": {
            "l": 64, "r": 16, "t": _MARGINS_PX[0] + legends_px[0] + titles_px, "b": _MARGINS_PX[1],
        },
        "hovermode": "closest",
    }  # fmt: skip
    height = round(_PIXELS_PER_INCH * chart.size[1] + legends_px[0] + titles_px)
    figure = {"data": made.traces, "layout": layout, "height": height}
    if chart.columns > 1:
        titles_px = _LINE_PX * _most_lines(chart.panels[:1])
        narrow["layout"]["margin"] = {"t": _MARGINS_PX[0] + legends_px[1] + titles_px}
        height = round(_PIXELS_PER_INCH * _stack(chart).size[1] + legends_px[1] + titles_px)
        figure["narrow"] = narrow | {"height": height}
    return figure


def _stack(chart: Chart) -> Chart:
    """Return the chart with its panels below one another, for a narrow page."""
    height = chart.size[1] * len(chart.panels) / chart.rows
    return replace(
        chart, columns=1, heights=(), widths=(), size_in=(chart.size[0], height), share_x=False,
        share_y=False,
    )  # fmt: skip


def _most_lines(panels: Sequence[Panel | Sky | Space]) -> int:
    """Return the number of lines of the longest title; a sky has letters above and below."""
    return max(
        sum(map(bool, (panel.title, panel.note))) + 2
        if isinstance(panel, Sky)
        else len(panel.title.splitlines())
        for panel in panels
    )


def _legend_px(labels: Collection[str], width_px: float) -> float:
    """Return the height of a legend of these entries."""
    own, per_character = _ENTRY_PX
    whole = sum(own + per_character * len(label) for label in labels)
    return 19.0 * math.ceil(whole / width_px)


def _hide_labels(made: _Builder, number: str, index: int) -> None:
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


def _place_narrow(
    narrow: dict[str, Any], made: _Builder, panel: Panel | Sky | Space, number: str,
    domain: _Domain,
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


def _axes_to_follow(chart: Chart, axes: Sequence[str], index: int) -> tuple[str | None, str | None]:
    """Return the x and y axes that those of a panel follow, None for none."""
    row, column = divmod(index, chart.columns)
    x = f"x{axes[column]}" if chart.share_x and row else None
    y = f"y{axes[row * chart.columns]}" if chart.share_y and column else None
    return x, y


def _domains(chart: Chart) -> list[_Domain]:
    """Return the part of the figure's width and height that each panel takes."""
    spans = []
    height = max(_PIXELS_PER_INCH * chart.size[1] - sum(_MARGINS_PX), 1.0)
    titles = _most_lines(chart.panels[chart.columns :]) if chart.rows > 1 else 0
    has_labels = not chart.share_x and any(isinstance(panel, Panel) for panel in chart.panels)
    gap_px = _LABELS_PX[has_labels] + _LINE_PX * titles
    for count, ratios, gap in (
        (chart.columns, chart.widths, _GAP_PX / _WIDTH_PX[0]),
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


def _panel(
    made: _Builder, panel: Panel, number: str, domain: _Domain,
    share_x: str | None, share_y: str | None,
) -> None:  # fmt: skip
    made.scales = (panel.x.scale, panel.y.scale)
    for mark in panel.marks:
        _MARKS[type(mark)](made, mark)
    x, y = _axis(panel.x, domain[0], f"y{number}"), _axis(panel.y, domain[1], f"x{number}")
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
        _title(made, panel.title, domain)


def _title(made: _Builder, text: str, domain: _Domain, shift_px: float = 0.0) -> None:
    made.annotate(
        text.replace("\n", "<br>"), sum(domain[0]) / 2.0, domain[1][1], xref="paper", yref="paper",
        xanchor="center", yanchor="bottom", yshift=shift_px, font={"size": 12},
    )  # fmt: skip


def _axis(axis: Axis, domain: list[float], anchor: str) -> dict[str, Any]:
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


def _pack(values: ArrayLike) -> Any:
    """Return an array as plotly.js reads it, in single precision where that is enough."""
    array = np.ascontiguousarray(values, dtype=float)
    finite = array[np.isfinite(array)]
    largest = float(np.abs(finite).max(initial=0.0))
    spread = float(np.ptp(finite)) if finite.size else 0.0
    is_short = spread >= _EXACT_PART * largest and largest < 1e38
    packed = array.astype("<f4" if is_short else "<f8")
    made = {"dtype": "f4" if is_short else "f8", "bdata": b64encode(packed.tobytes()).decode()}
    if array.ndim == 2:
        made["shape"] = f"{array.shape[0]}, {array.shape[1]}"
    return made


def _line(colour: str, dash: str, width: float) -> dict[str, Any]:
    return {"color": colour, "dash": _DASHES[dash], "width": width * _PIXELS}


def _marker_px(shape: str, size: float) -> float:
    """Return the size of a marker; a small dot of matplotlib has half of its nominal size."""
    return size * _PIXELS * (0.5 if shape == "dot" else 1.0)


def _marker(shape: str, size: float, colour: str, is_filled: bool = True) -> dict[str, Any]:
    made: dict[str, Any] = {
        "symbol": _MARKERS[shape], "size": _marker_px(shape, size), "color": colour,
    }  # fmt: skip
    # A thin marker has only a border.
    if shape in _THIN or not is_filled:
        made["line"] = {"color": colour, "width": 1.5}
        if shape not in _THIN:
            made["symbol"] = f"{_MARKERS[shape]}-open"
    return made


def _curve(made: _Builder, mark: Curve) -> None:
    colour = made.colour(mark.colour)
    trace = _scatter(made, mark.x, mark.y) | {
        "mode": "lines+markers" if mark.marker else "lines", "opacity": mark.opacity,
        "line": _line(colour, mark.dash, mark.width) | {"shape": "hv" if mark.steps else "linear"},
    }  # fmt: skip
    if mark.marker:
        trace["marker"] = _marker(mark.marker, 5.0, colour)
    made.add(trace, mark.label, mark.rows)


def _scatter(made: _Builder, x: ArrayLike, y: ArrayLike) -> Trace:
    if made.subplot:
        return {"type": "scatterpolar", "theta": _pack(x), "r": _pack(y)}
    return {"type": "scatter", "x": _pack(x), "y": _pack(y)}


def _points(made: _Builder, mark: Points) -> None:
    if mark.values is not None and mark.scale is not None:
        marker = _marker(mark.marker, mark.size, "") | _colour_keys(mark.values, mark.scale)
    else:
        marker = _marker(mark.marker, mark.size, made.colour(mark.colour), mark.is_filled)
    trace = _scatter(made, mark.x, mark.y) | {
        "mode": "markers", "marker": marker, "opacity": mark.opacity,
    }  # fmt: skip
    if mark.names:
        trace["text"] = list(mark.names)
    made.add(trace, mark.label, mark.rows)


def _colour_keys(values: ArrayLike, scale: ColourScale) -> dict[str, Any]:
    """Return the keys that colour points by values; the bar is drawn once, apart from them."""
    return {
        "color": _pack(_to_scale(values, scale)), "cmin": 0.0, "cmax": 1.0,
        "colorscale": _colour_stops(scale), "showscale": False,
    }  # fmt: skip


def _to_scale(values: ArrayLike, scale: ColourScale) -> Any:
    """Return the places of values on a scale, from 0 to 1; NaN stays."""
    width = scale.high - scale.low
    array = np.asarray(values, dtype=float)
    part = (array - scale.low) / width if width > 0.0 else np.where(np.isnan(array), array, 0.5)
    return np.clip(part, 0.0, 1.0) ** scale.power


def _colour_stops(scale: ColourScale) -> list[list[Any]]:
    last = len(scale.stops) - 1
    return [[i / last, colour] for i, colour in enumerate(scale.stops)]


def _band(made: _Builder, mark: Band) -> None:
    colour = made.colour(mark.colour)
    line = {"width": 0, "shape": "hv" if mark.steps else "linear"}
    hidden = {"mode": "lines", "line": line, "hoverinfo": "skip"}
    made.add(_scatter(made, mark.x, mark.low) | hidden)
    fill = {
        "fill": "tonext" if made.subplot else "tonexty",
        "fillcolor": _rgba(colour, mark.opacity),
    }
    made.add(_scatter(made, mark.x, mark.high) | hidden | fill, mark.label)


def _rgba(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def _area(made: _Builder, mark: Area) -> None:
    colour = made.colour(mark.colour)
    made.add(
        _scatter(made, mark.x, mark.y)
        | {
            "mode": "lines", "line": {"width": 0}, "fill": "toself", "hoverinfo": "skip",
            "fillcolor": _rgba(colour, mark.opacity),
        },
        mark.label,
    )  # fmt: skip


def _rule(made: _Builder, mark: Rule) -> None:
    ends = _across(made, mark.direction, mark.value, mark.value)
    line = _line(made.colour(mark.colour), mark.dash, mark.width)
    shape = {"type": "line", "line": line, **ends, **made.entry(mark.label)}
    made.layout.setdefault("shapes", []).append(shape)


def _span(made: _Builder, mark: Span) -> None:
    ends = _across(made, mark.direction, mark.low, mark.high)
    fill = _rgba(made.colour(mark.colour), mark.opacity)
    shape = {"type": "rect", "line": {"width": 0}, "fillcolor": fill, "layer": "below", **ends}
    made.layout.setdefault("shapes", []).append(shape | made.entry(mark.label))


def _across(made: _Builder, direction: str, low: float, high: float) -> dict[str, Any]:
    """Return the ends of a shape that crosses the whole panel."""
    if direction == "x":
        return {
            "xref": made.x, "x0": float(low), "x1": float(high),
            "yref": f"{made.y} domain", "y0": 0, "y1": 1,
        }  # fmt: skip
    return {
        "yref": made.y, "y0": float(low), "y1": float(high),
        "xref": f"{made.x} domain", "x0": 0, "x1": 1,
    }  # fmt: skip


def _bars(made: _Builder, mark: Bars) -> None:
    at, values = np.asarray(mark.at, dtype=float), np.asarray(mark.values, dtype=float)
    base = np.broadcast_to(np.asarray(mark.base, dtype=float), values.shape)
    width = np.broadcast_to(np.asarray(mark.width, dtype=float), values.shape)
    along, across = ("x", "y") if mark.direction == "x" else ("y", "x")
    trace = {
        "type": "bar", "orientation": "h" if mark.direction == "x" else "v",
        along: _pack(values - base), across: _pack(at), "width": _pack(width),
        "marker": {"color": made.colour(mark.colour)}, "opacity": mark.opacity,
    }  # fmt: skip
    if base.any():
        trace["base"] = _pack(base)
    made.layout["barmode"] = "overlay"
    made.add(trace, mark.label, mark.rows)


def _segments(made: _Builder, mark: Segments) -> None:
    at, low, high = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, dtype=float)) for v in (mark.at, mark.low, mark.high))
    )
    gap = np.full(at.shape, np.nan)
    across = np.column_stack((at, at, gap)).ravel()
    along = np.column_stack((low, high, gap)).ravel()
    colour = made.colour(mark.colour)
    x, y = (along, across) if mark.direction == "x" else (across, along)
    trace = _scatter(made, x, y) | {
        "mode": "lines", "line": _line(colour, "solid", mark.width), "opacity": mark.opacity,
    }  # fmt: skip
    if mark.has_caps:
        symbol = "line-ns" if mark.direction == "x" else "line-ew"
        line = {"color": colour, "width": 1.5}
        trace |= {"mode": "lines+markers", "marker": {"symbol": symbol, "size": 8, "line": line}}
    rows = mark.rows
    if rows is not None and not isinstance(rows, int):
        rows = np.repeat(rows, 3).tolist()  # two ends and the gap
    made.add(trace, mark.label, rows)


def _boxes(made: _Builder, mark: Boxes) -> None:
    colour = made.colour(mark.colour)
    names = ("lowerfence", "q1", "median", "q3", "upperfence")
    quantiles = np.asarray(mark.quantiles, dtype=float)
    across = "x" if mark.direction == "y" else "y"
    trace = {
        "type": "box", "orientation": "v" if mark.direction == "y" else "h", "width": mark.width,
        across: np.asarray(mark.at, dtype=float).tolist(), "line": {"color": colour, "width": 1.2},
        "fillcolor": _rgba(colour, 0.35),
        **{name: row.tolist() for name, row in zip(names, quantiles, strict=True)},
    }  # fmt: skip
    made.add(trace, mark.label, mark.rows)


def _map(made: _Builder, mark: Map) -> None:
    values = np.asarray(mark.values, dtype=float)
    trace = {
        "type": "heatmap", "x": _pack(mark.x), "y": _pack(mark.y), "zmin": 0.0, "zmax": 1.0,
        "z": _pack(_to_scale(values, mark.scale)), "colorscale": _colour_stops(mark.scale),
        "showscale": False, "xgap": 1, "ygap": 1, "hoverongaps": False,
        # A heat map takes no packed array of other values than z.
        "text": [[f"{value:.4g}" for value in row] for row in values.tolist()],
        "hovertemplate": "%{text}<extra></extra>",
    }  # fmt: skip
    if mark.has_numbers:
        trace |= {"texttemplate": "%{text}", "textfont": {"size": 10}}
    made.add(trace)


def _note(made: _Builder, mark: Note) -> None:
    font = {"size": 11} if mark.colour == "ink" else {"size": 11, "color": hex_colour(mark.colour)}
    if mark.x is not None and mark.y is not None:
        is_right, is_above = "left" not in mark.corner, "bottom" not in mark.corner
        is_centred = mark.corner == "centre"
        # Of all things on a logarithmic axis, plotly.js takes texts alone by their logarithm.
        x, y = (
            math.log10(value) if scale == "log" else value
            for value, scale in zip((mark.x, mark.y), made.scales, strict=True)
        )
        made.annotate(
            mark.text, x, y, xref=made.x, yref=made.y, font=font,
            xanchor="center" if is_centred else "left" if is_right else "right",
            yanchor="middle" if is_centred else "bottom" if is_above else "top",
            yshift=0 if is_centred else 3 if is_above else -3,
            xshift=0 if is_centred else 4 if is_right else -4,
        )  # fmt: skip
        return
    at_x, at_y, xanchor, yanchor = _CORNERS[mark.corner]
    made.annotate(
        mark.text, at_x, at_y, xref=f"{made.x} domain", yref=f"{made.y} domain", xanchor=xanchor,
        yanchor=yanchor, align=xanchor, font=font,
    )  # fmt: skip


_MARKS: dict[type, Callable[..., None]] = {
    Curve: _curve, Points: _points, Band: _band, Area: _area, Rule: _rule, Span: _span,
    Bars: _bars, Segments: _segments, Boxes: _boxes, Map: _map, Note: _note,
}  # fmt: skip


def _sky(made: _Builder, panel: Sky, domain: _Domain) -> None:
    for mark in panel.marks:
        _MARKS[type(mark)](made, mark)
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
    _title(made, text, domain, 1.3 * _LINE_PX)  # above the letter N


def _space(made: _Builder, panel: Space, domain: _Domain) -> None:
    for solid in panel.solids:
        _SOLIDS[type(solid)](made, solid)
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
        "domain": {"x": domain[0], "y": domain[1]}, "aspectmode": "data", "camera": {"eye": eye},
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
        _title(made, panel.title, domain)


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


def _xyz(points: ArrayLike) -> dict[str, Any]:
    return {name: _pack(row) for name, row in zip("xyz", np.asarray(points), strict=True)}


def _path(made: _Builder, solid: Path) -> None:
    trace = {
        "type": "scatter3d", "mode": "lines", "opacity": solid.opacity, **_xyz(solid.points),
        # Lines in space are thinner than their nominal width.
        "line": _line(made.colour(solid.colour), solid.dash, 2.0 * solid.width),
    }  # fmt: skip
    made.add(trace, solid.label, solid.rows)
    if solid.times is not None:
        times = np.asarray(solid.times, dtype=float).tolist()
        trace["meta"] = {**trace.get("meta", {}), "times": times}


def _cloud(made: _Builder, solid: Cloud) -> None:
    marker: dict[str, Any] = {
        "symbol": _SOLID_MARKERS.get(solid.marker, "circle"),
        "size": _marker_px(solid.marker, solid.size),
    }  # fmt: skip
    if solid.values is not None and solid.scale is not None:
        marker |= _colour_keys(solid.values, solid.scale)
    else:
        marker["color"] = made.colour(solid.colour)
    trace = {
        "type": "scatter3d", "mode": "markers", "opacity": solid.opacity, "marker": marker,
        **_xyz(solid.points),
    }  # fmt: skip
    if solid.names:
        trace["text"] = list(solid.names)
    made.add(trace, solid.label, solid.rows)


def _surface(made: _Builder, solid: Surface) -> None:
    trace: Trace = {"type": "surface", "opacity": solid.opacity, "showscale": False,
                    "hoverinfo": "skip", **_xyz(solid.points)}  # fmt: skip
    if solid.values is not None and solid.scale is not None:
        trace |= {"surfacecolor": _pack(_to_scale(solid.values, solid.scale)), "cmin": 0.0,
                  "cmax": 1.0, "colorscale": _colour_stops(solid.scale)}  # fmt: skip
    else:
        colour = made.colour(solid.colour)
        trace["colorscale"] = [[0.0, colour], [1.0, colour]]
    made.add(trace, solid.label)


def _mesh(made: _Builder, solid: Mesh) -> None:
    facets = np.asarray(solid.facets, dtype=int).T.tolist()
    trace: Trace = {
        "type": "mesh3d", "opacity": solid.opacity, "flatshading": True, "hoverinfo": "skip",
        **_xyz(solid.vertices), **dict(zip("ijk", facets, strict=True)),
    }  # fmt: skip
    if solid.values is not None and solid.scale is not None:
        trace |= {
            "intensity": _pack(_to_scale(solid.values, solid.scale)), "intensitymode": "cell",
            "cmin": 0.0, "cmax": 1.0, "colorscale": _colour_stops(solid.scale), "showscale": False,
        }  # fmt: skip
    else:
        trace["color"] = made.colour(solid.colour)
    made.add(trace, solid.label)


def _arrows(made: _Builder, solid: Arrows) -> None:
    start, vector = (np.asarray(v, dtype=float) for v in (solid.start, solid.vector))
    gap = np.full(start.shape, np.nan)
    lines = np.stack((start, start + vector, gap), axis=2).reshape(3, -1)
    colour = made.colour(solid.colour)
    trace = {
        "type": "scatter3d", "mode": "lines", "line": _line(colour, "solid", 2.0 * solid.width),
        **_xyz(lines),
    }  # fmt: skip
    made.add(trace, solid.label)
    heads = {"size": 3, "symbol": "diamond", "color": colour}
    tips = {"type": "scatter3d", "mode": "markers", "marker": heads, **_xyz(start + vector)}
    made.add(tips)


_SOLIDS: dict[type, Callable[..., None]] = {
    Path: _path, Cloud: _cloud, Surface: _surface, Mesh: _mesh, Arrows: _arrows,
}  # fmt: skip


def _own_scales(chart: Chart) -> dict[ColourScale, int]:
    """Return the colour scales of single panels, if there are several, and the panels' indices."""
    users: dict[ColourScale, list[int]] = {}
    for index, panel in enumerate(chart.panels):
        for scale in scales_of(panel)[:1]:
            users.setdefault(scale, []).append(index)
    if len(users) < 2:
        return {}
    return {scale: panels[0] for scale, panels in users.items() if len(panels) == 1}


def _colour_bars(
    made: _Builder, domains: Sequence[_Domain], stacked: Sequence[_Domain], narrow: dict[str, Any]
) -> None:
    """Add one colour bar per scale: beside its panel, or of several at the right of the figure."""
    scales = dict.fromkeys(scale for panel in made.chart.panels for scale in scales_of(panel))
    own, count = _own_scales(made.chart), 0
    for place, scale in enumerate(scales, 1):
        name = f"coloraxis{place if place > 1 else ''}"
        steps = [i / (_SCALE_STEPS - 1) for i in range(_SCALE_STEPS)]
        width = scale.high - scale.low
        values = [scale.low + width * step ** (1.0 / scale.power) for step in steps]
        text = f"{scale.label} ({scale.unit})" if scale.unit else scale.label
        bar: dict[str, Any] = {
            "title": {"text": text, "side": "right"}, "tickvals": steps,
            "ticktext": [f"{value:.4g}" for value in values], "thickness": 14, "outlinewidth": 0,
        }  # fmt: skip
        axis = {"cmin": 0.0, "cmax": 1.0, "colorscale": _colour_stops(scale)}
        if scale in own:
            for layout, places in ((made.layout, domains), (narrow, stacked)):
                layout[name] = axis | {"colorbar": bar | _beside(places[own[scale]])}
        else:
            made.layout[name] = axis | {"colorbar": bar | {"x": 1.0 + 0.12 * count}}
            count += 1
        # A trace without points carries the bar.
        made.traces.append(
            {
                "type": "scatter3d" if made.subplot.startswith("scene") else "scatter",
                "x": [None], "y": [None], "mode": "markers", "showlegend": False,
                "hoverinfo": "skip", "marker": {"color": [0.0], "coloraxis": name},
                **({"z": [None], "scene": made.subplot}
                   if made.subplot.startswith("scene") else {}),
            }
        )  # fmt: skip


def _beside(domain: _Domain) -> dict[str, Any]:
    """Return the place of a colour bar at the right of a panel."""
    (_, right), (low, high) = domain
    return {"x": right, "xanchor": "left", "y": 0.5 * (low + high), "len": high - low, "ypad": 0}
