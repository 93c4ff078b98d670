"""The encodings of orbit mean-elements messages: text (KVN), XML, and the JSON and CSV of services.

Each function yields one list of `Entry` for each message. The keywords are those of the standard
[1]_. JSON and CSV are not part of it: the services CelesTrak and Space-Track publish general
perturbations elements in them, under the keywords of the standard and a few of their own [2]_.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 4 (OMM) and 8 (XML).
.. [2] T. S. Kelso (2020), A New Way to Obtain GP Data, CelesTrak; Space-Track.org, the class gp.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError
from hillsphere.formats.ccsds_entries import Entry, Leniency, order_entries, split_unit
from hillsphere.formats.ccsds_xml import walk_xml

__all__ = ["COVARIANCE", "VERSIONS", "Entry", "encoding_of", "kvn_messages"]


_AXES = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
COVARIANCE = (
    "COV_REF_FRAME",
    *(f"C{row}_{column}" for k, row in enumerate(_AXES) for column in _AXES[: k + 1]),
)
"""Keywords of a covariance: its frame and the lower triangle."""
_KEYWORDS = (
    "CCSDS_OMM_VERS", "COMMENT", "CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID",
    "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "REF_FRAME_EPOCH", "TIME_SYSTEM",
    "MEAN_ELEMENT_THEORY",
    "EPOCH", "SEMI_MAJOR_AXIS", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE",
    "ARG_OF_PERICENTER", "MEAN_ANOMALY", "GM",
    "MASS", "SOLAR_RAD_AREA", "SOLAR_RAD_COEFF", "DRAG_AREA", "DRAG_COEFF",
    "EPHEMERIS_TYPE", "CLASSIFICATION_TYPE", "NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH",
    "BSTAR", "BTERM", "MEAN_MOTION_DOT", "MEAN_MOTION_DDOT", "AGOM",
    *COVARIANCE,
)  # fmt: skip
VERSIONS = ("2.0", "3.0")
"""Versions of the message that are read; the standard has it from the second on."""
_VERSION = "CCSDS_OMM_VERS"
_MANDATORY = (
    _VERSION, "CREATION_DATE", "ORIGINATOR", "OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME",
    "TIME_SYSTEM", "MEAN_ELEMENT_THEORY",
)  # fmt: skip
"""Keywords that a message as text or XML must have; its elements are checked
with their values."""
_MAY_BE_EMPTY = ("CREATION_DATE", "ORIGINATOR", "OBJECT_NAME", "OBJECT_ID")
"""Mandatory keywords that the services leave empty where they know nothing."""
_OF_SERVICES = (
    "SEMIMAJOR_AXIS", "PERIOD", "APOAPSIS", "PERIAPSIS", "OBJECT_TYPE", "RCS_SIZE", "COUNTRY_CODE",
    "LAUNCH_DATE", "SITE", "DECAY_DATE", "DECAYED", "FILE", "GP_ID", "TLE_LINE0", "TLE_LINE1",
    "TLE_LINE2", "DATA_SOURCE",
)  # fmt: skip
"""Further keywords of the services' JSON and CSV, which repeat or add to the elements."""
_CONTAINERS = {
    "omm", "header", "body", "segment", "metadata", "data", "meanElements", "spacecraftParameters",
    "tleParameters", "covarianceMatrix", "userDefinedParameters",
}  # fmt: skip
_HAS_UNIT = (
    "MEAN_MOTION", "MEAN_MOTION_DOT", "MEAN_MOTION_DDOT", "ECCENTRICITY", "INCLINATION",
    "RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY", "BSTAR", "SEMI_MAJOR_AXIS", "GM",
)  # fmt: skip
"""Keywords whose value may be followed by a unit; in a name, brackets are part of it."""
_USER_DEFINED = "USER_DEFINED_"
_KEYWORD = re.compile(r"[A-Z][A-Z0-9_]*")
_STARTS_KVN = re.compile(r"\s*(?:COMMENT[^\n]*\n\s*)*CCSDS_OMM_VERS\s*=")
_STARTS_JSON = re.compile(r"\[\s*[{\]]|\{\s*\"")
_STARTS_CSV = re.compile(r"(?=[^\n]*\bNORAD_CAT_ID\b)(?=[^\n]*\bMEAN_MOTION\b)[^\n]*,")

_AROUND = ((1, "ndm"), (2, "COMMENT"), (2, "MESSAGE_ID"))
"""Elements that may stand outside a message, with their depths."""

Messages = Iterator[tuple[str, list[Entry]]]
Reader = Callable[[str, str, Leniency], Messages]


def encoding_of(text: str) -> tuple[str, Reader] | None:
    """Return the name and the reader of the encoding in which a text begins, None if in none."""
    start = text.lstrip("\ufeff \t\r\n")
    if _STARTS_KVN.match(start):
        return "omm", kvn_messages
    if start.startswith("<"):
        return "omm_xml", _xml_messages
    if _STARTS_JSON.match(start):
        return "omm_json", _json_messages
    if _STARTS_CSV.match(start):
        return "omm_csv", _csv_messages
    return None


def kvn_messages(text: str, where: str, leniency: Leniency) -> Messages:
    """Yield the place and the entries of each message of a text."""
    entries: list[Entry] = []
    remarks: list[Entry] = []
    start = where
    for number, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        line, place = raw.strip(), f"{where}:{number}"
        if not line:
            continue
        if line == "COMMENT" or line.startswith("COMMENT "):
            (entries or remarks).append(Entry(place, "COMMENT", line[8:]))
            continue
        key, sign, value = (part.strip() for part in line.partition("="))
        if not (sign and _KEYWORD.fullmatch(key)):
            raise InputError(f"{place}: expected KEYWORD = value, got {line[:40]!r}")
        if key == _VERSION and entries:
            yield start, _in_order(entries, leniency)
            entries = []
        if not entries:
            start = place
            entries, remarks = [*remarks, *entries], []
        value, unit = split_unit(value) if key in _HAS_UNIT else (value, "")
        entries += _check_keyword(Entry(place, key, value, unit), leniency)
    if entries:
        yield start, _in_order(entries, leniency)


def _in_order(entries: list[Entry], leniency: Leniency) -> list[Entry]:
    """Return the entries of a message, if they are those it must have, in the standard's order."""
    of_the_standard = [
        entry._replace(value=entry.value or "unknown") if entry.key in _MAY_BE_EMPTY else entry
        for entry in entries
        if entry.key != "COMMENT" and not entry.key.startswith(_USER_DEFINED)
    ]
    order_entries(
        of_the_standard, tuple(key for key in _KEYWORDS if key != "COMMENT"), _MANDATORY,
        "an orbit mean-elements message", entries[-1].place, leniency,
        ("CREATION_DATE", "ORIGINATOR"),
    )  # fmt: skip
    return entries


def _xml_messages(text: str, where: str, leniency: Leniency) -> Messages:
    for place, entries in _XmlMessages(leniency).read(text, where):
        yield place, _in_order(entries, leniency)


def _start_of(text: str) -> tuple[str, int]:
    """Return a text from its first character on, and the number of lines above it."""
    start = text.lstrip("\ufeff \t\r\n")
    return start, text[: len(text) - len(start)].count("\n")


class _XmlMessages:
    """Collector of the leaves of each message in XML."""

    def __init__(self, leniency: Leniency) -> None:
        self._leniency = leniency
        self._depth = 0
        self._messages: list[tuple[str, list[Entry]]] = []
        self._within = False
        self._key, self._unit, self._place = "", "", ""

    def read(self, text: str, where: str) -> list[tuple[str, list[Entry]]]:
        """Return the place and the entries of each message."""
        walk_xml(text, where, self._start, self._end)
        return self._messages

    def _start(self, place: str, name: str, attributes: dict[str, str]) -> None:
        if self._key:  # so far it looked like a keyword
            raise InputError(
                f"{self._place}: {self._key[:60]!r} must hold a value, not further elements"
            )
        self._depth += 1
        if name == "omm":
            version = attributes.get("version", "")
            first = [Entry(place, _VERSION, version)] if version else []
            self._messages.append((place, first))
            self._within = True
        elif not self._within and (self._depth, name) not in _AROUND:
            hint = did_you_mean(name, ("omm",), otherwise="expected")
            raise InputError(
                f"{place}: no orbit mean-elements message: <{name[:60]}>{hint}; "
                "`hillsphere.formats.ndm.split_ndm` gives the parts of each kind"
            )
        elif self._within and name not in _CONTAINERS:
            self._key, self._unit, self._place = name, attributes.get("units", ""), place
            if name == "USER_DEFINED":
                self._key = f"USER_DEFINED_{attributes.get('parameter', '')}"

    def _end(self, name: str, text: str) -> None:
        if self._key:
            entry = Entry(self._place, self._key, text, self._unit)
            self._messages[-1][1].extend(_check_keyword(entry, self._leniency))
        self._key = ""
        self._depth -= 1
        if name == "omm":
            self._within = False


def _json_messages(text: str, where: str, leniency: Leniency) -> Messages:
    def refuse(word: str) -> NoReturn:
        raise ValueError(f"{word} is no number of JSON")

    try:
        # Numbers stay texts: the digits of a file are kept as they are.
        content = json.loads(
            text.lstrip("\ufeff"), parse_float=str, parse_int=str, parse_constant=refuse,
            object_pairs_hook=_Pairs,
        )  # fmt: skip
    except (ValueError, RecursionError) as error:
        reason = "too deep" if isinstance(error, RecursionError) else error
        raise InputError(f"{where}: not well-formed JSON: {reason}") from error
    messages = [content] if isinstance(content, _Pairs) else content
    for number, message in enumerate(messages, start=1):
        place = f"{where}, message {number}"
        if not isinstance(message, _Pairs):
            raise InputError(f"{place}: expected an object of keywords and values")
        yield (
            place,
            [entry for key, value in message for entry in _of_service(place, key, value, leniency)],
        )


class _Pairs(list[tuple[str, Any]]):
    """Keys and values of a JSON object, doubled ones included."""


def _csv_messages(text: str, where: str, leniency: Leniency) -> Messages:
    start, above = _start_of(text)
    rows = csv.reader(start.splitlines(), strict=True)
    try:
        head = [name.strip() for name in next(rows, [])]
        for row in rows:
            if not row:
                continue
            place = f"{where}:{rows.line_num + above}"
            if len(row) != len(head):
                raise InputError(f"{place}: expected {len(head)} columns, got {len(row)}")
            yield (
                place,
                [
                    entry
                    for key, value in zip(head, row, strict=True)
                    for entry in _of_service(place, key, value, leniency)
                ],
            )
    except csv.Error as error:
        place = f"{where}:{rows.line_num + above}"
        raise InputError(f"{place}: not well-formed CSV: {error}") from error


def _of_service(place: str, key: str, value: Any, leniency: Leniency) -> list[Entry]:
    if value is not None and not isinstance(value, str):
        raise InputError(f"{place}: {key[:40]} must be a number or text")
    return _check_keyword(Entry(place, key, (value or "").strip()), leniency, _OF_SERVICES)


def _check_keyword(entry: Entry, leniency: Leniency, further: tuple[str, ...] = ()) -> list[Entry]:
    """Return an entry; none if there is no such keyword and that is tolerated."""
    if not (entry.key in _KEYWORDS or entry.key in further or entry.key.startswith(_USER_DEFINED)):
        hint = did_you_mean(entry.key, (*_KEYWORDS, *further), otherwise="keywords")
        leniency.tolerate(
            f"{entry.place}: an orbit mean-elements message has no keyword {entry.key[:60]!r}{hint}"
        )
        return []
    return [entry]
