"""Figures of the comparison of trackers: outages, sweep, consistency, errors over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    Axis,
    Band,
    Bars,
    Chart,
    Curve,
    Dash,
    Mark,
    MarkerShape,
    Panel,
    Points,
    Rule,
    Segments,
)
from hillsphere.products.products import Bands
from hillsphere_tracking.assisted_tracking.figures import (
    AFTER_ACQUISITION,
    FLOOR_DEG,
    lock_marks,
    tracker_label,
    tracker_style,
)
from hillsphere_tracking.tracking_comparison.products import (
    AgeComparison,
    Consistency,
    TrackingComparison,
)

__all__ = ["age_chart", "band_chart", "consistency_chart", "outage_chart"]

_MARKS: tuple[MarkerShape, ...] = (
    "circle", "square", "triangle", "diamond", "triangle-down", "plus", "cross",
)  # fmt: skip
_DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted", "dashdot")
_PANELS = 18
"""Outages in the figure over time at most, six rows of three: its caption says how many there
are."""
_WIDE = 10.0
"""Ratio of the largest swept number to the smallest positive one beyond which these are drawn by
their logarithms."""


def outage_chart(
    product: TrackingComparison, published: Mapping[tuple[str, str], float], table: str
) -> Chart:
    """Return median and 5–95 % of the error of each outage and tracker, with published values.

    The rows of `table` are outages, each with all trackers.
    """
    places, count = np.arange(len(product.outages), dtype=float), len(product.trackers)
    marks: list[Mark] = [Rule("x", p - 0.5, "", "light", "solid", 0.6) for p in places[1:].tolist()]
    quantiles = np.degrees(product.quantiles[:, product.measures.index(product.measure)])
    for t, name in enumerate(product.trackers):
        low, middle, high = quantiles[:, t]
        x = places + 0.8 * ((t + 0.5) / count - 0.5)
        colour, _ = tracker_style(t)
        rows = range(t, places.size * count, count)
        marks += [
            Segments(x, low, high, "y", "", colour, 1.6, 0.7, rows=rows),
            Points(x, middle, tracker_label(name), colour, _MARKS[t % len(_MARKS)], rows=rows),
        ]
    keys = zip(product.passes, product.outages, strict=True)
    reference = np.array([published.get(key, np.nan) for key in keys])
    if np.isfinite(reference).any():
        marks.append(
            Segments(reference, places - 0.4, places + 0.4, "x", "published", "black", 1.6)
        )
    lock = float(np.degrees(product.lock_angle_rad))
    marks.append(Rule("y", lock, "beam", "black", "dashed", 0.9))
    minutes = [f"{loss_s / 60.0:g} min" for loss_s in product.loss_s]
    return Chart(
        "Largest error after each outage",
        [Panel(
            _outage_axis(product.passes, minutes),
            Axis("largest error of the prediction", "deg", scale="log"), marks,
        )],
        f"Medians and 5 % to 95 % of {product.ended} cases. Dashed: half-width of the beam."
        + (" Black: published values, one random draw each." if published else ""),
        shared_legend=True,
        size_in=(max(6.0, 1.6 + 0.62 * places.size), 5.0),
        table=table,
    )  # fmt: skip


def _outage_axis(passes: Sequence[str], outages: Sequence[str]) -> Axis:
    names = [f"{p}\n{outage}" for p, outage in zip(passes, outages, strict=True)]
    return Axis("pass, signal lost after", low=-0.5, high=len(names) - 0.5,
                ticks=list(enumerate(names)))  # fmt: skip


def age_chart(product: AgeComparison, styles: Sequence[str], table: str) -> Chart:
    """Return the mean of the medians of each tracker, and the time to reacquire, over a sweep.

    `styles` are the trackers in the order of their colours. The rows of `table` are points of the
    sweep, each with all trackers.
    """
    is_searched = bool(np.isfinite(product.reacquire_s).any())
    places, axis = _swept_axis(product)
    means: list[Mark] = []
    times: list[Mark] = []
    for t, name in enumerate(product.trackers):
        colour, _ = tracker_style(styles.index(name))
        for g, group in enumerate(dict.fromkeys(product.group)):
            here = np.flatnonzero([one == group for one in product.group])
            here = here[np.argsort(product.value[here], kind="stable")]
            x, rows = places[here], (here * len(product.trackers) + t).tolist()
            label = tracker_label(name) + (f", {group}" if group else "")
            mean_deg = np.degrees(product.mean_median_rad[t, here])
            median, most = product.reacquire_s[:, t, here]
            for marks, y in ((means, mean_deg), (times, median)):
                marks.append(
                    Curve(x, y, label, colour, _DASHES[g % len(_DASHES)],
                          marker=_MARKS[g % len(_MARKS)], rows=rows)
                )  # fmt: skip
            times.append(Segments(x, median, most, "y", "", colour, 0.9, 0.7, rows=rows))
    mean = Axis("mean over the outages of the\nmedian largest error", "deg", scale="log")
    time = Axis("time to reacquire\nof those found", "s", scale="log")
    panels = [Panel(axis, mean, means), Panel(axis, time, times)]
    return Chart(
        f"Trackers over {axis.label}",
        panels if is_searched else panels[:1],
        "Mean over the outages of the median over the cases, at each point."
        + (" Below: time to reacquire in cases that are found, from the median to 95 %."
           if is_searched else ""),
        share_x=True,
        shared_legend=True,
        size_in=(7.0, 8.0 if is_searched else 5.2),
        table=table,
    )  # fmt: skip


def _swept_axis(product: AgeComparison) -> tuple[Array, Axis]:
    """Return the places of the swept numbers and their axis.

    Numbers over more than a decade stand at their logarithms, and zero one decade below the
    smallest of the others.
    """
    value, name = product.value, product.name.replace("_", " ")
    positive = value[value > 0.0]
    if not positive.size or value.min() < 0.0 or positive.max() <= _WIDE * positive.min():
        return value, Axis(name, product.unit)
    places = np.log10(np.where(value > 0.0, value, 0.1 * positive.min()))
    ticks = sorted({place: f"{v:g}" for place, v in zip(places, value, strict=True)}.items())
    return places, Axis(name, product.unit, ticks=ticks)


def consistency_chart(product: Consistency, level: float, table: str) -> Chart:
    """Return the mean NEES of each outage and tracker, with the band of a consistent tracker.

    The rows of `table` are outages, each with all trackers.
    """
    places, count = np.arange(len(product.outages), dtype=float), len(product.trackers)
    low, high = product.interval[0].max(axis=0), product.interval[1].min(axis=0)
    marks: list[Mark] = [
        Bars(places, high, base=low, width=1.0, label=f"{100.0 * level:g} % band", colour="light",
             opacity=0.5),
        Rule("y", 2.0, "expected", "black", "dashed", 0.9),
    ]  # fmt: skip
    for t, name in enumerate(product.trackers):
        x = places + 0.6 * ((t + 0.5) / count - 0.5)
        marks.append(
            Points(x, product.mean[t], tracker_label(name), tracker_style(t)[0],
                   _MARKS[t % len(_MARKS)], rows=range(t, places.size * count, count))
        )  # fmt: skip
    return Chart(
        "Consistency of the trackers",
        [Panel(
            _outage_axis(product.passes, product.outages), Axis("mean NEES", scale="log"), marks,
        )],
        "Normalised estimation error squared (NEES) of predictions. Above the band the tracker is "
        "overconfident, below the band it is too cautious.",
        shared_legend=True,
        size_in=(max(6.0, 1.6 + 0.5 * places.size), 4.4),
        table=table,
    )  # fmt: skip


def band_chart(product: TrackingComparison, bands: Bands) -> Chart | None:
    """Return quantiles of errors over time, one panel per outage; None if there are none."""
    rows = {name: row for row, name in enumerate(bands.names)}
    minutes = bands.time_s / 60.0
    middle = int(np.argmin(np.abs(np.array(bands.levels) - 0.5)))
    panels = []
    for pass_, outage, loss_s in zip(product.passes, product.outages, product.loss_s, strict=True):
        curves: list[Mark] = []
        for t, tracker in enumerate(product.trackers):
            row = rows.get(f"{pass_}.{outage}.{tracker}.error")
            if row is None:
                continue
            values = np.maximum(np.degrees(bands.values[:, row]), FLOOR_DEG)
            there = np.isfinite(values[middle])
            x, values = minutes[there], values[:, there]
            colour, _ = tracker_style(t)
            curves += [
                Band(x, values[0], values[-1], "", colour, 0.25),
                Curve(x, values[middle], tracker_label(tracker), colour, width=1.2),
            ]
        if curves:
            error = Axis("error √(ΔA² + Δh²)", "deg", scale="log")
            marks = [*lock_marks(float(loss_s), product.lock_angle_rad), *curves]
            title = f"{pass_}, lost after {loss_s / 60.0:g} min"
            panels.append(Panel(AFTER_ACQUISITION, error, marks, title))
    if not panels:
        return None
    low, high = (100.0 * level for level in (bands.levels[0], bands.levels[-1]))
    left = f" The first {_PANELS} of {len(panels)} outages." if len(panels) > _PANELS else ""
    shown = panels[:_PANELS]
    columns = min(3, len(shown))
    return Chart(
        "Errors over time, over all cases",
        shown,
        f"Median and {low:g} % to {high:g} % of the cases at each time. Shaded: the signal is "
        f"received. Dashed: half-width of the beam.{left}",
        columns=columns,
        share_y=True,
        shared_legend=True,
        size_in=(1.0 + 3.3 * columns, 0.9 + 2.3 * -(-len(shown) // columns)),
    )
