"""Tables, metrics and sentences about transfers along manifolds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Cell, Column, Metric, Presentation, Printed, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    tabulate,
    take_or_blank,
    text_column,
)
from hillsphere_orbits.manifold_transfers.figures import front_chart, transfer_chart
from hillsphere_orbits.manifold_transfers.products import ManifoldTransfers
from hillsphere_orbits.manifold_transfers.specs import ManifoldTransfersSpec
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.scenes import about_moon

__all__ = ["present_transfers"]

_SAME_KM = 1e-6  # a published amplitude is a round number
_BESIDE = (
    Column("connects_paper", "", "connects, paper"),
    Column("dv_m_s_paper", "m/s", "ΔV, paper", 6),
    Column("dv_less_paper_m_s", "m/s", "ΔV less the paper's", 4),
    Column("tof_d_paper", "d", "time of flight, paper", 4),
    Column("tof_less_paper_d", "d", "time of flight less the paper's", 4),
    Column("dominated", "", "an entry of the ladder betters the paper in both"),
)


def present_transfers(
    product: ManifoldTransfers, spec: ManifoldTransfersSpec, reference: ReferenceTable | None
) -> Presentation:
    """Show transfers.

    Parameters
    ----------
    product : ManifoldTransfers
        What is shown.
    spec : ManifoldTransfersSpec
        For the samples and the label.
    reference : ReferenceTable or None
        Published transfers.

    Returns
    -------
    Presentation
        Tables ``table_4``, ``ladder_ORBIT``, ``legs``, ``transfer_convergence``, figures of the
        cheapest and the quickest transfer and of the fronts.
    """
    about = about_moon(product.body)
    names = f"{product.departure.labels[0]} to {product.arrival.labels[0]}"
    cells = tabulate(f"Transfers {names}{about}", _cells(product), _notes(product, spec))
    cells, beside = _beside(cells, product, reference)
    tables = {"table_4": cells, "legs": tabulate("Legs", _legs(product))}
    for i, label in enumerate(product.orbits.labels):
        own = np.flatnonzero(product.transfer_member == i)
        if own.size:
            tables[f"ladder_{_identifier(label)}"] = tabulate(
                f"Pareto-optimal transfers through {label}", _ladder(product, own)
            )
    if product.checked:
        tables["transfer_convergence"] = tabulate(
            "The search repeated with twice the samples", _convergence(product)
        )
    label = spec.label
    front = front_chart(product, reference, label_identifier("table_4", label))
    figures = {"transfer_front": front}
    if product.transfer_legs.shape[1]:
        best = {
            "cheapest_transfer": int(np.argmin(product.transfer_dv_m_s)),
            "quickest_transfer": int(np.argmin(product.transfer_tof_s)),
        }
        for name, q in best.items():
            title = f"{name.replace('_', ' ').capitalize()} {names}"
            figures[name] = transfer_chart(product, q, title, label_identifier("legs", label))
    return Presentation(
        metrics={label_identifier(k, label): v for k, v in _metrics(product).items()},
        tables={label_identifier(k, label): v for k, v in tables.items()},
        figures={label_identifier(k, label): v for k, v in figures.items()},
        verdict=[*_verdict(product, names), *beside[:3]],
    )


def _notes(product: ManifoldTransfers, spec: ManifoldTransfersSpec) -> list[str]:
    days = product.leg_limit_s / DAY_S
    legs = (
        "Legs to the unstable orbit are mirror images of legs along its unstable manifold."
        if product.mirrored
        else "Legs to the unstable orbit are flown along its stable manifold."
    )
    return [
        f"Each leg takes {days:g} d at most, from or to the last moment at which it is "
        f"{product.distance:g} away from the unstable orbit (Euclidean norm of the normalised "
        "state, both at the same time). The impulse falls in steps as legs get longer, so that it "
        "means little without that limit; how long the unstable orbit is flown is not counted.",
        f"{legs} Trajectories start at {product.start_distance:g} at most; "
        f"{spec.samples} of each side, and more where needed.",
        f"An entry of a ladder betters all quicker ones by {spec.least_gain_m_s:g} m/s at least.",
        "Closure: largest miss when a leg, and the planar orbit to where they meet, are flown anew "
        "by Taylor series from their first states. Legs that pass low over the body magnify the "
        f"last digits of their first state; those that miss by more than {spec.closure_limit_m:g} "
        "m make no transfer.",
    ]


def _impulses(product: ManifoldTransfers, index: list[int], digits: int) -> list[FilledColumn]:
    """Return cost and time of flight of both legs; blank for an index of −1."""
    a, b = product.transfer_legs
    dv, tof = product.leg_dv_m_s, product.leg_tof_s
    return [
        column("dv_departure_m_s", take_or_blank(dv[a], index), "ΔV at departure", digits),
        column("dv_arrival_m_s", take_or_blank(dv[b], index), "ΔV at arrival", digits),
        column("tof_departure_d", take_or_blank(tof[a], index), "to the orbit", digits - 1),
        column("tof_arrival_d", take_or_blank(tof[b], index), "from the orbit", digits - 1),
    ]


def _closures(product: ManifoldTransfers) -> dict[str, Array]:
    """Return the larger misses and the lesser altitude of both legs of each transfer (Q,)."""
    a, b = product.transfer_legs
    altitude = product.leg_altitude_m
    return {
        "km": np.maximum(product.leg_closure_km[a], product.leg_closure_km[b]),
        "m_s": np.maximum(product.leg_closure_m_s[a], product.leg_closure_m_s[b]),
        "altitude_m": np.minimum(altitude[a], altitude[b]),
    }


def _cells(product: ManifoldTransfers) -> list[FilledColumn]:
    of, dv, tof = FieldColumns(product, "orbits"), product.transfer_dv_m_s, product.transfer_tof_s
    own = [np.flatnonzero(product.transfer_member == i) for i in range(len(product.status))]
    least = [int(q[np.argmin(dv[q])]) if q.size else -1 for q in own]
    quick = [int(q[np.argmin(tof[q])]) if q.size else -1 for q in own]
    closures = _closures(product)
    return [
        text_column("orbit", product.orbits.labels, "through"),
        column("n", [n or None for n in product.revolutions.tolist()], "revolutions"),
        of("z_m", "Az_km"),
        of("status"),
        text_column("connects", [q.size > 0 for q in own], "connects"),
        column("dv_m_s", take_or_blank(dv, least), "least ΔV", 7),
        column("tof_d", take_or_blank(tof, least), "its time of flight", 6),
        *_impulses(product, least, 7),
        column("quickest_dv_m_s", take_or_blank(dv, quick), "ΔV of the quickest", 7),
        column("quickest_tof_d", take_or_blank(tof, quick), "least time of flight", 6),
        column("bound_m_s", np.sum(product.bound_m_s, axis=0), "ΔV at least, by energy", 6),
        column("closure_km", take_or_blank(closures["km"], least), "closure", 2, is_si=False),
        column("altitude_km", take_or_blank(closures["altitude_m"], least), "least altitude", 4),
    ]


def _ladder(product: ManifoldTransfers, own: Integers) -> list[FilledColumn]:
    closures = _closures(product)
    labels = ("at departure", "at arrival", "to the orbit", "from the orbit")
    return [
        column("tof_d", product.transfer_tof_s[own], "time of flight", 7),
        column("dv_m_s", product.transfer_dv_m_s[own], "ΔV", 8),
        *(
            replace(impulse, label=label)
            for impulse, label in zip(_impulses(product, own.tolist(), 8), labels, strict=True)
        ),
        column("closure_km", closures["km"][own], "closure", 2, is_si=False),
        column("closure_m_s", closures["m_s"][own], "closure", 2),
        column("altitude_km", closures["altitude_m"][own], "least altitude", 4),
    ]


def _legs(product: ManifoldTransfers) -> list[FilledColumn]:
    of = FieldColumns(product, "legs")
    return [
        text_column("orbit", [product.orbits.labels[i] for i in product.leg_member], "orbit"),
        text_column("leg", np.where(product.leg_arrives, "arrival", "departure"), "leg"),
        text_column("side", np.where(product.leg_side > 0, "+", "−"), "side"),
        of("leg_p", "p"),
        of("leg_tof_s", "tof_d"),
        of("leg_dv_m_s", "dv_m_s"),
        of("leg_place_bound_m_s", "bound_m_s"),
        of("leg_closure_km", "closure_km"),
        of("leg_closure_m_s", "closure_m_s"),
        of("leg_altitude_m", "altitude_km"),
        of("leg_impact", "impact"),
    ]


def _convergence(product: ManifoldTransfers) -> list[FilledColumn]:
    entries, doubled = product.check_entries
    shift = product.check_shift_m_s
    return [
        text_column("orbit", product.checked, "orbit"),
        column("entries", entries, "entries"),
        column("entries_doubled", doubled, "with twice the samples"),
        column("moved_m_s", np.where(np.isinf(shift), np.nan, shift), "moved by", 2),
    ]


def _beside(
    table: Table, product: ManifoldTransfers, reference: ReferenceTable | None
) -> tuple[Table, list[str]]:
    """Put published values beside the cells; return the table and notes on the comparison."""
    if reference is None:
        return table, []
    rows = [dict(row) for row in table.rows]
    printed: Mapping[tuple[int, float], Mapping[str, Cell]] = {
        (int(_float(row["n"])), _float(row["Az_km"])): row for row in reference.rows
    }
    ours_only: list[str] = []
    paper_only: list[str] = []
    bettered: list[str] = []
    cheaper = compared = 0
    for i, row in enumerate(rows):
        n, z = row["n"], row["Az_km"]
        key = next((k for k in printed if k[0] == n and abs(k[1] - _float(z)) <= _SAME_KM), None)
        if key is None:
            continue
        paper = printed[key]
        total, v_cm = paper["total_m_s"], paper["v_cm_m_s"]
        row["connects_paper"] = isinstance(total, Printed)
        if row["connects"] != row["connects_paper"]:
            (paper_only if row["connects_paper"] else ours_only).append(str(row["orbit"]))
        if not isinstance(total, Printed) or not isinstance(v_cm, Printed):
            continue
        # In decimal, which keeps the printed digits of both.
        dv = Printed(str(Decimal(total.text) - Decimal(v_cm.text)))
        row["dv_m_s_paper"] = dv
        if row["connects"]:
            row["dv_less_paper_m_s"] = _float(row["dv_m_s"]) - dv
        compared += bool(row["connects"])
        cheaper += bool(row["connects"]) and _float(row["dv_m_s"]) < dv
        if isinstance(paper["tof_d"], Printed):
            row["tof_d_paper"] = tof = paper["tof_d"]
            if row["connects"]:
                row["tof_less_paper_d"] = _float(row["tof_d"]) - tof
            own = product.transfer_member == i
            row["dominated"] = bool(
                np.any(
                    own & (product.transfer_dv_m_s <= dv) & (product.transfer_tof_s <= tof * DAY_S)
                )
            )
            bettered.append(
                f"{row['orbit']}: the paper's {dv:.2f} m/s in {tof:g} d is "
                f"{'bettered in both' if row['dominated'] else 'not bettered in both'}."
            )
    notes = [
        f"Of {format_count(compared, 'orbit')} that connect{'s' if compared == 1 else ''} here and "
        f"in the paper, {cheaper} {'has' if cheaper == 1 else 'have'} a transfer of a smaller "
        "impulse here, whatever its time of flight."
    ]
    notes.append(f"Connect here and not in the paper: {'; '.join(ours_only) or 'none'}.")
    notes.append(f"Connect in the paper and not here: {'; '.join(paper_only) or 'none'}.")
    source = (
        f"The paper: {reference.source}. Its impulse is the printed total less the printed "
        "station-keeping cost."
    )
    both = (
        "Differences are those of the transfer in the row, the one of least ΔV. Bettered in both: "
        "whether any entry of the ladder of that orbit takes at most the paper's ΔV and at most "
        "its time of flight."
    )
    notes += [*bettered, both, source]
    columns = (*table.columns, *_BESIDE)
    return Table(table.title, columns, rows, [*table.notes, *notes]), notes


def _metrics(product: ManifoldTransfers) -> dict[str, Metric]:
    metrics = {
        "connected_orbits": Metric(sum(status == "connected" for status in product.status)),
        "legs": Metric(len(product.leg_member)),
        "leg_impacts": Metric(int(np.count_nonzero(product.leg_impact))),
        "trajectories": Metric(int(np.sum(product.trajectories))),
    }
    if product.leg_member.size:
        margin = product.leg_dv_m_s - product.leg_place_bound_m_s
        whole = (
            product.leg_dv_m_s
            - product.bound_m_s[product.leg_arrives.astype(int), product.leg_member]
        )
        metrics["legs_too_sensitive"] = Metric(_too_sensitive(product))
        if np.all(np.isfinite(margin)):
            metrics["min_energy_margin_m_s"] = Metric(
                float(min(np.min(margin), np.min(whole))), "m/s"
            )
    if product.transfer_legs.shape[1]:
        kept = np.unique(product.transfer_legs)
        metrics["closure_max_km"] = Metric(float(np.max(product.leg_closure_km[kept])), "km")
        metrics["closure_max_m_s"] = Metric(float(np.max(product.leg_closure_m_s[kept])), "m/s")
        metrics["least_dv_m_s"] = Metric(float(np.min(product.transfer_dv_m_s)), "m/s")
        metrics["least_tof_d"] = Metric(float(np.min(product.transfer_tof_s)) / DAY_S, "d")
    if product.checked:
        metrics["convergence_moved_m_s"] = Metric(float(np.max(product.check_shift_m_s)), "m/s")
    return metrics


def _verdict(product: ManifoldTransfers, names: str) -> list[str]:
    count = sum(status == "connected" for status in product.status)
    limit = f"with legs of {product.leg_limit_s / DAY_S:g} d at most"
    whole = format_count(count, "orbit", of=len(product.status))
    sentences = [f"{whole} connect{'s' if count == 1 else ''} {names} {limit}."]
    if product.transfer_legs.shape[1]:
        dv, tof = product.transfer_dv_m_s, product.transfer_tof_s / DAY_S
        for what, q in (("The least impulse", np.argmin(dv)), ("The quickest", np.argmin(tof))):
            name = product.orbits.labels[int(product.transfer_member[q])]
            sentences.append(f"{what}: {dv[q]:.2f} m/s in {tof[q]:.2f} d through {name}.")
    if product.leg_member.size:
        sentences.append(_closure(product))
    unstable = [
        f"{name} ({status})"
        for name, status in zip(product.orbits.labels, product.status, strict=True)
        if status not in ("connected", "no leg", "no departure leg", "no arrival leg")
    ]
    if unstable:
        sentences.append(f"Without transfers: {'; '.join(unstable)}.")
    return sentences


def _too_sensitive(product: ManifoldTransfers) -> int:
    """Return the number of legs whose verified miss exceeds the limit."""
    return int(np.count_nonzero(~(product.leg_closure_km * 1e3 <= product.closure_limit_m)))


def _closure(product: ManifoldTransfers) -> str:
    """Return a sentence on the closure of transfers and on legs rejected for their miss."""
    out = (
        f"set aside as too sensitive (missing by more than {product.closure_limit_m:g} m): "
        f"{format_count(_too_sensitive(product), 'leg', of=len(product.leg_member))}"
    )
    if not product.transfer_legs.shape[1]:
        return f"No transfer is kept; {out}."
    largest = float(np.max(product.leg_closure_km[product.transfer_legs])) * 1e3
    return f"Flown anew, the transfers kept miss by at most {largest:.2g} m; {out}."


def _identifier(label: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")[:80] or "orbit"


def _float(cell: Cell) -> float:
    return float(cell) if isinstance(cell, int | float) else float("nan")
