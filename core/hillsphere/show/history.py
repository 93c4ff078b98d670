"""The time history of one case, as a CSV file and as a figure."""

from __future__ import annotations

import csv
from io import StringIO
from typing import TYPE_CHECKING, Literal

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, HOUR_S, MINUTE_S
from hillsphere.show.charts import Axis, Chart, Panel
from hillsphere.show.colours import LINE_COLOURS
from hillsphere.show.marks import Curve

if TYPE_CHECKING:
    from hillsphere.interfaces.cases import Histories

__all__ = ["history_chart", "history_csv", "time_unit"]

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


def history_chart(title: str, histories: Histories) -> Chart:
    """Return the history of a single case.

    Parameters
    ----------
    title : str
        Title of the figure.
    histories : Histories
        History of one case. Quantities whose names differ only in the part before the last dot
        (``"x"``, ``"seen.x"``, ``"ref.x"``) share a panel.
    """
    time_s = histories.time_s[:, 0]
    unit_of_time, scale = time_unit(float(np.ptp(time_s)) if len(time_s) else 0.0)
    groups: dict[tuple[str, str], dict[str, Array]] = {}
    for name, unit, values in zip(
        histories.names, histories.units, histories.values[:, :, 0], strict=True
    ):
        before, _, last = name.rpartition(".")
        groups.setdefault((last, unit), {})[before] = values
    kinds = list(dict.fromkeys(before for lines in groups.values() for before in lines))
    panels = []
    for (last, unit), lines in groups.items():
        main = min(lines, key=len)
        marks = [
            Curve(time_s / scale, values, f"{before}.{last}".lstrip("."),
                  LINE_COLOURS[kinds.index(before) % len(LINE_COLOURS)],
                  width=1.6 if before == main else 0.9)
            for before, values in lines.items()
        ]  # fmt: skip
        label = last if len(lines) > 1 else marks[0].label
        legend: Literal["best", "none"] = "best" if len(lines) > 1 else "none"
        panels.append(
            Panel(Axis("time", unit_of_time), Axis(label.replace("_", " "), unit), marks,
                  legend=legend)
        )  # fmt: skip
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    return Chart(title, panels, columns=columns, share_x=True,
                 size_in=(3.4 * columns, 0.5 + 2.0 * rows))  # fmt: skip
