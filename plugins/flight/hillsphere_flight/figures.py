"""Figures of the nominal flight."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import zoom

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, HOUR_S
from hillsphere.presentation import (
    LINE_COLOURS,
    Arrows,
    Axis,
    Chart,
    Cloud,
    Curve,
    Mark,
    Panel,
    Path,
    Points,
    Solid,
    Space,
    Surface,
)
from hillsphere.show.charts import even_indices
from hillsphere.show.spaces import with_room
from hillsphere_flight.histories import NOWHERE
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

__all__ = ["acceleration_chart", "command_chart", "error_chart", "has_accelerations", "path_chart"]

_LONG_H = 72.0
"""Hours beyond which the axis of time is in days: three-digit hours are hard to read."""

_NEAR = 3.0
"""A limit is drawn if it is at most this factor above the largest error: a higher line would
press the errors to the bottom of the figure."""
_ARROWS, _ARROW = 14, 0.35
"""Number of accelerations drawn along a path, and the length of the longest of them as a part of
the extent of the path: more or longer arrows cross each other."""
_FINER = 4
"""Factor by which the mesh of a surface is refined where only a part of it is shown; the coarse
mesh would show its facets there."""
_FAR_KM = 1.0
"""Flights of a smaller extent, km, are drawn in metres about their reference: labels in kilometres
would differ only in their last digits."""


def error_chart(product: ClosedLoopFlight, spec: ClosedLoopSpec) -> Chart:
    """Return distance and speed from the reference over time."""
    time, axis = _time(product)
    limits, require = spec.limits, spec.require
    counted = time >= time[0] + _in_units(spec.errors_from_s, product)
    final = dict(zip(product.metrics, product.values.tolist(), strict=True))
    at = even_indices(time.size)
    panels = []
    for label, unit, samples, end, limit, required in (
        ("distance", "m", product.position_error_m, "final_position_error",
         limits.position_error_m, "largest_position_error_m"),
        ("speed", "m/s", product.velocity_error_m_s, "final_velocity_error",
         limits.velocity_error_m_s, "largest_velocity_error_m_s"),
    ):  # fmt: skip
        error = _to_the_end(product, samples, final[end])
        marks: list[Mark] = [
            Curve(time[at], error[at], "from the reference", "blue"),
            *_line(time, error, limit, "vermillion", "limit"),
            *_line(time[counted], error, require.limit(required), "orange", "required"),
        ]
        panels.append(Panel(axis, Axis(label, unit, low=0.0), marks, legend="above"))
    return Chart(
        "Distance and speed from the reference", panels,
        "True deviations at the samples and at the end; dashed: limits and requirements.",
        share_x=True, size_in=(7.0, 4.5),
    )  # fmt: skip


def _line(time: Array, error: Array, value: float | None, colour: str, what: str) -> list[Mark]:
    if value is None or not np.isfinite(time).any() or value > _NEAR * np.nanmax(error):
        return []
    return [Curve([np.nanmin(time), np.nanmax(time)], [value, value], what, colour, "dashed")]


def command_chart(product: ClosedLoopFlight) -> Chart:
    """Return the command over time: steps where it is held, points where it is an impulse."""
    time, axis = _time(product)
    unit = product.control_units[0]
    impulses = unit == "m/s"
    most = np.nanmax(np.abs(product.u), initial=0.0)
    factor, prefix = (1e3, "m") if unit.startswith("m/s") and most < 0.1 else (1.0, "")
    marks: list[Mark] = []
    for name, values in zip(product.controls, factor * product.u, strict=True):
        if impulses:
            marks.append(Points(time[:-1], values, f"Δ{name}", marker="dot"))
        else:
            # The last command is held to the end of the flight.
            marks.append(Curve(time, np.append(values, values[-1]), name, steps=True))
    y_axis = Axis("impulse" if impulses else "command", prefix + unit.replace("s2", "s²"))
    return Chart(
        "Command", [Panel(axis, y_axis, marks)],
        "Command as the actuator executed it at each sample.",
    )  # fmt: skip


def path_chart(product: ClosedLoopFlight) -> Chart:
    """Return the paths in space, and the body if it has a surface."""
    rows = np.array(product.position_rows).reshape(-1, 3)
    x = _to_the_end(product, product.x, product.end_x)
    both = np.concatenate([x[rows], product.goal[rows]], axis=2) / 1e3
    span = float(np.max(np.nanmax(both, axis=2) - np.nanmin(both, axis=2)))
    near = span < _FAR_KM
    time, axis = _time(product)
    solids: list[Solid] = []
    for i, vector in enumerate(rows):
        path, goal = x[vector], product.goal[vector]
        if near:
            path, goal = path - goal[:, :1], goal - goal[:, :1]
        else:
            path, goal = path / 1e3, goal / 1e3
        who = f" {i + 1}" if len(rows) > 1 else ""
        flown = np.flatnonzero(np.isfinite(path).all(axis=0) & np.isfinite(time))
        flown = flown[even_indices(flown.size)]
        colour = LINE_COLOURS[i % len(LINE_COLOURS)]
        solids.append(Path(path[:, flown], f"flight{who}", colour, times=time[flown]))
        if np.ptp(goal, axis=1).any():
            goal = goal[:, even_indices(goal.shape[1])]
            solids.append(Path(goal, f"reference{who}", "black", "dashed"))
        else:
            solids.append(Cloud(goal[:, :1], f"reference{who}", "black", "cross"))
    if product.surface_m is not None and not near:
        solids.append(Surface(product.surface_m[:, ::3, ::3] / 1e3, colour="light", opacity=0.4))
    axes = {n: Axis(f"Δ{n}", "m") if near else Axis(n, "km") for n in "xyz"}
    return Chart(
        "Path", [with_room(Space(solids, axes["x"], axes["y"], axes["z"], time=axis))],
        f"In the frame {product.frame}; Δ: from where the reference begins. Dashed, or a cross: "
        "the reference.",
        shared_legend=True, size_in=(6.5, 5.5),
    )  # fmt: skip


def has_accelerations(product: ClosedLoopFlight) -> bool:
    """Whether there is a body to draw, and a flight of commands that add to a reference's."""
    return (
        product.surface_m is not None
        and bool(np.isfinite(product.own).any())
        and product.feedforward is not None
        and len(product.position_rows) == len(product.controls) == 3
    )


def acceleration_chart(product: ClosedLoopFlight) -> Chart:
    """Return the path over the body, with the accelerations at some of its samples."""
    assert product.feedforward is not None
    x = _to_the_end(product, product.x, product.end_x)
    path = x[list(product.position_rows)] / 1e3
    flown = np.flatnonzero(np.isfinite(product.own[0]) & np.isfinite(path[0, :-1]))
    at = flown[even_indices(flown.size, _ARROWS)]
    own, feed = product.own[:, at], product.feedforward[:, at]
    kinds = (
        ("reference", feed, None, "blue", 2.5),
        ("law", own, feed, "vermillion", 1.5),
        ("sum", feed + own, None, "black", 0.8),
    )
    sizes = [np.sqrt((a * a).sum(axis=0)).max() for _, a, _, _, _ in kinds]
    span = float(np.max(np.nanmax(path, axis=1) - np.nanmin(path, axis=1)))
    km = _ARROW * span / max(sizes) if max(sizes) > 0.0 else 0.0
    solids: list[Solid] = [Path(path[:, even_indices(path.shape[1])], "flight", "green")]
    for (name, a, after, colour, width), size in zip(kinds, sizes, strict=True):
        begin = path[:, at] if after is None else path[:, at] + km * after
        label = f"{name}, up to {1e3 * size:.3g} mm/s²"
        solids.append(Arrows(begin, km * a, label, colour, width))
    heads = path[:, at] + km * (feed + own)
    points = np.concatenate([path[:, :-1][:, flown], heads], axis=1)
    low, high = points.min(axis=1), points.max(axis=1)
    middle, half = 0.5 * (low + high), 0.52 * float((high - low).max())
    solids += _surface_within(product, middle, half)
    axes = {
        name: Axis(name, "km", low=centre - half, high=centre + half)
        for name, centre in zip("xyz", middle.tolist(), strict=True)
    }
    # Seen from the body's limb.
    azimuth_deg = float(np.degrees(np.arctan2(middle[1], middle[0]))) - 75.0
    return Chart(
        "Accelerations along the path",
        [Space(solids, axes["x"], axes["y"], axes["z"], "", azimuth_deg, 20.0)],
        f"In the frame {product.frame}: accelerations of the reference, of the law, and their sum, "
        "to one scale, before errors of the actuator.",
        shared_legend=True, size_in=(7.0, 6.0),
    )  # fmt: skip


def _surface_within(product: ClosedLoopFlight, middle: Array, half: float) -> list[Surface]:
    """Return the part of the body's surface in a cube, if there is any."""
    assert product.surface_m is not None
    surface = zoom(product.surface_m / 1e3, (1, _FINER, _FINER), order=1)
    inside = (np.abs(surface - middle[:, None, None]) <= half).all(axis=0)
    if not inside.any():
        return []
    surface[:, ~inside] = np.nan
    part = surface[:, inside.any(axis=1)][:, :, inside.any(axis=0)]
    return [Surface(part, colour="light", opacity=0.5)]


def _time(product: ClosedLoopFlight) -> tuple[Array, Axis]:
    """Return times since the start in hours or days, and their axis."""
    time_s = _to_the_end(product, product.time_s, product.end_s) - product.time_s[0]
    return _in_units(time_s, product), Axis("time", "d" if _is_long(product) else "h")


def _to_the_end(product: ClosedLoopFlight, samples: Array, end: Array | float) -> Array:
    """Return values (…, K + 1) at the samples, and after the last one those at the end.

    A flight that an event or a limit ended between two samples went on beyond the last one.
    """
    count = int(np.isfinite(product.time_s).sum())
    if product.status in NOWHERE or not 0 < count < len(product.time_s):
        return samples
    if not product.end_s > product.time_s[count - 1]:
        return samples
    made = samples.copy()
    made[..., count] = end
    return made


def _in_units(seconds: Any, product: ClosedLoopFlight) -> Any:
    return seconds / (DAY_S if _is_long(product) else HOUR_S)


def _is_long(product: ClosedLoopFlight) -> bool:
    flown = product.time_s[np.isfinite(product.time_s)]
    return bool(flown.size and np.ptp(flown) > _LONG_H * HOUR_S)
