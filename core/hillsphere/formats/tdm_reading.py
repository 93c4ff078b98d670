"""Order of the blocks of a Tracking Data Message, and its records read one at a time.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 3 and 4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite, radians
from typing import NamedTuple

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, read_scaled
from hillsphere.formats.tdm_entries import MARKS, MESSAGE_END, VERSION, entries_of
from hillsphere.formats.tdm_keywords import DATA, HEADER, VERSIONS, power_of
from hillsphere.formats.tdm_metadata import gather, read_meta, read_time_tag
from hillsphere.formats.tdm_segments import TdmHeader, TdmMeta

__all__ = [
    "MessageBlocks", "TdmRecord", "is_record", "limits_of", "read_record", "records_and_faults",
]  # fmt: skip


class TdmRecord(NamedTuple):
    """One number of the data.

    `place` is its ``"file:line"``, `value` in SI without corrections, `text` its digits.
    """

    place: str
    meta: TdmMeta
    keyword: str
    epoch: Epoch
    value: float
    text: str = ""


_NEXT = {
    "": VERSION,
    "header": "META_START",
    "metadata": "META_STOP",
    "metadata end": "DATA_START",
    "data": "DATA_STOP",
    "data end": "META_START",
}
"""What brings a message on from each of its blocks."""
_BEFORE = {
    "META_START": ("header", "data end"),
    "META_STOP": ("metadata",),
    "DATA_START": ("metadata end",),
    "DATA_STOP": ("data",),
}
"""Blocks after which, or in which, each mark may stand."""
_NAMES = {
    "header": "the header",
    "metadata": "the metadata",
    "metadata end": "the place between metadata and data",
    "data": "the data",
    "data end": "the place after the data",
}


class MessageBlocks:
    """Follows a message through its blocks, and reads its header and metadata.

    Parameters
    ----------
    where : str
        Name of the file, used in messages.
    leniency : Leniency
        What is done about harmless departures.

    Attributes
    ----------
    in_data : bool
        Whether the next entries may be records.
    meta : TdmMeta or None
        Metadata of the segment.
    header : TdmHeader
        Header of the message.
    comments : list of str
        Comments of the data so far.
    records : int
        Records of the data so far, counted by who reads them.
    """

    def __init__(self, where: str, leniency: Leniency) -> None:
        self._where, self._leniency = where, leniency
        self.meta: TdmMeta | None = None
        self.comments: list[str] = []
        self._place = f"{where}:1"
        self._messages = 0
        self._restart()

    def _restart(self) -> None:
        self._block = ""
        self.in_data = False
        self.header = TdmHeader()
        self.records = 0
        self._entries: list[Entry] = []
        self._comments: list[str] = []
        self._segments = 0

    def take(self, entry: Entry) -> None:
        """Take an entry that is no record.

        Raises
        ------
        InputError
            If it does not belong where it stands, or at the end of a block whose contents are not
            those of the standard. The message names file and line.
        """
        self._place = entry.place
        key = entry.key
        if key == "COMMENT":
            self._comment(entry)
        elif key == MESSAGE_END:
            self._end_message()
        elif key == VERSION:
            self._begin_message(entry)
        elif not self._block:
            got = key or entry.value
            raise InputError(
                f"{entry.place}: not a tracking data message: expected {VERSION} = 2.0, got "
                f"{got[:40]!r}"
            )
        elif key in MARKS:
            self._mark(entry.place, key)
        elif self._block in ("header", "metadata") and key:
            self._entries.append(entry)
        else:
            following = _NEXT[self._block]
            words = MARKS if key else (following,)
            hint = did_you_mean(key or entry.value, words) if len(entry.value) < 40 else ""
            expected = f"KEYWORD = value or {following}" if not key else following
            raise InputError(
                f"{entry.place}: expected {expected} in {_NAMES[self._block]}, got "
                f"{(key or entry.value)[:40]!r}{hint if 'mean' in hint else ''}"
            )

    def finish(self, place: str = "") -> None:
        """Take the end of the input, at its last line if a place is given.

        Raises
        ------
        InputError
            If the message is not complete.
        """
        self._place = place or self._place
        if self._block or not self._messages:
            self._end_message()

    def _begin_message(self, entry: Entry) -> None:
        if self._block:
            raise InputError(
                f"{entry.place}: a second {VERSION}; write each message into its own file, or into "
                "one <ndm> of XML"
            )
        if entry.value not in VERSIONS:
            raise InputError(
                f"{entry.place}: {VERSION}: version {entry.value[:40]!r} is not read; expected "
                f"{' or '.join(VERSIONS)}"
            )
        self._block = "header"
        self.header = TdmHeader(version=entry.value)

    def _comment(self, entry: Entry) -> None:
        at_beginning = {
            "header": not self._entries, "metadata": not self._entries,
            "data": not self.records,
        }.get(self._block, False)  # fmt: skip
        if not at_beginning:
            self._leniency.tolerate(
                f"{entry.place}: a COMMENT stands at the beginning of header, metadata or data "
                "only",
                "COMMENT",
            )
        (self.comments if self._block.startswith("data") else self._comments).append(entry.value)

    def _mark(self, place: str, mark: str) -> None:
        if self._block not in _BEFORE[mark]:
            raise InputError(
                f"{place}: {mark} cannot stand in {_NAMES[self._block]}; expected "
                f"{_NEXT[self._block]}"
            )
        if mark == "META_START":
            if self._block == "header":
                self.header = self._read_header(place)
            self._block, self._entries, self._comments = "metadata", [], []
        elif mark == "META_STOP":
            self.meta = read_meta(self._entries, self._comments, place, self._leniency)
            self._block, self._entries, self._comments = "metadata end", [], []
        elif mark == "DATA_START":
            self._block, self.in_data, self.records = "data", True, 0
            self.comments = self._comments
        else:
            self._end_data(place)

    def _end_data(self, place: str) -> None:
        if not self.records:
            self._leniency.tolerate(f"{place}: the data have no record; a segment has one at least")
        self._block, self.in_data = "data end", False
        self._segments += 1

    def _read_header(self, place: str) -> TdmHeader:
        fields = gather(self._entries, HEADER, "the header", self._leniency)
        for key in HEADER[:2]:
            if key not in fields:
                self._leniency.tolerate(f"{place}: the header lacks {key}, which it must have")
        if (date := fields.get("CREATION_DATE")) is not None:
            read_time_tag(date.value, "UTC", date.place, date.key, self._leniency)
        created, originator, identifier = (
            fields[key].value if key in fields else "" for key in HEADER
        )
        return TdmHeader(
            self.header.version, created, originator, identifier, tuple(self._comments)
        )

    def _end_message(self) -> None:
        self._messages += 1
        if self._block == "data":
            self._leniency.tolerate(f"{self._place}: the message ends before DATA_STOP")
            self._end_data(self._place)
        if not self._block:
            raise InputError(
                f"{self._place}: not a tracking data message: no {VERSION} = 2.0 at its beginning"
            )
        if self._block != "data end":
            raise InputError(
                f"{self._place}: the message ends in {_NAMES[self._block]}; expected "
                f"{_NEXT[self._block]}"
            )
        self._restart()


_OVER_THE_TOP = 180.0
"""Elevation of the horizon, degrees, for a mount that has turned beyond the zenith to the other
side. More is no elevation, but perhaps an azimuth in its place."""


def limits_of(key: str, meta: TdmMeta) -> tuple[float, float, bool]:
    """Return least and most of a value in the message, and whether it must exceed the first."""
    if key == "ANGLE_2" and meta.angle_type in ("AZEL", "RADEC"):
        return -90.0, 90.0, False
    quantity = DATA[key]
    return quantity.least, quantity.most, quantity.is_above


def read_record(entry: Entry, meta: TdmMeta, leniency: Leniency) -> TdmRecord | None:
    """Return a record of the data; None for an unknown keyword that is tolerated.

    Parameters
    ----------
    entry : Entry
        Its keyword, and its time and number.
    meta : TdmMeta
        Metadata of the segment.
    leniency : Leniency
        What is done about harmless departures.

    Raises
    ------
    InputError
        If it has no time and finite number within the limits of the keyword.
    """
    place, key = entry.place, entry.key
    if not key:
        raise InputError(
            f"{place}: expected KEYWORD = time number or DATA_STOP, got {entry.value[:40]!r}"
        )
    if key not in DATA:
        hint = did_you_mean(key, DATA, otherwise="keywords")
        # a keyword of a user may stand in every record: one warning is enough
        leniency.tolerate(f"{place}: no data keyword {key[:40]!r} in this standard{hint}", key)
        return None
    words = entry.value.split()
    if len(words) != 2:
        raise InputError(f"{place}: {key}: expected a time and a number, got {entry.value[:60]!r}")
    if entry.unit:
        expected = meta.range_units if key == "RANGE" else DATA[key].unit
        if entry.unit.lower() != expected.lower():
            raise InputError(
                f"{place}: {key} must be in {expected or 'no unit'}, got {entry.unit[:40]!r}"
            )
        leniency.tolerate(
            f"{place}: {key} has no attribute units in this standard; remove it", f"units {key}"
        )
    epoch = read_time_tag(words[0], meta.time_system, place, key, leniency)
    return TdmRecord(
        place, meta, key, epoch, _value(key, words[1], meta, place, leniency), words[1]
    )


def _value(key: str, text: str, meta: TdmMeta, place: str, leniency: Leniency) -> float:
    quantity = DATA[key]
    number = read_scaled(text, 0)
    if not isfinite(number):
        raise InputError(f"{place}: {key}: expected a finite number, got {text[:40]!r}")
    least, most, is_above = limits_of(key, meta)
    if key == "ANGLE_2" and meta.angle_type == "AZEL" and most < number <= _OVER_THE_TOP:
        # the standard's own range, -180 to 360°, is that of all types of angles
        must = f"must be from {least:g} to {most:g}°, got {text[:40]}"
        leniency.tolerate(
            f"{place}: {key} {must}, as a mount has that went over the top; "
            + ("lenient reading turns it" if leniency.strict
               else "such elevations are turned, with the opposite azimuth"),
            "over the top",
        )  # fmt: skip
        return radians(number)
    if not least <= number <= most or (is_above and number == least):
        unit = quantity.unit.replace("deg", "°")
        blank = "" if unit in ("°", "%") else " "
        limits = f"at least {least:g}" if most > 1e300 else f"from {least:g} to {most:g}"
        limits = f"above {least:g}" if is_above else limits
        raise InputError(f"{place}: {key} must be {limits}{blank}{unit}, got {text[:40]}")
    if number == most == 360.0:
        leniency.tolerate(f"{place}: {key} must be below 360°, got {text[:40]}")
    if quantity.is_count and "e" in text.lower():
        raise InputError(f"{place}: {key} must have no exponent, got {text[:40]!r}")
    if key == "DOPPLER_COUNT" and number != round(number):
        raise InputError(f"{place}: {key} must be a whole number, got {text[:40]!r}")
    if quantity.unit == "deg":
        return radians(number)
    value = read_scaled(text, power_of(key, meta))
    if not isfinite(value):
        raise InputError(f"{place}: {key}: expected a finite number, got {text[:40]!r}")
    return value


def records_and_faults(
    lines: Iterable[str], where: str = "TDM", leniency: Leniency | None = None
) -> Iterator[TdmRecord | InputError]:
    """Yield the records of a message as soon as their lines are there, and errors for bad ones.

    Parameters
    ----------
    lines : iterable of str
        The message, as text or XML; may be a stream that is still being written.
    where : str
        Name of the file, used in messages.
    leniency : Leniency, optional
        What is done about harmless departures; by default they are errors.

    Yields
    ------
    TdmRecord or InputError
        Records in the order of the message, whose times are not compared, and an error for each bad
        line of the data.

    Raises
    ------
    InputError
        If the metadata or the order of the blocks is wrong: the rest cannot be interpreted then.
    """
    leniency = leniency or Leniency()
    blocks = MessageBlocks(where, leniency)
    place = ""
    for entry in entries_of(lines, where):
        place = entry.place
        if not is_record(blocks, entry):
            blocks.take(entry)
            continue
        assert blocks.meta is not None
        try:
            record = read_record(entry, blocks.meta, leniency)
        except InputError as error:
            yield error
            continue
        blocks.records += 1
        if record is not None:
            yield record
    blocks.finish(place)


def is_record(blocks: MessageBlocks, entry: Entry) -> bool:
    """Return whether an entry is to be read as a record."""
    return blocks.in_data and entry.key not in (*MARKS, "COMMENT", MESSAGE_END, VERSION)
