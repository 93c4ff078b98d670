"""Figures of a fitted orbit: residuals over time, and the filter beside the fit."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.presentation import Axis, Chart, Curve, Mark, Panel, Points
from hillsphere_estimators.orbit_fit.products import OrbitFit

__all__ = ["filter_chart", "residual_chart"]

_MOST_PANELS = 12
"""Panels of the chart of residuals; the table lists all rows."""


def residual_chart(product: OrbitFit) -> Chart:
    """Return the residuals of each row over time, in their standard deviations."""
    rows, panels = product.rows, []
    t = rows.t_s / HOUR_S
    first = float(t.min())
    for number, label in enumerate(rows.labels[:_MOST_PANELS]):
        own = rows.row == number
        kept, out = own & (rows.used > 0.0), own & (rows.used == 0.0)
        marks: list[Mark] = [
            Points(t[kept] - first, np.clip(rows.normal[kept], -_SHOWN, _SHOWN), "used", "blue")
        ]
        if out.any():
            marks.append(
                Points(
                    t[out] - first, np.clip(rows.normal[out], -_SHOWN, _SHOWN), "left out",
                    "vermillion",
                )
            )  # fmt: skip
        panels.append(
            Panel(Axis("since the first value", "h"), Axis("residual", "σ"), marks, label)
        )
    return Chart(
        "Residuals of the fit", panels,
        "Measured less expected values in the standard deviations that they should have; those "
        f"beyond {_SHOWN:g} are drawn at {_SHOWN:g}.",
        share_x=True, shared_legend=True, size_in=(8.0, 1.0 + 1.9 * len(panels)),
        table="fit_residuals",
    )  # fmt: skip


_SHOWN = 10.0
"""Largest residual that is drawn at its place, in standard deviations."""


def filter_chart(product: OrbitFit) -> Chart:
    """Return the filter's standard deviation of the position, and its distance from the fit."""
    run = product.filter
    t = (run.t_s - run.t_s[0]) / HOUR_S
    marks: list[Mark] = [
        Curve(t, np.maximum(run.position_off_m, 1e-6), "distance from the fit", "blue"),
        Curve(t, run.position_sigma_m, "standard deviation", "vermillion", "dashed"),
    ]
    return Chart(
        "The filter beside the fit",
        [Panel(Axis("since the first value", "h"), Axis("position", "m", "log"), marks)],
        "Distance of the filter's position from that of the fit, which has used all data, and the "
        "filter's standard deviation.",
        size_in=(8.0, 4.0),
    )  # fmt: skip
