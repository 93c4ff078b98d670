"""Figure of the spectral radius of loops over the sampling period."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_radius"]

_TOP = 3.0
"""Largest spectral radius drawn: growth by three per sample is lost control, and larger values
would flatten the curve around the limit of one."""


def draw_radius(figure: Figure, product: SampledLoops) -> None:
    """Draw it for every controller, with the limit and where it is met."""
    axes = figure.subplots()
    colours = [colour for name, colour in PALETTE.items() if name != "yellow"]
    for k, (name, radius) in enumerate(zip(product.controllers, product.radius, strict=True)):
        if np.isnan(radius).all():
            continue
        colour, lost = colours[k % len(colours)], float(product.lost_s[k])
        label = name if not np.isfinite(lost) else f"{name}: lost at {lost:.4g} s"
        axes.semilogx(product.looked_s, np.minimum(radius, _TOP), color=colour, label=label)
        if np.isfinite(lost):
            axes.plot([lost], [1.0], "o", color=colour, ms=5)
    axes.axhline(1.0, color="#777777", ls=":", lw=1.2)
    low, high = float(np.nanmin(product.radius)), float(np.nanmax(product.radius))
    axes.set_ylim(min(0.9, low), min(_TOP, high + 0.1))
    axes.set_xlabel("time between samples (s)")
    axes.set_ylabel("largest spectral radius")
    axes.legend(fontsize=8)
