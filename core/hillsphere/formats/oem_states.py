"""States of an Orbit Ephemeris Message that are parsed as a whole, not line by line.

A million states take a few seconds so. What is not uniform is left to the caller, who reads line by
line and names the line of a fault. Values are the same to the last bit.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S
from hillsphere.base.time import Epoch

__all__ = ["parse_states"]

_AT_ONCE = 20_000
"""Lines that are taken apart at once: some megabytes of words."""
_TEXT = re.compile(r"[0-9TZ:+\-. \t\neE]*")
_TAIL = re.compile(r"(\.\d{1,12})?Z?", re.ASCII)
_SEPARATORS = ((4, "-"), (7, "-"), (10, "T"), (13, ":"), (16, ":"))
_FIELDS = ((0, 4), (5, 7), (8, 10), (11, 13), (14, 16), (17, 19))
"""Characters of year, month, day, hour, minute and whole seconds."""
_EXPONENT = 4
"""Digits of an exponent, without zeros before them: more are no number of any message."""
_HEAD = 19
"""Characters of ``2027-01-01T00:00:00``."""


def parse_states(
    lines: Sequence[str], width: int, scale: str, base: Epoch
) -> tuple[Array, Array, int] | None:
    """Parse lines of a calendar date and numbers in km and km/s.

    Parameters
    ----------
    lines : sequence of str
        The lines, stripped.
    width : int
        Numbers of each.
    scale : str
        Time scale of the dates.
    base : Epoch
        From which times count; in TAI where the scale is UTC.

    Returns
    -------
    times : ndarray, shape (K,)
        Seconds after `base`.
    rows : ndarray, shape (width, K)
        Numbers, each a thousand times that of the line, rounded once.
    decimals : int
        Most decimals of a date, without zeros at its end.
    None
        Instead of all, if a line has another form, or a date is none or within a leap second.
    """
    times, rows, tails = np.empty(len(lines)), np.empty((len(lines), width)), set[str]()
    for first in range(0, len(lines), _AT_ONCE):
        part = lines[first : first + _AT_ONCE]
        if not _TEXT.fullmatch("\n".join(part)):
            return None
        words = [line.split() for line in part]
        if any(len(row) != width + 1 for row in words):
            return None
        dates = [row[0] for row in words]
        tails.update(date[_HEAD:] for date in dates)
        instants = _seconds(dates, scale, base)
        if instants is None:
            return None
        times[first : first + len(part)] = instants
        try:
            values = [_thousandfold(word) for row in words for word in row[1:]]
        except ValueError:
            return None
        rows[first : first + len(part)] = np.array(values).reshape(-1, width)
    if not (np.isfinite(rows).all() and all(map(_TAIL.fullmatch, tails))):
        return None
    decimals = max((len(tail.rstrip("Z").rstrip("0").lstrip(".")) for tail in tails), default=0)
    return times, rows.T, decimals


def _thousandfold(word: str) -> float:
    if "E" in word or "e" in word:
        number, _, power = word.replace("E", "e").partition("e")
        if len(power.lstrip("+-").lstrip("0")) > _EXPONENT:
            raise ValueError(power)  # as `ccsds_entries.read_scaled` refuses it
        return float(f"{number}e{int(power) + 3}")
    return float(word + "e3")


def _seconds(dates: list[str], scale: str, base: Epoch) -> Array | None:
    """Return what `Epoch.parse` and `Epoch.seconds_since` give for each date, if all are plain."""
    if min(map(len, dates)) < _HEAD:
        return None
    text = "".join(date[:_HEAD] for date in dates).encode("ascii")
    characters = np.frombuffer(text, dtype=np.uint8).reshape(-1, _HEAD)
    if any((characters[:, place] != ord(sign)).any() for place, sign in _SEPARATORS):
        return None
    fields = []
    for begin, end in _FIELDS:
        digits = characters[:, begin:end].astype(np.int64) - ord("0")
        if (digits < 0).any() or (digits > 9).any():
            return None
        fields.append(digits @ 10 ** np.arange(end - begin)[::-1])
    year, month, day, hour, minute, second = fields
    if (hour > 23).any() or (minute > 59).any() or (second > 59).any():
        return None
    try:
        exact = np.array([float(date[17:].removesuffix("Z")) for date in dates])
        with warnings.catch_warnings():
            # a date beyond the last leap second announced is "dubious", not wrong
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            pair = erfa.dtf2d(scale, year, month, day, hour, minute, exact)
            if scale == "UTC":
                pair = erfa.tttai(*erfa.taitt(*erfa.utctai(*pair)))
    except (ValueError, erfa.ErfaError):
        return None
    return np.asarray(((pair[0] - base.day) + (pair[1] - base.fraction)) * DAY_S)
