"""Records of a Tracking Data Message turned into arrays, many at a time.

A batch of records is checked and converted as arrays. Where an array shows anything that is not
plain, the batch is read record by record instead, as a message that arrives line by line is: that
says which line is at fault, and what is unusual but right comes out as it should.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from datetime import date
from math import inf, isfinite
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import erfa
import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, read_scaled
from hillsphere.formats.ccsds_times import date_of_day
from hillsphere.formats.tdm_keywords import DATA, power_of
from hillsphere.formats.tdm_reading import TdmRecord, limits_of, read_record
from hillsphere.formats.tdm_segments import Series, TdmHeader, TdmMeta, TdmSegment

__all__ = ["Columns"]

_BATCH = 1 << 14
"""Records that are converted at once: enough for arrays to pay, few enough to need little room."""
_PLAIN = re.compile(r"[0-9.+\-]*", re.ASCII)
"""Characters of numbers without an exponent; `float` judges their order."""
_ZERO, _NINE = ord("0"), ord("9")


_Row: TypeAlias = tuple[int | str, str, str, str, str]
"""Line or ``"file:line"``, keyword, time, number, and unit of an attribute."""
_Part: TypeAlias = tuple[Array, Array, Array, NDArray[np.bytes_]]
"""Two parts of Julian dates, values, and digits of counts."""


class _Times(NamedTuple):
    """Two-part Julian dates (K,), and the decimals of their seconds."""

    day: Array
    fraction: Array
    digits: int


class Columns:
    """Collector of the records of a segment.

    Parameters
    ----------
    meta : TdmMeta
        Its metadata.
    where : str
        Name of the file.
    leniency : Leniency
        What is done about harmless departures.
    """

    def __init__(self, meta: TdmMeta, where: str, leniency: Leniency) -> None:
        self._meta, self._where, self._leniency = meta, where, leniency
        self._rows: list[_Row] = []
        self._parts: dict[str, list[_Part]] = {}
        self._scale = meta.time_system
        self._last: dict[str, tuple[float, float]] = {}
        self._digits = 0

    def add(self, place: int | str, key: str, time: str, value: str, unit: str = "") -> None:
        """Add a record; `place` is its line, or ``"file:line"``.

        Raises
        ------
        InputError
            If a record so far is not as the standard prescribes; the message names its line.
        """
        self._rows.append((place, key, time, value, unit))
        if len(self._rows) >= _BATCH:
            self._convert()

    def flush(self) -> None:
        """Read what has been added so far.

        Raises
        ------
        InputError
            As for `add`.
        """
        if self._rows:
            self._convert()

    def finish(self, header: TdmHeader, comments: Sequence[str]) -> TdmSegment | None:
        """Return the segment; None if it has no series.

        Raises
        ------
        InputError
            As for `add`.
        """
        self.flush()
        if not self._parts:
            return None
        whole = {
            key: [np.concatenate(columns) for columns in zip(*parts, strict=True)]
            for key, parts in self._parts.items()
        }
        self._parts = {}
        first = min(whole, key=lambda key: whole[key][0][0] + whole[key][1][0])
        epoch = Epoch(float(whole[first][0][0]), float(whole[first][1][0]), self._scale)
        series, counts = {}, {}
        for key in sorted(whole, key=list(DATA).index):
            day, fraction, values, texts = whole.pop(key)
            series[key] = Series(_seconds_since(day, fraction, epoch), values)
            if DATA[key].is_count:
                counts[key] = texts
        return TdmSegment(
            self._meta, epoch, MappingProxyType(series), tuple(comments), MappingProxyType(counts),
            header, min(max(self._digits, 6), 9),
        )  # fmt: skip

    def _convert(self) -> None:
        rows, self._rows = self._rows, []
        converted = self._convert_arrays(rows)
        for key, part in (self._convert_each(rows) if converted is None else converted).items():
            self._parts.setdefault(key, []).append(part)
            self._last[key] = (float(part[0][-1]), float(part[1][-1]))

    def _convert_arrays(self, rows: Sequence[_Row]) -> dict[str, _Part] | None:
        """Return the batch by keyword; None if anything in it is not plain."""
        groups: dict[str, tuple[list[str], list[str]]] = {}
        for _, key, time, value, unit in rows:
            if unit or key not in DATA:
                return None
            times, values = groups.setdefault(key, ([], []))
            times.append(time)
            values.append(value)
        parts = {}
        digits = self._digits
        for key, (tags, texts) in groups.items():
            when = _plain_times(tags, self._meta.time_system)
            numbers = _plain_values(key, texts, self._meta)
            if when is None or numbers is None:
                return None
            day, fraction, decimals = when
            if not self._rise(key, day, fraction):
                return None
            digits = max(digits, decimals)
            parts[key] = (day, fraction, numbers, _digits_of(key, texts))
        self._digits = digits
        return parts

    def _rise(self, key: str, day: Array, fraction: Array) -> bool:
        steps = np.diff(day) + np.diff(fraction)
        last = self._last.get(key)
        return bool(np.all(steps > 0.0)) and (
            last is None or (day[0] - last[0]) + (fraction[0] - last[1]) > 0.0
        )

    def _is_later(self, record: TdmRecord, before: Epoch) -> bool:
        step = record.epoch.seconds_since(before)
        if step > 0.0:
            return True
        must = "times of a keyword must rise"
        which = f"{record.place}: {record.keyword}:"
        if step < 0.0:
            raise InputError(f"{which} {-step:.6g} s earlier than the record before it; {must}")
        self._leniency.tolerate(
            f"{which} same time as the record before it; "
            + (must if self._leniency.strict else "it is left out")
        )
        return False

    def _convert_each(self, rows: Sequence[_Row]) -> dict[str, _Part]:
        """Return the batch by keyword, read record by record."""
        records: dict[str, list[TdmRecord]] = {}
        last = {key: Epoch(*pair, self._scale) for key, pair in self._last.items()}
        for where, key, time, value, unit in rows:
            place = f"{self._where}:{where}" if isinstance(where, int) else where
            entry = Entry(place, key, f"{time} {value}", unit)
            record = read_record(entry, self._meta, self._leniency)
            if record is None:
                continue
            if key in last and not self._is_later(record, last[key]):
                continue
            last[key] = record.epoch
            records.setdefault(key, []).append(record)
            self._digits = max(self._digits, _decimals(time))
        return {
            key: (
                np.array([record.epoch.day for record in some]),
                np.array([record.epoch.fraction for record in some]),
                np.array([record.value for record in some]),
                _digits_of(key, [record.text for record in some]),
            )
            for key, some in records.items()
        }


def _digits_of(key: str, texts: list[str]) -> NDArray[np.bytes_]:
    """Return the digits of counts; nothing for other keywords."""
    return np.array(texts if DATA[key].is_count else [], dtype=np.bytes_)


def _decimals(time: str) -> int:
    return len(time.rstrip("Z").partition(".")[2].rstrip("0"))


def _seconds_since(day: Array, fraction: Array, epoch: Epoch) -> Array:
    """Return SI seconds since an epoch, by the steps of `Epoch.seconds_since`."""
    if epoch.scale == "UT1":
        times = zip(day, fraction, strict=True)
        return np.array([Epoch(float(d), float(f), "UT1").seconds_since(epoch) for d, f in times])
    if epoch.scale == "UTC":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            day, fraction = erfa.tttai(*erfa.taitt(*erfa.utctai(day, fraction)))
        epoch = epoch.to("TAI")
    return np.asarray(((day - epoch.day) + (fraction - epoch.fraction)) * DAY_S)


def _plain_values(key: str, texts: Sequence[str], meta: TdmMeta) -> Array | None:
    """Return the values of a keyword in SI; None if any is not plain."""
    try:
        numbers = np.array([float(text) for text in texts])
    except ValueError:
        return None
    plain = _PLAIN.fullmatch("".join(texts)) is not None
    if not plain and (
        DATA[key].is_count or not all(isfinite(read_scaled(text, 0)) for text in texts)
    ):
        return None
    least, most, is_above = limits_of(key, meta)
    low, high = numbers.min(), numbers.max()
    # 360° itself is tolerated or not; a number beyond the doubles is none
    if not (least <= low and high <= most) or (is_above and low == least) or high in (360.0, inf):
        return None
    if key == "DOPPLER_COUNT" and np.any(numbers != np.round(numbers)):
        return None
    if DATA[key].unit == "deg":
        return np.asarray(np.radians(numbers))
    power = power_of(key, meta)
    if power == 0:
        return numbers
    # rounded once, as by `read_scaled`
    end = f"e{power}"
    scaled = [float(t + end) for t in texts] if plain else [read_scaled(t, power) for t in texts]
    values = np.array(scaled)
    return values if np.all(np.isfinite(values)) else None


def _plain_times(texts: Sequence[str], system: str) -> _Times | None:
    """Return times; None if any is unusual or wrong."""
    if system == "UT1":  # known within the span of a table only
        return None
    try:
        table = np.array(texts, dtype=np.bytes_)
    except UnicodeEncodeError:
        return None
    letters = table.view(np.uint8).reshape(table.size, table.itemsize)
    by_day = letters.shape[1] > 8 and letters[0, 8] == ord("T")
    form = "0000-000T00:00:00" if by_day else "0000-00-00T00:00:00"
    count = len(form)
    if letters.shape[1] < count:
        return None
    for number, letter in enumerate(form):
        column = letters[:, number]
        if letter == "0":
            if column.min() < _ZERO or column.max() > _NINE:
                return None
        elif np.any(column != ord(letter)):
            return None
    tail = _plain_tail(letters[:, count:], system)
    if tail is None:
        return None

    def number_at(first: int, width: int) -> NDArray[np.int64]:
        digits = letters[:, first : first + width].astype(np.int64) - _ZERO
        return np.asarray(digits @ 10 ** np.arange(width - 1, -1, -1))

    hour, minute = number_at(count - 8, 2), number_at(count - 5, 2)
    seconds = np.concatenate([letters[:, count - 2 : count], tail], axis=1)
    second = np.ascontiguousarray(seconds).view(f"S{seconds.shape[1]}")[:, 0].astype(float)
    if hour.max() > 23 or minute.max() > 59 or second.max() >= 60.0:
        return None
    width = 3 if by_day else 5
    days, index = np.unique(
        letters[:, : 5 + width].copy().view(f"S{5 + width}"), return_inverse=True
    )
    try:
        dates = [_date(day.decode(), by_day) for day in days.tolist()]
    except (ValueError, InputError):
        return None
    year, month, of_month = np.array([(d.year, d.month, d.day) for d in dates])[index.ravel()].T
    with warnings.catch_warnings():
        # a UTC date beyond the last leap second announced is "dubious", not wrong
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        day, fraction = erfa.dtf2d(system, year, month, of_month, hour, minute, second)
    used = np.flatnonzero(np.any(tail > _ZERO, axis=0))
    return _Times(day, fraction, int(used[-1]) if used.size else 0)


def _plain_tail(tail: NDArray[np.uint8], system: str) -> NDArray[np.uint8] | None:
    """Return the decimals after whole seconds without a Z; None if they are not plain."""
    is_z = tail == ord("Z")
    if np.any(is_z):
        if system != "UTC" or np.any(is_z[:, :-1] & (tail[:, 1:] != 0)):
            return None
        tail = np.where(is_z, 0, tail).astype(np.uint8)
    if not tail.shape[1]:
        return tail
    has_point = tail[:, 0] == ord(".")
    if tail.shape[1] > 13 or np.any(~has_point & (tail[:, 0] != 0)):
        return None
    rest = tail[:, 1:]
    if np.any(has_point) and (not rest.shape[1] or np.any(rest[has_point, 0] == 0)):
        return None
    is_digit = (rest >= _ZERO) & (rest <= _NINE)
    ends = np.any(is_digit[:, 1:] & ~is_digit[:, :-1])  # a digit after the end of the text
    return None if ends or np.any(~is_digit & (rest != 0)) or np.any(rest[~has_point]) else tail


def _date(text: str, by_day: bool) -> date:
    if by_day:
        return date_of_day(int(text[:4]), int(text[5:8]))
    return date(int(text[:4]), int(text[5:7]), int(text[8:10]))
