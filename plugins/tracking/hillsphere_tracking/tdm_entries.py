"""Parser of Tracking Data Messages (KVN or XML) into entries of keyword, value and line number.

XML is converted to the entries of the plain text form: ``META_START``, ``DATA_STOP``, a time before
each number.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple
from xml.parsers import expat

from hillsphere.base.errors import InputError

__all__ = ["Entry", "entries"]

_LINE = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*?)")
_MARKS = ("META_START", "META_STOP", "DATA_START", "DATA_STOP")
_LONGEST = 1000
"""Characters of a line at most; the standard allows 254."""
_MARK_OF = {"metadata": "META", "data": "DATA"}
_CONTAINERS = ("ndm", "tdm", "header", "body", "segment", "observation", *_MARK_OF)
_UNITS = {
    "ANGLE_1": "deg", "ANGLE_2": "deg", "DOPPLER_INSTANTANEOUS": "km/s",
    "DOPPLER_INTEGRATED": "km/s",
}  # fmt: skip


class Entry(NamedTuple):
    """One keyword and its value; `place` is ``"file:line"``."""

    place: str
    key: str
    value: str


def entries(lines: Iterable[str], where: str) -> Iterator[Entry]:
    """Yield the entries of a message while its lines arrive.

    Parameters
    ----------
    lines : iterable of str
        The message, in the plain text form or XML.
    where : str
        Name of the file, used in error messages.

    Yields
    ------
    Entry
        Entries in order, without comments.

    Raises
    ------
    InputError
        If a line is neither valid KVN nor valid XML; the message names file and line.
    """
    xml: _XmlEntries | None = None
    begun = False
    for number, raw in enumerate(lines, start=1):
        line = raw.removeprefix("\ufeff").strip() if number == 1 else raw.strip()
        place = f"{where}:{number}"
        if not begun and line:
            begun = True
            if line.startswith("<"):
                xml = _XmlEntries(where, number)
        if xml is not None:
            yield from xml.feed(raw.removeprefix("\ufeff"))
        elif line in _MARKS:
            yield Entry(place, line, "")
        elif line and line.split(maxsplit=1)[0] != "COMMENT":
            match = _LINE.fullmatch(line) if len(line) <= _LONGEST else None
            if match is None:
                raise InputError(f"{place}: expected KEYWORD = value, got {line[:40]!r}")
            yield Entry(place, match.group(1), match.group(2))
    if xml is not None:
        yield from xml.feed(None)


class _XmlEntries:
    """Incremental parser of a message in XML."""

    def __init__(self, where: str, first_line: int) -> None:
        self._where, self._offset = where, first_line - 1
        self._complete: list[Entry] = []
        self._epoch = self._text = ""
        self._open: list[str] = []
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.StartDoctypeDeclHandler = self._doctype

    @property
    def _place(self) -> str:
        return f"{self._where}:{self._parser.CurrentLineNumber + self._offset}"

    def feed(self, line: str | None) -> list[Entry]:
        """Parse a line, or None at the end of the input; return the entries that it completes."""
        try:
            if line is None:
                self._parser.Parse("", True)
            else:
                self._parser.Parse(line if line.endswith("\n") else line + "\n", False)
        except expat.ExpatError as error:
            raise InputError(
                f"{self._where}:{error.lineno + self._offset}: not well-formed XML: "
                f"{expat.errors.messages[error.code]}"
            ) from error
        entries, self._complete = self._complete, []
        return entries

    def _doctype(self, *_: object) -> None:
        # Entities could make a small file huge; no message of this standard needs them.
        raise InputError(
            f"{self._place}: a tracking data message must not contain a DOCTYPE; remove it"
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        name = name.rpartition(":")[2]  # schemas may give the root a prefix
        self._open.append(name)
        self._text = ""
        if name == "tdm":
            self._complete.append(
                Entry(self._place, attributes.get("id", ""), attributes.get("version", ""))
            )
        elif name in _MARK_OF:
            self._complete.append(Entry(self._place, f"{_MARK_OF[name]}_START", ""))
        unit = attributes.get("units", "").lower()
        if unit and unit != _UNITS.get(name, unit):
            raise InputError(f"{self._place}: {name} must be in {_UNITS[name]}, got {unit!r}")

    def _characters(self, text: str) -> None:
        self._text += text

    def _end(self, _: str) -> None:
        name = self._open.pop()
        text, self._text = self._text.strip(), ""
        if name in _MARK_OF:
            self._complete.append(Entry(self._place, f"{_MARK_OF[name]}_STOP", ""))
        elif name == "EPOCH":
            self._epoch = text
        elif name not in _CONTAINERS and name != "COMMENT":
            within = self._open[-1] if self._open else ""
            value = f"{self._epoch} {text}" if within == "observation" else text
            self._complete.append(Entry(self._place, name, value))
