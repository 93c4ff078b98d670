"""CCSDS Tracking Data Messages (TDM): azimuth and elevation, ranges and range rates [1]_.

`read_tdm` reads the plain text form (KVN) and XML, which the first character distinguishes;
`write_tdm` writes the plain text form. `hillsphere_tracking.tdm_records` reads a message record by
record while it is being written.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import pi
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere_tracking.tdm_records import (
    SCALAR,
    AnglePair,
    PairedAngles,
    TdmMeta,
    TdmRecord,
    tdm_records,
)

__all__ = ["Series", "TdmMeta", "TdmSegment", "read_tdm", "write_tdm"]

_ONE_LINE = re.compile(r"[^=\r\n]*[^=\s][^=\r\n]*")


class Series(NamedTuple):
    """Values (K,) of one keyword, SI, at times (K,), s after the epoch of the segment."""

    t_s: Array
    values: Array


@dataclass(frozen=True)
class TdmSegment:
    """One segment of a message: tracking data with common metadata.

    Parameters
    ----------
    meta : TdmMeta
        Participants and time system.
    epoch : Epoch
        Origin of the times.
    t_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        Angles and their times in increasing order; may be empty.
    series : mapping of str to Series
        The available ones of ``"RANGE"`` (m), ``"DOPPLER_INSTANTANEOUS"`` and
        ``"DOPPLER_INTEGRATED"`` (m/s). The path of the metadata tells one-way from two-way
        measurements.
    """

    meta: TdmMeta
    epoch: Epoch
    t_s: Array
    azimuth_rad: Array
    elevation_rad: Array
    series: Mapping[str, Series] = field(default_factory=dict)


def read_tdm(text: str, where: str = "TDM") -> list[TdmSegment]:
    """Read a whole message, in the plain text form or as XML.

    Parameters
    ----------
    text : str
        The message.
    where : str
        Name of the file, used in error messages.

    Returns
    -------
    list of TdmSegment
        Segments that contain a supported keyword; the epoch of each is its first time.

    Raises
    ------
    InputError
        As for `tdm_records`, and if an angle lacks the other angle of the same time.
    """
    pairing = PairedAngles()
    parts: dict[int, tuple[list[AnglePair], list[TdmRecord]]] = {}
    for record in tdm_records(text.splitlines(), where):
        angles, others = parts.setdefault(id(record.meta), ([], []))
        if pair := pairing.add(record):
            angles.append(pair)
        if record.keyword in SCALAR:
            others.append(record)
    pairing.finish()
    if not parts:
        raise InputError(f"{where}: the message contains no angles, ranges or Doppler measurements")
    return [_segment(angles, others) for angles, others in parts.values()]


def _segment(angles: list[AnglePair], others: list[TdmRecord]) -> TdmSegment:
    first = (angles or others)[0]
    epoch = first.epoch
    series = {}
    for keyword in SCALAR:
        records = [r for r in others if r.keyword == keyword]
        if records:
            times = np.array([r.epoch.seconds_since(epoch) for r in records])
            series[keyword] = Series(times, np.array([r.value for r in records]))
    return TdmSegment(
        first.meta,
        epoch,
        np.array([pair.epoch.seconds_since(epoch) for pair in angles]),
        np.array([pair.azimuth_rad for pair in angles]),
        np.array([pair.elevation_rad for pair in angles]),
        MappingProxyType(series),
    )


def write_tdm(
    segments: Sequence[TdmSegment],
    *,
    originator: str = "HILLSPHERE",
    created: datetime | None = None,
) -> str:
    """Return a Tracking Data Message in the plain text form (KVN).

    Parameters
    ----------
    segments : sequence of TdmSegment
        Segments in order. Of the metadata, participants, path and time system are written.
    originator : str
        Value of ORIGINATOR.
    created : datetime, optional
        Value of CREATION_DATE; by default the current time.

    Returns
    -------
    str
        The message: angles to 1e-9 degrees, ranges to 1 µm, range rates to 1 nm/s, times to 1 µs.

    Raises
    ------
    InputError
        If a name is empty or has several lines, a time system or keyword is unknown, data are not
        finite or out of range, or times do not increase by at least a microsecond.
    """
    if not segments:
        raise InputError("a tracking data message needs at least one segment")
    stamp = (created or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = ["CCSDS_TDM_VERS = 2.0", f"CREATION_DATE = {stamp}", f"ORIGINATOR = {originator}"]
    for number, segment in enumerate(segments, start=1):
        lines += ["", *_segment_lines(segment, f"segment {number}")]
    text = "\n".join(lines) + "\n"
    # the reader checks ranges, times and names
    read_tdm(text, "tracking data to be written")
    return text


def _segment_lines(segment: TdmSegment, what: str) -> list[str]:
    meta = segment.meta
    for name in meta.participants:
        if not _ONE_LINE.fullmatch(name):
            raise InputError(f"{what}: a participant must be one line without '=', got {name!r}")
    if segment.epoch.scale != meta.time_system:
        raise InputError(
            f"{what}: epoch in {segment.epoch.scale}, time system {meta.time_system}; convert one"
        )
    lines = ["META_START", f"TIME_SYSTEM = {meta.time_system}"]
    lines += [f"PARTICIPANT_{n} = {name}" for n, name in enumerate(meta.participants, start=1)]
    lines += ["MODE = SEQUENTIAL"]
    if meta.path:
        lines += [f"PATH = {','.join(str(n) for n in meta.path)}"]
    if segment.t_s.size:
        lines += ["ANGLE_TYPE = AZEL"]
    lines += ["META_STOP", "", "DATA_START"]
    azimuth = np.degrees(np.remainder(segment.azimuth_rad, 2.0 * pi))
    elevation = np.degrees(segment.elevation_rad)
    if not segment.t_s.shape == azimuth.shape == elevation.shape:
        raise InputError(
            f"{what}: times, azimuths and elevations must have the same shape, got "
            f"{segment.t_s.shape}, {azimuth.shape} and {elevation.shape}"
        )
    for when, a, h in zip(_times(segment, segment.t_s, what), azimuth, elevation, strict=True):
        lines += [f"ANGLE_1 = {when} {a:.9f}", f"ANGLE_2 = {when} {h:.9f}"]
    for keyword, series in segment.series.items():
        if keyword not in SCALAR:
            raise InputError(f"{what}: {keyword!r} cannot be written, only {', '.join(SCALAR)}")
        values = series.values / SCALAR[keyword]
        digits = 9 if keyword == "RANGE" else 12
        times = _times(segment, series.t_s, what)
        lines += [
            f"{keyword} = {when} {value:.{digits}f}"
            for when, value in zip(times, values, strict=True)
        ]
    return [*lines, "DATA_STOP"]


def _times(segment: TdmSegment, t_s: Array, what: str) -> list[str]:
    if not np.isfinite(t_s).all():
        raise InputError(f"{what}: times must be finite, got nan or inf")
    return segment.epoch.isot(t_s) if t_s.size else []
