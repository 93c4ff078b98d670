"""Figures of ground tracks, covered latitudes and altitudes."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    ColourScale,
    Curve,
    Map,
    Mark,
    Panel,
    Points,
    Segments,
)
from hillsphere_orbits.coverage.products import Coverage
from hillsphere_orbits.scenes import about_moon, name_axis

__all__ = ["coverage_chart", "track_chart"]

# A planar orbit spends all its time in a band, one in space a tenth: the root shows both.
_TIME = ColourScale("part of the time", power=0.5, reversed=True)
_POINTS = 2000
"""Points of a ground track: an orbit of 30 revolutions has some 60 on each."""


def coverage_chart(product: Coverage, table: str) -> Chart:
    """Return the time over each latitude and the range of altitudes, a row per orbit."""
    count = len(product.labels)
    rows, orbits = np.arange(count), name_axis(product.labels, 0.5)
    # Bands that are never met stay empty.
    time = np.where(product.band_time.T == 0.0, np.nan, product.band_time.T)
    bands = Map(np.degrees(product.band_rad), np.arange(count + 1) - 0.5, time, _TIME)
    is_known = bool(np.isfinite(product.altitude_m).all())
    least, mean, largest = (product.altitude_m if is_known else product.distance_m) / 1e3
    height = Axis("altitude above the surface" if is_known else "distance", "km", low=0.0,
                  high=1.05 * float(largest.max()))  # fmt: skip
    heights: list[Mark] = [
        Segments(rows, least, largest, "x", "least to largest", "blue", 3.0, rows=rows.tolist()),
        Points(mean, rows, "mean", "black", size=4.0, rows=rows.tolist()),
    ]
    latitude = Axis("latitude of the ground point", "deg", low=-90.0, high=90.0, step=30.0)
    return Chart(
        f"Latitudes{about_moon(product.body, 'of')} and altitudes",
        [Panel(latitude, orbits, [bands]), Panel(height, orbits, heights, legend="above")],
        "Left: part of the time over each band of latitude. Right: altitude, from the least to the "
        "largest, with its mean.",
        columns=2, share_y=True, widths=(3, 2), size_in=(9.0, 1.8 + 0.3 * max(4, count)),
        table=table,
    )  # fmt: skip


def track_chart(product: Coverage, table: str) -> Chart:
    """Return the ground tracks of at most three orbits."""
    order = np.argsort(product.latitude_rad[1], kind="stable")
    marks = []
    for colour, i in zip(
        LINE_COLOURS, dict.fromkeys(int(order[k]) for k in (-1, order.size // 2, 0)), strict=False
    ):
        stride = -(-product.track_rad.shape[1] // _POINTS)
        longitude, latitude = np.degrees(product.track_rad[:, ::stride, i])
        # A line must not cross the map where the longitude turns from 180° to −180°.
        turns = np.flatnonzero(np.abs(np.diff(longitude)) > 180.0) + 1
        x, y = np.insert(np.array([longitude, latitude]), turns, np.nan, axis=1)
        marks.append(Curve(x, y, product.labels[i], colour, width=1.0, rows=i))
    return Chart(
        f"Ground tracks on the surface{about_moon(product.body, 'of')}",
        [Panel(
            Axis("longitude, eastwards", "deg", low=-180.0, high=180.0, step=60.0),
            Axis("latitude", "deg", low=-90.0, high=90.0, step=30.0),
            marks, is_equal=True, legend="above",
        )],
        "The point of the surface nearest to the spacecraft, along one period of the orbits that "
        "reach least far, half as far and farthest in latitude.",
        size_in=(8.0, 4.8), table=table,
    )  # fmt: skip
