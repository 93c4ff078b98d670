"""Figures of the largest offsets that orbits survive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Mark,
    MarkerShape,
    Note,
    Panel,
    Points,
    Rule,
    Segments,
)
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.survival import Fate
from hillsphere_orbits.scenes import MARKERS, name_axis

__all__ = ["edge_chart", "probability_chart"]

_FATES: tuple[tuple[Fate, str, MarkerShape], ...] = (
    (Fate.ESCAPE, "blue", "circle"), (Fate.IMPACT, "vermillion", "square"),
    (Fate.UNRESOLVED, "purple", "cross"),
)  # fmt: skip
_WIDEST = 1e-3
"""Of the largest offset: low end of the axis where nothing is lost at any place on it."""
_MARGIN = 1.5
"""Factor by which the logarithmic axis goes beyond the outermost marks."""


def edge_chart(product: NonlinearStability, table: str) -> Chart:
    """Return the first losses of every orbit, by position and velocity; `table` lists them."""
    days = product.duration_s / DAY_S
    return Chart(
        "Largest offsets that the orbits survive",
        [
            _edge_panel(product, False, Axis("position offset", "m", "log"), 1.0),
            _edge_panel(product, True, Axis("velocity offset", "cm/s", "log"), 100.0),
        ],
        f"First losses by direction within {days:g} days; an open triangle: not lost at the "
        "largest offset tried. Dashed: one standard deviation of the injection error.",
        columns=2, share_y=True, shared_legend=True,
        size_in=(9.0, 1.8 + 0.32 * max(4, len(product.labels))), table=table,
    )  # fmt: skip


def _edge_panel(product: NonlinearStability, velocity: bool, x: Axis, factor: float) -> Panel:
    own = np.flatnonzero(product.direction[3:].any(axis=0) == velocity)
    lost, survived = product.lost[:, own] * factor, product.survived[:, own] * factor
    orbit = np.broadcast_to(np.arange(lost.shape[0])[:, None], lost.shape)
    rows = orbit * len(product.directions) + own
    weakest, orbits = product.weakest(velocity), np.arange(lost.shape[0])
    radius = factor * product.survived[orbits, weakest]
    # A radius of zero has no place on a logarithmic axis: it is written at its left end.
    is_shown = radius > 0.0
    marks: list[Mark] = []
    for fate, colour, marker in _FATES:
        chosen = np.isfinite(lost) & (survived > 0.0) & (product.lost_fate[:, own] == fate)
        if chosen.any():
            marks.append(Points(lost[chosen], orbit[chosen], f"first loss: {fate.text}", colour,
                                marker, 4.0, opacity=0.8, rows=rows[chosen].tolist()))  # fmt: skip
    if (free := np.isinf(lost)).any():
        marks.append(Points(survived[free], orbit[free], "not lost so far", "grey", "triangle",
                            is_filled=False, rows=rows[free].tolist()))  # fmt: skip
    if is_shown.any():
        marks.append(
            Points(radius[is_shown], orbits[is_shown], "stability radius", "black", "bar", 12.0,
                   rows=(orbits * len(product.directions) + weakest)[is_shown].tolist())
        )  # fmt: skip
        seen = np.concatenate([lost[np.isfinite(lost) & (survived > 0.0)], radius[is_shown]])
        low, high = seen.min() / _MARGIN, max(seen.max(), survived.max()) * _MARGIN
    else:
        high = factor * float(np.max(product.largest[:, own]))
        low = _WIDEST * high
    sigma = product.sigma_velocity_m_s if velocity else product.sigma_position_m
    if sigma > 0.0:
        marks.append(Rule("x", factor * sigma, "σ at injection", "ink", "dashed"))
        low = min(low, factor * sigma / _MARGIN)
    marks += [Note("0", 1.1 * low, float(i), "centre") for i in orbits[~is_shown]]
    return Panel(replace(x, low=low, high=high), name_axis(product.labels), marks)


def probability_chart(product: NonlinearStability, table: str) -> Chart:
    """Return the survival probability of every orbit and phase; `table` lists them."""
    phases, orbits = product.phases.size, np.arange(len(product.labels))
    marks: list[Mark] = []
    for k, phase in enumerate(product.phases):
        share = product.counts[Fate.SURVIVES, :, k] / product.draws
        place, colour = (
            orbits + 0.5 * ((k + 0.5) / phases - 0.5),
            LINE_COLOURS[k % len(LINE_COLOURS)],
        )
        rows = (orbits * phases + k).tolist()
        marks += [
            Segments(place, product.low[:, k], product.high[:, k], "x", "", colour, 1.2,
                     has_caps=True, rows=rows),
            Points(share, place, f"injected at phase {phase:g}", colour,
                   MARKERS[k % len(MARKERS)], 4.0, rows=rows),
        ]  # fmt: skip
    return Chart(
        f"Survival over {product.duration_s / DAY_S:g} days",
        [Panel(Axis("survival probability", low=-0.02, high=1.02), name_axis(product.labels), marks,
               legend="right")],
        f"Share of {product.draws} draws that survive, with {100 * product.confidence:g} % "
        "intervals.",
        size_in=(8.0, 1.8 + 0.32 * max(4, len(product.labels))), table=table,
    )  # fmt: skip
