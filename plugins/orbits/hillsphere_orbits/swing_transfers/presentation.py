"""Tables, metrics and sentences about transfers through swing orbits."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import Column, Metric, Presentation, Table
from hillsphere.show.reference import PAPER_SUFFIX, ReferenceTable
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    set_beside,
    tabulate,
    take_or_blank,
    text_column,
)
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.swing_transfers.figures import transfer_charts
from hillsphere_orbits.swing_transfers.products import SwingTransfers, Transfers

__all__ = ["present_transfers"]

_CERTAIN = 0.01  # p-value below which a correlation is taken for one
_LESS_PAPER = {
    "dv_m_s": Column("dv_less_paper_m_s", "m/s", "ΔV less the paper's", 4),
    "tof_d": Column("tof_less_paper_d", "d", "time of flight less the paper's", 4),
}


def present_transfers(
    product: SwingTransfers, reference: ReferenceTable | None, label: str
) -> Presentation:
    """Show transfers.

    Parameters
    ----------
    product : SwingTransfers
        What is shown.
    reference : ReferenceTable or None
        Published costs, matched by ``leg``.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Tables ``table_5``, ``swing_least``, ``swing_front``, ``swing_routes``, ``swing_ranks``,
        figures, checks as metrics.
    """
    notes = [
        "Two impulses, in the plane; the orbit in between is a member of a family of periodic "
        "orbits of several revolutions. The bound holds for any orbit in between: it follows from "
        "the Jacobi constants of both ends alone."
    ]
    unit = (
        f"Without unit: in units of L = {product.length_m / 1e3:.12g} km and 1/n = "
        f"{product.time_s:.12g} s. Closure: largest miss of a patch point when the transfer is "
        "flown from its first state on the departure orbit to a full revolution on the arrival "
        "orbit (Taylor series)."
    )
    tables = {
        "table_5": _with_differences(
            set_beside(
                tabulate("Least cost of each leg", _legs(product), notes), reference, on="leg"
            )
        ),
        "swing_least": tabulate(
            "Least cost of each family", _transfers(product, product.least), [unit]
        ),
        "swing_front": tabulate(
            "Pareto front of cost and time of flight", _transfers(product, product.front),
            [unit, "From the members of all families' chains and the minima along them; of mirror "
             "images one stands for both."],
        ),
        "swing_routes": tabulate(
            "Routes", _routes(product),
            ["Each leg by its cheapest transfer; in between the spacecraft waits on the orbit "
             "reached until the next leg begins."],
        ),
        "swing_ranks": tabulate(
            "What makes a transfer cheap", _ranks(product),
            ["Spearman's rank correlation over the members that connect (each by its cheapest "
             "transfer; angle: mean of both), and over the cheapest of each family. Neighbouring "
             "members resemble each other, so that p-values over members are too small."],
        ),
    }  # fmt: skip
    return Presentation(
        metrics={
            label_identifier(name, label): metric for name, metric in _metrics(product).items()
        },
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures=transfer_charts(product, label),
        verdict=_verdict(product),
    )


def _metrics(product: SwingTransfers) -> dict[str, Metric]:
    metrics = {"swing_transfers": Metric(product.least.size + product.front.size)}
    if product.least.size:
        both = (product.least, product.front)
        margins = [np.min(t.dv_m_s - t.bound_m_s) for t in both if t.size]
        metrics |= {
            "transfer_closure_max": Metric(
                float(max(t.closure_km.max() for t in both if t.size)), "km"
            ),
            "transfer_closure_speed_max": Metric(
                float(max(t.closure_m_s.max() for t in both if t.size)), "m/s"
            ),
            "min_above_energy_bound": Metric(float(min(margins)), "m/s"),
        }
        if not np.isnan(product.least.altitude_m).any():
            lowest = min(float(t.altitude_m.min()) for t in both if t.size)
            metrics["min_transfer_altitude"] = Metric(lowest / 1e3, "km")
    return metrics


def _best(product: SwingTransfers, leg: int) -> int | None:
    own = np.flatnonzero(product.least.leg == leg)
    return int(own[np.argmin(product.least.total_m_s[own])]) if own.size else None


def _legs(product: SwingTransfers) -> list[FilledColumn]:
    least, of = product.least, FieldColumns(product, "legs")
    own = [_best(product, leg) for leg in range(len(product.legs))]
    best = [-1 if k is None else k for k in own]
    families = [None if k is None else product.families[least.family[k]] for k in own]
    counts = [np.count_nonzero(least.leg == leg) for leg in range(len(product.legs))]
    return [
        of("legs", "leg"),
        column("dv_m_s", take_or_blank(least.total_m_s, best), "least ΔV", 8),
        column("dv_departure_m_s", take_or_blank(least.dv_m_s[0], best), "departure", 6),
        column("dv_arrival_m_s", take_or_blank(least.dv_m_s[1], best), "arrival", 6),
        column("tof_d", take_or_blank(least.tof_s, best), "time of flight", 6),
        text_column("family", families, "family"),
        text_column("kind", [None if k is None else least.kind[k] for k in own], "where"),
        of("bound_m_s", "energy_bound_m_s"),
        column("families", counts, "families that connect"),
        of("status"),
    ]


def _with_differences(table: Table) -> Table:
    """Put ours less the paper's behind the paper's."""
    columns: list[Column] = []
    rows = [dict(row) for row in table.rows]
    for paper in table.columns:
        columns.append(paper)
        name = paper.name.removesuffix(PAPER_SUFFIX)
        if name == paper.name or name not in _LESS_PAPER:
            continue
        columns.append(_LESS_PAPER[name])
        for row in rows:
            ours, theirs = row.get(name), row.get(paper.name)
            row[_LESS_PAPER[name].name] = (
                ours - theirs if isinstance(ours, float) and isinstance(theirs, float) else None
            )
    return Table(table.title, columns, rows, table.notes)


def _transfers(product: SwingTransfers, chosen: Transfers) -> list[FilledColumn]:
    of, family = FieldColumns(chosen, "transfers"), chosen.family.tolist()
    unit = np.array([product.length_m] * 3 + [product.length_m / product.time_s] * 3)
    x, y, _, vx, vy, _ = chosen.x0 / unit[:, None]
    departure, arrival = chosen.dv_m_s
    return [
        text_column("leg", [product.legs[leg] for leg in chosen.leg], "leg"),
        text_column("family", [product.families[f] for f in family], "family"),
        column("d", [product.d[f] for f in family]),
        column("n", [product.n[f] for f in family]),
        column("dv_m_s", chosen.total_m_s, "ΔV", 9),
        column("dv_departure_m_s", departure, "departure", 7),
        column("dv_arrival_m_s", arrival, "arrival", 7),
        column("bound_departure_m_s", chosen.bound_m_s[0], "bound", 5),
        column("bound_arrival_m_s", chosen.bound_m_s[1], "bound", 5),
        of("tof_s"),
        of("kind"),
        of("integral", "jacobi"),
        column("angle_departure_deg", chosen.angle_rad[0], "angle", 5),
        column("angle_arrival_deg", chosen.angle_rad[1], "angle", 5),
        column("x0", x, "x at the start", 12),
        column("y0", y, "y at the start", 12),
        column("vx0", vx, "ẋ at the start", 12),
        column("vy0", vy, "ẏ at the start", 12),
        column("period", chosen.period_s / product.time_s, "period", 12),
        *map(of, ("altitude_m", "closure_km", "closure_m_s")),
    ]


def _routes(product: SwingTransfers) -> list[FilledColumn]:
    of = FieldColumns(product.routes, "routes")
    return [
        of("name", "route"),
        of("total_m_s", "dv_m_s"),
        *map(of, ("tof_s", "waiting_s", "closure_km", "closure_m_s")),
    ]


def _ranks(product: SwingTransfers) -> list[FilledColumn]:
    ranks = np.stack([product.rank, product.rank_of_least], axis=1).reshape(-1, 2, 2)
    counts, cheapest = [], []
    for leg in range(len(product.legs)):
        own, least = product.member_leg == leg, product.least.leg == leg
        for angle, integral, dv in (
            (product.member_angle_rad[own], product.member_integral[own],
             product.member_dv_m_s[own]),
            (np.mean(product.least.angle_rad[:, least], axis=0), product.least.integral[least],
             product.least.total_m_s[least]),
        ):  # fmt: skip
            counts.append(dv.size)
            k = np.argmin(dv) if dv.size else 0
            cheapest.append(
                (angle[k], np.count_nonzero(angle < angle[k]), integral[k],
                 np.count_nonzero(integral > integral[k]))
                if dv.size else (None, None, None, None)
            )  # fmt: skip
    angles, smaller, integrals, larger = zip(*cheapest, strict=True)
    return [
        text_column("leg", np.repeat(np.array(product.legs), 2), "leg"),
        text_column("over", ("members", "families") * len(product.legs), "over"),
        column("count", counts, "number"),
        column("rho_angle", ranks[:, 0, 0], "ρ(ΔV, angle)", 4),
        column("p_angle", ranks[:, 0, 1], "p", 2),
        column("rho_jacobi", ranks[:, 1, 0], "ρ(ΔV, C)", 4),
        column("p_jacobi", ranks[:, 1, 1], "p", 2),
        column("cheapest_angle_deg", angles, "angle of the cheapest", 4),
        column("smaller_angle", smaller, "members with a smaller one"),
        column("cheapest_jacobi", integrals, "C of the cheapest", 6),
        column("larger_jacobi", larger, "members with a larger one"),
    ]


def _verdict(product: SwingTransfers) -> list[str]:
    sentences = []
    for leg, name in enumerate(product.legs):
        k = _best(product, leg)
        if k is None:
            sentences.append(f"{name}: no transfer through swing orbits, {product.status[leg]}.")
            continue
        least = product.least
        sentences.append(
            f"{name}: {least.total_m_s[k]:.4f} m/s in {least.tof_s[k] / DAY_S:.3f} d by way of "
            f"{product.families[least.family[k]]} ({least.kind[k]}); no orbit in between could do "
            f"with less than {product.bound_m_s[leg]:.3f} m/s."
        )
        sentences += _claim(product, leg, name)
    routes = product.routes
    for r, name in enumerate(routes.name):
        if len(routes.legs[r]) > 1 and np.isfinite(routes.total_m_s[r]):
            days = (routes.tof_s[r] + routes.waiting_s[r]) / DAY_S
            sentences.append(
                f"Route {name}: {routes.total_m_s[r]:.4f} m/s in {days:.3f} d, "
                f"{routes.waiting_s[r] / DAY_S:.3f} d of it between the legs."
            )
    if product.least.size:
        sentences.append(
            "Flown anew from end to end the transfers miss their patch points by at most "
            f"{max(product.least.closure_km.max(), product.front.closure_km.max()):.1e} km."
        )
    return sentences


def _claim(product: SwingTransfers, leg: int, name: str) -> list[str]:
    """Judge whether the cheapest swing orbits are nearly tangent and of highest Jacobi constant."""
    own = product.member_leg == leg
    ranks: Array = product.rank[leg]
    if not np.isfinite(ranks).all():
        return []
    angle, integral = product.member_angle_rad[own], product.member_integral[own]
    k = int(np.argmin(product.member_dv_m_s[own]))
    nearer = 1 + int(np.count_nonzero(angle < angle[k]))
    higher = 1 + int(np.count_nonzero(integral > integral[k]))
    tangent = ranks[0, 0] > 0.0 and ranks[0, 1] < _CERTAIN
    high = ranks[1, 0] < 0.0 and ranks[1, 1] < _CERTAIN
    return [
        f"{name}, over {angle.size} members: cost correlates with the angle between the orbits by "
        f"ρ = {ranks[0, 0]:.2f} and with the Jacobi constant by {ranks[1, 0]:.2f}. That the "
        f"cheapest are nearly tangent {_holds(tangent, nearer == 1)} (the cheapest member is "
        f"number {nearer} by its angle), that they are of highest Jacobi constant "
        f"{_holds(high, higher == 1)} (number {higher})."
    ]


def _holds(trend: bool, strictly: bool) -> str:
    if strictly:
        return "holds"
    return "holds as a trend only" if trend else "does not hold"
