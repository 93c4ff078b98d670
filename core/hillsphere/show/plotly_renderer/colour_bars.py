"""Colour bars of a figure of plotly.js: one per scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hillsphere.show.charts import Chart, scales_of
from hillsphere.show.colours import ColourScale
from hillsphere.show.plotly_renderer.builder import Builder, colour_stops
from hillsphere.show.plotly_renderer.layout import Domain

__all__ = ["BAR_PARTS", "add_colour_bars", "own_scales"]

BAR_PARTS = 0.06, 0.2
"""Parts of the width of a figure, and of a narrow one, that the colour bar of a panel takes."""
_SCALE_STEPS = 5
"""Ticks of a colour bar whose scale is not linear."""


def own_scales(chart: Chart) -> dict[ColourScale, int]:
    """Return the colour scales of single panels, if there are several, and the panels' indices."""
    users: dict[ColourScale, list[int]] = {}
    for index, panel in enumerate(chart.panels):
        for scale in scales_of(panel)[:1]:
            users.setdefault(scale, []).append(index)
    if len(users) < 2:
        return {}
    return {scale: panels[0] for scale, panels in users.items() if len(panels) == 1}


def add_colour_bars(
    made: Builder, domains: Sequence[Domain], stacked: Sequence[Domain], narrow: dict[str, Any]
) -> None:
    """Add one colour bar per scale: beside its panel, or of several at the right of the figure."""
    scales = dict.fromkeys(scale for panel in made.chart.panels for scale in scales_of(panel))
    own, count = own_scales(made.chart), 0
    for place, scale in enumerate(scales, 1):
        name = f"coloraxis{place if place > 1 else ''}"
        steps = [i / (_SCALE_STEPS - 1) for i in range(_SCALE_STEPS)]
        width = scale.high - scale.low
        values = [scale.low + width * step ** (1.0 / scale.power) for step in steps]
        text = f"{scale.label} ({scale.unit})" if scale.unit else scale.label
        bar: dict[str, Any] = {
            "title": {"text": text, "side": "right"}, "tickvals": steps,
            "ticktext": [f"{value:.4g}" for value in values], "thickness": 14, "outlinewidth": 0,
        }  # fmt: skip
        axis = {"cmin": 0.0, "cmax": 1.0, "colorscale": colour_stops(scale)}
        if scale in own:
            for layout, places in ((made.layout, domains), (narrow, stacked)):
                layout[name] = axis | {"colorbar": bar | _beside(places[own[scale]])}
        else:
            made.layout[name] = axis | {"colorbar": bar | {"x": 1.0 + 0.12 * count}}
            count += 1
        # A trace without points carries the bar.
        made.traces.append(
            {
                "type": "scatter3d" if made.subplot.startswith("scene") else "scatter",
                "x": [None], "y": [None], "mode": "markers", "showlegend": False,
                "hoverinfo": "skip", "marker": {"color": [0.0], "coloraxis": name},
                **({"z": [None], "scene": made.subplot}
                   if made.subplot.startswith("scene") else {}),
            }
        )  # fmt: skip


def _beside(domain: Domain) -> dict[str, Any]:
    """Return the place of a colour bar at the right of a panel."""
    (_, right), (low, high) = domain
    return {"x": right, "xanchor": "left", "y": 0.5 * (low + high), "len": high - low, "ypad": 0}
