"""How the stage ``lft`` shows its result: blocks, terms and errors in tables, two figures."""

from __future__ import annotations

from functools import partial

import numpy as np

from hillsphere.linear_products import LinearModels
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_controllers.stages.lft.figures import draw_errors, draw_responses
from hillsphere_controllers.stages.lft.products import FittedModels

__all__ = ["presented"]

_TERMS = 60


def presented(product: FittedModels, models: LinearModels) -> Presentation:
    """Return tables, figures and sentences of uncertain models.

    Parameters
    ----------
    product : FittedModels
        The uncertain models.
    models : LinearModels
        What they were fitted to.
    """
    seen = product.response_error[np.isfinite(product.response_error)]
    worst = float(seen.max()) if seen.size else 0.0
    metrics = {
        "lft_size": Metric(max(int((m.times * m.rows).sum()) for m in product.models)),
        "lft_response_error": Metric(worst),
    }
    tables = {"lft_blocks": _blocks(product)}
    figures = {}
    if product.exponents:
        metrics["lft_fit_error"] = Metric(max(float(e[-1]) for e in product.errors))
        tables["lft_terms"] = _terms(product)
        figures["lft_errors"] = Figure(
            "Error of the fit by the number of its terms",
            partial(draw_errors, product=product),
            "Largest error of an entry of [A B; C D] relative to its range over the models; an "
            "exact fit ends in rounding.",
        )
        figures["lft_responses"] = Figure(
            "Models and the uncertain model at their parameters",
            partial(draw_responses, product=product, models=models),
            "Largest singular value over frequency of models (coloured), and of the uncertain "
            "model at the same values of the parameters (black, dashed).",
        )
    return Presentation(metrics, tables, figures, _verdict(product, worst, seen.size))


def _blocks(product: FittedModels) -> Table:
    rows: list[dict[str, Cell]] = []
    for g, model in enumerate(product.models):
        for k, name in enumerate(model.names):
            real = model.kinds[k] == "real"
            place = product.parameters.index(name) if real else -1
            rows.append(
                {
                    "model": product.labels[g],
                    "block": name,
                    "kind": "dynamic" if model.dynamic[k] else model.kinds[k],
                    "rows": int(model.rows[k]),
                    "columns": int(model.columns[k]),
                    "copies_before": int(product.before[g, place]) if real else 1,
                    "copies": int(model.times[k]),
                    "lower": float(model.lower[k]) if real else None,
                    "nominal": float(model.nominal[k]) if real else None,
                    "upper": float(model.upper[k]) if real else None,
                    "unit": model.units[k] if real else "",
                }
            )
    columns = (
        Column("model", "", "uncertain model"),
        Column("block", "", "uncertainty"),
        Column("kind", "", "kind"),
        Column("rows", "-", "rows"),
        Column("columns", "-", "columns"),
        Column("copies_before", "-", "copies before reduction"),
        Column("copies", "-", "copies"),
        Column("lower", "-", "lower bound", 6),
        Column("nominal", "-", "nominal", 6),
        Column("upper", "-", "upper bound", 6),
        Column("unit", "", "unit"),
    )
    notes = [
        f"{label}: the reduction costs at most {bound:.3g} of the largest change of [A B; C D] "
        f"(proved for all Δ; {sampled:.3g} found at random)."
        for label, bound, sampled in zip(
            product.labels, product.bound, product.sampled, strict=True
        )
        if bound > 0.0
    ]
    return Table("Uncertainties", columns, rows, notes or ["No copy with any effect was left out."])


def _terms(product: FittedModels) -> Table:
    rows: list[dict[str, Cell]] = []
    for g, exponents in enumerate(product.exponents):
        rows += [
            {
                "model": product.labels[g],
                "term": _term(product.parameters, row.tolist()),
                "share": float(product.shares[g][t]),
                "error": float(product.errors[g][t]),
            }
            for t, row in enumerate(exponents)
        ]
    columns = (
        Column("model", "", "uncertain model"),
        Column("term", "", "term"),
        Column("share", "-", "share of the sum of squares", 4),
        Column("error", "-", "largest error so far", 3),
    )
    notes = ["Terms are of the distance from nominal; the largest error is relative to the range."]
    if len(rows) > _TERMS:
        notes.append(f"The first {_TERMS} of {len(rows)} terms.")
    return Table("Terms of the fit", columns, rows[:_TERMS], notes)


def _term(names: tuple[str, ...], exponents: list[int]) -> str:
    factors = [
        name if power == 1 else f"{name}^{power}"
        for name, power in zip(names, exponents, strict=True)
        if power
    ]
    return " ".join(factors) or "1"


def _verdict(product: FittedModels, worst: float, checked: int) -> list[str]:
    said = []
    if product.exponents:
        fit = max(float(e[-1]) for e in product.errors)
        said.append(
            f"Polynomials stand for the models' matrices to {fit:.2g} of each entry's range; the "
            f"uncertain models' responses are those of {checked} models to {worst:.2g} of their "
            "largest gain."
        )
    if product.beyond:
        said.append(
            f"The bounds reach beyond the models by {100.0 * product.beyond:.3g} % of their range: "
            "there the uncertain model is extrapolated."
        )
    alone = product.left_out_error[np.isfinite(product.left_out_error)]
    if alone.size and float(alone.max()) > 10.0 * product.tolerance:
        said.append(
            f"A fit without one of the models misses it by up to {float(alone.max()):.2g} of the "
            "range: more models, or a lower degree, would tell how good the fit is between them."
        )
    return said
