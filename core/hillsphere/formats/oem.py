"""CCSDS Orbit Ephemeris Messages: writing and reading text (KVN) and XML.

Each segment is one object's flight without a manoeuvre: states in one frame about one centre, at
epochs of one time scale.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 5 (OEM) and 8 (XML).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.ndm_parts import parts_of_kind
from hillsphere.formats.oem_encodings import take_apart
from hillsphere.formats.oem_reading import segments_of
from hillsphere.formats.oem_segments import INERTIAL_FRAMES, OemCovariance, OemSegment
from hillsphere.formats.oem_writing import write_kvn, write_xml

__all__ = [
    "INERTIAL_FRAMES",
    "OemCovariance",
    "OemSegment",
    "read_oem",
    "states_csv",
    "write_oem",
]


def write_oem(
    segments: Sequence[OemSegment],
    *,
    originator: str = "HILLSPHERE",
    created: datetime | None = None,
    degree: int = 7,
    encoding: str = "kvn",
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
        Degree of the Lagrange interpolation that the message recommends for a segment whose
        `interpolation` is None, less where it has too few states.
    encoding : str
        ``"kvn"`` for text, ``"xml"`` for XML.

    Returns
    -------
    str
        The message. Numbers are the shortest that are read back as they are; times have the
        decimals that the segment states, 1 µs by default.

    Raises
    ------
    InputError
        If a frame is not registered, a name is empty, a name or comment is more than a line, a
        segment has no finite states at times that rise by microseconds at least, or what it states
        beyond them could not be read again.
    """
    write = write_xml if encoding == "xml" else write_kvn
    return write(segments, originator, created, degree)


def states_csv(segments: Sequence[OemSegment]) -> str:
    """Return the states of all segments as a table: time, positions in km, velocities in km/s."""
    lines = ["time,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"]
    for segment in segments:
        times = segment.epoch.isot(segment.t_s, segment.time_digits)
        lines += [
            ",".join([when, *(repr(float(value)) for value in state)])
            for when, state in zip(times, segment.x.T / 1e3, strict=True)
        ]
    return "\n".join(lines) + "\n"


def read_oem(text: str, where: str = "OEM", *, lenient: bool = False) -> list[OemSegment]:
    """Read an Orbit Ephemeris Message: text (KVN) or XML, version 1.0, 2.0 or 3.0.

    An ``<ndm>`` of several such messages gives the segments of all.

    Comments are not kept, except for a single one in the metadata, and neither are CLASSIFICATION
    and MESSAGE_ID; `OemSegment.passed_over` names those that the message has.

    Parameters
    ----------
    text : str
        The message.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures from the standard become warnings of the segments: an unknown
        keyword of header or metadata, the order of their keywords, a header without originator or
        date, a customary name of a registered frame.

    Returns
    -------
    list of OemSegment
        Times count from the first state of each.

    Raises
    ------
    InputError
        Naming the line and the keyword, if the message departs from the standard or uses a time
        system that `Epoch` does not have.
    """
    leniency = Leniency.collecting(lenient)
    segments = [
        segment
        for part in parts_of_kind(text, where, "oem")
        for segment in segments_of(take_apart(part, where), leniency)
    ]
    warnings = tuple(leniency.warnings)
    return [replace(one, warnings=warnings) for one in segments] if warnings else segments
