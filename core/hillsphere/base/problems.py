"""Problems of an input: location, key and message, each as one line of text."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from hillsphere.base.errors import InputError

__all__ = [
    "Key",
    "MissionError",
    "Problem",
    "did_you_mean",
    "format_key",
    "format_value",
    "with_article",
]

Key = tuple[str | int, ...]
"""Path of a value in a mission: names of tables and keys, indices into arrays."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SHOWN_CHARACTERS = 60
"""Length at which a name is cut in a message: longer than any valid name."""
_CANDIDATES = 300
"""Valid names that are compared with a misspelt one; a comparison takes up to 0.1 ms."""
_LISTED = 24
"""Valid names that a message lists if none is near: about three lines on a terminal."""


@dataclass(frozen=True)
class Problem:
    """One fault of a mission file or a setting.

    Parameters
    ----------
    source : str
        The file as the user named it, or ``"--set a.b=…"``.
    line : int or None
        Line in that file, counted from 1; None for a setting and for the file as a whole.
    key : tuple
        Path of the faulty key; empty for the file as a whole.
    message : str
        The fault and its remedy.
    is_remark : bool
        Whether this is a remark on the list of problems, to be shown at its end.
    user : str
        Table that inherits the faulty value by ``like``; empty if the value is its own.
    is_idle : bool
        Whether this is a setting without effect because its table is dropped; it is no fault if
        another value of `for` keeps the table.
    given : str
        Values of a table with `for` for which the fault occurs: ``"controller = 'k0'"``.
    """

    source: str
    line: int | None
    key: Key
    message: str
    is_remark: bool = False
    user: str = ""
    is_idle: bool = False
    given: str = ""

    @property
    def place(self) -> str:
        """Return ``file:line``, or the setting."""
        return self.source if self.line is None else f"{self.source}:{self.line}"

    def __str__(self) -> str:
        """Return ``file:line: key: message``."""
        where = self.place
        told = f"{self.message} (for {self.given})" if self.given else self.message
        told = f"{told} (in {self.user}, which is like it)" if self.user else told
        return f"{where}: {format_key(self.key)}: {told}" if self.key else f"{where}: {told}"


class MissionError(InputError):
    """A mission cannot be run; `problems` lists all its faults.

    Parameters
    ----------
    problems : iterable of Problem
        At least one.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


def format_key(key: Sequence[str | int]) -> str:
    """Write a key path as TOML would: ``gravity.sum.parts[1]."odd name"``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            bare = len(part) <= _SHOWN_CHARACTERS and _BARE.fullmatch(part)
            text += ("." if text else "") + (part if bare else _quote(part))
    return text


def _quote(text: str) -> str:
    if len(text) > _SHOWN_CHARACTERS:
        text = text[:_SHOWN_CHARACTERS] + "…"
    # Unprintable characters are escaped: a message is one line and cannot steer a terminal.
    return json.dumps(text, ensure_ascii=not text.isprintable())


def did_you_mean(word: str, valid: Iterable[str], *, otherwise: str = "valid") -> str:
    """Return a hint to append to a message: the nearest valid word, else all of them.

    Parameters
    ----------
    word : str
        The invalid word.
    valid : iterable of str
        The valid words.
    otherwise : str
        Heading of the list of valid words, which is given if none is similar.

    Returns
    -------
    str
        ``"; did you mean 'axes_km'?"``, ``"; valid: a, b"`` or ``""``.
    """
    words = list(dict.fromkeys(valid))[:_CANDIDATES]
    # difflib is quadratic in the length of a word; no valid word is longer than this.
    if near := get_close_matches(word[:100], words, n=1, cutoff=0.6):
        return f"; did you mean {near[0][:100]!r}?"
    short = (word if len(word) <= _SHOWN_CHARACTERS else word[:_SHOWN_CHARACTERS] + "…"
             for word in words[:_LISTED])  # fmt: skip
    listed = ", ".join(short) + (", …" if len(words) > _LISTED else "")
    return f"; {otherwise}: {listed}" if words else ""


def format_value(value: Any) -> str:
    """Describe a value in the terms of a mission file, on one short line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, int):
        return repr(value) if value.bit_length() < 200 else "a very large whole number"
    if isinstance(value, str):
        text = value if len(value) <= _SHOWN_CHARACTERS else value[:_SHOWN_CHARACTERS] + "…"
        return f"a string {text!r}"
    if isinstance(value, list | tuple):
        return _shown_array(value)
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    if value is None:
        return "nothing"
    if hasattr(value, "isoformat"):
        return f"a date or time {value.isoformat()}"
    return f"an object of class {type(value).__name__}"


def _shown_array(value: Sequence[Any]) -> str:
    if not value:
        return "an empty array"
    if len(value) > 6 or not all(isinstance(v, str | bool | int | float) for v in value):
        return f"an array of {len(value)}"
    items = ", ".join(format_value(v).removeprefix("a string ") for v in value)
    return f"[{items}]" if len(items) <= _SHOWN_CHARACTERS else f"an array of {len(value)}"


def with_article(noun: str) -> str:
    """Return a noun after "a", or "an" before a vowel."""
    return f"{'an' if noun[:1].lower() in {*'aeiou'} else 'a'} {noun}"
