"""Figures of the stage ``navigation``."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import LINE_COLOURS, Axis, Band, Chart, Curve, Mark, Panel, Span
from hillsphere.show.charts import even_indices
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.products import NavigationFlight

__all__ = ["control_chart", "error_chart", "hours_or_days", "nees_axis", "nees_chart"]

_LONG_S = 3.0 * DAY_S
"""Flights longer than this are drawn over days: an axis in hours would have labels of three
digits."""
_FAR = 5.0
"""Factor above its band from which on a mean NEES is drawn on a logarithmic axis."""


def hours_or_days(time_s: Array) -> tuple[Array, Axis]:
    """Return times in hours, or in days for a long flight, and their axis."""
    if time_s[-1] > _LONG_S:
        return time_s / DAY_S, Axis("time", "d")
    return time_s / 3600.0, Axis("time", "h")


def error_chart(product: NavigationFlight, called: str, table: str) -> Chart:
    """Return the errors of the estimated positions; `table` lists the spacecraft."""
    time, axis = hours_or_days(product.time_s)
    panels = []
    for i, name in enumerate(product.spacecraft):
        at = _flown_indices(product.position_error_m[i])
        error = product.position_error_m[i, at]
        low, high = np.nanquantile(error, [0.05, 0.95], axis=1)
        rms, sigma = np.sqrt(np.nanmean(error**2, axis=1)), product.position_sigma_m[i, at, 0]
        marks: list[Mark] = [
            Band(time[at], low, high, "5 to 95 %"),
            Curve(time[at], error[:, 0], "first flight", "blue", width=1.8, rows=i),
            Curve(time[at], rms, "rms", "green", width=0.9, rows=i),
            Curve(time[at], 3.0 * sigma, "3σ believed", "vermillion", "dashed", rows=i),
            Curve(time[at], product.bound_m[i, at], "bound", "black", "dotted", rows=i),
        ]
        panels.append(Panel(axis, Axis("position error", "m", "log"), marks, name))
    return Chart(
        f"Errors of the estimated positions{called}", panels,
        "Thick: the first flight; dashed: three standard deviations by its filter; band: 5 to 95 % "
        "of all flights; thin: their rms error; dotted: the Cramér-Rao bound.",
        share_x=True, shared_legend=True, size_in=(7.5, 2.4 + 2.0 * len(panels)), table=table,
    )  # fmt: skip


def control_chart(product: NavigationFlight, called: str, table: str) -> Chart:
    """Return the distance from the reference, true and believed; `table` lists the spacecraft."""
    time, axis = hours_or_days(product.time_s)
    at = even_indices(time.size)
    marks: list[Mark] = []
    for i, name in enumerate(product.spacecraft):
        rows = slice(6 * i, 6 * i + 3)
        colour = LINE_COLOURS[i % len(LINE_COLOURS)]
        believed = np.linalg.norm(product.estimate[rows] - product.goal[rows], axis=0)
        true = product.control_error_m[i, :, 0]
        marks += [
            Curve(time[at], true[at], f"{name}, true", colour, rows=i),
            Curve(time[at], believed[at], f"{name}, estimated", colour, "dashed", opacity=0.7,
                  rows=i),
        ]  # fmt: skip
    return Chart(
        f"Distance from the reference{called}",
        [Panel(axis, Axis("distance from the reference", "m", "log"), marks)],
        "Of the first flight at its measurements: true and estimated.", table=table,
    )  # fmt: skip


def nees_chart(product: NavigationFlight, called: str) -> Chart:
    """Return the mean normalised errors squared with their band."""
    time, axis = hours_or_days(product.time_s)
    n, count = len(product.states), product.nees.shape[1]
    low, high = chi_square_band(n, max(count - product.lost, 1))
    at = _flown_indices(product.nees)
    mean = np.nanmean(product.nees[at], axis=1)
    flights = f"mean of {count - product.lost} flights"
    marks: list[Mark] = [
        Span("y", float(low), float(high), "99.9 % band", "body"),
        Curve(time[at], mean, flights, "blue"),
        Curve(time[at], np.nanmedian(product.nees[at], axis=1), "median", "vermillion", "dotted"),
    ]
    scale = nees_axis(f"NEES of {n} states", mean, float(high))
    return Chart(
        f"Normalised errors squared{called}", [Panel(axis, scale, marks)],
        f"Mean over {count} flights; grey: its 99.9 % band for a consistent filter.",
    )  # fmt: skip


def _flown_indices(values: Array) -> Integers:
    """Return indices, at most so many as a figure needs, of times (K,) at which flights go on.

    Flights that are lost have no values (K, flights); when the last one is lost, no statistics
    are left.
    """
    flown = np.flatnonzero(np.isfinite(values).any(axis=1))
    return flown[even_indices(flown.size)]


def nees_axis(label: str, mean: Array, high: float) -> Axis:
    """Return the axis of a mean NEES, logarithmic if it goes far above the end of its band."""
    return Axis(label, scale="log" if np.nanmax(mean, initial=0.0) > _FAR * high else "linear")
