"""The two encodings of Orbit Comprehensive Messages, text (KVN) and XML, taken apart into blocks.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 6 (OCM) and 8 (XML).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.formats.ccsds_entries import (
    KEYWORD_LINE,
    LINE_ENDS,
    VERSION_KEYWORD,
    Entry,
    Leniency,
    split_unit,
)
from hillsphere.formats.ccsds_tree import read_tree
from hillsphere.formats.oem_encodings import Block
from hillsphere.formats.opm_encodings import children_of, entry_of, xml_parts

__all__ = ["KINDS", "OcmBlock", "OcmBlocks", "take_apart"]

KINDS = ("TRAJ", "PHYS", "COV", "MAN", "PERT", "OD", "USER")
"""Kinds of blocks of data in the order of the standard."""
_MANY = ("TRAJ", "COV", "MAN")
"""Kinds that may occur more than once, and that have rows of numbers."""
_MARKS = {f"{kind}_{end}": (kind, end) for kind in ("META", *KINDS) for end in ("START", "STOP")}


@dataclass
class OcmBlock:
    """One block: its kind, its entries with comments, and its rows with their places."""

    kind: str
    block: Block
    rows: list[tuple[str, str]] = field(default_factory=list)


@dataclass
class OcmBlocks:
    """A message: its version, header and metadata, and its blocks of data in order."""

    version: Entry
    header: Block
    metadata: Block | None = None
    data: list[OcmBlock] = field(default_factory=list)


def take_apart(text: str, where: str, leniency: Leniency) -> OcmBlocks:
    """Return the blocks of a message in either encoding.

    Raises
    ------
    InputError
        If they do not follow each other as the standard prescribes; the message names the line.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        message = _of_xml(text, where, leniency)
    else:
        message = _KvnMessage(where).read(text)
    _check_order(message.data, leniency)
    return message


def _check_order(blocks: list[OcmBlock], leniency: Leniency) -> None:
    last = 0
    met: set[str] = set()
    for block in blocks:
        place, kind = block.block.place, block.kind
        if kind in met and kind not in _MANY:
            raise InputError(f"{place}: a second block {kind}; a message has one at most")
        rank = KINDS.index(kind)
        if rank < last:
            leniency.tolerate(f"{place}: the block {kind} must stand before {KINDS[last]}")
        met.add(kind)
        last = rank


class _KvnMessage:
    """Collector of the lines of a text."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._open: OcmBlock | None = None
        self._message: OcmBlocks | None = None
        self._remarks: list[Entry] = []

    def read(self, text: str) -> OcmBlocks:
        """Return the blocks of a text."""
        number = 1
        for number, raw in enumerate(LINE_ENDS.split(text.removeprefix("\ufeff")), 1):
            if line := raw.strip():
                self._line(f"{self._where}:{number}", line)
        place, message = f"{self._where}:{number}", self._message
        if message is None:
            raise InputError(
                f"{place}: not an orbit comprehensive message: no CCSDS_OCM_VERS = 3.0 at its "
                "beginning"
            )
        if self._open is not None:
            raise InputError(
                f"{place}: the message ends before {self._open.kind}_STOP of the block that begins "
                f"at {self._open.block.place}"
            )
        if message.metadata is None:
            raise InputError(f"{place}: the message has no metadata; expected META_START")
        return message

    def _line(self, place: str, line: str) -> None:
        message = self._message
        if line == "COMMENT" or line.startswith(("COMMENT ", "COMMENT\t")):
            comment = Entry(place, "COMMENT", line[8:].strip())
            if self._open is not None:
                self._open.block.entries.append(comment)
            elif message is not None:
                message.header.entries.append(comment)
            else:
                self._remarks.append(comment)
            return
        match = KEYWORD_LINE.fullmatch(line)
        if message is None:
            if match is None or match[1] != "CCSDS_OCM_VERS":
                raise InputError(
                    f"{place}: not an orbit comprehensive message: expected CCSDS_OCM_VERS = 3.0, "
                    f"got {line[:40]!r}"
                )
            self._message = OcmBlocks(
                Entry(place, match[1], match[2]), Block(place, place, self._remarks)
            )
        elif line in _MARKS:
            self._mark(message, place, line)
        elif match is not None:
            self._entry(message, place, match[1], match[2])
        elif self._open is not None and self._open.kind in _MANY:
            self._open.rows.append((place, line))
        else:
            hint = did_you_mean(line, _MARKS, otherwise="") if len(line) < 20 else ""
            hint = hint if "mean" in hint else ""
            raise InputError(f"{place}: expected KEYWORD = value, got {line[:40]!r}{hint}")

    def _mark(self, message: OcmBlocks, place: str, mark: str) -> None:
        kind, end = _MARKS[mark]
        block = self._open
        if end == "STOP":
            if block is None or block.kind != kind:
                expected = f"{block.kind}_STOP" if block else "the beginning of a block"
                raise InputError(f"{place}: {mark} ends no block; expected {expected}")
            block.block.end = place
            self._open = None
            return
        if block is not None:
            raise InputError(
                f"{place}: {mark} cannot stand in the block that begins at {block.block.place}; "
                f"expected {block.kind}_STOP"
            )
        self._open = OcmBlock(kind, Block(place))
        if kind == "META":
            if message.metadata is not None:
                raise InputError(f"{place}: a second META_START; a message has one set of metadata")
            message.metadata = self._open.block
            message.header.end = place
        elif message.metadata is None:
            raise InputError(f"{place}: {mark} must stand after the metadata; expected META_START")
        else:
            message.data.append(self._open)

    def _entry(self, message: OcmBlocks, place: str, key: str, value: str) -> None:
        block = self._open
        if VERSION_KEYWORD.fullmatch(key):
            raise InputError(
                f"{place}: a second message begins here; a text holds one orbit comprehensive "
                "message: write each into its own file, or all as parts of an <ndm> in XML"
            )
        if block is None and message.metadata is not None:
            raise InputError(
                f"{place}: {key[:40]} stands outside the blocks; expected the beginning of a "
                f"block: {', '.join(f'{kind}_START' for kind in KINDS)}"
            )
        if block is not None and block.rows:
            raise InputError(f"{place}: {key[:40]} must stand before the rows of its block")
        value, unit = (value, "") if block is None else split_unit(value)
        target = message.header if block is None else block.block
        target.entries.append(Entry(place, key, value, unit))


def _of_xml(text: str, where: str, leniency: Leniency) -> OcmBlocks:
    (message,) = xml_parts(read_tree(text, where), "ocm", "an orbit comprehensive message", 1)
    parts = children_of(message, ("header", "body"), ("header", "body"), leniency)
    body = parts["body"][0]
    segment = children_of(body, ("segment",), ("segment",), leniency)["segment"][0]
    inner = children_of(segment, ("metadata", "data"), ("metadata", "data"), leniency)
    result = OcmBlocks(
        Entry(message.place, "CCSDS_OCM_VERS", message.attributes.get("version", "")),
        Block(parts["header"][0].place, parts["header"][0].place),
        Block(inner["metadata"][0].place, inner["metadata"][0].place),
    )
    assert result.metadata is not None
    result.header.entries = [entry_of(one) for one in parts["header"][0].children]
    result.metadata.entries = [entry_of(one) for one in inner["metadata"][0].children]
    for container in (message, body, segment, inner["data"][0]):
        result.metadata.entries += [
            entry_of(one) for one in container.children if one.name == "COMMENT"
        ]
    names = tuple(kind.lower() for kind in KINDS)
    for element in inner["data"][0].children:
        if element.name == "COMMENT":
            continue
        if element.name not in names:
            hint = did_you_mean(element.name, names, otherwise="expected")
            raise InputError(f"{element.place}: <data> has no element {element.name[:60]!r}{hint}")
        block = OcmBlock(element.name.upper(), Block(element.place, element.place))
        for child in element.children:
            if child.name == f"{element.name}Line" and block.kind in _MANY:
                block.rows.append((child.place, entry_of(child).value))
            elif block.rows:
                raise InputError(
                    f"{child.place}: <{child.name[:60]}> must stand before the rows of its block"
                )
            else:
                block.block.entries.append(entry_of(child))
        result.data.append(block)
    return result
