"""Figures of passes: the sky over a station, and ground tracks on a map."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Integers
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Band,
    Chart,
    Curve,
    Mark,
    Note,
    Panel,
    Points,
    Sky,
)
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import split_at_wrap
from hillsphere_tracking.passes.products import PassList

__all__ = ["SKIES_PER_FIGURE", "map_chart", "sky_chart"]

SKIES_PER_FIGURE = 12
"""Skies in one figure, in rows of three; with more a page cannot show it whole."""

_SUN = "orange"
_COLOURS = tuple(name for name in LINE_COLOURS if name != _SUN)
_NAMED = 12
"""Satellites in the legend of the map at most: it is as high as the map."""


def sky_chart(product: PassList, station: int, chosen: Integers, start: Epoch, table: str) -> Chart:
    """Return the sky of a station with each of the chosen passes, which are rows of `table`."""
    columns = min(3, chosen.size)
    clock = start.isot(product.rise_s[chosen], 0)
    return Chart(
        f"Passes in the sky of {product.stations[station]}",
        [_sky(product, k, rise) for k, rise in zip(chosen.tolist(), clock, strict=True)],
        "North is up and east to the right, as on a map; the rim is the horizon. Dot: rise. "
        "Square: set. Disc: Sun, if it is up. Grey: below the horizon mask. Yellow: in a blind "
        "sector, or with the Sun in the beam.",
        columns=columns,
        size_in=(0.6 + 2.9 * columns, 0.4 + 3.2 * -(-chosen.size // columns)),
        table=table,
    )


def _sky(product: PassList, k: int, rise: str) -> Sky:
    mask = np.degrees(np.clip(product.mask_rad[:, product.station[k]], 0.0, None))
    azimuth = np.degrees(product.azimuth_rad[:, k])
    zenith = 90.0 - np.degrees(product.elevation_rad[:, k])
    colour = _COLOURS[product.satellite[k] % len(_COLOURS)]
    marks: list[Curve | Points | Band] = [
        Band(np.arange(361.0), 90.0 - mask, np.full(361, 90.0), "", "light", 1.0),
        Curve(azimuth, zenith, "", colour, rows=k),
        Points(azimuth[:1], zenith[:1], "", colour, rows=k),
        Points(azimuth[-1:], zenith[-1:], "", colour, "square", rows=k),
    ]
    sun_azimuth, sun_elevation = np.degrees(product.sun_rad[:, k])
    if sun_elevation > 0.0:
        marks.append(Points([sun_azimuth], [90.0 - sun_elevation], "", _SUN, size=9.0))
    for begin, end in product.span_s[:, product.span_pass == k].T:
        inside = (product.t_s[:, k] >= begin) & (product.t_s[:, k] <= end)
        marks.append(Curve(azimuth[inside], zenith[inside], "", _SUN, width=4.0, opacity=0.6))
    return Sky(
        marks,
        f"{product.satellites[product.satellite[k]]}, revolution {product.revolution[k]}",
        f"{rise[:10]} {rise[11:16]} UTC, up to {np.degrees(product.elevation_max_rad[k]):.1f}°",
    )


def map_chart(product: PassList) -> Chart:
    """Return the ground tracks on a map; thick lines mark the parts that a station sees."""
    marks: list[Mark] = []
    for n, satellite in enumerate(product.satellites):
        there = np.isfinite(product.ground_s[:, n])
        latitude, longitude, _ = np.degrees(product.ground[:, there, n])
        colour = _COLOURS[n % len(_COLOURS)]
        track = split_at_wrap(longitude, latitude, 360.0)
        t = product.ground_s[there, n]
        visible = np.zeros(t.size, dtype=bool)
        for k in np.flatnonzero(product.satellite == n):
            visible |= (t >= product.rise_s[k]) & (t <= product.set_s[k])
        above = split_at_wrap(longitude, np.where(visible, latitude, np.nan), 360.0)
        label = satellite if n < _NAMED else ""
        marks += [
            Curve(*track, "", colour, width=0.5, opacity=0.6),
            Curve(*above, label, colour, width=2.2),
        ]
    latitude, longitude = np.degrees(product.place_rad)
    longitude = (longitude + 180.0) % 360.0 - 180.0
    marks.append(
        Points(longitude, latitude, "", "black", "triangle", 7.0, names=product.stations)
    )  # fmt: skip
    places = zip(product.stations, longitude.tolist(), latitude.tolist(), strict=True)
    marks += [Note(name, x, y) for name, x, y in places]
    return Chart(
        "Ground tracks and passes",
        [Panel(
            Axis("longitude, eastwards", "deg", low=-180.0, high=180.0, step=60.0),
            Axis("geodetic latitude", "deg", low=-90.0, high=90.0, step=30.0),
            marks, is_equal=True, legend="right",
        )],
        "Thin lines: subsatellite points, for one day at most. Thick lines: the satellite is above "
        "a station's horizon mask. Triangles: stations.",
        size_in=(8.5, 4.8),
    )  # fmt: skip
