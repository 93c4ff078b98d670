"""Figures of the stage ``pointing``: axis angles and rates, errors, paths near the keyhole."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_tracking.pointing.products import Pointing
from hillsphere_tracking.topocentric import direction_cosines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_axes", "draw_errors", "draw_errors_by_culmination", "draw_keyholes"]

_PLANNED, _NAIVE, _LIMIT = PALETTE["blue"], PALETTE["vermillion"], "#777777"
_FLOOR_DEG = 1e-4
"""Smaller errors (deg) are drawn here: no antenna points better."""
_SECOND_S = 1.0
"""Interval (s) of which the largest error is drawn: errors swing between predictions, which come
about once a second."""
_TIES = 24
"""Lines that join satellite and beam at the same instants; with more they merge into an area."""
_AXIS_NAMES = {"azimuth_elevation": ("azimuth", "elevation"), "x_y": ("X", "Y")}


def draw_axes(figure: Figure, product: Pointing, mount: int, chosen: int) -> None:
    """Draw angles and rates of both axes during one pass, with their limits."""
    n = product.count[chosen]
    t = product.period_s * np.arange(n)
    grid = figure.subplots(2, 2, sharex=True, squeeze=False)
    for column, (name, planned, naive, limits) in enumerate(
        zip(
            _AXIS_NAMES[product.kinds[mount]],
            (product.primary_rad, product.secondary_rad),
            (product.naive_primary_rad, product.naive_secondary_rad),
            (product.primary_limits, product.secondary_limits),
            strict=True,
        )
    ):
        low, high, rate, _ = np.degrees(limits[:, mount])
        above, below = grid[:, column]
        for angle, colour, style, label in (
            (naive, _NAIVE, "--", "naive"),
            (planned, _PLANNED, "-", "planned"),
        ):
            course = np.degrees(angle[:n, chosen, mount])
            above.plot(t, course, color=colour, ls=style, label=label)
            below.plot(t[1:], np.diff(course) / product.period_s, color=colour, ls=style, lw=1.2)
        for axes, values, label in ((above, (low, high), "stops"), (below, (-rate, rate), "")):
            for value in values:
                axes.axhline(value, color=_LIMIT, ls=":", lw=1.2, label=label)
                label = ""
        above.set_ylabel(f"{name} (deg)")
        below.set_ylabel(f"rate of {name} (deg/s)")
        below.set_xlabel("time after the rise (s)")
        below.set_ylim(-1.15 * rate, 1.15 * rate)
        below.annotate("largest rate", (0.02, rate), xycoords=("axes fraction", "data"),
                       xytext=(0, 2), textcoords="offset points", fontsize=8, color="#444444",
                       va="bottom")  # fmt: skip
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(f"{product.mounts[mount]}: {_pass_name(product, chosen)}", fontsize=11)


def draw_errors(figure: Figure, product: Pointing) -> None:
    """Draw the error of each mount over time, in its most demanding pass (`telling_pass`)."""
    panels = figure.subplots(len(product.mounts), 1, squeeze=False)[:, 0]
    for mount, axes in enumerate(panels):
        chosen = product.telling_pass(mount)
        n = product.count[chosen]
        # Errors oscillate between predictions, every second: draw the largest of each second.
        first = np.arange(0, n, max(round(_SECOND_S / product.period_s), 1))
        t = product.period_s * first
        for error, colour, style, label in (
            (product.naive_error_rad, _NAIVE, "--", "naive"),
            (product.error_rad, _PLANNED, "-", "planned"),
        ):
            largest = np.maximum.reduceat(np.degrees(error[:n, chosen, mount]), first)
            drawn = np.maximum(largest, _FLOOR_DEG)
            axes.semilogy(t, drawn, color=colour, ls=style, label=label, lw=1.3)
        _mark_lock(axes, product)
        axes.set_ylim(0.4 * _FLOOR_DEG, 250.0)
        axes.set_ylabel("error (deg)")
        axes.set_title(f"{product.mounts[mount]}: {_pass_name(product, chosen)}", fontsize=10)
    panels[0].legend(loc="upper left", ncols=3, fontsize=8)
    panels[-1].set_xlabel("time after the rise (s)")


def draw_errors_by_culmination(figure: Figure, product: Pointing) -> None:
    """Draw the largest error of every pass against its highest elevation."""
    axes = figure.add_subplot()
    colours = list(PALETTE.values())
    top = np.degrees(product.elevation_max_rad)
    for mount, name in enumerate(product.mounts):
        marker = "osD^vP"[mount]
        for error, face, label in (
            (product.naive_error_rad, "none", f"{name}, naive"),
            (product.error_rad, colours[mount], f"{name}, planned"),
        ):
            largest = np.degrees(np.nanmax(error[:, :, mount], axis=0))
            axes.semilogy(
                top, np.maximum(largest, _FLOOR_DEG), marker, mfc=face, mec=colours[mount],
                ms=8 if face == "none" else 5, label=label,
            )  # fmt: skip
    _mark_lock(axes, product)
    axes.set_ylim(0.7 * _FLOOR_DEG, 250.0)
    axes.set_xlim(right=91.0)
    axes.set_xlabel("highest elevation of the pass (deg)")
    axes.set_ylabel("largest error (deg)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)


def draw_keyholes(figure: Figure, product: Pointing) -> None:
    """Draw satellite and beam near the keyhole of each mount, in its most demanding pass."""
    count = len(product.mounts)
    columns = min(2, count)
    grid = figure.subplots(ceil(count / columns), columns, squeeze=False)
    for place in grid.ravel()[count:]:
        place.set_axis_off()
    for mount, axes in enumerate(grid.ravel()[:count]):
        _draw_keyhole(axes, product, mount, product.telling_pass(mount))
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8)


def _draw_keyhole(axes: Axes, product: Pointing, mount: int, chosen: int) -> None:
    n = product.count[chosen]
    frame = product.axes[:, :, mount]
    satellite = direction_cosines(
        product.azimuth_rad[:n, chosen], product.elevation_rad[:n, chosen]
    )
    distance = product.keyhole_distance(mount)[:n, chosen]
    nearest = int(np.argmin(distance))
    # An X/Y mount has a keyhole at each end of its X axis; take the nearer one.
    end = 1.0 if frame[2] @ satellite[:, nearest] >= 0.0 else -1.0
    turned = np.array([frame[0], end * frame[1], end * frame[2]])

    def project(direction: Array) -> Array:
        """Project directions to degrees right of the keyhole and above it (equidistant)."""
        up, right, along = turned @ direction
        across = np.hypot(up, right)
        scale = np.degrees(np.arctan2(across, along)) / np.maximum(across, 1e-300)
        return np.array([right * scale, up * scale])

    beams = [
        (np.tensordot(frame.T, _unit(primary[:n, chosen, mount], secondary[:n, chosen, mount]), 1))
        for primary, secondary in (
            (product.naive_primary_rad, product.naive_secondary_rad),
            (product.primary_rad, product.secondary_rad),
        )
    ]
    target, naive, planned = project(satellite), project(beams[0]), project(beams[1])
    near = np.degrees(distance[nearest])
    missed = np.degrees(np.max(product.error_rad[:n, chosen, mount][np.degrees(distance) < 45.0],
                               initial=0.0))  # fmt: skip
    reach = max(1.6 * near, 2.5 * missed, 3.0)
    axes.plot(*target, color="#999999", lw=4, label="satellite", solid_capstyle="round")
    axes.plot(*naive, color=_NAIVE, ls="--", label="naive beam")
    axes.plot(*planned, color=_PLANNED, label="planned beam")
    shown = np.flatnonzero(np.abs(target).max(axis=0) < reach)
    step = max(shown.size // _TIES, 1)
    for k in range(nearest % step, n, step):
        axes.plot(*np.column_stack([target[:, k], planned[:, k]]), color=_PLANNED, lw=0.7)
    around = np.linspace(0.0, 2.0 * np.pi, 100)
    lock = np.degrees(product.lock_angle_rad)
    circle = target[:, nearest, None] + lock * np.array([np.cos(around), np.sin(around)])
    axes.plot(*circle, color="black", lw=0.8, label="lock angle")
    axes.plot(0.0, 0.0, "+", color="black", ms=10, label="keyhole")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    upright = product.kinds[mount] == "azimuth_elevation"
    axes.set_xlabel(f"{'east' if upright else 'right'} of the keyhole (deg)")
    axes.set_ylabel(f"{'north of' if upright else 'above'} the keyhole (deg)")
    axes.set_title(f"{product.mounts[mount]}: {_pass_name(product, chosen)}", fontsize=9)


def _unit(primary: Array, secondary: Array) -> Array:
    level = np.cos(secondary)
    return np.array([np.cos(primary) * level, np.sin(primary) * level, np.sin(secondary)])


def _mark_lock(axes: Axes, product: Pointing) -> None:
    lock = np.degrees(product.lock_angle_rad)
    axes.axhline(lock, color=_LIMIT, ls=":", lw=1.2, label=f"lock angle, {lock:g}°")


def _pass_name(product: Pointing, chosen: int) -> str:
    return (
        f"{product.stations[chosen]}, revolution {product.revolution[chosen]}, up to "
        f"{np.degrees(product.elevation_max_rad[chosen]):.1f}°"
    )
