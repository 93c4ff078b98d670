"""Figures of a sweep: metrics and failure ratios over the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from textwrap import fill

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.presentation import (
    Axis,
    Band,
    ColourScale,
    Curve,
    Map,
    Mark,
    Panel,
    Points,
    Segments,
)
from hillsphere.products import CaseTable
from hillsphere_campaigns.figures import LINE_LENGTH, format_name, quantity_axis

__all__ = ["MOST_POINTS", "PointLayout", "PointValues", "layout_points", "sweep_panels"]

MOST_POINTS = 60
"""Points that are drawn by name, side by side."""
_MOST_TICKS = 15, 10
"""Names of values at most along the axis of a line, and of a map, whose panel is narrower."""
_NUMBERED = 64
"""Cells of a map up to which each has room for its number."""
_WIDE = 30.0
"""Ratio of the largest to the smallest value of a swept quantity from which on its axis is
logarithmic."""


@dataclass(frozen=True)
class PointLayout:
    """How the points of a sweep are laid out in a figure.

    Parameters
    ----------
    axes : tuple of Axis
        Axes of the one or two quantities; none if the points are drawn by name.
    ticks : tuple of tuple of str
        Names of the values of each, ascending; of the points if these are drawn by name.
    values : tuple of ndarray
        The values of each; places 0, 1 … for what is no number.
    places : ndarray of int, shape (1 or 2, P)
        Place of each point among these; −1 for a point that is not drawn.
    """

    axes: tuple[Axis, ...]
    ticks: tuple[tuple[str, ...], ...]
    values: tuple[Array, ...]
    places: Integers

    @property
    def is_map(self) -> bool:
        """Whether the points fill a rectangle of two quantities."""
        return len(self.axes) == 2


@dataclass(frozen=True)
class PointValues:
    """One quantity at the P points: a value, and where it has one, a lower and an upper end."""

    axis: Axis
    value: Array
    low: Array | None = None
    high: Array | None = None


def layout_points(table: CaseTable) -> PointLayout:
    """Lay out the points of a sweep: over one quantity, a rectangle of two, or else by name."""
    assert table.points is not None
    count = table.points.shape[1]
    if len(table.swept) in (1, 2):
        axes = [np.unique(row, return_inverse=True) for row in table.points]
        places = np.array([place for _, place in axes])
        size = [value.size for value, _ in axes]
        if np.prod(size) == count == np.unique(places, axis=1).shape[1]:
            ticks = tuple(_ticks(table, axis, value) for axis, (value, _) in enumerate(axes))
            said = table.swept_labels or ("",) * len(table.swept)
            labels = tuple(map(quantity_axis, table.swept, table.swept_units, said))
            values = tuple(
                value if unit else np.arange(float(value.size))
                for unit, (value, _) in zip(table.swept_units, axes, strict=True)
            )
            return PointLayout(labels, ticks, values, places)
    places = np.where(np.arange(count) < MOST_POINTS, np.arange(count), -1)[None]
    drawn = min(count, MOST_POINTS)
    names = tuple(format_name(label) for label in table.point_labels[:drawn])
    if drawn > 8 or max(map(len, names)) > 16:
        names = tuple(map(str, range(drawn)))
    return PointLayout((), (names,), (np.arange(float(drawn)),), places)


def _ticks(table: CaseTable, axis: int, values: Array) -> tuple[str, ...]:
    assert table.points is not None
    if table.swept_units[axis]:
        return tuple(f"{value:.4g}" for value in values)
    # No number: what the points are called, "NAME = VALUE, NAME = VALUE" or a name of their own.
    ticks = []
    for value in values:
        label = table.point_labels[int(np.flatnonzero(table.points[axis] == value)[0])]
        parts = label.split(", ")
        if len(parts) == len(table.swept):
            name, _, said = parts[axis].partition(" = ")
            ticks.append(format_name(said or name)[:24])
        else:
            ticks.append(f"no. {value:.0f}")
    return tuple(ticks)


def sweep_panels(
    layout: PointLayout, shown: Sequence[PointValues], band: str, lines: str
) -> list[Panel]:
    """Return quantities over the points of a sweep, a panel each; a row is a point.

    Parameters
    ----------
    layout : PointLayout
        Where the points lie.
    shown : sequence of PointValues
        What is drawn.
    band : str
        What the ends of each quantity are.
    lines : str
        What the value is.
    """
    if layout.is_map:
        return [_map(layout, one) for one in shown]
    return [_line(layout, one, band, lines) for one in shown]


def _line(layout: PointLayout, one: PointValues, band: str, lines: str) -> Panel:
    points = np.flatnonzero(layout.places[0] >= 0)
    points = points[np.argsort(layout.places[0, points], kind="stable")]
    rows = points.tolist()
    x, value = layout.values[0], one.value[points]
    by_number = bool(layout.axes) and not _are_places(x, layout.ticks[0])
    marks: list[Mark] = []
    if one.low is not None and one.high is not None:
        low, high = one.low[points], one.high[points]
        if by_number and "interval" not in band:
            marks.append(Band(x, low, high, band, opacity=0.45))
        else:
            marks.append(Segments(x, low, high, "y", band, "blue", rows=rows))
    if by_number:
        marks.append(Curve(x, value, lines, "blue", marker="circle", rows=rows))
        is_wide = x.min() > 0 and x.max() > _WIDE * x.min()
        axis = replace(layout.axes[0], scale="log" if is_wide else "linear")
    else:
        marks.append(Points(x, value, lines, "blue", size=4.0, rows=rows))
        step = -(-x.size // _MOST_TICKS[0])
        ticks = list(zip(x[::step].tolist(), layout.ticks[0][::step], strict=True))
        own = layout.axes[0] if layout.axes else Axis("number of the point in the table")
        axis = replace(own, ticks=ticks)
    return Panel(axis, one.axis, marks)


def _are_places(x: Array, ticks: Sequence[str]) -> bool:
    return any(tick != f"{value:.4g}" for value, tick in zip(x, ticks, strict=True))


def _map(layout: PointLayout, one: PointValues) -> Panel:
    nx, ny = (value.size for value in layout.values)
    cells = np.full((ny, nx), np.nan)
    cells[layout.places[1], layout.places[0]] = one.value
    known = cells[np.isfinite(cells)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    scale = ColourScale(one.axis.label, one.axis.unit, low, high)
    x, y = (
        replace(axis, ticks=list(enumerate(ticks))[:: -(-len(ticks) // _MOST_TICKS[1])])
        for axis, ticks in zip(layout.axes, layout.ticks, strict=True)
    )
    y = replace(y, label=fill(y.label, LINE_LENGTH))
    edges = [np.arange(count + 1) - 0.5 for count in (nx, ny)]
    return Panel(x, y, [Map(edges[0], edges[1], cells, scale, has_numbers=nx * ny <= _NUMBERED)])
