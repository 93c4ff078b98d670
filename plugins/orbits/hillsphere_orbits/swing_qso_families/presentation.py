"""Tables, metrics, figures and sentences about planar orbits of several revolutions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    Axis,
    Chart,
    Curve,
    Mark,
    Metric,
    Note,
    Panel,
    Points,
    Presentation,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.scenes import about_moon, family_colours, moon_outline
from hillsphere_orbits.swing_qso_families.products import SwingFamilies

__all__ = ["present_swing"]

_COLUMNS = 5  # panels in a row
_MOST_PANELS = 30
"""Families of which an orbit is drawn: six rows."""
_LEAST_JACOBI = 4.0
"""Low end of the axis in multiples of the least Jacobi constant at which a family branches off
(all are negative): the families go on to orbits that would press the others together."""


def present_swing(product: SwingFamilies, family: QsoFamily | None, label: str) -> Presentation:
    """Show families of planar orbits of several revolutions.

    Parameters
    ----------
    product : SwingFamilies
        What is shown.
    family : QsoFamily or None
        The orbits of one revolution, drawn beside them.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Tables ``swing_families`` and, unless there are none, ``swing_members`` and
        ``swing_events``, figures ``swing_orbits`` and ``swing_curves``, checks as metrics.
    """
    curve = product.curve
    about = about_moon(product.body)
    scale = [
        "Without unit: in units of L = (μ/n²)^(1/3) = "
        f"{curve.length_m / 1e3:.12g} km and 1/n = {curve.time_s:.12g} s; "
        "periods are those of all revolutions.",
        f"Orbits found over {product.method}; closure {product.check}.",
    ]
    growth = np.maximum(1e3, np.max(np.abs(product.curve_indices), axis=0))
    metrics = {
        "swing_closure_max": Metric(float(np.max(curve.residual))),
        "swing_closure_over_lambda_max": Metric(float(np.max(curve.residual / growth))),
        "swing_half_closure_max": Metric(float(np.max(product.curve_half_residual))),
        "swing_families": Metric(len(product.n)),
        "swing_asymmetric_families": Metric(product.symmetry.count("none")),
    }
    tables = {
        "swing_families": tabulate(
            f"Families of orbits of several revolutions{about}", _families(product),
            [*scale, *product.notes],
        ),
    }  # fmt: skip
    if product.member_family.size:
        tables["swing_members"] = tabulate(
            f"Orbits of several revolutions{about}", _members(product), scale
        )
    if product.event_family.size:
        tables["swing_events"] = tabulate(
            "Secondary bifurcations along these families", _events(product),
            ["fold: the Jacobi constant turns; branching: orbits of the same period and less "
             "symmetry (or out of the plane) begin; doubling: orbits of twice the period."],
        )  # fmt: skip
    own = label_identifier("swing_families", label)
    figures = {
        "swing_orbits": _orbit_chart(product, own),
        "swing_curves": _curve_chart(product, family, own),
    }
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _resonance(product: SwingFamilies, family: int) -> str:
    return f"{product.d[family]}:{product.n[family]}"


def _starts_m(product: SwingFamilies, families: Sequence[int], x0: Array) -> Array:
    """Return the distance of starts x0 (6, N) of orbits of N families on their axis (N,), m."""
    rows = [0 if product.axis[f] == "x" else 1 for f in families]
    return np.asarray(np.abs(x0[rows, np.arange(len(rows))]))


def _families(product: SwingFamilies) -> list[FilledColumn]:
    of, curve, families = FieldColumns(product, "families"), product.curve, range(len(product.n))
    own = [np.flatnonzero(product.curve_family == f) for f in families]
    first, last = ([int(orbits[k]) for orbits in own] for k in (0, -1))
    parents = ["one revolution" if f < 0 else product.name(f) for f in product.parent]
    nearest = [product.curve_least_m[orbits].min() for orbits in own]
    farthest = [product.curve_largest_m[orbits].max() for orbits in own]
    stable = [np.count_nonzero(product.curve_stable[orbits]) for orbits in own]
    return [
        text_column("family", [product.name(f) for f in families], "family"),
        text_column("resonance", [_resonance(product, f) for f in families], "d:n"),
        of("symmetry"),
        text_column("parent", parents, "branches off"),
        column("bifurcation_km", _starts_m(product, families, product.origin.x0),
               "start of the bifurcating orbit", 8),
        column("jacobi_from", curve.integral[first], "Jacobi constant from", 8),
        column("jacobi_to", curve.integral[last], "to", 8),
        column("period_from_h", curve.period_s[first], "period from", 7),
        column("period_to_h", curve.period_s[last], "to", 7),
        column("nearest_km", nearest, "nearest to the centre", 6),
        column("farthest_km", farthest, "farthest from it", 6),
        column("stable_orbits", stable, "stable orbits of its curve"),
        column("orbits", [orbits.size for orbits in own], "orbits of its curve"),
        of("ends", "end"),
    ]  # fmt: skip


def _members(product: SwingFamilies) -> list[FilledColumn]:
    orbits, family = product.members, product.member_family.tolist()
    of, own = FieldColumns(orbits, "orbits"), FieldColumns(product, "members")
    speed = orbits.length_m / orbits.time_s
    planar, vertical = product.member_indices
    return [
        of("labels", "orbit"),
        text_column("resonance", [_resonance(product, f) for f in family], "d:n"),
        text_column("symmetry", [product.symmetry[f] for f in family], "symmetry"),
        column("x0", orbits.x0[0] / orbits.length_m, "x at the start", 12),
        column("y0", orbits.x0[1] / orbits.length_m, "y at the start", 12),
        column("vx0", orbits.x0[3] / speed, "ẋ at the start", 12),
        column("vy0", orbits.x0[4] / speed, "ẏ at the start", 12),
        column("period", orbits.period_s / orbits.time_s, "period in 1/n", 12),
        of("period_s"),
        of("integral", "jacobi"),
        column("b_planar", planar, "planar index", 9),
        column("b_vertical", vertical, "vertical index", 9),
        column("lambda_max", np.max(np.abs(product.member_multipliers), axis=0), "largest |λ|", 7),
        own("member_stable", "stable"),
        of("residual", "closure"),
        own("member_half_residual", "half_closure"),
    ]


def _events(product: SwingFamilies) -> list[FilledColumn]:
    orbits, family = product.event_orbits, product.event_family.tolist()
    of, own = FieldColumns(orbits, "orbits"), FieldColumns(product, "events")
    return [
        text_column("family", [product.name(f) for f in family], "family"),
        own("event_kind", "kind"),
        own("event_plane", "plane"),
        column("start_km", _starts_m(product, family, orbits.x0), "start", 8),
        of("integral", "jacobi", digits=10),
        of("period_s", digits=8),
    ]


def _verdict(product: SwingFamilies) -> list[str]:
    names = list(dict.fromkeys(_resonance(product, f) for f in range(len(product.n))))
    closure, half = product.curve.residual.max(), product.curve_half_residual.max()
    sentences = [
        f"{len(product.n)} families of planar orbits of several revolutions branch off at "
        f"{', '.join(names)}; their orbits close to {half:.1e} after half a period and to "
        f"{closure:.1e} after a whole one ({product.check}).",
    ]
    if both := [product.name(f) for f, kept in enumerate(product.symmetry) if kept == "xy"]:
        sentences.append(f"Symmetric about both axes: {', '.join(both)}.")
    if oblique := [product.name(f) for f, kept in enumerate(product.symmetry) if kept == "none"]:
        sentences.append(f"Without any mirror: {', '.join(oblique)}.")
    sentences += [f"{note[0].upper()}{note[1:]}." for note in product.notes]
    return sentences


def _orbit_chart(product: SwingFamilies, table: str) -> Chart:
    count = min(len(product.n), _MOST_PANELS)
    columns, panels = min(count, _COLUMNS), []
    for f in range(count):
        (x, y), name = _track(product, f)
        # The axes of the outer panels have labels for all.
        across = Axis("x", "km") if f + columns >= count else Axis()
        up = Axis() if f % columns else Axis("y", "km")
        marks = [Curve(x / 1e3, y / 1e3, "", "blue", width=0.8, rows=f), moon_outline(product)]
        panels.append(Panel(across, up, marks, name, is_equal=True, legend="none"))
    return Chart(
        f"Orbits of several revolutions{about_moon(product.body)}", panels,
        "One orbit of each family (of those asked for, the last of the family; else the one "
        "half-way along it), the body to scale, equal axes; x away from the primary, y along the "
        "orbital velocity.",
        columns=columns, size_in=(2.2 * columns, 1.0 + 2.6 * -(-count // columns)), table=table,
    )  # fmt: skip


def _track(
    product: SwingFamilies, family: int
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], str]:
    """Return the track (2, P) of a family's orbit and its name."""
    asked = np.flatnonzero(product.member_family == family)
    if asked.size:
        i = int(asked[-1])
        return product.tracks_m[:2, :, i], product.members.labels[i]
    title = f"{product.name(family)}, C = {product.family_jacobi[family]:.4g}"
    return product.family_tracks_m[:2, :, family], title


def _first_of(product: SwingFamilies, resonance: str) -> int:
    """Return the first family of a resonance."""
    return next(f for f in range(len(product.n)) if _resonance(product, f) == resonance)


def _curve_chart(product: SwingFamilies, family: QsoFamily | None, table: str) -> Chart:
    curve, origin = product.curve, product.origin
    marks: list[Mark] = []
    if family is not None:
        marks.append(Curve(family.curve.integral, family.curve.x0[0] / 1e3, "one revolution, x",
                           "grey", width=2.2))  # fmt: skip
    names = list(dict.fromkeys(_resonance(product, f) for f in range(len(product.n))))
    order = np.argsort([-origin.integral[_first_of(product, name)] for name in names])
    colours = [family_colours(len(names))[int(k)] for k in np.argsort(order)]
    for f in range(len(product.n)):
        own, name = product.curve_family == f, _resonance(product, f)
        colour = colours[names.index(name)]
        integral = np.concatenate([origin.integral[[f]], curve.integral[own]])
        states = np.concatenate([origin.x0[:, [f]], curve.x0[:, own]], axis=1)
        place = np.abs(states[0 if product.axis[f] == "x" else 1]) / 1e3
        is_stable = np.concatenate([[False], product.curve_stable[own]])
        marks += [
            Curve(integral, place, name, colour, "solid" if product.axis[f] == "x" else "dashed",
                  1.0, rows=f),
            Curve(np.where(is_stable, integral, np.nan), place, "", colour, width=3.0, rows=f),
            Points(integral[:1], place[:1], "", colour, size=4.0, rows=f),
        ]  # fmt: skip
        if product.axis[f] == "y" or f == _first_of(product, name):
            marks.append(Note(name, float(integral[0]), float(place[0]), "bottom left", colour))
    low = max(float(curve.integral.min()), _LEAST_JACOBI * float(np.min(origin.integral)))
    return Chart(
        "Families of orbits of several revolutions",
        [Panel(
            Axis("Jacobi constant (natural units)", low=low,
                 high=float(curve.integral.max()) + 0.2),
            Axis("distance of the start on its axis", "km", "log"), marks, legend="right",
        )],
        "Distance of the start on the axis against the Jacobi constant: solid for families that "
        "start on the x axis, dashed for the y axis; one colour per resonance, dots where they "
        "branch off, thick where they are linearly stable.",
        size_in=(8.0, 6.0), table=table,
    )  # fmt: skip
