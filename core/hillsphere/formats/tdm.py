"""CCSDS Tracking Data Messages: reading and writing text (KVN) and XML.

Each segment has metadata, which say what was measured between whom, and one series of numbers for
each keyword. `hillsphere.formats.tdm_reading` reads a message record by record while it is being
written.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime

from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import LINE_ENDS, Entry, Leniency
from hillsphere.formats.tdm_columns import Columns
from hillsphere.formats.tdm_entries import entries_of, entry_of_line
from hillsphere.formats.tdm_keywords import DATA, UNITS
from hillsphere.formats.tdm_reading import MessageBlocks, is_record, read_record
from hillsphere.formats.tdm_segments import Series, TdmHeader, TdmMeta, TdmSegment, angle_series
from hillsphere.formats.tdm_writing import header_of, kvn_lines, xml_lines

__all__ = [
    "UNITS",
    "Series",
    "TdmHeader",
    "TdmMeta",
    "TdmSegment",
    "angle_series",
    "read_tdm",
    "write_tdm",
]

_RECORD = re.compile(r"\s*([A-Z][A-Z0-9_]*)\s*=\s*(\S+)\s+(\S+)\s*")
_PIECE = 1 << 16
"""Characters of a message that are cut into lines at once: lines take more memory than text."""


def read_tdm(
    text: str,
    where: str = "TDM",
    *,
    lenient: bool = False,
    warn: Callable[[str], object] | None = None,
) -> list[TdmSegment]:
    """Read a Tracking Data Message: text (KVN) or XML, version 1.0 or 2.0.

    Of a combined message in XML (``<ndm>``) the tracking data are read.

    Parameters
    ----------
    text : str
        The message.
    where : str
        Name of the file, used in messages.
    lenient : bool
        Whether harmless departures from the standard are no errors: unknown keywords, missing
        CREATION_DATE and ORIGINATOR, order within header and metadata, comments and blanks where
        they do not belong, a missing DATA_STOP at the end.
    warn : callable, optional
        Called with ``"file:line: what is wrong"`` for each of them; by default a Python warning is
        given.

    Returns
    -------
    list of TdmSegment
        In order.

    Raises
    ------
    InputError
        Naming the line and the keyword, if the message departs from the standard or uses a time
        system that is neither of `hillsphere.time.SCALES` nor GPS.
    """
    leniency = Leniency(not lenient, warn)
    segments = _Segments(where, leniency)
    number = 0
    if text[:1000].lstrip("\ufeff \t\r\n").startswith("<"):
        for entry in entries_of((line for _, line in _numbered_lines(text)), where):
            segments.take(entry)
    else:
        for number, line in _numbered_lines(text):
            if segments.columns is not None:
                match = _RECORD.fullmatch(line)
                if match is not None and match[1] in DATA:
                    segments.blocks.records += 1
                    segments.columns.add(number, match[1], match[2], match[3])
                    continue
            if bare := line.strip():
                segments.take(entry_of_line(bare, f"{where}:{number}"))
    segments.finish("" if number == 0 else f"{where}:{number}")
    if not segments.complete:
        raise InputError(f"{where}: the message has no record of the data that can be read")
    return segments.complete


def write_tdm(
    segments: Sequence[TdmSegment],
    *,
    originator: str | None = None,
    created: datetime | None = None,
    encoding: str = "kvn",
) -> str:
    """Return a Tracking Data Message, version 2.0.

    Parameters
    ----------
    segments : sequence of TdmSegment
        In order. The message has the comments and the identifier of the header of the first.
    originator : str, optional
        Who made it; by default that of the first segment's header, else ``"HILLSPHERE"``.
    created : datetime, optional
        When; by default now.
    encoding : str
        ``"kvn"`` for text, ``"xml"`` for XML.

    Returns
    -------
    str
        The message, with the records of a segment in order of time. Numbers are the shortest that
        are read back as they are, which are up to 17 digits (the standard says 16); of counts the
        digits are those of the segment. Times have the decimals that the segment states, 1 µs by
        default.

    Raises
    ------
    InputError
        If what a segment holds could not be read again.
    """
    if encoding not in ("kvn", "xml"):
        raise InputError(f"encoding must be 'kvn' or 'xml', got {encoding!r}")
    write = xml_lines if encoding == "xml" else kvn_lines
    text = "\n".join(write(header_of(segments, originator, created), segments)) + "\n"
    # the reader checks limits, paths, and that times still rise when they are rounded
    read_tdm(text, "tracking data to be written")
    return text


class _Segments:
    """Collector of the segments of a message."""

    def __init__(self, where: str, leniency: Leniency) -> None:
        self._where, self._leniency = where, leniency
        self.blocks = MessageBlocks(where, leniency)
        self.columns: Columns | None = None
        self.complete: list[TdmSegment] = []

    def take(self, entry: Entry) -> None:
        """Take an entry of the message, perhaps a record."""
        blocks, columns = self.blocks, self.columns
        if columns is not None and is_record(blocks, entry):
            self._record(entry, columns)
            return
        if columns is not None and self._leniency.strict:
            columns.flush()  # the first fault of the file comes first
        blocks.take(entry)
        self._follow()

    def finish(self, place: str) -> None:
        """Take the end of the message."""
        if self.columns is not None and self._leniency.strict:
            self.columns.flush()
        self.blocks.finish(place)
        self._follow()

    def _record(self, entry: Entry, columns: Columns) -> None:
        self.blocks.records += 1
        words = entry.value.split()
        if len(words) == 2 and entry.key in DATA:
            columns.add(entry.place, entry.key, words[0], words[1], entry.unit)
            return
        columns.flush()
        assert self.blocks.meta is not None
        read_record(entry, self.blocks.meta, self._leniency)

    def _follow(self) -> None:
        """Begin or end a segment as the blocks of the message do."""
        blocks = self.blocks
        if self.columns is None and blocks.in_data and blocks.meta is not None:
            self.columns = Columns(blocks.meta, self._where, self._leniency)
        elif self.columns is not None and not blocks.in_data:
            segment = self.columns.finish(blocks.header, blocks.comments)
            self.columns = None
            if segment is not None:
                self.complete.append(segment)


def _numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text with their numbers, without a list of all of them."""
    begin, number = (1, 0) if text.startswith("\ufeff") else (0, 0)
    while begin < len(text):
        end = text.find("\n", begin + _PIECE) + 1 or len(text)
        lines = LINE_ENDS.split(text[begin:end])
        if not lines[-1]:
            del lines[-1]
        for line in lines:
            number += 1
            yield number, line
        begin = end
