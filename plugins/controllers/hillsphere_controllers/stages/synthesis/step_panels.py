"""Panels of step responses: one for each response, or, where they are many, one for each step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Axis, Chart, Curve, Mark, Panel, Rule

__all__ = ["step_chart"]

_LARGEST_GRID = 4
"""Up to so many measurements, each response has a panel of its own."""
_PANELS = 15
"""Steps drawn at most: five rows of three panels fill a page."""
_COLUMNS = 3
"""Panels in a row: axis labels of narrower panels overlap."""
_SAMPLES = 100
"""Samples of a response drawn in grey, about: it shows only how far an output moves."""
_TIME = Axis("time", "s")

Lines = Sequence[tuple[Array, str, str, int]]
"""Responses (K, q, q) of a loop, of all outputs to a step of each command; colour, label, row."""


def step_chart(times_s: Array, lines: Lines, names: Sequence[str], table: str) -> Chart:
    """Return the responses of all measured outputs to steps of their commands.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Samples.
    lines : sequence of (ndarray, str, str, int)
        For each loop its responses, shape (K, q, q), colour, label and row of the table.
    names : sequence of str
        Measurements.
    table : str
        Table of the loops.

    Returns
    -------
    Chart
        Up to four measurements: a panel for each response. More: a panel for each step, with the
        commanded output in colour, all others in grey, and the name of the one that moves most; of
        more than fifteen steps those with the largest responses.
    """
    count = len(names)
    caption = (
        "Responses of the plant's outputs to a step of each command in turn, in the units of the "
        "measurements"
    )
    if count <= _LARGEST_GRID:
        panels = _each_response(times_s, lines, names)
        caption += "."
        columns, size = count, (7.0, 4.5 if count <= 2 else 1.6 * count + 0.6)
    else:
        panels = _each_step(times_s, lines, names)
        caption += "; outputs not commanded are grey."
        columns, size = _COLUMNS, (8.0, 2.2 * -(-len(panels) // _COLUMNS) + 0.8)
    if len(panels) < count:
        caption += f" {len(panels)} of {count} steps, those with the largest responses."
    return Chart(
        "Step responses", panels, caption, columns=columns, share_x=True,
        share_y=count <= _LARGEST_GRID, size_in=size, table=table,
    )  # fmt: skip


def _each_response(times_s: Array, lines: Lines, names: Sequence[str]) -> list[Panel]:
    """Return a grid of panels: each measurement's response to a step of each command."""
    return [
        Panel(
            _TIME, Axis(f"of {output}"),
            [
                *(Curve(times_s, response[:, i, j], label, colour, width=1.2, rows=row)
                  for response, colour, label, row in lines),
                Rule("y", float(i == j)),
            ],
            f"step of {command}" if i == 0 else "",
            legend="best" if i == j == 0 else "none",
        )
        for i, output in enumerate(names)
        for j, command in enumerate(names)
    ]  # fmt: skip


def _each_step(times_s: Array, lines: Lines, names: Sequence[str]) -> list[Panel]:
    """Return a panel for each step: the commanded output in colour, all other outputs in grey."""
    size = np.max([np.abs(line[0]).max(axis=0) for line in lines], axis=0, initial=0.0)
    shown = sorted(np.argsort(-size.max(axis=0), kind="stable")[:_PANELS].tolist())
    panels: list[Panel] = []
    for j in shown:
        others = [i for i in range(len(names)) if i != j]
        marks: list[Mark] = [_greys(times_s, response[:, others, j]) for response, *_ in lines]
        marks += [
            Curve(times_s, response[:, j, j], label, colour, rows=row)
            for response, colour, label, row in lines
        ]
        most = max(others, key=lambda i: size[i, j])
        title = f"step of {names[j]}\nlargest other: {names[most]}, {size[most, j]:.2g}"
        panels.append(
            Panel(_TIME, Axis("response"), [*marks, Rule("y", 1.0)], title,
                  legend="none" if panels else "best")
        )  # fmt: skip
    return panels


def _greys(times_s: Array, responses: Array) -> Curve:
    """Return all responses (K, n) as one curve with gaps."""
    stride = max(1, times_s.size // _SAMPLES)
    x = np.append(times_s[::stride], np.nan)
    y = np.vstack([responses[::stride], np.full(responses.shape[1], np.nan)])
    return Curve(np.tile(x, y.shape[1]), y.T.ravel(), "", "light", width=0.6)
