"""What searches of a fixed structure show: spread of the starts, worst cases, scenarios."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.presentation import Cell, Column, Metric, Table
from hillsphere_controllers.stages.synthesis.products import RobustResult, SearchResult

__all__ = ["search_metrics", "search_tables", "worst_sentence"]

_LISTED = 60
_SHOWN = 4
"""Values of so many parameters of a scenario stand in the table."""


def search_metrics(search: SearchResult) -> dict[str, Metric]:
    """Return the spread of γ over the starts, and the worst case of uncertain plants."""
    found: dict[str, Metric] = {}
    starts = search.starts[np.isfinite(search.starts)]
    if starts.size > 1:
        found["synthesis_spread"] = Metric(float(starts.max() / starts.min() - 1.0))
    if search.robust is not None:
        found["synthesis_worst_gamma"] = Metric(float(search.robust.worst.max(initial=0.0)))
    return found


def search_tables(search: SearchResult, names: Sequence[str]) -> dict[str, Table]:
    """Return tables of worst cases, scenarios, and γ of each plant by itself.

    Parameters
    ----------
    search : SearchResult
        What the search says.
    names : sequence of str
        Of the plants that the controller was made for.
    """
    tables = {}
    if search.robust is not None:
        tables["synthesis_worst"] = _worst(search.robust)
        tables["synthesis_scenarios"] = _scenarios(search.robust)
    if search.per_plant.size:
        columns = (Column("model", "", "model"), Column("gamma", "-", "γ", 6))
        rows: list[dict[str, Cell]] = [
            {"model": name, "gamma": _finite(gamma)}
            for name, gamma in zip(names, search.per_plant, strict=True)
        ]
        note = "At its nominal parameters, by searches that begin at the joint controller."
        tables["synthesis_own"] = Table(
            "The same structure for each plant by itself", columns, rows[:_LISTED], (note,)
        )
    return tables


def worst_sentence(search: SearchResult) -> list[str]:
    """Return a sentence on the worst case of uncertain plants; none without."""
    robust = search.robust
    if robust is None:
        return []
    k = int(np.argmax(robust.worst))
    word = "no more than" if robust.converged else "more than"
    return [
        f"For the uncertain models the worst case found has γ = {robust.worst[k]:.6g} "
        f"({robust.labels[k]}), {word} 0.5 % above that of the {robust.gammas.size - 1} scenarios "
        "that it was made for."
    ]


def _worst(robust: RobustResult) -> Table:
    columns = (Column("model", "", "model"), Column("gamma", "-", "γ of the worst case found", 6))
    rows: list[dict[str, Cell]] = [
        {"model": label, "gamma": _finite(gamma)}
        for label, gamma in zip(robust.labels, robust.worst, strict=True)
    ]
    note = "Gains that are reached: whether any is larger, a bound of µ tells."
    return Table("Worst cases", columns, rows[:_LISTED], (note,))


def _scenarios(robust: RobustResult) -> Table:
    columns = (
        Column("model", "", "model"),
        Column("gamma", "-", "γ", 6),
        Column("values", "", "parameters"),
    )
    rows: list[dict[str, Cell]] = [
        {
            "model": robust.labels[int(robust.plants[k])],
            "gamma": _finite(robust.gammas[k]),
            "values": _said(robust.names[k], robust.values[k].tolist()),
        }
        for k in range(robust.gammas.size)
    ]
    note = f"The last one is the worst case of all. All values are in the product; {_SHOWN} shown."
    return Table("Scenarios that the controller was made for", columns, rows[-_LISTED:], (note,))


def _said(names: Sequence[str], values: Sequence[float]) -> str:
    pairs = [f"{name} {value:.3g}" for name, value in zip(names, values, strict=True)]
    return ", ".join(pairs[:_SHOWN]) + (", …" if len(pairs) > _SHOWN else "")


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
