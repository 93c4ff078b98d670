"""Figures of the reference trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Cloud,
    Curve,
    Dash,
    Panel,
    Path,
    Solid,
    Space,
    Surface,
)
from hillsphere.show.spaces import with_room
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories

__all__ = ["descent_chart", "difference_chart", "history_chart"]

_LINES: tuple[Dash, ...] = ("solid", "dashed", "dotted", "dashdot")
_NAMED = 16
"""Descents that the legend names at most: more names would take more room than the figure."""
_LEVEL, _ASIDE = 25.0, 65.0
"""Where the view is from, degrees: above, and from the line through most of the starts."""


def descent_chart(product: ReferenceTrajectories, table: str) -> Chart:
    """Return the paths over the body; `table` lists the descents."""
    r, hours = product.flights.x[:3] / 1e3, product.flights.t_s / 3600.0
    solids: list[Solid] = []
    # behind the paths a solid body would hide what lies beyond it
    if product.surface_m is not None:
        solids.append(Surface(product.surface_m / 1e3, product.body, "light", 0.35))
    ends = []
    for i in range(len(product.flights.labels)):
        known = np.isfinite(r[:, :, i]).all(axis=0)
        style = _style(product, i)
        if style["label"]:
            style["label"] += f" ({product.dv_m_s[i]:.2f} m/s)"
        solids.append(Path(r[:, known, i], times=hours[known, i], **style))
        ends.append(r[:, known, i][:, -1])
    rows = range(len(ends))
    solids += [
        Cloud(r[:, 0], "starts", "black", size=3.0, rows=rows),
        Cloud(np.transpose(ends), "ends", "black", "diamond", 3.0, rows=rows),
    ]
    return Chart(
        "Reference trajectories",
        [with_room(Space(solids, azimuth_deg=_along(r[:2, 0]) + _ASIDE, elevation_deg=_LEVEL,
                         time=Axis("time", "h")))],
        "In the frame of the motion, with ΔV.", shared_legend=True,
        size_in=(8.0, 7.0), table=table,
    )  # fmt: skip


def history_chart(product: ReferenceTrajectories, table: str) -> Chart:
    """Return heights and sizes of the commands; `table` lists the descents."""
    known = bool(np.isfinite(product.height_m).any())
    x = product.flights.x[: len(product.command)]
    height = product.height_m if known else np.linalg.norm(x, axis=0)
    size = 1e3 * np.linalg.norm(product.command, axis=0)
    height_axis = Axis("height" if known else "distance", "km")
    return Chart(
        "Reference trajectories over time",
        [_over_time(product, height / 1e3, height_axis),
         _over_time(product, size, Axis("command", "mm/s²"))],
        "Height above the surface along the radius, and the size of the command as planned.",
        share_x=True, shared_legend=True, size_in=(8.0, 6.0), table=table,
    )  # fmt: skip


def difference_chart(product: ReferenceTrajectories, table: str) -> Chart:
    """Return by how much other plants accelerate otherwise along the paths."""
    panels = [
        _over_time(
            product, 1e3 * sizes,
            Axis("difference", "mm/s²", "log" if np.nanmin(sizes) > 0.0 else "linear"),
            name.replace("_", " "), first=c * sizes.shape[1],
        )
        for c, (name, sizes) in enumerate(
            zip(product.compared, product.difference_m_s2, strict=True)
        )
    ]  # fmt: skip
    return Chart(
        "Accelerations by other plants", panels,
        "Size of the difference from the plant's own acceleration along each path, without a "
        "command.",
        share_x=True, shared_legend=True, size_in=(8.0, 1.0 + 2.6 * len(panels)), table=table,
    )  # fmt: skip


def _over_time(
    product: ReferenceTrajectories, values: Array, axis: Axis, title: str = "", first: int = 0
) -> Panel:
    """Return values (times, descents) over time; `first` is the row of the first descent."""
    hours = product.flights.t_s / 3600.0
    marks = [
        Curve(hours[:, i], values[:, i], **_style(product, i) | {"rows": first + i})
        for i in range(hours.shape[1])
    ]
    return Panel(Axis("time", "h"), axis, marks, title)


def _style(product: ReferenceTrajectories, i: int) -> dict[str, Any]:
    """Return a colour for each descent, a line for each start; of very many few are named."""
    names = list(dict.fromkeys(product.descents))
    label, of = product.flights.labels[i], product.descents[i]
    start = product.descents[:i].count(of)
    return {
        "label": label if i < _NAMED else "",
        "colour": LINE_COLOURS[names.index(of) % len(LINE_COLOURS)],
        "dash": _LINES[start % len(_LINES)],
        "rows": i,
    }


def _along(starts: Array) -> float:
    """Return the azimuth of the line through the origin nearest to points (2, N), degrees."""
    way = np.linalg.svd(starts, full_matrices=False)[0][:, 0]
    return float(np.degrees(np.arctan2(way[1], way[0])))
