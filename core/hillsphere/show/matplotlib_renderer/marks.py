"""Drawing of the marks of a flat panel with matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

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
from hillsphere.show.matplotlib_renderer.styles import (
    DASHES,
    MARKERS,
    Colours,
    legend_label,
    named_colour,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["DRAW_MARK"]

_MOST_DOTS = 3000
"""Points of one mark beyond which they are drawn as an image: an SVG of more is slow to open."""
_CORNERS = {
    "top right": (0.98, 0.96, "right", "top"), "top left": (0.02, 0.96, "left", "top"),
    "bottom right": (0.98, 0.04, "right", "bottom"), "bottom left": (0.02, 0.04, "left", "bottom"),
    "centre": (0.5, 0.5, "center", "center"),
}  # fmt: skip
_CELLS_WITH_LINES = 2500
"""Cells of a map up to which white lines separate them; of more the lines would be all one sees."""


def _curve(axes: Axes, mark: Curve, colours: Colours, x: Any = None) -> None:
    axes.plot(
        mark.x if x is None else x, mark.y, color=named_colour(mark.colour, colours),
        linestyle=DASHES[mark.dash], linewidth=mark.width, alpha=mark.opacity,
        marker=MARKERS[mark.marker], drawstyle="steps-post" if mark.steps else "default",
        label=legend_label(mark.label),
    )  # fmt: skip


def _points(axes: Axes, mark: Points, colours: Colours, x: Any = None) -> None:
    at = mark.x if x is None else x
    if mark.values is not None and mark.scale is not None:
        values = np.asarray(mark.values, dtype=float)
        axes.scatter(
            at, mark.y, s=mark.size**2, c=[mark.scale.colour(v) for v in values.tolist()],
            marker=MARKERS[mark.marker], alpha=mark.opacity, label=legend_label(mark.label),
            rasterized=values.size > _MOST_DOTS,
        )  # fmt: skip
        return
    colour = named_colour(mark.colour, colours)
    axes.plot(
        at, mark.y, MARKERS[mark.marker], color=colour, markersize=mark.size,
        markerfacecolor=colour if mark.is_filled else "none", alpha=mark.opacity, linestyle="",
        label=legend_label(mark.label), rasterized=np.size(mark.y) > _MOST_DOTS,
    )  # fmt: skip


def _band(axes: Axes, mark: Band, colours: Colours, x: Any = None) -> None:
    axes.fill_between(
        mark.x if x is None else x, mark.low, mark.high,
        color=named_colour(mark.colour, colours), alpha=mark.opacity, linewidth=0,
        step="post" if mark.steps else None, label=legend_label(mark.label),
    )  # fmt: skip


def _area(axes: Axes, mark: Area, colours: Colours) -> None:
    axes.fill(mark.x, mark.y, color=named_colour(mark.colour, colours), alpha=mark.opacity,
              label=legend_label(mark.label))  # fmt: skip


def _rule(axes: Axes, mark: Rule, colours: Colours) -> None:
    draw = axes.axvline if mark.direction == "x" else axes.axhline
    draw(mark.value, color=named_colour(mark.colour, colours), linestyle=DASHES[mark.dash],
         linewidth=mark.width, label=legend_label(mark.label))  # fmt: skip


def _span(axes: Axes, mark: Span, colours: Colours) -> None:
    draw = axes.axvspan if mark.direction == "x" else axes.axhspan
    draw(mark.low, mark.high, color=named_colour(mark.colour, colours), alpha=mark.opacity,
         linewidth=0, label=legend_label(mark.label))  # fmt: skip


def _bars(axes: Axes, mark: Bars, colours: Colours) -> None:
    base = np.asarray(mark.base, dtype=float)
    lengths = np.asarray(mark.values, dtype=float) - base
    options: dict[str, Any] = {
        "color": named_colour(mark.colour, colours), "alpha": mark.opacity,
        "label": legend_label(mark.label),
    }  # fmt: skip
    if mark.direction == "x":
        axes.barh(mark.at, lengths, height=mark.width, left=base, **options)
    else:
        axes.bar(mark.at, lengths, width=mark.width, bottom=base, **options)


def _segments(axes: Axes, mark: Segments, colours: Colours) -> None:
    at, low, high = (
        np.atleast_1d(np.asarray(v, dtype=float)) for v in (mark.at, mark.low, mark.high)
    )
    at, low, high = np.broadcast_arrays(at, low, high)
    gap = np.full(at.shape, np.nan)
    across, along = (np.column_stack(v).ravel() for v in ((at, at, gap), (low, high, gap)))
    caps = {"x": "|", "y": "_"}[mark.direction] if mark.has_caps else ""
    x, y = (along, across) if mark.direction == "x" else (across, along)
    axes.plot(x, y, color=named_colour(mark.colour, colours), linewidth=mark.width, marker=caps,
              alpha=mark.opacity, solid_capstyle="butt",
              label=legend_label(mark.label))  # fmt: skip


def _boxes(axes: Axes, mark: Boxes, colours: Colours) -> None:
    colour, at = named_colour(mark.colour, colours), np.asarray(mark.at, dtype=float)
    least, first, median, third, largest = np.asarray(mark.quantiles, dtype=float)
    half = np.full(at.shape, 0.5 * mark.width)
    options: dict[str, Any] = {"color": colour, "alpha": 0.5, "label": legend_label(mark.label)}
    if mark.direction == "y":
        axes.bar(at, third - first, width=mark.width, bottom=first, **options)
        lines: tuple[Any, Any] = (axes.vlines, axes.hlines)
    else:
        axes.barh(at, third - first, height=mark.width, left=first, **options)
        lines = (axes.hlines, axes.vlines)
    along, across = lines
    along(at, least, first, color="black", linewidth=1.0)
    along(at, third, largest, color="black", linewidth=1.0)
    across(median, at - half, at + half, color="black", linewidth=1.4)


def _map(axes: Axes, mark: Map, colours: Colours) -> None:
    from matplotlib.colors import LinearSegmentedColormap, PowerNorm

    values = np.ma.masked_invalid(np.asarray(mark.values, dtype=float))
    scale = mark.scale
    has_lines = values.size <= _CELLS_WITH_LINES
    axes.pcolormesh(
        mark.x, mark.y, values, cmap=LinearSegmentedColormap.from_list("scale", scale.stops),
        norm=PowerNorm(scale.power, vmin=scale.low, vmax=scale.high),
        edgecolors="white" if has_lines else "none", linewidth=0.4 if has_lines else 0.0,
        rasterized=not has_lines,
    )  # fmt: skip
    if not mark.has_numbers:
        return
    x, y = (np.convolve(np.asarray(edges, dtype=float), [0.5, 0.5], "valid")
            for edges in (mark.x, mark.y))  # fmt: skip
    for (row, column), value in np.ndenumerate(np.asarray(mark.values, dtype=float)):
        if np.isfinite(value):
            is_dark = _luminance(scale.colour(float(value))) < 0.5
            axes.text(
                float(x[column]), float(y[row]), f"{value:.3g}", ha="center", va="center",
                fontsize=7, color="white" if is_dark else "black",
            )  # fmt: skip


def _luminance(colour: str) -> float:
    """Return the relative luminance of a colour, by the weights of ITU-R BT.709."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _note(axes: Axes, mark: Note, colours: Colours) -> None:
    colour = hex_colour(mark.colour)
    if mark.x is not None and mark.y is not None:
        right, above = ("left" not in mark.corner), ("bottom" not in mark.corner)
        is_centred = mark.corner == "centre"
        axes.annotate(
            mark.text, (mark.x, mark.y), fontsize=8, zorder=6, color=colour,
            xytext=(0, 0) if is_centred else (5 if right else -5, 4 if above else -4),
            textcoords="offset points", ha="center" if is_centred else "left" if right else "right",
            va="center" if is_centred else "bottom" if above else "top",
        )  # fmt: skip
        return
    x, y, ha, va = _CORNERS[mark.corner]
    axes.text(
        x, y, mark.text, transform=axes.transAxes, ha=ha, va=va, fontsize=8, color=colour,
        wrap=mark.corner == "centre",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2},
    )  # fmt: skip


DRAW_MARK: dict[type, Callable[..., None]] = {
    Curve: _curve, Points: _points, Band: _band, Area: _area, Rule: _rule, Span: _span,
    Bars: _bars, Segments: _segments, Boxes: _boxes, Map: _map, Note: _note,
}  # fmt: skip
