"""Tables, metrics, figures and sentences about planar orbits of several revolutions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE, Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_orbits.qso.presentation import named
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.spatial_qso_families.presentation import family_colours
from hillsphere_orbits.swing_qso_families.products import SwingFamilies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["present_swing"]

_COLUMNS = 5  # panels in a row
_MEMBERS = (
    Column("orbit", "", "orbit"),
    Column("resonance", "", "d:n"),
    Column("symmetry", "", "symmetry"),
    Column("x0", "-", "x at the start", 12),
    Column("y0", "-", "y at the start", 12),
    Column("vx0", "-", "ẋ at the start", 12),
    Column("vy0", "-", "ẏ at the start", 12),
    Column("period", "-", "period in 1/n", 12),
    Column("period_h", "h", "period", 9),
    Column("jacobi", "-", "Jacobi constant", 12),
    Column("b_planar", "-", "planar index", 9),
    Column("b_vertical", "-", "vertical index", 9),
    Column("lambda_max", "-", "largest |λ|", 7),
    Column("stable", "", "stable"),
    Column("closure", "-", "closure", 2),
    Column("half_closure", "-", "at half a period", 2),
)
_FAMILIES = (
    Column("family", "", "family"),
    Column("resonance", "", "d:n"),
    Column("symmetry", "", "symmetry"),
    Column("parent", "", "branches off"),
    Column("bifurcation_km", "km", "start of the bifurcating orbit", 8),
    Column("jacobi_from", "-", "Jacobi constant from", 8),
    Column("jacobi_to", "-", "to", 8),
    Column("period_from_h", "h", "period from", 7),
    Column("period_to_h", "h", "to", 7),
    Column("nearest_km", "km", "nearest to the centre", 6),
    Column("farthest_km", "km", "farthest from it", 6),
    Column("stable_orbits", "-", "stable orbits of its curve"),
    Column("orbits", "-", "orbits of its curve"),
    Column("end", "", "why it ends"),
)
_EVENTS = (
    Column("family", "", "family"),
    Column("kind", "", "kind"),
    Column("plane", "", "plane"),
    Column("start_km", "km", "start", 8),
    Column("jacobi", "-", "Jacobi constant", 10),
    Column("period_h", "h", "period", 8),
)


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
    about = f" around {product.body.capitalize()}" if product.body not in ("", "body") else ""
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
        "swing_families": Table(
            f"Families of orbits of several revolutions{about}", _FAMILIES, _family_rows(product),
            [*scale, *product.notes],
        ),
    }  # fmt: skip
    if members := _member_rows(product):
        tables["swing_members"] = Table(
            f"Orbits of several revolutions{about}", _MEMBERS, members, scale
        )
    if events := _event_rows(product):
        tables["swing_events"] = Table(
            "Secondary bifurcations along these families", _EVENTS, events,
            ["fold: the Jacobi constant turns; branching: orbits of the same period and less "
             "symmetry (or out of the plane) begin; doubling: orbits of twice the period."],
        )  # fmt: skip
    figures = {
        "swing_orbits": Figure(
            f"Orbits of several revolutions{about}",
            lambda figure: _draw_orbits(figure, product),
            "One orbit of each family (of those asked for, the last of the family; else the one "
            "half-way along it), the body to scale, equal axes.",
            size_in=(11.0, 1.0 + 2.6 * -(-len(_shown(product)) // _COLUMNS)),
        ),
        "swing_curves": Figure(
            "Families of orbits of several revolutions",
            lambda figure: _draw_curves(figure, product, family),
            "Distance of the start on the axis against the Jacobi constant: solid for families "
            "that start on the x axis, dashed for the y axis; one colour per resonance, dots where "
            "they branch off, thick where they are linearly stable.",
            size_in=(8.0, 6.0),
        ),
    }
    return Presentation(
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _resonance(product: SwingFamilies, family: int) -> str:
    return f"{product.d[family]}:{product.n[family]}"


def _start_km(
    product: SwingFamilies, family: int, x0: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> float:
    return float(abs(x0[0 if product.axis[family] == "x" else 1]) / 1e3)


def _family_rows(product: SwingFamilies) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for f in range(len(product.n)):
        own = product.curve_family == f
        curve = product.curve
        parent = product.parent[f]
        rows.append(
            {
                "family": product.name(f),
                "resonance": _resonance(product, f),
                "symmetry": product.symmetry[f],
                "parent": product.name(parent) if parent >= 0 else "one revolution",
                "bifurcation_km": _start_km(product, f, product.origin.x0[:, f]),
                "jacobi_from": float(curve.integral[own][0]),
                "jacobi_to": float(curve.integral[own][-1]),
                "period_from_h": float(curve.period_s[own][0] / 3600.0),
                "period_to_h": float(curve.period_s[own][-1] / 3600.0),
                "nearest_km": float(product.curve_least_m[own].min() / 1e3),
                "farthest_km": float(product.curve_largest_m[own].max() / 1e3),
                "stable_orbits": int(np.count_nonzero(product.curve_stable[own])),
                "orbits": int(np.count_nonzero(own)),
                "end": product.ends[f],
            }
        )
    return rows


def _member_rows(product: SwingFamilies) -> list[dict[str, Cell]]:
    orbits = product.members
    speed = orbits.length_m / orbits.time_s
    return [
        {
            "orbit": orbits.labels[i],
            "resonance": _resonance(product, int(family)),
            "symmetry": product.symmetry[family],
            "x0": float(orbits.x0[0, i] / orbits.length_m),
            "y0": float(orbits.x0[1, i] / orbits.length_m),
            "vx0": float(orbits.x0[3, i] / speed),
            "vy0": float(orbits.x0[4, i] / speed),
            "period": float(orbits.period_s[i] / orbits.time_s),
            "period_h": float(orbits.period_s[i] / 3600.0),
            "jacobi": float(orbits.integral[i]),
            "b_planar": float(product.member_indices[0, i]),
            "b_vertical": float(product.member_indices[1, i]),
            "lambda_max": float(np.max(np.abs(product.member_multipliers[:, i]))),
            "stable": bool(product.member_stable[i]),
            "closure": float(orbits.residual[i]),
            "half_closure": float(product.member_half_residual[i]),
        }
        for i, family in enumerate(product.member_family)
    ]


def _event_rows(product: SwingFamilies) -> list[dict[str, Cell]]:
    orbits = product.event_orbits
    return [
        {
            "family": product.name(int(family)),
            "kind": product.event_kind[i],
            "plane": product.event_plane[i],
            "start_km": _start_km(product, int(family), orbits.x0[:, i]),
            "jacobi": float(orbits.integral[i]),
            "period_h": float(orbits.period_s[i] / 3600.0),
        }
        for i, family in enumerate(product.event_family)
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


def _shown(product: SwingFamilies) -> list[int]:
    return list(range(min(len(product.n), 30)))


def _draw_body(axes: Axes, product: SwingFamilies) -> None:
    if not product.semi_axes_m:
        axes.plot([0.0], [0.0], "+", color=PALETTE["black"])
        return
    a, b, _ = np.array(product.semi_axes_m) / 1e3
    angle = np.linspace(0.0, 2.0 * np.pi, 91)
    c, s = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
    u, v = a * np.cos(angle), b * np.sin(angle)
    axes.fill(c * u - s * v, s * u + c * v, color="#777777")


def _draw_orbits(figure: Canvas, product: SwingFamilies) -> None:
    shown = _shown(product)
    grid = figure.subplots(-(-len(shown) // _COLUMNS), _COLUMNS, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_axis_off()
    for axes, f in zip(grid.flat, shown, strict=False):
        track, name = _track(product, f)
        axes.plot(*track / 1e3, color=PALETTE["blue"], lw=0.8)
        _draw_body(axes, product)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(name, fontsize=8)
        axes.tick_params(labelsize=6)
        axes.set_xlabel("x, away from the primary (km)", fontsize=6)
        axes.set_ylabel("y, along the orbital velocity (km)", fontsize=6)


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


def _draw_curves(figure: Canvas, product: SwingFamilies, family: QsoFamily | None) -> None:
    axes = figure.add_subplot()
    curve = product.curve
    if family is not None:
        axes.plot(family.curve.integral, family.curve.x0[0] / 1e3, color="#666666", lw=2.2,
                  label="one revolution, x")  # fmt: skip
    names = list(dict.fromkeys(_resonance(product, f) for f in range(len(product.n))))
    order = np.argsort([-product.origin.integral[_first_of(product, name)] for name in names])
    colours = [family_colours(len(names))[int(k)] for k in np.argsort(order)]
    low = float(np.min(product.origin.integral))
    for f in range(len(product.n)):
        own = product.curve_family == f
        k = names.index(_resonance(product, f))
        start = curve.x0[0 if product.axis[f] == "x" else 1, own] / 1e3
        integral = np.concatenate([product.origin.integral[[f]], curve.integral[own]])
        place = np.concatenate([[_start_km(product, f, product.origin.x0[:, f])], np.abs(start)])
        line = "-" if product.axis[f] == "x" else "--"
        label = names[k] if f == _first_of(product, names[k]) else None
        colour = colours[k]
        axes.plot(integral, place, line, color=colour, lw=1.0, label=label)
        stable = np.concatenate([[False], product.curve_stable[own]])
        axes.plot(np.where(stable, integral, np.nan), place, "-", color=colour, lw=3.0)
        axes.plot(integral[:1], place[:1], "o", color=colour, ms=4)
        if product.axis[f] == "y" or f == _first_of(product, names[k]):
            axes.annotate(names[k], (integral[0], place[0]), xytext=(-4, -8), fontsize=7,
                          ha="right", textcoords="offset points", color=colour)  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlim(max(float(curve.integral.min()), 4.0 * low), float(curve.integral.max()) + 0.2)
    axes.set_xlabel("Jacobi constant (natural units)")
    axes.set_ylabel("distance of the start on its axis (km)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
