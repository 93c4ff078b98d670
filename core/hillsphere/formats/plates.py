"""Plate models: vertices and triangles as plain tables of numbers, in one file or in two."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.formats.bulk import parse_table
from hillsphere.formats.coefficients import LineReader
from hillsphere.formats.icq import is_icq, read_icq
from hillsphere.formats.obj import read_obj

__all__ = ["read_plate_files", "read_plates", "read_shape"]

_Rows = list[tuple[int, list[str]]]
"""Lines of numbers: number of the line, words."""
_MOST = 99_999_999
"""Most vertices, and plates, of a file: more do not fit into a file of `MAX_TEXT_BYTES`."""


def read_shape(path: str | Path) -> tuple[Array, Integers]:
    """Read a mesh of any kind: rows ``v`` and ``f``, a plate model, or an ICQ file.

    Parameters
    ----------
    path : str or Path
        The file. One whose name ends with ``.obj`` is read by `read_obj`. In other files the first
        word decides: a number begins a plate model (`read_plates`), or an ICQ file if the number of
        rows is that of one (`is_icq`); other rows are those of an OBJ file, whose vertices may be
        counted from 0.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0.

    Raises
    ------
    InputError
        See `read_obj`, `read_plates` and `read_icq`.
    """
    if Path(path).suffix.lower() == ".obj":
        return read_obj(path)
    for line in LineReader(Path(path)):
        words = line.partition("#")[0].split()
        if words:
            if words[0][0] not in "+-.0123456789":
                return read_obj(path, True)
            return read_icq(path) if is_icq(path) else read_plates(path)
    return read_plates(path)  # empty: tells what is expected


def read_plates(path: str | Path) -> tuple[Array, Integers]:
    """Read a plate model.

    Parameters
    ----------
    path : str or Path
        The file: either the numbers of vertices and of plates in its first line, then the vertices,
        then the plates; or the number of vertices, the vertices, the number of plates, the plates.
        A vertex is ``x y z``, a plate ``i j k``; before either may stand its own number, counted
        from 0 or 1 without gaps. Columns are separated by blanks or commas; what follows a ``#`` is
        comment. Vertices are counted from 0 if a plate names vertex 0, else from 1.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file, which such a table does not state.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0, in the order of the file.

    Raises
    ------
    InputError
        Names file and line: a malformed row, numbers that do not fit the counts, a plate that
        refers to a missing vertex.
    """
    lines = LineReader(Path(path))
    if (parsed := _parse_plates(lines)) is not None:
        return parsed
    rows = _rows(lines)
    if not rows or len(rows[0][1]) > 2:
        raise lines.fault(
            "expected the number of vertices, or those of vertices and plates",
            rows[0][0] if rows else 0,
        )
    counts = [_count(lines, word, rows[0][0]) for word in rows[0][1]]
    vertices, rest = _take(lines, rows[1:], counts[0], "vertices")
    if len(counts) == 1:
        if not rest or len(rest[0][1]) != 1:
            raise lines.fault(
                f"expected the number of plates after {counts[0]} vertices",
                rest[0][0] if rest else 0,
            )
        counts.append(_count(lines, rest[0][1][0], rest[0][0]))
        rest = rest[1:]
    plates, rest = _take(lines, rest, counts[1], "plates")
    if rest:
        raise lines.fault(f"a row after the last of {counts[1]} plates", rest[0][0])
    coordinates = _vertices(lines, vertices)
    return coordinates, _plates(lines, plates, len(coordinates))


def read_plate_files(vertices: str | Path, plates: str | Path) -> tuple[Array, Integers]:
    """Read a plate model of two files, one of vertices and one of plates.

    Parameters
    ----------
    vertices, plates : str or Path
        The files, with rows as `read_plates` takes them. Their number may stand in the first line.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0.

    Raises
    ------
    InputError
        See `read_plates`.
    """
    first, second = LineReader(Path(vertices)), LineReader(Path(plates))
    coordinates = _parse_counted(first, "f8")
    if coordinates is None:
        coordinates = _vertices(first, _read_counted(first, "vertices"))
    numbers = _parse_counted(second, "i8")
    faces = None if numbers is None else _count_from_0(numbers, len(coordinates))
    if faces is None:
        faces = _plates(second, _read_counted(second, "plates"), len(coordinates))
    return coordinates, faces


def _parse_plates(lines: LineReader) -> tuple[Array, Integers] | None:
    """Return vertices and plates of a sound file, else None."""
    rows = lines.rows()
    counts = next(rows, "").split()
    if not (0 < len(counts) <= 2 and all(word.isdecimal() for word in counts)):
        return None
    vertices = _parse_part(rows, int(counts[0]), "f8")
    if vertices is None:
        return None
    if len(counts) == 1:
        counts += next(rows, "").split()
        if not (len(counts) == 2 and counts[1].isdecimal()):
            return None
    plates = _parse_part(rows, int(counts[1]), "i8")
    if plates is None or next(rows, None) is not None:
        return None
    faces = _count_from_0(plates, len(vertices))
    return None if faces is None else (vertices, faces)


def _parse_counted(lines: LineReader, type_: str) -> Array | None:
    """Return the rows of a sound file of one kind, after a count in its first line, else None."""
    rows = lines.rows()
    first = next(rows, "")
    words = first.split()
    if len(words) == 1 and words[0].isdecimal():
        part = _parse_part(rows, int(words[0]), type_)
        return part if next(rows, None) is None else None
    return _parse_part(chain([first], rows), None, type_) if words else None


def _parse_part(rows: Iterator[str], count: int | None, type_: str) -> Array | None:
    """Return the last three columns of the next rows, whose numbers before them must fit."""
    first = next(rows, "")
    width = len(first.split())
    if width not in (3, 4) or (count is not None and not 0 < count <= _MOST):
        return None
    fields = [("number", "i8")] * (width - 3) + [(name, type_) for name in "xyz"]
    more = rows if count is None else islice(rows, count - 1)
    table = parse_table(chain([first], more), np.dtype(fields))
    if table is None or (count is not None and len(table) != count):
        return None
    if width == 4:
        start = int(table["number"][0])
        if start not in (0, 1) or (np.diff(table["number"]) != 1).any():
            return None
    return np.stack([table[name] for name in "xyz"], axis=1)


def _count_from_0(numbers: Array, known: int) -> Integers | None:
    """Return the vertices of plates counted from 0; None if one does not exist."""
    base = 0 if (numbers == 0).any() else 1
    if numbers.min() < base or numbers.max() > known - 1 + base:
        return None
    return np.asarray(numbers - base, dtype=np.int64)


def _rows(lines: LineReader) -> _Rows:
    rows: _Rows = []
    for line in lines:
        text = line.partition("#")[0].strip()
        if not text:
            continue
        # Between two commas without a number stands an empty column, which no number is.
        words = [word for part in text.rstrip(" ,").split(",") for word in (part.split() or [""])]
        rows.append((lines.number, words))
    return rows


def _count(lines: LineReader, word: str, line: int) -> int:
    count = lines.integer(word, "number of vertices or plates", line)
    if not 0 < count <= _MOST:
        raise lines.fault(f"the number must lie between 1 and {_MOST}, got {word}", line)
    return count


def _take(lines: LineReader, rows: _Rows, count: int, what: str) -> tuple[_Rows, _Rows]:
    if len(rows) < count:
        raise lines.fault(f"expected {count} {what}, got {len(rows)}", line=0)
    return rows[:count], rows[count:]


def _read_counted(lines: LineReader, what: str) -> _Rows:
    """Return the rows of a file of one kind, after a count in its first line."""
    rows = _rows(lines)
    if rows and len(rows[0][1]) == 1:
        count = _count(lines, rows[0][1][0], rows[0][0])
        if len(rows) - 1 != count:
            raise lines.fault(f"expected {count} {what}, got {len(rows) - 1}", rows[0][0])
        rows = rows[1:]
    if not rows:
        raise lines.fault(f"no {what}", line=0)
    return rows


def _columns(lines: LineReader, rows: _Rows, what: str) -> _Rows:
    """Return the rows without the numbers that may stand before them."""
    width = len(rows[0][1])
    first = None
    three: _Rows = []
    for place, (line, words) in enumerate(rows):
        if len(words) not in (3, 4) or len(words) != width:
            expected = "3 columns, or 4 with a number before them" if place == 0 else f"{width}"
            raise lines.fault(f"expected {what} of {expected}, got {len(words)}", line)
        if width == 4:
            number = lines.integer(words[0], f"number of a row of {what}", line)
            if first is None and number > 1:
                raise lines.fault(f"{what} must be counted from 0 or 1, got {number}", line)
            first = number if first is None else first
            if number != first + place:
                raise lines.fault(
                    f"{what} must be counted without gaps: expected {first + place}, got {number}",
                    line,
                )
        three.append((line, words[-3:]))
    return three


def _vertices(lines: LineReader, rows: _Rows) -> Array:
    return np.array(
        [
            [lines.real(word, "coordinate", line) for word in words]
            for line, words in _columns(lines, rows, "vertices")
        ]
    )


def _plates(lines: LineReader, rows: _Rows, known: int) -> Integers:
    rows = _columns(lines, rows, "plates")
    numbers: NDArray[np.int64] = np.array(
        [
            [lines.integer(word, "vertex of a plate", line) for word in words]
            for line, words in rows
        ],
        dtype=np.int64,
    )
    base = 0 if (numbers == 0).any() else 1
    beyond = (numbers > known - 1 + base).any(axis=1)
    if beyond.any():
        place = int(np.argmax(beyond))
        raise lines.fault(
            f"a plate names vertex {numbers[place].max()}, but there are {base} to "
            f"{known - 1 + base}",
            rows[place][0],
        )
    return numbers - base
