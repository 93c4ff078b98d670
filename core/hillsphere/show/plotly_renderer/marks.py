"""Marks of a flat panel as traces, shapes and annotations of plotly.js."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.show.colours import hex_colour
from hillsphere.show.marks import (
    Area,
    Band,
    Bars,
    Boxes,
    Curve,
    Map,
    Note,
    Points,
    Rule,
    Segments,
    Span,
)
from hillsphere.show.plotly_renderer.builder import (
    Builder,
    Trace,
    colour_keys,
    colour_stops,
    line_style,
    marker_style,
    pack,
    rgba,
    to_scale,
)

__all__ = ["ADD_MARK"]

_CORNERS = {
    "top right": (0.98, 0.96, "right", "top"), "top left": (0.02, 0.96, "left", "top"),
    "bottom right": (0.98, 0.04, "right", "bottom"), "bottom left": (0.02, 0.04, "left", "bottom"),
    "centre": (0.5, 0.5, "center", "middle"),
}  # fmt: skip


def _curve(made: Builder, mark: Curve) -> None:
    colour = made.colour(mark.colour)
    trace = _scatter(made, mark.x, mark.y) | {
        "mode": "lines+markers" if mark.marker else "lines", "opacity": mark.opacity,
        "line": line_style(colour, mark.dash, mark.width)
        | {"shape": "hv" if mark.steps else "linear"},
    }  # fmt: skip
    if mark.marker:
        trace["marker"] = marker_style(mark.marker, 5.0, colour)
    made.add(trace, mark.label, mark.rows)


def _scatter(made: Builder, x: ArrayLike, y: ArrayLike) -> Trace:
    if made.subplot:
        return {"type": "scatterpolar", "theta": pack(x), "r": pack(y)}
    return {"type": "scatter", "x": pack(x), "y": pack(y)}


def _points(made: Builder, mark: Points) -> None:
    if mark.values is not None and mark.scale is not None:
        marker = marker_style(mark.marker, mark.size, "") | colour_keys(mark.values, mark.scale)
    else:
        marker = marker_style(mark.marker, mark.size, made.colour(mark.colour), mark.is_filled)
    trace = _scatter(made, mark.x, mark.y) | {
        "mode": "markers", "marker": marker, "opacity": mark.opacity,
    }  # fmt: skip
    if mark.names:
        trace["text"] = list(mark.names)
    made.add(trace, mark.label, mark.rows)


def _band(made: Builder, mark: Band) -> None:
    colour = made.colour(mark.colour)
    line = {"width": 0, "shape": "hv" if mark.steps else "linear"}
    hidden = {"mode": "lines", "line": line, "hoverinfo": "skip"}
    made.add(_scatter(made, mark.x, mark.low) | hidden)
    fill = {
        "fill": "tonext" if made.subplot else "tonexty",
        "fillcolor": rgba(colour, mark.opacity),
    }
    made.add(_scatter(made, mark.x, mark.high) | hidden | fill, mark.label)


def _area(made: Builder, mark: Area) -> None:
    colour = made.colour(mark.colour)
    made.add(
        _scatter(made, mark.x, mark.y)
        | {
            "mode": "lines", "line": {"width": 0}, "fill": "toself", "hoverinfo": "skip",
            "fillcolor": rgba(colour, mark.opacity),
        },
        mark.label,
    )  # fmt: skip


def _rule(made: Builder, mark: Rule) -> None:
    ends = _across(made, mark.direction, mark.value, mark.value)
    line = line_style(made.colour(mark.colour), mark.dash, mark.width)
    shape = {"type": "line", "line": line, **ends, **made.entry(mark.label)}
    made.layout.setdefault("shapes", []).append(shape)


def _span(made: Builder, mark: Span) -> None:
    ends = _across(made, mark.direction, mark.low, mark.high)
    fill = rgba(made.colour(mark.colour), mark.opacity)
    shape = {"type": "rect", "line": {"width": 0}, "fillcolor": fill, "layer": "below", **ends}
    made.layout.setdefault("shapes", []).append(shape | made.entry(mark.label))


def _across(made: Builder, direction: str, low: float, high: float) -> dict[str, Any]:
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


def _bars(made: Builder, mark: Bars) -> None:
    at, values = np.asarray(mark.at, dtype=float), np.asarray(mark.values, dtype=float)
    base = np.broadcast_to(np.asarray(mark.base, dtype=float), values.shape)
    width = np.broadcast_to(np.asarray(mark.width, dtype=float), values.shape)
    along, across = ("x", "y") if mark.direction == "x" else ("y", "x")
    trace = {
        "type": "bar", "orientation": "h" if mark.direction == "x" else "v",
        along: pack(values - base), across: pack(at), "width": pack(width),
        "marker": {"color": made.colour(mark.colour)}, "opacity": mark.opacity,
    }  # fmt: skip
    if base.any():
        trace["base"] = pack(base)
    made.layout["barmode"] = "overlay"
    made.add(trace, mark.label, mark.rows)


def _segments(made: Builder, mark: Segments) -> None:
    at, low, high = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, dtype=float)) for v in (mark.at, mark.low, mark.high))
    )
    gap = np.full(at.shape, np.nan)
    across = np.column_stack((at, at, gap)).ravel()
    along = np.column_stack((low, high, gap)).ravel()
    colour = made.colour(mark.colour)
    x, y = (along, across) if mark.direction == "x" else (across, along)
    trace = _scatter(made, x, y) | {
        "mode": "lines", "line": line_style(colour, "solid", mark.width), "opacity": mark.opacity,
    }  # fmt: skip
    if mark.has_caps:
        symbol = "line-ns" if mark.direction == "x" else "line-ew"
        line = {"color": colour, "width": 1.5}
        trace |= {"mode": "lines+markers", "marker": {"symbol": symbol, "size": 8, "line": line}}
    rows = mark.rows
    if rows is not None and not isinstance(rows, int):
        rows = np.repeat(rows, 3).tolist()  # two ends and the gap
    made.add(trace, mark.label, rows)


def _boxes(made: Builder, mark: Boxes) -> None:
    colour = made.colour(mark.colour)
    names = ("lowerfence", "q1", "median", "q3", "upperfence")
    quantiles = np.asarray(mark.quantiles, dtype=float)
    across = "x" if mark.direction == "y" else "y"
    trace = {
        "type": "box", "orientation": "v" if mark.direction == "y" else "h", "width": mark.width,
        across: np.asarray(mark.at, dtype=float).tolist(), "line": {"color": colour, "width": 1.2},
        "fillcolor": rgba(colour, 0.35),
        **{name: row.tolist() for name, row in zip(names, quantiles, strict=True)},
    }  # fmt: skip
    made.add(trace, mark.label, mark.rows)


def _map(made: Builder, mark: Map) -> None:
    values = np.asarray(mark.values, dtype=float)
    trace = {
        "type": "heatmap", "x": pack(mark.x), "y": pack(mark.y), "zmin": 0.0, "zmax": 1.0,
        "z": pack(to_scale(values, mark.scale)), "colorscale": colour_stops(mark.scale),
        "showscale": False, "xgap": 1, "ygap": 1, "hoverongaps": False,
        # A heat map takes no packed array of other values than z.
        "text": [[f"{value:.4g}" for value in row] for row in values.tolist()],
        "hovertemplate": "%{text}<extra></extra>",
    }  # fmt: skip
    if mark.has_numbers:
        trace |= {"texttemplate": "%{text}", "textfont": {"size": 10}}
    made.add(trace)


def _note(made: Builder, mark: Note) -> None:
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


ADD_MARK: dict[type, Callable[..., None]] = {
    Curve: _curve, Points: _points, Band: _band, Area: _area, Rule: _rule, Span: _span,
    Bars: _bars, Segments: _segments, Boxes: _boxes, Map: _map, Note: _note,
}  # fmt: skip
