"""Panels of step responses: one for each response, or, where they are many, one for each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.interfaces import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["LARGEST_GRID", "draw_each_response", "draw_each_step", "step_figure_size"]

LARGEST_GRID = 4
"""Up to so many measurements, each response has a panel of its own."""

_PANELS = 15
"""Steps drawn at most: five rows of three panels fill a page."""
_COLUMNS = 3
"""Panels in a row: axis labels of narrower panels overlap."""
_TARGET = "#555555"
_OTHERS = "#aaaaaa"

Lines = Sequence[tuple[Array, str, str]]
"""Responses (K, q, q) of a loop, of all outputs to a step of each command, colour and label."""


def step_figure_size(measurements: int) -> tuple[float, float]:
    """Return the size in inches of the figure for a number of measurements."""
    if measurements <= LARGEST_GRID:
        return (7.0, 4.5 if measurements <= 2 else 1.6 * measurements + 0.6)
    rows = -(-min(measurements, _PANELS) // _COLUMNS)
    return (8.0, 2.2 * rows + 0.8)


def draw_each_response(figure: Figure, times_s: Array, lines: Lines, names: Sequence[str]) -> None:
    """Draw a grid of panels: each measurement's response to a step of each command."""
    q = len(names)
    grid = figure.subplots(q, q, squeeze=False, sharex=True, sharey=True)
    for i in range(q):
        for j in range(q):
            axes = grid[i, j]
            for response, colour, label in lines:
                axes.plot(times_s, response[:, i, j], color=colour, lw=1.2, label=label)
            axes.axhline(float(i == j), color=_TARGET, ls=":", lw=1.0)
            if j == 0:
                axes.set_ylabel(f"of {names[i]}")
            if i == 0:
                axes.set_title(f"step of {names[j]}", fontsize=9)
            if i == q - 1:
                axes.set_xlabel("time (s)")
    if any(label for _, _, label in lines):
        grid[0, 0].legend(fontsize=8)


def draw_each_step(figure: Figure, times_s: Array, lines: Lines, names: Sequence[str]) -> None:
    """Draw a panel for each step: the commanded output in colour, all other outputs in grey.

    The other measurement that moves most is named. Of more than fifteen steps the panels show
    those with the largest responses.
    """
    q = len(names)
    size = np.max([np.abs(response).max(axis=0) for response, _, _ in lines], axis=0, initial=0.0)
    shown = sorted(np.argsort(-size.max(axis=0), kind="stable")[:_PANELS].tolist())
    rows = -(-len(shown) // _COLUMNS)
    grid = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True)
    for axes, j in zip(grid.flat, shown, strict=False):
        others = [i for i in range(q) if i != j]
        for response, _, _ in lines:
            axes.plot(times_s, response[:, others, j], color=_OTHERS, lw=0.6, zorder=1)
        for response, colour, label in lines:
            axes.plot(times_s, response[:, j, j], color=colour, lw=1.4, label=label, zorder=2)
        axes.axhline(1.0, color=_TARGET, ls=":", lw=1.0)
        most = max(others, key=lambda i: size[i, j])
        axes.set_title(
            f"step of {names[j]}\nlargest other: {names[most]}, {size[most, j]:.2g}", fontsize=8
        )
        axes.tick_params(labelsize=8)
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for column in range(min(_COLUMNS, len(shown))):
        below = (len(shown) - 1 - column) // _COLUMNS
        grid[below, column].set_xlabel("time (s)")
        grid[below, column].tick_params(labelbottom=True)
    for row in grid:
        row[0].set_ylabel("response")
    if len(shown) < q:
        figure.suptitle(f"{len(shown)} of {q} steps, those with the largest responses", fontsize=9)
    if any(label for _, _, label in lines):
        grid[0, 0].legend(fontsize=7)
