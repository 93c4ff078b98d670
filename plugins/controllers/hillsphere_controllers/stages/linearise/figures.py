"""Figures of linear models along a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Integers
from hillsphere.lti import LtiSystem
from hillsphere.presentation import PALETTE
from hillsphere_controllers.stages.linearise.products import LinearisedFlight

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_influence", "draw_poles", "unstable_poles"]

_ON_THE_AXIS = 1e-9
"""Real part, relative to the largest pole, up to which a pole counts as on the imaginary axis: the
rounding of eigenvalues."""


def unstable_poles(system: LtiSystem) -> NDArray[np.bool_]:
    """Return which poles (n,) are to the right of the axis by more than rounding."""
    poles = system.poles
    return np.asarray(poles.real > _ON_THE_AXIS * np.abs(poles).max(initial=0.0))


def draw_poles(figure: Figure, product: LinearisedFlight, nominal: Integers) -> None:
    """Draw eigenvalues over time, and the unknown acceleration below if there is any."""
    unknown = 1e3 * np.sqrt(np.einsum("iiN->iN", product.acceleration_covariance))
    axes = figure.subplots(3 if unknown.any() else 2, 1, sharex=True)
    for i, k in enumerate(nominal):
        poles = product.systems[int(k)].poles
        time = np.full(poles.size, product.t_s[i])
        unstable = unstable_poles(product.systems[int(k)])
        for part, values in zip(axes[:2], (poles.real, poles.imag), strict=True):
            for which, colour, label in (
                (unstable, PALETTE["vermillion"], "unstable"),
                (~unstable, PALETTE["blue"], "stable or on the axis"),
            ):
                part.plot(
                    time[which], 1e3 * values[which], ls="", marker="o", ms=4, color=colour,
                    label=label if i == 0 else None,
                )  # fmt: skip
    axes[0].set_ylabel("real part (1e-3/s)")
    axes[1].set_ylabel("imaginary part\n(1e-3 rad/s)")
    axes[0].legend(fontsize=8, ncol=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    if unknown.any():
        for name, row in zip(product.rates, unknown, strict=True):
            axes[2].plot(product.t_s, row, marker="o", ms=4, label=f"rate of {name}")
        axes[2].set_ylabel("unknown acc.,\none σ (mm/s²)")
        axes[2].legend(fontsize=8)
    axes[-1].set_xlabel("time since the start (s)")


def draw_influence(figure: Figure, product: LinearisedFlight, order: Integers) -> None:
    """Draw the effects of one standard deviation of each parameter, as bars of four measures."""
    # what all names begin with tells nothing
    tables = {name.rpartition(".")[0] for name in product.dispersed}
    short = [name.rpartition(".")[2] if len(tables) == 1 else name for name in product.dispersed]
    place = np.arange(order.size)
    parts = figure.subplots(1, 4, sharey=True)
    for axes, values, label, colour in (
        (parts[0], 100.0 * product.jacobian_share.max(axis=1), "change of A (%)", "blue"),
        (parts[1], 1e3 * product.largest_acceleration, "acceleration\n(mm/s²)", "vermillion"),
        (parts[2], 1e-3 * product.end_deviation_m, "end of the flight\n(km)", "green"),
        (parts[3], 100.0 * product.fit_weight, "share in the\nchanges of A (%)", "purple"),
    ):
        axes.barh(place, values[order], color=PALETTE[colour])
        axes.set_xlabel(label)
    parts[0].set_yticks(place, [short[k] for k in order], fontsize=8)
    parts[0].invert_yaxis()
