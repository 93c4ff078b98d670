"""Table and figure of the station-keeping index, beside published values."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import (
    Axis,
    Cell,
    Chart,
    Column,
    Curve,
    Mark,
    Metric,
    Panel,
    Points,
    Presentation,
    Printed,
    Table,
)
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.scenes import family_colours
from hillsphere_orbits.spatial_qso_families.products import StationKeepingIndex
from hillsphere_orbits.spatial_qso_families.specs import StationKeepingSpec

__all__ = ["AGREES", "present_index"]

AGREES = 5e-4
"""Relative difference up to which a published value counts as reproduced."""

_NEARLY_ALL = 0.9  # of the cells: then the model is the paper's and the rest is print


_SAME_KM = 1e-6  # a published amplitude is a round number


def present_index(
    product: StationKeepingIndex, spec: StationKeepingSpec, reference: ReferenceTable | None
) -> Presentation:
    """Show the index.

    Parameters
    ----------
    product : StationKeepingIndex
        What is shown.
    spec : StationKeepingSpec
        The assumptions.
    reference : ReferenceTable or None
        Published values with the columns n, Az_km, v_cm_m_s.

    Returns
    -------
    Presentation
        Tables ``table_3`` and ``table_3_differences``, figure ``station_keeping``.
    """
    days = spec.duration_s / DAY_S
    notes = [
        f"v_cm is an index, not a cost that can be flown: it nulls the unstable component once "
        f"per period, adds up {spec.sigmas:g}σ of it over {days:g} days, and takes the state to "
        f"be known perfectly (σ = {spec.sigma_position_m:g} m and "
        f"{100.0 * spec.sigma_velocity_m_s:g} cm/s per axis; no navigation or execution error).",
        "A stable member has no unstable component: it has no index, not an index of zero.",
    ]
    table = tabulate(f"Station-keeping index, {days:g} days", _members(product), notes)
    label, tables = spec.label, {}
    if reference is not None:
        table, differences = _beside(table, reference)
        if differences:
            tables[label_identifier("table_3_differences", label)] = tabulate(
                "Station-keeping index against the published one", differences
            )
    unstable = product.v_cm_m_s[~product.stable]
    metrics = {"stable_members": Metric(int(np.count_nonzero(product.stable)))}
    verdict = [f"{_number(product)} judged; {metrics['stable_members'].value} stable."]
    if unstable.size:
        metrics["v_cm_least"] = Metric(float(unstable.min()), "m/s")
        metrics["v_cm_largest"] = Metric(float(unstable.max()), "m/s")
        verdict[0] = (
            f"The index of {unstable.size} unstable members of {_number(product)} is "
            f"{unstable.min():.4g} to {unstable.max():.4g} m/s per {days:g} days, with perfect "
            "knowledge of the state and one correction per period."
        )
    own = label_identifier("table_3", label)
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={own: table, **tables},
        figures={label_identifier("station_keeping", label): _index_chart(table, days, own)},
        verdict=verdict,
    )


def _number(product: StationKeepingIndex) -> str:
    count = len(product.n)
    return f"{count} member{'' if count == 1 else 's'}"


def _members(product: StationKeepingIndex) -> list[FilledColumn]:
    of = FieldColumns(product, "members")
    return [
        of("n"),
        of("z_m", "Az_km"),
        *map(of, ("x0", "vy", "period", "jacobi", "lambda_max")),
        column("v_cm_m_s", np.where(product.stable, np.nan, product.v_cm_m_s), "v_cm", 6),
        of("stable"),
    ]


def _beside(table: Table, reference: ReferenceTable) -> tuple[Table, list[FilledColumn]]:
    """Add the published values and say how they compare; return the differences too."""
    rows = [dict(row) for row in table.rows]
    printed = {
        (float(row["n"]), float(row["Az_km"])): row["v_cm_m_s"]
        for row in reference.rows
        if isinstance(row["n"], Printed) and isinstance(row["Az_km"], Printed)
    }
    compared: list[tuple[Cell, Cell, float]] = []
    apart, blank = [], []
    for row in rows:
        n, z = row["n"], row["Az_km"]
        key = next((k for k in printed if k[0] == n and abs(k[1] - _float(z)) <= _SAME_KM), None)
        if key is None:
            continue
        name, paper, ours = f"1:{n} at {key[1]:g} km", printed[key], row["v_cm_m_s"]
        row["v_cm_paper"] = paper
        if not isinstance(paper, Printed):
            blank.append(
                f"The paper leaves {name} blank; that member is "
                f"{'stable' if ours is None else 'not stable'} here."
            )
        elif ours is None:
            apart.append(f"{name}: stable here, {paper.text} m/s in the paper.")
        else:
            off = _float(ours) / float(paper) - 1.0
            compared.append((n, z, off))
            if abs(off) > AGREES:
                apart.append(f"{name}: {_float(ours):.4f} against the printed {paper.text} m/s.")
    columns = [*table.columns[:-1], Column("v_cm_paper", "m/s", "", 6), table.columns[-1]]
    if not compared:
        return Table(table.title, columns, rows, [*table.notes, *apart, *blank]), []
    orders, amplitudes, offs = zip(*compared, strict=True)
    agrees = [abs(off) <= AGREES for off in offs]
    head = (
        f"{sum(agrees)} of {len(agrees)} values agree within {AGREES:g} (relative) with "
        f"{reference.source}."
    )
    if apart and sum(agrees) >= _NEARLY_ALL * len(agrees):
        head += " Nearly all agree, so the printed ones look like misprints."
    differences = [
        column("n", orders, "revolutions"),
        column("Az_km", amplitudes, "amplitude z", 9, is_si=False),
        column("difference", offs, "relative difference of v_cm", 2),
        text_column("agrees", agrees, f"within {AGREES:g}"),
    ]
    return Table(table.title, columns, rows, [*table.notes, head, *apart, *blank]), differences


def _float(cell: Cell) -> float:
    return float(cell) if isinstance(cell, int | float) else float("nan")


def _index_chart(shown: Table, days: float, table: str) -> Chart:
    rows = shown.rows
    orders = sorted({int(_float(row["n"])) for row in rows})
    marks: list[Mark] = []
    for n, colour in zip(orders, family_colours(len(orders)), strict=True):
        own = [k for k, row in enumerate(rows) if row["n"] == n]
        z, v = ([_float(rows[k][key]) for k in own] for key in ("Az_km", "v_cm_m_s"))
        marks.append(Curve(z, v, f"n = {n}", colour, width=1.2, marker="circle", rows=own))
    printed = [k for k, row in enumerate(rows) if row.get("v_cm_paper")]
    if printed:
        z, v = ([_float(rows[k][key]) for k in printed] for key in ("Az_km", "v_cm_paper"))
        marks.append(Points(z, v, "the paper", "vermillion", "cross", 6.0, rows=printed))
    return Chart(
        shown.title,
        [Panel(Axis("amplitude z", "km"), Axis(f"station-keeping index, {days:g} days", "m/s"),
               marks, legend="right")],
        "Index v_cm against the amplitude, one line per family; a stable member has none.",
        size_in=(8.0, 5.0), table=table,
    )  # fmt: skip
