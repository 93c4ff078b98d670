"""Figures of runs for plotly.js: read with suspicion, and laid over each other.

A figure of a run directory may be a stranger's. Only kinds of traces that a report draws are
passed on, and nothing that would load a picture or a map, or lead to another page.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.base.json_files import parse_json

__all__ = ["MAX_FIGURE_BYTES", "figure_json", "overlay", "read_figure"]

MAX_FIGURE_BYTES = 64 << 20
"""Largest figure that is read; the largest of the packaged missions has 2 MB."""
_DEFAULT_HEIGHT = 400  # pixels, of a figure that says none
_LARGEST_HEIGHT = 4000
"""Largest height in pixels: no figure may push the rest of a page out of reach."""

_TRACES = frozenset(
    {"scatter", "scatterpolar", "bar", "box", "heatmap", "scatter3d", "surface", "mesh3d"}
)
_OPAQUE = frozenset({"heatmap", "surface", "mesh3d"})
"""Traces that cover those of other runs; only the first run's are drawn."""
_LAYOUT = re.compile(
    r"[xy]axis\d*|scene\d*|polar\d*|coloraxis\d*|annotations|shapes|showlegend|legend|margin"
    r"|hovermode|barmode|meta"
)
"""Keys of a layout that a report uses."""
_DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
_LINK = re.compile(r"(?i)<\s*/?\s*a\b[^>]*>?")


def read_figure(data: bytes, path: str) -> dict[str, Any]:
    """Return the figure of a run, reduced to what a report draws.

    Parameters
    ----------
    data : bytes
        Content of ``figures/<id>.json``.
    path : str
        Its name, for messages.

    Raises
    ------
    InputError
        If it is not what a run writes.
    """
    try:
        figure = parse_json(data.decode("utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: is damaged: {error}") from error
    if (
        not isinstance(figure, dict)
        or not isinstance(figure.get("data"), list)
        or not isinstance(figure.get("layout"), dict)
        or not all(isinstance(trace, dict) for trace in figure["data"])
    ):
        raise InputError(f"{path}: is not the file that a run writes")
    height = figure.get("height")
    is_sound = isinstance(height, int) and 0 < height <= _LARGEST_HEIGHT
    return {
        "data": [_without_links(t) for t in figure["data"] if t.get("type") in _TRACES],
        "layout": _without_links(
            {key: value for key, value in figure["layout"].items() if _LAYOUT.fullmatch(key)}
        ),
        "height": height if is_sound else _DEFAULT_HEIGHT,
    }


def _without_links(value: Any) -> Any:
    """Return JSON without the tag ``<a>``, which plotly.js makes a link, and without pictures."""
    if isinstance(value, dict):
        return {key: _without_links(item) for key, item in value.items() if key != "images"}
    if isinstance(value, list):
        return [_without_links(item) for item in value]
    return _LINK.sub("", value) if isinstance(value, str) and "<" in value else value


def overlay(figures: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of several runs as one.

    Parameters
    ----------
    figures : mapping
        Letter of the run → its figure from `read_figure`. The first one gives the layout.

    Returns
    -------
    dict
        The traces of all, named after their runs, the lines of each run in its own dash.
    """
    first = next(iter(figures.values()))
    traces: list[dict[str, Any]] = []
    layout = {**first["layout"], "showlegend": True}
    for index, (letter, figure) in enumerate(figures.items()):
        own = [dict(trace) for trace in figure["data"] if not (index and trace["type"] in _OPAQUE)]
        for trace in own:
            _mark(trace, letter, index)
        if own and not any(trace.get("showlegend", True) for trace in own):
            # The first trace that can be seen stands for the run in the legend.
            shown = next((t for t in own if t.get("x") not in (None, [None])), own[0])
            shown |= {"name": letter, "showlegend": True}
        traces += own
    for key in [key for key in layout if re.match(r"[xy]axis", key)]:
        axes = [figure["layout"].get(key) for figure in figures.values()]
        ranges = [axis.get("range") if isinstance(axis, dict) else None for axis in axes]
        if isinstance(layout[key], dict) and any(one != ranges[0] for one in ranges):
            layout[key] = {k: v for k, v in layout[key].items() if k != "range"}
    return {"data": traces, "layout": layout, "height": first["height"]}


def _mark(trace: dict[str, Any], letter: str, index: int) -> None:
    """Name a trace after its run, and draw it so that it can be told apart."""
    trace.pop("meta", None)
    name = trace.get("name")
    trace["name"] = f"{letter}: {name}" if isinstance(name, str) and name else letter
    trace["legendgroup"] = trace["name"]
    if not index:
        return
    line = trace.get("line")
    if "lines" in str(trace.get("mode", "lines")) and trace["type"].startswith("scatter"):
        dash = _DASHES[index % len(_DASHES)]
        trace["line"] = {**(line if isinstance(line, dict) else {}), "dash": dash}
    elif trace["type"] in ("scatter", "scatterpolar", "scatter3d"):
        marker = trace.get("marker")
        symbol = ("circle", "square-open", "diamond-open", "x", "cross", "circle-open")[index % 6]
        trace["marker"] = {**(marker if isinstance(marker, dict) else {}), "symbol": symbol}
    elif trace["type"] == "bar":
        trace["opacity"] = 0.5


def figure_json(figure: Mapping[str, Any], path: str | Path) -> bytes:
    """Return a figure as JSON; `InputError` if it holds an infinity, which JSON lacks."""
    try:
        return json.dumps(figure, allow_nan=False, separators=(",", ":")).encode("ascii")
    except ValueError as error:
        raise InputError(f"{path}: is damaged: {error}") from error
