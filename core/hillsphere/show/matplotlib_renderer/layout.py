"""Axes, ticks, legends and colour bars of charts drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from hillsphere.show.charts import Axis, Chart, scales_of
from hillsphere.show.colours import ColourScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["add_colour_bars", "add_legend", "add_legend_below", "set_axis", "set_log_ticks"]

_MOST_LEGEND_ENTRIES = 14
"""Entries beyond which a legend is set in smaller type and two columns."""
_PLAIN = (5e-5, 2e5)
"""Ends of a logarithmic axis between which its numbers are written in full, with six digits at
most."""


def set_axis(axes: Any, name: str, axis: Axis) -> None:
    """Set label, scale, ticks and ends of the axis x, y or z."""
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


def set_log_ticks(axes: Any) -> None:
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


def add_legend(axes: Any, place: str) -> None:
    """Add the legend of one panel at its place."""
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


def add_legend_below(figure: MatplotlibFigure, drawn: Sequence[Axes]) -> None:
    """Add one legend of all panels below them."""
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


def add_colour_bars(figure: MatplotlibFigure, chart: Chart, drawn: Sequence[Axes]) -> None:
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
