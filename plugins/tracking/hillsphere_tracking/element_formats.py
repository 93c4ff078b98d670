"""Mean elements for SGP4 as files: two-line element sets (TLE) and CCSDS OMM, read and written.

Every number of an element set is decimal, so that an OMM can hold it digit by digit. The reverse
rounds to the digits of the set and says so. The derivatives of the mean motion are those of the
element set in both: half the first one, a sixth of the second one [1]_.

References
----------
.. [1] F. R. Hoots, R. L. Roehrich (1980), Models for Propagation of NORAD Element Sets, Spacetrack
   Report No. 3 (the format in its appendix).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path

from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.formats.specs import FileFormatSpec
from hillsphere_tracking.omm import Omm, read_omms
from hillsphere_tracking.tle import Tle, read_tles

__all__ = ["OmmFile", "TleFile"]

_FIRST_YEAR = 57
"""Two-digit years from 57 on belong to the 20th century: the first satellite flew in 1957."""
_TICK_US = 864
"""Last digit of an element set's epoch, 1e-8 day, in microseconds."""
_DECIMALS = {
    "INCLINATION": 4, "RA_OF_ASC_NODE": 4, "ECCENTRICITY": 7, "ARG_OF_PERICENTER": 4,
    "MEAN_ANOMALY": 4, "MEAN_MOTION": 8, "MEAN_MOTION_DOT": 8,
}  # fmt: skip
"""Decimals of an element set, by keyword of the OMM."""
_DESIGNATOR = re.compile(r"(\d{4})-(\d{3}[A-Z]{0,3})")


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
        return read_omms(_messages(map(_fields_of, sets)), str(path)), ()

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return element sets with title lines, and which numbers were rounded.

        Raises
        ------
        InputError
            If a number does not fit into its columns.
        """
        lines: list[str] = []
        lost: list[str] = []
        for message in content:
            lines.append(message.name)
            one, two, rounded = _element_set(message)
            lines += [one + _checksum(one), two + _checksum(two)]
            if rounded:
                lost.append(f"{message.name}: digits of {', '.join(rounded)}")
        return "\n".join(lines) + "\n", tuple(lost)


class OmmFile:
    """CCSDS Orbit Mean-Elements Messages, read as text (KVN) and XML, written as text.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "set of mean elements"
    suffixes = (".omm", ".xml")

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the text says that it is such a message."""
        return "CCSDS_OMM_VERS" in beginning or re.search(r"<(\w+:)?omm\b", beginning) is not None

    def read(self, path: Path) -> tuple[tuple[Omm, ...], tuple[str, ...]]:
        """Read messages; see `hillsphere_tracking.omm.read_omms`."""
        return read_omms(_text(path), str(path)), ()

    def write(self, content: Sequence[Omm]) -> tuple[str, tuple[str, ...]]:
        """Return messages as text. Nothing is lost."""
        fields = ({"OBJECT_NAME": message.name, **message.fields} for message in content)
        return _messages(fields), ()


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason or error}") from error


def _messages(sets: Iterator[Mapping[str, str]]) -> str:
    """Return orbit mean-elements messages in the text form."""
    stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    order = (
        "EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE",
        "ARG_OF_PERICENTER", "MEAN_ANOMALY", "EPHEMERIS_TYPE", "CLASSIFICATION_TYPE",
        "NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH", "BSTAR", "MEAN_MOTION_DOT",
        "MEAN_MOTION_DDOT",
    )  # fmt: skip
    lines: list[str] = []
    for fields in sets:
        lines += ["CCSDS_OMM_VERS = 2.0", f"CREATION_DATE = {stamp}", "ORIGINATOR = HILLSPHERE"]
        lines += [f"{key} = {fields[key]}".rstrip() for key in ("OBJECT_NAME", "OBJECT_ID")]
        lines += ["CENTER_NAME = EARTH", "REF_FRAME = TEME", "TIME_SYSTEM = UTC"]
        lines += ["MEAN_ELEMENT_THEORY = SGP4"]
        lines += [f"{key} = {fields[key]}" for key in order]
    return "\n".join(lines) + "\n"


def _fields_of(tle: Tle) -> dict[str, str]:
    """Return the fields of an element set as texts, digit by digit."""
    one, two = tle.line1, tle.line2
    launch = one[9:17].strip()
    century = "19" if launch[:2].isdigit() and int(launch[:2]) >= _FIRST_YEAR else "20"
    number = one[2:7].strip()
    if not number.isdigit():
        raise InputError(
            f"{tle.name}: catalogue number {number!r} has a letter in place of the first digits; "
            "only plain numbers are converted"
        )
    return {
        "OBJECT_NAME": tle.name,
        "OBJECT_ID": f"{century}{launch[:2]}-{launch[2:]}" if launch else "",
        "EPOCH": _epoch_text(one[18:20], one[20:32]),
        "MEAN_MOTION": two[52:63].strip(),
        "ECCENTRICITY": f"0.{two[26:33].strip()}",
        "INCLINATION": two[8:16].strip(),
        "RA_OF_ASC_NODE": two[17:25].strip(),
        "ARG_OF_PERICENTER": two[34:42].strip(),
        "MEAN_ANOMALY": two[43:51].strip(),
        "EPHEMERIS_TYPE": "0",
        "CLASSIFICATION_TYPE": one[7].strip() or "U",
        "NORAD_CAT_ID": number,
        "ELEMENT_SET_NO": one[64:68].strip() or "0",
        "REV_AT_EPOCH": two[63:68].strip() or "0",
        "BSTAR": _power(one[53:61]),
        "MEAN_MOTION_DOT": str(Decimal(one[33:43].strip())),
        "MEAN_MOTION_DDOT": _power(one[44:52]),
    }


def _power(text: str) -> str:
    """Return a number with an assumed decimal point, ``"-11606-4"`` for -0.11606e-4."""
    text = text.strip()
    sign = "-" if text.startswith("-") else ""
    digits, power = text.lstrip("+-")[:-2], text[-2:]
    return f"{sign}0.{digits}E{power}"


def _epoch_text(year: str, day: str) -> str:
    century = 1900 if int(year) >= _FIRST_YEAR else 2000
    ticks = int(Decimal(day.strip()).scaleb(8).to_integral_exact(ROUND_HALF_EVEN))
    start = datetime(century + int(year), 1, 1) - timedelta(days=1)
    return (start + timedelta(microseconds=_TICK_US * ticks)).isoformat(timespec="microseconds")


def _element_set(message: Omm) -> tuple[str, str, list[str]]:
    """Return both lines without checksums, and the keywords whose numbers were rounded."""
    fields = message.fields
    rounded: list[str] = []

    def fault(key: str) -> InputError:
        return InputError(
            f"{message.name}: {key} = {fields[key]} does not fit into an element set; it stays an "
            "orbit mean-elements message"
        )

    def fixed(key: str, width: int) -> str:
        exact = Decimal(fields[key])
        value = round(exact, _DECIMALS[key])
        if value != exact:
            rounded.append(key)
        text = f"{value:.{_DECIMALS[key]}f}"
        if len(text) > width:
            raise fault(key)
        return text.rjust(width)

    def count(key: str, width: int) -> str:
        if len(fields[key].lstrip("0")) > width:
            raise fault(key)
        return str(int(fields[key])).rjust(width)

    def power(key: str) -> str:
        exact = Decimal(fields[key])
        if not exact:
            return " 00000+0"
        exponent = exact.adjusted() + 1  # of a mantissa below 1
        digits = int(abs(exact).scaleb(5 - exponent).to_integral_value(ROUND_HALF_EVEN))
        if digits == 100_000:
            digits, exponent = 10_000, exponent + 1
        if exponent < -9:  # smaller than the format's last digit
            digits = int(abs(exact).scaleb(14).to_integral_value(ROUND_HALF_EVEN))
            exponent = -9
        if exponent > 9:
            raise fault(key)
        if Decimal(digits).scaleb(exponent - 5) != abs(exact):
            rounded.append(key)
        return f"{'-' if exact < 0 else ' '}{digits:05d}{exponent:+d}"

    identifier = ""
    if fields["OBJECT_ID"]:
        match = _DESIGNATOR.fullmatch(fields["OBJECT_ID"])
        if match is None:
            raise fault("OBJECT_ID")
        identifier = match[1][2:] + match[2]
    number = count("NORAD_CAT_ID", 5).replace(" ", "0")
    when = datetime.fromisoformat(fields["EPOCH"])
    since = when - datetime(when.year, 1, 1)
    ticks, rest = divmod(since // timedelta(microseconds=1), _TICK_US)
    if rest:
        rounded.append("EPOCH")
        ticks += 2 * rest >= _TICK_US
    if not 1900 + _FIRST_YEAR <= when.year < 2000 + _FIRST_YEAR:
        raise fault("EPOCH")
    day = f"{(Decimal(ticks) / 10**8) + 1:.8f}".rjust(12, "0")
    rate = fixed("MEAN_MOTION_DOT", 11)
    if abs(Decimal(rate)) >= 1:
        raise fault("MEAN_MOTION_DOT")
    rate = f"{'-' if rate.strip().startswith('-') else ' '}{rate.strip().lstrip('-')[1:]}"
    eccentricity = fixed("ECCENTRICITY", 9).partition(".")[2]
    kind = fields["CLASSIFICATION_TYPE"][:1]
    one = (
        f"1 {number}{kind} {identifier:8} {when:%y}{day} {rate} {power('MEAN_MOTION_DDOT')} "
        f"{power('BSTAR')} 0 {count('ELEMENT_SET_NO', 4)}"
    )
    two = (
        f"2 {number} {fixed('INCLINATION', 8)} {fixed('RA_OF_ASC_NODE', 8)} {eccentricity} "
        f"{fixed('ARG_OF_PERICENTER', 8)} {fixed('MEAN_ANOMALY', 8)} {fixed('MEAN_MOTION', 11)}"
        f"{count('REV_AT_EPOCH', 5)}"
    )
    return one, two, rounded


def _checksum(line: str) -> str:
    return str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)
