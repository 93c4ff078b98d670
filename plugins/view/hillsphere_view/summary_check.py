"""Check of ``summary.json``, which a stranger may have written, before a page shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError

__all__ = ["check_summary"]

_MOST_DIGITS = 17
"""Significant digits of a double."""
_LARGEST = 1 << 63
"""Bound of whole numbers; larger ones do not become a double."""


def check_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Refuse a summary without the form that a run writes.

    Parameters
    ----------
    summary : mapping
        Content of the file.
    path : Path
        The run directory, for the message.

    Raises
    ------
    InputError
        If it has another form.
    """
    for key, is_sound in _ENTRIES.items():
        if key in summary and not is_sound(summary[key]):
            raise InputError(f"{path / 'summary.json'}: is not the file that a run writes: {key}")


def _is_scalar(value: Any) -> bool:
    if isinstance(value, int):
        return abs(value) < _LARGEST
    return value is None or isinstance(value, str | float)


def _is_digits(value: Any) -> bool:
    return isinstance(value, int) and 1 <= value <= _MOST_DIGITS


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _has(**tests: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return a test of tables that have all of the entries, each of which passes its test."""
    return lambda value: (
        isinstance(value, dict)
        and all(key in value and test(value[key]) for key, test in tests.items())
    )


def _each(test: Callable[[Any], bool], of: type) -> Callable[[Any], bool]:
    """Return a test of lists or tables whose items all pass a test."""

    def is_sound(value: Any) -> bool:
        items = value.values() if isinstance(value, dict) else value
        return isinstance(value, of) and all(map(test, items))

    return is_sound


_OUTCOMES = _each(
    _has(name=_is_text, state=_is_text, text=_is_text, asked=_is_text, got=_is_text), list
)


def _is_column(value: Any) -> bool:
    return (
        _has(name=_is_text)(value)
        and all(_is_text(value.get(key, "")) for key in ("unit", "label"))
        and _is_digits(value.get("digits", 1))
    )


_TABLE = _has(columns=_each(_is_column, list), rows=_each(_each(_is_scalar, dict), list))
_ENTRIES: Mapping[str, Callable[[Any], bool]] = {
    "verdict": _has(state=_is_text, text=_is_text),
    "requirements": _OUTCOMES,
    "claims": _OUTCOMES,
    "metrics": _each(_has(value=_is_scalar, unit=_is_text), dict),
    "tables": _each(_TABLE, dict),
}
