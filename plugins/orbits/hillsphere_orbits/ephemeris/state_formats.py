"""Ephemerides as files: CCSDS OEM, and a table of states for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.formats.oem import OemSegment, read_oem, states_csv, write_oem
from hillsphere.formats.specs import FileFormatSpec

__all__ = ["OemFile", "StatesCsv"]


class OemFile:
    """CCSDS Orbit Ephemeris Messages in the text form; km and km/s.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "ephemeris"
    suffixes = (".oem",)

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the text says that it is such a message."""
        return "CCSDS_OEM_VERS" in beginning

    def read(self, path: Path) -> tuple[list[OemSegment], tuple[str, ...]]:
        """Read a message; see `hillsphere.formats.oem.read_oem`."""
        try:
            segments = read_oem(read_text(path))
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            raise InputError(f"{path}: cannot be read: {reason or error}") from error
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        return segments, tuple(dict.fromkeys(what for one in segments for what in one.passed_over))

    def write(self, content: Sequence[OemSegment]) -> tuple[str, tuple[str, ...]]:
        """Return a message; positions to 1 µm, velocities to 1 nm/s, times to 1 µs."""
        return write_oem(content), ()


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
        return states_csv(content), tuple(lost)


def _references(segment: OemSegment) -> tuple[str, ...]:
    """Return to what the states of a segment refer."""
    return (
        segment.object_name, segment.object_id, segment.center_name, segment.ref_frame,
        segment.epoch.scale,
    )  # fmt: skip
