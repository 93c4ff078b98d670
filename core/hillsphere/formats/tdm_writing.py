"""Writer of Tracking Data Messages as text (KVN) and XML.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 3 to 5.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from math import degrees, isfinite, nextafter, pi, radians
from xml.sax.saxutils import escape

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import Epoch
from hillsphere.formats.ccsds_entries import write_scaled
from hillsphere.formats.tdm_keywords import DATA, METADATA, power_of
from hillsphere.formats.tdm_segments import TdmHeader, TdmMeta, TdmSegment

__all__ = ["header_of", "kvn_lines", "xml_lines"]

_ONE_LINE = re.compile(r"[^=]*[^=\s][^=]*")
_SEARCHED = 3
"""Doubles on either side of an angle in degrees among which the one that comes back is looked for:
the two roundings of a conversion to degrees and back move it by less."""


def header_of(
    segments: Sequence[TdmSegment], originator: str | None, created: datetime | None
) -> TdmHeader:
    """Return the header of a message that is to be written."""
    if not segments:
        raise InputError("a tracking data message needs at least one segment")
    first = segments[0].header
    stamp = (created or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    name = originator if originator is not None else first.originator or "HILLSPHERE"
    return TdmHeader("2.0", stamp, name, first.message_id, first.comments)


def kvn_lines(header: TdmHeader, segments: Sequence[TdmSegment]) -> Iterator[str]:
    """Yield the lines of a message as text.

    Raises
    ------
    InputError
        If a segment cannot be written; the message says which.
    """
    yield f"CCSDS_TDM_VERS = {header.version}"
    yield from _comments(header.comments)
    for key, value in _header_pairs(header):
        yield f"{key} = {value}"
    for number, segment in enumerate(segments, start=1):
        what = f"segment {number}"
        yield ""
        yield "META_START"
        yield from _comments(segment.meta.comments)
        for key, value in _metadata(segment, what):
            yield f"{key} = {value}"
        yield from ("META_STOP", "", "DATA_START")
        yield from _comments(segment.comments)
        for key, time, value in _records(segment, what):
            yield f"{key} = {time} {value}"
        yield "DATA_STOP"


def xml_lines(header: TdmHeader, segments: Sequence[TdmSegment]) -> Iterator[str]:
    """Yield the lines of a message in XML, as `kvn_lines` those of text."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield (
        '<tdm xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation='
        '"https://sanaregistry.org/r/ndmxml_unqualified/ndmxml-2.0.0-master-2.0.xsd" '
        f'id="CCSDS_TDM_VERS" version="{header.version}">'
    )
    yield "<header>"
    yield from _elements([("COMMENT", text) for text in _one_line_each(header.comments)])
    yield from _elements(_header_pairs(header))
    yield from ("</header>", "<body>")
    for number, segment in enumerate(segments, start=1):
        what = f"segment {number}"
        yield from ("<segment>", "<metadata>")
        yield from _elements([("COMMENT", text) for text in _one_line_each(segment.meta.comments)])
        yield from _elements(_metadata(segment, what))
        yield from ("</metadata>", "<data>")
        yield from _elements([("COMMENT", text) for text in _one_line_each(segment.comments)])
        for key, time, value in _records(segment, what):
            yield f"<observation><EPOCH>{time}</EPOCH><{key}>{value}</{key}></observation>"
        yield from ("</data>", "</segment>")
    yield from ("</body>", "</tdm>")


def _elements(pairs: Sequence[tuple[str, str]]) -> Iterator[str]:
    for key, value in pairs:
        yield f"<{key}>{escape(value)}</{key}>"


def _comments(comments: Sequence[str]) -> Iterator[str]:
    for text in _one_line_each(comments):
        yield f"COMMENT {text}".rstrip()


def _one_line_each(comments: Sequence[str]) -> Sequence[str]:
    for text in comments:
        if not text.isprintable():
            raise InputError(f"a comment must be one line of text, got {text[:60]!r}")
    return comments


def _header_pairs(header: TdmHeader) -> list[tuple[str, str]]:
    pairs = [
        ("CREATION_DATE", header.creation_date), ("ORIGINATOR", header.originator),
        ("MESSAGE_ID", header.message_id),
    ]  # fmt: skip
    for key, value in pairs[:2] + ([pairs[2]] if header.message_id else []):
        _check_name(value, key, "the header")
    return [pair for pair in pairs if pair[1]]


def _check_name(text: str, key: str, what: str) -> None:
    if not _ONE_LINE.fullmatch(text) or not text.isprintable():
        raise InputError(f"{what}: {key} must be one line without '=', got {text[:60]!r}")


def _metadata(segment: TdmSegment, what: str) -> list[tuple[str, str]]:
    """Return the metadata of a segment in the order of the standard."""
    meta = segment.meta
    if segment.epoch.scale != meta.time_system:
        raise InputError(
            f"{what}: epoch in {segment.epoch.scale}, time system {meta.time_system}; convert one"
        )
    pairs: dict[str, str] = {
        "TRACK_ID": meta.track_id,
        "DATA_TYPES": ",".join(meta.data_types),
        "TIME_SYSTEM": meta.time_system,
        "START_TIME": _utc(meta.start, segment.time_digits),
        "STOP_TIME": _utc(meta.stop, segment.time_digits),
        **{f"PARTICIPANT_{n}": name for n, name in enumerate(meta.participants, start=1)},
        "MODE": meta.mode,
        **{key: ",".join(map(str, getattr(meta, key.lower())))
           for key in ("PATH", "PATH_1", "PATH_2")},
        **{f"EPHEMERIS_NAME_{n}": name for n, name in meta.ephemeris_names.items()},
        "TRANSMIT_BAND": meta.transmit_band,
        "RECEIVE_BAND": meta.receive_band,
        "TIMETAG_REF": meta.timetag_ref,
        "INTEGRATION_REF": meta.integration_ref,
        "RANGE_MODE": meta.range_mode,
        "RANGE_UNITS": meta.range_units if "RANGE" in segment.series else "",
        "ANGLE_TYPE": meta.angle_type,
        "REFERENCE_FRAME": meta.reference_frame,
        "INTERPOLATION": meta.interpolation,
        "DATA_QUALITY": meta.data_quality,
        **_numbers(meta),
    }  # fmt: skip
    for key, flag in (
        ("DOPPLER_COUNT_ROLLOVER", meta.doppler_count_rollover),
        ("CORRECTIONS_APPLIED", meta.corrections_applied),
    ):
        if flag is not None:
            pairs[key] = "YES" if flag else "NO"
    for key, value in pairs.items():
        if key not in METADATA:
            raise InputError(f"{what}: no keyword {key!r} in the metadata")
        if value or key.startswith(("PARTICIPANT", "EPHEMERIS")):
            _check_name(value, key, what)
    return [(key, pairs[key]) for key in METADATA if pairs.get(key)]


def _numbers(meta: TdmMeta) -> Mapping[str, str]:
    """Return the numbers of the metadata; what is usual is left out."""
    power = 3 if meta.range_units == "km" else 0
    numbers: dict[str, str] = {}
    if meta.turnaround is not None:
        numbers["TURNAROUND_NUMERATOR"], numbers["TURNAROUND_DENOMINATOR"] = map(
            str, meta.turnaround
        )
    if meta.integration_interval_s is not None:
        numbers["INTEGRATION_INTERVAL"] = write_scaled(meta.integration_interval_s, 0)
    if meta.freq_offset_hz:
        numbers["FREQ_OFFSET"] = write_scaled(meta.freq_offset_hz, 0)
    if meta.range_modulus:
        numbers["RANGE_MODULUS"] = write_scaled(meta.range_modulus, power)
    if meta.interpolation_degree is not None:
        numbers["INTERPOLATION_DEGREE"] = str(meta.interpolation_degree)
    if meta.doppler_count_bias_hz:
        numbers["DOPPLER_COUNT_BIAS"] = write_scaled(meta.doppler_count_bias_hz, 0)
    if meta.doppler_count_scale != 1:
        numbers["DOPPLER_COUNT_SCALE"] = str(meta.doppler_count_scale)
    for key, delays in (
        ("TRANSMIT_DELAY", meta.transmit_delays_s), ("RECEIVE_DELAY", meta.receive_delays_s)
    ):  # fmt: skip
        numbers |= {f"{key}_{n}": write_scaled(value, 0) for n, value in delays.items()}
    for key, value in meta.corrections.items():
        of = key.removeprefix("CORRECTION_").replace("DOPPLER", "DOPPLER_INTEGRATED")
        if of.startswith(("ANGLE", "ABERRATION")):
            numbers[key] = _degrees(value)
        else:
            numbers[key] = write_scaled(value, power_of(of, meta) if of in DATA else 0)
    return numbers


def _utc(epoch: Epoch | None, digits: int) -> str:
    return "" if epoch is None else epoch.to("UTC").isot(np.zeros(1), digits)[0]


def _records(segment: TdmSegment, what: str) -> Iterator[tuple[str, str, str]]:
    """Yield keyword, time and value of the records in order of time."""
    keys = [key for key in DATA if key in segment.series]
    for key in segment.series:
        if key not in DATA:
            hint = did_you_mean(key, DATA, otherwise="keywords")
            raise InputError(f"{what}: no data keyword {key[:40]!r}{hint}")
    epoch = segment.epoch
    turned = _turn_over_the_top(segment, what)
    columns: list[tuple[str, list[str], list[str]]] = []
    for key in keys:
        t_s, values = segment.series[key]
        _check_series(key, t_s, values, what)
        times = epoch.isot(t_s, segment.time_digits) if t_s.size else []
        columns.append((key, times, _texts(segment, key, turned.get(key, values), what)))
    if not any(times for _, times, _ in columns):
        raise InputError(f"{what}: a segment needs at least one record")
    t = np.concatenate([segment.series[key].t_s for key in keys])
    which = np.repeat(np.arange(len(keys)), [segment.series[key].t_s.size for key in keys])
    within = np.concatenate([np.arange(segment.series[key].t_s.size) for key in keys])
    for n in np.argsort(t, kind="stable").tolist():
        key, times, texts = columns[which[n]]
        yield key, times[within[n]], texts[within[n]]


def _turn_over_the_top(segment: TdmSegment, what: str) -> Mapping[str, Array]:
    """Return angles by keyword, if some elevations of lenient reading are beyond 90°.

    The direction is the same with the opposite azimuth and 180° minus the elevation, which the
    standard allows.
    """
    meta, angles = segment.meta, segment.series.get("ANGLE_2")
    if meta.angle_type != "AZEL" or angles is None:
        return {}
    over = (angles.values > 0.5 * pi) & (angles.values <= pi)
    if not over.any():
        return {}
    azimuths = segment.series.get("ANGLE_1")
    if azimuths is None or not np.array_equal(azimuths.t_s, angles.t_s):
        raise InputError(
            f"{what}: elevations beyond 90° need an azimuth of the same time, to be written as "
            "those of the same direction"
        )
    if meta.correction_of("ANGLE_2"):
        raise InputError(
            f"{what}: elevations beyond 90° cannot be written with a CORRECTION_ANGLE_2 that is "
            "not applied: its sign would be another one; apply it before"
        )
    return {
        "ANGLE_1": np.where(over, np.remainder(azimuths.values + pi, 2.0 * pi), azimuths.values),
        "ANGLE_2": np.where(over, pi - angles.values, angles.values),
    }


def _check_series(key: str, t_s: Array, values: Array, what: str) -> None:
    if t_s.shape != values.shape or t_s.ndim != 1:
        raise InputError(
            f"{what}: {key}: times and values must have the same shape, got {t_s.shape} and "
            f"{values.shape}"
        )
    if not np.isfinite(t_s).all():
        raise InputError(f"{what}: {key}: times must be finite, got nan or inf")
    if not np.isfinite(values).all():
        raise InputError(f"{what}: {key}: expected a finite number, got nan or inf")
    if np.any(np.diff(t_s) <= 0.0):
        raise InputError(f"{what}: {key}: times must rise")


def _texts(segment: TdmSegment, key: str, values: Array, what: str) -> list[str]:
    if key in segment.counts:
        texts = [text.decode("ascii", "replace") for text in segment.counts[key].tolist()]
        if len(texts) != values.size or any(
            not _is_near(text, value) for text, value in zip(texts, values.tolist(), strict=True)
        ):
            raise InputError(f"{what}: {key}: the digits of the counts are not those of the series")
        return texts
    if DATA[key].unit == "deg":
        return [_degrees(value) for value in values.tolist()]
    power = power_of(key, segment.meta)
    return [write_scaled(value, power) for value in values.tolist()]


def _is_near(text: str, value: float) -> bool:
    try:
        return float(text) == value
    except ValueError:
        return False


def _degrees(angle_rad: float) -> str:
    """Return the shortest text in degrees that is read as an angle, or as the double next to it.

    Not every double is an angle in degrees times π/180 after rounding; what came from a message is.
    """
    near = degrees(angle_rad)
    if not isfinite(near):
        raise InputError(f"an angle must be finite, got {near}")
    for digits in (12, 14, 15, 16):
        short = float(f"{near:.{digits}g}")
        if radians(short) == angle_rad:
            return write_scaled(short, 0)
    candidates = [near]
    below = above = near
    for _ in range(_SEARCHED):
        below, above = nextafter(below, -np.inf), nextafter(above, np.inf)
        candidates += [below, above]
    for candidate in candidates:
        if radians(candidate) == angle_rad:
            return write_scaled(candidate, 0)
    return write_scaled(near, 0)
