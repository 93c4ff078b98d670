"""States and ephemerides as files: CCSDS OPM, OEM and OCM, and a table for other programs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.formats.ocm import ephemeris_segments, read_ocm
from hillsphere.formats.oem import OemSegment, read_oem, states_csv, write_oem
from hillsphere.formats.opm import Opm, read_opm, write_opm
from hillsphere.formats.specs import FileFormatSpec, OrbitMessageSpec

__all__ = ["OcmFile", "OemFile", "OemXml", "OpmFile", "OpmXml", "StatesCsv"]


class _Message:
    """A CCSDS message in one of its encodings, by which its beginning is recognised.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    kind: str
    encoding = "kvn"

    def __init__(self, spec: OrbitMessageSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether a file begins as this message does in this encoding."""
        if self.encoding == "xml":
            return _is_xml(beginning) and bool(re.search(rf"<(\w+:)?{self.kind}\b", beginning))
        return f"CCSDS_{self.kind.upper()}_VERS" in beginning and not _is_xml(beginning)


class OemFile(_Message):
    """CCSDS Orbit Ephemeris Messages in the text form; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    kind = "oem"
    content = "ephemeris"
    suffixes: tuple[str, ...] = (".oem",)

    def read(self, path: Path) -> tuple[list[OemSegment], tuple[str, ...]]:
        """Read a message; see `hillsphere.formats.oem.read_oem`."""
        segments = read_oem(_text_of(path), str(path), lenient=self.spec.lenient)
        return segments, tuple(dict.fromkeys(what for one in segments for what in one.passed_over))

    def write(self, content: Sequence[OemSegment]) -> tuple[str, tuple[str, ...]]:
        """Return the message, which holds all fields of an `OemSegment`."""
        return write_oem(content, encoding=self.encoding), ()


class OemXml(OemFile):
    """CCSDS Orbit Ephemeris Messages as XML; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    suffixes = (".xml",)
    encoding = "xml"


class OpmFile(_Message):
    """CCSDS Orbit Parameter Messages in the text form; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    kind = "opm"
    content = "state"
    suffixes: tuple[str, ...] = (".opm",)

    def read(self, path: Path) -> tuple[Opm, tuple[str, ...]]:
        """Read a message; see `hillsphere.formats.opm.read_opm`."""
        return read_opm(_text_of(path), str(path), lenient=self.spec.lenient), ()

    def write(self, content: Opm) -> tuple[str, tuple[str, ...]]:
        """Return the message, which holds all fields of an `Opm`."""
        return write_opm(content, encoding=self.encoding), ()


class OpmXml(OpmFile):
    """CCSDS Orbit Parameter Messages as XML; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    suffixes = (".xml",)
    encoding = "xml"


class OcmFile:
    """CCSDS Orbit Comprehensive Messages in either form, whose histories of states are read.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    content = "ephemeris"
    suffixes: tuple[str, ...] = (".ocm",)

    def __init__(self, spec: OrbitMessageSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the beginning of a file is that of such a message."""
        return "CCSDS_OCM_VERS" in beginning and not re.search(r"<(\w+:)?ndm\b", beginning)

    def read(self, path: Path) -> tuple[list[OemSegment], tuple[str, ...]]:
        """Read the histories of positions and velocities, and name what else the message holds."""
        message = read_ocm(_text_of(path), str(path), lenient=self.spec.lenient)
        lost = [
            f"covariances ({len(message.covariances)} blocks)" if message.covariances else "",
            f"manoeuvres ({len(message.manoeuvres)} blocks)" if message.manoeuvres else "",
            "orbit determination" if message.orbit_determination else "",
            "comments" if message.comments else "",
            "metadata beyond object, centre, frame and times",
        ]
        lost += [f"the block {text.kind}: {text.reason}" for text in message.texts]
        lost += [
            f"the block TRAJ ({one.metadata['TRAJ_TYPE']})"
            for one in message.trajectories
            if one.x is None or one.x.shape[0] < 6
        ]
        segments = ephemeris_segments(message)
        return segments, tuple(dict.fromkeys(text for text in lost if text))

    def write(self, content: Sequence[OemSegment]) -> tuple[str, tuple[str, ...]]:
        """Refuse to write such a message."""
        raise InputError("an orbit comprehensive message is only read; write an OEM")


class StatesCsv:
    """A table of epochs, positions (km) and velocities (km/s), as the stage `ephemeris` writes it.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "ephemeris"
    suffixes = (".csv",)

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return False: the table does not say to which frame and centre its states refer."""
        return False

    def read(self, path: Path) -> tuple[list[OemSegment], tuple[str, ...]]:
        """Refuse to read a table, which lacks what an ephemeris must state."""
        raise InputError(
            f"{path}: a table of states says nothing of its frame, centre and time system; it is "
            "only written"
        )

    def write(self, content: Sequence[OemSegment]) -> tuple[str, tuple[str, ...]]:
        """Return the table, and what it does not hold.

        Raises
        ------
        InputError
            If the segments differ in object, centre, frame or time system, since no row could say
            to which of them it belongs.
        """
        first = content[0]
        for number, other in enumerate(content[1:], start=2):
            differ = [
                f"{what} ({one}, {another})"
                for what, one, another in zip(
                    ("object", "object identifier", "centre", "frame", "time system"),
                    _references(first), _references(other), strict=True,
                )
                if one != another
            ]  # fmt: skip
            if differ:
                raise InputError(
                    f"segments 1 and {number} differ in {', '.join(differ)}, which a table of "
                    "states does not say; split the ephemeris first"
                )
        lost = [
            f"object ({first.object_name}, {first.object_id}), centre ({first.center_name}), frame "
            f"({first.ref_frame}), time system ({first.epoch.scale})"
        ]
        if len(content) > 1:
            lost.append(f"limits of the {len(content)} segments")
        lost += [what for what, is_held in _HELD_IN_OEM.items() if any(map(is_held, content))]
        return states_csv(content), tuple(lost)


_HELD_IN_OEM: dict[str, Callable[[OemSegment], object]] = {
    "comments": lambda one: one.comment,
    "accelerations": lambda one: one.accelerations_m_s2 is not None,
    "covariances": lambda one: one.covariances,
    "useable span": lambda one: (one.useable_start_s, one.useable_stop_s) != (None, None),
    "START_TIME and STOP_TIME, which differ from the first and last state": lambda one: (
        one.start_s not in (None, one.t_s[0]) or one.stop_s not in (None, one.t_s[-1])
    ),
    "recommended interpolation": lambda one: one.interpolation,
    "epoch of the frame": lambda one: one.ref_frame_epoch,
}
"""What a segment may hold for which a table has no column."""


def _text_of(path: Path) -> str:
    """Return the text of a file; `InputError` if it cannot be read."""
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason or error}") from error


def _is_xml(beginning: str) -> bool:
    """Return whether a file begins as XML does."""
    # the beginning of a file is decoded as Latin-1, in which a byte order mark is three letters
    return beginning.lstrip("\ufeff\u00ef\u00bb\u00bf \t\r\n").startswith("<")


def _references(segment: OemSegment) -> tuple[str, ...]:
    """Return to what the states of a segment refer."""
    return (
        segment.object_name, segment.object_id, segment.center_name, segment.ref_frame,
        segment.epoch.scale,
    )  # fmt: skip
