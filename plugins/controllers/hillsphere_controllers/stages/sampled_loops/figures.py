"""Figure of the spectral radius of loops over the sampling period."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import LINE_COLOURS, Axis, Chart, Curve, Mark, Panel, Points, Rule
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops

__all__ = ["radius_chart"]

_TOP = 3.0
"""Largest spectral radius drawn: growth by three per sample is lost control, and larger values
would flatten the curve around the limit of one."""


def radius_chart(product: SampledLoops, table: str) -> Chart:
    """Return the radius for every controller, with the limit and where it is met.

    The rows of `table` are controllers, each at all periods.
    """
    marks: list[Mark] = []
    for k, (name, radius) in enumerate(zip(product.controllers, product.radius, strict=True)):
        if np.isnan(radius).all():
            continue
        colour, lost_s = LINE_COLOURS[k % len(LINE_COLOURS)], float(product.lost_s[k])
        row = k * product.period_s.size
        label = f"{name}: lost at {lost_s:.4g} s" if np.isfinite(lost_s) else name
        marks.append(Curve(product.looked_s, np.minimum(radius, _TOP), label, colour, rows=row))
        if np.isfinite(lost_s):
            marks.append(Points([lost_s], [1.0], "", colour, rows=row))
    low, high = float(np.nanmin(product.radius)), float(np.nanmax(product.radius))
    return Chart(
        "Spectral radius over the sampling period",
        [Panel(
            Axis("time between samples", "s", scale="log"),
            Axis("largest spectral radius", low=min(0.9, low), high=min(_TOP, high + 0.1)),
            [*marks, Rule("y", 1.0)],
        )],
        "Of the monodromy over one period, the largest of all models; a loop is stable below one.",
        table=table,
    )  # fmt: skip
