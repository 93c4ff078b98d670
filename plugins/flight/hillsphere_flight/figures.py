"""Figures of the nominal flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import zoom

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, HOUR_S
from hillsphere.presentation import PALETTE
from hillsphere_flight.histories import NOWHERE
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_accelerations", "draw_command", "draw_errors", "draw_path", "has_accelerations"]

_COLOURS = ("blue", "vermillion", "green", "purple", "orange", "sky", "black")
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


def draw_errors(figure: Figure, product: ClosedLoopFlight, spec: ClosedLoopSpec) -> None:
    """Draw distance and speed from the reference over time."""
    time, label = _time(product)
    top, bottom = figure.subplots(2, 1, sharex=True)
    limits, require = spec.limits, spec.require
    top.set_ylabel("distance [m]")
    bottom.set_ylabel("speed [m/s]")
    bottom.set_xlabel(label)
    counted = time >= time[0] + _in_units(spec.errors_from_s, product)
    final = dict(zip(product.metrics, product.values.tolist(), strict=True))
    for axes, error, limit, required in (
        (
            top,
            _to_the_end(product, product.position_error_m, final["final_position_error"]),
            limits.position_error_m,
            require.limit("largest_position_error_m"),
        ),
        (
            bottom,
            _to_the_end(product, product.velocity_error_m_s, final["final_velocity_error"]),
            limits.velocity_error_m_s,
            require.limit("largest_velocity_error_m_s"),
        ),
    ):
        axes.plot(time, error, color=PALETTE["blue"], label="from the reference")
        _line(axes, time, error, limit, "vermillion", "limit")
        _line(axes, time[counted], error, required, "orange", "required")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)


def _line(
    axes: Axes, time: Array, error: Array, value: float | None, colour: str, what: str
) -> None:
    if value is not None and np.isfinite(time).any() and value <= _NEAR * np.nanmax(error):
        ends = [np.nanmin(time), np.nanmax(time)]
        axes.plot(ends, [value, value], color=PALETTE[colour], linestyle="--", label=what)


def draw_command(figure: Figure, product: ClosedLoopFlight) -> None:
    """Draw the command over time: steps where it is held, points where it is an impulse."""
    time, label = _time(product)
    unit = product.control_units[0]
    impulses = unit == "m/s"
    most = np.nanmax(np.abs(product.u), initial=0.0)
    factor, prefix = (1e3, "m") if unit.startswith("m/s") and most < 0.1 else (1.0, "")
    axes = figure.subplots()
    for i, (name, values) in enumerate(zip(product.controls, factor * product.u, strict=True)):
        colour = PALETTE[_COLOURS[i % len(_COLOURS)]]
        if impulses:
            axes.plot(time[:-1], values, ".", color=colour, label=f"Δ{name}")
        else:
            # The last command is held to the end of the flight.
            steps = np.append(values, values[-1])
            axes.step(time, steps, where="post", color=colour, label=name)
    axes.set_xlabel(label)
    shown = prefix + unit.replace("s2", "s²")
    axes.set_ylabel(f"{'impulse' if impulses else 'command'} [{shown}]")
    axes.legend(loc="best", ncols=max(1, len(product.controls) // 3))


def draw_path(figure: Figure, product: ClosedLoopFlight) -> None:
    """Draw the paths in space, and the body if it has a surface."""
    axes: Any = figure.add_subplot(projection="3d")
    rows = np.array(product.position_rows).reshape(-1, 3)
    x = _to_the_end(product, product.x, product.end_x)
    both = np.concatenate([x[rows], product.goal[rows]], axis=2) / 1e3
    span = float(np.max(np.nanmax(both, axis=2) - np.nanmin(both, axis=2)))
    near = span < _FAR_KM
    for i, vector in enumerate(rows):
        colour = PALETTE[_COLOURS[i % len(_COLOURS)]]
        path, goal = x[vector], product.goal[vector]
        if near:
            path, goal = path - goal[:, :1], goal - goal[:, :1]
        else:
            path, goal = path / 1e3, goal / 1e3
        who = f" {i + 1}" if len(rows) > 1 else ""
        axes.plot(*path, color=colour, label=f"flight{who}")
        still = not np.ptp(goal, axis=1).any()
        shape = {"marker": "x", "linestyle": ""} if still else {"linestyle": "--"}
        shown = goal[:, :1] if still else goal
        axes.plot(*shown, color=PALETTE["black"], label=f"reference{who}", **shape)
    if product.surface_m is not None and not near:
        body = product.surface_m[:, ::3, ::3] / 1e3
        axes.plot_surface(*body, color="#bbbbbb", alpha=0.4, linewidth=0)
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"Δ{name} [m]" if near else f"{name} [km]", labelpad=8)
        axes.locator_params(axis=name, nbins=5)
    axes.set_aspect("equal")
    axes.legend(loc="upper left")


def has_accelerations(product: ClosedLoopFlight) -> bool:
    """Whether there is a body to draw, and a flight of commands that add to a reference's."""
    return (
        product.surface_m is not None
        and bool(np.isfinite(product.own).any())
        and product.feedforward is not None
        and len(product.position_rows) == len(product.controls) == 3
    )


def draw_accelerations(figure: Figure, product: ClosedLoopFlight) -> None:
    """Draw the path over the body, with the accelerations at some of its samples."""
    assert product.feedforward is not None
    x = _to_the_end(product, product.x, product.end_x)
    path = x[list(product.position_rows)] / 1e3
    flown = np.flatnonzero(np.isfinite(product.own[0]) & np.isfinite(path[0, :-1]))
    at = flown[np.unique(np.linspace(0, len(flown) - 1, _ARROWS).round().astype(int))]
    own, feed = product.own[:, at], product.feedforward[:, at]
    kinds = (
        ("reference", feed, None, "blue", 2.5),
        ("law", own, feed, "vermillion", 1.5),
        ("sum", feed + own, None, "black", 0.8),
    )
    sizes = [np.sqrt((a * a).sum(axis=0)).max() for _, a, _, _, _ in kinds]
    span = float(np.max(np.nanmax(path, axis=1) - np.nanmin(path, axis=1)))
    km = _ARROW * span / max(sizes) if max(sizes) > 0.0 else 0.0
    axes: Any = figure.add_subplot(projection="3d")
    axes.plot(*path, color=PALETTE["green"], label="flight")
    for (name, a, after, colour, width), size in zip(kinds, sizes, strict=True):
        begin = path[:, at] if after is None else path[:, at] + km * after
        axes.quiver(
            *begin, *(km * a), color=PALETTE[colour], linewidth=width, arrow_length_ratio=0.15,
            label=f"{name}, up to {1e3 * size:.3g} mm/s²",
        )  # fmt: skip
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"{name} [km]", labelpad=8)
        axes.locator_params(axis=name, nbins=5)
    heads = path[:, at] + km * (feed + own)
    _show_with_body(axes, product, np.concatenate([path[:, :-1][:, flown], heads], axis=1))
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 1.08))


def _show_with_body(axes: Any, product: ClosedLoopFlight, points: Array) -> None:
    """Show a cube about points (3, J), and of the body what is in it, seen from its limb."""
    low, high = points.min(axis=1), points.max(axis=1)
    middle, half = 0.5 * (low + high), 0.52 * float((high - low).max())
    assert product.surface_m is not None
    surface = zoom(product.surface_m / 1e3, (1, _FINER, _FINER), order=1)
    inside = (np.abs(surface - middle[:, None, None]) <= half).all(axis=0)
    surface[:, ~inside] = np.nan
    with np.errstate(invalid="ignore"):
        axes.plot_surface(
            *surface, color="#bbbbbb", alpha=0.5, linewidth=0, rstride=2, cstride=2, shade=False
        )
    for name, centre in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{name}lim")(centre - half, centre + half)
    axes.set_aspect("equal")
    axes.view_init(elev=20.0, azim=float(np.degrees(np.arctan2(middle[1], middle[0]))) - 75.0)


def _time(product: ClosedLoopFlight) -> tuple[Array, str]:
    """Return times since the start in hours or days, and the label of their axis."""
    unit = "days" if _is_long(product) else "h"
    time_s = _to_the_end(product, product.time_s, product.end_s) - product.time_s[0]
    return _in_units(time_s, product), f"time [{unit}]"


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
