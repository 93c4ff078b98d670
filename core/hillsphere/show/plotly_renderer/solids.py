"""Marks of a panel in three dimensions as traces of plotly.js."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.show.plotly_renderer.builder import (
    Builder,
    Trace,
    colour_keys,
    colour_stops,
    line_style,
    marker_px,
    pack,
    to_scale,
)
from hillsphere.show.solids import Arrows, Cloud, Mesh, Path, Surface

__all__ = ["ADD_SOLID"]

_SOLID_MARKERS = {"cross": "x", "plus": "cross", "square": "square", "diamond": "diamond"}
"""Marker shapes in three dimensions, where plotly.js has only a few; others are circles."""


def _path(made: Builder, solid: Path) -> None:
    trace = {
        "type": "scatter3d", "mode": "lines", "opacity": solid.opacity, **_xyz(solid.points),
        # Lines in space are thinner than their nominal width.
        "line": line_style(made.colour(solid.colour), solid.dash, 2.0 * solid.width),
    }  # fmt: skip
    made.add(trace, solid.label, solid.rows)
    if solid.times is not None:
        times = np.asarray(solid.times, dtype=float).tolist()
        trace["meta"] = {**trace.get("meta", {}), "times": times}


def _cloud(made: Builder, solid: Cloud) -> None:
    marker: dict[str, Any] = {
        "symbol": _SOLID_MARKERS.get(solid.marker, "circle"),
        "size": marker_px(solid.marker, solid.size),
    }
    if solid.values is not None and solid.scale is not None:
        marker |= colour_keys(solid.values, solid.scale)
    else:
        marker["color"] = made.colour(solid.colour)
    trace = {
        "type": "scatter3d", "mode": "markers", "opacity": solid.opacity, "marker": marker,
        **_xyz(solid.points),
    }  # fmt: skip
    if solid.names:
        trace["text"] = list(solid.names)
    made.add(trace, solid.label, solid.rows)


def _surface(made: Builder, solid: Surface) -> None:
    trace: Trace = {"type": "surface", "opacity": solid.opacity, "showscale": False,
                    "hoverinfo": "skip", **_xyz(solid.points)}  # fmt: skip
    if solid.values is not None and solid.scale is not None:
        trace |= {"surfacecolor": pack(to_scale(solid.values, solid.scale)), "cmin": 0.0,
                  "cmax": 1.0, "colorscale": colour_stops(solid.scale)}  # fmt: skip
    else:
        colour = made.colour(solid.colour)
        trace["colorscale"] = [[0.0, colour], [1.0, colour]]
    made.add(trace, solid.label)


def _mesh(made: Builder, solid: Mesh) -> None:
    facets = np.asarray(solid.facets, dtype=int).T.tolist()
    trace: Trace = {
        "type": "mesh3d", "opacity": solid.opacity, "flatshading": True, "hoverinfo": "skip",
        **_xyz(solid.vertices), **dict(zip("ijk", facets, strict=True)),
    }  # fmt: skip
    if solid.values is not None and solid.scale is not None:
        trace |= {
            "intensity": pack(to_scale(solid.values, solid.scale)), "intensitymode": "cell",
            "cmin": 0.0, "cmax": 1.0, "colorscale": colour_stops(solid.scale), "showscale": False,
        }  # fmt: skip
    else:
        trace["color"] = made.colour(solid.colour)
    made.add(trace, solid.label)


def _arrows(made: Builder, solid: Arrows) -> None:
    start, vector = (np.asarray(v, dtype=float) for v in (solid.start, solid.vector))
    gap = np.full(start.shape, np.nan)
    lines = np.stack((start, start + vector, gap), axis=2).reshape(3, -1)
    colour = made.colour(solid.colour)
    trace = {
        "type": "scatter3d", "mode": "lines", **_xyz(lines),
        "line": line_style(colour, "solid", 2.0 * solid.width),
    }  # fmt: skip
    made.add(trace, solid.label)
    heads = {"size": 3, "symbol": "diamond", "color": colour}
    tips = {"type": "scatter3d", "mode": "markers", "marker": heads, **_xyz(start + vector)}
    made.add(tips)


def _xyz(points: ArrayLike) -> dict[str, Any]:
    return {name: pack(row) for name, row in zip("xyz", np.asarray(points), strict=True)}


ADD_SOLID: dict[type, Callable[..., None]] = {
    Path: _path, Cloud: _cloud, Surface: _surface, Mesh: _mesh, Arrows: _arrows,
}  # fmt: skip
