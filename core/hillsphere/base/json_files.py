"""Safe reading of JSON files from untrusted sources: bounded in size and depth, without NaN."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_bytes

__all__ = ["MAX_DEPTH", "parse_json", "read_json"]

MAX_DEPTH = 64
"""Deepest nesting that is read. What the framework writes has at most ten levels; the functions
that walk through it call themselves once a level, and Python allows a thousand."""


def read_json(path: Path, max_bytes: int, *, follow_links: bool = True) -> Any:
    """Return the content of a JSON file.

    Parameters
    ----------
    path, max_bytes, follow_links
        As for `hillsphere.base.regular_files.open_regular`.

    Raises
    ------
    InputError
        If it cannot be read or is not JSON; the message names the file.
    """
    try:
        data = read_bytes(path, max_bytes, follow_links=follow_links)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        return parse_json(data.decode("utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: is damaged: {error}") from error


def parse_json(text: str) -> Any:
    """Return the value of a JSON text.

    Raises
    ------
    ValueError
        If it is not JSON, has NaN or an infinity, or is nested deeper than `MAX_DEPTH`.
    """
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
    except RecursionError:
        raise ValueError(f"it is nested deeper than {MAX_DEPTH} levels") from None
    level = [content]
    for _ in range(MAX_DEPTH):
        level = [
            item
            for value in level
            if isinstance(value, dict | list)
            for item in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return content
    raise ValueError(f"it is nested deeper than {MAX_DEPTH} levels")


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")
