"""Tables of coefficients without a head, as EGM2008 is published."""

from __future__ import annotations

from pathlib import Path

from hillsphere.formats.bulk import parse_series
from hillsphere.formats.coefficients import Coefficient, LineReader

__all__ = ["read_coefficient_rows", "split_columns"]

_MOST = 10_000
"""Largest degree: a larger number in the first column is no degree."""


def split_columns(line: str) -> list[str]:
    """Return the columns of a line, separated by blanks, commas or both.

    Between two commas without a number stands an empty column, so that it is not passed over.
    """
    if "," not in line:
        return line.split()
    return [word for part in line.rstrip(" ,\t").split(",") for word in (part.split() or [""])]


def read_coefficient_rows(
    path: str | Path, kept_degree: int | None = None
) -> tuple[tuple[Coefficient, ...], int]:
    """Read rows of degree, order, C, S and perhaps their two standard deviations.

    Parameters
    ----------
    path : str or Path
        The file. Columns are separated by blanks or commas; all rows have the same number. What
        follows a ``#`` is comment.
    kept_degree : int, optional
        Rows of higher degree are checked and left out, which saves memory.

    Returns
    -------
    rows : tuple of Coefficient
        In the order of the file.
    max_degree : int
        Highest degree of the file.

    Raises
    ------
    InputError
        Names file and line: a malformed or doubled row, a missing degree, no row at all.
    """
    lines = LineReader(Path(path))
    if (bulk := parse_series(lines, widths=(4, 6), kept_degree=kept_degree)) is not None:
        lines.check_degrees(bulk.degrees, max(bulk.degrees))
        return bulk.rows, max(bulk.degrees)
    rows: list[Coefficient] = []
    columns = 0
    for line in lines:
        words = split_columns(line.partition("#")[0])
        if not words:
            continue
        if len(words) not in (4, 6) or (columns and len(words) != columns):
            expected = str(columns) if columns else "4 (n, m, C, S) or 6 (and two sigmas)"
            raise lines.fault(f"expected {expected} columns, got {len(words)}")
        columns = len(words)
        rows.append(lines.coefficient(words, _MOST))
    if not rows:
        raise lines.fault("no row of degree, order, C and S", line=0)
    degree = max(row.n for row in rows)
    lines.check_degrees((row.n for row in rows), degree)
    return tuple(row for row in rows if kept_degree is None or row.n <= kept_degree), degree
