"""Reader of the metadata of a Tracking Data Message.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 3.3 and 4.3.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import inf, isfinite, radians
from types import MappingProxyType

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import SCALES, Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, read_scaled
from hillsphere.formats.ccsds_times import read_ccsds_time
from hillsphere.formats.oem_segments import hint_of_frame, is_frame
from hillsphere.formats.tdm_keywords import DATA, METADATA, WORDS, power_of
from hillsphere.formats.tdm_segments import TdmMeta

__all__ = ["check_text", "gather", "read_meta", "read_time_tag"]

_OTHER_SCALES = ("GMST", "MET", "MRT", "SCLK")
"""Time systems of the registry that `Epoch` does not have."""
_TIME = re.compile(r"(\d{4}-(?:\d\d-\d\d|\d{3})T\d\d:\d\d:\d\d(?:\.\d{1,12})?)\d*(Z?)", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,10}", re.ASCII)
_PATH = re.compile(r"[1-5](,[1-5])+", re.ASCII)


def read_time_tag(text: str, system: str, place: str, key: str, leniency: Leniency) -> Epoch:
    """Read a time of the data; digits beyond a picosecond are left out.

    Parameters
    ----------
    text : str
        The time.
    system : str
        Time system of the metadata.
    place, key : str
        Where it stands, for messages.
    leniency : Leniency
        What is done about a ``Z`` after a time that is not in UTC.

    Returns
    -------
    Epoch
        The instant, in the time system.

    Raises
    ------
    InputError
        If it is no time of the standard's two forms.
    """
    match = _TIME.fullmatch(text)
    if match is None:
        raise InputError(
            f"{place}: {key}: expected a time such as 2026-11-21T09:00:00.5 or "
            f"2026-325T09:00:00.5, got {text[:40]!r}"
        )
    if match[2] and system != "UTC":
        leniency.tolerate(
            f"{place}: {key}: the Z after {text[:40]} says UTC, TIME_SYSTEM says {system}",
            f"Z {key}",
        )
    try:
        return read_ccsds_time(match[1], system)
    except InputError as error:
        raise InputError(f"{place}: {key}: {error}") from error


def gather(
    entries: Sequence[Entry], known: Sequence[str], what: str, leniency: Leniency
) -> dict[str, Entry]:
    """Return the entries of a block by keyword.

    Parameters
    ----------
    entries : sequence of Entry
        As they stand in the message.
    known : sequence of str
        Keywords of the block, in the order that the standard prescribes.
    what : str
        Name of the block, for messages.
    leniency : Leniency
        What is done about an unknown keyword and a wrong order.

    Raises
    ------
    InputError
        If a keyword occurs twice or has no value.
    """
    rank = {key: number for number, key in enumerate(known)}
    ordered: dict[str, Entry] = {}
    last = ""
    for entry in entries:
        place, key = entry.place, entry.key
        if key in ordered:
            raise InputError(f"{place}: {key} occurs twice in {what}; keep one")
        check_text(entry)
        ordered[key] = entry
        if key not in rank:
            hint = did_you_mean(key, known, otherwise="keywords")
            leniency.tolerate(f"{place}: {what} has no keyword {key[:60]!r}{hint}")
            continue
        if last and rank[key] < rank[last]:
            leniency.tolerate(f"{place}: {key} must stand before {last} in {what}")
        else:
            last = key
    return ordered


def check_text(entry: Entry) -> None:
    """Refuse an empty value, and one that could not be written as one line again."""
    if not entry.value:
        raise InputError(f"{entry.place}: {entry.key} has no value; expected one after it")
    if "=" in entry.value or not entry.value.isprintable():
        raise InputError(
            f"{entry.place}: {entry.key} must be printable text without '=', got "
            f"{entry.value[:40]!r}"
        )


def read_meta(
    entries: Sequence[Entry], comments: Sequence[str], end: str, leniency: Leniency
) -> TdmMeta:
    """Return the metadata of a segment.

    Parameters
    ----------
    entries : sequence of Entry
        As they stand in the message.
    comments : sequence of str
        The comments among them.
    end : str
        Where the metadata end: the place of what is missing.
    leniency : Leniency
        What is done about harmless departures.

    Raises
    ------
    InputError
        Naming the line and the keyword, at the first fault.
    """
    fields = _Fields(gather(entries, METADATA, "the metadata", leniency), end)
    system = _time_system(fields)
    participants = _participants(fields)
    mode, paths = _paths(fields, len(participants), leniency)
    units = fields.word("RANGE_UNITS") or "km"
    power = 3 if units == "km" else 0
    method, degree = fields.word("INTERPOLATION"), fields.whole("INTERPOLATION_DEGREE", 1)
    if method and degree is None:
        leniency.tolerate(f"{fields.place('INTERPOLATION')}: INTERPOLATION needs a degree after it")
    angles, frame = fields.word("ANGLE_TYPE"), _frame(fields)
    if (angles == "RADEC") != bool(frame):
        place = fields.place("REFERENCE_FRAME" if frame else "ANGLE_TYPE")
        leniency.tolerate(f"{place}: REFERENCE_FRAME and ANGLE_TYPE = RADEC must be given together")
    start, stop = _span(fields)
    bare = TdmMeta(participants, range_units=units)
    return TdmMeta(
        participants=participants,
        path=paths["PATH"],
        time_system=system,
        fields=MappingProxyType({key: entry.value for key, entry in fields.entries.items()}),
        path_1=paths["PATH_1"],
        path_2=paths["PATH_2"],
        mode=mode,
        timetag_ref=fields.word("TIMETAG_REF"),
        integration_interval_s=fields.number("INTEGRATION_INTERVAL", 0, above=0.0),
        integration_ref=fields.word("INTEGRATION_REF"),
        freq_offset_hz=fields.number("FREQ_OFFSET") or 0.0,
        range_mode=fields.word("RANGE_MODE"),
        range_modulus=fields.number("RANGE_MODULUS", power, least=0.0) or 0.0,
        range_units=units,
        angle_type=angles,
        reference_frame=frame,
        turnaround=_turnaround(fields),
        transmit_delays_s=_delays(fields, "TRANSMIT_DELAY", participants),
        receive_delays_s=_delays(fields, "RECEIVE_DELAY", participants),
        corrections=MappingProxyType(_corrections(fields, bare, leniency)),
        corrections_applied=fields.yes("CORRECTIONS_APPLIED"),
        data_quality=fields.word("DATA_QUALITY"),
        ephemeris_names=MappingProxyType(
            {n: entry.value for n, entry in fields.numbered("EPHEMERIS_NAME", participants).items()}
        ),
        interpolation=method,
        interpolation_degree=degree,
        data_types=_data_types(fields, leniency),
        start=start,
        stop=stop,
        track_id=fields.text("TRACK_ID"),
        transmit_band=fields.text("TRANSMIT_BAND"),
        receive_band=fields.text("RECEIVE_BAND"),
        doppler_count_bias_hz=fields.number("DOPPLER_COUNT_BIAS", least=0.0) or 0.0,
        doppler_count_scale=fields.whole("DOPPLER_COUNT_SCALE", 1) or 1,
        doppler_count_rollover=fields.yes("DOPPLER_COUNT_ROLLOVER"),
        comments=tuple(comments),
    )


class _Fields:
    """The entries of the metadata, and readers of their values."""

    def __init__(self, entries: Mapping[str, Entry], end: str) -> None:
        self.entries, self.end = entries, end

    def place(self, key: str) -> str:
        return self.entries[key].place if key in self.entries else self.end

    def text(self, key: str) -> str:
        return self.entries[key].value if key in self.entries else ""

    def word(self, key: str) -> str:
        """Return a word of the list of a keyword, or the empty text without it."""
        if key not in self.entries:
            return ""
        # an underscore is the same as a blank, and case does not matter
        given = re.sub(r"\s+", "_", self.text(key)).upper()
        for word in WORDS[key]:
            if word.upper() == given:
                return word
        hint = did_you_mean(given, WORDS[key])
        raise InputError(
            f"{self.place(key)}: {key} must be one of {', '.join(WORDS[key])}, got "
            f"{self.text(key)[:40]!r}{hint if 'mean' in hint else ''}"
        )

    def yes(self, key: str) -> bool | None:
        word = self.word(key)
        return word == "YES" if word else None

    def number(
        self, key: str, power: int = 0, *, least: float = -inf, above: float = -inf
    ) -> float | None:
        """Return a number times a power of ten, or None without it."""
        if key not in self.entries:
            return None
        value = read_scaled(self.text(key), power)
        if not isfinite(value):
            raise InputError(
                f"{self.place(key)}: {key}: expected a finite number, got {self.text(key)[:40]!r}"
            )
        if value < least or value <= above:
            limit = f"at least {least:g}" if isfinite(least) else f"above {above:g}"
            raise InputError(f"{self.place(key)}: {key} must be {limit}, got {self.text(key)[:40]}")
        return value

    def whole(self, key: str, least: int) -> int | None:
        if key not in self.entries:
            return None
        text = self.text(key)
        if not _INTEGER.fullmatch(text) or int(text) < least:
            raise InputError(
                f"{self.place(key)}: {key} must be a whole number of at least {least}, got "
                f"{text[:40]!r}"
            )
        return int(text)

    def numbered(self, key: str, participants: Sequence[str]) -> dict[int, Entry]:
        """Return the entries with the numbers of participants."""
        found = {n: self.entries[f"{key}_{n}"] for n in range(1, 6) if f"{key}_{n}" in self.entries}
        for n, entry in found.items():
            if n > len(participants):
                raise InputError(f"{entry.place}: {entry.key}: there is no PARTICIPANT_{n}")
        return found


def _time_system(fields: _Fields) -> str:
    place, given = fields.place("TIME_SYSTEM"), fields.text("TIME_SYSTEM")
    if not given:
        raise InputError(f"{place}: the metadata lack TIME_SYSTEM; known: {', '.join(SCALES)}")
    if given.upper() in SCALES:
        return given.upper()
    if given.upper() in _OTHER_SCALES:
        raise InputError(
            f"{place}: TIME_SYSTEM: the framework has no time system {given!r}; known: "
            f"{', '.join(SCALES)}"
        )
    raise InputError(
        f"{place}: TIME_SYSTEM: no time system {given[:40]!r}"
        f"{did_you_mean(given.upper(), SCALES, otherwise='known')}"
    )


def _participants(fields: _Fields) -> tuple[str, ...]:
    numbers = [n for n in range(1, 6) if f"PARTICIPANT_{n}" in fields.entries]
    if not numbers or numbers != list(range(1, len(numbers) + 1)):
        missing = next(n for n in range(1, 6) if n not in numbers)
        raise InputError(
            f"{fields.end}: the metadata lack PARTICIPANT_{missing}; participants are numbered 1, "
            "2, … without gaps"
        )
    return tuple(fields.text(f"PARTICIPANT_{n}") for n in numbers)


def _paths(
    fields: _Fields, count: int, leniency: Leniency
) -> tuple[str, dict[str, tuple[int, ...]]]:
    mode = fields.word("MODE")
    paths: dict[str, tuple[int, ...]] = {}
    for key in ("PATH", "PATH_1", "PATH_2"):
        text = fields.text(key)
        bare = "".join(text.split())
        paths[key] = ()
        if not text:
            continue
        if not _PATH.fullmatch(bare) or any(int(n) > count for n in bare.split(",")):
            raise InputError(
                f"{fields.place(key)}: {key} must list numbers of participants (1 to {count}) such "
                f"as 1,2,1, got {text[:40]!r}"
            )
        paths[key] = tuple(int(n) for n in bare.split(","))
        if any(a == b for a, b in zip(paths[key], paths[key][1:], strict=False)):
            raise InputError(
                f"{fields.place(key)}: {key} goes from a participant to itself: {text}"
            )
        if bare != text:
            leniency.tolerate(f"{fields.place(key)}: {key} must have no blanks, got {text[:40]!r}")
    expected = ("PATH_1", "PATH_2") if mode == "SINGLE_DIFF" else ("PATH",)
    for key in ("PATH", "PATH_1", "PATH_2"):
        if paths[key] and key not in expected:
            raise InputError(
                f"{fields.place(key)}: {key} does not belong to MODE = {mode or '(missing)'}; "
                f"expected {' and '.join(expected)}"
            )
        if mode and key in expected and not paths[key]:
            message = f"{fields.end}: MODE = {mode} needs {key} in the metadata"
            if mode == "SINGLE_DIFF":
                raise InputError(message)
            leniency.tolerate(message)
    return mode, paths


def _frame(fields: _Fields) -> str:
    frame = fields.text("REFERENCE_FRAME").upper()
    if frame and not is_frame(frame):
        raise InputError(
            f"{fields.place('REFERENCE_FRAME')}: REFERENCE_FRAME: no reference frame "
            f"{frame[:40]!r}{hint_of_frame(frame)}"
        )
    return frame


def _turnaround(fields: _Fields) -> tuple[int, int] | None:
    keys = ("TURNAROUND_NUMERATOR", "TURNAROUND_DENOMINATOR")
    up, down = (fields.whole(key, 1) for key in keys)
    if up is None and down is None:
        return None
    if up is None or down is None:
        given, missing = keys if down is None else keys[::-1]
        raise InputError(f"{fields.place(given)}: {given} needs {missing}")
    return up, down


def _delays(fields: _Fields, key: str, participants: Sequence[str]) -> Mapping[int, float]:
    return MappingProxyType(
        {
            n: fields.number(entry.key, least=0.0) or 0.0
            for n, entry in fields.numbered(key, participants).items()
        }
    )


def _corrections(fields: _Fields, meta: TdmMeta, leniency: Leniency) -> dict[str, float]:
    corrections = {}
    for key in METADATA:
        if not key.startswith("CORRECTION_") or key not in fields.entries:
            continue
        if "CORRECTIONS_APPLIED" not in fields.entries:
            leniency.tolerate(
                f"{fields.place(key)}: {key} needs CORRECTIONS_APPLIED = YES or NO in the metadata"
            )
        of = key.removeprefix("CORRECTION_")
        if of.startswith(("ANGLE", "ABERRATION")):
            corrections[key] = radians(fields.number(key) or 0.0)
        else:
            data = "DOPPLER_INTEGRATED" if of == "DOPPLER" else of
            power = power_of(data, meta) if data in DATA else 0
            corrections[key] = fields.number(key, power) or 0.0
    return corrections


def _data_types(fields: _Fields, leniency: Leniency) -> tuple[str, ...]:
    text = fields.text("DATA_TYPES")
    types = tuple(word.strip() for word in text.split(",")) if text else ()
    for word in types:
        if word.replace("_n", "_1") not in DATA:
            leniency.tolerate(
                f"{fields.place('DATA_TYPES')}: DATA_TYPES: no data keyword {word[:40]!r}"
                f"{did_you_mean(word, DATA, otherwise='known')}"
            )
    return types


def _span(fields: _Fields) -> tuple[Epoch | None, Epoch | None]:
    """Return the span of the data, which the standard gives in UTC whatever the time system."""
    span = [
        read_time_tag(fields.text(key), "UTC", fields.place(key), key, Leniency())
        if key in fields.entries
        else None
        for key in ("START_TIME", "STOP_TIME")
    ]
    start, stop = span
    if start is not None and stop is not None and stop.seconds_since(start) < 0.0:
        raise InputError(
            f"{fields.place('STOP_TIME')}: STOP_TIME {fields.text('STOP_TIME')} is before "
            f"START_TIME {fields.text('START_TIME')}"
        )
    return start, stop
