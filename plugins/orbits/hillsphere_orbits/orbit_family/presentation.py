"""Tables, figures and sentences about a family that was followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE, Figure, Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, take_or_blank
from hillsphere_orbits.orbit_family.products import FollowedFamily
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.stability import multipliers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["present_followed"]

_WORDS = {"amplitude": "amplitude", "period": "period", "jacobi": "integral of motion"}
_COLOURS = tuple(
    PALETTE[name] for name in ("blue", "vermillion", "green", "purple", "orange", "sky", "black")
)


def present_followed(product: FollowedFamily, label: str) -> Presentation:
    """Show members, curve and ways.

    Parameters
    ----------
    product : FollowedFamily
        What is shown.
    label : str
        Appended to all identifiers.
    """
    title = "Orbits asked for"
    tables = {
        label_identifier("orbit_family", label): tabulate(
            title, _members(product), ["Numbers without unit are in natural units."]
        )
    }
    figures = {
        label_identifier("orbit_family_indices", label): Figure(
            "Stability along the family",
            lambda figure: _draw_indices(figure, product),
            "Stability indices b = λ + 1/λ; shaded: stable. The scale is linear within ±2.",
        )
    }
    if product.members.labels:
        figures[label_identifier("orbit_family_orbits", label)] = Figure(
            title,
            lambda figure: _draw_orbits(figure, product),
            "One period, in the frame of the motion, to scale.",
            size_in=(9.0, 5.0),
        )
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
        figures[label_identifier("orbit_family_ways", label)] = Figure(
            "Orbits as the parameters change",
            lambda figure: _draw_ways(figure, product),
            "Against the part of the change of the parameters; dots are the orbits computed.",
            size_in=(9.5, 4.0),
        )
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


def _draw_indices(figure: Canvas, product: FollowedFamily) -> None:
    axes = figure.add_subplot()
    axes.axhspan(-2.0, 2.0, color="#f0f0f0", zorder=0)
    amplitude = product.curve_amplitude_m / 1e3
    flat = bool(np.all(product.curve.x0[[2, 5]] == 0.0))
    names = ("planar", "vertical") if flat else ("larger", "smaller")
    for row, (name, colour) in enumerate(zip(names, ("blue", "vermillion"), strict=True)):
        axes.plot(amplitude, product.curve_indices[row], color=PALETTE[colour], label=name)
        if product.members.labels:
            axes.plot(
                product.member_amplitude_m / 1e3, product.member_indices[row], "o", ms=5,
                color=PALETTE[colour], markeredgecolor="white",
                label=f"{name}, asked for",
            )  # fmt: skip
    axes.set_yscale("symlog", linthresh=2.0)
    axes.set_xlabel("amplitude (km)")
    axes.set_ylabel("stability index b")
    axes.legend(fontsize=8)


def _draw_orbits(figure: Canvas, product: FollowedFamily) -> None:
    tracks = product.tracks_m / 1e3
    in_space = bool(np.max(np.abs(tracks[2])) > 1e-9 * np.max(np.abs(tracks[:2])))
    panels = figure.subplots(1, 2 if in_space else 1, squeeze=False)[0]
    views = (((0, "x"), (1, "y")), ((0, "x"), (2, "z")))
    words = {"x": "x, away from the primary", "y": "y, along the orbit", "z": "z, north"}
    for axes, ((i, across), (j, up)) in zip(panels, views, strict=False):
        for k, name in enumerate(product.members.labels):
            colour = _COLOURS[k % len(_COLOURS)]
            axes.plot(tracks[i, :, k], tracks[j, :, k], color=colour, lw=1.2, label=name)
        _draw_body(axes, product, i, j)
        axes.locator_params(axis="x", nbins=5)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{words[across]} (km)")
        axes.set_ylabel(f"{words[up]} (km)")
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, fontsize=8)


def _draw_body(axes: Axes, product: FollowedFamily, i: int, j: int) -> None:
    if not product.semi_axes_m:
        axes.plot([0.0], [0.0], "+", color=PALETTE["black"], label="centre of the body")
        return
    a, b, c = np.array(product.semi_axes_m) / 1e3
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    cos, sin = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
    outline: Array
    if j == 1:
        u, v = a * np.cos(angle), b * np.sin(angle)
        outline = np.array([cos * u - sin * v, sin * u + cos * v])
    else:
        # the silhouette along y of an ellipsoid turned about z
        outline = np.array([np.hypot(a * cos, b * sin) * np.cos(angle), c * np.sin(angle)])
    axes.fill(*outline, color="#777777", label=product.body.capitalize() or "body")


def _draw_ways(figure: Canvas, product: FollowedFamily) -> None:
    panels = figure.subplots(1, 3)
    rows = (
        ("x at the start (km)", product.way_x0[0] / 1e3),
        ("period (h)", product.way_period_s / HOUR_S),
        ("integral of motion (natural units)", product.way_integral),
    )
    for axes, (name, values) in zip(panels, rows, strict=True):
        for k in np.unique(product.way_orbit):
            own = product.way_orbit == k
            axes.plot(
                product.way_fraction[own], values[own], ".-", lw=1.0, label=product.asked[k],
                color=_COLOURS[int(k) % len(_COLOURS)],
            )  # fmt: skip
        axes.set_ylabel(name)
        axes.set_xlabel("part of the change")
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, fontsize=8)
