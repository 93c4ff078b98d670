"""Figures of transfers through swing orbits; one panel per leg."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import (
    Axis,
    Chart,
    ColourScale,
    Curve,
    Mark,
    Note,
    Panel,
    Points,
    Rule,
)
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.scenes import AXES, moon_outline
from hillsphere_orbits.swing_transfers.products import SwingTransfers

__all__ = ["transfer_charts"]

_COLUMNS = 2
"""Panels beside one another: more would be too narrow to read in a report."""
_WIDTH_IN = 9.0
"""Width of a figure with two columns, inches."""
_PANEL_IN = (7.0, 3.6)
"""Width and height of a single panel, inches."""
_ORBIT_IN = (5.0, 5.2)
"""The same of a panel with orbits, which are longer than wide."""


def transfer_charts(product: SwingTransfers, label: str) -> Mapping[str, Chart]:
    """Return the figures by identifier, to which `label` is appended."""
    ratio = np.array(product.n) / np.array(product.d) if product.n else np.zeros(1)
    # Beyond nine tenths of the scale the colours are too light for a line.
    families = ColourScale("n/d of the family", "", float(ratio.min()),
                           float(ratio.min() + max(np.ptp(ratio), 1e-9) / 0.9))  # fmt: skip
    values = product.member_integral if product.member_integral.size else np.zeros(1)
    integrals = ColourScale("Jacobi constant", "", float(values.min()), float(values.max()))

    def chart(
        title: str,
        caption: str,
        table: str,
        panel: Callable[[int], Panel],
        size_in: tuple[float, float] = _PANEL_IN,
    ) -> Chart:
        legs, (width, height) = len(product.legs), size_in
        columns = min(legs, _COLUMNS)
        return Chart(
            title, [panel(leg) for leg in range(legs)], caption, columns=columns,
            size_in=(width if legs == 1 else _WIDTH_IN, height * -(-legs // columns)),
            shared_legend=size_in is _ORBIT_IN, table=label_identifier(table, label),
        )  # fmt: skip

    charts = {
        "swing_transfers": chart(
            "Cheapest transfer of each leg",
            "Departure and arrival orbit, the path from one to the other, and the body to scale.",
            "table_5", lambda leg: _transfer_panel(product, leg), _ORBIT_IN,
        ),
        "swing_along": chart(
            "Cost along the families",
            "Every member that connects the two orbits, by its Jacobi constant; marked: the least "
            "of each family, and the least of all. Dashed: the Jacobi constants of both orbits.",
            "swing_least", lambda leg: _along_panel(product, leg, families),
        ),
        "swing_front": chart(
            "Cost and time", "Pareto-optimal transfers, and the least cost of each family.",
            "swing_front", lambda leg: _front_panel(product, leg),
        ),
        "swing_tangency": chart(
            "Cost and tangency",
            "Cheapest transfer of every member that connects, against the mean of the angles at "
            "which it meets the two orbits.",
            "swing_ranks", lambda leg: _tangency_panel(product, leg, integrals),
        ),
    }  # fmt: skip
    return {label_identifier(name, label): made for name, made in charts.items()}


def _transfer_panel(product: SwingTransfers, leg: int) -> Panel:
    marks: list[Mark] = [moon_outline(product)]
    for orbits, label, colour in (
        (product.departure, "departure orbit", "blue"), (product.arrival, "arrival orbit", "green"),
    ):  # fmt: skip
        x, y = product.orbit_tracks_m[:, :, orbits[leg]] / 1e3
        marks.append(Curve(x, y, label, colour, width=1.4))
    for track in np.flatnonzero(product.track_leg == leg)[:1]:
        x, y = product.tracks_m[:, :, track] / 1e3
        marks += [
            Curve(x, y, "transfer", "vermillion", width=1.0, rows=leg),
            Points(x[:1], y[:1], "first impulse", "black", rows=leg),
            Points(x[-1:], y[-1:], "second impulse", "black", "square", rows=leg),
        ]
    return Panel(*AXES[:2], marks, product.legs[leg], is_equal=True)


def _along_panel(product: SwingTransfers, leg: int, scale: ColourScale) -> Panel:
    own, least = product.member_leg == leg, np.flatnonzero(product.least.leg == leg)
    ratio = np.array(product.n) / np.array(product.d)
    marks: list[Mark] = []
    for f in np.unique(product.member_family[own]).tolist():
        mine = np.flatnonzero(own & (product.member_family == f))
        # Families are drawn in pieces: some members in between do not connect.
        gaps = np.flatnonzero(np.diff(product.member_position[mine]) > 1) + 1
        integral, cost = (
            np.insert(values[mine], gaps, np.nan)
            for values in (product.member_integral, product.member_dv_m_s)
        )
        marks.append(Curve(integral, cost, "", scale.colour(ratio[f]), width=0.9))
    ends = product.orbit_integral[[product.departure[leg], product.arrival[leg]]]
    marks += [Rule("x", float(end), "", "grey", "dashed") for end in ends]
    x, y = Axis("Jacobi constant of the swing orbit"), Axis("ΔV", "m/s", low=0.0)
    if not least.size:
        return _empty_panel(product, leg, x, y)
    c, dv = product.least.integral[least], product.least.total_m_s[least]
    k, colours = int(np.argmin(dv)), product.least.family[least]
    name = product.families[colours[k]]
    marks += [
        Points(c, dv, "least of a family", size=4.5, values=ratio[colours], scale=scale,
               names=[product.families[f] for f in colours], rows=least.tolist()),
        Points(c[[k]], dv[[k]], f"least of all: {name}", "vermillion", "star", 12.0,
               rows=[int(least[k])]),
    ]  # fmt: skip
    top = 2.5 * float(dv[k]) + 0.2 * float(np.max(dv))
    seen = product.member_integral[own & (product.member_dv_m_s < top)]
    shown = np.concatenate([seen, c[dv < top], ends])
    margin = 0.05 * float(np.ptp(shown))
    x = replace(x, low=float(shown.min()) - margin, high=float(shown.max()) + margin)
    return Panel(x, replace(y, high=top), marks, product.legs[leg], scale=scale)


def _empty_panel(product: SwingTransfers, leg: int, x: Axis, y: Axis) -> Panel:
    return Panel(x, y, [Note(product.status[leg], corner="centre")], product.legs[leg])


def _front_panel(product: SwingTransfers, leg: int) -> Panel:
    x, y = Axis("time of flight", "d"), Axis("ΔV", "m/s", low=0.0)
    on = np.flatnonzero(product.front.leg == leg)
    least = np.flatnonzero(product.least.leg == leg)
    if not on.size:
        return _empty_panel(product, leg, x, y)
    days, dv = product.front.tof_s[on] / DAY_S, product.front.total_m_s[on]
    all_days, all_dv = product.least.tof_s[least] / DAY_S, product.least.total_m_s[least]
    marks: list[Mark] = [
        Curve(days, dv, "Pareto front", "blue", width=1.0, steps=True, marker="circle",
              rows=on.tolist()),
        Points(all_days, all_dv, "least of a family", "vermillion", "cross"),
        Rule("y", float(product.bound_m_s[leg]), "bound by energy"),
    ]  # fmt: skip
    dear = 1.1 * float(np.max(dv))
    late = float(np.max(np.concatenate([days, all_days[all_dv < dear]])))
    margin = 0.05 * (late - float(np.min(days))) + 1e-3 * late
    x = replace(x, low=float(np.min(days)) - margin, high=late + margin)
    return Panel(x, replace(y, high=dear), marks, product.legs[leg])


def _tangency_panel(product: SwingTransfers, leg: int, scale: ColourScale) -> Panel:
    x, y = Axis("mean angle between the orbits", "deg"), Axis("ΔV", "m/s")
    own, rho = product.member_leg == leg, product.rank[leg, 0, 0]
    if not own.any():
        return _empty_panel(product, leg, x, y)
    marks: list[Mark] = [
        Points(np.degrees(product.member_angle_rad[own]), product.member_dv_m_s[own], size=3.0,
               values=product.member_integral[own], scale=scale)
    ]  # fmt: skip
    if np.isfinite(rho):
        marks.append(Note(f"ρ = {rho:.2f}", corner="top left"))
    return Panel(x, y, marks, product.legs[leg])
