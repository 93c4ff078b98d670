"""The time history of one case, as a CSV file and as a figure."""

from __future__ import annotations

import csv
from io import StringIO
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, HOUR_S, MINUTE_S
from hillsphere.show.presentation import PALETTE, Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from hillsphere.interfaces.cases import Histories

__all__ = ["history_csv", "history_figure", "time_unit"]

_COLUMNS = 3
"""Panels side by side; with more the labels of neighbouring axes would meet."""
_TIMES = (("d", DAY_S), ("h", HOUR_S), ("min", MINUTE_S))


def time_unit(span_s: float) -> tuple[str, float]:
    """Return a suitable unit for the time axis of a figure, and its size in s."""
    return next(((u, s) for u, s in _TIMES if span_s >= 3 * s), ("s", 1.0))


def history_csv(histories: Histories) -> str:
    """Return the history of a single case as CSV, in full precision, ``nan`` for missing values.

    Parameters
    ----------
    histories : Histories
        Histories of one case.

    Returns
    -------
    str
        A line of names with units in brackets, then one line per sample.
    """
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    units = zip(histories.names, histories.units, strict=True)
    writer.writerow(["time [s]", *(f"{name} [{unit}]" for name, unit in units)])
    rows = np.vstack([histories.time_s[:, 0], histories.values[:, :, 0]]).T
    writer.writerows([repr(value) for value in row] for row in rows.tolist())
    return stream.getvalue()


def history_figure(title: str, histories: Histories) -> Figure:
    """Return a figure of the history of a single case.

    Parameters
    ----------
    title : str
        Title of the figure.
    histories : Histories
        History of one case. Quantities whose names differ only in the part before the last dot
        (``"x"``, ``"seen.x"``, ``"ref.x"``) share a panel.
    """
    time_s = histories.time_s[:, 0]
    span = float(np.ptp(time_s)) if len(time_s) else 0.0
    unit_of_time, scale = time_unit(span)
    panels: dict[tuple[str, str], dict[str, Array]] = {}
    for name, unit, values in zip(
        histories.names, histories.units, histories.values[:, :, 0], strict=True
    ):
        before, _, last = name.rpartition(".")
        panels.setdefault((last, unit), {})[before] = values
    colours = dict.fromkeys(before for lines in panels.values() for before in lines)
    for before, colour in zip(colours, cycle(list(PALETTE.values())[:-1]), strict=False):
        colours[before] = colour
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)

    def draw(figure: MatplotlibFigure) -> None:
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for axes, ((last, unit), lines) in zip(grid, panels.items(), strict=False):
            for before, values in lines.items():
                name = f"{before}.{last}" if before else last
                width = 1.6 if before == min(lines, key=len) else 0.9
                axes.plot(time_s / scale, values, label=name, lw=width, color=colours[before])
            axes.set_ylabel(f"{last if len(lines) > 1 else name} [{unit}]")
            if len(lines) > 1:
                axes.legend(fontsize=7)
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        for axes in grid[len(panels) - columns : len(panels)]:
            axes.set_xlabel(f"time [{unit_of_time}]")
            axes.tick_params(labelbottom=True)

    return Figure(title, draw, size_in=(3.4 * columns, 0.5 + 2.0 * rows))
