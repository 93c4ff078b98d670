"""Records of a CCSDS Tracking Data Message, read and checked one at a time [1]_.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite, nan, radians
from types import MappingProxyType
from typing import NamedTuple

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import SCALES, Epoch
from hillsphere.formats.ccsds_times import read_ccsds_time
from hillsphere_tracking.tdm_entries import Entry, entries

__all__ = [
    "SCALAR", "AnglePair", "PairedAngles", "TdmMeta", "TdmRecord", "tdm_records",
    "tdm_records_and_faults",
]  # fmt: skip

SCALAR = MappingProxyType({"RANGE": 1e3, "DOPPLER_INSTANTANEOUS": 1e3, "DOPPLER_INTEGRATED": 1e3})
"""Supported keywords besides the angles, with their factors to SI (from km and km/s)."""
_ANGLES = ("ANGLE_1", "ANGLE_2")
_READ = (*_ANGLES, *SCALAR)
_PASSED_OVER = re.compile(
    r"CARRIER_POWER|CLOCK_(BIAS|DRIFT)|DOPPLER_COUNT|DOR|MAG|P[CR]_N0|PRESSURE|RCS"
    r"|RECEIVE_(FREQ(_[1-5])?|PHASE_CT_[1-5])|RHUMIDITY|STEC|TEMPERATURE"
    r"|TRANSMIT_(FREQ(_RATE)?|PHASE_CT)_[1-5]|TROPO_(DRY|WET)|VLBI_DELAY"
)
_PARTICIPANT = re.compile(r"PARTICIPANT_([1-5])")


@dataclass(frozen=True)
class TdmMeta:
    """Metadata of a segment.

    Parameters
    ----------
    participants : tuple of str
        Stations and spacecraft, in the order of their numbers 1, 2, …
    path : tuple of int
        Numbers of the participants along the path of the signal; empty if it is not given.
    time_system : str
        Time scale of the data, one of `hillsphere.time.SCALES`.
    fields : mapping of str to str
        All keywords of the metadata with their text.
    """

    participants: tuple[str, ...]
    path: tuple[int, ...] = ()
    time_system: str = "UTC"
    fields: Mapping[str, str] = field(default_factory=dict)

    @property
    def station(self) -> str:
        """The receiving participant, which measures the angles; the first one without a path."""
        return self.participants[self.path[-1] - 1 if self.path else 0]


class TdmRecord(NamedTuple):
    """One measured number: file and line, metadata, keyword, time and value (rad, m or m/s)."""

    place: str
    meta: TdmMeta
    keyword: str
    epoch: Epoch
    value: float


class AnglePair(NamedTuple):
    """Azimuth from north eastwards and elevation at one time, rad."""

    place: str
    meta: TdmMeta
    epoch: Epoch
    azimuth_rad: float
    elevation_rad: float


class PairedAngles:
    """Pairs each ANGLE_1 with the ANGLE_2 of the same time.

    The two keywords may alternate, or all values of one may precede all values of the other.

    Parameters
    ----------
    tell : callable, optional
        Receives the error of an angle without a partner; by default the error is raised.
    """

    def __init__(self, tell: Callable[[InputError], None] | None = None) -> None:
        self._waiting: deque[TdmRecord] = deque()
        self._tell = tell

    def add(self, record: TdmRecord) -> AnglePair | None:
        """Add a record; return the pair that it completes, or None.

        Raises
        ------
        InputError
            If an angle has no partner and no callback was given.
        """
        waiting = self._waiting
        if waiting and waiting[0].meta is not record.meta:
            self.finish()
        if record.keyword not in _ANGLES:
            return None
        while waiting and waiting[0].keyword != record.keyword:
            other = waiting[0]
            apart = record.epoch.seconds_since(other.epoch)
            # Times rise within a keyword, so that the earlier of the two can have no partner any
            # more. Equal times are equal to 1 ns: messages give microseconds.
            if apart < -1e-9:
                self._report_unpaired(record)
                return None
            waiting.popleft()
            if apart <= 1e-9:
                angles = {r.keyword: r.value for r in (other, record)}
                return AnglePair(
                    record.place, record.meta, record.epoch, angles["ANGLE_1"], angles["ANGLE_2"]
                )
            self._report_unpaired(other)
        waiting.append(record)
        return None

    def finish(self) -> None:
        """Report the angles that have no partner at the end of the data, as `add` does."""
        while self._waiting:
            self._report_unpaired(self._waiting.popleft())

    def _report_unpaired(self, record: TdmRecord) -> None:
        fault = _unpaired_error(record)
        if self._tell is None:
            raise fault
        self._tell(fault)


def _unpaired_error(record: TdmRecord) -> InputError:
    other = _ANGLES[record.keyword == _ANGLES[0]]
    return InputError(
        f"{record.place}: {record.keyword} has no {other} of the same time; both are needed"
    )


def tdm_records(lines: Iterable[str], where: str = "TDM") -> Iterator[TdmRecord]:
    """Yield the records of a message, each as soon as it is complete.

    Other keywords of the standard (power, weather, clocks …) are skipped.

    Parameters
    ----------
    lines : iterable of str
        The message; may be a stream that is still being written.
    where : str
        Name of the file, used in error messages.

    Yields
    ------
    TdmRecord
        Angles in rad, ranges in m, range rates in m/s, with the corrections of the metadata.

    Raises
    ------
    InputError
        If the text is not such a message, a keyword is missing or unknown, the angle type is not
        AZEL, the time system or unit is not supported, a value is not finite or out of range, or
        times do not increase. The message names file and line.
    """
    meta: TdmMeta | None = None
    latest: dict[str, Epoch] = {}
    for record in tdm_records_and_faults(lines, where):
        if isinstance(record, InputError):
            raise record
        if record.meta is not meta:
            latest, meta = {}, record.meta
        before = latest.get(record.keyword)
        if before is not None and (step := record.epoch.seconds_since(before)) <= 0.0:
            fault = (
                "same time as the record before it"
                if step == 0.0
                else (f"{-step:.6g} s earlier than the record before it")
            )
            raise InputError(
                f"{record.place}: {record.keyword}: {fault}; times of a keyword must rise"
            )
        latest[record.keyword] = record.epoch
        yield record


def tdm_records_and_faults(
    lines: Iterable[str], where: str = "TDM"
) -> Iterator[TdmRecord | InputError]:
    """Yield the records of a message like `tdm_records`, and errors for bad data lines.

    Parameters
    ----------
    lines : iterable of str
        The message.
    where : str
        Name of the file, used in error messages.

    Yields
    ------
    TdmRecord or InputError
        Records in the order of the message, with unchecked order of times, and an error for each
        invalid data line.

    Raises
    ------
    InputError
        If the metadata or the structure is invalid: the rest cannot be interpreted then.
    """
    state = ""
    version = False
    gathered: dict[str, str] = {}
    meta: TdmMeta | None = None
    place = where
    for entry in entries(lines, where):
        place, key = entry.place, entry.key
        if key == "CCSDS_TDM_VERS":
            version = True
            if entry.value not in ("1.0", "2.0"):
                raise InputError(f"{place}: version {entry.value!r}; 1.0 and 2.0 are read")
        elif not version:
            raise InputError(
                f"{place}: not a tracking data message: CCSDS_TDM_VERS must come first"
            )
        elif key == "META_START":
            state, gathered, meta = key, {}, None
        elif key == "META_STOP":
            state, meta = key, _meta(gathered, place)
        elif key in ("DATA_START", "DATA_STOP"):
            if meta is None:
                raise InputError(f"{place}: {key} without metadata before it")
            state = key
        elif state == "META_START":
            if key in gathered:
                raise InputError(f"{place}: {key} occurs twice; keep one")
            gathered[key] = entry.value
        elif state == "DATA_START" and meta is not None:
            try:
                record = _record(entry, meta)
            except InputError as error:
                yield error
                continue
            if record is not None:
                yield record
        elif state:
            raise InputError(f"{place}: {key} is outside the metadata and the data")
    if meta is None:
        raise InputError(f"{place}: not a tracking data message: it ends before any data")


def _meta(fields: dict[str, str], place: str) -> TdmMeta:
    scale = fields.get("TIME_SYSTEM", "")
    if scale not in SCALES:
        raise InputError(
            f"{place}: TIME_SYSTEM {scale!r} cannot be read; known: {', '.join(SCALES)}"
        )
    numbered = {
        int(m.group(1)): name for key, name in fields.items() if (m := _PARTICIPANT.fullmatch(key))
    }
    if not numbered or sorted(numbered) != list(range(1, len(numbered) + 1)):
        raise InputError(f"{place}: the metadata must name PARTICIPANT_1, PARTICIPANT_2, …")
    path = fields.get("PATH", "")
    words = [word.strip() for word in path.split(",")] if path else []
    if any(not word.isdigit() or int(word) not in numbered for word in words):
        raise InputError(f"{place}: PATH must list numbers of participants, got {path!r}")
    names = tuple(numbered[n] for n in sorted(numbered))
    return TdmMeta(names, tuple(int(word) for word in words), scale, MappingProxyType(fields))


def _record(entry: Entry, meta: TdmMeta) -> TdmRecord | None:
    place, key = entry.place, entry.key
    if key not in _READ:
        if _PASSED_OVER.fullmatch(key):
            return None
        raise InputError(
            f"{place}: no data keyword {key[:40]!r} in a tracking data message"
            f"{did_you_mean(key, _READ, otherwise='read')}"
        )
    words = entry.value.split()
    if len(words) != 2:
        raise InputError(f"{place}: {key}: expected a time and a number, got {entry.value[:60]!r}")
    epoch = _epoch(words[0], meta.time_system, place)
    value = _number(words[1], key, place) + _correction(key, meta, place)
    if key in _ANGLES:
        _check_angle(key, value, meta, place)
        return TdmRecord(place, meta, key, epoch, radians(value))
    unit = meta.fields.get("RANGE_UNITS", "km")
    if key == "RANGE" and unit != "km":
        raise InputError(f"{place}: RANGE_UNITS = {unit} cannot be read, only km; convert them")
    return TdmRecord(place, meta, key, epoch, value * SCALAR[key])


def _check_angle(key: str, value: float, meta: TdmMeta, place: str) -> None:
    kind = meta.fields.get("ANGLE_TYPE", "")
    if kind.upper() != "AZEL":
        raise InputError(
            f"{place}: ANGLE_TYPE = {kind or '(missing)'}: only azimuth and elevation, AZEL, are "
            "read; convert the angles"
        )
    what, low, high = ("azimuth", -180.0, 360.0) if key == "ANGLE_1" else ("elevation", -90.0, 90.0)
    if not low <= value <= high:
        raise InputError(
            f"{place}: {key}: {what} must be from {low:g}° to {high:g}°, got {value:.10g}°"
        )


def _correction(key: str, meta: TdmMeta, place: str) -> float:
    """Return the correction that must be added to a value, in the unit of the message.

    The metadata give a correction and say whether the data contain it already (0 then).
    """
    name = f"CORRECTION_{'DOPPLER' if key.startswith('DOPPLER') else key}"
    if name not in meta.fields:
        return 0.0
    applied = meta.fields.get("CORRECTIONS_APPLIED", "").upper()
    if applied not in ("YES", "NO"):
        raise InputError(f"{place}: {name} needs CORRECTIONS_APPLIED = YES or NO in the metadata")
    return 0.0 if applied == "YES" else _number(meta.fields[name], name, place)


def _number(text: str, what: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(value):
        raise InputError(f"{place}: {what}: expected a finite number, got {text[:40]!r}")
    return value


def _epoch(text: str, scale: str, place: str) -> Epoch:
    try:
        return read_ccsds_time(text, scale)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
