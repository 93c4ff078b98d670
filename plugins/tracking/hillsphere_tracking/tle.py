"""Strict reader of two-line element sets (TLE), which refuses truncated and damaged lines.

References
----------
.. [1] F. R. Hoots, R. L. Roehrich (1980), Models for Propagation of NORAD Element Sets, Spacetrack
   Report No. 3 (the format in its appendix).
.. [2] Space-Track.org, Alpha-5 (documentation of element sets for numbers above 99999).
"""

from __future__ import annotations

import re
from calendar import isleap
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from hillsphere.errors import InputError

__all__ = ["FIRST_YEAR", "Checksum", "Tle", "alpha5", "catalogue_number", "full_year", "read_tles"]

Checksum: TypeAlias = Literal["refuse", "warn", "ignore"]
"""What to do about a wrong checksum."""
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
_CATALOGUE = re.compile(r" *\d{1,5}|[A-HJ-NP-Z]\d{4}")
"""Catalogue number, five columns: digits, or from 100000 on "Alpha-5", a letter without I and O in
place of the first two digits [2]_."""
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
FIRST_YEAR = 57
"""Two-digit years from 57 on belong to the 20th century: the first satellite flew in 1957."""


@dataclass(frozen=True)
class Tle:
    """A two-line element set.

    Parameters
    ----------
    name : str
        Name of the satellite; its catalogue number if the set has no title line.
    line1, line2 : str
        The two lines, 69 characters each.
    place : str
        File and line of line 1.
    warnings : tuple of str
        Wrong checksums that were not refused.
    """

    name: str
    line1: str
    line2: str
    place: str = field(default="", compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)


def read_tles(text: str, where: str = "TLE", *, checksum: Checksum = "refuse") -> tuple[Tle, ...]:
    """Read two-line element sets, each with or without a title line above it.

    Parameters
    ----------
    text : str
        One or more sets; blank lines are ignored.
    where : str
        Name of the file, used in error messages.
    checksum : str
        What a wrong checksum is: ``"refuse"``, an error; ``"warn"``, a warning of the set;
        ``"ignore"``, nothing. A wrong checksum mostly means that a digit is wrong.

    Returns
    -------
    tuple of Tle
        In the order of the text.

    Raises
    ------
    InputError
        If a line is missing or truncated, its checksum is wrong, a number is malformed, or the two
        lines belong to different satellites, the epoch is no day of its year, the inclination is
        beyond 180°, or the elements are of another theory than SGP4; the message has a line for
        each fault, which names the line of the file.
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
        doubts: list[str] = []
        torn = [
            *_faults("1", line, f"{where}:{number}", checksum, doubts),
            *_faults("2", line2, f"{where}:{second}", checksum, doubts),
        ]
        if not torn and line[2:7] != line2[2:7]:
            torn.append(
                f"{where}:{second}: line 2 is of satellite {line2[2:7]!r}, line 1 above it of "
                f"{line[2:7]!r}; keep the two lines of one set together"
            )
        # After a line 1 without its line 2 the next set is read from where it begins.
        at += line2.startswith("2 ") or not torn
        if not torn:
            name = title or line[2:7].strip()
            sets.append(Tle(name, line, line2, f"{where}:{number}", tuple(doubts)))
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


def _faults(
    kind: str, line: str, where: str, checksum: Checksum, doubts: list[str]
) -> Iterator[str]:
    """Yield the first fault of a line, if it has one: those behind it would follow from it.

    A wrong checksum that is no fault is added to the doubts, unless it is ignored.
    """
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
    if line[-1] != str(total) and checksum != "ignore":
        fault = (
            f"{where}: the checksum in column {_LENGTH} is {line[-1]!r}, but the line adds up to "
            f"{total}: a character is missing or changed; fetch the set again"
        )
        if checksum == "refuse":
            yield fault
            return
        doubts.append(fault)
    yield from _wrong_values(kind, line, where)


def _wrong_values(kind: str, line: str, where: str) -> Iterator[str]:
    """Yield a fault for each number that the format can hold and an element set cannot have."""
    if not _CATALOGUE.fullmatch(line[2:7]):
        yield (
            f"{where}: columns 3 to 7 must be a catalogue number, five digits or a letter (not I "
            f"or O) and four digits, got {line[2:7]!r}"
        )
    if kind == "2":
        if not 0.0 <= float(line[8:16]) <= 180.0:
            yield (
                f"{where}: columns 9 to 16 (inclination) must be between 0 and 180 degrees, got "
                f"{line[8:16].strip()}"
            )
        return
    if line[62] not in " 02":
        # SGP4 would fly elements of SGP4-XP kilometres away from their orbit.
        xp = " (SGP4-XP)" if line[62] == "4" else ""
        yield (
            f"{where}: column 63 (ephemeris type) must be blank, 0 or 2 for elements that SGP4 can "
            f"propagate, got {line[62]!r}{xp}"
        )
    year = full_year(line[18:20])
    days = 366 if isleap(year) else 365
    if not 1.0 <= float(line[20:32]) < days + 1:
        yield (
            f"{where}: columns 21 to 32 (epoch day) must be from 1 up to {days} for the year "
            f"{year}, got {line[20:32].strip()}"
        )


def full_year(digits: str) -> int:
    """Return the year from 1957 to 2056 that two digits mean."""
    year = int(digits)
    return year + (1900 if year >= FIRST_YEAR else 2000)


def catalogue_number(columns: str) -> int:
    """Return the number in five columns of an element set: ``"25544"``, ``"T0001"`` = 270001."""
    columns = columns.strip()
    if columns[0].isdigit():
        return int(columns)
    return 10_000 * (10 + _LETTERS.index(columns[0])) + int(columns[1:])


def alpha5(number: int) -> str | None:
    """Return the five columns of a catalogue number, None above 339999, the largest one."""
    if number < 100_000:
        return f"{number:05d}"
    first, rest = divmod(number, 10_000)
    return f"{_LETTERS[first - 10]}{rest:04d}" if first < 10 + len(_LETTERS) else None
