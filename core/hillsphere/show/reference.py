"""Comparison of computed with published values, from cited CSV tables, row by row.

A reference table is a CSV file whose head cites the source of its numbers::

    # source: Title, authors, year, Table 1
    name,x0_km,y_max_km,period_h
    QSO-H,100,198.47,7.59

Its columns have the names of the computed ones. The numbers are kept as printed, so that a
comparison accounts for the number of printed digits.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_bytes
from hillsphere.show.presentation import Cell, Column, Printed

__all__ = [
    "PAPER_SUFFIX", "ReferenceTable", "beside", "computed_columns", "difference_notes",
    "with_paper", "without_unit",
]  # fmt: skip

PAPER_SUFFIX = "_paper"
MAX_BYTES = 1 << 20
"""Largest reference table, 1 MB: a printed table of a thousand rows has a tenth of it."""


@dataclass(frozen=True)
class ReferenceTable:
    """A table of published values.

    Parameters
    ----------
    source : str
        Citation.
    columns : tuple of str
        In the order of the file.
    rows : tuple of mapping
        Column → `Printed` number, text, or ``None`` for an empty cell.
    about : mapping
        Further ``# key: value`` lines of the head.
    """

    source: str
    columns: tuple[str, ...]
    rows: tuple[Mapping[str, Printed | str | None], ...]
    about: Mapping[str, str]

    @classmethod
    def read(cls, path: str | Path) -> ReferenceTable:
        """Read a cited CSV file.

        Parameters
        ----------
        path : str or Path
            UTF-8; lines ``# key: value`` first (``# source:`` is required), then a line of column
            names, then the rows. An empty cell stands for a value that the source does not give.

        Returns
        -------
        ReferenceTable
            The table. A column is text if none of its cells is a number.

        Raises
        ------
        InputError
            With file and line, if the file cannot be read, cites no source, or has a row of the
            wrong length, a column twice, or a word among numbers.
        """
        place = Path(path)
        try:
            # utf-8-sig: a spreadsheet puts a byte-order mark first.
            text = read_bytes(place, MAX_BYTES).decode("utf-8-sig")
        except OSError as error:
            raise InputError(f"{place.name}: cannot be read: {error.strerror or error}") from error
        except UnicodeDecodeError as error:
            raise InputError(f"{place.name}: not UTF-8 text (byte {error.start})") from error
        about, lines = _head(text)
        if not about.get("source"):
            raise InputError(
                f"{place.name}:1: no citation; begin the file with a line '# source: …'"
            )
        columns, cells = _cells(place.name, lines)
        texts = [
            all(not row[j] or _number(row[j]) is None for _, row in cells)
            for j in range(len(columns))
        ]
        rows = []
        for line, row in cells:
            entry: dict[str, Printed | str | None] = {}
            for name, is_text, cell in zip(columns, texts, row, strict=True):
                number = None if is_text else _number(cell)
                if cell and not is_text and number is None:
                    raise InputError(f"{place.name}:{line}: {name}: not a number: {cell!r}")
                entry[name] = (cell or None) if is_text else number
            rows.append(entry)
        return cls(about.pop("source"), tuple(columns), tuple(rows), about)

    def match(self, on: str, value: Cell, tol: float) -> Mapping[str, Printed | str | None] | None:
        """Return the row whose cell in column `on` is nearest, within tol; ``None`` without one."""
        if isinstance(value, str | None):
            return next((r for r in self.rows if value is not None and r[on] == value), None)
        near = [
            (abs(float(r[on]) - value), i)  # type: ignore[arg-type]
            for i, r in enumerate(self.rows)
            if isinstance(r[on], Printed)
        ]
        distance, index = min(near, default=(float("inf"), -1))
        return self.rows[index] if distance <= tol else None


def beside(
    rows: Iterable[Mapping[str, Cell]], reference: ReferenceTable, *, on: str, tol: float = 0.0
) -> list[dict[str, Cell]]:
    """Add the published values to rows of computed ones.

    Parameters
    ----------
    rows : iterable of mapping
        Computed rows: column name to cell.
    reference : ReferenceTable
        Published values under the same column names.
    on : str
        Column by which rows are matched, in both.
    tol : float
        Largest difference in `on`, in the unit of that column, between matching rows; text must be
        equal.

    Returns
    -------
    list of dict
        The rows with a ``NAME_paper`` cell (a `Printed`) directly after each ``NAME`` for which the
        matching row of the reference has a number.

    Raises
    ------
    InputError
        If the reference has no column `on`.
    """
    if on not in reference.columns:
        raise InputError(
            f"the reference table has no column {on!r} to match rows by; it has "
            f"{', '.join(reference.columns)}"
        )
    completed = []
    for row in rows:
        twin = reference.match(on, row.get(on), tol) or {}
        wide: dict[str, Cell] = {}
        for name, cell in row.items():
            wide[name] = cell
            printed = twin.get(name)
            if name != on and isinstance(printed, Printed):
                wide[name + PAPER_SUFFIX] = printed
        completed.append(wide)
    return completed


def with_paper(columns: Sequence[Column], rows: Iterable[Mapping[str, Cell]]) -> list[Column]:
    """Return columns with those that `beside` added, ``*_paper``, each after its computed one.

    Parameters
    ----------
    columns : sequence of Column
        The computed columns.
    rows : iterable of mapping
        Result of `beside`.

    Returns
    -------
    list of Column
        The columns, each followed by its ``*_paper`` column of the same unit if any row has one.
    """
    present = {name for row in rows for name in row}
    wide: list[Column] = []
    for column in columns:
        wide.append(column)
        if (twin := column.name + PAPER_SUFFIX) in present:
            wide.append(replace(column, name=twin, label=""))
    return wide


def computed_columns(columns: Sequence[Column]) -> dict[str, str]:
    """Return the computed column that each column of published values belongs to.

    Parameters
    ----------
    columns : sequence of Column
        Columns of a table.

    Returns
    -------
    dict
        ``NAME_paper`` → ``NAME``, or NAME with its unit: ``v_paper`` → ``v_m_s``.
    """
    computed = {without_unit(column): column.name for column in columns}
    computed.update({column.name: column.name for column in columns})
    return {
        column.name: computed[stem]
        for column in columns
        if column.name.endswith(PAPER_SUFFIX)
        and (stem := column.name.removesuffix(PAPER_SUFFIX)) in computed
    }


def without_unit(column: Column) -> str:
    """Return the name of a column without its unit's suffix."""
    suffix = "_" + column.unit.replace("/", "_").replace("^", "").replace("²", "2")
    return column.name.removesuffix(suffix)


def difference_notes(
    rows: Iterable[Mapping[str, Cell]], reference: ReferenceTable, *, label: str = "name"
) -> list[str]:
    """Compare computed and published values in sentences.

    Parameters
    ----------
    rows : iterable of mapping
        Result of `beside`.
    reference : ReferenceTable
        Source of the published values.
    label : str
        Column that names a row.

    Returns
    -------
    list of str
        First the number of values that agree to the printed digit, with the source; then a sentence
        for each other value, with the difference in units of the last printed digit. Empty without
        any compared value.
    """
    compared = 0
    apart: list[str] = []
    for row in rows:
        for name, printed in row.items():
            value = row.get(name.removesuffix(PAPER_SUFFIX))
            if not name.endswith(PAPER_SUFFIX) or not isinstance(printed, Printed):
                continue
            if not isinstance(value, float | int):
                continue
            compared += 1
            if not printed.agrees(value):
                units = f"{printed.difference(value):+.2f} units of its last digit"
                apart.append(
                    f"{row.get(label) or 'row'}, {name.removesuffix(PAPER_SUFFIX)}: "
                    f"{value:.8g} against the printed {printed.text}"
                    f"{', ' + units if math.isfinite(value) else ''}."
                )
    if not compared:
        return []
    return [
        f"{compared - len(apart)} of {compared} values agree to the printed digit with "
        f"{reference.source}.",
        *apart,
    ]


def _head(text: str) -> tuple[dict[str, str], list[tuple[int, str]]]:
    about: dict[str, str] = {}
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon and not lines:
                about[key.strip().lower()] = value.strip()
        elif line.strip():
            lines.append((number, line))
    return about, lines


def _cells(
    file: str, lines: list[tuple[int, str]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    if not lines:
        raise InputError(f"{file}: no line of column names")
    try:
        # Line by line: a cell of a table of numbers has no line break, and every row has a number.
        table = [
            (n, [c.strip() for c in next(csv.reader([text], strict=True))]) for n, text in lines
        ]
    except csv.Error as error:
        raise InputError(f"{file}: not a CSV table: {error}") from error
    (first, columns), *rows = table
    if len(set(columns)) < len(columns) or "" in columns:
        raise InputError(f"{file}:{first}: column names must be there and differ, got {columns}")
    for line, row in rows:
        if len(row) != len(columns):
            raise InputError(f"{file}:{line}: {len(columns)} cells expected, got {len(row)}")
    return columns, rows


def _number(cell: str) -> Printed | None:
    try:
        return Printed(cell)
    except ValueError:
        return None
