"""Recorded tracking data as records of observables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import cos, nan
from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.base.constants import SPEED_OF_LIGHT_M_S
from hillsphere.base.paths import missions_directory
from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.formats.angle_table import AngleTable
from hillsphere.formats.tdm import TdmSegment, read_tdm
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.data_kinds import reason_left_out
from hillsphere_estimators.orbit_fit.observables import INTEGRATION, Observable
from hillsphere_estimators.orbit_fit.records import Record
from hillsphere_estimators.orbit_fit.sight import HORIZON
from hillsphere_estimators.orbit_fit.specs import DataSpec, NoiseSpec, OrbitFitSpec
from hillsphere_estimators.orbit_fit.uplink import Transmission, join_transmissions, split_ramps

__all__ = ["TrackingData", "place_of", "read_tracking_data", "text_of"]

_MOST_DEPARTURES = 5
"""Of a message from the standard that are told; a program that writes one repeats it."""
_LEAST_COSINE = 1e-3
"""Of a second angle, in the standard deviation of the first: 0.06° from the zenith or the pole."""


@dataclass(frozen=True)
class TrackingData:
    """All data of a stage.

    Parameters
    ----------
    records : tuple of Record
        One for each observable; times count from the plant's.
    transmissions : mapping of str to Transmission
        By the name of the transmitter.
    craft : str
        Name of the spacecraft among the participants.
    left_out : mapping of (str, str) to int
        What, and why → number of values.
    notes : tuple of str
        What a reader must know of the treatment of the data.
    """

    records: tuple[Record, ...]
    transmissions: Mapping[str, Transmission]
    craft: str
    left_out: Mapping[tuple[str, str], int]
    notes: tuple[str, ...]


@dataclass
class _Gathered:
    """Data on their way from files to records."""

    spec: OrbitFitSpec
    zero: Epoch
    series: dict[Observable, list[tuple[Array, Array, Array]]] = field(default_factory=dict)
    sent: dict[str, list[tuple[Array, Array, Array]]] = field(default_factory=dict)
    left_out: dict[tuple[str, str], int] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)

    def leave(self, what: str, why: str, count: int) -> None:
        self.left_out[what, why] = self.left_out.get((what, why), 0) + count


def place_of(path: str) -> Path:
    """Return where a file of data is, which may be a packaged one."""
    place = Path(path)
    if not place.is_absolute() and not place.exists():
        return missions_directory() / "data" / path
    return place


def text_of(path: str) -> str:
    """Return the text of a file of data, which may be a packaged one.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        return read_text(place_of(path), "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason or error}") from error


def read_tracking_data(spec: OrbitFitSpec, zero: Epoch) -> TrackingData:
    """Read all files of a stage.

    Parameters
    ----------
    spec : OrbitFitSpec
        Names the files, and says what they do not.
    zero : Epoch
        From which times count.

    Returns
    -------
    TrackingData
        Sorted by time.

    Raises
    ------
    InputError
        Naming file or key, if something cannot be read or is not said.
    """
    gathered = _Gathered(spec, zero)
    craft, files = spec.spacecraft, ", ".join(data.file for data in spec.data)
    messages: list[tuple[str, list[TdmSegment]]] = []
    tables: list[tuple[DataSpec, str]] = []
    for data in spec.data:
        text = text_of(data.file)
        beginning = text.lstrip()
        if beginning.startswith(("CCSDS_", "<", "COMMENT")):
            departures: list[str] = []
            segments = read_tdm(text, data.file, lenient=True, warn=departures.append)
            messages.append((data.file, segments))
            gathered.notes |= dict.fromkeys(departures[:_MOST_DEPARTURES])
        else:
            tables.append((data, text))
    craft = craft or _only_craft(spec, [s for _, segments in messages for s in segments], files)
    for file, segments in messages:
        for number, segment in enumerate(segments, start=1):
            _take_segment(gathered, segment, craft, f"{file}, segment {number}")
    for data, text in tables:
        _take_table(gathered, data, text, craft)
    if not gathered.series:
        why = "; ".join(f"{what}: {reason}" for what, reason in gathered.left_out)
        raise InputError(f"data: {files}: nothing that can be fitted{': ' if why else ''}{why}")
    transmissions = join_transmissions(gathered.sent)
    records = tuple(
        _less_reference(_record(observable, parts, spec.noise, files), transmissions, files)
        for observable, parts in gathered.series.items()
    )
    return TrackingData(
        records, transmissions, craft, dict(gathered.left_out), tuple(gathered.notes)
    )


def _names(spec: OrbitFitSpec) -> list[str]:
    """Return the names of all observers."""
    return [s.name for s in spec.stations] + [o.name for o in spec.observers]


def _only_craft(spec: OrbitFitSpec, segments: Sequence[TdmSegment], files: str) -> str:
    """Return the only participant that is neither station nor observer."""
    known = _names(spec)
    names = dict.fromkeys(name for one in segments for name in one.meta.participants)
    others = [name for name in names if name not in known]
    if not segments:
        return "spacecraft"
    if len(others) != 1:
        raise InputError(
            f"spacecraft: the participants of {files} are {', '.join(names)}, of which "
            f"{' and '.join(others) or 'none'} "
            f"{'are' if len(others) > 1 else 'is'} neither station nor observer; name the "
            "spacecraft, and give a place to each other one that measures"
        )
    return others[0]


def _take_segment(gathered: _Gathered, segment: TdmSegment, craft: str, where: str) -> None:
    """Add the series of one segment of a message."""
    meta, spec = segment.meta, gathered.spec
    offset = segment.epoch.seconds_since(gathered.zero)
    degraded = meta.data_quality == "DEGRADED" and not spec.use_degraded
    for keyword in segment.series:
        if not keyword.startswith("TRANSMIT_FREQ_") or "RATE" in keyword:
            continue
        if degraded:
            gathered.leave(keyword, _DEGRADED, len(segment.series[keyword].values))
            continue
        rate = segment.series.get(keyword.replace("FREQ", "FREQ_RATE"))
        own = segment.corrected(keyword)
        name = meta.participants[int(keyword[-1]) - 1]
        gathered.sent.setdefault(name, []).append(split_ramps(own.t_s, own.values, rate, offset))
    for keyword in segment.series:
        reason = reason_left_out(keyword)
        if reason:
            gathered.leave(keyword, reason, len(segment.series[keyword].values))
    wanted = [k for k in segment.series if k in _SHAPES or k.startswith("RECEIVE_FREQ")]
    reason = ""
    if meta.mode == "SINGLE_DIFF" or meta.path_1:
        reason = "differenced data are not used"
    elif degraded:
        reason = _DEGRADED
    if reason:
        for keyword in wanted:
            gathered.leave(keyword, reason, len(segment.series[keyword].values))
        return
    if wanted and meta.corrections_applied is None and any(meta.corrections.values()):
        gathered.notes[
            f"{where}: the message has {', '.join(meta.corrections)} and does not say whether they "
            "are applied; nothing was applied"
        ] = None
    for keyword in wanted:
        if keyword == "ANGLE_2":
            continue
        for observable, t, values in _split_series(segment, keyword, craft, spec, where):
            gathered.series.setdefault(observable, []).append(
                (t + offset, values, np.full(values.shape, nan))
            )
            _note(gathered, observable, where)


_DEGRADED = "marked as degraded"
_SHAPES = ("ANGLE_1", "ANGLE_2", "RANGE", "DOPPLER_INSTANTANEOUS", "DOPPLER_INTEGRATED")


def _split_series(
    segment: TdmSegment, keyword: str, craft: str, spec: OrbitFitSpec, where: str
) -> Iterator[tuple[Observable, Array, Array]]:
    """Yield the observable of a keyword with times (K,), s, and values (r, K), SI."""
    meta = segment.meta
    path = _path(segment, keyword, craft, spec, where)
    numbers = meta.path or tuple(meta.participants.index(name) + 1 for name in path)
    common: dict[str, Any] = {
        "path": path,
        "tagged": "transmit" if meta.timetag_ref == "TRANSMIT" else "receive",
        "receive_delays_s": tuple(meta.receive_delays_s.get(n, 0.0) for n in numbers),
        "transmit_delays_s": tuple(meta.transmit_delays_s.get(n, 0.0) for n in numbers),
    }
    if keyword == "ANGLE_1":
        try:
            t, first, second = segment.angle_pairs()
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        kind, frame = meta.angle_type, ""
        if kind not in (*HORIZON, "RADEC"):
            raise InputError(f"{where}: ANGLE_TYPE is {kind or 'missing'}; expected AZEL, RADEC, "
                             "XEYN or XSYE")  # fmt: skip
        if kind == "RADEC":
            frame = meta.reference_frame or spec.reference_frame
            if not frame:
                raise InputError(
                    f"reference_frame: {where} does not name the frame of right ascension and "
                    "declination; give it"
                )
        elif path[-1] not in [station.name for station in spec.stations]:
            raise InputError(f"{where}: {kind} needs a station, and {path[-1]} is none")
        yield (
            Observable("angles", angle_type=kind, frame=frame, **common),
            t,
            np.array([first, second]),
        )
        return
    series = segment.corrected(keyword)
    interval = 0.0
    if keyword == "DOPPLER_INTEGRATED" or keyword.startswith("RECEIVE_FREQ"):
        interval = meta.integration_interval_s or 0.0
        if not interval and keyword == "DOPPLER_INTEGRATED":
            raise InputError(f"{where}: DOPPLER_INTEGRATED needs INTEGRATION_INTERVAL")
        common["interval_s"] = interval
        common["middle"] = INTEGRATION[meta.integration_ref or "MIDDLE"] if interval else 0.0
    values = series.values[None]
    if keyword.startswith("RECEIVE_FREQ"):
        top, bottom = meta.turnaround or (1, 1)
        if meta.turnaround is None and len(path) > 2:
            raise InputError(
                f"{where}: {keyword} of a round trip needs TURNAROUND_NUMERATOR and "
                "TURNAROUND_DENOMINATOR"
            )
        ratio = top / bottom if len(path) > 2 else 1.0
        observable = Observable("frequency", turnaround=ratio, **common)
        yield observable, series.t_s, values + meta.freq_offset_hz
        return
    if keyword == "RANGE":
        unit = _range_unit(meta.range_units, spec, where)
        share = _share(spec.two_way_range, "two_way_range", path, where)
        yield (
            Observable(
                "range",
                share=share,
                modulus_m=meta.range_modulus * unit,
                **common,
            ),
            series.t_s,
            values * unit,
        )
        return
    share = _share(spec.two_way_range_rate, "two_way_range_rate", path, where)
    yield Observable("range_rate", share=share, **common), series.t_s, values


def _path(
    segment: TdmSegment, keyword: str, craft: str, spec: OrbitFitSpec, where: str
) -> tuple[str, ...]:
    """Return the names along the path, after a check that each has a place."""
    meta = segment.meta
    known = [craft, *_names(spec)]
    if meta.path:
        path = tuple(meta.participants[n - 1] for n in meta.path)
    elif keyword == "ANGLE_1":
        others = [name for name in meta.participants if name != craft]
        if len(others) != 1:
            raise InputError(f"{where}: without PATH there must be one participant beside {craft}")
        path = (craft, others[0])
    else:
        raise InputError(f"{where}: {keyword} needs PATH, the way of the signal")
    for name in path:
        if name not in known:
            raise InputError(
                f"stations: {where} has the participant {name!r}; give its place as a station or "
                f"an observer (known: {', '.join(known)})"
            )
    if craft not in path[-2:] if keyword == "ANGLE_1" else craft not in path:
        raise InputError(f"{where}: {keyword} is not of {craft}: its path is {' → '.join(path)}")
    if path[-1] == craft:
        raise InputError(f"{where}: {keyword} is received by {craft} itself; expected an observer")
    return path


def _range_unit(units: str, spec: OrbitFitSpec, where: str) -> float:
    """Return the length of a unit of the series ``RANGE``, m."""
    if units == "RU":
        if spec.range_unit_m is None:
            raise InputError(
                f"range_unit: {where} gives ranges in range units, whose length only the parties "
                "know; give range_unit_m"
            )
        return spec.range_unit_m
    return SPEED_OF_LIGHT_M_S if units == "s" else 1.0


def _share(given: str | None, key: str, path: tuple[str, ...], where: str) -> float:
    """Return the part of the way that a value counts."""
    if len(path) < 3:
        return 1.0
    if given is None:
        raise InputError(
            f"{key}: {where} has values of round trips, and the standard leaves open whether they "
            'count the whole way or half of it; give "whole" or "half"'
        )
    return 1.0 if given == "whole" else 0.5


def _note(gathered: _Gathered, observable: Observable, where: str) -> None:
    if observable.kind == "frequency" and len(observable.path) < 3:
        gathered.notes[
            "One-way frequencies are taken as if the spacecraft's clock ran at the rate of the "
            "ground's; an error of its frequency belongs among the biases."
        ] = None
    if observable.kind == "angles" and observable.angle_type in HORIZON:
        gathered.notes["Refraction is not modelled: angles must be corrected for it."] = None


def _take_table(gathered: _Gathered, data: DataSpec, text: str, craft: str) -> None:
    """Add a table of azimuths and elevations."""
    spec = gathered.spec
    names = [station.name for station in spec.stations]
    station = data.station or (names[0] if len(names) == 1 else "")
    if station not in names:
        raise InputError(
            f"data: {data.file} is a table of angles; which of {', '.join(names) or 'no'} stations "
            f"measured them? give station{f', got {station!r}' if station else ''}"
        )
    rows = list(AngleTable(text.splitlines(), data.file, gathered.zero))
    if not rows:
        raise InputError(f"{data.file}: the table has no rows")
    t = np.array([row.epoch.seconds_since(gathered.zero) for row in rows])
    values = np.array([[row.azimuth_rad, row.elevation_rad] for row in rows]).T
    sigma = np.array(
        [
            [row.sigma_rad / max(cos(row.elevation_rad), _LEAST_COSINE), row.sigma_rad]
            if row.sigma_rad else [nan, nan]
            for row in rows
        ]
    ).T  # fmt: skip
    observable = Observable("angles", (craft, station), "AZEL")
    gathered.series.setdefault(observable, []).append((t, values, sigma))
    _note(gathered, observable, data.file)


def _record(
    observable: Observable,
    parts: list[tuple[Array, Array, Array]],
    noise: Sequence[NoiseSpec],
    files: str,
) -> Record:
    """Return a record in order of time, with its standard deviations."""
    t = np.concatenate([part[0] for part in parts])
    values = np.concatenate([part[1] for part in parts], axis=1)
    sigma = np.concatenate([part[2] for part in parts], axis=1)
    order = np.argsort(t, kind="stable")
    t, values, sigma = t[order], values[:, order], sigma[:, order]
    repeated = np.flatnonzero(np.diff(t) <= 0.0)
    if len(repeated):
        raise InputError(
            f"data: {files}: {observable.label} has two values of {observable.names[0]} at "
            f"{t[repeated[0]]:.12g} s after the plant's epoch; is a file given twice?"
        )
    if np.isnan(sigma).any():
        key = {"angles": "angle_rad", "range": "range_m", "range_rate": "range_rate_m_s",
               "frequency": "frequency_hz"}[observable.kind]  # fmt: skip
        given = [getattr(one, key) for name in (observable.receiver, "") for one in noise
                 if one.station == name and getattr(one, key) is not None]  # fmt: skip
        if not given:
            raise InputError(
                f"noise: {observable.receiver} measures {' and '.join(observable.names)}, and no "
                f"standard deviation is given in {files}; give noise.{key}, or another unit"
            )
        stated = np.full(sigma.shape, given[0])
        if observable.kind == "angles":
            stated[0] /= np.maximum(np.abs(np.cos(values[1])), _LEAST_COSINE)
        sigma = np.where(np.isnan(sigma), stated, sigma)
    return Record(observable, t, values[:, :, None], sigma)


def _less_reference(
    record: Record, transmissions: Mapping[str, Transmission], files: str
) -> Record:
    """Return received frequencies less that of the first transmission, see `expected_values`.

    Raises
    ------
    InputError
        If a received frequency has no transmitted one.
    """
    observable = record.observable
    if observable.kind != "frequency":
        return record
    sender = observable.path[0]
    if sender not in transmissions:
        raise InputError(
            f"data: {files}: {observable.label} has received frequencies, and no TRANSMIT_FREQ of "
            f"{sender}"
        )
    reference = observable.turnaround * transmissions[sender].reference_hz
    return replace(record, values=record.values - reference)
