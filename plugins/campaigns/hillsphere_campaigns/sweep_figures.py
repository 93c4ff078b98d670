"""Figures of a sweep: metrics and failure ratios over the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.presentation import PALETTE
from hillsphere.products import CaseTable
from hillsphere_campaigns.figures import axis_label, grid_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["MOST_POINTS", "PointValues", "Points", "draw_sweep", "points_of"]

MOST_POINTS = 60
"""Points that are drawn by name, side by side."""
_ROOM = 40
"""Characters of names that stand side by side below a panel; longer ones are slanted."""


@dataclass(frozen=True)
class Points:
    """How the points of a sweep are laid out in a figure.

    Parameters
    ----------
    labels : tuple of str
        Axis labels of the one or two quantities; none if the points are drawn by name.
    ticks : tuple of tuple of str
        Names of the values of each, ascending; of the points if these are drawn by name.
    values : tuple of ndarray
        The values of each; places 0, 1 … for what is no number.
    places : ndarray of int, shape (1 or 2, P)
        Place of each point among these; −1 for a point that is not drawn.
    """

    labels: tuple[str, ...]
    ticks: tuple[tuple[str, ...], ...]
    values: tuple[Array, ...]
    places: Integers

    @property
    def is_map(self) -> bool:
        """Whether the points fill a rectangle of two quantities."""
        return len(self.labels) == 2


@dataclass(frozen=True)
class PointValues:
    """One quantity at the P points: a value, and where it has one, a lower and an upper end."""

    label: str
    value: Array
    low: Array | None = None
    high: Array | None = None


def points_of(table: CaseTable) -> Points:
    """Lay out the points of a sweep: over one quantity, a rectangle of two, or else by name."""
    assert table.points is not None
    count = table.points.shape[1]
    if len(table.swept) in (1, 2):
        axes = [np.unique(row, return_inverse=True) for row in table.points]
        places = np.array([place for _, place in axes])
        size = [value.size for value, _ in axes]
        if np.prod(size) == count == np.unique(places, axis=1).shape[1]:
            ticks = tuple(_ticks(table, axis, value) for axis, (value, _) in enumerate(axes))
            labels = tuple(map(axis_label, table.swept, table.swept_units))
            values = tuple(
                value if unit else np.arange(float(value.size))
                for unit, (value, _) in zip(table.swept_units, axes, strict=True)
            )
            return Points(labels, ticks, values, places)
    places = np.where(np.arange(count) < MOST_POINTS, np.arange(count), -1)[None]
    drawn = min(count, MOST_POINTS)
    names = table.point_labels[:drawn]
    if drawn > 8 or max(map(len, names)) > 16:
        names = tuple(map(str, range(drawn)))
    return Points((), (names,), (np.arange(float(drawn)),), places)


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
            ticks.append((said or name)[:24])
        else:
            ticks.append(f"no. {value:.0f}")
    return tuple(ticks)


def draw_sweep(
    figure: Figure, points: Points, shown: Sequence[PointValues], band: str, lines: str
) -> None:
    """Draw quantities over the points of a sweep, a panel each.

    Parameters
    ----------
    figure : Figure
        Empty.
    points : Points
        Where the points lie.
    shown : sequence of PointValues
        What is drawn.
    band : str
        What the ends of each quantity are.
    lines : str
        What the value is.
    """
    for axes, one in zip(grid_of(figure, len(shown)), shown, strict=True):
        if points.is_map:
            _draw_map(figure, axes, points, one)
        else:
            _draw_line(axes, points, one, band, lines)
    if not points.is_map:
        handles, names = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2, fontsize=8)


def _draw_line(axes: Axes, points: Points, one: PointValues, band: str, lines: str) -> None:
    rows = np.flatnonzero(points.places[0] >= 0)
    rows = rows[np.argsort(points.places[0, rows], kind="stable")]
    x = points.values[0]
    value = one.value[rows]
    by_number = bool(points.labels) and not _are_places(x, points.ticks[0])
    if one.low is not None and one.high is not None:
        low, high = one.low[rows], one.high[rows]
        if by_number and "interval" not in band:
            axes.fill_between(x, low, high, color=PALETTE["sky"], alpha=0.45, lw=0, label=band)
        else:
            known = np.isfinite(low) & np.isfinite(high)
            axes.vlines(x[known], low[known], high[known], color=PALETTE["blue"], lw=1.4,
                        label=band)  # fmt: skip
    axes.plot(x, value, "o-" if by_number else "o", ms=4, color=PALETTE["blue"], label=lines)
    if by_number:
        if x.min() > 0 and x.max() > 30.0 * x.min():
            axes.set_xscale("log")
    else:
        step = -(-x.size // 15)
        ticks = points.ticks[0][::step]
        axes.set_xticks(x[::step], ticks, fontsize=8)
        if sum(map(len, ticks)) > _ROOM:
            axes.tick_params(axis="x", rotation=25)
        axes.grid(axis="x", visible=False)
    axes.set_xlabel(points.labels[0] if points.labels else "point of table sweep_failures")
    axes.set_ylabel(one.label)


def _are_places(x: Array, ticks: Sequence[str]) -> bool:
    return any(tick != f"{value:.4g}" for value, tick in zip(x, ticks, strict=True))


def _draw_map(figure: Figure, axes: Axes, points: Points, one: PointValues) -> None:
    nx, ny = (value.size for value in points.values)
    cells = np.full((ny, nx), np.nan)
    cells[points.places[1], points.places[0]] = one.value
    mesh = axes.pcolormesh(
        np.arange(nx + 1) - 0.5, np.arange(ny + 1) - 0.5, np.ma.masked_invalid(cells),
        cmap="viridis", edgecolors="white", linewidth=0.4,
    )  # fmt: skip
    figure.colorbar(mesh, ax=axes, label=one.label)
    for set_ticks, ticks in (
        (axes.set_xticks, points.ticks[0]),
        (axes.set_yticks, points.ticks[1]),
    ):
        step = -(-len(ticks) // 10)
        set_ticks(range(0, len(ticks), step), ticks[::step], fontsize=8)
    if nx * ny <= 64:
        finite = cells[np.isfinite(cells)]
        middle = 0.5 * (finite.min() + finite.max()) if finite.size else 0.0
        for (row, column), value in np.ndenumerate(cells):
            if np.isfinite(value):
                axes.text(column, row, f"{value:.3g}", ha="center", va="center", fontsize=7,
                          color="white" if value < middle else "black")  # fmt: skip
    axes.grid(visible=False)
    axes.set_xlabel(points.labels[0])
    axes.set_ylabel(points.labels[1])
