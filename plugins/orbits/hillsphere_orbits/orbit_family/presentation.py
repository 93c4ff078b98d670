"""Tables, figures and sentences about a family that was followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Curve,
    Mark,
    Metric,
    Panel,
    Points,
    Presentation,
    Rule,
    Span,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, take_or_blank
from hillsphere_orbits.orbit_family.products import FollowedFamily
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.scenes import orbit_paths, scene_chart
from hillsphere_orbits.stability import multipliers

__all__ = ["present_followed"]

_WORDS = {"amplitude": "amplitude", "period": "period", "jacobi": "integral of motion"}
_LARGE = 4.0
"""Stability index beyond which a second panel shows its modulus on a logarithmic scale."""


def present_followed(product: FollowedFamily, label: str) -> Presentation:
    """Show members, curve and ways.

    Parameters
    ----------
    product : FollowedFamily
        What is shown.
    label : str
        Appended to all identifiers.
    """
    title, own = "Orbits asked for", label_identifier("orbit_family", label)
    place = {name: row for row, name in enumerate(product.asked)}
    rows = [place[name] for name in product.members.labels]
    notes = ["Numbers without unit are in natural units."]
    tables = {own: tabulate(title, _members(product), notes)}
    figures = {label_identifier("orbit_family_indices", label): _index_chart(product, rows, own)}
    if rows:
        paths = orbit_paths(product.tracks_m, product.members.labels, range(len(rows)))
        figures[label_identifier("orbit_family_orbits", label)] = scene_chart(
            title, [replace(path, rows=row) for path, row in zip(paths, rows, strict=True)],
            product, "One period, in the frame of the motion, to scale.", table=own,
        )  # fmt: skip
    if product.parameters:
        of = FieldColumns(product, "parameters")
        tables[label_identifier("orbit_family_parameters", label)] = tabulate(
            "Parameters that change",
            [
                of("parameters", "parameter"),
                of("parameter_start", "start"),
                of("parameter_end", "end"),
            ],
        )
        figures[label_identifier("orbit_family_ways", label)] = _way_chart(product, own)
    arrived = len(product.members.labels)
    closure = float(np.max(product.members.residual, initial=0.0))
    return Presentation(
        metrics={
            label_identifier("orbits_asked_for", label): Metric(len(product.asked)),
            label_identifier("orbits_found", label): Metric(arrived),
            label_identifier("largest_closure", label): Metric(closure),
        },
        tables=tables,
        figures=figures,
        verdict=_sentences(product),
    )


def _members(product: FollowedFamily) -> list[FilledColumn]:
    orbits, of = product.members, FieldColumns(product, "asked")
    speed, y = orbits.length_m / orbits.time_s, orbits.states.index("vy")
    place = {name: i for i, name in enumerate(orbits.labels)}
    index = [place.get(name, -1) for name in product.asked]

    def column_of(name: str, values: Array, label: str, digits: int) -> FilledColumn:
        finite = np.where(np.isfinite(values), values, np.nan)
        return column(name, take_or_blank(finite, index), label, digits)

    larger, smaller = product.member_indices
    largest = np.abs(multipliers(orbits.monodromy)[0]) if orbits.labels else np.empty(0)
    return [
        of("asked", "orbit"),
        of("status"),
        column_of("amplitude_km", product.member_amplitude_m, "amplitude", 9),
        column_of("x0", orbits.x0[0] / orbits.length_m, "x at the start", 12),
        column_of("z0", orbits.x0[2] / orbits.length_m, "z at the start", 12),
        column_of("vy0", orbits.x0[y] / speed, "ẏ at the start", 12),
        column_of("period", orbits.period_s / orbits.time_s, "period", 12),
        column_of("period_h", orbits.period_s, "period", 9),
        column_of("jacobi", orbits.integral, "integral of motion", 12),
        column_of("b_1", larger, "planar index; larger in space", 10),
        column_of("b_2", smaller, "vertical index; smaller in space", 10),
        column_of("lambda_max", largest, "largest |λ|", 9),
        column_of("closure", orbits.residual, "closure", 2),
    ]


def _sentences(product: FollowedFamily) -> list[str]:
    low, high = product.curve_amplitude_m[[0, -1]] / 1e3
    sentences = [
        f"The family was followed from amplitude {low:.6g} km ({product.ends[0]}) to {high:.6g} km "
        f"({product.ends[1]}); orbits over {product.method}."
    ]
    if product.parameters:
        kept = ", ".join(_WORDS[word] for word in dict.fromkeys(product.held))
        sentences.append(
            f"With {', '.join(product.parameters)} changing and {kept} held, "
            f"{format_count(len(product.members.labels), 'orbit', of=len(product.asked))} arrived."
        )
    sentences += [
        f"{name}: {status}."
        for name, status in zip(product.asked, product.status, strict=True)
        if status != "reached"
    ]
    inside = np.flatnonzero(product.member_clearance < 0.0)
    sentences += [f"{product.members.labels[i]} passes through the body." for i in inside]
    return sentences


def _index_chart(product: FollowedFamily, rows: list[int], table: str) -> Chart:
    amplitude, members = product.curve_amplitude_m / 1e3, product.member_amplitude_m / 1e3
    is_flat = bool(np.all(product.curve.x0[[2, 5]] == 0.0))
    names = ("planar", "vertical") if is_flat else ("larger", "smaller")

    def marks(curve: Array, member: Array) -> list[Mark]:
        return [
            mark
            for name, colour, along, at in zip(
                names, ("blue", "vermillion"), curve, member, strict=True
            )
            for mark in (
                Curve(amplitude, along, name, colour),
                Points(members, at, f"{name}, asked for", colour, rows=rows),
            )
        ]

    curve, member = product.curve_indices, product.member_indices
    finite = curve[np.isfinite(curve)]
    x, caption = Axis("amplitude", "km"), "Stability indices b = λ + 1/λ; shaded: stable."
    panels = [Panel(
        x, Axis("stability index b", low=max(-_LARGE, min(-2.3, finite.min(initial=0.0) - 0.2)),
                high=min(_LARGE, max(2.3, finite.max(initial=0.0) + 0.2))),
        [Span("y", -2.0, 2.0), *marks(curve, member)],
    )]  # fmt: skip
    if np.any(np.abs(finite) > _LARGE):
        panels.append(Panel(x, Axis("modulus |b|", scale="log"),
                            [*marks(np.abs(curve), np.abs(member)), Rule("y", 2.0)],
                            legend="none"))  # fmt: skip
        caption += " Below: the moduli, stable under the dotted line."
    return Chart("Stability along the family", panels, caption, share_x=True, table=table)


def _way_chart(product: FollowedFamily, table: str) -> Chart:
    panels = []
    for axis, values in (
        (Axis("x at the start", "km"), product.way_x0[0] / 1e3),
        (Axis("period", "h"), product.way_period_s / HOUR_S),
        (Axis("integral of motion (natural units)"), product.way_integral),
    ):
        marks = [
            Curve(product.way_fraction[own], values[own], product.asked[k],
                  LINE_COLOURS[k % len(LINE_COLOURS)], width=1.0, marker="dot", rows=k)
            for k in np.unique(product.way_orbit).tolist()
            for own in [product.way_orbit == k]
        ]  # fmt: skip
        panels.append(Panel(Axis("part of the change"), axis, marks))
    return Chart(
        "Orbits as the parameters change", panels,
        "Against the part of the change of the parameters; dots are the orbits computed.",
        columns=3, shared_legend=True, size_in=(9.5, 4.0), table=table,
    )  # fmt: skip
