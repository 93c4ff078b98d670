"""Drawing of charts with matplotlib, for SVG and PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

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
    Rule,
    Segments,
    Sky,
    Space,
    Span,
    Surface,
    scales_of,
)
from hillsphere.show.colours import LINE_COLOURS, ColourScale, hex_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["draw_chart"]

_DASHES = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}
_MARKERS = {
    "": "", "dot": ".", "circle": "o", "square": "s", "diamond": "D", "triangle": "^",
    "triangle-down": "v", "cross": "x", "plus": "+", "star": "*", "bar": "|",
}  # fmt: skip
_MOST_DOTS = 3000
"""Points of one mark beyond which they are drawn as an image: an SVG of more is slow to open."""
_CORNERS = {
    "top right": (0.98, 0.96, "right", "top"), "top left": (0.02, 0.96, "left", "top"),
    "bottom right": (0.98, 0.04, "right", "bottom"), "bottom left": (0.02, 0.04, "left", "bottom"),
    "centre": (0.5, 0.5, "center", "center"),
}  # fmt: skip
_MOST_LEGEND_ENTRIES = 14
"""Entries beyond which a legend is set in smaller type and two columns."""
_PLAIN = (5e-5, 2e5)
"""Ends of a logarithmic axis between which its numbers are written in full, with six digits at
most."""
_CELLS_WITH_LINES = 2500
"""Cells of a map up to which white lines separate them; of more the lines would be all one sees."""

Colours: TypeAlias = Iterator[str]


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
        _set_log_ticks(axes)
    _colour_bars(figure, chart, drawn)
    if chart.shared_legend:
        _legend_below(figure, drawn)


def _panel(axes: Axes, panel: Panel, has_legend: bool) -> None:
    colours = _palette()
    for mark in panel.marks:
        _MARKS[type(mark)](axes, mark, colours)
    _axis(axes, "x", panel.x)
    _axis(axes, "y", panel.y)
    if panel.is_equal:
        axes.set_aspect("equal", adjustable="box" if _has_ends(panel) else "datalim")
    if panel.title:
        axes.set_title(panel.title, fontsize=10)
    if any(isinstance(mark, Map) for mark in panel.marks):
        axes.grid(visible=False)
    if has_legend and panel.legend != "none":
        _legend(axes, panel.legend)


def _has_ends(panel: Panel) -> bool:
    return None not in (panel.x.low, panel.x.high, panel.y.low, panel.y.high)


def _sky(axes: Any, panel: Sky, has_legend: bool) -> None:
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    colours = _palette()
    for mark in panel.marks:
        turned = np.radians(np.asarray(mark.x, dtype=float))
        _MARKS[type(mark)](axes, mark, colours, turned)
    axes.set_ylim(0.0, 90.0)
    axes.set_yticks([30.0, 60.0, 90.0], ["60°", "30°", ""], fontsize=7)
    axes.set_xticks(np.radians([0.0, 90.0, 180.0, 270.0]), ["N", "E", "S", "W"])
    axes.tick_params(pad=0)
    axes.set_title(panel.title, fontsize=9)
    axes.set_xlabel(panel.note, fontsize=8)
    if has_legend:
        _legend(axes, "best")


def _space(axes: Any, panel: Space, has_legend: bool) -> None:
    colours = _palette()
    for solid in panel.solids:
        _SOLIDS[type(solid)](axes, solid, colours)
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
        _legend(axes, "upper left")


_PANELS: dict[type, Callable[..., None]] = {Panel: _panel, Sky: _sky, Space: _space}


def _palette() -> Colours:
    return cycle(LINE_COLOURS)


def _colour(name: str, colours: Colours) -> str:
    return hex_colour(name or next(colours))


def _label(text: str) -> str | None:
    return text or None


def _curve(axes: Axes, mark: Curve, colours: Colours, x: Any = None) -> None:
    axes.plot(
        mark.x if x is None else x, mark.y, color=_colour(mark.colour, colours),
        linestyle=_DASHES[mark.dash], linewidth=mark.width, alpha=mark.opacity,
        marker=_MARKERS[mark.marker], drawstyle="steps-post" if mark.steps else "default",
        label=_label(mark.label),
    )  # fmt: skip


def _points(axes: Axes, mark: Points, colours: Colours, x: Any = None) -> None:
    at = mark.x if x is None else x
    if mark.values is not None and mark.scale is not None:
        values = np.asarray(mark.values, dtype=float)
        axes.scatter(
            at, mark.y, s=mark.size**2, c=[mark.scale.colour(v) for v in values.tolist()],
            marker=_MARKERS[mark.marker], alpha=mark.opacity, label=_label(mark.label),
            rasterized=values.size > _MOST_DOTS,
        )  # fmt: skip
        return
    colour = _colour(mark.colour, colours)
    axes.plot(
        at, mark.y, _MARKERS[mark.marker], color=colour, markersize=mark.size,
        markerfacecolor=colour if mark.is_filled else "none", alpha=mark.opacity, linestyle="",
        label=_label(mark.label), rasterized=np.size(mark.y) > _MOST_DOTS,
    )  # fmt: skip


def _band(axes: Axes, mark: Band, colours: Colours, x: Any = None) -> None:
    axes.fill_between(
        mark.x if x is None else x, mark.low, mark.high,
        color=_colour(mark.colour, colours), alpha=mark.opacity, linewidth=0,
        step="post" if mark.steps else None, label=_label(mark.label),
    )  # fmt: skip


def _area(axes: Axes, mark: Area, colours: Colours) -> None:
    axes.fill(mark.x, mark.y, color=_colour(mark.colour, colours), alpha=mark.opacity,
              label=_label(mark.label))  # fmt: skip


def _rule(axes: Axes, mark: Rule, colours: Colours) -> None:
    draw = axes.axvline if mark.direction == "x" else axes.axhline
    draw(mark.value, color=_colour(mark.colour, colours), linestyle=_DASHES[mark.dash],
         linewidth=mark.width, label=_label(mark.label))  # fmt: skip


def _span(axes: Axes, mark: Span, colours: Colours) -> None:
    draw = axes.axvspan if mark.direction == "x" else axes.axhspan
    draw(mark.low, mark.high, color=_colour(mark.colour, colours), alpha=mark.opacity,
         linewidth=0, label=_label(mark.label))  # fmt: skip


def _bars(axes: Axes, mark: Bars, colours: Colours) -> None:
    base = np.asarray(mark.base, dtype=float)
    lengths = np.asarray(mark.values, dtype=float) - base
    options: dict[str, Any] = {
        "color": _colour(mark.colour, colours), "alpha": mark.opacity, "label": _label(mark.label),
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
    axes.plot(x, y, color=_colour(mark.colour, colours), linewidth=mark.width, marker=caps,
              alpha=mark.opacity, solid_capstyle="butt", label=_label(mark.label))  # fmt: skip


def _boxes(axes: Axes, mark: Boxes, colours: Colours) -> None:
    colour, at = _colour(mark.colour, colours), np.asarray(mark.at, dtype=float)
    least, first, median, third, largest = np.asarray(mark.quantiles, dtype=float)
    half = np.full(at.shape, 0.5 * mark.width)
    options: dict[str, Any] = {"color": colour, "alpha": 0.5, "label": _label(mark.label)}
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


_MARKS: dict[type, Callable[..., None]] = {
    Curve: _curve, Points: _points, Band: _band, Area: _area, Rule: _rule, Span: _span,
    Bars: _bars, Segments: _segments, Boxes: _boxes, Map: _map, Note: _note,
}  # fmt: skip


def _path(axes: Any, solid: Path, colours: Colours) -> None:
    axes.plot(*np.asarray(solid.points, dtype=float), color=_colour(solid.colour, colours),
              linestyle=_DASHES[solid.dash], linewidth=solid.width, alpha=solid.opacity,
              label=_label(solid.label))  # fmt: skip


def _cloud(axes: Any, solid: Cloud, colours: Colours) -> None:
    points = np.asarray(solid.points, dtype=float)
    if solid.values is not None and solid.scale is not None:
        shades: Any = [solid.scale.colour(v) for v in np.asarray(solid.values, float).tolist()]
    else:
        shades = _colour(solid.colour, colours)
    axes.scatter(*points, s=solid.size**2, c=shades, marker=_MARKERS[solid.marker],
                 alpha=solid.opacity, label=_label(solid.label))  # fmt: skip


def _surface(axes: Any, solid: Surface, colours: Colours) -> None:
    points = np.asarray(solid.points, dtype=float)
    options: dict[str, Any] = {"color": _colour(solid.colour, colours)}
    if solid.values is not None and solid.scale is not None:
        values = np.asarray(solid.values, dtype=float)
        options = {"facecolors": _shades(values, solid.scale), "shade": False}
    axes.plot_surface(*points, alpha=solid.opacity, linewidth=0, antialiased=True,
                      rcount=points.shape[1], ccount=points.shape[2], **options)  # fmt: skip


def _shades(values: Any, scale: ColourScale) -> Any:
    flat = [scale.colour(value) for value in values.ravel().tolist()]
    return np.array(flat, dtype=object).reshape(values.shape)


def _mesh(axes: Any, solid: Mesh, colours: Colours) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    vertices, facets = np.asarray(solid.vertices, dtype=float), np.asarray(solid.facets)
    corners = vertices.T[facets]
    if solid.values is not None and solid.scale is not None:
        shades: Any = [solid.scale.colour(v) for v in np.asarray(solid.values, float).tolist()]
    else:
        shades = _colour(solid.colour, colours)
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=shades, alpha=solid.opacity, linewidths=0, shade=True)
    )
    axes.auto_scale_xyz(*vertices)


def _arrows(axes: Any, solid: Arrows, colours: Colours) -> None:
    start, vector = (np.asarray(v, dtype=float) for v in (solid.start, solid.vector))
    axes.quiver(*start, *vector, color=_colour(solid.colour, colours), linewidth=solid.width,
                arrow_length_ratio=0.15, label=_label(solid.label))  # fmt: skip


_SOLIDS: dict[type, Callable[..., None]] = {
    Path: _path, Cloud: _cloud, Surface: _surface, Mesh: _mesh, Arrows: _arrows,
}  # fmt: skip


def _axis(axes: Any, name: str, axis: Axis) -> None:
    from matplotlib.ticker import MultipleLocator

    if axis.text:
        getattr(axes, f"set_{name}label")(axis.text)
    if axis.scale == "log":
        getattr(axes, f"set_{name}scale")("log")
    if axis.ticks:
        places, texts = zip(*axis.ticks, strict=True)
        is_long = name == "x" and sum(map(len, texts)) > 40
        getattr(axes, f"set_{name}ticks")(places, texts, fontsize=8)
        if is_long:
            axes.tick_params(axis="x", rotation=25)
        axes.grid(axis=name, visible=False)
    elif axis.step is not None:
        getattr(axes, f"{name}axis").set_major_locator(MultipleLocator(axis.step))
    if axis.low is not None or axis.high is not None:
        getattr(axes, f"set_{name}lim")(axis.low, axis.high)
    if axis.is_reversed:
        getattr(axes, f"{name}axis").set_inverted(True)


def _set_log_ticks(axes: Any) -> None:
    """Set ticks of logarithmic axes, whose ranges are known when all panels are drawn.

    Up to two decades and a half have more ticks than the powers of ten, and numbers near one are
    written in full.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

    for name in "xy":
        if getattr(axes, f"get_{name}scale")() != "log":
            continue
        low, high = sorted(getattr(axes, f"get_{name}lim")())
        line = getattr(axes, f"{name}axis")
        line.set_minor_formatter(NullFormatter())
        if isinstance(line.get_major_locator(), FixedLocator):
            continue  # these ticks are the panel's own
        if high < 300.0 * low:
            steps = (1.0, 2.0, 5.0) if high > 6.0 * low else tuple(range(1, 10))
            line.set_major_locator(LogLocator(subs=steps))
        if low >= _PLAIN[0] and high <= _PLAIN[1]:
            line.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _legend(axes: Any, place: str) -> None:
    handles = _handles([axes])
    if not handles:
        return
    many = len(handles) > _MOST_LEGEND_ENTRIES
    options: dict[str, Any] = {"fontsize": 7 if many else 8}
    if place == "right":
        options |= {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "ncols": 2 if many else 1}
    elif place == "above":
        options |= {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 3}
    else:
        options |= {"loc": place, "ncols": 2 if many else 1}
    axes.legend(handles.values(), handles.keys(), **options)


def _legend_below(figure: MatplotlibFigure, drawn: Sequence[Axes]) -> None:
    handles = _handles(drawn)
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center",
                      ncols=min(len(handles), 4), fontsize=8)  # fmt: skip


def _handles(drawn: Iterable[Axes]) -> dict[str, Any]:
    """Return the entries of a legend, each label once."""
    handles: dict[str, Any] = {}
    for axes in drawn:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    return handles


def _colour_bars(figure: MatplotlibFigure, chart: Chart, drawn: Sequence[Axes]) -> None:
    """Draw one bar for all panels with the same scale, beside the last of them."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, PowerNorm

    users: dict[ColourScale, list[Axes]] = {}
    for panel, axes in zip(chart.panels, drawn, strict=True):
        for scale in scales_of(panel):
            users.setdefault(scale, []).append(axes)
    for scale, where in users.items():
        shades = LinearSegmentedColormap.from_list("scale", scale.stops)
        norm = PowerNorm(scale.power, vmin=scale.low, vmax=scale.high)
        text = f"{scale.label} ({scale.unit})" if scale.unit else scale.label
        is_space = any(axes.name == "3d" for axes in where)
        figure.colorbar(
            ScalarMappable(norm, shades), ax=where, label=text, fraction=0.05,
            pad=0.1 if is_space else 0.02, shrink=0.7 if is_space else 1.0,
        )  # fmt: skip
