"""Entries of CCSDS messages: keywords in their order, and numbers in other units of length.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 7 (syntax).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from decimal import Decimal
from math import inf, isfinite
from typing import NamedTuple

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean

__all__ = [
    "KEYWORD_LINE", "LINE_ENDS", "VERSION_KEYWORD", "Entry", "Leniency", "order_entries",
    "read_scaled", "split_unit", "write_scaled",
]  # fmt: skip

KEYWORD_LINE = re.compile(r"([A-Za-z][A-Za-z0-9_]*)\s*=\s*(.*)")
"""A line of text (KVN) with a keyword and its value."""
LINE_ENDS = re.compile(r"\r\n|\n|\r")
"""Ends of lines, of any system."""
VERSION_KEYWORD = re.compile(r"CCSDS_[A-Z]+_VERS")
"""The keyword with which a message begins."""

_WITH_UNIT = re.compile(r"(.*?\S)\s*\[([^\[\]]*)\]")
"""A value before its unit. What begins with a bracket is a value: a list of units."""
_REAL = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+))(?:[eE]([+-]?0*\d{1,4}))?", re.ASCII)


class Entry(NamedTuple):
    """One keyword of a message, with its value, its unit ("" if none is given) and its place."""

    place: str
    key: str
    value: str
    unit: str = ""


def split_unit(value: str) -> tuple[str, str]:
    """Return the number and the unit of ``"7000 [km]"``; the unit is "" if none follows."""
    match = _WITH_UNIT.fullmatch(value)
    return (match[1], match[2]) if match else (value, "")


class Leniency:
    """What a reader does about harmless departures from a standard.

    Parameters
    ----------
    strict : bool
        Whether they are errors.
    warn : callable, optional
        Called with each message if they are none; by default a Python warning is given.
    """

    def __init__(self, strict: bool = True, warn: Callable[[str], object] | None = None) -> None:
        self.strict = strict
        self.warnings: list[str] = []
        self._warn = warn
        self._kinds: set[str] = set()

    @classmethod
    def collecting(cls, lenient: bool) -> Leniency:
        """Return a reader's leniency that gives no Python warning: its result holds all."""
        return cls(not lenient, warn=lambda message: None)

    def tolerate(self, message: str, kind: str = "") -> None:
        """Record a departure, once, and tell of it.

        Parameters
        ----------
        message : str
            ``"file:line: what is wrong"``.
        kind : str
            Of departures of the same kind only the first is recorded; by default each message is
            its own kind.

        Raises
        ------
        InputError
            If the reader is strict.
        """
        if self.strict:
            raise InputError(message)
        kind = kind or message
        if kind in self._kinds:
            return
        self._kinds.add(kind)
        self.warnings.append(message)
        if self._warn is None:
            warnings.warn(message, stacklevel=2)
        else:
            self._warn(message)


def order_entries(
    entries: Sequence[Entry],
    known: Sequence[str],
    required: Sequence[str],
    what: str,
    end: str,
    leniency: Leniency | None = None,
    dispensable: Sequence[str] = (),
) -> dict[str, Entry]:
    """Return the entries of a block by keyword, if they are those that it may have, in order.

    Parameters
    ----------
    entries : sequence of Entry
        As they stand in the message.
    known : sequence of str
        Keywords of the block, in the order that the standard prescribes.
    required : sequence of str
        Those that the block must have.
    what : str
        Name of the block, used in error messages.
    end : str
        Where the block ends: the place of what is missing.
    leniency : Leniency, optional
        Whether unknown keywords, which are then left out, and another order are tolerated; by
        default neither is.
    dispensable : sequence of str
        Required keywords whose absence is tolerated likewise.

    Returns
    -------
    dict of str to Entry
        In the order of the message.

    Raises
    ------
    InputError
        If a keyword is unknown, doubled, out of order, missing or without value.
    """
    leniency = leniency or Leniency()
    rank = {key: number for number, key in enumerate(known)}
    ordered: dict[str, Entry] = {}
    last = ""
    for entry in entries:
        place, key = entry.place, entry.key
        if key not in rank:
            hint = did_you_mean(key, known, otherwise="keywords")
            leniency.tolerate(f"{place}: {what} has no keyword {key[:60]!r}{hint}")
            continue
        if key in ordered:
            raise InputError(f"{place}: {key} occurs twice in {what}; keep one")
        if last and rank[key] < rank[last]:
            leniency.tolerate(f"{place}: {key} must stand before {last} in {what}")
        if not entry.value:
            raise InputError(f"{place}: {key} has no value; expected one after it")
        ordered[key] = entry
        last = key
    if missing := [key for key in required if key not in ordered]:
        report = leniency if set(missing) <= set(dispensable) else Leniency()
        report.tolerate(f"{end}: {what} lacks {', '.join(missing)}, which it must have")
    return ordered


def read_scaled(text: str, power: int) -> float:
    """Return a number times a power of ten, rounded once; infinity if it is no finite number.

    A product ``1e3 * float(text)`` would be rounded twice, and the digits of a message would not
    come back.
    """
    match = _REAL.fullmatch(text)
    value = float(f"{match[1]}e{int(match[2] or 0) + power}") if match else inf
    return value if isfinite(value) else inf


def write_scaled(value: float, power: int) -> str:
    """Return the shortest text that `read_scaled` turns into a number."""
    shifted = Decimal(repr(float(value))).scaleb(-power)
    # 'f' keeps common magnitudes without an exponent, as most readers of messages expect
    plain = shifted.is_zero() or -7 <= shifted.adjusted() <= 15
    return f"{shifted:f}" if plain else f"{shifted:e}"
