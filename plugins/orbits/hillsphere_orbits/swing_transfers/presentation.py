"""Tables, metrics and sentences about transfers by way of swing orbits."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.show.reference import (
    PAPER_SUFFIX,
    ReferenceTable,
    beside,
    difference_notes,
    with_paper,
)
from hillsphere_orbits.qso.presentation import named
from hillsphere_orbits.swing_transfers.figures import (
    draw_along,
    draw_fronts,
    draw_tangency,
    draw_transfers,
    figure_size,
)
from hillsphere_orbits.swing_transfers.products import SwingTransfers, Transfers

__all__ = ["present_transfers"]

_DAY = 86400.0
_CERTAIN = 0.01  # p-value below which a correlation is taken for one
_LESS_PAPER = {
    "dv_m_s": Column("dv_less_paper_m_s", "m/s", "ΔV less the paper's", 4),
    "tof_d": Column("tof_less_paper_d", "d", "time of flight less the paper's", 4),
}
_LEGS = (
    Column("leg", "", "leg"),
    Column("dv_m_s", "m/s", "least ΔV", 8),
    Column("dv_departure_m_s", "m/s", "departure", 6),
    Column("dv_arrival_m_s", "m/s", "arrival", 6),
    Column("tof_d", "d", "time of flight", 6),
    Column("family", "", "family"),
    Column("kind", "", "where"),
    Column("energy_bound_m_s", "m/s", "bound by energy", 6),
    Column("families", "-", "families that connect"),
    Column("status", "", "status"),
)
_TRANSFERS = (
    Column("leg", "", "leg"),
    Column("family", "", "family"),
    Column("d", "-"),
    Column("n", "-"),
    Column("dv_m_s", "m/s", "ΔV", 9),
    Column("dv_departure_m_s", "m/s", "departure", 7),
    Column("dv_arrival_m_s", "m/s", "arrival", 7),
    Column("bound_departure_m_s", "m/s", "bound", 5),
    Column("bound_arrival_m_s", "m/s", "bound", 5),
    Column("tof_d", "d", "time of flight", 7),
    Column("kind", "", "where"),
    Column("jacobi", "-", "Jacobi constant", 10),
    Column("angle_departure_deg", "deg", "angle", 5),
    Column("angle_arrival_deg", "deg", "angle", 5),
    Column("x0", "-", "x at the start", 12),
    Column("y0", "-", "y at the start", 12),
    Column("vx0", "-", "ẋ at the start", 12),
    Column("vy0", "-", "ẏ at the start", 12),
    Column("period", "-", "period", 12),
    Column("altitude_km", "km", "least altitude", 5),
    Column("closure_km", "km", "closure", 2),
    Column("closure_m_s", "m/s", "closure", 2),
)
_ROUTES = (
    Column("route", "", "route"),
    Column("dv_m_s", "m/s", "ΔV", 8),
    Column("tof_d", "d", "on swing orbits, without waiting", 6),
    Column("waiting_d", "d", "waiting in between", 6),
    Column("closure_km", "km", "closure", 2),
    Column("closure_m_s", "m/s", "closure", 2),
)
_RANKS = (
    Column("leg", "", "leg"),
    Column("over", "", "over"),
    Column("count", "-", "number"),
    Column("rho_angle", "-", "ρ(ΔV, angle)", 4),
    Column("p_angle", "-", "p", 2),
    Column("rho_jacobi", "-", "ρ(ΔV, C)", 4),
    Column("p_jacobi", "-", "p", 2),
    Column("cheapest_angle_deg", "deg", "angle of the cheapest", 4),
    Column("smaller_angle", "-", "members with a smaller one"),
    Column("cheapest_jacobi", "-", "C of the cheapest", 6),
    Column("larger_jacobi", "-", "members with a larger one"),
)


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
    rows, columns = _leg_rows(product), list(_LEGS)
    notes = [
        "Two impulses, in the plane; the orbit in between is a member of a family of periodic "
        "orbits of several revolutions. The bound holds for any orbit in between: it follows from "
        "the Jacobi constants of both ends alone."
    ]
    if reference is not None:
        rows = beside(rows, reference, on="leg")
        columns = _with_differences(with_paper(columns, rows), rows)
        notes += difference_notes(rows, reference)
    unit = (
        f"Without unit: in units of L = {product.length_m / 1e3:.12g} km and 1/n = "
        f"{product.time_s:.12g} s. Closure: largest miss of a patch point when the transfer is "
        "flown from its first state on the departure orbit to a full revolution on the arrival "
        "orbit (Taylor series)."
    )
    tables = {
        "table_5": Table("Least cost of each leg", columns, rows, notes),
        "swing_least": Table(
            "Least cost of each family", _TRANSFERS, _transfer_rows(product, product.least), [unit]
        ),
        "swing_front": Table(
            "Transfers that none betters in cost and time", _TRANSFERS,
            _transfer_rows(product, product.front),
            [unit, "From the members of all families' chains and the minima along them; of mirror "
             "images one stands for both."],
        ),
        "swing_routes": Table(
            "Routes", _ROUTES, _route_rows(product),
            ["Each leg by its cheapest transfer; in between the spacecraft waits on the orbit "
             "reached until the next leg begins."],
        ),
        "swing_ranks": Table(
            "What makes a transfer cheap", _RANKS, _rank_rows(product),
            ["Spearman's rank correlation over the members that connect (each by its cheapest "
             "transfer; angle: mean of both), and over the cheapest of each family. Neighbouring "
             "members resemble each other, so that p-values over members are too small."],
        ),
    }  # fmt: skip
    return Presentation(
        metrics={named(name, label): metric for name, metric in _metrics(product).items()},
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in _figures(product).items()},
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
            "above_energy_bound_min": Metric(float(min(margins)), "m/s"),
        }
        if not np.isnan(product.least.altitude_m).any():
            lowest = min(float(t.altitude_m.min()) for t in both if t.size)
            metrics["transfer_altitude_min"] = Metric(lowest / 1e3, "km")
    return metrics


def _figures(product: SwingTransfers) -> dict[str, Figure]:
    wide, tall = figure_size(len(product.legs), 3.6), figure_size(len(product.legs), 5.2)
    return {
        "swing_transfers": Figure(
            "Cheapest transfer of each leg",
            lambda figure: draw_transfers(figure, product),
            "Departure and arrival orbit, the way from one to the other, and the body to scale.",
            size_in=tall,
        ),
        "swing_along": Figure(
            "Cost along the families",
            lambda figure: draw_along(figure, product),
            "Every member that connects the two orbits, by its Jacobi constant; marked: the least "
            "of each family, and the least of all. Dashed: the Jacobi constants of both orbits.",
            size_in=wide,
        ),
        "swing_front": Figure(
            "Cost and time",
            lambda figure: draw_fronts(figure, product),
            "Transfers that no other one betters in both, and the least cost of each family.",
            size_in=wide,
        ),
        "swing_tangency": Figure(
            "Cost and tangency",
            lambda figure: draw_tangency(figure, product),
            "Cheapest transfer of every member that connects, against the mean of the angles at "
            "which it meets the two orbits.",
            size_in=wide,
        ),
    }


def _best(product: SwingTransfers, leg: int) -> int | None:
    own = np.flatnonzero(product.least.leg == leg)
    return int(own[np.argmin(product.least.total_m_s[own])]) if own.size else None


def _leg_rows(product: SwingTransfers) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for leg, name in enumerate(product.legs):
        row: dict[str, Cell] = {"leg": name, "dv_m_s": None}
        k = _best(product, leg)
        if k is not None:
            least = product.least
            row |= {
                "dv_m_s": float(least.total_m_s[k]),
                "dv_departure_m_s": float(least.dv_m_s[0, k]),
                "dv_arrival_m_s": float(least.dv_m_s[1, k]),
                "tof_d": float(least.tof_s[k] / _DAY),
                "family": product.families[least.family[k]],
                "kind": least.kind[k],
            }
        row |= {
            "energy_bound_m_s": float(product.bound_m_s[leg]),
            "families": int(np.count_nonzero(product.least.leg == leg)),
            "status": product.status[leg],
        }
        rows.append(row)
    return rows


def _with_differences(columns: list[Column], rows: list[dict[str, Cell]]) -> list[Column]:
    """Put ours less the paper's into the rows; return the columns with those of the differences."""
    wide: list[Column] = []
    for column in columns:
        wide.append(column)
        name = column.name.removesuffix(PAPER_SUFFIX)
        if name == column.name or name not in _LESS_PAPER:
            continue
        wide.append(_LESS_PAPER[name])
        for row in rows:
            ours, paper = row.get(name), row.get(column.name)
            row[_LESS_PAPER[name].name] = (
                ours - paper if isinstance(ours, float) and isinstance(paper, float) else None
            )
    return wide


def _transfer_rows(product: SwingTransfers, chosen: Transfers) -> list[dict[str, Cell]]:
    dv, angle = chosen.dv_m_s, np.degrees(chosen.angle_rad)
    unit = np.array([product.length_m] * 3 + [product.length_m / product.time_s] * 3)
    start = chosen.x0 / unit[:, None]
    return [
        {
            "leg": product.legs[chosen.leg[k]],
            "family": product.families[chosen.family[k]],
            "d": product.d[chosen.family[k]],
            "n": product.n[chosen.family[k]],
            "dv_m_s": float(dv[:, k].sum()),
            "dv_departure_m_s": float(dv[0, k]),
            "dv_arrival_m_s": float(dv[1, k]),
            "bound_departure_m_s": float(chosen.bound_m_s[0, k]),
            "bound_arrival_m_s": float(chosen.bound_m_s[1, k]),
            "tof_d": float(chosen.tof_s[k] / _DAY),
            "kind": chosen.kind[k],
            "jacobi": float(chosen.integral[k]),
            "angle_departure_deg": float(angle[0, k]),
            "angle_arrival_deg": float(angle[1, k]),
            "x0": float(start[0, k]),
            "y0": float(start[1, k]),
            "vx0": float(start[3, k]),
            "vy0": float(start[4, k]),
            "period": float(chosen.period_s[k] / product.time_s),
            "altitude_km": _or_none(chosen.altitude_m[k] / 1e3),
            "closure_km": float(chosen.closure_km[k]),
            "closure_m_s": float(chosen.closure_m_s[k]),
        }
        for k in range(chosen.size)
    ]


def _route_rows(product: SwingTransfers) -> list[dict[str, Cell]]:
    routes = product.routes
    return [
        {
            "route": name,
            "dv_m_s": _or_none(routes.total_m_s[r]),
            "tof_d": _or_none(routes.tof_s[r] / _DAY),
            "waiting_d": _or_none(routes.waiting_s[r] / _DAY),
            "closure_km": _or_none(routes.closure_km[r]),
            "closure_m_s": _or_none(routes.closure_m_s[r]),
        }
        for r, name in enumerate(routes.name)
    ]


def _rank_rows(product: SwingTransfers) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for leg, name in enumerate(product.legs):
        own = product.member_leg == leg
        least = product.least.leg == leg
        for over, ranks, angle, integral, dv in (
            ("members", product.rank[leg], product.member_angle_rad[own],
             product.member_integral[own], product.member_dv_m_s[own]),
            ("families", product.rank_of_least[leg],
             np.mean(product.least.angle_rad[:, least], axis=0), product.least.integral[least],
             product.least.total_m_s[least]),
        ):  # fmt: skip
            row: dict[str, Cell] = {"leg": name, "over": over, "count": int(dv.size)}
            row |= {
                "rho_angle": _or_none(ranks[0, 0]), "p_angle": _or_none(ranks[0, 1]),
                "rho_jacobi": _or_none(ranks[1, 0]), "p_jacobi": _or_none(ranks[1, 1]),
            }  # fmt: skip
            if dv.size:
                k = int(np.argmin(dv))
                row |= {
                    "cheapest_angle_deg": float(np.degrees(angle[k])),
                    "smaller_angle": int(np.count_nonzero(angle < angle[k])),
                    "cheapest_jacobi": float(integral[k]),
                    "larger_jacobi": int(np.count_nonzero(integral > integral[k])),
                }
            rows.append(row)
    return rows


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _verdict(product: SwingTransfers) -> list[str]:
    sentences = []
    for leg, name in enumerate(product.legs):
        k = _best(product, leg)
        if k is None:
            sentences.append(f"{name}: no transfer by way of swing orbits, {product.status[leg]}.")
            continue
        least = product.least
        sentences.append(
            f"{name}: {least.total_m_s[k]:.4f} m/s in {least.tof_s[k] / _DAY:.3f} d by way of "
            f"{product.families[least.family[k]]} ({least.kind[k]}); no orbit in between could do "
            f"with less than {product.bound_m_s[leg]:.3f} m/s."
        )
        sentences += _claim(product, leg, name)
    routes = product.routes
    for r, name in enumerate(routes.name):
        if len(routes.legs[r]) > 1 and np.isfinite(routes.total_m_s[r]):
            days = (routes.tof_s[r] + routes.waiting_s[r]) / _DAY
            sentences.append(
                f"Route {name}: {routes.total_m_s[r]:.4f} m/s in {days:.3f} d, "
                f"{routes.waiting_s[r] / _DAY:.3f} d of it between the legs."
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
