"""Figures of uncertain models: errors of the fit, frequency responses."""

from __future__ import annotations

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere.presentation import LINE_COLOURS, Axis, Chart, Curve, Mark, MarkerShape, Panel, Rule
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.table_cells import whole_step
from hillsphere_controllers.stages.uncertain import to_lft

__all__ = ["error_chart", "response_chart", "size_chart"]

_FLOOR = 1e-17
"""Smallest error drawn: a logarithmic axis has no zero, and errors below rounding look alike."""
_DRAWN = 6
"""Models drawn, and legend entries, at most; more curves could not be told apart."""
_MARKERS: tuple[MarkerShape, ...] = (
    "circle", "square", "diamond", "triangle", "triangle-down", "cross", "plus",
)  # fmt: skip


def error_chart(product: FittedModels, table: str) -> Chart:
    """Return the largest error over the number of terms, one line an uncertain model.

    The rows of `table` are the terms.
    """
    ends = np.cumsum([errors.size for errors in product.errors]).tolist()
    marks: list[Mark] = [
        Curve(np.arange(1, errors.size + 1), np.maximum(errors, _FLOOR), label, marker="circle",
              rows=range(end - errors.size, end))
        for label, errors, end in zip(product.labels, product.errors, ends, strict=True)
    ]  # fmt: skip
    most = max(errors.size for errors in product.errors)
    return Chart(
        "Error of the fit by the number of its terms",
        [Panel(
            Axis("number of terms", step=whole_step(most)),
            Axis("largest error, relative to range", scale="log"),
            [*marks, Rule("y", product.tolerance, "tolerance")],
            legend="best" if len(product.errors) <= _DRAWN else "none",
        )],
        "Largest error of an entry of [A B; C D] relative to its range over the models; an exact "
        "fit ends in rounding.",
        table=table,
    )  # fmt: skip


def size_chart(product: FittedModels, table: str) -> Chart:
    """Return the copies of all parameters, one line for each number of standard deviations.

    The rows of `table` are the uncertain models.
    """
    count, is_alone = len(product.models), len(product.known) == 1
    along = product.known_values[0] if is_alone else np.arange(1.0, count + 1)
    lines = list(zip((f"{s:g} σ" for s in product.size_sigmas), product.sizes, strict=True))
    lines = lines or [("as declared", product.after.sum(axis=1))]
    step = whole_step(float(np.max(along))) if np.array_equal(along, np.round(along)) else None
    most = max(float(np.max(sizes)) for _, sizes in lines)
    return Chart(
        "Size of the uncertain models",
        [Panel(
            Axis(product.known[0].replace("_", " ") if is_alone else "uncertain model", step=step),
            Axis("copies of uncertain parameters", low=0.0, step=whole_step(most)),
            [
                Curve(along, sizes, label, marker=_MARKERS[k % len(_MARKERS)], rows=range(count))
                for k, (label, sizes) in enumerate(lines)
            ],
        )],
        "Copies of all uncertain parameters together.",
        table=table,
    )  # fmt: skip


def response_chart(product: FittedModels, models: LinearModels) -> Chart:
    """Return gains of a few models, and of the uncertain model at their parameters."""
    known = np.flatnonzero(np.isfinite(product.response_error))
    chosen = known[np.unique(np.linspace(0, known.size - 1, min(known.size, _DRAWN)).astype(int))]
    omega = frequencies([models.systems[int(k)] for k in chosen])
    curves, fits = [], []
    for place, k in enumerate(chosen.tolist()):
        model = product.models[int(product.group[k])]
        lft = to_lft(model)
        values = {
            name: float(models.values[models.parameters.index(name), k])
            for name in model.names
            if name in product.parameters
        }
        system = _drop_closed_channels(models.systems[k], lft.nominal)
        fitted = largest_gains(lft.response(omega, values)[0])
        curves.append(
            Curve(omega, largest_gains(system.response(omega)), models.labels[k],
                  LINE_COLOURS[place], width=3.0, opacity=0.7)
        )  # fmt: skip
        fits.append(Curve(omega, fitted, "uncertain model", "black", "dashed", 1.0))
    return Chart(
        "Models and the uncertain model at their parameters",
        [Panel(
            Axis("frequency", "rad/s", scale="log"), Axis("largest singular value", scale="log"),
            [*curves, *fits],
        )],
        "Largest singular value over frequency of models (coloured), and of the uncertain model at "
        "the same values of the parameters (black, dashed).",
    )  # fmt: skip


def _drop_closed_channels(system: LtiSystem, like: LtiSystem) -> LtiSystem:
    """Return the outputs and inputs that no block of the uncertain model closes."""
    if not like.outputs:
        return system
    return system.of(like.outputs, like.inputs)
