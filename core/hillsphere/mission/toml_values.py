"""Numbers and dates that a mission accepts: finite, within 64 bits, dates with a time zone."""

from __future__ import annotations

import re
from datetime import datetime

__all__ = ["value_fault"]

_LONGEST = 200
"""Longest text that is examined as a number or a date, in characters; a double needs at most 25."""
_INT = r"[+-]?(?:0|[1-9](?:_?[0-9])*+)"
_DATE = r"[0-9]{4}-[0-9]{2}-[0-9]{2}"
_TIME = r"[0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]++)?+"
_VALUE = re.compile(
    rf"(?P<int>{_INT}|0x[0-9A-Fa-f](?:_?[0-9A-Fa-f])*+|0o[0-7](?:_?[0-7])*+|0b[01](?:_?[01])*+)"
    rf"|(?P<float>{_INT}(?:\.[0-9](?:_?[0-9])*+)?+(?:[eE][+-]?[0-9](?:_?[0-9])*+)?+)"
    r"|(?P<bool>true|false)"
    r"|(?P<special>[+-]?(?:inf|nan))"
    rf"|(?P<zoned>{_DATE}[Tt ]{_TIME}(?:[Zz]|[+-][0-9]{{2}}:[0-9]{{2}}))"
    rf"|(?P<local>{_DATE}(?:[Tt ]{_TIME})?+|{_TIME})"
)


def value_fault(token: str) -> str | None:
    """Return the fault of a number, boolean or date.

    Parameters
    ----------
    token : str
        Text of the value, without surrounding blanks.

    Returns
    -------
    str or None
        The fault and its remedy; None if the value is accepted.
    """
    if len(token) > _LONGEST:
        return f"a value of {len(token)} characters is neither a number nor a date"
    match = _VALUE.fullmatch(token)
    if match is None:
        return _no_value(token)
    if match.lastgroup == "int":
        if not -(2**63) <= int(token.replace("_", ""), 0) < 2**63:
            return f"whole numbers have 64 bits; {token} is too large (write it with a point)"
    elif match.lastgroup == "float":
        if abs(float(token.replace("_", ""))) == float("inf"):
            return f"{token} is too large for a number"
    elif match.lastgroup == "special":
        return f"{token} is not accepted; every number must be finite"
    elif match.lastgroup == "zoned":
        try:
            datetime.fromisoformat(token.upper())
        except ValueError as error:
            return f"{token} is not a date and time: {error}"
    elif match.lastgroup == "local":
        return f"a date must have a time and a zone, such as 2027-05-01T12:00:00Z; got {token}"
    return None


def _no_value(token: str) -> str:
    if token.lower() in ("true", "false"):
        return f"{token} is not a value; write {token.lower()}"
    if token[0].isalpha() or token[0] in "/~_":
        return f"{token[:60]!r} is not a value; a string needs quotes"
    if re.match(r"[0-9]{4}-[0-9]{2}", token):
        return f"{token[:60]!r} is not a date and time; write it as 2027-05-01T12:00:00Z"
    return f"{token[:60]!r} is not a value; a number is written 0.5, 20 or 1.5e3"
