"""Reading of ``manifest.json``, with validation of its content.

A run directory may come from another user. Names in its manifest become names of files, so that
they must be valid names; every other value must have the type that a run writes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias

from hillsphere.base.errors import InputError
from hillsphere.base.json_files import read_json
from hillsphere.mission.tables import TABLE_NAME

__all__ = ["MANIFEST", "SCHEMA", "parse_time", "read_manifest", "read_record"]

MANIFEST = "manifest.json"
SCHEMA = 1
"""Version of the manifest's layout; manifests of another version are refused."""
MAX_BYTES = 64 << 20
"""Largest size of a record. The manifest of a sweep of a thousand campaigns has 2 MB."""

Test: TypeAlias = Callable[[Any], bool]
_DIGEST = re.compile(r"[0-9a-f]{64}")


def read_manifest(directory: Path) -> Mapping[str, Any]:
    """Return the content of a run's ``manifest.json``.

    Parameters
    ----------
    directory : Path
        The run directory.

    Raises
    ------
    InputError
        If it cannot be read, is of another version, or has not the form that a run writes.
    """
    path = directory / MANIFEST
    manifest = read_record(path, ("mission", "stages", "versions", "platform"))
    for key, (test, what) in _ENTRIES.items():
        if key in manifest and not test(manifest[key]):
            raise InputError(f"{path}: is not the file that a run writes: {key} must be {what}")
    finished = [manifest["finished_utc"]] if manifest.get("finished_utc") else []
    for moment in [manifest.get("started_utc"), *finished, *manifest.get("resumed_utc", [])]:
        try:
            parse_time(moment)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    return manifest


def read_record(path: Path, keys: tuple[str, ...]) -> Mapping[str, Any]:
    """Return the table of a JSON file that a run has written; it must have the given keys.

    Raises
    ------
    InputError
        If it cannot be read, lacks one of the keys, or is of another version.
    """
    record = read_json(path, MAX_BYTES, follow_links=False)
    if not isinstance(record, dict) or not all(key in record for key in keys):
        raise InputError(f"{path}: is not the file that a run writes")
    if record.get("schema") != SCHEMA:
        raise InputError(
            f"{path}: written in format {record.get('schema')!r}; this version reads {SCHEMA}"
        )
    return record


def parse_time(text: object) -> datetime:
    """Parse a time of the manifest; `InputError` if the text is not one."""
    try:
        return datetime.strptime(str(text), "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=UTC)
    except ValueError as error:
        raise InputError(f"{text!r} is no time") from error


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_text_or_none(value: Any) -> bool:
    return value is None or isinstance(value, str)


def _is_digest_or_none(value: Any) -> bool:
    return value is None or (isinstance(value, str) and _DIGEST.fullmatch(value) is not None)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e12


def _is_flag(value: Any) -> bool:
    return isinstance(value, bool)


def _list_of(test: Test) -> Test:
    return lambda value: isinstance(value, list) and all(test(item) for item in value)


def _table_of(test: Test, name: str = r"(?s:.*)") -> Test:
    pattern = re.compile(name)
    return lambda value: (
        isinstance(value, dict)
        and all(pattern.fullmatch(key) is not None and test(item) for key, item in value.items())
    )


def _with(tests: Mapping[str, Test]) -> Test:
    """Return a test of tables, which applies each test to the entry of its name, if present."""
    return lambda value: (
        isinstance(value, dict)
        and all(test(value[key]) for key, test in tests.items() if key in value)
    )


def _is_mission(value: Any) -> bool:
    stages = _table_of(lambda table: isinstance(table, dict) and _is_text(table.get("type")),
                       TABLE_NAME)  # fmt: skip
    return _with({"name": _is_text, "title": _is_text, "stage": stages})(value)


_STAGE = _with(
    {
        "type": _is_text,
        "state": _is_text,
        "cached": _is_flag,
        "seconds": _is_number,
        "key": _is_digest_or_none,
        "product": _is_digest_or_none,
    }
)

_ENTRIES: Mapping[str, tuple[Test, str]] = {
    "state": (_is_text, "text"),
    "command": (_is_text, "text"),
    "profile": (_is_text_or_none, "text or null"),
    "sets": (_list_of(_is_text), "a list of texts"),
    "resumed_utc": (_list_of(_is_text), "a list of times"),
    "mission": (_is_mission, "the tables of a mission"),
    "stages": (_table_of(_STAGE, TABLE_NAME), "a table of stages with names, digests and times"),
    "inputs": (
        _table_of(_with({"file": _is_text, "sha256": _is_digest_or_none})),
        "a table of files with digests",
    ),
    "sources": (_table_of(_is_text), "a table of texts"),
    "versions": (
        _with(
            {
                "python": _is_text_or_none,
                "packages": _table_of(_is_text),
                "plugins": _table_of(_is_text),
            }
        ),
        "a table of versions",
    ),
    "platform": (
        _with({"cpu_features": _list_of(_is_text), "kernels": _table_of(_is_text)}),
        "a table of facts",
    ),
}
