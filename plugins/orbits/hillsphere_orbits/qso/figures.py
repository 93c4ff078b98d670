"""Figures of families of quasi-satellite orbits."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere.presentation import (
    Axis,
    Chart,
    Curve,
    Mark,
    Note,
    Panel,
    Points,
    Rule,
    Side,
    Span,
)
from hillsphere.products import Bifurcations
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.scenes import orbit_paths, scene_chart

__all__ = ["index_chart", "orbit_chart", "period_chart", "resonance_chart"]

_PLANES = (("planar", "blue"), ("vertical", "vermillion"))
_NAME_WIDTH, _NAME_HEIGHT = 0.028, 0.22
"""Size of the name of a resonance: part of the range of amplitudes, and in stability index."""
_AMPLITUDE = Axis("x at the crossing of the x axis", "km")


def _amplitudes(product: QsoFamily) -> Array:
    return np.asarray(product.curve.x0[0] / 1e3)


def _other_name(product: QsoFamily, compare: QsoFamily) -> str:
    return compare.name + (" (compared with)" if compare.name == product.name else "")


def period_chart(product: QsoFamily, compare: QsoFamily | None, table: str) -> Chart:
    """Return the period against the amplitude; `table` lists the members."""
    month_h = 2.0 * np.pi * product.curve.time_s / HOUR_S
    marks: list[Mark] = [Rule("y", month_h, "orbital period of the moon")]
    if compare is not None:
        marks.append(
            Curve(_amplitudes(compare), compare.curve.period_s / HOUR_S,
                  _other_name(product, compare), "orange", "dashed")
        )  # fmt: skip
    members = product.members
    marks += [
        Curve(_amplitudes(product), product.curve.period_s / HOUR_S, product.name, "blue"),
        Points(members.x0[0] / 1e3, members.period_s / HOUR_S, "members of the table", "black",
               names=members.labels, rows=range(len(members.labels))),
    ]  # fmt: skip
    return Chart(
        "Period of the family",
        [Panel(_AMPLITUDE, Axis("period", "h"), marks)],
        "Far away the period is that of the moon's orbit; close in it falls.",
        table=table,
    )


def index_chart(product: QsoFamily, compare: QsoFamily | None) -> Chart:
    """Return both stability indices against the amplitude."""
    return Chart(
        "Stability of the family",
        [_index_panel(product, compare, [])],
        "Stability indices b = λ + 1/λ; the family is linearly stable in the shaded band.",
    )


def _index_panel(product: QsoFamily, compare: QsoFamily | None, further: list[Mark]) -> Panel:
    marks: list[Mark] = [Span("y", -2.0, 2.0)]
    for row, (plane, colour) in enumerate(_PLANES):
        if compare is not None:
            marks.append(
                Curve(_amplitudes(compare), compare.curve_indices[row],
                      f"{plane}, {_other_name(product, compare)}", colour, "dashed", 1.1, 0.8)
            )  # fmt: skip
        marks.append(
            Curve(_amplitudes(product), product.curve_indices[row], f"{plane}, {product.name}",
                  colour)
        )  # fmt: skip
    finite = product.curve_indices[np.isfinite(product.curve_indices)]
    low = max(-4.0, min(-2.3, float(finite.min()) - 0.2))
    high = min(4.0, max(2.3, float(finite.max()) + 0.2))
    axis = Axis("stability index b = λ + 1/λ", low=low, high=high)
    return Panel(_AMPLITUDE, axis, [*marks, *further], legend="above")


def resonance_chart(
    product: QsoFamily, compare: QsoFamily | None, bifurcations: Bifurcations, table: str
) -> Chart:
    """Return the stability indices with the resonances marked; `table` lists these."""
    marks: list[Mark] = []
    for row, (plane, colour) in enumerate(_PLANES):
        chosen = [i for i, name in enumerate(bifurcations.plane) if name == plane]
        x, b = bifurcations.orbits.x0[0, chosen] / 1e3, bifurcations.index[chosen]
        names = [f"{bifurcations.d[i]}:{bifurcations.n[i]}" for i in chosen]
        marks.append(Points(x, b, "", colour, size=6.0, names=names, rows=chosen))
        last_end, last_b = -np.inf, -np.inf
        width = _NAME_WIDTH * float(np.ptp(_amplitudes(product)))
        for k in np.argsort(x):
            # On the side on which the curve is lower, so that it does not cross the label.
            falls = _slope(product, row, x[k]) < 0.0
            begin = x[k] - width if falls else x[k]
            # A label that would cover its neighbour's is left out; the table has them all.
            if begin < last_end and abs(b[k] - last_b) < _NAME_HEIGHT:
                continue
            last_end, last_b = begin + width, b[k]
            corner: Side = "bottom left" if falls else "bottom right"
            marks.append(Note(names[k], float(x[k]), float(b[k]), corner, colour))
    return Chart(
        "Stability indices with the resonances",
        [_index_panel(product, compare, marks)],
        "Marked: where a family of orbits of n revolutions branches off, b = 2 cos(2π d/n); where "
        "they crowd, some have no name here (the table has all). Dashed: the family compared with.",
        size_in=(8.0, 5.0),
        table=table,
    )


def _slope(product: QsoFamily, row: int, x_km: float) -> float:
    x = _amplitudes(product)[::-1]
    slope = np.gradient(product.curve_indices[row, ::-1], x)
    return float(np.interp(x_km, x, slope))


def orbit_chart(product: QsoFamily, title: str, table: str) -> Chart:
    """Return the members and the body to scale; `table` lists the members."""
    labels = product.members.labels
    return scene_chart(
        title, orbit_paths(product.tracks_m, labels, range(len(labels))), product,
        "The orbits and the body to scale, seen from above the orbit plane of the moon.",
        table=table,
    )  # fmt: skip
