"""Orbit Ephemeris Messages as text (KVN) and XML.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 5 (OEM) and 8 (XML).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import write_scaled
from hillsphere.formats.oem_encodings import ACCELERATION, COVARIANCE, STATE
from hillsphere.formats.oem_reading import UNITS
from hillsphere.formats.oem_segments import (
    INERTIAL_FRAMES,
    INTERPOLATIONS,
    OemSegment,
    is_covariance_frame,
    is_frame,
    least_eigenvalue,
    states_needed,
)

__all__ = ["write_kvn", "write_xml"]

_NAME = re.compile(r"[^=\r\n]*[^=\s][^=\r\n]*")
Pairs = list[tuple[str, str]]


@dataclass(frozen=True)
class _Printed:
    """A segment in the words of a message."""

    comment: str
    metadata: Pairs
    states: list[Pairs]
    covariances: list[Pairs]


def write_kvn(
    segments: Sequence[OemSegment], originator: str, created: datetime | None, degree: int
) -> str:
    """Return a message as text; see `hillsphere.formats.oem.write_oem`."""
    lines = ["CCSDS_OEM_VERS = 2.0", *_lines(_header(segments, originator, created))]
    for segment in segments:
        printed = _print(segment, degree)
        lines += ["", "META_START"]
        if printed.comment:
            lines.append(f"COMMENT {printed.comment}")
        lines += [*_lines(printed.metadata), "META_STOP", ""]
        lines += [" ".join(value for _, value in state) for state in printed.states]
        if printed.covariances:
            lines += ["", "COVARIANCE_START"]
            for pairs in printed.covariances:
                values = dict(pairs)
                lines += _lines([pair for pair in pairs if pair[0] in ("EPOCH", "COV_REF_FRAME")])
                lines += [" ".join(values[key] for key in row) for row in COVARIANCE]
            lines.append("COVARIANCE_STOP")
    return "\n".join(lines) + "\n"


def write_xml(
    segments: Sequence[OemSegment], originator: str, created: datetime | None, degree: int
) -> str:
    """Return a message as XML; see `hillsphere.formats.oem.write_oem`."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<oem id="CCSDS_OEM_VERS" version="2.0">']
    lines += ["<header>", *_elements(_header(segments, originator, created)), "</header>", "<body>"]
    for segment in segments:
        printed = _print(segment, degree)
        comment = [("COMMENT", printed.comment)] if printed.comment else []
        lines += ["<segment>", "<metadata>", *_elements([*comment, *printed.metadata])]
        lines += ["</metadata>", "<data>"]
        for name, blocks in (
            ("stateVector", printed.states),
            ("covarianceMatrix", printed.covariances),
        ):
            for pairs in blocks:
                lines += [f"<{name}>", *_elements(pairs), f"</{name}>"]
        lines += ["</data>", "</segment>"]
    return "\n".join([*lines, "</body>", "</oem>"]) + "\n"


def _lines(pairs: Iterable[tuple[str, str]]) -> list[str]:
    return [f"{key} = {value}" for key, value in pairs]


def _elements(pairs: Iterable[tuple[str, str]]) -> list[str]:
    return [
        f'<{key} units="{UNITS[key]}">{value}</{key}>'
        if key in UNITS
        else f"<{key}>{escape(value)}</{key}>"
        for key, value in pairs
    ]


def _header(segments: Sequence[OemSegment], originator: str, created: datetime | None) -> Pairs:
    if not segments:
        raise InputError("an ephemeris message needs at least one segment")
    if not _NAME.fullmatch(originator) or not originator.isprintable():
        raise InputError(f"originator must be one line of text without '=', got {originator!r}")
    stamp = (created or datetime.now(UTC)).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return [("CREATION_DATE", stamp), ("ORIGINATOR", originator)]


def _print(segment: OemSegment, degree: int) -> _Printed:
    """Return the words of a segment; `InputError` if no message can hold it."""
    _check_names(segment)
    _check_states(segment)
    _check_covariances(segment)
    start, stop = _span(segment)

    def times(offsets: Iterable[float]) -> list[str]:
        offsets = np.array(list(offsets))
        return segment.epoch.isot(offsets, segment.time_digits) if offsets.size else []

    when = times(segment.t_s)
    if any(a == b for a, b in pairwise(when)):
        unit = "microsecond" if segment.time_digits == 6 else f"{segment.time_digits}th decimal"
        raise InputError(
            f"{segment.object_name}: two states have the same time to the {unit}; leave one out"
        )
    metadata = [
        ("OBJECT_NAME", segment.object_name),
        ("OBJECT_ID", segment.object_id),
        ("CENTER_NAME", segment.center_name),
        ("REF_FRAME", segment.ref_frame),
    ]
    if segment.ref_frame_epoch is not None:
        (at,) = segment.ref_frame_epoch.to(segment.epoch.scale).isot(np.zeros(1), 6)
        metadata.append(("REF_FRAME_EPOCH", at))
    metadata.append(("TIME_SYSTEM", segment.epoch.scale))
    span = {"START_TIME": start, "USEABLE_START_TIME": segment.useable_start_s,
            "USEABLE_STOP_TIME": segment.useable_stop_s, "STOP_TIME": stop}  # fmt: skip
    stated = {key: value for key, value in span.items() if value is not None}
    metadata += zip(stated, times(stated.values()), strict=True)
    metadata += _interpolation(segment, degree)
    columns = [segment.x] if segment.accelerations_m_s2 is None else [
        segment.x, segment.accelerations_m_s2
    ]  # fmt: skip
    keys = (*STATE, *ACCELERATION)[: 3 * (len(columns) + 1)]
    states = [
        [("EPOCH", at), *((key, write_scaled(v, 3)) for key, v in zip(keys, row, strict=True))]
        for at, row in zip(when, np.concatenate(columns).T.tolist(), strict=True)
    ]
    covariances = []
    at_covariances = times(one.t_s for one in segment.covariances)
    for at, one in zip(at_covariances, segment.covariances, strict=True):
        pairs = [("EPOCH", at)]
        if one.ref_frame:
            pairs.append(("COV_REF_FRAME", one.ref_frame))
        pairs += [
            (key, write_scaled(one.matrix[i, j], 6))
            for i, row in enumerate(COVARIANCE)
            for j, key in enumerate(row)
        ]
        covariances.append(pairs)
    return _Printed(segment.comment, metadata, states, covariances)


def _interpolation(segment: OemSegment, degree: int) -> Pairs:
    """Return what a message recommends: as the segment states, else Lagrange's as far as it can."""
    method, count = segment.interpolation, segment.t_s.size
    if method is None:
        method, stated = "LAGRANGE", min(degree, count - 1)
        if stated < 1:
            return []
    elif not method:
        return []
    elif method not in INTERPOLATIONS:
        raise InputError(
            f"interpolation must be {', '.join(INTERPOLATIONS)} or '', got {method[:40]!r}"
        )
    elif segment.interpolation_degree is None:
        if method != "PROPAGATE":
            raise InputError(f"interpolation {method} needs an interpolation_degree")
        return [("INTERPOLATION", method)]
    else:
        stated = segment.interpolation_degree
        if stated < 1 or (method != "PROPAGATE" and states_needed(method, stated) > count):
            raise InputError(
                f"interpolation_degree {stated} ({method}) needs "
                f"{states_needed(method, max(stated, 1))} states, the segment has {count}"
            )
    return [("INTERPOLATION", method), ("INTERPOLATION_DEGREE", str(stated))]


def _check_names(segment: OemSegment) -> None:
    if not is_frame(segment.ref_frame):
        raise InputError(
            f"an ephemeris message needs an inertial frame ({', '.join(INERTIAL_FRAMES)}) or "
            f"another registered one, got {segment.ref_frame!r}"
        )
    for key in ("object_name", "object_id", "center_name"):
        value = getattr(segment, key)
        if not _NAME.fullmatch(value) or not value.isprintable():
            raise InputError(f"{key} must be one line of text without '=', got {value!r}")
    if not segment.comment.isprintable():
        raise InputError(f"comment must be one line of text, got {segment.comment!r}")


def _check_states(segment: OemSegment) -> None:
    t, x, a = segment.t_s, segment.x, segment.accelerations_m_s2
    if x.shape != (6, t.size) or not t.size:
        raise InputError(f"states must be (6, {t.size}) at {t.size} ≥ 1 times, got {x.shape}")
    if a is not None and a.shape != (3, t.size):
        raise InputError(f"accelerations must be (3, {t.size}), got {a.shape}")
    finite = _are_finite(x, t) and (a is None or _are_finite(a))
    if not (finite and np.all(np.diff(t) > 0.0)):
        raise InputError(
            f"{segment.object_name}: times must rise and all states be finite; cut it before "
            "the flight ends"
        )


def _are_finite(*arrays: Array) -> bool:
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def _check_covariances(segment: OemSegment) -> None:
    before = -np.inf
    for one in segment.covariances:
        matrix = one.matrix
        if matrix.shape != (6, 6) or not _are_finite(matrix) or np.any(matrix != matrix.T):
            raise InputError(
                f"{segment.object_name}: a covariance must be a finite, symmetric 6 × 6 matrix"
            )
        # as coarse as the reader's: a matrix may come from a message of few digits
        if (least := least_eigenvalue(matrix)) < -1e-3:
            raise InputError(
                f"{segment.object_name}: a covariance must be positive semidefinite; its "
                f"correlations have the eigenvalue {least:.3g}"
            )
        if one.ref_frame and not is_covariance_frame(one.ref_frame):
            raise InputError(f"no covariance frame {one.ref_frame[:40]!r}")
        if not before < one.t_s < np.inf:
            raise InputError(f"{segment.object_name}: times of covariances must rise")
        before = one.t_s


def _span(segment: OemSegment) -> tuple[float, float]:
    """Return start and stop of a segment, between which all it states must lie."""
    instants = [*segment.t_s[[0, -1]], *(one.t_s for one in segment.covariances)]
    start = min(instants) if segment.start_s is None else segment.start_s
    stop = max(instants) if segment.stop_s is None else segment.stop_s
    useable = [t for t in (segment.useable_start_s, segment.useable_stop_s) if t is not None]
    ordered = [start, *useable, stop]
    if ordered != sorted(ordered) or start > min(instants) or stop < max(instants):
        raise InputError(
            f"{segment.object_name}: states, covariances and the useable span must lie between "
            "start and stop"
        )
    return start, stop
