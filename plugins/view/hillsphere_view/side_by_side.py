"""Several runs beside each other: outcomes, metrics, and tables joined by their first columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.runs.run_comparison import compare_runs, rows_by_key
from hillsphere.runs.run_summary import RunSummary

__all__ = ["LETTERS", "Cell", "SideBySide", "compare_side_by_side"]

LETTERS = "ABCDEF"
"""Short names of the runs on the page; their number is the most that are compared at a time."""
_METRIC_DIGITS = 8
"""Significant digits to which metrics are compared, as by ``hillsphere compare``."""
_MOST_ROWS = 100
"""Rows of a joined table that are shown; the CSV files have all."""


@dataclass(frozen=True)
class Cell:
    """A value as text, and whether it differs from that of the first run."""

    text: str
    differs: bool = False


@dataclass(frozen=True)
class Line:
    """A named row with one cell per run."""

    name: str
    unit: str
    cells: Sequence[Cell]


@dataclass(frozen=True)
class Joined:
    """A table of several runs.

    Parameters
    ----------
    name : str
        Its identifier.
    heads : sequence of (label, unit, letter)
        Its columns; the letter of a run where the runs differ, else ``""``.
    rows : sequence of (key, cells)
        The first rows.
    count : int
        Number of all rows.
    """

    name: str
    heads: Sequence[tuple[str, str, str]]
    rows: Sequence[tuple[str, Sequence[Cell]]]
    count: int


@dataclass(frozen=True)
class SideBySide:
    """Runs beside each other.

    Parameters
    ----------
    configuration : sequence of (letter, lines)
        Changed keys, inputs and versions of each further run.
    outcomes, metrics : sequence of Line
        Requirements and claims; metrics.
    tables : sequence of Joined
        Tables that at least two runs have.
    counts : sequence of (letter, different, compared)
        How many results of each further run differ from the first.
    notes : sequence of str
        Why a run cannot be compared.
    """

    configuration: Sequence[tuple[str, Sequence[str]]]
    outcomes: Sequence[Line]
    metrics: Sequence[Line]
    tables: Sequence[Joined]
    counts: Sequence[tuple[str, int, int]]
    notes: Sequence[str]


_Unequal = set[tuple[str, str, str]]
"""(letter of the run, where, name) of values that differ from those of the first run."""


def compare_side_by_side(runs: Sequence[RunSummary]) -> SideBySide:
    """Compare runs with the first of them, at most `LETTERS` at a time.

    Parameters
    ----------
    runs : sequence of RunSummary
        At least two, whose summaries were checked.
    """
    unequal: _Unequal = set()
    configuration, counts, notes = [], [], []
    for letter, run in zip(LETTERS[1:], runs[1:], strict=False):
        try:
            found = compare_runs(runs[0], run)
        except InputError as error:
            notes.append(f"{LETTERS[0]} and {letter}: {error}")
            continue
        except (TypeError, ValueError, KeyError, AttributeError, ArithmeticError) as error:
            # A manifest that no run has written: its single values are not checked before.
            raise InputError(f"{str(run.path)!r}: its manifest cannot be compared") from error
        configuration.append((letter, found.configuration))
        counts.append((letter, len(found.results), found.compared))
        unequal |= {(letter, one.where, one.name) for one in found.results}
    summaries = [run.summary for run in runs]
    return SideBySide(
        configuration, _outcomes(summaries, unequal), _metrics(summaries, unequal),
        list(_tables(summaries, unequal)), counts, notes,
    )  # fmt: skip


def format_cell(value: Any, digits: int = _METRIC_DIGITS) -> str:
    """Return a value as text with so many significant digits; a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.{digits}g}".replace("-", "−") if isinstance(value, float) else str(value)


def _outcomes(summaries: Sequence[Mapping[str, Any]], unequal: _Unequal) -> list[Line]:
    lines = []
    for word, key in (("requirement", "requirements"), ("claim", "claims")):
        groups = [{one["name"]: one for one in run.get(key, ())} for run in summaries]
        for name in dict.fromkeys(name for group in groups for name in group):
            cells, text = [], ""
            for letter, group in zip(LETTERS, groups, strict=False):
                one = group.get(name)
                shown = f"{one['state']}: {one['got']}".rstrip(": ") if one else "–"
                text = text or (one["text"] if one else "")
                cells.append(Cell(shown, (letter, word, name) in unequal))
            lines.append(Line(text or name, "", cells))
    return lines


def _metrics(summaries: Sequence[Mapping[str, Any]], unequal: _Unequal) -> list[Line]:
    lines = []
    for name in dict.fromkeys(name for run in summaries for name in run["metrics"]):
        found = [run["metrics"].get(name) for run in summaries]
        unit = next(metric["unit"] for metric in found if metric)
        cells = [
            Cell(format_cell(metric["value"] if metric else None),
                 (letter, "metric", name) in unequal)
            for letter, metric in zip(LETTERS, found, strict=False)
        ]  # fmt: skip
        lines.append(Line(name, "" if unit == "-" else unit, cells))
    return lines


def _tables(summaries: Sequence[Mapping[str, Any]], unequal: _Unequal) -> Iterable[Joined]:
    for name in dict.fromkeys(name for run in summaries for name in run["tables"]):
        tables = {
            letter: run["tables"][name]
            for letter, run in zip(LETTERS, summaries, strict=False)
            if name in run["tables"] and run["tables"][name]["columns"]
        }
        if len(tables) > 1:
            yield _join(name, tables, unequal)


def _join(name: str, tables: Mapping[str, Mapping[str, Any]], unequal: _Unequal) -> Joined:
    """Join tables by their first columns.

    A column in which all runs agree is shown once, unless a run lacks a row.
    """
    keyed = {letter: rows_by_key(table) for letter, table in tables.items()}
    keys = list(dict.fromkeys(key for rows in keyed.values() for key in rows))
    columns = {c["name"]: c for table in tables.values() for c in table["columns"]}
    first, *others = columns
    split = {where[1] for _, table, cell in unequal
             if table == name and (where := cell.rpartition(", ")[::2])}  # fmt: skip
    if any(key not in rows for rows in keyed.values() for key in keys):
        split = set(others)  # a row of some runs only is shown as theirs
    heads = [(_label(columns[first]), columns[first].get("unit", ""), "")]
    parts: list[tuple[str, str]] = []
    for column in others:
        letters = list(tables) if column in split else [next(iter(tables))]
        parts += [(column, letter) for letter in letters]
        heads += [
            (_label(columns[column]), columns[column].get("unit", ""),
             letter if column in split else "")
            for letter in letters
        ]  # fmt: skip
    rows = []
    for key in keys[:_MOST_ROWS]:
        cells = []
        for column, letter in parts:
            # Where no run differs, the first one that has the row speaks for all.
            holders = [letter] if column in split else [one for one in keyed if key in keyed[one]]
            row = keyed[holders[0]].get(key, {})
            differs = bool({(letter, name, f"{key}, {column}"), (letter, name, f"row {key}")}
                           & unequal)  # fmt: skip
            cells.append(Cell(format_cell(row.get(column), columns[column].get("digits", 8)),
                              differs))  # fmt: skip
        rows.append((key, cells))
    return Joined(name, heads, rows, len(keys))


def _label(column: Mapping[str, Any]) -> str:
    return str(column.get("label") or column["name"])
