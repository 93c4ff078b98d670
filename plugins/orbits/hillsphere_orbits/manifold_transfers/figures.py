"""Figures of transfers along manifolds."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import (
    Axis,
    Chart,
    Cloud,
    Curve,
    Mark,
    Panel,
    Path,
    Points,
    Printed,
    Solid,
    Space,
)
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.spaces import with_room
from hillsphere_orbits.manifold_transfers.products import ManifoldTransfers
from hillsphere_orbits.scenes import (
    DIRECTIONS,
    MARKERS,
    SPACE_AXES,
    cylinder_solids,
    family_colours,
    moon_solid,
)

__all__ = ["front_chart", "transfer_chart"]

_SAME = 1e-9
"""Relative difference of the durations of one leg, which come from the same numbers."""


def front_chart(product: ManifoldTransfers, reference: ReferenceTable | None, table: str) -> Chart:
    """Return the impulse of transfers against their time of flight, one line per orbit.

    Colours tell n, markers the amplitude z; `table` lists the orbits.
    """
    dv, tof, member = (
        product.transfer_dv_m_s,
        product.transfer_tof_s / DAY_S,
        product.transfer_member,
    )
    orders = sorted(set(product.revolutions.tolist()))
    colours = dict(zip(orders, family_colours(len(orders)), strict=True))
    z_km, drawn = np.round(product.z_m / 1e3, 6), np.unique(member).tolist()
    heights = sorted(set(z_km[drawn][np.isfinite(z_km[drawn])].tolist()))
    markers = {z: MARKERS[k % len(MARKERS)] for k, z in enumerate(heights)}
    marks: list[Mark] = []
    for i in drawn:
        own, n = member == i, int(product.revolutions[i])
        name = f"n = {n}" if n else product.orbits.labels[i]
        marks += [
            Curve(tof[own], dv[own], name, colours[n], width=0.9, steps=True, rows=i),
            Points(tof[own], dv[own], "", colours[n], markers.get(float(z_km[i]), "dot"), 4.5,
                   rows=i),
        ]  # fmt: skip
    # Entries of the legend alone: the markers of the curves have colours besides.
    marks += [
        Points([np.nan], [np.nan], f"Az = {z:g} km", "black", marker)
        for z, marker in markers.items()
    ]
    printed = [] if reference is None else [
        (float(row["tof_d"]), float(row["dv_m_s"]))
        for row in reference.rows
        if isinstance(row["tof_d"], Printed) and isinstance(row["dv_m_s"], Printed)
    ]  # fmt: skip
    if printed:
        days, costs = zip(*printed, strict=True)
        marks.append(Points(days, costs, "the paper", "vermillion", "cross", 9.0))
    return Chart(
        "Time of flight against impulse",
        [Panel(Axis("time of flight of both legs", "d"), Axis("ΔV of both impulses", "m/s"), marks,
               legend="right")],
        "Pareto-optimal transfers through each orbit; the colour shows n, the marker the "
        "amplitude z.",
        size_in=(8.0, 5.5), table=table,
    )  # fmt: skip


def transfer_chart(product: ManifoldTransfers, q: int, title: str, table: str) -> Chart:
    """Return a transfer that is among the product's flights, with the cylinders and the body.

    `table` lists the legs.
    """
    label, flights = product.orbits.labels[int(product.transfer_member[q])], product.flights
    length = flights.t_s[-1] - flights.t_s[0]
    solids: list[Solid] = []
    height = 0.0
    for name, colour, leg in zip(
        ("departure", "arrival"), ("blue", "vermillion"), product.transfer_legs[:, q].tolist(),
        strict=True,
    ):  # fmt: skip
        seconds = product.leg_tof_s[leg]
        k = next(
            k for k, plan in enumerate(flights.plans)
            if plan.startswith(f"{label}, ") and flights.labels[k] == name
            and abs(length[k] - seconds) <= _SAME * seconds
        )  # fmt: skip
        way = flights.x[:3, :, k] / 1e3
        end = way[:, -1:] if name == "arrival" else way[:, :1]
        solids += [
            Path(way, f"{name} leg, {seconds / DAY_S:.2f} d", colour, rows=leg,
                 times=flights.t_s[:, k] / DAY_S),
            Cloud(end, "", colour, size=6.0),
        ]  # fmt: skip
        height = max(height, float(np.max(np.abs(way[2]))))
    for ring, colour, planar in (
        (product.departure_track_m, "green", product.departure),
        (product.arrival_track_m, "purple", product.arrival),
    ):
        solids += cylinder_solids(ring / 1e3, height, colour, planar.labels[0])
    space = Space([*solids, moon_solid(product)], *SPACE_AXES, time=Axis("time", "d"))
    return Chart(
        title, [with_room(space)],
        f"Through {label}: {product.transfer_dv_m_s[q]:.2f} m/s in "
        f"{product.transfer_tof_s[q] / DAY_S:.2f} d. Transparent: cylinders over the planar "
        f"orbits. Equal axes: {DIRECTIONS}",
        shared_legend=True, size_in=(8.0, 7.0), table=table,
    )  # fmt: skip
