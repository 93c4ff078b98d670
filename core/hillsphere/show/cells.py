"""Cells of tables: numbers, words, and numbers as a paper prints them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from html import escape
from typing import Any, TypeAlias

__all__ = ["CELL_TYPES", "Cell", "Printed", "render_cell", "render_grid"]

_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)

Cell: TypeAlias = float | int | str | bool | None
"""Content of one cell of a table; ``None`` leaves it blank."""
CELL_TYPES = (float, int, str, type(None))
"""Its types, of which int has the truth values; a tuple, since campaigns have a million cells."""


class Printed(float):
    """A number as printed in a paper: its value and its number of digits.

    It is a float. In a table it belongs in a ``*_paper`` column beside the computed one; the report
    marks whether the two agree to the printed digit.

    Parameters
    ----------
    text : str
        The number as printed, e.g. ``"7.10"``; a typographic minus is understood.

    Raises
    ------
    ValueError
        If it is not a finite decimal number.
    """

    text: str

    def __new__(cls, text: str) -> Printed:
        """Parse the printed text."""
        plain = text.strip().replace("\u2212", "-")
        if not _DECIMAL.fullmatch(plain):
            raise ValueError(f"not a decimal number: {text!r}")
        made = super().__new__(cls, plain)
        if not math.isfinite(made):
            raise ValueError(f"too large: {text!r}")
        made.text = plain
        return made

    def __reduce__(self) -> tuple[type[Printed], tuple[str]]:
        return Printed, (self.text,)

    @property
    def last_digit(self) -> float:
        """One unit of the last printed digit: 0.01 of ``"7.10"``."""
        return float(f"1e{self._exponent}")

    @property
    def _exponent(self) -> int:
        mantissa, _, exponent = self.text.lower().partition("e")
        return int(exponent or 0) - len(mantissa.partition(".")[2])

    def difference(self, value: float) -> float:
        """Return value − printed in units of the last printed digit."""
        # Scaled in decimal: in binary 39.45 − 39.4 is 0.0500…04, half a unit and a bit.
        return float((Decimal(repr(float(value))) - Decimal(self.text)).scaleb(-self._exponent))

    def agrees(self, value: float) -> bool:
        """Whether the value, rounded to the printed digit, is the printed number."""
        return math.isfinite(value) and abs(self.difference(value)) <= 0.5


def render_cell(value: Any, digits: int) -> str:
    """Return the HTML of one value with so many significant digits; a dash for a missing one."""
    if hasattr(value, "dtype"):
        value = value.item()
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Printed):
        return escape(value.text)
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:.{digits}g}".replace("-", "−")
    return escape(str(value))


def render_grid(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of cells that are HTML already; the headings are text."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
