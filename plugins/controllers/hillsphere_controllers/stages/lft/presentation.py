"""Presentation of uncertain models: tables of blocks, terms and errors, and figures."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np

from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.tables import FieldColumns, column, tabulate, text_column
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.lft.figures import error_chart, response_chart, size_chart
from hillsphere_controllers.stages.lft.products import FittedModels

__all__ = ["present_uncertain_models"]

_TERMS = 60
"""Rows of a table of terms at most; all terms are in the product."""


def present_uncertain_models(product: FittedModels, models: LinearModels) -> Presentation:
    """Return tables, figures and sentences of uncertain models.

    Parameters
    ----------
    product : FittedModels
        The uncertain models.
    models : LinearModels
        Models that they were fitted to.
    """
    seen = product.response_error[np.isfinite(product.response_error)]
    worst = float(seen.max()) if seen.size else 0.0
    metrics = {
        "lft_size": Metric(max(int((m.times * m.rows)[~m.covers].sum()) for m in product.models)),
    }
    if seen.size:
        metrics["lft_response_error"] = Metric(worst)
    tables = {"lft_blocks": _blocks(product)}
    figures = {}
    if not product.exponents and product.parameters:
        metrics["lft_left_out"] = Metric(float(product.sampled.max()))
    if len(product.models) > 1 and product.parameters:
        tables["lft_sizes"] = _sizes(product)
        figures["lft_sizes"] = size_chart(product, "lft_sizes")
    if product.exponents:
        metrics["lft_fit_error"] = Metric(max(float(e[-1]) for e in product.errors))
        tables["lft_terms"] = _terms(product)
        figures["lft_errors"] = error_chart(product, "lft_terms")
    if product.parameters and seen.size:
        figures["lft_responses"] = response_chart(product, models)
    return Presentation(metrics, tables, figures, _verdict(product, worst, seen.size))


def _blocks(product: FittedModels) -> Table:
    blocks = [(g, k) for g, model in enumerate(product.models) for k in range(len(model.names))]

    def each(field: str) -> list[Any]:
        return [getattr(product.models[g], field)[k] for g, k in blocks]

    names, kinds, dynamic, times = map(each, ("names", "kinds", "dynamic", "times"))
    covers = each("covers")
    real = [kind == "real" for kind in kinds]

    def of_real(field: str, blank: Any = None) -> list[Any]:
        return [one if here else blank for one, here in zip(each(field), real, strict=True)]

    before = [
        product.before[g, product.parameters.index(name)] if name in product.parameters else copies
        for (g, _), name, copies in zip(blocks, names, times, strict=True)
    ]
    columns = [
        text_column("model", [product.labels[g] for g, _ in blocks], "uncertain model"),
        text_column("block", names, "uncertainty"),
        text_column(
            "kind",
            [
                "cover" if left else "dynamic" if own else kind
                for left, own, kind in zip(covers, dynamic, kinds, strict=True)
            ],
            "kind",
        ),
        column("rows", each("rows"), "rows"),
        column("columns", each("columns"), "columns"),
        column("copies_before", before, "copies before reduction"),
        column("copies", times, "copies"),
        column("lower", of_real("lower"), "lower bound", 6),
        column("nominal", of_real("nominal"), "nominal", 6),
        column("upper", of_real("upper"), "upper bound", 6),
        text_column("unit", of_real("units", ""), "unit"),
    ]  # fmt: skip
    notes = [
        f"{label}: the error of the reduction is at most {bound:.3g} of the largest change of "
        f"[A B; C D] (proved for all Δ; {sampled:.3g} found at random)."
        for label, bound, sampled in zip(
            product.labels, product.bound, product.sampled, strict=True
        )
        if bound > 0.0
    ]
    notes = notes or ["The reduction removed only copies without effect."]
    if any(covers):
        notes.append(
            "A block of the kind cover stands for what was left out: with it, an uncertain model "
            "contains the whole family."
        )
    if "misfit" in names:
        notes.append(
            "The block misfit covers the errors of the polynomials at the models; between the "
            "models nothing is known of them."
        )
    return tabulate("Uncertainties", columns, notes)


def _sizes(product: FittedModels) -> Table:
    of = FieldColumns(product, "uncertain_models")
    columns = [
        of("labels", "model"),
        column("before", product.before.sum(axis=1), "copies before reduction"),
        column("after", product.after.sum(axis=1), "copies"),
        column("parameters", np.count_nonzero(product.after, axis=1), "parameters left"),
        *map(of, ("dropped", "bound", "sampled")),
        *(
            column(_at_sigmas(sigmas), sizes, f"copies for {sigmas:g} σ")
            for sigmas, sizes in zip(product.size_sigmas.tolist(), product.sizes, strict=True)
        ),
    ]
    notes = [
        "Truncation error: the root sum of squares of the directions left out, relative to "
        + (
            "that of all directions"
            if product.truncation_of == "change"
            else "the nominal matrix where parameters change it"
        )
        + "; and its largest singular value, relative to that of the largest change of "
        "[A B; C D], as a bound for all values of the parameters and at random ones. A block of "
        "the uncertain models covers this error; the copies do not count it."
    ]
    return tabulate("Sizes of the uncertain models", columns, notes)


def _at_sigmas(sigmas: float) -> str:
    return f"copies_{sigmas:g}_sigma".replace(".", "p")


def _terms(product: FittedModels) -> Table:
    terms = [(g, row) for g, exponents in enumerate(product.exponents) for row in exponents]
    columns = [
        text_column("model", [product.labels[g] for g, _ in terms], "uncertain model"),
        text_column("term", [_term(product.parameters, row.tolist()) for _, row in terms], "term"),
        column("share", list(chain(*product.shares)), "share of the sum of squares", 4),
        column("error", list(chain(*product.errors)), "largest error so far", 3),
    ]
    notes = [
        "The terms are powers of the distance from nominal. "
        "The largest error is relative to the range."
    ]
    return tabulate("Terms of the fit", columns, notes).first(_TERMS, "terms")


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
            f"The polynomials fit the models' matrices to {fit:.2g} of each entry's range, and the "
            f"frequency responses of {checked} models to {worst:.2g} of their largest gain."
        )
    elif product.parameters and product.checks.all():
        bare = [
            label
            for label, copies in zip(product.labels, product.after, strict=True)
            if not copies.any()
        ]
        kept = "the uncertain models keep their strongest directions"
        if bare:
            some = len(bare) < len(product.labels)
            kept = f"{kept}, but none" if some else "the truncation leaves all of them out"
            kept += f" at {', '.join(bare)}: nothing but the cover is left uncertain there"
        said.append(
            f"All models are affine in the {len(product.parameters)} uncertain parameters; {kept}."
        )
    elif product.parameters:
        said.append(
            f"The models are assumed affine in the {len(product.parameters)} uncertain "
            "parameters. No model is left to check this: make more than one for each parameter."
        )
    if product.beyond:
        said.append(
            f"The bounds exceed the models' range by {100.0 * product.beyond:.3g} % of it: the "
            "uncertain model extrapolates there."
        )
    alone = product.left_out_error[np.isfinite(product.left_out_error)]
    if alone.size and float(alone.max()) > 10.0 * product.tolerance:
        said.append(
            f"Cross-validation: a fit without one of the models misses it by up to "
            f"{float(alone.max()):.2g} of the range. Use more models, or a lower degree."
        )
    return said
