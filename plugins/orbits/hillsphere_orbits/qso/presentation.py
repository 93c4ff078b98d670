"""Tables, metrics and sentences about a family of quasi-satellite orbits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.presentation import Metric, Presentation
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import FieldColumns, FilledColumn, column, set_beside, tabulate
from hillsphere_orbits.qso.figures import index_chart, orbit_chart, period_chart
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.scenes import about_moon
from hillsphere_orbits.stability import determinant_error

__all__ = ["format_count", "label_identifier", "present_family"]

_SAME_ORBIT_KM = 1e-6
"""Amplitudes of a printed orbit and ours that are equal: ours is prescribed, so that only rounding,
far below this millimetre, separates them."""
_SAME_RADIUS = 1e-3
"""Relative distance by which an orbit must be nearer than a sphere to be called inside it: the
samples of an orbit that ends at the sphere are rounded."""
_BEYOND_HILL = 0.1  # part of the distance to the primary


def label_identifier(identifier: str, label: str) -> str:
    """Return an identifier with the label of its stage appended."""
    return f"{identifier}_{label}" if label else identifier


def format_count(count: int, noun: str, *, of: int | None = None) -> str:
    """Return ``"3 orbits"`` or ``"1 orbit"``; with `of`, ``"1 of 3 orbits"``."""
    whole = count if of is None else of
    words = f"{whole} {noun}{'' if whole == 1 else 's'}"
    return words if of is None else f"{count} of {words}"


def _members(product: QsoFamily) -> list[FilledColumn]:
    orbits = product.members
    of, speed = FieldColumns(orbits, "orbits"), orbits.length_m / orbits.time_s
    planar, vertical = product.member_indices
    return [
        of("labels", "name"),
        column("x0_km", orbits.x0[0], "x at the crossing", 6),
        FieldColumns(product, "members")("y_max_m"),
        column("vy_m_s", np.abs(orbits.x0[4]), "|ẏ| at the crossing", 7),
        column("vx_m_s", np.abs(product.vx_at_y_max_m_s), "|ẋ| at largest y", 7),
        of("period_s", digits=8),
        of("integral", "jacobi", digits=10),
        column("vy0", orbits.x0[4] / speed, "ẏ at the crossing", 12),
        column("period", orbits.period_s / orbits.time_s, "period in 1/n", 12),
        column("b_planar", planar, "planar index", 10),
        column("b_vertical", vertical, "vertical index", 10),
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
    notes = [
        "Without unit: in units of L = (μ/n²)^(1/3) = "
        f"{product.members.length_m / 1e3:.12g} km and 1/n = {product.members.time_s:.12g} s; "
        "the Jacobi constant is ½(3x² − z²) + U − ½v²."
    ]
    title = f"Quasi-satellite orbits{about_moon(product.body)}{_kind(label)}"
    table = tabulate(title, _members(product), notes)
    table = set_beside(table, reference, on="x0_km", tol=_SAME_ORBIT_KM)
    metrics = {
        "closure_max": Metric(float(np.max(product.members.residual))),
        "jacobi_drift_max": Metric(float(np.max(product.drift))),
        "determinant_error_max": Metric(
            float(np.max(np.abs(determinant_error(product.members.monodromy))))
        ),
        **{
            # A missing index, of complex multipliers, is one beyond every limit.
            f"{plane}_index_largest": Metric(float(np.nan_to_num(np.abs(b), nan=np.inf).max()))
            for plane, b in zip(("planar", "vertical"), product.member_indices, strict=True)
        },
        "x0_largest": Metric(float(product.curve.x0[0, 0] / 1e3), "km"),
        "x0_smallest": Metric(float(product.curve.x0[0, -1] / 1e3), "km"),
    }
    if product.gravity_error is not None:
        metrics["gravity_error_max"] = Metric(product.gravity_error)
    own = label_identifier("table_1", label)
    other = _other(compare)
    figures = {
        "period": replace(
            period_chart(product, compare, own),
            title=f"Period along the family{_kind(label)}",
            caption=f"Period against x at the crossing of the x axis.{other}",
        ),
        "stability": replace(
            index_chart(product, compare),
            title=f"Stability indices along the family{_kind(label)}",
            caption="Planar and vertical stability index; an orbit is linearly stable while both "
            f"are between −2 and 2 (shaded).{other}",
        ),
        "orbits": orbit_chart(product, title, own),
    }
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={own: table},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
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
            "All members are linearly stable. How large an offset they survive is a question of "
            "nonlinear stability."
        )
    if product.primary_distance_m:
        share = float(np.max(product.y_max_m)) / product.primary_distance_m
        sentences.append(
            f"The largest orbit reaches {100 * share:.2g} % of the distance to the primary; the "
            "Hill approximation neglects terms of that relative order"
            + (": this orbit is beyond it." if share > _BEYOND_HILL else ".")
        )
    if product.gravity_error is not None:
        sentences.append(
            "The series of the shape differs along these orbits from the gravity of the shape "
            f"itself by at most {product.gravity_error:.1e} of the acceleration."
        )
    if product.series_radius_m is not None and product.nearest_m < product.series_radius_m * (
        1.0 - _SAME_RADIUS
    ):
        sentences.append(
            f"Orbits come as near as {product.nearest_m / 1e3:.4g} km, inside the sphere of "
            f"{product.series_radius_m / 1e3:.4g} km outside which the harmonic series is sure to "
            "converge: its gravity is used there without that guarantee."
        )
    return sentences


def _kind(label: str) -> str:
    return f", {label.replace('_', ' ')}" if label else ""


def _other(compare: QsoFamily | None) -> str:
    return "" if compare is None else f" Dashed: {compare.name}."
