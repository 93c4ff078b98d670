"""Finished runs as their two records tell them: ``manifest.json`` and ``summary.json``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.interfaces.outcomes import CLAIM_STATES, REQUIREMENT_STATES
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.run_manifest import read_record

__all__ = ["RunSummary", "list_runs"]

_MOST_DIGITS = 17
"""Significant digits of a double."""
_LARGEST = 1 << 63
"""Bound of whole numbers; larger ones do not become a double."""


@dataclass(frozen=True)
class RunSummary:
    """Manifest and summary of a run.

    Parameters
    ----------
    path : Path
        The run directory.
    manifest, summary : mapping
        Contents of ``manifest.json`` and ``summary.json``; the summary is empty while a run lasts.
    """

    path: Path
    manifest: Mapping[str, Any]
    summary: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | Path) -> RunSummary:
        """Read a run directory, which a stranger may have written.

        Raises
        ------
        InputError
            If it is none, has no summary yet, or one without the form that a run writes.
        """
        earlier, file = EarlierRun.open(path), Path(path) / "summary.json"
        summary = read_record(file, ("mission", "verdict", "metrics", "tables"))
        for key, is_sound in _ENTRIES.items():
            if key in summary and not is_sound(summary[key]):
                raise InputError(f"{file}: is not the file that a run writes: {key}")
        return cls(Path(path), earlier.manifest, summary)

    @property
    def mission(self) -> str:
        """Name of the mission."""
        return str(self.manifest["mission"].get("name", ""))


def list_runs(folder: str | Path) -> list[RunSummary]:
    """Return the runs in a folder, the latest first; a run that still lasts has an empty summary.

    Raises
    ------
    InputError
        If there is no such folder.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError(f"{str(folder)!r} is no folder of runs")
    runs = []
    for path in place.iterdir():
        try:
            runs.append(RunSummary.read(path))
        except InputError:
            try:
                runs.append(RunSummary(path, EarlierRun.open(path).manifest, {}))
            except InputError:
                continue  # no run
    return sorted(runs, key=lambda run: str(run.manifest.get("started_utc", "")), reverse=True)


def _is_scalar(value: Any) -> bool:
    if isinstance(value, int):
        return abs(value) < _LARGEST
    return value is None or isinstance(value, str | float)


def _is_digits(value: Any) -> bool:
    return isinstance(value, int) and 1 <= value <= _MOST_DIGITS


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return _is_scalar(value) and isinstance(value, int | float)


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


def _outcomes(states: Sequence[str]) -> Callable[[Any], bool]:
    texts = dict.fromkeys(("name", "text", "asked", "got", "unit", "reason"), _is_text)
    has_entries = _has(**texts, state=states.__contains__, value=_is_scalar, limit=_is_scalar)

    def is_outcome(row: Any) -> bool:
        margin = row.get("margin") if has_entries(row) else ""
        numbers = (margin, row["value"], row["limit"]) if margin is not None else ()
        return all(map(_is_number, numbers))

    return _each(is_outcome, list)


def _is_column(value: Any) -> bool:
    return (
        _has(name=_is_text)(value)
        and all(_is_text(value.get(key, "")) for key in ("unit", "label"))
        and _is_digits(value.get("digits", 1))
    )


_TABLE = _has(columns=_each(_is_column, list), rows=_each(_each(_is_scalar, dict), list))
_ENTRIES: Mapping[str, Callable[[Any], bool]] = {
    "mission": _is_text,
    "verdict": _has(state=_is_text, text=_is_text, notes=_each(_is_text, list)),
    "requirements": _outcomes(REQUIREMENT_STATES),
    "claims": _outcomes(CLAIM_STATES),
    "metrics": _each(_has(value=_is_scalar, unit=_is_text), dict),
    "tables": _each(_TABLE, dict),
}
