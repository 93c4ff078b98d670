"""States of spacecraft as files: CCSDS OPM, and the histories of an OCM."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from hillsphere.base.errors import InputError
from hillsphere.formats.ocm import ephemeris_segments, read_ocm
from hillsphere.formats.oem import OemSegment
from hillsphere.formats.opm import Opm, read_opm, write_opm
from hillsphere.formats.specs import OrbitMessageSpec
from hillsphere_orbits.ephemeris.state_formats import is_xml, text_of

__all__ = ["OcmFile", "OpmFile", "OpmXml"]


class OpmFile:
    """CCSDS Orbit Parameter Messages in the text form; km and km/s.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    content = "state"
    suffixes: tuple[str, ...] = (".opm",)
    encoding = "kvn"

    def __init__(self, spec: OrbitMessageSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the text says that it is such a message."""
        return "CCSDS_OPM_VERS" in beginning and not is_xml(beginning)

    def read(self, path: Path) -> tuple[Opm, tuple[str, ...]]:
        """Read a message; see `hillsphere.formats.opm.read_opm`."""
        return read_opm(text_of(path), str(path), lenient=self.spec.lenient), ()

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

    def recognises(self, beginning: str) -> bool:
        """Return whether the beginning of an XML file has the element of such a message."""
        return is_xml(beginning) and bool(re.search(r"<(\w+:)?opm\b", beginning))


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
        message = read_ocm(text_of(path), str(path), lenient=self.spec.lenient)
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
