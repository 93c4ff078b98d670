"""Figures of ground tracks, covered latitudes and altitudes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere_orbits.coverage.products import Coverage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_coverage", "draw_tracks"]

_COLOURS = ("blue", "vermillion", "green")


def draw_coverage(figure: Figure, product: Coverage) -> None:
    """Draw the time over each latitude and the range of altitudes, a row per orbit."""
    from matplotlib.colors import PowerNorm

    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(product.labels))
    edges = np.degrees(product.band_rad)
    # bands that are never met stay white
    time = np.ma.masked_equal(product.band_time.T, 0.0)
    # a planar orbit spends all its time in a band, one in space a tenth: the root shows both
    mesh = left.pcolormesh(edges, np.arange(rows.size + 1) - 0.5, time, cmap="viridis_r",
                           norm=PowerNorm(0.5, vmin=0.0, vmax=1.0), edgecolors="white",
                           linewidth=0.4)  # fmt: skip
    figure.colorbar(
        mesh, ax=left, label="part of the time", location="top", shrink=0.8, aspect=30, pad=0.01
    )
    left.set_xlim(-90.0, 90.0)
    left.set_xticks(range(-90, 91, 30))
    left.set_xlabel("latitude of the ground point (deg)")
    left.set_yticks(rows, product.labels)
    left.set_ylim(rows.size - 0.5, -0.5)
    known = bool(np.isfinite(product.altitude_m).all())
    least, mean, largest = (product.altitude_m if known else product.distance_m) / 1e3
    right.hlines(rows, least, largest, color=PALETTE["blue"], lw=3.0, label="least to largest")
    right.plot(mean, rows, "o", color=PALETTE["black"], ms=4, label="mean")
    right.set_xlim(left=0.0)
    right.set_xlabel("altitude above the surface (km)" if known else "distance (km)")
    right.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=8)


def draw_tracks(figure: Figure, product: Coverage) -> None:
    """Draw the ground tracks of at most three orbits."""
    axes = figure.add_subplot()
    order = np.argsort(product.latitude_rad[1], kind="stable")
    chosen = dict.fromkeys(int(order[k]) for k in (-1, order.size // 2, 0))
    for colour, i in zip(_COLOURS, chosen, strict=False):
        longitude, latitude = np.degrees(product.track_rad[:, :, i])
        axes.plot(longitude, latitude, ".", ms=1.6, color=PALETTE[colour], label=product.labels[i])
    axes.set_xlim(-180.0, 180.0)
    axes.set_ylim(-90.0, 90.0)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yticks(range(-90, 91, 30))
    axes.set_aspect("equal")
    axes.set_xlabel("longitude, eastwards (deg)")
    axes.set_ylabel("latitude (deg)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, markerscale=6)
