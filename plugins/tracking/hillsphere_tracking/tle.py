"""Strict reader of two-line element sets (TLE), which refuses truncated and damaged lines.

References
----------
.. [1] F. R. Hoots, R. L. Roehrich (1980), Models for Propagation of NORAD Element Sets, Spacetrack
   Report No. 3 (the format in its appendix).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from hillsphere.errors import InputError

__all__ = ["Tle", "read_tles"]

_LENGTH = 69
"""Characters of a line of an element set, the checksum in the last column [1]_."""
_MOST_FAULTS = 20
"""Faults in one message at most: more lines are torn for one reason."""
_REMEDY = "copy the whole line, blanks included"
# columns (from 0) of the fields that must be plain numbers, by line
_NUMBERS = {
    "1": {"epoch year": (18, 20), "epoch day": (20, 32), "first derivative": (33, 43)},
    "2": {
        "inclination": (8, 16),
        "node": (17, 25),
        "eccentricity": (26, 33),
        "argument of perigee": (34, 42),
        "mean anomaly": (43, 51),
        "mean motion": (52, 63),
    },
}
_POWERS = {"second derivative": (44, 52), "drag term": (53, 61)}
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)\s*")
_POWER = re.compile(r"\s*[+-]?\d{1,5}[+-]\d\s*")


@dataclass(frozen=True)
class Tle:
    """A two-line element set.

    Parameters
    ----------
    name : str
        Name of the satellite; its catalogue number if the set has no title line.
    line1, line2 : str
        The two lines, 69 characters each, with correct checksums.
    """

    name: str
    line1: str
    line2: str


def read_tles(text: str, where: str = "TLE") -> tuple[Tle, ...]:
    """Read two-line element sets, each with or without a title line above it.

    Parameters
    ----------
    text : str
        One or more sets; blank lines are ignored.
    where : str
        Name of the file, used in error messages.

    Returns
    -------
    tuple of Tle
        In the order of the text.

    Raises
    ------
    InputError
        If a line is missing or truncated, its checksum is wrong, a number is malformed, or the two
        lines belong to different satellites; the message has a line for each fault, which names
        the line of the file.
    """
    lines = [
        (number, line.rstrip())
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip()
    ]
    sets: list[Tle] = []
    faults: list[str] = []
    title = ""
    at = 0
    while at < len(lines):
        number, line = lines[at]
        at += 1
        if not line.startswith("1 ") or len(line) < _LENGTH - 1:
            if title:
                faults.append(
                    f"{where}:{number}: expected line 1 of the element set {title[:40]!r}, which "
                    f"begins with '1 ' and is {_LENGTH} characters long, got {line[:40]!r}; "
                    f"{_REMEDY}"
                )
                title = ""
                continue
            # "0 NAME" is a title too, in the three-line form
            title = line.removeprefix("0 ").strip()
            continue
        if at == len(lines):
            faults.append(f"{where}:{number}: line 2 is missing after this line; {_REMEDY}")
            title = ""
            break
        second, line2 = lines[at]
        torn = [
            *_faults("1", line, f"{where}:{number}"),
            *_faults("2", line2, f"{where}:{second}"),
        ]
        if not torn and line[2:7] != line2[2:7]:
            torn.append(
                f"{where}:{second}: line 2 is of satellite {line2[2:7]!r}, line 1 above it of "
                f"{line[2:7]!r}; keep the two lines of one set together"
            )
        # After a line 1 without its line 2 the next set is read from where it begins.
        at += line2.startswith("2 ") or not torn
        if not torn:
            sets.append(Tle(title or line[2:7].strip(), line, line2))
        faults += torn
        title = ""
    if title:
        faults.append(
            f"{where}:{lines[-1][0]}: no element set after {title[:40]!r}; a line 1 begins with "
            f"'1 ' and is {_LENGTH} characters long; {_REMEDY}"
        )
    if len(faults) > _MOST_FAULTS:
        more = len(faults) - _MOST_FAULTS
        faults[_MOST_FAULTS:] = [f"{where}: {more} more lines are torn; fetch the file again"]
    if faults:
        raise InputError("\n".join(faults))
    if not sets:
        raise InputError(f"{where}: the file contains no two-line element set")
    return tuple(sets)


def _faults(kind: str, line: str, where: str) -> Iterator[str]:
    """Yield the first fault of a line, if it has one: those behind it would follow from it."""
    if not line.startswith(kind + " "):
        yield (
            f"{where}: expected line {kind}, which begins with {kind + ' '!r}, got {line[:40]!r}; "
            f"{_REMEDY}"
        )
        return
    if len(line) != _LENGTH or not line.isascii():
        yield f"{where}: line {kind} must be {_LENGTH} plain characters, got {len(line)}; {_REMEDY}"
        return
    fields = {name: (place, _NUMBER) for name, place in _NUMBERS[kind].items()}
    if kind == "1":
        fields |= {name: (place, _POWER) for name, place in _POWERS.items()}
    for name, ((begin, end), form) in fields.items():
        if not form.fullmatch(line[begin:end]):
            yield (
                f"{where}: columns {begin + 1} to {end} ({name}) must be a number, got "
                f"{line[begin:end]!r}; {_REMEDY}"
            )
            return
    total = sum(int(c) if c.isdigit() else c == "-" for c in line[:-1]) % 10
    if line[-1] != str(total):
        yield (
            f"{where}: the checksum in column {_LENGTH} is {line[-1]!r}, but the line adds up to "
            f"{total}: a character is missing or changed; fetch the set again"
        )
