"""Shapes as tables of spherical-harmonic coefficients of the radius."""

from __future__ import annotations

from pathlib import Path

from hillsphere.formats.coefficients import Coefficient, LineReader

__all__ = ["read_shape_harmonics"]

_MOST = 2000
"""Largest degree: 2 million coefficients. A larger number in the first column is no degree."""


def read_shape_harmonics(path: str | Path) -> tuple[Coefficient, ...]:
    """Read rows ``n m C S``, as the tables of the Planetary Data System hold them.

    Parameters
    ----------
    path : str or Path
        The file: columns separated by blanks or commas, in any order of degree and order; what
        follows a ``#`` is comment.

    Returns
    -------
    tuple of Coefficient
        In the unit of the file, which such a table does not state.

    Raises
    ------
    InputError
        Names file and line: a malformed or doubled row, a missing degree, no C of degree 0.
    """
    lines = LineReader(Path(path))
    rows: list[Coefficient] = []
    for line in lines:
        words = line.partition("#")[0].replace(",", " ").split()
        if words:
            rows.append(lines.coefficient(words, _MOST))
    lines.check_degrees((row.n for row in rows), max((row.n for row in rows), default=0))
    if not any(row.n == 0 and row.c > 0.0 for row in rows):
        raise lines.fault("no row '0 0 C 0' with the mean radius C > 0", line=0)
    return tuple(rows)
