"""Reader of CCSDS Orbit Mean-Elements Messages (OMM) for SGP4: text (KVN), XML, JSON and CSV.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 4 (OMM).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.ccsds_times import read_ccsds_time
from hillsphere.time import Epoch
from hillsphere_tracking.omm_encodings import COVARIANCE, VERSIONS, Entry, encoding_of, kvn_messages

__all__ = ["Omm", "omm_of_fields", "read_omms"]

_MUST_BE = {
    "CCSDS_OMM_VERS": VERSIONS,
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4"),
    "EPHEMERIS_TYPE": ("0", "2"),
}
_UNITS = {
    "MEAN_MOTION": "rev/day",
    "ECCENTRICITY": "",
    "INCLINATION": "deg",
    "RA_OF_ASC_NODE": "deg",
    "ARG_OF_PERICENTER": "deg",
    "MEAN_ANOMALY": "deg",
    "BSTAR": "1/ER",
}
"""Numbers that a message must have, and the only unit that may follow each of them [1]_."""
_OPTIONAL = {"MEAN_MOTION_DOT": "rev/day**2", "MEAN_MOTION_DDOT": "rev/day**3"}
"""Numbers that are zero if they are not given."""
_TEXTS = ("OBJECT_NAME", "OBJECT_ID", "CLASSIFICATION_TYPE")
_OF_THE_FILE = ("CCSDS_OMM_VERS", "CREATION_DATE", "ORIGINATOR")
"""What says who wrote a message and when, which each file says anew."""
_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_COUNT = re.compile(r"\d{1,18}", re.ASCII)
_BELOW_A_MICROSECOND = re.compile(r"\.\d{6}\d*[1-9]")


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
    passed_over : tuple of str
        What else the message states, in words or by keyword.
    warnings : tuple of str
        What a lenient reader did not refuse.
    """

    name: str
    epoch: Epoch
    fields: Mapping[str, str]
    passed_over: tuple[str, ...] = field(default=(), compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)


def read_omms(text: str, where: str = "OMM", *, lenient: bool = False) -> tuple[Omm, ...]:
    """Read orbit mean-elements messages: text (KVN), XML, or the JSON and CSV of element services.

    Parameters
    ----------
    text : str
        One or more messages.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether unknown keywords are passed over, with warnings of the messages.

    Returns
    -------
    tuple of Omm
        In the order of the text.

    Raises
    ------
    InputError
        If the text is not such a message, a keyword is unknown, missing, doubled or out of range,
        or the elements do not belong to SGP4 (theory, frame or time system).
    """
    encoding = encoding_of(text)
    read = encoding[1] if encoding else kvn_messages
    leniency = Leniency.collecting(lenient)
    messages = tuple(_of_entries(entries, place) for place, entries in read(text, where, leniency))
    if not messages:
        raise InputError(f"{where}: the file contains no orbit mean-elements message")
    if not leniency.warnings:
        return messages
    return tuple(replace(one, warnings=tuple(leniency.warnings)) for one in messages)


def _of_entries(entries: Sequence[Entry], where: str) -> Omm:
    fields: dict[str, str] = {}
    places: dict[str, str] = {}
    for place, key, value, unit in entries:
        if key == "COMMENT":
            fields.setdefault(key, value)
            continue
        if key in fields:
            raise InputError(f"{place}: {key} occurs twice in one message; keep one")
        expected = (_UNITS | _OPTIONAL).get(key, unit)
        if unit and unit.lower() != expected.lower():
            raise InputError(
                f"{place}: {key} must be in {expected or 'no unit'}, got the unit {unit[:40]!r}"
            )
        fields[key] = value
        places[key] = place
    return omm_of_fields(fields, where, places)


def omm_of_fields(
    given: Mapping[str, str], where: str, places: Mapping[str, str] | None = None
) -> Omm:
    """Check the values of a message.

    Parameters
    ----------
    given : mapping of str to str
        Values by keyword.
    where : str
        Place of the message, used in error messages.
    places : mapping of str to str, optional
        Place of each keyword.

    Returns
    -------
    Omm
        The message.

    Raises
    ------
    InputError
        As for `read_omms`.
    """
    name = given.get("OBJECT_NAME") or given.get("OBJECT_ID") or given.get("NORAD_CAT_ID", "")
    suffix = f" ({name[:60]})" if name.isprintable() and name else ""

    def at(key: str) -> str:
        return (places or {}).get(key, where) + suffix

    for key in _TEXTS:
        # Each becomes a line of a file: one that holds a line feed could bring further elements.
        if not given.get(key, "").isprintable():
            raise InputError(
                f"{at(key)}: {key} must be one line of printable text, got {given[key][:40]!r}"
            )
    for key, allowed in _MUST_BE.items():
        value = given.get(key) or allowed[0]
        if value.upper() not in allowed:
            what = "" if key == "CCSDS_OMM_VERS" else " for elements that SGP4 can propagate"
            xp = " (SGP4-XP)" if key == "EPHEMERIS_TYPE" and value == "4" else ""
            raise InputError(
                f"{at(key)}: {key} must be {' or '.join(allowed)}{what}, got {value[:40]!r}{xp}"
            )
    numbers = {key: _number(given, key, at(key)) for key in _UNITS}
    numbers |= {key: _number(given, key, at(key)) if given.get(key) else 0.0 for key in _OPTIONAL}
    for key, low, high in (
        ("ECCENTRICITY", 0.0, 1.0 - 1e-12),
        ("INCLINATION", 0.0, 180.0),
        ("MEAN_MOTION", 1e-3, 20.0),
    ):
        if not low <= numbers[key] <= high:
            raise InputError(
                f"{at(key)}: {key} must be between {low:g} and {high:g}, got {numbers[key]!r}"
            )
    epoch = _epoch(given, at("EPOCH"))
    fields = {
        "OBJECT_ID": given.get("OBJECT_ID", ""),
        "CLASSIFICATION_TYPE": given.get("CLASSIFICATION_TYPE") or "U",
        "EPHEMERIS_TYPE": given.get("EPHEMERIS_TYPE") or "0",
        "ELEMENT_SET_NO": _count(given, "ELEMENT_SET_NO", at("ELEMENT_SET_NO")),
        "REV_AT_EPOCH": _count(given, "REV_AT_EPOCH", at("REV_AT_EPOCH")),
        "NORAD_CAT_ID": _count(given, "NORAD_CAT_ID", at("NORAD_CAT_ID")),
        "EPOCH": epoch.isot(np.zeros(1), 6)[0],
        **{key: repr(value) for key, value in numbers.items()},
    }
    return Omm(
        name or fields["NORAD_CAT_ID"], epoch, fields, passed_over=_list_passed_over(given, numbers)
    )


def _number(given: Mapping[str, str], key: str, where: str) -> float:
    text = given.get(key, "")
    value = float(text) if _REAL.fullmatch(text) else math.nan
    if not math.isfinite(value):
        got = f"got {text[:40]!r}" if text else "it is missing"
        raise InputError(f"{where}: {key} must be a finite number; {got}")
    return value


def _count(given: Mapping[str, str], key: str, where: str) -> str:
    text = given.get(key) or "0"
    if not _COUNT.fullmatch(text):
        raise InputError(f"{where}: {key} must be a whole number, got {text[:40]!r}")
    return str(int(text))


def _epoch(given: Mapping[str, str], where: str) -> Epoch:
    text = given.get("EPOCH", "")
    if not text:
        raise InputError(f"{where}: EPOCH is missing")
    try:
        return read_ccsds_time(text, "UTC")
    except InputError as error:
        raise InputError(f"{where}: EPOCH: {error}") from error


def _list_passed_over(given: Mapping[str, str], numbers: Mapping[str, float]) -> tuple[str, ...]:
    """Return what a message states beyond its checked fields, each once."""
    used = {*numbers, *_MUST_BE, *_TEXTS, *_OF_THE_FILE, "EPOCH", "NORAD_CAT_ID",
            "ELEMENT_SET_NO", "REV_AT_EPOCH"}  # fmt: skip
    words = {"COMMENT": "comments"} | dict.fromkeys(COVARIANCE, "covariance")
    others = [words.get(key, key) for key, value in given.items() if value and key not in used]
    cut = [key for key, value in numbers.items()
           if given.get(key) and Decimal(given[key]) != Decimal(repr(value))]  # fmt: skip
    if _BELOW_A_MICROSECOND.search(given["EPOCH"]):
        cut.append("EPOCH")
    if cut:
        others.append(f"last digits of {', '.join(cut)}")
    return tuple(dict.fromkeys(others))
