"""Two-line element sets as the fields of an orbit mean-elements message, and the reverse.

The derivatives of the mean motion are those of the element set in both: half the first one, a sixth
of the second one [1]_.

References
----------
.. [1] F. R. Hoots, R. L. Roehrich (1980), Models for Propagation of NORAD Element Sets, Spacetrack
   Report No. 3 (the format in its appendix).
"""

from __future__ import annotations

import re
from calendar import isleap
from datetime import datetime, timedelta
from decimal import ROUND_HALF_EVEN, Decimal

from hillsphere.errors import InputError
from hillsphere_tracking.omm import Omm
from hillsphere_tracking.tle import FIRST_YEAR, Tle, alpha5, catalogue_number, full_year

__all__ = ["element_set_of", "fields_of"]

_TICK_US = 864
"""Last digit of an element set's epoch, 1e-8 day, in microseconds."""
_DECIMALS = {
    "INCLINATION": 4, "RA_OF_ASC_NODE": 4, "ECCENTRICITY": 7, "ARG_OF_PERICENTER": 4,
    "MEAN_ANOMALY": 4, "MEAN_MOTION": 8, "MEAN_MOTION_DOT": 8,
}  # fmt: skip
"""Decimals of an element set, by keyword of the OMM."""
_CIRCULAR = ("RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY")
"""Angles that an element set states from 0 up to 360 degrees."""
_DESIGNATOR = re.compile(r"(\d{4})-(\d{3}[A-Z]{0,3})", re.ASCII)
_SHORT_DESIGNATOR = re.compile(r"\d{5}[A-Z]{0,3}", re.ASCII)
"""International designator as an element set has it: ``98067A`` for 1998-067A."""
_YEARS = range(1900 + FIRST_YEAR, 2000 + FIRST_YEAR)


def fields_of(tle: Tle) -> dict[str, str]:
    """Return the fields of an element set as texts, digit by digit."""
    one, two = tle.line1, tle.line2
    launch = one[9:17].strip()
    return {
        "OBJECT_NAME": tle.name,
        "OBJECT_ID": _long_designator(launch),
        "EPOCH": _epoch_text(one[18:20], one[20:32]),
        "MEAN_MOTION": two[52:63].strip(),
        "ECCENTRICITY": f"0.{two[26:33].strip()}",
        "INCLINATION": two[8:16].strip(),
        "RA_OF_ASC_NODE": two[17:25].strip(),
        "ARG_OF_PERICENTER": two[34:42].strip(),
        "MEAN_ANOMALY": two[43:51].strip(),
        "EPHEMERIS_TYPE": one[62].strip() or "0",
        "CLASSIFICATION_TYPE": one[7].strip() or "U",
        "NORAD_CAT_ID": str(catalogue_number(one[2:7])),
        "ELEMENT_SET_NO": one[64:68].strip() or "0",
        "REV_AT_EPOCH": two[63:68].strip() or "0",
        "BSTAR": _power(one[53:61]),
        "MEAN_MOTION_DOT": str(Decimal(one[33:43].strip())),
        "MEAN_MOTION_DDOT": _power(one[44:52]),
    }


def _long_designator(launch: str) -> str:
    """Return ``1998-067A`` for ``98067A``, and anything else as it is."""
    if not _SHORT_DESIGNATOR.fullmatch(launch):
        return launch
    return f"{full_year(launch[:2])}-{launch[2:]}"


def _power(text: str) -> str:
    """Return a number with an assumed decimal point, ``"-11606-4"`` for -0.11606e-4."""
    text = text.strip()
    sign = "-" if text.startswith("-") else ""
    digits, power = text.lstrip("+-")[:-2], text[-2:]
    return f"{sign}0.{digits}E{power}"


def _epoch_text(year: str, day: str) -> str:
    ticks = int(Decimal(day.strip()).scaleb(8).to_integral_exact(ROUND_HALF_EVEN))
    start = datetime(full_year(year), 1, 1) - timedelta(days=1)
    return (start + timedelta(microseconds=_TICK_US * ticks)).isoformat(timespec="microseconds")


def element_set_of(message: Omm) -> tuple[str, str, tuple[str, ...]]:
    """Return the element set of a message.

    Parameters
    ----------
    message : Omm
        The message.

    Returns
    -------
    tuple
        Both lines, and in words what they do not hold.

    Raises
    ------
    InputError
        If a number does not fit into its columns.
    """
    fields = message.fields
    rounded: list[str] = []

    def fault(key: str) -> InputError:
        return InputError(
            f"{message.name}: {key} = {fields[key]} does not fit into an element set; it stays an "
            "orbit mean-elements message"
        )

    def fixed(key: str, width: int) -> str:
        exact = Decimal(fields[key])
        if key in _CIRCULAR:
            exact -= 360 * (exact // 360)
            exact += 360 if exact < 0 else 0
        value = round(exact, _DECIMALS[key])
        if value != exact:
            rounded.append(key)
        if key in _CIRCULAR and value == 360:
            value = Decimal(0)
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

    unheld: list[str] = []
    identifier = _short_designator(fields["OBJECT_ID"])
    if identifier is None:
        unheld.append(f"OBJECT_ID ({fields['OBJECT_ID']})")
    number = alpha5(int(fields["NORAD_CAT_ID"]))
    if number is None:
        raise fault("NORAD_CAT_ID")
    try:
        when = datetime.fromisoformat(fields["EPOCH"])
    except ValueError as error:  # second 60 of a leap second, which a fraction of a day has not
        raise fault("EPOCH") from error
    year = when.year
    since = when - datetime(year, 1, 1)
    ticks, rest = divmod(since // timedelta(microseconds=1), _TICK_US)
    if rest:
        rounded.append("EPOCH")
        ticks += 2 * rest >= _TICK_US
    if ticks >= (366 if isleap(year) else 365) * 10**8:  # rounded up to the next year's beginning
        year, ticks = year + 1, 0
    if year not in _YEARS:
        raise fault("EPOCH")
    day = f"{(Decimal(ticks) / 10**8) + 1:.8f}".rjust(12, "0")
    rate = fixed("MEAN_MOTION_DOT", 11)
    if abs(Decimal(rate)) >= 1:
        raise fault("MEAN_MOTION_DOT")
    rate = f"{'-' if rate.strip().startswith('-') else ' '}{rate.strip().lstrip('-')[1:]}"
    whole, _, eccentricity = fixed("ECCENTRICITY", 9).strip().partition(".")
    if whole != "0":  # rounded up to a parabola
        raise fault("ECCENTRICITY")
    kind = fields["CLASSIFICATION_TYPE"]
    if len(kind) != 1 or not kind.isascii():
        raise fault("CLASSIFICATION_TYPE")
    one = (
        f"1 {number}{kind} {identifier or '':8} {year % 100:02d}{day} {rate} "
        f"{power('MEAN_MOTION_DDOT')} {power('BSTAR')} {fields['EPHEMERIS_TYPE']} "
        f"{count('ELEMENT_SET_NO', 4)}"
    )
    two = (
        f"2 {number} {fixed('INCLINATION', 8)} {fixed('RA_OF_ASC_NODE', 8)} {eccentricity} "
        f"{fixed('ARG_OF_PERICENTER', 8)} {fixed('MEAN_ANOMALY', 8)} {fixed('MEAN_MOTION', 11)}"
        f"{count('REV_AT_EPOCH', 5)}"
    )
    if rounded:
        unheld.insert(0, f"digits of {', '.join(rounded)}")
    return one + _checksum(one), two + _checksum(two), tuple(unheld)


def _short_designator(identifier: str) -> str | None:
    """Return the eight columns of a designator, None if they cannot hold it."""
    if match := _DESIGNATOR.fullmatch(identifier):
        return match[1][2:] + match[2] if int(match[1]) in _YEARS else None
    return identifier if not identifier or _SHORT_DESIGNATOR.fullmatch(identifier) else None


def _checksum(line: str) -> str:
    return str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)
