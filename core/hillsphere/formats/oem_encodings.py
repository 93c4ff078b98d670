"""The two encodings of Orbit Ephemeris Messages, text (KVN) and XML, taken apart into entries.

Both give the same blocks; what their keywords and values may be is checked in `oem_reading`.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 5 (OEM) and 8 (XML).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.formats.ccsds_entries import KEYWORD_LINE, LINE_ENDS, VERSION_KEYWORD, Entry
from hillsphere.formats.ccsds_xml import walk_xml

__all__ = [
    "ACCELERATION",
    "COVARIANCE",
    "STATE",
    "Block",
    "Message",
    "SegmentBlocks",
    "read_state_line",
    "take_apart",
]

STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
"""Components of a state, in km and km/s."""
ACCELERATION = ("X_DDOT", "Y_DDOT", "Z_DDOT")
"""Components of an acceleration, in km/s²."""
COVARIANCE = tuple(
    tuple(f"C{row}_{column}" for column in STATE[: number + 1]) for number, row in enumerate(STATE)
)
"""Rows of the lower triangle of a covariance."""

_MARKS = {
    "META_START": ("header", "data"),
    "META_STOP": ("metadata",),
    "COVARIANCE_START": ("data",),
    "COVARIANCE_STOP": ("covariance",),
}
"""Lines that begin and end blocks, and the blocks within which each may stand."""
_ENDS = {"metadata": "META_STOP", "covariance": "COVARIANCE_STOP"}
_CHILDREN = {
    "": ("ndm", "oem"),
    "ndm": ("oem",),
    "oem": ("header", "body"),
    "body": ("segment",),
    "segment": ("metadata", "data"),
    "data": ("stateVector", "covarianceMatrix"),
}
"""Elements of XML that hold elements; the others hold one value each."""
_LEAVES = ("header", "metadata", "stateVector", "covarianceMatrix")


@dataclass
class Block:
    """Consecutive entries, and where they begin and end (``"file:line"``)."""

    place: str
    end: str = ""
    entries: list[Entry] = field(default_factory=list)


@dataclass
class SegmentBlocks:
    """One segment: its metadata, states and covariances.

    States of a text after the first are lines, which `read_state_line` takes apart.
    """

    place: str
    metadata: Block
    states: list[Block] = field(default_factory=list)
    covariances: list[Block] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    other_comments: bool = False


@dataclass
class Message:
    """A message: its version and header, and its segments."""

    version: Entry
    header: Block
    segments: list[SegmentBlocks] = field(default_factory=list)
    comments: bool = False


def take_apart(text: str, where: str) -> Message:
    """Return the blocks of a message in either encoding.

    Raises
    ------
    InputError
        If they do not follow each other as the standard prescribes; the message names the line.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        return _XmlMessage(where).read(text)
    return _KvnMessage(where).read(text)


class _KvnMessage:
    """Collector of the lines of a text."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._block = "header"
        self._began = ""
        self._message: Message | None = None
        self._comments_above = False
        self._with_states: SegmentBlocks | None = None

    def read(self, text: str) -> Message:
        """Return the blocks of a text."""
        number = 1
        for number, raw in enumerate(LINE_ENDS.split(text.removeprefix("\ufeff")), 1):
            if line := raw.strip():
                segment = self._with_states
                if segment is not None and line[0] in "0123456789" and "=" not in line:
                    segment.lines.append(line)
                    segment.numbers.append(number)
                else:
                    self._line(f"{self._where}:{number}", line)
        place = f"{self._where}:{number}"
        if self._message is None:
            raise InputError(
                f"{place}: not an orbit ephemeris message: no CCSDS_OEM_VERS = 2.0 at its beginning"
            )
        if self._block in _ENDS:
            raise InputError(
                f"{place}: the message ends before {_ENDS[self._block]} of the block that begins "
                f"at {self._began}"
            )
        if not self._message.segments:
            raise InputError(f"{place}: the message has no segment; expected META_START")
        return self._message

    def _line(self, place: str, line: str) -> None:
        message = self._message
        if line == "COMMENT" or line.startswith(("COMMENT ", "COMMENT\t")):
            self._comment(line[8:].strip())
        elif message is None:
            match = KEYWORD_LINE.fullmatch(line)
            if match is None or match[1] != "CCSDS_OEM_VERS":
                raise InputError(
                    f"{place}: not an orbit ephemeris message: expected CCSDS_OEM_VERS = 2.0, got "
                    f"{line[:40]!r}"
                )
            entry = Entry(place, match[1], match[2])
            self._message = Message(entry, Block(place), comments=self._comments_above)
        elif line in _MARKS:
            self._mark(message, place, line)
        elif self._block == "data":
            self._state(message.segments[-1], place, line)
        elif self._block == "covariance" and "=" not in line:
            self._row(message.segments[-1], place, line)
        else:
            self._entry(message, place, line)

    def _comment(self, text: str) -> None:
        if self._message is None:
            self._comments_above = True
        elif self._block == "metadata":
            self._message.segments[-1].comments.append(text)
        elif self._block == "header":
            self._message.comments = True
        else:
            self._message.segments[-1].other_comments = True

    def _mark(self, message: Message, place: str, mark: str) -> None:
        if self._block not in _MARKS[mark]:
            expected = _ENDS.get(self._block) or (
                "META_START"
                if self._block == "header"
                else "a state, COVARIANCE_START or META_START"
            )
            raise InputError(
                f"{place}: {mark} cannot stand in the {self._block}; expected {expected}"
            )  # fmt: skip
        self._with_states = None
        if mark == "META_START":
            if self._block == "header":
                message.header.end = place
            message.segments.append(SegmentBlocks(place, Block(place)))
            self._block, self._began = "metadata", place
        elif mark == "META_STOP":
            message.segments[-1].metadata.end = place
            self._block = "data"
        elif mark == "COVARIANCE_START":
            self._block, self._began = "covariance", place
            self._rows: list[Block] = []
        else:
            if not self._rows:
                raise InputError(f"{place}: the block has no covariance; expected EPOCH and 6 rows")
            self._finish_rows(place)
            message.segments[-1].covariances += self._rows
            self._block = "data"

    def _entry(self, message: Message, place: str, line: str) -> None:
        match = KEYWORD_LINE.fullmatch(line)
        if match is None:
            end = _ENDS.get(self._block, "META_START")
            hint = did_you_mean(line, (end,)) if len(line) < 40 else ""
            raise InputError(f"{place}: expected KEYWORD = value or {end}, got {line[:40]!r}{hint}")
        _refuse_second(place, match[1])
        entry = Entry(place, match[1], match[2])
        if self._block == "header":
            message.header.entries.append(entry)
        elif self._block == "metadata":
            message.segments[-1].metadata.entries.append(entry)
        else:
            if entry.key == "EPOCH":
                if self._rows:
                    self._finish_rows(place)
                self._rows.append(Block(place))
            elif entry.key != "COV_REF_FRAME":
                hint = did_you_mean(entry.key, ("EPOCH", "COV_REF_FRAME"), otherwise="keywords")
                raise InputError(f"{place}: a covariance has no keyword {entry.key[:60]!r}{hint}")
            elif not self._rows:
                raise InputError(f"{place}: COV_REF_FRAME must follow the EPOCH of its covariance")
            self._rows[-1].entries.append(entry)

    def _state(self, segment: SegmentBlocks, place: str, line: str) -> None:
        if segment.covariances:
            raise InputError(
                f"{place}: expected COVARIANCE_START or META_START: states stand before the "
                f"covariances of a segment, got {line[:40]!r}"
            )
        if match := KEYWORD_LINE.fullmatch(line):
            _refuse_second(place, match[1])
            hint = "; metadata stand between META_START and META_STOP"
            raise InputError(
                f"{place}: expected a time and 6 or 9 numbers, got the keyword {match[1][:40]!r}"
                f"{hint}"
            )
        segment.states.append(read_state_line(place, line))
        self._with_states = segment

    def _row(self, segment: SegmentBlocks, place: str, line: str) -> None:
        if not self._rows:
            raise InputError(f"{place}: expected EPOCH before the first row, got {line[:40]!r}")
        block, parts = self._rows[-1], line.split()
        number = _rows_of(block)
        if number == len(COVARIANCE):
            raise InputError(f"{place}: a covariance has 6 rows, got a seventh")
        keys = COVARIANCE[number]
        if len(parts) != len(keys):
            raise InputError(
                f"{place}: row {number + 1} of a covariance has {len(keys)} "
                f"{'number' if len(keys) == 1 else 'numbers'} ({', '.join(keys)}), got {len(parts)}"
            )
        block.entries += [Entry(place, key, part) for key, part in zip(keys, parts, strict=True)]

    def _finish_rows(self, place: str) -> None:
        block = self._rows[-1]
        block.end = place
        if (number := _rows_of(block)) != len(COVARIANCE):
            raise InputError(
                f"{place}: the covariance that begins at {block.place} has {number} rows; "
                "expected 6"
            )


def read_state_line(place: str, line: str) -> Block:
    """Return the entries of a line of a time and 6 or 9 numbers, else raise `InputError`."""
    parts = line.split()
    if len(parts) not in (7, 10):
        hint = did_you_mean(line, _MARKS, otherwise="") if len(parts) == 1 else ""
        hint = hint if "mean" in hint else ""
        raise InputError(
            f"{place}: expected a time and 6 or 9 numbers ({', '.join(STATE)} and perhaps "
            f"{', '.join(ACCELERATION)}), got {len(parts)} words{hint}"
        )
    keys = ("EPOCH", *STATE, *ACCELERATION)[: len(parts)]
    return Block(
        place, place, [Entry(place, key, part) for key, part in zip(keys, parts, strict=True)]
    )


def _refuse_second(place: str, key: str) -> None:
    if VERSION_KEYWORD.fullmatch(key):
        raise InputError(
            f"{place}: a second message begins here; a text holds one orbit ephemeris message: "
            "write each into its own file, or all as parts of an <ndm> in XML"
        )


def _rows_of(block: Block) -> int:
    """Return the number of rows that a covariance has so far."""
    keys = {entry.key for entry in block.entries}
    return sum(row[0] in keys for row in COVARIANCE)


class _XmlMessage:
    """Collector of the elements of XML."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._open: list[tuple[str, str, str]] = []  # place, name, unit
        self._message: Message | None = None
        self._seen: list[str] = []

    def read(self, text: str) -> Message:
        """Return the blocks of a text."""
        walk_xml(text, self._where, self._start, self._end)
        last = f"{self._where}:{text.count(chr(10)) or 1}"
        if self._message is None:
            raise InputError(f"{last}: not an orbit ephemeris message: it has no <oem>")
        if not self._message.segments:
            raise InputError(f"{last}: the message has no <segment>")
        return self._message

    def _start(self, place: str, name: str, attributes: dict[str, str]) -> None:
        parent_place, parent, _ = self._open[-1] if self._open else (place, "", "")
        if parent in _CHILDREN and not (name == "COMMENT" and parent):
            if name not in _CHILDREN[parent]:
                hint = did_you_mean(name, _CHILDREN[parent], otherwise="expected")
                within = f"<{parent}>" if parent else "an orbit ephemeris message"
                raise InputError(f"{place}: {within} has no element {name[:60]!r}{hint}")
            self._container(place, name, attributes)
        elif parent in _LEAVES and name in (*_CHILDREN, *_LEAVES):
            raise InputError(f"{place}: <{parent}> has no element {name!r}; close <{parent}> first")
        elif parent not in (*_CHILDREN, *_LEAVES):
            raise InputError(
                f"{parent_place}: {parent[:60]!r} must hold a value, not further elements"
            )
        self._open.append((place, name, attributes.get("units", "")))

    def _container(self, place: str, name: str, attributes: dict[str, str]) -> None:
        if name == "oem":
            if self._message is not None:
                raise InputError(f"{place}: a second <oem>; write each message into its own file")
            self._message = Message(
                Entry(place, "CCSDS_OEM_VERS", attributes.get("version", "")), Block(place)
            )
            return
        message = self._message
        if message is None:
            return
        doubled = {"header": "header" in self._seen, "body": "body" in self._seen}
        if doubled.get(name):
            raise InputError(f"{place}: a second <{name}>; keep one")
        if name == "body" and "header" not in self._seen:
            raise InputError(f"{place}: <body> must follow the <header>")
        if name == "header" and "body" in self._seen:
            raise InputError(f"{place}: <header> must stand before the <body>")
        if name not in ("stateVector", "covarianceMatrix"):
            self._seen.append(name)
        if name == "header":
            message.header.place = place
        elif name == "segment":
            message.segments.append(SegmentBlocks(place, Block("")))
        elif name in ("metadata", "data"):
            metadata = message.segments[-1].metadata
            began = self._seen[len(self._seen) - self._seen[::-1].index("segment") :]
            if began != (["metadata"] if name == "metadata" else ["metadata", "data"]):
                raise InputError(f"{place}: a <segment> has one <metadata>, then one <data>")
            if name == "metadata":
                metadata.place = place
        elif name == "stateVector":
            if message.segments[-1].covariances:
                raise InputError(f"{place}: <stateVector> must stand before <covarianceMatrix>")
            message.segments[-1].states.append(Block(place, place))
        elif name == "covarianceMatrix":
            message.segments[-1].covariances.append(Block(place, place))

    def _end(self, name: str, text: str) -> None:
        place, _, unit = self._open.pop()
        parent = self._open[-1][1] if self._open else ""
        if name in _CHILDREN or (name in _LEAVES and parent in _CHILDREN):
            if text:
                raise InputError(f"{place}: <{name}> holds elements, got the text {text[:40]!r}")
            self._close(place, name)
        elif name == "COMMENT":
            self._comment(parent, text)
        else:
            self._block(parent).entries.append(Entry(place, name, text, unit))

    def _close(self, place: str, name: str) -> None:
        message = self._message
        if message is None:
            return
        if name == "metadata":
            message.segments[-1].metadata.end = place
        elif name == "header":
            message.header.end = place
        elif name == "segment" and self._seen[-1] != "data":
            raise InputError(f"{place}: the <segment> lacks <metadata> or <data>")

    def _block(self, parent: str) -> Block:
        if (message := self._message) is None:
            raise AssertionError(parent)  # entries stand in blocks of a message only
        if parent == "header":
            return message.header
        segment = message.segments[-1]
        if parent == "metadata":
            return segment.metadata
        return (segment.states if parent == "stateVector" else segment.covariances)[-1]

    def _comment(self, parent: str, text: str) -> None:
        if (message := self._message) is None:
            return
        if parent == "metadata":
            message.segments[-1].comments.append(text)
        elif message.segments and parent in ("data", "stateVector", "covarianceMatrix"):
            message.segments[-1].other_comments = True
        else:
            message.comments = True
