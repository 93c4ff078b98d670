"""Comparison of two finished runs: configuration, outcomes, metrics, and tables row by row.

Only ``manifest.json`` and ``summary.json`` are read. Numbers are equal if they agree to the
significant digits that their column declares, or to a given relative tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.runs.run_differences import differences
from hillsphere.runs.run_summary import RunSummary

__all__ = [
    "Difference",
    "RunComparison",
    "compare_runs",
    "rows_by_key",
]  # fmt: skip

_METRIC_DIGITS = 8
"""Significant digits to which metrics are compared: those of a column that declares none."""


@dataclass(frozen=True)
class Difference:
    """A value that two runs do not share.

    Parameters
    ----------
    where : str
        ``"metric"``, ``"requirement"``, ``"claim"``, or the name of a table.
    name : str
        Name of the metric or outcome; of a table's cell, its row and column.
    first, second : object
        The values; None where a run has none.
    """

    where: str
    name: str
    first: Any
    second: Any


@dataclass(frozen=True)
class RunComparison:
    """Differences of two runs.

    Parameters
    ----------
    configuration : sequence of str
        Changed keys, inputs and versions, ``"stage.first.count: 3 -> 4"``.
    results : sequence of Difference
        Changed results.
    compared : int
        Number of values that either run has.
    """

    configuration: Sequence[str]
    results: Sequence[Difference]
    compared: int

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON types."""
        return asdict(self)


def compare_runs(
    first: RunSummary, second: RunSummary, tolerance: float | None = None
) -> RunComparison:
    """Compare two runs.

    Parameters
    ----------
    first, second : RunSummary
        The runs.
    tolerance : float, optional
        Largest relative difference of numbers that count as equal; by default half a unit of the
        last significant digit that a column declares.

    Returns
    -------
    RunComparison
        Differences in the order of the first run.

    Raises
    ------
    InputError
        If the runs share no metric and no table, so that there is nothing to compare.
    """
    pairs = list(_pairs(first.summary, second.summary))
    if not any(pair[2] is not _MISSING and pair[3] is not _MISSING for pair in pairs):
        raise InputError(
            f"{str(first.path)!r} (mission {first.mission}) and {str(second.path)!r} (mission "
            f"{second.mission}) share no metric and no table"
        )
    unequal = [
        Difference(where, name, _or_none(a), _or_none(b))
        for where, name, a, b, digits in pairs
        if not _are_equal(a, b, tolerance, digits)
    ]
    return RunComparison(differences(first.manifest, second.manifest), unequal, len(pairs))


_MISSING = object()


def _or_none(value: Any) -> Any:
    return None if value is _MISSING else value


def _pairs(
    first: Mapping[str, Any], second: Mapping[str, Any]
) -> Iterator[tuple[str, str, Any, Any, int]]:
    """Yield (where, name, value of the first run, of the second, digits)."""
    for word, key in (("requirement", "requirements"), ("claim", "claims")):
        states = [
            {row["name"]: row["state"] for row in run.get(key, ())} for run in (first, second)
        ]
        for name in dict.fromkeys((*states[0], *states[1])):
            yield word, name, *(s.get(name, _MISSING) for s in states), _METRIC_DIGITS
    metrics = [run["metrics"] for run in (first, second)]
    for name in dict.fromkeys((*metrics[0], *metrics[1])):
        units = [m[name]["unit"] for m in metrics if name in m]
        if len(set(units)) > 1:
            yield "metric", f"{name}, unit", units[0], units[1], _METRIC_DIGITS
        values = [m[name]["value"] if name in m else _MISSING for m in metrics]
        yield "metric", name, values[0], values[1], _METRIC_DIGITS
    tables = [run["tables"] for run in (first, second)]
    for name in dict.fromkeys((*tables[0], *tables[1])):
        if name in tables[0] and name in tables[1]:
            yield from _cells(name, tables[0][name], tables[1][name])
        else:
            sizes = [len(t[name]["rows"]) if name in t else _MISSING for t in tables]
            yield name, "rows", sizes[0], sizes[1], _METRIC_DIGITS


def _cells(
    name: str, first: Mapping[str, Any], second: Mapping[str, Any]
) -> Iterator[tuple[str, str, Any, Any, int]]:
    """Yield the cells of two tables whose rows are joined by their first column."""
    columns = [{c["name"]: c.get("digits", _METRIC_DIGITS) for c in t["columns"]}
               for t in (first, second)]  # fmt: skip
    units = [{c["name"]: c["unit"] for c in t["columns"]} for t in (first, second)]
    for column, unit in units[0].items():
        if units[1].get(column, unit) != unit:
            yield name, f"{column}, unit", unit, units[1][column], _METRIC_DIGITS
    keyed = [rows_by_key(table) for table in (first, second)]
    for key in dict.fromkeys((*keyed[0], *keyed[1])):
        rows = [rows.get(key) for rows in keyed]
        if None in rows:
            there = [key if row is not None else _MISSING for row in rows]
            yield name, f"row {key}", there[0], there[1], _METRIC_DIGITS
            continue
        for column, digits in {**columns[0], **columns[1]}.items():
            cells = [
                row.get(column) if column in own else _MISSING  # type: ignore[union-attr]
                for row, own in zip(rows, columns, strict=True)
            ]
            yield name, f"{key}, {column}", cells[0], cells[1], digits


def rows_by_key(table: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the rows of a table of ``summary.json`` by their first cells.

    A cell that occurs again gets its number.
    """
    first = table["columns"][0]["name"] if table["columns"] else ""
    keyed: dict[str, Mapping[str, Any]] = {}
    counts: dict[str, int] = {}
    for row in table["rows"]:
        cell = row.get(first)
        key = f"{cell:.6g}" if isinstance(cell, float) else str(cell)
        number = counts[key] = counts.get(key, 0) + 1
        free = key if number == 1 else f"{key} ({number})"
        while free in keyed:  # a cell may look like a numbered one
            number += 1
            free = f"{key} ({number})"
        keyed[free] = row
    return keyed


def _are_equal(first: Any, second: Any, tolerance: float | None, digits: int) -> bool:
    """Return whether two values are equal to a relative tolerance, or to significant digits."""
    numbers = [v for v in (first, second) if isinstance(v, float | int) and not isinstance(v, bool)]
    if len(numbers) < 2 or all(isinstance(v, int) for v in numbers):
        return type(first) is type(second) and bool(first == second)
    difference, largest = abs(numbers[0] - numbers[1]), max(map(abs, numbers))
    if tolerance is not None:
        return bool(difference <= tolerance * largest)
    if difference == 0.0:
        return True
    last_digit = 10.0 ** (math.floor(math.log10(largest)) + 1 - digits)
    return bool(difference <= 0.5 * last_digit)
