"""Reader of CCSDS Orbit Mean-Elements Messages (OMM) for SGP4, in the text form (KVN) and in XML.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 4 (OMM) and annex on XML.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from hillsphere.errors import InputError
from hillsphere.time import Epoch

__all__ = ["Omm", "read_omms"]

_MUST_BE = {
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4"),
    "EPHEMERIS_TYPE": ("0", "2"),
}
_NUMBERS = (
    "MEAN_MOTION",
    "ECCENTRICITY",
    "INCLINATION",
    "RA_OF_ASC_NODE",
    "ARG_OF_PERICENTER",
    "MEAN_ANOMALY",
    "BSTAR",
)
_OPTIONAL = {"MEAN_MOTION_DOT": 0.0, "MEAN_MOTION_DDOT": 0.0}
_KEYWORD = re.compile(r"[A-Z][A-Z0-9_]*")
_DAY_OF_YEAR = re.compile(r"(\d{4})-(\d{3})(T.*)")


@dataclass(frozen=True)
class Omm:
    """An orbit mean-elements message with elements for SGP4.

    Parameters
    ----------
    name : str
        Name of the satellite.
    epoch : Epoch
        Epoch of the elements, UTC.
    fields : mapping of str to str
        Checked values by keyword, as `sgp4.omm.initialize` takes them.
    """

    name: str
    epoch: Epoch
    fields: Mapping[str, str]


def read_omms(text: str, where: str = "OMM") -> tuple[Omm, ...]:
    """Read orbit mean-elements messages, in the text form (KVN) or as XML.

    Parameters
    ----------
    text : str
        One or more messages.
    where : str
        Name of the file, used in error messages.

    Returns
    -------
    tuple of Omm
        In the order of the text.

    Raises
    ------
    InputError
        If the text is not such a message, a keyword is missing or out of range, or the elements do
        not belong to SGP4 (theory, frame or time system).
    """
    read = _xml if text.lstrip("\ufeff \t\r\n").startswith("<") else _kvn
    messages = list(read(text, where))
    if not messages:
        raise InputError(f"{where}: the file contains no orbit mean-elements message")
    return tuple(_validate_message(fields, place) for place, fields in messages)


def _kvn(text: str, where: str) -> Iterator[tuple[str, dict[str, str]]]:
    fields: dict[str, str] = {}
    place = where
    for number, raw in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith("COMMENT"):
            continue
        key, sign, value = (part.strip() for part in line.partition("="))
        if not (sign and _KEYWORD.fullmatch(key)):
            raise InputError(f"{where}:{number}: expected KEYWORD = value, got {line[:40]!r}")
        if value.endswith("]"):  # a unit: 3.0539 [deg]
            value = value[: max(value.rfind("["), 0)].rstrip()
        if key == "CCSDS_OMM_VERS" and fields:
            yield place, fields
            fields = {}
        if key in fields:
            raise InputError(f"{where}:{number}: {key} occurs twice in one message; keep one")
        if not fields:
            place = f"{where}:{number}"
        fields[key] = value
    if fields:
        yield place, fields


def _xml(text: str, where: str) -> Iterator[tuple[str, dict[str, str]]]:
    # Entities could make a small file huge; no message of this standard needs them.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{where}: an orbit message must not contain a DOCTYPE; remove it")
    try:
        root = ET.fromstring(text.lstrip("\ufeff \t\r\n"))
    except ET.ParseError as error:
        raise InputError(f"{where}: not well-formed XML: {error}") from error
    messages = (element for element in root.iter() if _tag(element) == "omm")
    for number, message in enumerate(messages, start=1):
        leaves = (element for element in message.iter() if not len(element))
        yield (
            f"{where}, message {number}",
            {_tag(leaf): (leaf.text or "").strip() for leaf in leaves},
        )


def _tag(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _validate_message(given: Mapping[str, str], where: str) -> Omm:
    name = given.get("OBJECT_NAME") or given.get("OBJECT_ID") or given.get("NORAD_CAT_ID", "")
    where = f"{where} ({name})" if name else where
    for key, allowed in _MUST_BE.items():
        value = given.get(key, allowed[0])
        if value.upper() not in allowed:
            raise InputError(
                f"{where}: {key} must be {' or '.join(allowed)} for elements that SGP4 can "
                f"propagate, got {value[:40]!r}"
            )
    numbers = {key: _number(given, key, where) for key in _NUMBERS}
    numbers |= {
        key: _number(given, key, where) if key in given else value
        for key, value in _OPTIONAL.items()
    }
    for key, low, high in (
        ("ECCENTRICITY", 0.0, 1.0 - 1e-12),
        ("INCLINATION", 0.0, 180.0),
        ("MEAN_MOTION", 1e-3, 20.0),
    ):
        if not low <= numbers[key] <= high:
            raise InputError(
                f"{where}: {key} must be between {low:g} and {high:g}, got {numbers[key]!r}"
            )
    epoch = _epoch(given, where)
    fields = {
        "OBJECT_ID": given.get("OBJECT_ID", ""),
        "CLASSIFICATION_TYPE": given.get("CLASSIFICATION_TYPE") or "U",
        "EPHEMERIS_TYPE": "0",
        "ELEMENT_SET_NO": _count(given, "ELEMENT_SET_NO", where),
        "REV_AT_EPOCH": _count(given, "REV_AT_EPOCH", where),
        "NORAD_CAT_ID": _count(given, "NORAD_CAT_ID", where),
        "EPOCH": epoch.isot(np.zeros(1), 6)[0],
        **{key: repr(value) for key, value in numbers.items()},
    }
    return Omm(name or fields["NORAD_CAT_ID"], epoch, fields)


def _number(given: Mapping[str, str], key: str, where: str) -> float:
    text = given.get(key, "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        got = f"got {text[:40]!r}" if text else "it is missing"
        raise InputError(f"{where}: {key} must be a finite number; {got}")
    return value


def _count(given: Mapping[str, str], key: str, where: str) -> str:
    text = given.get(key) or "0"
    if not text.isascii() or not text.isdigit():
        raise InputError(f"{where}: {key} must be a whole number, got {text[:40]!r}")
    return text


def _epoch(given: Mapping[str, str], where: str) -> Epoch:
    text = given.get("EPOCH", "").removesuffix("Z")
    if not text:
        raise InputError(f"{where}: EPOCH is missing")
    try:
        if match := _DAY_OF_YEAR.fullmatch(text):
            year, day, clock = match.groups()
            date = datetime(int(year), 1, 1) + timedelta(days=int(day) - 1)
            if f"{date:%Y}" != year:
                raise InputError(f"{text!r} has no such day of the year")
            text = f"{date:%Y-%m-%d}{clock}"
        return Epoch.parse(text, "UTC")
    except (InputError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: EPOCH: {error}") from error
