"""The figure of plotly.js that is being built, and its arrays, lines, markers and colours."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import cycle
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.show.charts import Chart
from hillsphere.show.colours import ColourScale, hex_colour
from hillsphere.show.marks import Rows

__all__ = [
    "Builder", "Trace", "colour_keys", "colour_stops", "line_style", "marker_px", "marker_style",
    "pack", "rgba", "to_scale",
]  # fmt: skip

Trace: TypeAlias = dict[str, Any]
_DASHES = {"solid": "solid", "dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_MARKERS = {
    "dot": "circle", "circle": "circle", "square": "square", "diamond": "diamond",
    "triangle": "triangle-up", "triangle-down": "triangle-down", "cross": "x-thin",
    "plus": "cross-thin", "star": "star", "bar": "line-ns",
}  # fmt: skip
_THIN = ("cross", "plus", "bar")
_PIXELS = 96.0 / 72.0
"""CSS pixels per point."""
_EXACT_PART = 1e-4
"""Smallest ratio of the range of an array to its largest value at which single precision, with a
relative error of 6e-8, shows no steps on a screen of 2000 pixels."""


@dataclass
class Builder:
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
        """Return a colour by its name, the next of the panel's for none."""
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
        """Add a text at a place."""
        note = {"text": text, "x": x, "y": y, "showarrow": False, "font": {"size": 11}, **keys}
        self.layout.setdefault("annotations", []).append(note)


def pack(values: ArrayLike) -> Any:
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


def line_style(colour: str, dash: str, width: float) -> dict[str, Any]:
    """Return the keys of a line, its width in points."""
    return {"color": colour, "dash": _DASHES[dash], "width": width * _PIXELS}


def marker_px(shape: str, size: float) -> float:
    """Return the size of a marker; a small dot of matplotlib has half of its nominal size."""
    return size * _PIXELS * (0.5 if shape == "dot" else 1.0)


def marker_style(shape: str, size: float, colour: str, is_filled: bool = True) -> dict[str, Any]:
    """Return the keys of a marker, its size in points."""
    made: dict[str, Any] = {
        "symbol": _MARKERS[shape], "size": marker_px(shape, size), "color": colour,
    }  # fmt: skip
    # A thin marker has only a border.
    if shape in _THIN or not is_filled:
        made["line"] = {"color": colour, "width": 1.5}
        if shape not in _THIN:
            made["symbol"] = f"{_MARKERS[shape]}-open"
    return made


def colour_keys(values: ArrayLike, scale: ColourScale) -> dict[str, Any]:
    """Return the keys that colour points by values; the bar is drawn once, apart from them."""
    return {
        "color": pack(to_scale(values, scale)), "cmin": 0.0, "cmax": 1.0,
        "colorscale": colour_stops(scale), "showscale": False,
    }  # fmt: skip


def to_scale(values: ArrayLike, scale: ColourScale) -> Any:
    """Return the places of values on a scale, from 0 to 1; NaN stays."""
    width = scale.high - scale.low
    array = np.asarray(values, dtype=float)
    part = (array - scale.low) / width if width > 0.0 else np.where(np.isnan(array), array, 0.5)
    return np.clip(part, 0.0, 1.0) ** scale.power


def colour_stops(scale: ColourScale) -> list[list[Any]]:
    """Return a colour scale from 0 to 1 as plotly.js takes it."""
    last = len(scale.stops) - 1
    return [[i / last, colour] for i, colour in enumerate(scale.stops)]


def rgba(colour: str, opacity: float) -> str:
    """Return a colour with its opacity."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"
