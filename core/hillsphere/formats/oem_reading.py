"""Orbit Ephemeris Messages from their blocks: keywords, times, numbers and covariances checked.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 5 (OEM).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, order_entries
from hillsphere.formats.ccsds_times import plain_seconds
from hillsphere.formats.ccsds_values import (
    TRIANGLE,
    check_moving_frame,
    check_text,
    check_word,
    read_epoch,
    read_frame,
    read_number,
    read_time_system,
    read_triangle,
)
from hillsphere.formats.oem_encodings import (
    ACCELERATION,
    STATE,
    Block,
    Message,
    SegmentBlocks,
    read_state_line,
)
from hillsphere.formats.oem_segments import (
    INTERPOLATIONS,
    OemCovariance,
    OemSegment,
    states_needed,
)
from hillsphere.formats.oem_states import parse_states

__all__ = ["HEADER", "METADATA", "UNITS", "VERSIONS", "needs_epoch", "segments_of"]

VERSIONS = ("1.0", "2.0", "3.0")
"""Versions of the message that are read."""
HEADER = ("CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
"""Keywords of the header, in order."""
METADATA = (
    "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "REF_FRAME_EPOCH", "TIME_SYSTEM",
    "START_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME", "STOP_TIME", "INTERPOLATION",
    "INTERPOLATION_DEGREE",
)  # fmt: skip
"""Keywords of the metadata, in order."""
_MANDATORY = (
    "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "START_TIME", "STOP_TIME"
)  # fmt: skip
UNITS = {
    **dict.fromkeys(STATE[:3], "km"), **dict.fromkeys(STATE[3:], "km/s"),
    **dict.fromkeys(ACCELERATION, "km/s**2"),
    **{key: f"km**2{('', '/s', '/s**2')[key.count('_DOT')]}" for key in TRIANGLE},
}  # fmt: skip
"""The unit of each number."""
_ROWS = (("EPOCH", *STATE), ("EPOCH", *STATE, *ACCELERATION))
_DIGITS = re.compile(r"\.(\d*?)0*Z?")
_NEEDS_EPOCH = re.compile(r"TEMEOFEPOCH|(MOE|TOE)_.*")


def needs_epoch(frame: str) -> bool:
    """Return whether the definition of a frame leaves its epoch open."""
    return _NEEDS_EPOCH.fullmatch(frame) is not None


def segments_of(message: Message, leniency: Leniency) -> list[OemSegment]:
    """Return the segments of a message.

    Parameters
    ----------
    message : Message
        Its blocks.
    leniency : Leniency
        What to do about harmless departures in header and metadata.

    Raises
    ------
    InputError
        Naming the line and the keyword, at the first fault.
    """
    version = message.version
    if version.value not in VERSIONS:
        raise InputError(
            f"{version.place}: CCSDS_OEM_VERS: version {version.value[:40]!r} is not read; "
            f"expected {', '.join(VERSIONS)}"
        )
    header = order_entries(
        message.header.entries, HEADER, HEADER[1:3], "the header", message.header.end, leniency,
        HEADER[1:3],
    )  # fmt: skip
    for entry in header.values():
        check_text(entry)
    if "CREATION_DATE" in header:
        read_epoch(header["CREATION_DATE"], "UTC")
    unheld: list[str] = [key for key in ("CLASSIFICATION", "MESSAGE_ID") if key in header]
    if message.comments:
        unheld.insert(0, "comments")
    return [_Reading.of(blocks, leniency).segment(blocks, unheld) for blocks in message.segments]


@dataclass(frozen=True)
class _Reading:
    """Metadata of a segment, and the epoch from which its times count."""

    meta: Mapping[str, Entry]
    epoch: Epoch
    base: Epoch
    span: Mapping[str, float]

    @classmethod
    def of(cls, blocks: SegmentBlocks, leniency: Leniency) -> _Reading:
        metadata = blocks.metadata
        meta = order_entries(
            metadata.entries, METADATA, _MANDATORY, "the metadata", metadata.end, leniency
        )
        for entry in meta.values():
            check_text(entry)
        name = read_frame(meta["REF_FRAME"], leniency)
        meta["REF_FRAME"] = meta["REF_FRAME"]._replace(value=name)
        scale = read_time_system(meta["TIME_SYSTEM"])
        frame, frame_epoch = meta["REF_FRAME"], meta.get("REF_FRAME_EPOCH")
        if frame_epoch is None and needs_epoch(frame.value.upper()):
            raise InputError(
                f"{frame.place}: REF_FRAME: {frame.value} needs a REF_FRAME_EPOCH after it"
            )
        if not blocks.states:
            raise InputError(
                f"{metadata.end}: the segment has no states; expected a time and 6 or 9 numbers"
            )
        times = {
            key: read_epoch(entry, scale) for key, entry in meta.items() if key.endswith("_TIME")
        }
        first = blocks.states[0]
        epoch = read_epoch(_first(first, "EPOCH"), scale)
        base = epoch.to("TAI") if scale == "UTC" else epoch
        span = {key: time.seconds_since(base) for key, time in times.items()}
        _check_span(meta, span)
        return cls(meta, epoch, base, span)

    @property
    def scale(self) -> str:
        return self.epoch.scale

    def segment(self, blocks: SegmentBlocks, unheld: Sequence[str]) -> OemSegment:
        """Return the segment."""
        t_s, rows, decimals = self._states(blocks)
        covariances = self._covariances(blocks.covariances)
        method, degree = self._interpolation(t_s.size)
        extras = list(unheld)
        if blocks.other_comments or len(blocks.comments) > 1:
            extras.insert(0, "comments")
        printed = [entry.value for block in blocks.covariances for entry in block.entries[:1]]
        printed += [entry.value for key, entry in self.meta.items() if key.endswith("_TIME")]
        digits = max(decimals, *map(_decimals, printed))
        if digits > 9:
            extras.append("digits of the times below 1 ns")
        meta, span = self.meta, self.span
        frame_epoch = meta.get("REF_FRAME_EPOCH")
        comment = blocks.comments[0] if len(blocks.comments) == 1 else ""
        return OemSegment(
            object_name=meta["OBJECT_NAME"].value,
            object_id=meta["OBJECT_ID"].value,
            center_name=meta["CENTER_NAME"].value,
            ref_frame=meta["REF_FRAME"].value.upper(),
            epoch=self.epoch,
            t_s=t_s,
            x=rows[:6],
            comment=comment if comment.isprintable() else "",
            passed_over=tuple(dict.fromkeys(extras)),
            accelerations_m_s2=rows[6:] if rows.shape[0] == 9 else None,
            covariances=covariances,
            start_s=span["START_TIME"],
            stop_s=span["STOP_TIME"],
            useable_start_s=span.get("USEABLE_START_TIME"),
            useable_stop_s=span.get("USEABLE_STOP_TIME"),
            interpolation=method,
            interpolation_degree=degree,
            ref_frame_epoch=frame_epoch and read_epoch(frame_epoch, self.scale),
            time_digits=min(max(digits, 6), 9),
        )

    def _states(self, segment: SegmentBlocks) -> tuple[Array, Array, int]:
        """Return times (K,), components (6 or 9, K) and the decimals of the times."""
        blocks = segment.states
        if segment.lines:
            width = len(blocks[0].entries) - 1
            t_s, rows, decimals = self._read_states(blocks)
            # days of UT1 have their own length each
            parsed = (
                None
                if self.scale == "UT1"
                else parse_states(segment.lines, width, self.scale, self.base)
            )
            if parsed is not None:
                t_s = np.concatenate([t_s, parsed[0]])
                within = self.span["START_TIME"] <= t_s[0] and t_s[-1] <= self.span["STOP_TIME"]
                if within and (np.diff(t_s) > 0.0).all():
                    return t_s, np.hstack([rows, parsed[1]]), max(decimals, parsed[2])
            # What is wrong, or of another form, is found line by line.
            where = segment.metadata.place.rpartition(":")[0]
            blocks = blocks + [
                read_state_line(f"{where}:{number}", line)
                for number, line in zip(segment.numbers, segment.lines, strict=True)
            ]
        return self._read_states(blocks)

    def _read_states(self, blocks: Sequence[Block]) -> tuple[Array, Array, int]:
        """Return times, components and decimals of states that are taken apart."""
        decimals = 0
        times: list[float] = []
        rows: list[list[float]] = []
        width = len(blocks[0].entries)
        plain = [b.entries[0].value for b in blocks if _is_row(b)]
        known = plain_seconds(plain, self.base, self.scale) if len(plain) == len(blocks) else None
        for number, block in enumerate(blocks):
            if known is not None:
                entries = {entry.key: entry for entry in block.entries}
            else:
                entries = order_entries(
                    block.entries, ("EPOCH", *STATE, *ACCELERATION), ("EPOCH", *STATE), "a state",
                    block.end,
                )  # fmt: skip
            if len(entries) not in (7, 10):
                raise InputError(
                    f"{block.place}: a state has all of {', '.join(ACCELERATION)} or none"
                )
            if len(entries) != width:
                raise InputError(
                    f"{block.place}: expected {width - 1} numbers as in the first state of the "
                    f"segment ({blocks[0].place}), got {len(entries) - 1}"
                )
            instant = None if known is None else float(known[number])
            decimals = max(decimals, _decimals(entries["EPOCH"].value))
            times.append(self._instant(entries.pop("EPOCH"), times, "state", instant))
            rows.append([read_number(entry, UNITS[key], 3) for key, entry in entries.items()])
        return np.array(times), np.array(rows).T, decimals

    def _instant(
        self, entry: Entry, before: Sequence[float], what: str, instant: float | None = None
    ) -> float:
        """Return a time that follows those before it, within the span of the segment."""
        if instant is None:
            instant = read_epoch(entry, self.scale).seconds_since(self.base)
        if before and instant <= before[-1]:
            fault = "is that of" if instant == before[-1] else "is before that of"
            raise InputError(
                f"{entry.place}: EPOCH {entry.value} {fault} the {what} above; expected times in "
                "rising order"
            )
        if not self.span["START_TIME"] <= instant <= self.span["STOP_TIME"]:
            raise InputError(
                f"{entry.place}: EPOCH {entry.value} is not between START_TIME "
                f"({self.meta['START_TIME'].value}) and STOP_TIME ({self.meta['STOP_TIME'].value})"
            )
        return instant

    def _covariances(self, blocks: Sequence[Block]) -> tuple[OemCovariance, ...]:
        times: list[float] = []
        covariances = []
        for block in blocks:
            entries = order_entries(
                block.entries, ("EPOCH", "COV_REF_FRAME", *TRIANGLE), ("EPOCH", *TRIANGLE),
                "a covariance", block.end,
            )  # fmt: skip
            times.append(self._instant(entries["EPOCH"], times, "covariance"))
            frame = entries.get("COV_REF_FRAME")
            if frame is not None:
                check_moving_frame(frame)
            matrix = read_triangle(entries, UNITS)
            name = frame.value.upper() if frame else ""
            covariances.append(OemCovariance(times[-1], matrix, name))
        return tuple(covariances)

    def _interpolation(self, states: int) -> tuple[str, int | None]:
        method, degree = self.meta.get("INTERPOLATION"), self.meta.get("INTERPOLATION_DEGREE")
        if method is None:
            if degree is not None:
                raise InputError(
                    f"{degree.place}: INTERPOLATION_DEGREE needs INTERPOLATION before it: "
                    f"{', '.join(INTERPOLATIONS)}"
                )
            return "", None
        check_word(method, INTERPOLATIONS.__contains__, INTERPOLATIONS, "method")
        name = method.value.upper()
        if degree is None:
            if name != "PROPAGATE":
                raise InputError(
                    f"{method.place}: INTERPOLATION needs an INTERPOLATION_DEGREE after it"
                )
            return name, None
        if not re.fullmatch(r"0*[1-9]\d{0,3}", degree.value, re.ASCII):
            raise InputError(
                f"{degree.place}: INTERPOLATION_DEGREE must be a whole number above 0, got "
                f"{degree.value[:40]!r}"
            )
        value = int(degree.value)
        if name != "PROPAGATE" and (needed := states_needed(name, value)) > states:
            raise InputError(
                f"{degree.place}: INTERPOLATION_DEGREE {value} ({name}) needs {needed} states, the "
                f"segment has {states}"
            )
        return name, value


def _is_row(block: Block) -> bool:
    """Return whether a state has its keywords in order, with values: all that text (KVN) has."""
    keys = tuple(entry.key for entry in block.entries)
    return keys in _ROWS and all(entry.value for entry in block.entries)


def _check_span(meta: Mapping[str, Entry], span: Mapping[str, float]) -> None:
    """Check that the useable span lies within the whole one."""
    last = "START_TIME"
    for key in METADATA:
        if key not in span:
            continue
        if span[key] < span[last]:
            entry = meta[key]
            raise InputError(
                f"{entry.place}: {key} {entry.value} is before {last} ({meta[last].value}); "
                "expected START_TIME ≤ USEABLE_START_TIME ≤ USEABLE_STOP_TIME ≤ STOP_TIME"
            )
        last = key


def _first(block: Block, key: str) -> Entry:
    for entry in block.entries:
        if entry.key == key:
            return entry
    raise InputError(f"{block.end}: a state lacks {key}, which it must have")


def _decimals(time: str) -> int:
    """Return the number of decimals of a time, without zeros at its end."""
    match = _DIGITS.fullmatch(time[time.find(".") :]) if "." in time else None
    return len(match[1]) if match else 0
