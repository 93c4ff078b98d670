"""Joint samples of quantities, drawn from the rows of a table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.uncertainty.distribution import require_count, si_unit
from hillsphere.uncertainty.specs import SamplesSpec

__all__ = ["Samples", "read_columns"]


class Samples:
    """Empirical distribution: equally probable rows of a table.

    A whole row is drawn, by the first uniform number of a case, so that the correlation of the
    columns is preserved. Mean and covariance are those of the rows as a population.

    Parameters
    ----------
    spec : SamplesSpec
        The table.

    Raises
    ------
    InputError
        If the file cannot be read as a table of numbers or lacks a column.
    """

    def __init__(self, spec: SamplesSpec) -> None:
        self.of = spec.of
        self.keys = spec.parameters
        self.unit, factor = si_unit(spec.unit)
        if spec.file is not None:
            table = read_columns(spec.file)
            if missing := [name for name in spec.parameters if name not in table]:
                raise InputError(
                    f"{spec.file}: no column {missing[0]!r}; it has {', '.join(table)}"
                )
            rows = np.array([table[name] for name in spec.parameters])
        else:
            rows = np.array(spec.rows, dtype=float).T
        rows = factor * rows
        self._mean = rows.mean(axis=1)
        if spec.scale != 1.0:
            rows = self._mean[:, None] + spec.scale * (rows - self._mean[:, None])
        self._rows = rows

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return whole rows as values (k, N), SI, by the first row of numbers u (k, N) in (0, 1).

        Parameters
        ----------
        u : ndarray, shape (k, N)
            Independent uniform numbers.
        nominal : ndarray, shape (k,)
            Nominal values; only their number is used.
        """
        self._check(nominal)
        count = self._rows.shape[1]
        row = np.minimum((u[0] * count).astype(np.int64), count - 1)
        return np.ascontiguousarray(self._rows[:, row])

    def mean(self, nominal: Array) -> Array:
        """Return the mean of the rows (k,), SI."""
        self._check(nominal)
        return np.array(self._mean)

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance of the rows (k, k), SI."""
        self._check(nominal)
        apart = self._rows - self._mean[:, None]
        return np.asarray(apart @ apart.T / self._rows.shape[1])

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return mean ∓ `sigmas` standard deviations (k,), SI, limited to the range of the rows."""
        mean, reach = self.mean(nominal), sigmas * np.sqrt(np.diag(self.covariance(nominal)))
        least, largest = self._rows.min(axis=1), self._rows.max(axis=1)
        return np.maximum(mean - reach, least), np.minimum(mean + reach, largest)

    def _check(self, nominal: Array) -> None:
        require_count(len(self._rows), len(nominal), "a column")


def read_columns(path: str | Path) -> dict[str, Array]:
    """Read a CSV file of numbers whose first line names the columns.

    Parameters
    ----------
    path : str or Path
        The file, in UTF-8; empty lines and lines that begin with ``#`` are ignored.

    Returns
    -------
    dict of str to ndarray, shape (N,)
        Column → values, in the order of the file; at least one row.

    Raises
    ------
    InputError
        If a value is missing or not a finite number; the message names file and line.
    """
    try:
        text = read_text(path, "utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text: {error.reason}") from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if len(lines) < 2:
        raise InputError(f"{path}: needs a line of column names and at least one row of numbers")
    try:
        table = [
            (number, [cell.strip() for cell in next(csv.reader([line], strict=True))])
            for number, line in lines
        ]
    except csv.Error as error:
        raise InputError(f"{path}: not a CSV table: {error}") from error
    (first, names), *rows = table
    if len(set(names)) < len(names) or "" in names:
        raise InputError(f"{path}:{first}: column names must be there and differ, got {names}")
    values = np.empty((len(names), len(rows)))
    for at, (number, cells) in enumerate(rows):
        if len(cells) != len(names):
            raise InputError(f"{path}:{number}: {len(names)} numbers expected, got {len(cells)}")
        for column, cell in enumerate(cells):
            values[column, at] = _number(cell, f"{path}:{number}: {names[column][:64]}")
    return dict(zip(names, values, strict=True))


def _number(cell: str, where: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        raise InputError(f"{where}: expected a number, got {cell[:40]!r}") from None
    if not np.isfinite(number):
        raise InputError(f"{where}: must be finite, got {cell[:40]!r}")
    return number
