"""CCSDS Orbit Ephemeris Messages: writing and reading the plain text form.

Each segment is one object's flight without a manoeuvre: states in one inertial frame about one
centre, at epochs of one time scale.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 5 (OEM).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from math import isfinite, nan

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import SCALES, Epoch
from hillsphere.formats.ccsds_times import read_ccsds_time

__all__ = ["INERTIAL_FRAMES", "OemSegment", "read_oem", "states_csv", "write_oem"]

INERTIAL_FRAMES = ("ICRF", "EME2000", "GCRF", "TEME")
"""Frames in which an ephemeris can be written; a rotating one is refused."""

_META = (
    "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "START_TIME", "STOP_TIME"
)  # fmt: skip
_BELOW_A_MICROSECOND = re.compile(r"\.\d{6}\d*[1-9]")
_NAME = re.compile(r"[^=\r\n]+")


@dataclass(frozen=True)
class OemSegment:
    """Part of an ephemeris between two manoeuvres.

    Parameters
    ----------
    object_name, object_id : str
        Of the spacecraft.
    center_name : str
        Origin, e.g. ``"MARS"``.
    ref_frame : str
        One of `INERTIAL_FRAMES`.
    epoch : Epoch
        From which times count, in the time system of the message.
    t_s : ndarray, shape (K,)
        Times, rising.
    x : ndarray, shape (6, K)
        Positions, m, and velocities, m/s.
    comment : str
        One line, may be empty.
    passed_over : tuple of str
        What else the message states of it, in words.
    """

    object_name: str
    object_id: str
    center_name: str
    ref_frame: str
    epoch: Epoch
    t_s: Array
    x: Array
    comment: str = ""
    passed_over: tuple[str, ...] = field(default=(), compare=False)


def write_oem(
    segments: Sequence[OemSegment],
    *,
    originator: str = "HILLSPHERE",
    created: datetime | None = None,
    degree: int = 7,
) -> str:
    """Return an Orbit Ephemeris Message.

    Parameters
    ----------
    segments : sequence of OemSegment
        In order.
    originator : str
        Who made it.
    created : datetime, optional
        When; by default now.
    degree : int
        Degree of the Lagrange interpolation that the message recommends, less where a segment
        has too few states.

    Returns
    -------
    str
        The message; positions to 1 µm, velocities to 1 nm/s, times to 1 µs.

    Raises
    ------
    InputError
        If a frame is not inertial, a name is empty, a name or comment is more than a line, or a
        segment has no finite states at times that rise by microseconds at least.
    """
    if not segments:
        raise InputError("an ephemeris message needs at least one segment")
    stamp = (created or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = ["CCSDS_OEM_VERS = 2.0", f"CREATION_DATE = {stamp}", f"ORIGINATOR = {originator}"]
    for segment in segments:
        _check(segment)
        times = segment.epoch.isot(segment.t_s)
        if any(a == b for a, b in pairwise(times)):
            raise InputError(
                f"{segment.object_name}: two states have the same time to the microsecond; leave "
                "one out"
            )
        lines += ["", "META_START"]
        if segment.comment:
            lines.append(f"COMMENT {segment.comment}")
        values = (
            segment.object_name, segment.object_id, segment.center_name, segment.ref_frame,
            segment.epoch.scale, times[0], times[-1],
        )  # fmt: skip
        lines += [f"{key} = {value}" for key, value in zip(_META, values, strict=True)]
        if (usable := min(degree, len(times) - 1)) > 0:
            lines += ["INTERPOLATION = LAGRANGE", f"INTERPOLATION_DEGREE = {usable}"]
        lines += ["META_STOP", ""]
        place, speed = segment.x[:3].T / 1e3, segment.x[3:].T / 1e3
        lines += [
            f"{when} {r[0]:.9f} {r[1]:.9f} {r[2]:.9f} {v[0]:.12f} {v[1]:.12f} {v[2]:.12f}"
            for when, r, v in zip(times, place, speed, strict=True)
        ]
    return "\n".join(lines) + "\n"


def states_csv(segments: Sequence[OemSegment]) -> str:
    """Return the states of all segments as a table: time, positions in km, velocities in km/s."""
    lines = ["time,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"]
    for segment in segments:
        times = segment.epoch.isot(segment.t_s)
        lines += [
            ",".join([when, *(repr(float(value)) for value in state)])
            for when, state in zip(times, segment.x.T / 1e3, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _check(segment: OemSegment) -> None:
    if segment.ref_frame not in INERTIAL_FRAMES:
        raise InputError(
            f"an ephemeris message needs an inertial frame ({', '.join(INERTIAL_FRAMES)}), got "
            f"{segment.ref_frame!r}"
        )
    for key in ("object_name", "object_id", "center_name"):
        if not _NAME.fullmatch(value := getattr(segment, key)):
            raise InputError(f"{key} must be one line of text without '=', got {value!r}")
    if len(segment.comment.splitlines()) > 1:
        raise InputError(f"comment must be one line of text, got {segment.comment!r}")
    t, x = segment.t_s, segment.x
    if x.shape != (6, t.size) or not t.size:
        raise InputError(f"states must be (6, {t.size}) at {t.size} ≥ 1 times, got {x.shape}")
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
        raise InputError(
            f"{segment.object_name}: times must rise and all states be finite; cut it before "
            "the flight ends"
        )


def read_oem(text: str) -> list[OemSegment]:
    """Read an Orbit Ephemeris Message in the plain text form.

    Accelerations, covariances, comments and keywords of the metadata that `OemSegment` has no field
    for are not kept; its `passed_over` names those that the message has.

    Parameters
    ----------
    text : str
        The message.

    Returns
    -------
    list of OemSegment
        Times count from the first state of each.

    Raises
    ------
    InputError
        Naming the line, if it is not such a message or uses an unknown frame or time scale.
    """
    segments: list[OemSegment] = []
    meta: dict[str, str] = {}
    rows: list[tuple[int, list[str]]] = []
    extras: dict[str, None] = {}
    where = "header"
    version = False

    def finish(number: int) -> None:
        if meta:
            segments.append(_segment(meta, rows, number, extras))

    number = 0
    for number, raw in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
        line = raw.strip()
        if line.startswith("COMMENT"):
            extras["comments"] = None
            continue
        if not line:
            continue
        if line == "META_START":
            finish(number)
            meta, rows, where = {}, [], "meta"
            extras = {}
        elif line == "META_STOP":
            where = "data"
        elif line == "COVARIANCE_START":
            where = "covariance"
            extras["covariances"] = None
        elif line == "COVARIANCE_STOP":
            where = "data"
        elif where == "data":
            rows.append((number, line.split()))
        elif where != "covariance":
            key, sign, value = (part.strip() for part in line.partition("="))
            if not sign:
                raise InputError(f"line {number}: expected KEY = VALUE, got {line[:60]!r}")
            version |= key == "CCSDS_OEM_VERS"
            if where == "meta":
                meta[key] = value
    finish(number)
    if not version or not segments:
        raise InputError("not an orbit ephemeris message: no CCSDS_OEM_VERS or no segment in it")
    return segments


def _segment(
    meta: dict[str, str],
    rows: Sequence[tuple[int, list[str]]],
    number: int,
    extras: Mapping[str, None],
) -> OemSegment:
    if missing := [key for key in _META if key not in meta]:
        raise InputError(f"line {number}: the segment lacks {', '.join(missing)}")
    if (scale := meta["TIME_SYSTEM"]) not in SCALES:
        raise InputError(f"line {number}: time system {scale!r}; known: {', '.join(SCALES)}")
    if not rows:
        raise InputError(f"line {number}: the segment has no states")
    epochs: list[Epoch] = []
    states: list[list[float]] = []
    for line, parts in rows:
        try:
            epochs.append(read_ccsds_time(parts[0], scale))
        except InputError as error:
            raise InputError(f"line {line}: {error}") from error
        values = [_number(part, line) for part in parts[1:]]
        if len(values) not in (6, 9):
            raise InputError(f"line {line}: expected an epoch and 6 or 9 numbers")
        states.append(values[:6])
    extras = dict(extras)
    if any(len(parts) == 10 for _, parts in rows):
        extras["accelerations"] = None
    if any(_BELOW_A_MICROSECOND.search(parts[0]) for _, parts in rows):
        extras["digits of the times below 1 µs"] = None
    extras |= dict.fromkeys(key for key in meta if key not in _META)
    return OemSegment(
        object_name=meta["OBJECT_NAME"],
        object_id=meta["OBJECT_ID"],
        center_name=meta["CENTER_NAME"],
        ref_frame=meta["REF_FRAME"],
        epoch=epochs[0],
        t_s=np.array([epoch.seconds_since(epochs[0]) for epoch in epochs]),
        x=np.array(states).T * 1e3,
        passed_over=tuple(extras),
    )


def _number(text: str, line: int) -> float:
    """Read a number of kilometres or kilometres a second."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(1e3 * value):
        raise InputError(f"line {line}: expected a finite number, got {text[:40]!r}")
    return value
