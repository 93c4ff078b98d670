"""Figures of linear models along a trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Integers
from hillsphere.lti import LtiSystem
from hillsphere.presentation import LINE_COLOURS, Axis, Bars, Chart, Curve, Panel, Points
from hillsphere_controllers.stages.linearise.products import LinearisedFlight

__all__ = ["influence_chart", "pole_chart", "unstable_poles"]

_ON_THE_AXIS = 1e-9
"""Real part, relative to the largest pole, up to which a pole counts as on the imaginary axis: the
rounding of eigenvalues."""


def unstable_poles(system: LtiSystem) -> NDArray[np.bool_]:
    """Return which poles (n,) are to the right of the axis by more than rounding."""
    poles = system.poles
    return np.asarray(poles.real > _ON_THE_AXIS * np.abs(poles).max(initial=0.0))


def pole_chart(product: LinearisedFlight, nominal: Integers, table: str) -> Chart:
    """Return eigenvalues over time, and the unknown acceleration below if there is any.

    The rows of `table` are the points of the flight.
    """
    systems = [product.systems[k] for k in nominal.tolist()]
    poles = 1e3 * np.concatenate([system.poles for system in systems])
    is_unstable = np.concatenate([unstable_poles(system) for system in systems])
    rows = np.repeat(np.arange(len(systems)), [system.order for system in systems])
    time = Axis("time since the start", "s")
    kinds = (
        (is_unstable, "unstable", "vermillion"),
        (~is_unstable, "stable or on the axis", "blue"),
    )
    panels = [
        Panel(
            time, axis,
            [
                Points(product.t_s[rows[which]], values[which], label, colour,
                       rows=rows[which].tolist())
                for which, label, colour in kinds
            ],
        )
        for values, axis in (
            (poles.real, Axis("real part", "1e-3/s")),
            (poles.imag, Axis("imaginary part", "1e-3 rad/s")),
        )
    ]  # fmt: skip
    unknown = 1e3 * np.sqrt(np.einsum("iiN->iN", product.acceleration_covariance))
    if unknown.any():
        curves = [
            Curve(product.t_s, row, f"rate of {name}", LINE_COLOURS[2 + k % 5], marker="circle",
                  rows=range(product.t_s.size))
            for k, (name, row) in enumerate(zip(product.rates, unknown, strict=True))
        ]  # fmt: skip
        panels.append(Panel(time, Axis("unknown acc.,\none σ", "mm/s²"), curves))
    return Chart(
        f"Poles along {product.flight}",
        panels,
        "Real and imaginary parts of the eigenvalues of A at the points, all parameters nominal; "
        "below, the standard deviation of the unknown acceleration.",
        share_x=True,
        shared_legend=True,
        table=table,
    )


def influence_chart(product: LinearisedFlight, order: Integers, table: str) -> Chart:
    """Return the effects of one standard deviation of each parameter, as bars of four measures.

    The rows of `table` are the parameters in this order.
    """
    # A table that all names begin with tells nothing.
    tables = {name.rpartition(".")[0] for name in product.dispersed}
    short = [name.rpartition(".")[2] if len(tables) == 1 else name for name in product.dispersed]
    rows = range(order.size)
    names = Axis(ticks=[(k, short[i]) for k, i in enumerate(order.tolist())], is_reversed=True)
    return Chart(
        f"What one standard deviation of each parameter does to {product.flight}",
        [
            Panel(axis, names, [Bars(rows, values[order], "x", colour=colour, rows=rows)])
            for axis, values, colour in (
                (Axis("change of A", "%"), 100.0 * product.jacobian_share.max(axis=1), "blue"),
                (Axis("acceleration", "mm/s²"), 1e3 * product.largest_acceleration, "vermillion"),
                (Axis("end of the flight", "km"), 1e-3 * product.end_deviation_m, "green"),
                (Axis("share in the\nchanges of A", "%"), 100.0 * product.fit_weight, "purple"),
            )
        ],
        "Change of A relative to A, of the acceleration at most along the trajectory, of the "
        "place where the flight ends under its own command; share in the changes of A.",
        columns=4,
        share_y=True,
        size_in=(7.0, 4.5),
        table=table,
    )
