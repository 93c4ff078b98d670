"""Tables of numbers that are parsed as a whole, by NumPy instead of line by line.

A table of a million rows takes a second so, and fifteen line by line. Whatever is not uniform is
left to the caller, who reads line by line and names the line of a fault.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hillsphere.formats.coefficients import Coefficient, LineReader

__all__ = ["SeriesRows", "parse_series", "parse_table"]

_MOST_DEGREE = 10_000
"""Largest degree of a table without a head: a larger number in the first column is no degree."""


class SeriesRows(NamedTuple):
    """The rows of a series that were kept, and the degrees of which the file has rows."""

    rows: tuple[Coefficient, ...]
    degrees: frozenset[int]
    columns: int


def parse_series(
    lines: LineReader,
    *,
    widths: tuple[int, ...],
    keyword: str | None = None,
    max_degree: int | None = None,
    max_order: int | None = None,
    kept_degree: int | None = None,
) -> SeriesRows | None:
    """Parse what follows the present line as degree, order, C, S and standard deviations.

    Parameters
    ----------
    lines : LineReader
        After the head.
    widths : tuple of int
        Numbers of columns that a row may have, without the keyword.
    keyword : str, optional
        What stands before the columns in each row, where neither comments nor commas may stand.
    max_degree, max_order : int, optional
        Highest that may stand there; by default 10,000 and the degree.
    kept_degree : int, optional
        Rows of higher degree are checked and left out.

    Returns
    -------
    SeriesRows or None
        The rows; None if there is none, or one is malformed or doubled, or none of the formats.
    """
    rows = lines.rows(bare=keyword is not None)
    first = next(rows, "").split()
    at = 0 if keyword is None else 1
    width = len(first) - at
    if width not in widths:
        return None
    fields: list[tuple[str, str]] = [("n", "i8"), ("m", "i8")]
    fields += [(f"value {k}", "f8") for k in range(width - 2)]
    if keyword is not None:
        # one character more than it has, so that a longer word is another one
        fields.insert(0, ("keyword", f"U{len(keyword) + 1}"))
    table = parse_table(chain([" ".join(first)], rows), np.dtype(fields))
    if table is None or (keyword is not None and (table["keyword"] != keyword).any()):
        return None
    n, m = table["n"], table["m"]
    most = _MOST_DEGREE if max_degree is None else max_degree
    order = most if max_order is None else max_order
    sound = (m >= 0) & (m <= n) & (n <= most) & (m <= order)
    sound &= (m > 0) | (table["value 1"] == 0.0)
    if not sound.all() or len(np.unique(n * (most + 1) + m)) != len(table):
        return None
    kept = table if kept_degree is None else table[n <= kept_degree]
    names = [name for name in kept.dtype.names or () if name != "keyword"][:6]
    columns = [kept[name].tolist() for name in names]
    return SeriesRows(
        tuple(Coefficient(*row) for row in zip(*columns, strict=True)),
        frozenset(np.unique(n).tolist()),
        width,
    )


def parse_table(
    rows: Iterable[str], dtype: DTypeLike, columns: Sequence[int] | None = None
) -> NDArray[Any] | None:
    """Parse rows of numbers between blanks.

    Parameters
    ----------
    rows : iterable of str
        The rows, none of them blank; Fortran's D exponents are accepted.
    dtype : dtype
        Of the table, or of one row of it: a structure whose fields are the columns. Integers must
        be written as such.
    columns : sequence of int, optional
        Columns that are used; rows may then have more, and different numbers of them.

    Returns
    -------
    ndarray or None
        One row for each; None if a row has another number of columns than the first, or a word
        that is no finite number of its type.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a float where an integer must stand, a file without rows
        try:
            table = np.loadtxt(
                (_write_exponents(row) for row in rows),
                dtype=dtype, comments=None, usecols=columns, ndmin=1, encoding=None,
            )  # fmt: skip
        except (ValueError, OverflowError, UserWarning, DeprecationWarning):
            return None
    parts = [table[name] for name in table.dtype.names] if table.dtype.names else [table]
    finite = all(np.isfinite(part).all() for part in parts if part.dtype.kind == "f")
    return table if finite else None


def _write_exponents(row: str) -> str:
    if "D" in row or "d" in row:
        return row.replace("D", "E").replace("d", "e")
    return row
