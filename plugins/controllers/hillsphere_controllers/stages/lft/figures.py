"""Figures of uncertain models: errors of the fit, frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere.presentation import PALETTE
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.uncertain import to_lft

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_errors", "draw_responses", "draw_sizes"]

_FLOOR = 1e-17
"""Smallest error drawn: a logarithmic axis has no zero, and errors below rounding look alike."""
_DRAWN = 6
"""Models drawn, and legend entries, at most; more curves could not be told apart."""


def draw_errors(figure: Figure, product: FittedModels) -> None:
    """Draw the largest error over the number of terms, one line an uncertain model."""
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_subplot()
    for label, errors in zip(product.labels, product.errors, strict=True):
        count = np.arange(1, errors.size + 1)
        axes.semilogy(count, np.maximum(errors, _FLOOR), marker="o", label=label)
    axes.axhline(product.tolerance, color="#777777", ls=":", label="tolerance")
    axes.set_xlabel("number of terms")
    axes.set_ylabel("largest error, relative to range")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if len(product.errors) <= _DRAWN:
        axes.legend()


def draw_sizes(figure: Figure, product: FittedModels) -> None:
    """Draw the copies of all parameters, one line for each number of standard deviations."""
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_subplot()
    alone = len(product.known) == 1
    along = product.known_values[0] if alone else np.arange(1.0, len(product.models) + 1)
    lines = list(zip((f"{s:g} σ" for s in product.size_sigmas), product.sizes, strict=True))
    lines = lines or [("as declared", product.after.sum(axis=1))]
    for (label, sizes), marker in zip(lines, "osD^v<>" * len(lines), strict=False):
        axes.plot(along, sizes, marker=marker, label=label)
    axes.set_xlabel(product.known[0] if alone else "uncertain model")
    axes.set_ylabel("copies of uncertain parameters")
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


def draw_responses(figure: Figure, product: FittedModels, models: LinearModels) -> None:
    """Draw gains of a few models, and of the uncertain model at their parameters."""
    axes = figure.add_subplot()
    known = np.flatnonzero(np.isfinite(product.response_error))
    chosen = known[np.unique(np.linspace(0, known.size - 1, min(known.size, _DRAWN)).astype(int))]
    omega = frequencies([models.systems[int(k)] for k in chosen])
    colours = list(PALETTE.values())
    for place, k in enumerate(chosen):
        model = product.models[int(product.group[k])]
        lft = to_lft(model)
        values = {
            name: float(models.values[models.parameters.index(name), k])
            for name in model.names
            if name in product.parameters
        }
        system = models.systems[int(k)]
        axes.loglog(
            omega, largest_gains(_drop_closed_channels(system, lft.nominal).response(omega)),
            color=colours[place % len(colours)], lw=3.0, alpha=0.7, label=models.labels[int(k)],
        )  # fmt: skip
        gains = largest_gains(lft.response(omega, values)[0])
        axes.loglog(omega, gains, color="black", ls="--", lw=1.0)
    axes.set_xlabel("frequency (rad/s)")
    axes.set_ylabel("largest singular value")
    axes.legend(fontsize=8)


def _drop_closed_channels(system: LtiSystem, like: LtiSystem) -> LtiSystem:
    """Return the outputs and inputs that no block of the uncertain model closes."""
    if not like.outputs:
        return system
    return system.of(like.outputs, like.inputs)
