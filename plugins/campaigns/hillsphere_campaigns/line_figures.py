"""Figure of the single cases of a sweep over time, before the bands of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.cases.case_classes import decided_failures, is_undecided
from hillsphere.presentation import PALETTE, Figure
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands, Lines, LinesToEnds
from hillsphere.show.history import time_unit
from hillsphere_campaigns.band_figures import MOST_PANELS, draw_bands
from hillsphere_campaigns.figures import axis_label, grid_of, grid_size, legend_below

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["MOST_LINES", "line_figure"]

MOST_LINES = 1000
"""Cases of which lines are drawn at most."""
_THIN, _FAINT = 0.9, 0.75
"""Width, points, and opacity of the lines, so that crossing lines and bands behind stay visible."""


def line_figure(table: CaseTable, lines: Lines, bands: Bands | None) -> Figure:
    """Return a figure of every case over time, a panel for each of the first quantities.

    Parameters
    ----------
    table : CaseTable
        The sweep.
    lines : Lines
        Its histories.
    bands : Bands or None
        Of a campaign that is drawn behind.
    """
    total = len(lines.names)
    count = min(total, MOST_PANELS)
    caption = "Each line is a case, at times after its first sample and to its end."
    if bands is not None:
        caption += " Behind: the bands of the campaign with random cases."
    if count < total:
        caption += f" The first {count} of {total} quantities."
    return Figure(
        "Cases over time",
        lambda figure: _draw(figure, table, lines, bands, count),
        caption,
        grid_size(count),
    )


def _draw(figure: Canvas, table: CaseTable, lines: Lines, bands: Bands | None, count: int) -> None:
    places = np.searchsorted(table.case, lines.case)
    failed = decided_failures(table)[places]
    undecided = is_undecided(table.status)[places]
    longest = float(lines.time_s[-1])
    if bands is not None:
        longest = max(longest, float(bands.time_s[-1]))
    unit, scale = time_unit(longest)
    for quantity, axes in enumerate(grid_of(figure, count)):
        name = lines.names[quantity]
        if bands is not None and name in bands.names:
            draw_bands(axes, bands, bands.names.index(name), scale)
        _panel(axes, lines, quantity, failed, undecided, scale)
        axes.set_xlabel(f"time ({unit})")
        axes.set_ylabel(axis_label(name, lines.units[quantity]))
    legend_below(figure)


def _panel(
    axes: Axes, lines: Lines, quantity: int, failed: NDArray[np.bool_],
    undecided: NDArray[np.bool_], scale: float,
) -> None:  # fmt: skip
    kinds = (
        ("case", ~failed & ~undecided, "black", "-"),
        ("failed case", failed, "vermillion", "--"),
        ("undecided case", undecided, "orange", ":"),
    )
    for name, which, colour, style in kinds:
        for place, k in enumerate(np.flatnonzero(which).tolist()):
            time_s, values = _course(lines, quantity, k)
            axes.plot(
                time_s / scale, values, style, color=PALETTE[colour],
                lw=_THIN, alpha=_FAINT, label=name if place == 0 else None,
            )  # fmt: skip


def _course(lines: Lines, quantity: int, k: int) -> tuple[Array, Array]:
    """Return times (K,) and values (K,) of one line, to its end."""
    time_s, values = lines.time_s, lines.values[quantity, :, k]
    if not isinstance(lines, LinesToEnds) or not np.isfinite(lines.end_s[k]):
        return time_s, values
    before = time_s < lines.end_s[k]
    return np.append(time_s[before], lines.end_s[k]), np.append(
        values[before], lines.end_values[quantity, k]
    )
