"""Columns of many cases in files: written once, block by block, and read a column at a time.

A file is an ordinary ``.npy`` of one record, whose fields are the columns of its cases, so that
``numpy.load("cases-0000000.npy", mmap_mode="r")["values"][0, 3]`` works without this package. The
field ``facts`` holds JSON; ``checks`` the CRC-32 of each column, which is compared when it is read.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import tokenize
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from secrets import token_hex
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.atomic import PART_SUFFIX, replacing
from hillsphere.base.errors import InputError, StageError
from hillsphere.base.private_cache import is_private
from hillsphere.base.regular_files import open_regular

__all__ = [
    "ColumnFile",
    "ColumnFiles",
    "Columns",
    "column_folder",
    "write_columns",
]

Key = int | np.integer[Any] | slice | EllipsisType | Sequence[int] | NDArray[Any]

_SUFFIX = ".columns"
"""Ending of the folder beside a product's file that holds its columns."""

_DAMAGES = (
    ValueError, LookupError, TypeError, AttributeError, SyntaxError, EOFError, ArithmeticError,
    RuntimeError, struct.error, tokenize.TokenError,
)  # fmt: skip
"""Errors of JSON, and of NumPy, which parses the head of a file as a Python literal."""

_KINDS = "fiubU"
"""Kinds of numbers and texts that a file may hold; no Python objects."""


def column_folder(path: Path) -> Path:
    """Return the folder of the columns of a product that is stored at `path`."""
    return path.with_suffix(_SUFFIX)


def write_columns(
    path: Path, columns: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
) -> None:
    """Write a file of columns; it appears complete or not at all.

    Parameters
    ----------
    path : Path
        The file.
    columns : mapping of str to ndarray
        Arrays of shape (n,) or (rows, n), by name.
    facts : mapping
        Anything else, as JSON.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    text = json.dumps(facts, sort_keys=True, allow_nan=False).encode("ascii")
    arrays = {name: np.ascontiguousarray(a) for name, a in columns.items()}
    checks = [zlib.crc32(row.tobytes()) for a in arrays.values() for row in _rows(a)]
    arrays["facts"] = np.frombuffer(text, dtype=np.uint8)
    arrays["checks"] = np.array([*checks, zlib.crc32(text)], dtype=np.uint32)
    fields = [(name, a.dtype.newbyteorder("<"), a.shape) for name, a in arrays.items()]
    descr = np.lib.format.dtype_to_descr(np.dtype(fields))
    with replacing(path) as stream:
        head = {"descr": descr, "fortran_order": False, "shape": (1,)}
        np.lib.format.write_array_header_1_0(stream, head)
        for (_, dtype, _), array in zip(fields, arrays.values(), strict=True):
            stream.write(array.astype(dtype, copy=False).tobytes())


def _rows(array: NDArray[Any]) -> NDArray[Any]:
    """Return the columns of a field (rows, n), each of which has a check of its own."""
    return array if array.ndim == 2 else array[None]


class ColumnFile:
    """An open file of columns; a context manager, which closes it.

    Parameters
    ----------
    path : Path
        The file.
    own : bool
        Whether to refuse a file that others may write to.

    Attributes
    ----------
    facts : dict
        What was written beside the columns.
    cases : int
        Number of cases n.
    check : int
        CRC-32 of its checks, which distinguishes it from any other file.

    Raises
    ------
    InputError
        If it is not there, no such file, or damaged; with `own`, if others may write to it.
    StageError
        If it cannot be read just now.
    """

    def __init__(self, path: Path, *, own: bool = False) -> None:
        self._path = path
        try:
            self._stream = open_regular(path, follow_links=False)
        except FileNotFoundError as error:
            raise InputError(
                f"{path}: is not there; the columns of a large campaign are read from its run "
                "directory"
            ) from error
        except OSError as error:
            raise StageError(f"{path}: cannot be read: {error.strerror or error}") from error
        try:
            if own and not is_private(os.fstat(self._stream.fileno())):
                raise InputError(f"{path.name}: belongs to another user, or others may write to it")
            self._read_head()
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> ColumnFile:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _read_head(self) -> None:
        stream = self._stream
        try:
            if np.lib.format.read_magic(stream) != (1, 0):
                raise ValueError("its header is of another version")
            shape, _, self._dtype = np.lib.format.read_array_header_1_0(stream)
            self._begin = stream.tell()
            size = os.fstat(stream.fileno()).st_size
            parts = dict(self._dtype.fields or {})
            bad = any((p[0].subdtype or (p[0],))[0].kind not in _KINDS for p in parts.values())
            if shape != (1,) or bad or self._begin + self._dtype.itemsize != size:
                raise ValueError("it is cut off, or holds something else")
            self._fields: dict[str, tuple[np.dtype[Any], tuple[int, ...], int, int]] = {}
            first = 0
            for name in self._dtype.names or ():
                dtype, offset = parts[name][:2]
                base, extent = dtype.subdtype or (dtype, ())
                self._fields[name] = base, extent, int(offset), first
                first += extent[0] if len(extent) == 2 else 1
            self._checks = self._raw("checks")
            self.check = zlib.crc32(self._checks.tobytes())
            self.facts: dict[str, Any] = json.loads(self.read("facts").tobytes())
            self.cases = int(self._fields["case"][1][0])
        except _DAMAGES as error:
            raise InputError(
                f"{self._path.name}: damaged, or no file of cases ({error})"
            ) from error

    def rows(self, name: str) -> int:
        """Return the number of columns in a field of shape (rows, n)."""
        return self._field(name)[1][0]

    def _field(self, name: str) -> tuple[np.dtype[Any], tuple[int, ...], int, int]:
        if name not in self._fields:
            raise InputError(f"{self._path.name}: damaged, it has no field {name}")
        return self._fields[name]

    def read(self, name: str, row: int | None = None) -> NDArray[Any]:
        """Return a field, or one column of a field that has several.

        Raises
        ------
        InputError
            If it is damaged.
        """
        values = self._raw(name, row)
        first = self._field(name)[3] + (row or 0)
        for i, one in enumerate(_rows(values)):
            if zlib.crc32(one.tobytes()) != self._checks[first + i]:
                raise InputError(
                    f"{self._path.name}: its field {name} is damaged; restore it, or run the "
                    "mission again"
                )
        return values

    def _raw(self, name: str, row: int | None = None) -> NDArray[Any]:
        base, extent, offset, _ = self._field(name)
        if row is not None:
            extent = extent[1:]
            offset += row * base.itemsize * extent[0]
        size = int(np.prod(extent)) * base.itemsize
        try:
            self._stream.seek(self._begin + offset)
            return np.frombuffer(self._stream.read(size), dtype=base).reshape(extent)
        except OSError as error:
            raise StageError(f"{self._path}: cannot be read: {error.strerror or error}") from error


@dataclass(eq=False)
class ColumnFiles:
    """Files of neighbouring cases, ``cases-0000000.npy`` and so on.

    Parameters
    ----------
    directory : Path
        Where they are; changed when the product that they belong to is stored.
    counts : ndarray of int, shape (files,)
        Cases in each.
    sizes : ndarray of int, shape (files,)
        Bytes of each.
    checks : ndarray of int, shape (files,)
        `ColumnFile.check` of each.
    own : bool
        Whether to refuse files that others may write to.
    """

    directory: Path
    counts: Integers
    sizes: Integers
    checks: Integers
    own: bool = False
    _ends: Integers = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._ends = np.cumsum(self.counts, dtype=np.int64)

    @staticmethod
    def name(number: int) -> str:
        """Return the name of a file."""
        return f"cases-{number:07d}.npy"

    @property
    def cases(self) -> int:
        """Number of cases in all."""
        return int(self._ends[-1]) if self._ends.size else 0

    def verify(self) -> None:
        """Raise `InputError` unless all files are there with their sizes."""
        for number, size in enumerate(self.sizes.tolist()):
            path = self.directory / self.name(number)
            try:
                there = path.lstat().st_size
            except OSError as error:
                raise InputError(
                    f"{path}: cannot be read: {error.strerror or error}; restore it, or run the "
                    "mission again"
                ) from error
            if there != size:
                raise InputError(
                    f"{path}: has {there} bytes instead of {size}; restore it, or run the mission "
                    "again"
                )

    def read(self, name: str) -> NDArray[Any]:
        """Return a field of shape (n,) of all cases."""
        parts = []
        for number in range(self.counts.size):
            with self._open(number) as file:
                parts.append(file.read(name))
        return np.concatenate(parts)

    def rows(self, name: str, rows: Sequence[int], first: int, last: int) -> Array:
        """Return columns of a field for the cases at places first … last − 1.

        Parameters
        ----------
        name : str
            A field of shape (rows, n) in each file; NaN where a file has no rows, because none of
            its cases has a value.
        rows : sequence of int
            Which.
        first, last : int
            Places of the cases.

        Returns
        -------
        ndarray, shape (len(rows), last − first)
        """
        found = np.full((len(rows), max(last - first, 0)), np.nan)
        begin = int(np.searchsorted(self._ends, first, side="right"))
        for number in range(begin, self.counts.size):
            start = int(self._ends[number] - self.counts[number])
            if start >= last:
                break
            a, b = max(first, start), min(last, int(self._ends[number]))
            with self._open(number) as file:
                if file.rows(name):
                    for place, row in enumerate(rows):
                        part = file.read(name, row)[a - start : b - start]
                        found[place, a - first : b - first] = part
        return found

    def _open(self, number: int) -> ColumnFile:
        """Open a file, and make sure that it is the one that was written."""
        path = self.directory / self.name(number)
        file = ColumnFile(path, own=self.own)
        if file.check != self.checks[number] or file.cases != self.counts[number]:
            file.close()
            raise InputError(
                f"{path}: is not the file that the run wrote; it is damaged or was replaced: "
                "restore it, or run the mission again"
            )
        return file

    def store(self, folder: Path, *, own: bool) -> None:
        """Have the files in a folder, as links to the same content where that can be.

        Parameters
        ----------
        folder : Path
            The folder, which appears complete or not at all; an old one is replaced.
        own : bool
            Whether nobody else may write to the files.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        if folder == self.directory:
            return
        part = folder.with_name(f".{folder.name}.{token_hex(4)}{PART_SUFFIX}")
        part.mkdir(mode=0o700 if own else 0o777)
        try:
            for number in range(self.counts.size):
                _link(self.directory / self.name(number), part / self.name(number), own)
            shutil.rmtree(folder, ignore_errors=True)
            part.replace(folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        self.directory = folder


def _link(source: Path, target: Path, own: bool) -> None:
    """Make a hard link, or a copy on another file system or if others may write to the file."""
    if not own or is_private(source.lstat()):
        try:
            os.link(source, target, follow_symlinks=False)
            return
        except FileNotFoundError:
            raise
        except OSError:  # no links there
            pass
    with source.open("rb") as stream, replacing(target, mode=0o600 if own else None) as copy:
        shutil.copyfileobj(stream, copy)


class Columns:
    """Columns (k, N) of numbers in files, of which one is in memory at a time.

    ``columns[3]`` is the column (N,) as an array, ``columns[3, cases]`` and ``columns[:, 10:20]``
    are parts as arrays, ``columns[[1, 2]]`` some columns in files. ``numpy.asarray(columns)`` reads
    all of them.

    Parameters
    ----------
    files : ColumnFiles
        The files.
    field : str
        Field of the files, of shape (rows, n) in each.
    rows : sequence of int
        Rows of the field.
    """

    dtype = np.dtype(np.float64)
    ndim = 2

    def __init__(self, files: ColumnFiles, field: str, rows: Sequence[int]) -> None:
        self.files, self.field, self.rows = files, field, tuple(rows)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of columns and of cases."""
        return len(self.rows), self.files.cases

    def __len__(self) -> int:
        """Return the number of columns."""
        return len(self.rows)

    def __iter__(self) -> Iterator[Array]:
        """Return the columns one by one."""
        return (self._part((row,), 0, self.files.cases)[0] for row in self.rows)

    def __array__(
        self, dtype: np.dtype[Any] | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return all columns."""
        return self._part(self.rows, 0, self.files.cases).astype(dtype or self.dtype, copy=False)

    def __getitem__(self, key: Any) -> Any:
        """Return a column, a part of columns, or some of the columns, as described above."""
        if not isinstance(key, tuple):
            chosen = np.array(self.rows, dtype=np.int64)[key]
            if np.ndim(chosen):
                return Columns(self.files, self.field, chosen.tolist())
            return self._part((int(chosen),), 0, self.files.cases)[0]
        rows, cases = key
        chosen = np.array(self.rows, dtype=np.int64)[rows]
        if np.ndim(rows) and np.ndim(cases) and np.asarray(cases).dtype != np.bool_:
            return self._pairs(*np.broadcast_arrays(chosen, np.asarray(cases)))
        each = np.atleast_1d(chosen).tolist()
        if isinstance(cases, slice) and cases.step in (None, 1):
            first, last, _ = cases.indices(self.files.cases)
            found = self._part(each, first, last)
        elif isinstance(cases, int | np.integer):
            place = range(self.files.cases)[int(cases)]
            found = self._part(each, place, place + 1)[:, 0]
        else:
            parts = [self._part((row,), 0, self.files.cases)[0][cases] for row in each]
            found = np.array(parts) if parts else np.empty((0, self.files.cases))[:, cases]
        return found if np.ndim(chosen) else found[0]

    def _part(self, rows: Sequence[int], first: int, last: int) -> Array:
        return self.files.rows(self.field, rows, first, last)

    def _pairs(self, rows: Integers, cases: Integers) -> Array:
        """Return single values (n,), by their rows and cases (n,)."""
        found = np.empty(rows.shape)
        for row in np.unique(rows).tolist():
            here = rows == row
            found[here] = self._part((row,), 0, self.files.cases)[0][cases[here]]
        return found
