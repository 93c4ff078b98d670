"""Tables, metrics and sentences about a family of quasi-satellite orbits."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable, beside, difference_notes, with_paper
from hillsphere_orbits.qso.figures import draw_indices, draw_orbits, draw_periods
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.stability import determinant_error

__all__ = ["amplitude_km", "counted", "named", "present_family"]

_COLUMNS = (
    Column("name", "", "orbit"),
    Column("x0_km", "km", "x at the crossing", 6),
    Column("y_max_km", "km", "largest y", 9),
    Column("vy_m_s", "m/s", "|ẏ| at the crossing", 7),
    Column("vx_m_s", "m/s", "|ẋ| at largest y", 7),
    Column("period_h", "h", "period", 8),
    Column("jacobi", "-", "Jacobi constant", 10),
    Column("vy0", "-", "ẏ at the crossing", 12),
    Column("period", "-", "period in 1/n", 12),
    Column("b_planar", "-", "planar index", 10),
    Column("b_vertical", "-", "vertical index", 10),
)
_SAME_ORBIT_KM = 1e-6
_BEYOND_HILL = 0.1  # part of the distance to the primary


def named(identifier: str, label: str) -> str:
    """Return an identifier with the label that tells two stages apart."""
    return f"{identifier}_{label}" if label else identifier


def counted(count: int, noun: str, *, of: int | None = None) -> str:
    """Return ``"3 orbits"`` or ``"1 orbit"``; with `of`, ``"1 of 3 orbits"``."""
    whole = count if of is None else of
    words = f"{whole} {noun}{'' if whole == 1 else 's'}"
    return words if of is None else f"{count} of {words}"


def amplitude_km(x0: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[float]:
    """Return the amplitudes of initial states (6, N), km."""
    return [float(x) for x in x0[0] / 1e3]


def rows_of(product: QsoFamily) -> list[dict[str, Cell]]:
    """Return one table row per member."""
    members = product.members
    speed = members.length_m / members.time_s
    planar, vertical = product.member_indices
    return [
        {
            "name": members.labels[i],
            "x0_km": x_km,
            "y_max_km": float(product.y_max_m[i] / 1e3),
            "vy_m_s": float(abs(members.x0[4, i])),
            "vx_m_s": float(abs(product.vx_at_y_max_m_s[i])),
            "period_h": float(members.period_s[i] / 3600.0),
            "jacobi": float(members.integral[i]),
            "vy0": float(members.x0[4, i] / speed),
            "period": float(members.period_s[i] / members.time_s),
            "b_planar": float(planar[i]),
            "b_vertical": float(vertical[i]),
        }
        for i, x_km in enumerate(amplitude_km(members.x0))
    ]


def present_family(
    product: QsoFamily, compare: QsoFamily | None, reference: ReferenceTable | None, label: str
) -> Presentation:
    """Show a family.

    Parameters
    ----------
    product : QsoFamily
        What is shown.
    compare : QsoFamily or None
        A family drawn beside it.
    reference : ReferenceTable or None
        Published orbits, matched by ``x0_km``.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Table ``table_1``, figures ``period``, ``stability`` and ``orbits``, checks as metrics.
    """
    rows, columns = rows_of(product), list(_COLUMNS)
    notes = [
        "Without unit: in units of L = (μ/n²)^(1/3) = "
        f"{product.members.length_m / 1e3:.12g} km and 1/n = {product.members.time_s:.12g} s; "
        "the Jacobi constant is ½(3x² − z²) + U − ½v²."
    ]
    if reference is not None:
        rows = beside(rows, reference, on="x0_km", tol=_SAME_ORBIT_KM)
        columns = with_paper(columns, rows)
        notes += difference_notes(rows, reference)
    title = f"Quasi-satellite orbits{_around(product)}{_kind(label)}"
    metrics = {
        "closure_max": Metric(float(np.max(product.members.residual))),
        "jacobi_drift_max": Metric(float(np.max(product.drift))),
        "determinant_error_max": Metric(
            float(np.max(np.abs(determinant_error(product.members.monodromy))))
        ),
        "x0_largest": Metric(float(product.curve.x0[0, 0] / 1e3), "km"),
        "x0_smallest": Metric(float(product.curve.x0[0, -1] / 1e3), "km"),
    }
    figures = {
        "period": Figure(
            f"Period along the family{_kind(label)}",
            lambda figure: draw_periods(figure, product, compare),
            f"Period against x at the crossing of the x axis.{_other(compare)}",
        ),
        "stability": Figure(
            f"Stability indices along the family{_kind(label)}",
            lambda figure: draw_indices(figure, product, compare),
            "Planar and vertical stability index; an orbit is linearly stable while both are "
            f"between −2 and 2.{_other(compare)}",
        ),
        "orbits": Figure(
            title,
            lambda figure: draw_orbits(figure, product),
            "The orbits and the body to scale, seen from above the orbit plane of the moon.",
            size_in=(6.0, 8.0),
        ),
    }
    return Presentation(
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={named("table_1", label): Table(title, columns, rows, notes)},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _verdict(product: QsoFamily) -> list[str]:
    largest, smallest = product.curve.x0[0, [0, -1]] / 1e3
    sentences = [
        f"The family ({product.name}) goes from x = {largest:.6g} km ({product.ends[0]}) to "
        f"{smallest:.6g} km ({product.ends[1]}); its orbits were found over {product.method}.",
        f"Its members close to {np.max(product.members.residual):.1e} and keep the Jacobi constant "
        f"to {np.max(product.drift):.1e} over {product.drift_revolutions} revolutions "
        f"({product.check}).",
    ]
    sentences += [f"Not all orbits exist: {fault}." for fault in product.missing]
    if not np.all(np.isfinite(product.member_indices)):
        sentences.append("Where a stability index is missing the multipliers are complex.")
    unstable = ~np.all(np.abs(product.member_indices) < 2.0, axis=0)
    if np.any(unstable):
        names = [n for n, bad in zip(product.members.labels, unstable, strict=True) if bad]
        sentences.append(f"Not linearly stable: {', '.join(names)}.")
    else:
        sentences.append(
            "All members are linearly stable; that says nothing of how large an error they bear."
        )
    if product.primary_distance_m:
        share = float(np.max(product.y_max_m)) / product.primary_distance_m
        sentences.append(
            f"The largest orbit reaches {100 * share:.2g} % of the distance to the primary; the "
            "Hill approximation neglects terms of that relative order"
            + (": this orbit is beyond it." if share > _BEYOND_HILL else ".")
        )
    if product.series_radius_m is not None and product.nearest_m < product.series_radius_m:
        sentences.append(
            f"Orbits come as near as {product.nearest_m / 1e3:.4g} km, inside the sphere of "
            f"{product.series_radius_m / 1e3:.4g} km outside which the harmonic series is sure to "
            "converge: its gravity is used there without that guarantee."
        )
    return sentences


def _around(product: QsoFamily) -> str:
    return f" around {product.body.capitalize()}" if product.body not in ("", "body") else ""


def _kind(label: str) -> str:
    return f", {label.replace('_', ' ')}" if label else ""


def _other(compare: QsoFamily | None) -> str:
    return "" if compare is None else f" Dashed: {compare.name}."
