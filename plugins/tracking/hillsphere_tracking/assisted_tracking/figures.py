"""Figures of one case of assisted tracking: errors over time, standard deviations, sky plots."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Band,
    Chart,
    Curve,
    Dash,
    Mark,
    Panel,
    Points,
    Rule,
    Sky,
    Span,
)
from hillsphere_tracking.assisted_tracking.products import AssistedTracking

__all__ = [
    "AFTER_ACQUISITION", "FLOOR_DEG", "ROWS_PER_FIGURE", "SKIES_PER_FIGURE", "error_chart",
    "lock_marks", "sky_chart", "spread_chart", "tracker_label", "tracker_style",
]  # fmt: skip

ROWS_PER_FIGURE = 3
"""Passes in one figure of errors; with more a page cannot show it whole."""
SKIES_PER_FIGURE = 12
"""Skies in one figure, in rows of three; with more a page cannot show it whole."""
FLOOR_DEG = 1e-3
"""Errors below this are drawn here, so that a logarithmic axis keeps its room for those that
matter: no antenna of this study measures a thousandth of a degree."""
AFTER_ACQUISITION = Axis("after acquisition", "min")

_DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted")
_COLUMNS = 4
"""Outages of a pass side by side at most."""
_SAMPLES = 100
"""Points of a standard deviation over time, about: it has no corners."""
_MEASURED = 60
"""Measurements of a pass that are drawn in the sky, about: more dots merge into a line."""


def tracker_style(number: int) -> tuple[str, Dash]:
    """Return colour and dashes of a tracker by its number, the same in every figure."""
    turn, place = divmod(number, len(LINE_COLOURS))
    return LINE_COLOURS[place], _DASHES[turn % len(_DASHES)]


def tracker_label(name: str) -> str:
    """Return the name of a tracker in words."""
    return name.replace("_", " ")


def lock_marks(loss_s: float, lock_angle_rad: float | None = None) -> list[Mark]:
    """Return marks of the time before the loss of signal and of the half-width of the beam."""
    end = loss_s / 60.0
    marks: list[Mark] = [Span("x", 0.0, end), Rule("x", end, dash="solid", width=0.9)]
    if lock_angle_rad is not None:
        lock_deg = float(np.degrees(lock_angle_rad))
        marks.append(Rule("y", lock_deg, colour="black", dash="dashed", width=0.9))
    return marks


def error_chart(product: AssistedTracking, chosen: Integers, title: str, table: str) -> Chart:
    """Return the errors √(ΔA² + Δh²) over time, one panel per outage of the chosen passes.

    The rows of `table` are outages, each with all trackers.
    """
    columns = min(int(np.bincount(product.outage_pass)[chosen].max()), _COLUMNS)
    outages = [k for p in chosen for k in np.flatnonzero(product.outage_pass == p).tolist()]
    largest = float(np.degrees(np.nanmax(product.error_rad[:, outages], initial=0.0)))
    axis = _angle_axis("error √(ΔA² + Δh²)", largest)
    panels = [_error_panel(product, k, axis) for k in outages]
    lock_deg = np.degrees(product.lock_angle_rad)
    return Chart(
        f"Errors over time{title}",
        panels,
        "Shaded: the signal is received and measurements are used. After the loss the curves are "
        f"errors of the prediction. Dashed: half-width of the beam, {lock_deg:g}°.",
        columns=columns,
        share_y=True,
        shared_legend=True,
        size_in=(1.2 + 3.3 * columns, 0.9 + 2.5 * -(-len(panels) // columns)),
        table=table,
    )


def _angle_axis(label: str, largest_deg: float) -> Axis:
    """Return the logarithmic axis of all panels of a figure."""
    return Axis(label, "deg", "log", 0.7 * FLOOR_DEG, max(1.5 * largest_deg, 10.0 * FLOOR_DEG))


def _error_panel(product: AssistedTracking, outage: int, axis: Axis) -> Panel:
    p, count = int(product.outage_pass[outage]), len(product.trackers)
    minutes = product.t_s[:, p] / 60.0
    errors = np.maximum(np.degrees(product.error_rad[:, outage]), FLOOR_DEG)
    loss_s = float(product.outage_s[outage])
    return Panel(
        AFTER_ACQUISITION, axis,
        [
            *lock_marks(loss_s, product.lock_angle_rad),
            *(Curve(minutes, errors[t], tracker_label(name), *tracker_style(t), 1.2,
                    rows=outage * count + t)
              for t, name in enumerate(product.trackers)),
        ],
        f"{product.passes[p]}, lost after {loss_s / 60.0:g} min",
    )  # fmt: skip


def spread_chart(product: AssistedTracking, outage: int, chosen: Integers, table: str) -> Chart:
    """Return the error on the sky with its standard deviation, one panel per chosen tracker.

    The rows of `table` are outages, each with all trackers.
    """
    p, count = int(product.outage_pass[outage]), len(product.trackers)
    minutes = product.t_s[:, p] / 60.0
    drawn = (3.0 * product.spread_rad[chosen, outage], product.sky_error_rad[chosen, outage])
    largest = max(float(np.degrees(np.nanmax(values, initial=0.0))) for values in drawn)
    angle = _angle_axis("angle", largest)
    panels = []
    for t in chosen.tolist():
        spread = np.degrees(product.spread_rad[t, outage])
        there = np.flatnonzero(np.isfinite(spread))
        there = there[:: max(1, there.size // _SAMPLES)]
        floor = np.full(there.size, FLOOR_DEG)
        error = np.maximum(np.degrees(product.sky_error_rad[t, outage]), FLOOR_DEG)
        marks = lock_marks(float(product.outage_s[outage]))
        marks += [
            Band(minutes[there], floor, np.maximum(sigmas * spread[there], FLOOR_DEG), f"{sigmas}σ",
                 opacity=opacity)
            for sigmas, opacity in ((3, 0.18), (2, 0.22), (1, 0.28))
        ]  # fmt: skip
        row = outage * count + t
        marks.append(Curve(minutes, error, "error on the sky", "blue", width=1.2, rows=row))
        panels.append(Panel(AFTER_ACQUISITION, angle, marks, tracker_label(product.trackers[t])))
    columns = min(3, len(panels))
    return Chart(
        f"Errors and their standard deviations, {product.passes[p]}",
        panels,
        "Line: error on the sky. Bands: one, two and three standard deviations of the tracker "
        "along the major axis of its covariance. Shaded: the signal is received.",
        columns=columns,
        share_y=True,
        shared_legend=True,
        size_in=(1.0 + 3.3 * columns, 0.9 + 2.6 * -(-len(panels) // columns)),
        table=table,
    )


def sky_chart(product: AssistedTracking, chosen: Integers, title: str, table: str) -> Chart:
    """Return the sky with each chosen pass, which is a row of `table`."""
    columns = min(3, chosen.size)
    return Chart(
        f"Passes in the sky{title}",
        [_sky(product, p) for p in chosen.tolist()],
        "North is up and east to the right, as on a map; the rim is the horizon. Line: true path. "
        "Dots: measurements before the first loss. Diamonds: losses of signal. Square: set.",
        columns=columns,
        shared_legend=True,
        size_in=(0.6 + 2.9 * columns, 0.6 + 3.2 * -(-chosen.size // columns)),
        table=table,
    )


def _sky(product: AssistedTracking, p: int) -> Sky:
    there = np.isfinite(product.t_s[:, p])
    t_s, path = product.t_s[there, p], _on_sky(product.true_rad[:, there, p])
    losses = product.outage_s[product.outage_pass == p]
    before = np.flatnonzero(t_s <= losses.min())
    measured = _on_sky(product.measured_rad[:, there, p])
    measured = measured[:, before[:: max(1, before.size // _MEASURED)]]
    lost = path[:, np.minimum(np.searchsorted(t_s, losses), t_s.size - 1)]
    return Sky(
        [
            Curve(path[0], path[1], "true path", "grey", width=1.2, rows=p),
            Points(path[0, -1:], path[1, -1:], "set", "grey", "square", rows=p),
            Points(measured[0], measured[1], "measured", "blue", "dot", rows=p),
            Points(lost[0], lost[1], "signal lost", "vermillion", "diamond", rows=p),
        ],
        f"{product.passes[p]}, {product.stations[p]}",
        f"{product.directions[p]}, up to {np.degrees(product.elevation_max_rad[p]):.1f}°",
    )


def _on_sky(angles: Array) -> Array:
    """Return azimuth and distance from the zenith, degrees, of azimuth and elevation (2, n)."""
    azimuth, elevation = np.degrees(angles)
    return np.array([azimuth, 90.0 - elevation])
