"""Colours of figures: a palette for kinds, and sequential scales for values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["LINE_COLOURS", "NEUTRAL", "PALETTE", "SCHEMES", "ColourScale", "hex_colour"]

PALETTE: Mapping[str, str] = {
    "blue": "#0072B2",
    "vermillion": "#D55E00",
    "green": "#009E73",
    "purple": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "black": "#000000",
    "yellow": "#F0E442",
}
"""Colours that survive colour-blindness (Okabe and Ito, 2008).

Name a colour where it carries a meaning.
"""
LINE_COLOURS = tuple(name for name in PALETTE if name != "yellow")
"""Names of the colours in the order in which marks without a colour take them; yellow is too light
for a line."""
NEUTRAL: Mapping[str, str] = {
    "ink": "#444444", "grey": "#777777", "body": "#999999", "light": "#BBBBBB",
}  # fmt: skip
"""Greys for texts, limits, bodies and backgrounds."""

SCHEMES: Mapping[str, tuple[str, ...]] = {
    "viridis": (
        "#440154", "#472D7B", "#3B528B", "#2C728E", "#21918C", "#28AE80", "#5EC962", "#ADDC30",
        "#FDE725",
    ),
    "diverging": ("#0072B2", "#7FB8D8", "#F2F2F2", "#EAAE7F", "#D55E00"),
}  # fmt: skip
"""Sequential colours from the lowest to the highest value: viridis (van der Walt and Smith, CC0) at
nine equal steps, and blue to vermillion for values about zero."""


@dataclass(frozen=True)
class ColourScale:
    """A scale that gives values a colour; a figure shows it as a colour bar.

    Parameters
    ----------
    label : str
        Quantity.
    unit : str
        Its unit, ``""`` for none.
    low, high : float
        Values at the ends.
    scheme : str
        A key of `SCHEMES`.
    power : float
        Exponent of the relative value: 0.5 separates small values.
    reversed : bool
        Give the low end the colours of the high one.
    """

    label: str
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    scheme: Literal["viridis", "diverging"] = "viridis"
    power: float = 1.0
    reversed: bool = False

    def fraction(self, value: float) -> float:
        """Return the place of a value on the scale, from 0 to 1."""
        width = self.high - self.low
        part = (value - self.low) / width if width > 0.0 else 0.5
        return float(min(max(part, 0.0), 1.0) ** self.power)

    def colour(self, value: float) -> str:
        """Return the colour of a value, ``"#rrggbb"``; grey for NaN."""
        if math.isnan(value):
            return NEUTRAL["light"]
        stops = self.stops
        place = self.fraction(value) * (len(stops) - 1)
        index = min(int(place), len(stops) - 2)
        return _mix(stops[index], stops[index + 1], place - index)

    @property
    def stops(self) -> tuple[str, ...]:
        """Colours at equal steps of the fraction, from low to high."""
        stops = SCHEMES[self.scheme]
        return stops[::-1] if self.reversed else stops


def hex_colour(name: str) -> str:
    """Return a colour as ``"#rrggbb"``: of the palette, a grey, or given so."""
    return PALETTE.get(name) or NEUTRAL.get(name) or name


def _mix(first: str, second: str, part: float) -> str:
    channels = (
        round((1.0 - part) * int(first[i : i + 2], 16) + part * int(second[i : i + 2], 16))
        for i in (1, 3, 5)
    )
    return "#" + "".join(f"{channel:02X}" for channel in channels)
