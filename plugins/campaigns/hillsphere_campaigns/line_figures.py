"""Figure of the single cases of a sweep over time, before the bands of a campaign."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.cases.case_classes import decided_failures, is_undecided
from hillsphere.presentation import Axis, Chart, Curve, Dash, Panel
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands, Lines, LinesToEnds
from hillsphere.show.charts import even_indices
from hillsphere.show.history import time_unit
from hillsphere_campaigns.band_figures import MOST_PANELS, band_marks
from hillsphere_campaigns.figures import MOST_STEPS, grid_chart, quantity_axis

__all__ = ["MOST_LINES", "line_chart"]

MOST_LINES = 1000
"""Cases of which lines are drawn at most."""
_MOST_SAMPLES = 20_000
"""Samples of all lines of a panel at most, which keeps the page of a run below a few megabytes."""
_THIN, _FAINT = 0.9, 0.75
"""Width, points, and opacity of the lines, so that crossing lines and bands behind stay visible."""


def line_chart(table: CaseTable, lines: Lines, bands: Bands | None) -> Chart:
    """Return every case over time, a panel for each of the first quantities.

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
    longest = max(float(one.time_s[-1]) for one in (lines, bands) if one is not None)
    unit, scale = time_unit(longest)
    panels = []
    for quantity, name in enumerate(lines.names[:count]):
        behind = bands is not None and name in bands.names
        marks = band_marks(bands, bands.names.index(name), scale) if bands and behind else []
        axis = quantity_axis(name, lines.units[quantity])
        marks += _curves(table, lines, quantity, scale)
        panels.append(Panel(Axis("time", unit), axis, marks))
    has_points = table.points is not None and table.points.shape[1] > 1
    return grid_chart("Cases over time", panels, caption, "sweep_failures" if has_points else "")


def _curves(table: CaseTable, lines: Lines, quantity: int, scale: float) -> list[Curve]:
    """Return the lines of the cases of each kind as one curve with gaps; a row is a point."""
    places = np.searchsorted(table.case, lines.case)
    failed = decided_failures(table)[places]
    undecided = is_undecided(table.status)[places]
    made = []
    kinds: tuple[tuple[str, str, Dash], ...] = (
        ("case", "black", "solid"),
        ("failed case", "vermillion", "dashed"),
        ("undecided case", "orange", "dotted"),
    )
    groups = (~failed & ~undecided, failed, undecided)
    for (name, colour, dash), which in zip(kinds, groups, strict=True):
        some = np.flatnonzero(which).tolist()
        if not some:
            continue
        each = [_history(lines, quantity, k) for k in some]
        x, y = (np.concatenate(parts) for parts in zip(*each, strict=True))
        point = np.repeat(table.point[places[some]], [time.size for time, _ in each])
        made.append(Curve(x / scale, y, name, colour, dash, _THIN, _FAINT, rows=point.tolist()))
    return made


def _history(lines: Lines, quantity: int, k: int) -> tuple[Array, Array]:
    """Return times (K,) and values (K,) of one line to its end, and a gap."""
    time_s, values = lines.time_s, lines.values[quantity, :, k]
    if isinstance(lines, LinesToEnds) and np.isfinite(lines.end_s[k]):
        before = time_s < lines.end_s[k]
        time_s = np.append(time_s[before], lines.end_s[k])
        values = np.append(values[before], lines.end_values[quantity, k])
    at = even_indices(time_s.size, min(MOST_STEPS, _MOST_SAMPLES // lines.case.size))
    return np.append(time_s[at], np.nan), np.append(values[at], np.nan)
