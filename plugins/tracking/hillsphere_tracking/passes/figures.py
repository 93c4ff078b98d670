"""Figures of passes: the sky over a station, and ground tracks on a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.interfaces import Integers
from hillsphere.presentation import PALETTE
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import split_at_wrap
from hillsphere_tracking.passes.products import PassList

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SKIES_PER_FIGURE", "draw_map", "draw_skies"]

SKIES_PER_FIGURE = 12
"""Skies in one figure, in rows of three; with more a page cannot show it whole."""

_COLOURS = tuple(
    PALETTE[name] for name in ("blue", "vermillion", "green", "purple", "sky", "black")
)
_SUN = PALETTE["orange"]


def draw_skies(figure: Figure, product: PassList, chosen: Integers, start: Epoch) -> None:
    """Draw polar sky plots of passes of one station, with the zenith in the centre."""
    columns = min(3, chosen.size)
    rows = -(-chosen.size // columns)
    clock = start.isot(product.rise_s[chosen], 0)
    around = np.radians(np.arange(361.0))
    for place, (k, rise) in enumerate(zip(chosen, clock, strict=True)):
        axes = figure.add_subplot(rows, columns, place + 1, projection="polar")
        # theta runs from north eastwards, the radius is the distance from the zenith
        axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
        axes.set_theta_direction(-1)  # type: ignore[attr-defined]
        mask = np.degrees(np.clip(product.mask_rad[:, product.station[k]], 0.0, None))
        axes.fill_between(around, 90.0 - mask, 90.0, color="#bbbbbb", lw=0)
        azimuth, elevation = product.azimuth_rad[:, k], np.degrees(product.elevation_rad[:, k])
        colour = _COLOURS[product.satellite[k] % len(_COLOURS)]
        axes.plot(azimuth, 90.0 - elevation, color=colour)
        axes.plot(azimuth[0], 90.0 - elevation[0], "o", color=colour, ms=5)
        axes.plot(azimuth[-1], 90.0 - elevation[-1], "s", color=colour, ms=5)
        sun_azimuth, sun_elevation = product.sun_rad[:, k]
        if sun_elevation > 0.0:
            zenith = 90.0 - np.degrees(sun_elevation)
            axes.plot(sun_azimuth, zenith, "o", color=_SUN, ms=9, mec="black", mew=0.5)
        for span in np.flatnonzero(product.span_pass == k):
            begin, end = product.span_s[:, span]
            inside = (product.t_s[:, k] >= begin) & (product.t_s[:, k] <= end)
            axes.plot(azimuth[inside], 90.0 - elevation[inside], color=_SUN, lw=4, alpha=0.6)
        axes.set_ylim(0.0, 90.0)
        axes.set_yticks([30.0, 60.0, 90.0], ["60°", "30°", ""], fontsize=7)
        axes.set_xticks(np.radians([0.0, 90.0, 180.0, 270.0]), ["N", "E", "S", "W"])
        axes.tick_params(pad=0)
        axes.set_title(
            f"{product.satellites[product.satellite[k]]}, revolution {product.revolution[k]}",
            fontsize=9,
        )
        axes.set_xlabel(
            f"{rise[:10]} {rise[11:16]} UTC, up to {np.degrees(product.elevation_max_rad[k]):.1f}°",
            fontsize=8,
        )


def draw_map(figure: Figure, product: PassList) -> None:
    """Draw the ground tracks on a map; thick lines mark the parts that a station sees."""
    axes = figure.add_subplot()
    for n, satellite in enumerate(product.satellites):
        there = np.isfinite(product.ground_s[:, n])
        latitude, longitude, _ = np.degrees(product.ground[:, there, n])
        x, y = split_at_wrap(longitude, latitude, 360.0)
        colour = _COLOURS[n % len(_COLOURS)]
        axes.plot(x, y, color=colour, lw=0.5, alpha=0.6)
        t = product.ground_s[there, n]
        own = np.flatnonzero(product.satellite == n)
        visible = np.zeros(t.size, dtype=bool)
        for k in own:
            visible |= (t >= product.rise_s[k]) & (t <= product.set_s[k])
        x, y = split_at_wrap(longitude, np.where(visible, latitude, np.nan), 360.0)
        axes.plot(x, y, color=colour, lw=2.2, label=satellite if n < 12 else None)
    latitude, longitude = np.degrees(product.place_rad)
    longitude = (longitude + 180.0) % 360.0 - 180.0
    axes.plot(longitude, latitude, "^", color="black", ms=7, mec="white", zorder=5)
    for name, x_place, y_place in zip(product.stations, longitude, latitude, strict=True):
        axes.annotate(name, (x_place, y_place), xytext=(5, 4), textcoords="offset points",
                      fontsize=8, zorder=6)  # fmt: skip
    axes.set_xlim(-180.0, 180.0)
    axes.set_ylim(-90.0, 90.0)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yticks(range(-90, 91, 30))
    axes.set_aspect("equal")
    axes.set_xlabel("longitude, eastwards (deg)")
    axes.set_ylabel("geodetic latitude (deg)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
