"""Values of Python as TOML text: whole missions, and settings of one line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from hillsphere.base.errors import InputError

__all__ = ["settings_of", "toml_text"]


def settings_of(values: Mapping[str, Any] | None) -> tuple[str, ...]:
    """Return settings as the texts of ``--set``.

    Parameters
    ----------
    values : mapping or None
        Key → value: a number, a text, a path, a sequence, a mapping, or an array.

    Raises
    ------
    InputError
        If TOML has no such value.
    """
    import tomlkit

    def inline(value: Any) -> Any:
        if isinstance(value, dict):
            table = tomlkit.inline_table()
            for key, item in value.items():
                table.append(key, inline(item))
            return table
        if isinstance(value, list):
            array = tomlkit.array()
            for item in value:
                array.append(inline(item))
            return array
        return tomlkit.item(value)

    plain = {key: _plain(value, key) for key, value in (values or {}).items()}
    return tuple(f"{key}={inline(value).as_string()}" for key, value in plain.items())


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return the text of a TOML file.

    Parameters
    ----------
    tables : mapping
        Content of the file; values as for `settings_of`.

    Raises
    ------
    InputError
        If TOML has no such value.
    """
    import tomlkit

    return tomlkit.dumps(_plain(tables, ""))


def _plain(value: Any, where: str) -> Any:
    """Return a value in the types that a TOML file has."""
    if isinstance(value, Mapping):
        return {
            str(key): _plain(item, f"{where}.{key}" if where else str(key))
            for key, item in value.items()
        }
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # an array of numpy, or one of its numbers
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, bool | int | float | str):
        return value
    kind = "None" if value is None else f"a {type(value).__name__}"
    raise InputError(f"{where}: expected a number, a text, a sequence or a table, got {kind}")
