"""Tables, metrics, figures and sentences about families of orbits in space."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    Axis,
    Bars,
    Chart,
    Curve,
    Mark,
    MarkerShape,
    Metric,
    Panel,
    Points,
    Presentation,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.scenes import about_moon, family_colours, orbit_paths, scene_chart
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies

__all__ = ["present_families"]

_POINTS = 600  # of a curve in a figure
_REAL = 1e-6  # imaginary part of an index, relative, that is rounding

_STARTS = {
    "position": "on the plane xz, z ≠ 0",
    "velocity": "on the x axis, ż ≠ 0",
    "y_position": "on the plane yz, z ≠ 0",
}
_MARKERS: dict[str, MarkerShape] = {
    "fold": "square", "branching": "triangle", "doubling": "triangle-down", "krein": "diamond",
}  # fmt: skip


def present_families(product: SpatialFamilies, label: str) -> Presentation:
    """Show families in space.

    Parameters
    ----------
    product : SpatialFamilies
        What is shown.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Tables ``spatial_families``, ``spatial_members``, ``stability_windows`` and
        ``secondary_bifurcations``, figures ``families_3d`` and ``multipliers``, checks as metrics.
    """
    notes = [
        "Without unit: in units of L = (μ/n²)^(1/3) = "
        f"{product.members.length_m / 1e3:.12g} km and 1/n = {product.members.time_s:.12g} s; "
        "periods are those of all revolutions.",
        f"Orbits found over {product.method}; closure {product.check}.",
        "λ is the multiplier of the dominant pair, from the trace of M; the others are 1/λ and, "
        "to within rounding where the resonance is of high order, four times 1.",
    ]
    about = about_moon(product.body)
    size = np.maximum(1e3, np.abs(product.member_multipliers[0]))
    metrics = {
        "closure_max": Metric(float(np.max(product.members.residual))),
        "closure_over_lambda_max": Metric(float(np.max(product.members.residual / size))),
        "half_closure_max": Metric(
            float(max(product.member_half_residual.max(), product.curve_half_residual.max()))
        ),
        "families": Metric(len(product.n)),
        "families_not_followed": Metric(len(product.n) - len(set(product.curve_family.tolist()))),
        "stable_members": Metric(int(np.count_nonzero(product.member_stable))),
    }
    own = label_identifier("spatial_members", label)
    figures = {
        "families_3d": _orbit_chart(product, f"One member of each family{about}", own),
        "multipliers": _multiplier_chart(product, own),
    }
    title = f"Orbits in space{about}"
    tables = {
        "spatial_families": tabulate("Families", _families(product), _family_notes(product)),
        "spatial_members": tabulate(title, _members(product), notes),
        "stability_windows": tabulate(
            "Windows of stability", _windows(product),
            ["A window that ends with its family is cut off there."],
        ),
        "secondary_bifurcations": tabulate(
            "Secondary bifurcations", _secondary(product),
            ["fold: λ = 1 where the Jacobi constant turns; branching: λ = 1 and it does not, a "
             "family of less symmetry begins; doubling: λ = −1, a family of twice the period "
             "begins (an orbit with two mirrors stays stable there: its index touches −2); krein: "
             "two pairs of multipliers meet."],
        ),
    }  # fmt: skip
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product, label),
    )


def _name(product: SpatialFamilies, family: int) -> str:
    """Return d:n of a family, with the place where it begins if another has the same d:n."""
    own = (product.d[family], product.n[family])
    name = f"{own[0]}:{own[1]}"
    if list(zip(product.d, product.n, strict=True)).count(own) == 1:
        return name
    return f"{name} at x = {product.bifurcation_x_m[family] / 1e3:.4g} km"


def _resonances(product: SpatialFamilies, families: Iterable[int]) -> FilledColumn:
    return text_column("resonance", [f"{product.d[f]}:{product.n[f]}" for f in families], "d:n")


def _members(product: SpatialFamilies) -> list[FilledColumn]:
    orbits, dominant = product.members, product.member_multipliers[0]
    of, own = FieldColumns(orbits, "orbits"), FieldColumns(product, "members")
    return [
        of("labels", "orbit"),
        _resonances(product, product.member_family.tolist()),
        own("member_z_m", "z_km"),
        column("x0", orbits.x0[0] / orbits.length_m, "x at the start", 12),
        column("vy0", orbits.x0[4] / (orbits.length_m / orbits.time_s), "ẏ at the start", 12),
        column("period", orbits.period_s / orbits.time_s, "period in 1/n", 12),
        of("period_s"),
        of("integral", "jacobi"),
        column("lambda_real", dominant.real, "Re λ", 9),
        column("lambda_imag", dominant.imag, "Im λ", 9),
        column("lambda_max", np.max(np.abs(product.member_multipliers), axis=0), "largest |λ|", 9),
        own("member_stable", "stable"),
        of("residual", "closure"),
        own("member_half_residual", "half_closure"),
    ]


def _families(product: SpatialFamilies) -> list[FilledColumn]:
    of, families = FieldColumns(product, "families"), range(len(product.n))
    own = [np.flatnonzero(product.curve_family == f) for f in families]
    largest = np.max(np.abs(product.curve_multipliers), axis=0)
    z, growth = (
        [values[orbits].max() if orbits.size else None for orbits in own]
        for values in (product.curve_z_m, largest)
    )
    return [
        _resonances(product, families),
        text_column("start", [_STARTS[start] for start in product.starts], "starts"),
        text_column(
            "other", [not first for first in product.of_position],
            "the other family than z ≠ 0 at x > 0",
        ),
        of("bifurcation_x_m", "x0_km"),
        column("orbits", [orbits.size for orbits in own], "orbits along it"),
        column("z_max_km", z, "largest z", 6),
        column("lambda_max", growth, "largest |λ|", 6),
        of("ends", "end"),
    ]  # fmt: skip


def _family_notes(product: SpatialFamilies) -> list[str]:
    notes = [
        "Two families branch off at every vertical bifurcation. Which of them a start belongs to "
        "follows from its phase in the kernel of the n-revolution map.",
    ]
    if same := [
        _name(product, f)
        for f, start in enumerate(product.starts)
        if product.of_position[f] and start != "position"
    ]:
        notes.append(
            f"{', '.join(same)}: the start asked for ({product.branch}) belongs to the same family "
            'as z ≠ 0 at x > 0, seen some revolutions later; the other one is branch "companion".'
        )
    return notes + [f"{sentence}." for sentence in product.missing]


def _secondary(product: SpatialFamilies) -> list[FilledColumn]:
    of = FieldColumns(product, "events")
    return [
        _resonances(product, product.secondary_family.tolist()),
        of("secondary_kind", "kind"),
        of("secondary_z_m", "z_km"),
        of("secondary_jacobi", "jacobi"),
        column("b", product.secondary_index[0].real, "b of the dominant pair", 6),
    ]


def _windows(product: SpatialFamilies) -> list[FilledColumn]:
    begin, end = product.window_z_m
    return [
        _resonances(product, product.window_family.tolist()),
        column("z_from_km", begin, "from z", 6),
        column("z_to_km", end, "to z", 6),
    ]


def _verdict(product: SpatialFamilies, label: str) -> list[str]:
    followed = set(product.curve_family.tolist())
    reached: dict[str, list[str]] = {}
    for f, end in enumerate(product.ends):
        if f in followed:
            top = product.curve_z_m[product.curve_family == f].max() / 1e3
            reached.setdefault(end, []).append(f"{_name(product, f)} to {top:.4g} km")
    said = "; ".join(f"{', '.join(names)} ({end})" for end, names in reached.items())
    closure, half = product.members.residual.max(), product.member_half_residual.max()
    members, one = len(product.member_stable), len(product.member_stable) == 1
    which = f"{label.replace('_', ' ')}, " if label else ""
    sentences = [
        f"{'Family' if len(followed) == 1 else 'Families'} in space ({which}branch "
        f"{product.branch}): {said}.",
        f"{'Its' if len(followed) == 1 else 'Their'} {format_count(members, 'member')} "
        f"{'closes' if one else 'close'} to {half:.1e} after half a period and to {closure:.1e} "
        f"after a whole one ({product.check}).",
    ]
    if lost := [
        f"{_name(product, f)} ({end})" for f, end in enumerate(product.ends) if f not in followed
    ]:
        sentences.append(f"Not followed: {', '.join(lost)}.")
    sentences += _family_notes(product)[1:]
    if stable := [
        name
        for name, good in zip(product.members.labels, product.member_stable, strict=True)
        if good
    ]:
        sentences.append(f"Linearly stable: {'; '.join(stable)}.")
    return sentences


def _orbit_chart(product: SpatialFamilies, title: str, table: str) -> Chart:
    colours, paths = family_colours(len(product.n)), []
    for f in sorted({0, len(product.n) // 2, len(product.n) - 1}):
        own = np.flatnonzero(product.member_family == f)
        if own.size:
            i = int(own[np.argmax(product.member_z_m[own])])
            (path,) = orbit_paths(product.tracks_m, product.members.labels, [i])
            paths.append(replace(path, colour=colours[f], width=0.6))
    return scene_chart(
        title, paths, product, "The largest orbits asked for and the body to scale (equal axes).",
        table=table,
    )  # fmt: skip


def _multiplier_chart(product: SpatialFamilies, table: str) -> Chart:
    names = [_name(product, f) for f in range(len(product.n))]
    largest: list[Mark] = []
    stable: list[Mark] = []
    top = 1.0
    for f, colour in enumerate(family_colours(len(names))):
        own = np.flatnonzero(product.curve_family == f)
        if not own.size:
            continue
        z_km, modulus = _smooth(product, own)
        top = max(top, float(np.max(modulus)))
        largest.append(Curve(z_km, modulus, names[f], colour, width=1.2))
        begin, end = product.window_z_m[:, product.window_family == f] / 1e3
        stable.append(Bars(np.full(begin.size, f), end, "x", begin, colour=colour))
    members = np.max(np.abs(product.member_multipliers), axis=0)
    largest.append(Points(product.member_z_m / 1e3, members, "asked for", "black", size=3.0,
                          names=product.members.labels, rows=range(members.size)))  # fmt: skip
    for kind, marker in _MARKERS.items():
        own = np.flatnonzero(np.array(product.secondary_kind) == kind)
        if own.size:
            stable.append(Points(product.secondary_z_m[own] / 1e3, product.secondary_family[own],
                                 kind, "vermillion", marker, 6.0))  # fmt: skip
    z = Axis("amplitude z", "km")
    # A logarithmic axis of less than a decade above 1 would have the tick 1 alone.
    y = Axis("largest modulus of a multiplier", scale="log" if top > 10.0 else "linear")
    return Chart(
        "Stability along the families",
        [
            Panel(z, y, largest, legend="right"),
            Panel(z, Axis("stable", ticks=list(enumerate(names)), low=-0.6, high=len(names) - 0.4),
                  stable, legend="right"),
        ],
        "Above: largest modulus of a multiplier against the amplitude, with the orbits asked for; "
        "between the orbits computed the index is interpolated. Below: where the orbits are "
        "linearly stable, and secondary bifurcations.",
        share_x=True, heights=(3, 2), size_in=(8.0, 7.0), table=table,
    )  # fmt: skip


def _smooth(product: SpatialFamilies, own: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return amplitudes (km) and largest moduli along a family, densely interpolated.

    What is interpolated is the dominant index of the return map: it is smooth where the modulus
    leaves 1 steeply, and where the index of M touches −2 it passes 0.
    """
    z, place = product.curve_z_m[own] / 1e3, product.curve_place[own]
    c = product.curve_return_index[:, own]
    alone = np.all(np.abs(c[0].imag) <= _REAL * np.abs(c[0])) and np.all(c[1] == 2.0)
    if own.size < 4 or not alone:
        # two pairs take part: they may swap or leave the real axis, and are not smooth there
        return z, np.max(np.abs(product.curve_multipliers[:, own]), axis=0)
    dense = np.unique(np.concatenate([place, np.linspace(place[0], place[-1], _POINTS)]))
    index = np.sinh(CubicSpline(place, np.arcsinh(c[0].real))(dense))
    half = np.maximum(0.5 * np.abs(index), 1.0)
    power = int(product.curve_return_power[own[0]])
    return CubicSpline(place, z)(dense), (half + np.sqrt(half**2 - 1.0)) ** power
