"""Tables and sentences on searches: spread over the starts, worst cases, scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.presentation import Metric, Table
from hillsphere.show.tables import FieldColumns, column, finite_or_blank, tabulate, text_column
from hillsphere_controllers.stages.synthesis.products import RobustResult, SearchResult
from hillsphere_controllers.stages.table_cells import finite_fields
from hillsphere_controllers.structured.verdict import AGREED, Verdict

__all__ = ["search_metrics", "search_tables", "start_sentences", "worst_sentence"]

_LISTED = 60
"""Rows of a table at most; all searches are in the product."""
_ALIKE = 0.2
"""Spread of γ over the starts, %, up to which they are said to end alike."""
_SHOWN = 4
"""Values of so many parameters of a scenario stand in the table."""


def search_metrics(search: SearchResult) -> dict[str, Metric]:
    """Return the spread of γ over starts, the verdict in numbers, and the worst case found."""
    verdict = search.verdict
    found = {"synthesis_routes_agreeing": Metric(len(verdict.arrived))}
    if np.isfinite(verdict.gap):
        found["synthesis_gap"] = Metric(verdict.gap)
    starts = search.starts[np.isfinite(search.starts)]
    if starts.size > 1 and not search.scatter:
        found["synthesis_spread"] = Metric(float(starts.max() / starts.min() - 1.0))
    if search.robust is not None:
        found["synthesis_worst_gamma"] = Metric(float(search.robust.worst.max(initial=0.0)))
    return found


def search_tables(search: SearchResult, names: Sequence[str]) -> dict[str, Table]:
    """Return tables of searches, equal designs, worst cases, scenarios, each plant by itself.

    Parameters
    ----------
    search : SearchResult
        What the search says.
    names : sequence of str
        Of the plants that the controller was made for.
    """
    tables = {
        "synthesis_searches": _searches(search),
        "synthesis_routes": _routes(search.verdict),
    }
    if search.equals.size:
        tables["synthesis_equals"] = _equals(search)
    if search.robust is not None:
        tables["synthesis_worst"] = _worst(search.robust)
        tables["synthesis_scenarios"] = _scenarios(search.robust)
    if search.per_plant.size:
        of = FieldColumns(finite_fields(search, "per_plant", "joint"), "plants")
        above = 100.0 * (search.joint / search.per_plant - 1.0)
        columns = [
            text_column("model", names, "model"),
            of("per_plant", "gamma"),
            of("joint"),
            column("above", finite_or_blank(above), "above", 3, unit="%"),
        ]
        note = (
            "Cost of one controller for all plants. Each plant has its nominal parameters, and its "
            "own searches begin at the joint controller."
        )
        title = "The same structure for each plant by itself"
        tables["synthesis_own"] = tabulate(title, columns, (note,)).first(_LISTED)
    return tables


def worst_sentence(search: SearchResult) -> list[str]:
    """Return a sentence on the worst case of uncertain plants; none without."""
    robust = search.robust
    if robust is None:
        return []
    k = int(np.argmax(robust.worst))
    word = "at most" if robust.converged else "more than"
    return [
        f"Worst case found for the uncertain models: γ = {robust.worst[k]:.6g} "
        f"({robust.labels[k]}), {word} 0.5 % above the γ of the {robust.gammas.size - 1} scenarios "
        "of the design."
    ]


def start_sentences(search: SearchResult) -> list[str]:
    """Return sentences on the spread over the starts, the verdict, and the choice of equals."""
    said = []
    good = search.starts[np.isfinite(search.starts)]
    if good.size > 1:
        spread = 100.0 * float(good.max() / good.min() - 1.0)
        told = "no more" if spread <= _ALIKE else "more"
        some = "" if good.size == search.starts.size else f" with a result, of {search.starts.size}"
        said.append(
            f"All starts lie within {100.0 * search.scatter:g} % about one controller. Their "
            f"spread in γ, {spread:.2g} % over {good.size}{some}, gives no evidence on other "
            "minima."
            if search.scatter
            else f"γ spreads by {spread:.2g} % over {good.size} starts{some}, {told} than "
            f"{_ALIKE:g} %."
        )
    said += search.verdict.sentences
    if (below := int(np.count_nonzero(good < search.target))) > 0:
        said.append(
            f"{below} of them stopped below the target γ of {search.target:g}, not at a minimum."
        )
    if search.equals.shape[0] > 1:
        worst = float(search.equals[0, 1])
        said.append(
            f"{search.equals.shape[0]} designs are equal within the tie. The one with the smallest "
            f"worst case of the wider uncertainty was taken: γ = {worst:.4g}; the others have up "
            f"to {search.equals[:, 1].max():.4g}."
        )
    return said


def _searches(search: SearchResult) -> Table:
    found = np.concatenate([search.starts, search.shaken])
    best = found.min(initial=np.inf)
    given = ["at the controller given"] if search.given else []
    about = "about it" if search.scatter else "from a start"
    begun = given + [about] * (search.starts.size - len(given))
    begun += ["near one of the best"] * search.shaken.size
    above = 100.0 * (found / best - 1.0) if np.isfinite(best) else np.full(found.size, np.nan)
    columns = [
        column("search", range(found.size), "search"),
        text_column("begun", begun, "begun"),
        column("gamma", finite_or_blank(found), "γ", 6),
        column("above", finite_or_blank(above), "above the best", 3, unit="%"),
    ]
    note = "A blank cell means that no admissible controller was found."
    return tabulate("Searches", columns, (note,)).first(_LISTED)


def _routes(verdict: Verdict) -> Table:
    of = FieldColumns(finite_fields(verdict, "gammas"), "routes")
    above = 100.0 * (verdict.gammas / verdict.gamma - 1.0)
    columns = [
        *map(of, ("routes", "searches")),
        of("gammas", "gamma"),
        column("above", finite_or_blank(above), "above γ", 3, unit="%"),
        of("remarks", "remark"),
    ]
    note = (
        f"A route arrives if its γ is above the controller's by {100.0 * AGREED:g} % at most. "
        "Restarts near the best confirm nothing."
    )
    return tabulate("Routes", columns, (*verdict.sentences, note))


def _equals(search: SearchResult) -> Table:
    gamma, wider = finite_or_blank(search.equals).T
    columns = [
        text_column("taken", np.arange(gamma.size) == 0, "taken"),
        column("gamma", gamma, "γ", 6),
        column("wider", wider, "γ of its worst case of the wider uncertainty", 6),
    ]
    note = (
        "Designs whose γ differs by at most the tie are equal. The one with the smallest worst "
        "case found for the wider uncertainty is taken."
    )
    return tabulate("Equal designs", columns, (note,)).first(_LISTED)


def _worst(robust: RobustResult) -> Table:
    of = FieldColumns(finite_fields(robust, "worst"), "models")
    columns = [of("labels", "model"), of("worst", "gamma")]
    note = "Each γ is reached by a perturbation and is a lower bound; µ gives an upper bound."
    return tabulate("Worst cases", columns, (note,)).first(_LISTED)


def _scenarios(robust: RobustResult) -> Table:
    of = FieldColumns(finite_fields(robust, "gammas"), "scenarios")
    pairs = zip(robust.names, robust.values, strict=True)
    columns = [
        text_column("model", [robust.labels[k] for k in robust.plants.tolist()], "model"),
        of("gammas", "gamma"),
        text_column(
            "values",
            [_format_values(names, found.tolist()) for names, found in pairs],
            "parameters",
        ),
    ]
    note = (
        f"The last row is the worst case of all. {_SHOWN} values are shown, all are in the product."
    )
    table = tabulate("Scenarios that the controller was made for", columns, (note,))
    return replace(table, rows=table.rows[-_LISTED:])


def _format_values(names: Sequence[str], values: Sequence[float]) -> str:
    pairs = [f"{name} {value:.3g}" for name, value in zip(names, values, strict=True)]
    return ", ".join(pairs[:_SHOWN]) + (", …" if len(pairs) > _SHOWN else "")
