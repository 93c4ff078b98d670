"""Tables, metrics, figures and sentences about families of orbits in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE, Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_orbits.qso_presentation import named
from hillsphere_orbits.spatial_products import SpatialFamilies

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["family_colours", "present_families"]

_MEMBERS = (
    Column("orbit", "", "orbit"),
    Column("resonance", "", "d:n"),
    Column("z_km", "km", "amplitude z", 9),
    Column("x0", "-", "x at the start", 12),
    Column("vy0", "-", "ẏ at the start", 12),
    Column("period", "-", "period in 1/n", 12),
    Column("period_h", "h", "period", 9),
    Column("jacobi", "-", "Jacobi constant", 12),
    Column("lambda_real", "-", "Re λ", 9),
    Column("lambda_imag", "-", "Im λ", 9),
    Column("lambda_max", "-", "largest |λ|", 9),
    Column("stable", "", "stable"),
    Column("closure", "-", "closure", 2),
    Column("half_closure", "-", "at half a period", 2),
)
_WINDOWS = (
    Column("resonance", "", "d:n"),
    Column("z_from_km", "km", "from z", 6),
    Column("z_to_km", "km", "to z", 6),
)


def family_colours(families: int) -> list[str]:
    """Return one colour per family, from dark to light (they are ordered by n)."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shades = colormaps["viridis"](np.linspace(0.0, 0.9, max(families, 1)))
    return [to_hex(shade) for shade in shades]


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
        Tables ``spatial_members`` and ``stability_windows``, figures ``families_3d`` and
        ``multipliers``, checks as metrics.
    """
    notes = [
        "Without unit: in units of L = (μ/n²)^(1/3) = "
        f"{product.members.length_m / 1e3:.12g} km and 1/n = {product.members.time_s:.12g} s; "
        "periods are those of all revolutions.",
        f"Orbits found over {product.method}; closure {product.check}.",
        "λ is the multiplier of the dominant pair, from the trace of M; the others are 1/λ and, "
        "to within rounding where the resonance is of high order, four times 1.",
    ]
    about = f" around {product.body.capitalize()}" if product.body not in ("", "body") else ""
    size = np.maximum(1e3, np.abs(product.member_multipliers[0]))
    metrics = {
        "closure_max": Metric(float(np.max(product.members.residual))),
        "closure_over_lambda_max": Metric(float(np.max(product.members.residual / size))),
        "half_closure_max": Metric(
            float(max(product.member_half_residual.max(), product.curve_half_residual.max()))
        ),
        "families": Metric(len(product.n)),
        "stable_members": Metric(int(np.count_nonzero(product.member_stable))),
    }
    figures = {
        "families_3d": Figure(
            f"One member of each family{about}",
            lambda figure: _draw_space(figure, product),
            "The largest orbits asked for and the body to scale (equal axes).",
            size_in=(8.0, 8.0),
        ),
        "multipliers": Figure(
            "Stability along the families",
            lambda figure: _draw_multipliers(figure, product),
            "Above: largest modulus of a multiplier against the amplitude, with the orbits asked "
            "for. Below: where the orbits are linearly stable.",
            size_in=(8.0, 7.0),
        ),
    }
    title = f"Orbits in space{about}"
    tables = {
        "spatial_members": Table(title, _MEMBERS, _member_rows(product), notes),
        "stability_windows": Table(
            "Windows of stability", _WINDOWS, _window_rows(product),
            ["A window that ends with its family is cut off there."],
        ),
    }  # fmt: skip
    return Presentation(
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _name(product: SpatialFamilies, family: int) -> str:
    return f"{product.d[family]}:{product.n[family]}"


def _member_rows(product: SpatialFamilies) -> list[dict[str, Cell]]:
    orbits = product.members
    speed = orbits.length_m / orbits.time_s
    return [
        {
            "orbit": orbits.labels[i],
            "resonance": _name(product, int(family)),
            "z_km": float(product.member_z_m[i] / 1e3),
            "x0": float(orbits.x0[0, i] / orbits.length_m),
            "vy0": float(orbits.x0[4, i] / speed),
            "period": float(orbits.period_s[i] / orbits.time_s),
            "period_h": float(orbits.period_s[i] / 3600.0),
            "jacobi": float(orbits.integral[i]),
            "lambda_real": float(product.member_multipliers[0, i].real),
            "lambda_imag": float(product.member_multipliers[0, i].imag),
            "lambda_max": float(np.max(np.abs(product.member_multipliers[:, i]))),
            "stable": bool(product.member_stable[i]),
            "closure": float(orbits.residual[i]),
            "half_closure": float(product.member_half_residual[i]),
        }
        for i, family in enumerate(product.member_family)
    ]


def _window_rows(product: SpatialFamilies) -> list[dict[str, Cell]]:
    return [
        {
            "resonance": _name(product, int(family)),
            "z_from_km": float(begin / 1e3),
            "z_to_km": float(end / 1e3),
        }
        for family, begin, end in zip(product.window_family, *product.window_z_m, strict=True)
    ]


def _verdict(product: SpatialFamilies) -> list[str]:
    reached = [
        f"{_name(product, f)} to {product.curve_z_m[product.curve_family == f].max() / 1e3:.4g} km"
        f" ({end})"
        for f, end in enumerate(product.ends)
    ]
    closure, half = product.members.residual.max(), product.member_half_residual.max()
    sentences = [
        f"Families in space (branch {product.branch}): {', '.join(reached)}.",
        f"Their {len(product.member_stable)} members close to {half:.1e} after half a period and "
        f"to {closure:.1e} after a whole one ({product.check}).",
    ]
    if stable := [
        name
        for name, good in zip(product.members.labels, product.member_stable, strict=True)
        if good
    ]:
        sentences.append(f"Linearly stable: {'; '.join(stable)}.")
    return sentences


def _draw_space(figure: Canvas, product: SpatialFamilies) -> None:
    axes = figure.add_subplot(projection="3d")
    colours = family_colours(len(product.n))
    for f in sorted({0, len(product.n) // 2, len(product.n) - 1}):
        own = np.flatnonzero(product.member_family == f)
        if own.size:
            i = own[np.argmax(product.member_z_m[own])]
            axes.plot(*product.tracks_m[:, :, i] / 1e3, color=colours[f], lw=0.6,
                      label=product.members.labels[i])  # fmt: skip
    if product.semi_axes_m:
        a, b, c = np.array(product.semi_axes_m) / 1e3
        u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 33), np.linspace(0.0, np.pi, 17))
        p, q = a * np.cos(u) * np.sin(v), b * np.sin(u) * np.sin(v)
        cos, sin = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
        axes.plot_surface(cos * p - sin * q, sin * p + cos * q, c * np.cos(v), color="#777777")
    axes.set_box_aspect(np.ptp(np.array(axes.get_w_lims()).reshape(3, 2), axis=1))
    axes.set_xlabel("x, away from the primary (km)")
    axes.set_ylabel("y, along the orbital velocity (km)")
    axes.set_zlabel("z, north (km)")
    axes.legend(loc="upper right", fontsize=8)


def _draw_multipliers(figure: Canvas, product: SpatialFamilies) -> None:
    axes, below = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    colours = family_colours(len(product.n))
    largest = np.max(np.abs(product.curve_multipliers), axis=0)
    for f, colour in enumerate(colours[: len(product.n)]):
        own = product.curve_family == f
        edges = product.window_z_m[:, product.window_family == f]
        z, values = product.curve_z_m[own] / 1e3, largest[own]
        if np.all(np.diff(z) > 0.0):
            # no fold: the edges of the windows, where the curve leaves 1 steeply, can be put in
            z = np.concatenate([z, edges.ravel() / 1e3])
            order = np.argsort(z, kind="stable")
            z, values = z[order], np.concatenate([values, np.ones(edges.size)])[order]
        axes.semilogy(z, values, color=colour, lw=1.1, label=_name(product, f))
        for begin, end in edges.T / 1e3:
            below.barh(f, end - begin, left=begin, height=0.7, color=colour)
    members = np.max(np.abs(product.member_multipliers), axis=0)
    axes.semilogy(product.member_z_m / 1e3, members, ".", color=PALETTE["black"], ms=4,
                  label="asked for")  # fmt: skip
    axes.set_ylabel("largest modulus of\na multiplier")
    axes.legend(loc="upper left", fontsize=8, ncols=2)
    below.set_yticks(range(len(product.n)), [_name(product, f) for f in range(len(product.n))])
    below.tick_params(axis="y", labelsize=8)
    below.set_ylabel("stable")
    below.set_xlabel("amplitude z (km)")
