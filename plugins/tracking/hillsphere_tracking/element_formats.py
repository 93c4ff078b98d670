"""Mean elements for SGP4 as files: two-line element sets (TLE) and CCSDS OMM in four encodings.

Every number of an element set is decimal, so that an OMM can hold it digit by digit. The reverse
rounds to the digits of the set and says so, see `hillsphere_tracking.element_sets`.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path
from xml.sax.saxutils import escape

from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.formats.specs import FileFormatSpec, OrbitMessageSpec
from hillsphere_tracking.element_sets import element_set_of, fields_of
from hillsphere_tracking.omm import Omm, omm_of_fields, read_omms
from hillsphere_tracking.omm_encodings import encoding_of
from hillsphere_tracking.sgp4_orbit import Sgp4Orbit
from hillsphere_tracking.tle import read_tles

__all__ = ["OmmCsv", "OmmFile", "OmmJson", "OmmXml", "TleFile"]

_ELEMENTS = (
    "EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER",
    "MEAN_ANOMALY",
)  # fmt: skip
_OF_A_SET = (
    "EPHEMERIS_TYPE", "CLASSIFICATION_TYPE", "NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH",
    "BSTAR", "MEAN_MOTION_DOT", "MEAN_MOTION_DDOT",
)  # fmt: skip
_TEXTS = ("OBJECT_NAME", "OBJECT_ID", "EPOCH", "CLASSIFICATION_TYPE")
_METADATA = {
    "CENTER_NAME": "EARTH", "REF_FRAME": "TEME", "TIME_SYSTEM": "UTC",
    "MEAN_ELEMENT_THEORY": "SGP4",
}  # fmt: skip
_READS_AS_LINE = re.compile("[012] ")
"""Beginnings of names that a reader takes for a mark of the line, not for part of the name."""


class TleFile:
    """Two-line element sets, each with or without a title line; angles in degrees.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "set of mean elements"
    suffixes = (".tle", ".3le")

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether one of the first two lines is line 1 of an element set."""
        lines = [line.rstrip() for line in beginning.splitlines() if line.strip()]
        return any(line.startswith("1 ") and len(line) in (68, 69) for line in lines[:2])

    def read(self, path: Path) -> tuple[tuple[Omm, ...], tuple[str, ...]]:
        """Read element sets; see `hillsphere_tracking.tle.read_tles`."""
        sets = read_tles(_text(path), str(path))
        return tuple(omm_of_fields(fields_of(one), one.place) for one in sets), ()

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return element sets with title lines, and which numbers were rounded or left out.

        Raises
        ------
        InputError
            If a number does not fit into its columns.
        """
        lines: list[str] = []
        lost: list[str] = []
        for message in content:
            # In the form of three lines a title begins with "0 ".
            mark = "0 " if _READS_AS_LINE.match(message.name) else ""
            one, two, unheld = element_set_of(message)
            lines += [mark + message.name, one, two]
            lost += [f"{message.name}: {what}" for what in unheld]
        return "\n".join(lines) + "\n", tuple(lost)

    def orbits(self, content: Sequence[Omm]) -> tuple[Sgp4Orbit, ...]:
        """Return the orbits of element sets by SGP4; see `Sgp4Orbit`."""
        return tuple(map(Sgp4Orbit.from_omm, content))


class OmmFile:
    """CCSDS Orbit Mean-Elements Messages as text (KVN).

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    content = "set of mean elements"
    suffixes: tuple[str, ...] = (".omm",)
    encoding = "omm"

    def __init__(self, spec: OrbitMessageSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the text begins like such messages."""
        encoding = encoding_of(beginning)
        return encoding is not None and encoding[0] == self.encoding

    def read(self, path: Path) -> tuple[tuple[Omm, ...], tuple[str, ...]]:
        """Read messages in any encoding; see `hillsphere_tracking.omm.read_omms`."""
        messages = read_omms(_text(path), str(path), lenient=self.spec.lenient)
        return messages, tuple(dict.fromkeys(what for one in messages for what in one.passed_over))

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return the messages, which hold all fields of an `Omm`."""
        lines: list[str] = []
        for message in content:
            fields = {"CCSDS_OMM_VERS": "2.0", **_header(), **_metadata_of(message)}
            fields |= {key: message.fields[key] for key in (*_ELEMENTS, *_OF_A_SET)}
            lines += [f"{key} = {value}".rstrip() for key, value in fields.items()]
        return "\n".join(lines) + "\n", ()

    def orbits(self, content: Sequence[Omm]) -> tuple[Sgp4Orbit, ...]:
        """Return the orbits of messages by SGP4; see `Sgp4Orbit`."""
        return tuple(map(Sgp4Orbit.from_omm, content))


class OmmXml(OmmFile):
    """CCSDS Orbit Mean-Elements Messages as XML.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    suffixes = (".xml",)
    encoding = "omm_xml"

    def recognises(self, beginning: str) -> bool:
        """Return whether the beginning of an XML file has the element of such a message."""
        return super().recognises(beginning) and bool(re.search(r"<(\w+:)?omm\b", beginning))

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return the messages, which hold all fields of an `Omm`."""
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<ndm>"]
        for message in content:
            lines += ['<omm id="CCSDS_OMM_VERS" version="2.0">', "<header>"]
            lines += _elements(_header())
            lines += ["</header>", "<body>", "<segment>", "<metadata>"]
            lines += _elements(_metadata_of(message))
            lines += ["</metadata>", "<data>", "<meanElements>"]
            lines += _elements({key: message.fields[key] for key in _ELEMENTS})
            lines += ["</meanElements>", "<tleParameters>"]
            lines += _elements({key: message.fields[key] for key in _OF_A_SET})
            lines += ["</tleParameters>", "</data>", "</segment>", "</body>", "</omm>"]
        return "\n".join([*lines, "</ndm>"]) + "\n", ()


class OmmJson(OmmFile):
    """Elements in JSON under the keywords of an OMM, as CelesTrak and Space-Track publish them.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    suffixes = (".json",)
    encoding = "omm_json"

    def recognises(self, beginning: str) -> bool:
        """Return whether the beginning of a JSON file has a keyword of such elements."""
        return super().recognises(beginning) and '"MEAN_MOTION"' in beginning

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return the elements, which hold all fields of an `Omm`."""
        # The numbers of a message are decimal already, and JSON has the same notation.
        objects = (
            ",".join(
                f"{json.dumps(key)}:{json.dumps(value) if key in _TEXTS else value}"
                for key, value in _row(message).items()
            )
            for message in content
        )
        return "[" + ",\n".join(f"{{{one}}}" for one in objects) + "]\n", ()


class OmmCsv(OmmFile):
    """Elements in CSV under the keywords of an OMM, as CelesTrak and Space-Track publish them.

    Parameters
    ----------
    spec : OrbitMessageSpec
        Whether it is read leniently.
    """

    suffixes = (".csv",)
    encoding = "omm_csv"

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return the elements, which hold all fields of an `Omm`."""
        table = StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(("OBJECT_NAME", "OBJECT_ID", *_ELEMENTS, *_OF_A_SET))
        writer.writerows(_row(message).values() for message in content)
        return table.getvalue(), ()


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason or error}") from error


def _header() -> dict[str, str]:
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return {"CREATION_DATE": stamp, "ORIGINATOR": "HILLSPHERE"}


def _metadata_of(message: Omm) -> dict[str, str]:
    return {"OBJECT_NAME": message.name, "OBJECT_ID": message.fields["OBJECT_ID"], **_METADATA}


def _row(message: Omm) -> dict[str, str]:
    """Return the fields that the services publish, in their order."""
    fields = {"OBJECT_NAME": message.name, "OBJECT_ID": message.fields["OBJECT_ID"]}
    return fields | {key: message.fields[key] for key in (*_ELEMENTS, *_OF_A_SET)}


def _elements(fields: dict[str, str]) -> Iterator[str]:
    return (f"<{key}>{escape(value)}</{key}>" for key, value in fields.items())
