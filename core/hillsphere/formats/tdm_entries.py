"""Tracking Data Messages taken apart into entries: text (KVN) and XML, line by line.

XML is converted to the entries of the text form: ``META_START``, ``DATA_STOP``, a time before each
number.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 4 (KVN) and 5 (XML).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.formats.ccsds_entries import Entry
from hillsphere.formats.ccsds_xml import XmlWalk

__all__ = ["MARKS", "MESSAGE_END", "VERSION", "TdmElements", "entries_of", "entry_of_line"]

VERSION = "CCSDS_TDM_VERS"
"""Keyword with which a message begins."""
MESSAGE_END = "</tdm>"
"""Key of the entry with which a message in XML ends; further ones may follow it."""
MARKS = ("META_START", "META_STOP", "DATA_START", "DATA_STOP")
"""Lines that begin and end blocks."""

_LINE = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*)")
_LONGEST = 4096
"""Characters of a line at most. The standard allows 254, which a list of all DATA_TYPES exceeds."""
_CHILDREN = {
    "": ("ndm", "tdm"),
    "tdm": ("header", "body"),
    "body": ("segment",),
    "segment": ("metadata", "data"),
    "data": ("observation",),
}
"""Elements that hold elements; the others of a message hold one value each."""
_LEAVES = ("header", "metadata", "observation")
_MARK_OF = {"metadata": "META", "data": "DATA"}


def entry_of_line(line: str, place: str) -> Entry:
    """Return the entry of a line of text.

    Parameters
    ----------
    line : str
        The line, without blanks round it, not empty.
    place : str
        Its ``"file:line"``.

    Returns
    -------
    Entry
        With the key ``"COMMENT"``, one of `MARKS` or a keyword; with the key ``""`` and the line
        as its value if it is none of these.
    """
    if line in MARKS:
        return Entry(place, line, "")
    if line == "COMMENT" or line.startswith(("COMMENT ", "COMMENT\t")):
        return Entry(place, "COMMENT", line[8:].rstrip())
    match = _LINE.fullmatch(line) if len(line) <= _LONGEST else None
    if match is None:
        return Entry(place, "", line)
    return Entry(place, match[1], match[2])


def entries_of(lines: Iterable[str], where: str) -> Iterator[Entry]:
    """Yield the entries of a message while its lines arrive.

    Parameters
    ----------
    lines : iterable of str
        The message, as text or XML.
    where : str
        Name of the file, used in messages.

    Yields
    ------
    Entry
        In order, as `entry_of_line` returns them.

    Raises
    ------
    InputError
        If XML is not well-formed or has other elements than such a message; the message names file
        and line.
    """
    elements: TdmElements | None = None
    walk: XmlWalk | None = None
    begun = False
    for number, raw in enumerate(lines, start=1):
        text = raw.removeprefix("\ufeff") if number == 1 else raw
        line = text.strip()
        if not begun and line:
            begun = True
            if line.startswith("<"):
                elements = TdmElements()
                walk = XmlWalk(where, elements.start, elements.end, number - 1)
                text = text.lstrip()
        if walk is not None and elements is not None:
            walk.feed(text if text.endswith(("\n", "\r")) else text + "\n")
            yield from elements.take()
        elif line:
            yield entry_of_line(line, f"{where}:{number}")
    if walk is not None and elements is not None:
        walk.feed("", True)
        yield from elements.take()


class TdmElements:
    """Collector of the elements of one message, or of those in a combined one (``<ndm>``).

    Its `start` and `end` are the callbacks of `hillsphere.formats.ccsds_xml`, so that another
    reader of combined messages can pass on to it what stands in a ``<tdm>``.
    """

    def __init__(self) -> None:
        self._open: list[tuple[str, str]] = []  # place, name
        self._foreign = 0
        self._complete: list[Entry] = []
        self._epoch = self._unit = ""
        self._observed: list[Entry] = []
        self._header = ""

    def take(self) -> list[Entry]:
        """Return the entries that are complete since the last call."""
        entries, self._complete = self._complete, []
        return entries

    def start(self, place: str, name: str, attributes: dict[str, str]) -> None:
        """Take a start tag.

        Raises
        ------
        InputError
            If the element does not belong where it stands.
        """
        parent = self._open[-1][1] if self._open else ""
        if self._foreign or (parent == "ndm" and name != "tdm"):
            self._foreign += 1  # another message of a combined one, or its header
            return
        if parent in _CHILDREN:
            if name not in (*_CHILDREN[parent], "COMMENT") or (name == "COMMENT" and not parent):
                within = f"<{parent}>" if parent else "a tracking data message"
                hint = did_you_mean(name, _CHILDREN[parent], otherwise="expected")
                raise InputError(f"{place}: {within} has no element {name[:60]!r}{hint}")
            self._begin(place, name, attributes)
        elif parent not in _LEAVES and parent != "ndm":
            raise InputError(
                f"{self._open[-1][0]}: {parent[:60]!r} must hold a value, not further elements"
            )
        elif parent == "ndm":
            self._begin(place, name, attributes)
        elif name in (*_CHILDREN, *_LEAVES):
            raise InputError(f"{place}: <{parent}> has no element {name!r}; close <{parent}> first")
        self._unit = attributes.get("units", "")
        if self._unit and parent != "observation":
            raise InputError(f"{place}: {name[:60]} has no attribute units; remove it")
        self._open.append((place, name))

    def _begin(self, place: str, name: str, attributes: dict[str, str]) -> None:
        if name == "tdm":
            key = attributes.get("id", "")
            if key != VERSION:
                raise InputError(f'{place}: <tdm> must have id="{VERSION}", got {key[:40]!r}')
            self._complete.append(Entry(place, VERSION, attributes.get("version", "")))
            self._header = ""
        elif name in ("header", "body"):
            expected = "header" if not self._header else "body"
            if name != expected or self._header == "body":
                raise InputError(f"{place}: a <tdm> has one <header>, then one <body>")
            self._header = name
        elif name in _MARK_OF:
            self._complete.append(Entry(place, f"{_MARK_OF[name]}_START", ""))
        elif name == "observation":
            self._epoch, self._observed = "", []

    def end(self, name: str, text: str) -> None:
        """Take an end tag and the text directly within its element.

        Raises
        ------
        InputError
            If an element of elements has a text, or an observation not one time and one number.
        """
        if self._foreign:
            self._foreign -= 1
            return
        place, _ = self._open.pop()
        parent = self._open[-1][1] if self._open else ""
        if name in _CHILDREN or name in ("ndm", *_LEAVES):
            if text:
                raise InputError(f"{place}: <{name}> holds elements, got the text {text[:40]!r}")
            if name in _MARK_OF:
                self._complete.append(Entry(place, f"{_MARK_OF[name]}_STOP", ""))
            elif name == "tdm":
                self._complete.append(Entry(place, MESSAGE_END, ""))
            elif name == "observation":
                self._observe(place)
        elif parent != "observation" or name == "COMMENT":
            self._complete.append(Entry(place, name, text))
        elif name == "EPOCH" and not self._epoch and not self._observed:
            self._epoch = text
        else:
            self._observed.append(Entry(place, name, text, self._unit))

    def _observe(self, place: str) -> None:
        if not self._epoch or len(self._observed) != 1:
            keys = ", ".join(entry.key[:40] for entry in self._observed[:5]) or "nothing"
            raise InputError(
                f"{place}: an <observation> has one EPOCH, then one number; got "
                f"{'EPOCH and ' if self._epoch else ''}{keys}"
            )
        (one,) = self._observed
        self._complete.append(one._replace(value=f"{self._epoch} {one.value}"))
