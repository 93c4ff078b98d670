"""Ephemerides as files: CCSDS OEM, and a table of states for other programs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.formats.oem import OemSegment, read_oem, states_csv, write_oem
from hillsphere.formats.specs import FileFormatSpec, OrbitMessageSpec

__all__ = ["OemFile", "OemXml", "StatesCsv", "is_xml", "text_of"]


class OemFile:
    """CCSDS Orbit Ephemeris Messages in the text form; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    content = "ephemeris"
    suffixes: tuple[str, ...] = (".oem",)
    encoding = "kvn"

    def __init__(self, spec: OrbitMessageSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the text says that it is such a message."""
        return "CCSDS_OEM_VERS" in beginning and not is_xml(beginning)

    def read(self, path: Path) -> tuple[list[OemSegment], tuple[str, ...]]:
        """Read a message; see `hillsphere.formats.oem.read_oem`."""
        segments = read_oem(text_of(path), str(path), lenient=self.spec.lenient)
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

    def recognises(self, beginning: str) -> bool:
        """Return whether the beginning of an XML file has the element of such a message."""
        return is_xml(beginning) and bool(re.search(r"<(\w+:)?oem\b", beginning))


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


def text_of(path: Path) -> str:
    """Return the text of a file; `InputError` if it cannot be read."""
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason or error}") from error


def is_xml(beginning: str) -> bool:
    """Return whether a file begins as XML does."""
    # the beginning of a file is decoded as Latin-1, in which a byte order mark is three letters
    return beginning.lstrip("\ufeff\u00ef\u00bb\u00bf \t\r\n").startswith("<")


def _references(segment: OemSegment) -> tuple[str, ...]:
    """Return to what the states of a segment refer."""
    return (
        segment.object_name, segment.object_id, segment.center_name, segment.ref_frame,
        segment.epoch.scale,
    )  # fmt: skip
