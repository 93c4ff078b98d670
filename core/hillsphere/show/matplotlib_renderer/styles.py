"""Lines, markers and colours of charts as matplotlib names them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

from hillsphere.show.colours import hex_colour

__all__ = ["DASHES", "MARKERS", "Colours", "legend_label", "named_colour"]

DASHES = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}
MARKERS = {
    "": "", "dot": ".", "circle": "o", "square": "s", "diamond": "D", "triangle": "^",
    "triangle-down": "v", "cross": "x", "plus": "+", "star": "*", "bar": "|",
}  # fmt: skip
Colours: TypeAlias = Iterator[str]


def named_colour(name: str, colours: Colours) -> str:
    """Return a colour by its name, the next of the panel's for none."""
    return hex_colour(name or next(colours))


def legend_label(text: str) -> str | None:
    """Return a label for matplotlib, which takes None for no entry."""
    return text or None
