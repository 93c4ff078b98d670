"""Figures of the largest offsets that orbits survive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.survival import Fate

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_edges", "draw_probabilities"]

_FATES = ((Fate.ESCAPE, "blue", "o"), (Fate.IMPACT, "vermillion", "s"),
          (Fate.UNRESOLVED, "purple", "x"))  # fmt: skip
_MARKS = (("o", "blue"), ("s", "vermillion"), ("^", "green"), ("D", "purple"), ("v", "orange"),
          ("P", "sky"))  # fmt: skip


def draw_edges(figure: Figure, product: NonlinearStability) -> None:
    """Draw the first losses of every orbit, position offsets beside velocity offsets."""
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_side(left, product, velocity=False, factor=1.0, sigma=product.sigma_position_m)
    _draw_side(right, product, velocity=True, factor=100.0, sigma=product.sigma_velocity_m_s)
    left.set_xlabel("position offset (m)")
    right.set_xlabel("velocity offset (cm/s)")
    rows = np.arange(len(product.labels))
    left.set_yticks(rows, product.labels)
    left.set_ylim(rows[-1] + 0.6, -0.6)
    handles: dict[str, Artist] = {}
    for axes in (left, right):
        handles |= {str(h.get_label()): h for h in axes.get_legend_handles_labels()[0]}
    figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=5,
                  fontsize=8)  # fmt: skip


def _draw_side(
    axes: Axes, product: NonlinearStability, velocity: bool, factor: float, sigma: float
) -> None:
    own = np.flatnonzero(product.direction[3:].any(axis=0) == velocity)
    lost, survived = product.lost[:, own] * factor, product.survived[:, own] * factor
    fates = product.lost_fate[:, own]
    row = np.broadcast_to(np.arange(lost.shape[0])[:, None], lost.shape)
    # a radius of zero has no place on a logarithmic axis: it is written at its left end
    bears = survived > 0.0
    for fate, colour, mark in _FATES:
        chosen = np.isfinite(lost) & bears & (fates == fate)
        if chosen.any():
            axes.plot(lost[chosen], row[chosen], mark, color=PALETTE[colour], ms=4, alpha=0.8,
                      ls="none", label=f"first loss: {fate.text}")  # fmt: skip
    free = np.isinf(lost)
    if free.any():
        axes.plot(survived[free], row[free], ">", color="#888888", ms=4, ls="none",
                  label="not lost so far")  # fmt: skip
    weakest = product.weakest(velocity)
    radius = factor * product.survived[np.arange(weakest.size), weakest]
    good = radius > 0.0
    if good.any():
        axes.plot(radius[good], np.flatnonzero(good), "|", color=PALETTE["black"], ms=13, mew=2,
                  ls="none", label="stability radius")  # fmt: skip
    axes.set_xscale("log")
    if not good.any():
        largest = factor * float(np.max(product.largest[:, own]))
        axes.set_xlim(1e-3 * largest, largest)
    for i in np.flatnonzero(~good):
        axes.annotate("0", (0.0, i), xycoords=("axes fraction", "data"), xytext=(3, 0),
                      textcoords="offset points", va="center", fontsize=8)  # fmt: skip
    if sigma > 0.0:
        axes.axvline(factor * sigma, color="#444444", ls="--", lw=1.0, label="σ at injection")


def draw_probabilities(figure: Figure, product: NonlinearStability) -> None:
    """Draw the survival probability of every orbit and phase with its interval."""
    axes = figure.add_subplot()
    phases = product.phases.size
    rows = np.arange(len(product.labels), dtype=float)
    for k, phase in enumerate(product.phases):
        share = product.counts[Fate.SURVIVES, :, k] / product.draws
        mark, colour = _MARKS[k % len(_MARKS)]
        shift = 0.5 * ((k + 0.5) / phases - 0.5)
        axes.errorbar(share, rows + shift,
                      xerr=[share - product.low[:, k], product.high[:, k] - share],
                      fmt=mark, color=PALETTE[colour], ms=4, lw=1.2, capsize=2,
                      label=f"injected at phase {phase:g}")  # fmt: skip
    axes.set_yticks(rows, product.labels)
    axes.set_ylim(rows[-1] + 0.6, -0.6)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xlabel("survival probability")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
