"""Figures of the stage ``pointing``: axis angles and rates, errors, paths near the keyhole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Curve,
    Dash,
    Mark,
    MarkerShape,
    Note,
    Panel,
    Points,
    Rule,
)
from hillsphere_tracking.pointing.products import Pointing
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["axis_chart", "culmination_chart", "error_chart", "keyhole_chart"]

_KINDS: tuple[tuple[str, str, Dash], ...] = (
    ("naive", "vermillion", "dashed"), ("planned", "blue", "solid"),
)  # fmt: skip
_PATHS: tuple[tuple[str, str, Dash, float], ...] = (
    ("satellite", "body", "solid", 4.0), ("naive beam", "vermillion", "dashed", 1.6),
    ("planned beam", "blue", "solid", 1.6),
)  # fmt: skip
_MARKERS: tuple[MarkerShape, ...] = (
    "circle", "square", "diamond", "triangle", "triangle-down", "plus",
)  # fmt: skip
_FLOOR_DEG = 1e-4
"""Smaller errors (deg) are drawn here: no antenna points better."""
_TOP_DEG = 250.0
"""Upper end of the axis of errors: above 180°, the largest error, with room for the legend."""
_SECOND_S = 1.0
"""Interval (s) of which the largest error is drawn: errors swing between predictions, which come
about once a second."""
_SAMPLES = 1500
"""Points of a curve, about: a screen is not wider."""
_TIES = 24
"""Lines that join satellite and beam at the same instants; with more they merge into an area."""
_AROUND = 3.0
"""Part of the paths that is drawn, relative to the part shown at first: room to zoom out."""
_AXIS_NAMES = {"azimuth_elevation": ("azimuth", "elevation"), "x_y": ("X", "Y")}
_AFTER_RISE = Axis("time after the rise", "s")


def axis_chart(product: Pointing, mount: int, table: str) -> Chart:
    """Return angles and rates of both axes with their limits, in the most demanding pass.

    The rows of `table` are mounts, each with all passes.
    """
    chosen = product.telling_pass(mount)
    n = product.count[chosen]
    stride = -(-int(n) // _SAMPLES)
    t = product.period_s * np.arange(n)
    row = mount * product.count.size + chosen
    above, below = [], []
    for name, naive, planned, limits in zip(
        _AXIS_NAMES[product.kinds[mount]],
        (product.naive_primary_rad, product.naive_secondary_rad),
        (product.primary_rad, product.secondary_rad),
        (product.primary_limits, product.secondary_limits),
        strict=True,
    ):
        low, high, rate, _ = np.degrees(limits[:, mount]).tolist()
        angles: list[Mark] = [Rule("y", low, "stops"), Rule("y", high, "stops")]
        rates: list[Mark] = [
            Rule("y", -rate), Rule("y", rate), Note("largest rate", 0.0, rate, "top right"),
        ]  # fmt: skip
        for angle, (label, colour, dash) in zip((naive, planned), _KINDS, strict=True):
            path = np.degrees(angle[:n, chosen, mount])
            speed = np.diff(path) / product.period_s
            angles.append(Curve(t[::stride], path[::stride], label, colour, dash, rows=row))
            rates.append(Curve(t[1::stride], speed[::stride], label, colour, dash, 1.2, rows=row))
        above.append(Panel(_AFTER_RISE, Axis(name, "deg"), angles))
        ends = Axis(f"rate of {name}", "deg/s", low=-1.15 * rate, high=1.15 * rate)
        below.append(Panel(_AFTER_RISE, ends, rates))
    return Chart(
        f"Axes of {_mount_and_pass(product, mount)}",
        [*above, *below],
        "Angles and rates of both axes in the pass with the largest error, or with the largest "
        "naive error if all planned errors are small. Dotted: stops and largest rates.",
        columns=2,
        share_x=True,
        shared_legend=True,
        size_in=(8.6, 5.6),
        table=table,
    )


def error_chart(product: Pointing, table: str) -> Chart:
    """Return the error of each mount over time, in its most demanding pass (`telling_pass`).

    The rows of `table` are mounts, each with all passes.
    """
    panels = []
    for mount in range(len(product.mounts)):
        chosen = product.telling_pass(mount)
        n = product.count[chosen]
        # Errors oscillate between predictions, every second: draw the largest of each second.
        first = np.arange(0, n, max(round(_SECOND_S / product.period_s), 1))
        row = mount * product.count.size + chosen
        marks: list[Mark] = [
            Curve(
                product.period_s * first,
                _limit_below(np.maximum.reduceat(error[:n, chosen, mount], first)),
                label, colour, dash, 1.3, rows=row,
            )
            for error, (label, colour, dash) in zip(_errors(product), _KINDS, strict=True)
        ]  # fmt: skip
        error_axis = Axis("error", "deg", scale="log", low=0.4 * _FLOOR_DEG, high=_TOP_DEG)
        panels.append(
            Panel(_AFTER_RISE, error_axis, [*marks, _lock(product)],
                  _mount_and_pass(product, mount))
        )  # fmt: skip
    return Chart(
        "Errors during a pass",
        panels,
        "The same passes; the largest error of each second. Errors below 1e-4° are drawn at 1e-4°.",
        shared_legend=True,
        size_in=(7.5, 0.8 + 2.2 * len(panels)),
        table=table,
    )


def culmination_chart(product: Pointing, table: str) -> Chart:
    """Return the largest error of every pass against its highest elevation.

    The rows of `table` are mounts, each with all passes.
    """
    count = product.count.size
    marks: list[Mark] = [
        Points(
            np.degrees(product.elevation_max_rad),
            _limit_below(np.nanmax(error[:, :, mount], axis=0)),
            f"{name}, {kind}", LINE_COLOURS[mount], _MARKERS[mount], size, is_filled,
            rows=range(mount * count, (mount + 1) * count),
        )
        for mount, name in enumerate(product.mounts)
        for error, kind, size, is_filled in zip(
            _errors(product), ("naive", "planned"), (8.0, 5.0), (False, True), strict=True
        )
    ]  # fmt: skip
    return Chart(
        "Largest errors of all passes",
        [Panel(
            Axis("highest elevation of the pass", "deg", high=91.0),
            Axis("largest error", "deg", scale="log", low=0.7 * _FLOOR_DEG, high=_TOP_DEG),
            [*marks, _lock(product)], legend="right",
        )],
        "Filled: planned. Open: naive. Errors below 1e-4° are drawn at 1e-4°.",
        size_in=(7.0, 4.2),
        table=table,
    )  # fmt: skip


def keyhole_chart(product: Pointing, table: str) -> Chart:
    """Return satellite and beam near the keyhole of each mount, in its most demanding pass.

    The rows of `table` are mounts, each with all passes.
    """
    mounts = len(product.mounts)
    columns = min(2, mounts)
    return Chart(
        "Satellite and beam near the keyhole",
        [_keyhole_panel(product, mount, product.telling_pass(mount)) for mount in range(mounts)],
        "The same passes, around the direction of the primary axis. Thin lines connect satellite "
        "and planned beam at equal times.",
        columns=columns,
        shared_legend=True,
        size_in=(4.4 * columns, 0.3 + 4.1 * -(-mounts // 2)),
        table=table,
    )


def _keyhole_panel(product: Pointing, mount: int, chosen: int) -> Panel:
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

    target = project(satellite)
    naive, planned = (
        project(np.tensordot(frame.T, _unit(*(q[:n, chosen, mount] for q in angles)), 1))
        for angles in (
            (product.naive_primary_rad, product.naive_secondary_rad),
            (product.primary_rad, product.secondary_rad),
        )
    )
    near = np.degrees(distance[nearest])
    missed = np.degrees(np.max(product.error_rad[:n, chosen, mount][np.degrees(distance) < 45.0],
                               initial=0.0))  # fmt: skip
    reach = max(1.6 * near, 2.5 * missed, 3.0)
    row = mount * product.count.size + chosen
    near_by = np.abs(target).max(axis=0)
    drawn = np.flatnonzero(near_by < _AROUND * reach)
    drawn = drawn[:: -(-drawn.size // _SAMPLES) or 1]
    step = max(int(np.count_nonzero(near_by < reach)) // _TIES, 1)
    tied = np.arange(nearest % step, n, step)
    tied = tied[near_by[tied] < _AROUND * reach]
    gaps = np.full((2, tied.size), np.nan)
    ties = np.stack([target[:, tied], planned[:, tied], gaps], axis=2).reshape(2, -1)
    around = np.linspace(0.0, 2.0 * np.pi, 100)
    lock = np.degrees(product.lock_angle_rad)
    x, y = target[:, nearest]
    is_upright = product.kinds[mount] == "azimuth_elevation"
    right, above = ("east", "north of") if is_upright else ("right", "above")
    return Panel(
        Axis(f"{right} of the keyhole", "deg", low=-reach, high=reach),
        Axis(f"{above} the keyhole", "deg", low=-reach, high=reach),
        [
            *(Curve(path[0, drawn], path[1, drawn], name, colour, dash, width, rows=row)
              for path, (name, colour, dash, width) in zip(
                  (target, naive, planned), _PATHS, strict=True)),
            Curve(ties[0], ties[1], "", "blue", width=0.7),
            Curve(x + lock * np.cos(around), y + lock * np.sin(around), "lock angle", "black",
                  width=0.8),
            Points([0.0], [0.0], "keyhole", "black", "plus", 10.0),
        ],
        _mount_and_pass(product, mount),
        is_equal=True,
    )  # fmt: skip


def _unit(primary: Array, secondary: Array) -> Array:
    level = np.cos(secondary)
    return np.array([np.cos(primary) * level, np.sin(primary) * level, np.sin(secondary)])


def _errors(product: Pointing) -> tuple[Array, Array]:
    return product.naive_error_rad, product.error_rad


def _limit_below(error_rad: Array) -> NDArray[np.float64]:
    return np.maximum(np.degrees(error_rad), _FLOOR_DEG)


def _lock(product: Pointing) -> Rule:
    lock = float(np.degrees(product.lock_angle_rad))
    return Rule("y", lock, f"lock angle, {lock:g}°")


def _mount_and_pass(product: Pointing, mount: int) -> str:
    chosen = product.telling_pass(mount)
    return (
        f"{product.mounts[mount]}: {product.stations[chosen]}, revolution "
        f"{product.revolution[chosen]}, up to {np.degrees(product.elevation_max_rad[chosen]):.1f}°"
    )
