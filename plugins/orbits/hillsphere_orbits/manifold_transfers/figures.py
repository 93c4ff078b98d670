"""Figures of transfers along manifolds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import PALETTE, Printed
from hillsphere.show.reference import ReferenceTable
from hillsphere_orbits.invariant_manifolds.presentation import (
    draw_body,
    draw_cylinder,
    finish_space,
)
from hillsphere_orbits.manifold_transfers.products import ManifoldTransfers
from hillsphere_orbits.spatial_qso_families.presentation import family_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["draw_front", "draw_transfer"]

_MARKERS = "os^DvP<>h*"


def draw_front(
    figure: Canvas, product: ManifoldTransfers, reference: ReferenceTable | None
) -> None:
    """Draw the impulse of transfers against their time of flight, one line per orbit.

    Colours tell n, markers the amplitude z.
    """
    axes = figure.add_subplot()
    dv, tof, member = (
        product.transfer_dv_m_s,
        product.transfer_tof_s / DAY_S,
        product.transfer_member,
    )
    orders = sorted(set(product.revolutions.tolist()))
    colours = dict(zip(orders, family_colours(len(orders)), strict=True))
    z_km = np.round(product.z_m / 1e3, 6)
    heights = sorted(set(z_km[np.unique(member)][np.isfinite(z_km[np.unique(member)])].tolist()))
    markers = {z: _MARKERS[k % len(_MARKERS)] for k, z in enumerate(heights)}
    seen: set[int] = set()
    for i in np.unique(member):
        own, n = member == i, int(product.revolutions[i])
        name = f"n = {n}" if n else product.orbits.labels[int(i)]
        axes.plot(tof[own], dv[own], marker=markers.get(float(z_km[i]), "."), color=colours[n],
                  lw=0.8, ms=4.0, mew=0.0, drawstyle="steps-post")  # fmt: skip
        if not n or n not in seen:  # in the legend a line without a marker
            axes.plot([], [], color=colours[n], label=name)
        seen.add(n)
    for z, marker in markers.items():
        axes.plot([], [], marker, color=PALETTE["black"], ms=5, label=f"Az = {z:g} km")
    if reference is not None:
        marked = [
            (float(row["tof_d"]), float(row["dv_m_s"]))
            for row in reference.rows
            if isinstance(row["tof_d"], Printed) and isinstance(row["dv_m_s"], Printed)
        ]
        if marked:
            axes.plot(*np.array(marked).T, "x", color=PALETTE["vermillion"], ms=9, mew=2,
                      label="the paper")  # fmt: skip
    axes.set_xlabel("time of flight of both legs (d)")
    axes.set_ylabel("ΔV of both impulses (m/s)")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def draw_transfer(figure: Canvas, product: ManifoldTransfers, q: int) -> None:
    """Draw a transfer that is among the product's flights, with the cylinders and the body."""
    axes = figure.add_subplot(projection="3d")
    label = product.orbits.labels[int(product.transfer_member[q])]
    duration = product.leg_tof_s[product.transfer_legs[:, q]]
    flights = product.flights
    length = flights.t_s[-1] - flights.t_s[0]
    parts = (("departure", PALETTE["blue"]), ("arrival", PALETTE["vermillion"]))
    height = 0.0
    for (name, colour), seconds in zip(parts, duration, strict=True):
        for k, plan in enumerate(flights.plans):
            same = abs(length[k] - seconds) <= 1e-9 * seconds
            if plan.startswith(f"{label}, ") and flights.labels[k] == name and same:
                way = flights.x[:3, :, k] / 1e3
                axes.plot(*way, color=colour, lw=0.9, label=f"{name} leg, {seconds / DAY_S:.2f} d")
                end = way[:, -1 if name == "arrival" else 0]
                axes.plot(*end[:, None], "o", color=colour, ms=5)
                height = max(height, float(np.max(np.abs(way[2]))))
                break
    for ring, colour, planar in (
        (product.departure_track_m, PALETTE["green"], product.departure),
        (product.arrival_track_m, PALETTE["purple"], product.arrival),
    ):
        draw_cylinder(axes, ring / 1e3, height, colour, planar.labels[0])
    draw_body(axes, product.semi_axes_m, product.prime_meridian_rad)
    finish_space(axes)
