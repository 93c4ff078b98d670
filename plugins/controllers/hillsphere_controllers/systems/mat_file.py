"""MATLAB's files of version 5, read without compiled code: a damaged one can only be refused.

SciPy's ``loadmat`` reads them in compiled code that trusts the lengths in the file; some damaged
files end the process. Here every length is compared with what is there before it is used.

References
----------
.. [1] The MathWorks, "MAT-File Format", chapter 1 (Level 5 MAT-Files): head, data elements, tags,
   and the subelements of arrays.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from math import prod
from typing import Any, TypeAlias

import numpy as np

from hillsphere.base.npz import MAX_UNPACKED_BYTES

__all__ = ["MatFileError", "parse_mat"]

Value: TypeAlias = np.ndarray[Any, Any]

_HEAD = 128
"""Bytes of the header of a version 5 file [1]_: 116 of text, 8 of offset, 2 of version, 2 of byte
order."""
_MATRIX, _COMPRESSED = 14, 15
"""Kinds of data elements that hold others [1]_, table 1-1."""

_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
"""Kinds of data elements that hold numbers."""

_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
"""Kinds of data elements that hold characters."""

_CLASSES = {
    6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8",
}  # fmt: skip
"""Classes of arrays of numbers [1]_, table 1-3."""

_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
"""Classes of arrays that are not numeric [1]_, table 1-3; 16 and 17 are undocumented: function
handles and new-style objects."""
_COMPLEX = 0x0800
"""Bit of the array flags that announces an imaginary part [1]_."""

_DEEPEST = 16
"""Deepest nesting of cells and structs. What is read here has three levels; each costs three calls
of Python's thousand."""


class MatFileError(ValueError):
    """The file is damaged, or holds an unsupported element; the message names it."""


def parse_mat(data: bytes) -> dict[str, Value]:
    """Return the variables of a file of version 5 (MATLAB's ``-v6`` and ``-v7``).

    Parameters
    ----------
    data : bytes
        The whole file.

    Returns
    -------
    dict of str to ndarray
        By name. A struct has named fields, a cell array is one of objects, text one of strings,
        a row each, a sparse matrix is full.

    Raises
    ------
    MatFileError
        If it is of another version, is damaged, unpacks to more than
        `hillsphere.base.npz.MAX_UNPACKED_BYTES`, or holds objects or functions.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise MatFileError("it does not begin as a file of version 5; save it with save(…, '-v7')")
    version = struct.unpack(f"{order}H", data[124:126])[0]
    if version == 0x0200:
        raise MatFileError("it is a file of version 7.3; save it with save(…, '-v7')")
    if version != 0x0100:
        raise MatFileError(f"it is of version {version:#x}, which is not read")
    reader = _Reader(order)
    variables: dict[str, Value] = {}
    for kind, content in reader.elements(memoryview(data)[_HEAD:]):
        body = content
        if kind == _COMPRESSED:
            kind, body = reader.one(memoryview(reader.decompress(content)))
        if kind != _MATRIX:
            raise MatFileError(f"a variable is of kind {kind}, which is no array")
        name, value = reader.array(body, 0)
        if not name:  # where MATLAB keeps what its objects consist of
            raise MatFileError(_OBJECTS)
        variables[name] = value
    return variables


_OBJECTS = (
    "it holds objects of MATLAB's, such as ss or uss; save a struct of their matrices a, b, c, d, "
    "Ts instead"
)


class _Reader:
    """Reads data elements of one byte order; counts the bytes that were asked for.

    Parameters
    ----------
    order : str
        ``"<"`` or ``">"``.
    """

    def __init__(self, order: str) -> None:
        self.order = order
        self._bytes = 0

    def _claim(self, count: int) -> None:
        self._bytes += count
        if self._bytes > MAX_UNPACKED_BYTES:
            raise MatFileError(f"it unpacks to more than {MAX_UNPACKED_BYTES} bytes")

    def decompress(self, data: memoryview) -> bytes:
        """Return the content of a compressed element; zlib packs 1000 zeros in a byte."""
        unpacking = zlib.decompressobj()
        parts: list[bytes] = []
        rest: bytes | memoryview = data
        try:
            while rest and not unpacking.eof:
                parts.append(unpacking.decompress(rest, 1 << 20))
                self._claim(len(parts[-1]))
                rest = unpacking.unconsumed_tail
            parts.append(unpacking.flush())
        except zlib.error as error:
            raise MatFileError(f"a compressed variable is torn: {error}") from error
        return b"".join(parts)

    def elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield kind and content of data elements that stand one behind the other [1]_, 1-6."""
        at = 0
        while at < len(data):
            if at + 8 > len(data):
                raise MatFileError("it ends within the head of an element")
            kind, length = struct.unpack_from(f"{self.order}2I", data, at)
            begin = at + 8
            if kind >> 16:  # a small one: its length, its kind, and up to four bytes
                kind, length, begin = kind & 0xFFFF, kind >> 16, at + 4
                if length > 4:
                    raise MatFileError(f"a small element is said to have {length} bytes")
                at += 8
            else:
                # Compressed elements alone are not filled up to eight bytes.
                at = begin + (length if kind == _COMPRESSED else length + -length % 8)
            if begin + length > len(data):
                raise MatFileError(f"an element of {length} bytes has {len(data) - begin}")
            yield kind, data[begin : begin + length]

    def one(self, data: memoryview) -> tuple[int, memoryview]:
        """Return kind and content of the first element."""
        for kind, content in self.elements(data):
            return kind, content
        raise MatFileError("a compressed variable is empty")

    def array(self, data: memoryview, depth: int) -> tuple[str, Value]:
        """Return name and value of an array, whose subelements these are [1]_, table 1-2."""
        if not len(data):  # what MATLAB writes for [] in a cell or a field
            return "", np.zeros((0, 0))
        if depth > _DEEPEST:
            raise MatFileError(f"it is nested deeper than {_DEEPEST} levels")
        parts = self.elements(data)
        flags = self._integers(parts, "u4")
        if len(flags) != 2:
            raise MatFileError("the flags of an array are no two numbers")
        kind = flags[0] & 0xFF
        if kind in (_FUNCTION, _OPAQUE):
            raise MatFileError(_OBJECTS)
        shape = tuple(self._integers(parts, "i4"))
        if not 2 <= len(shape) <= 8 or min(shape) < 0:
            raise MatFileError(f"the dimensions of an array are said to be {shape}")
        name = self._text(parts)
        if kind == _OBJECT:
            raise MatFileError(
                f"{name or 'a field'} is an object of MATLAB's; save a struct of its matrices"
            )
        if kind == _CHAR:
            return name, self._characters(shape, parts)
        if kind == _CELL:
            return name, self._cells(shape, parts, len(data), depth)
        if kind == _STRUCT:
            return name, self._struct(shape, parts, len(data), depth)
        if kind == _SPARSE:
            return name, self._sparse(shape, parts, bool(flags[0] & _COMPLEX))
        if kind not in _CLASSES:
            raise MatFileError(f"{name or 'a field'} is an array of the unknown class {kind}")
        return name, self._numeric(shape, parts, _CLASSES[kind], bool(flags[0] & _COMPLEX))

    def _next(self, parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
        for kind, content in parts:
            return kind, content
        raise MatFileError("an array has too few parts")

    def _integers(self, parts: Iterator[tuple[int, memoryview]], form: str) -> list[int]:
        kind, content = self._next(parts)
        # Dimensions are integers of four bytes, with or without a sign: writers differ.
        if kind not in (5, 6) or len(content) % 4:
            raise MatFileError(f"integers are of kind {kind} and {len(content)} bytes")
        if len(content) > 64:  # two flags; dimensions, of which MATLAB's arrays have few
            raise MatFileError(f"an array is said to have {len(content) // 4} dimensions")
        made: list[int] = np.frombuffer(content, self.order + form).tolist()
        return made

    def _text(self, parts: Iterator[tuple[int, memoryview]]) -> str:
        kind, content = self._next(parts)
        if kind not in (1, 2, 16):
            raise MatFileError(f"a name is of kind {kind}")
        return _word(bytes(content))

    def _values(self, parts: Iterator[tuple[int, memoryview]], form: str, count: int) -> Value:
        """Return a number of values in the type of their array, whatever type the file stores."""
        kind, content = self._next(parts)
        held = _NUMBERS.get(kind)
        if held is None:
            raise MatFileError(f"numbers are of kind {kind}")
        if len(content) != count * int(held[1]):
            raise MatFileError(f"{count} numbers have {len(content)} bytes")
        self._claim(count * int(form[1]))
        with np.errstate(all="ignore"):
            return np.frombuffer(content, self.order + held).astype(form)

    def _numeric(
        self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], form: str, two: bool
    ) -> Value:
        values = self._values(parts, form, prod(shape))
        if two:
            self._claim(values.nbytes)
            values = values + 1j * self._values(parts, form, prod(shape))
        return values.reshape(shape, order="F")

    def _sparse(
        self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], two: bool
    ) -> Value:
        """Return a matrix that is kept by columns: rows, where each column begins, values."""
        if len(shape) != 2:
            raise MatFileError(f"a sparse matrix has {len(shape)} dimensions")
        kept = []
        for _ in range(2):
            kind, content = self._next(parts)
            if kind not in (5, 6) or len(content) % 4:
                raise MatFileError(f"places of a sparse matrix are of kind {kind}")
            self._claim(2 * len(content))
            kept.append(np.frombuffer(content, self.order + "i4").astype(np.int64))
        rows, begins = kept
        count = int(begins[-1]) if begins.size else -1
        sound = (
            begins.size == shape[1] + 1
            and begins[0] == 0
            and bool((np.diff(begins) >= 0).all())
            and count <= rows.size
        )
        if not sound or (count and not 0 <= rows[:count].min() <= rows[:count].max() < shape[0]):
            raise MatFileError("the places of a sparse matrix lie outside it")
        self._claim(prod(shape) * (1 + two) * 8)
        full = np.zeros(shape, complex if two else float)
        values = []
        for _ in range(1 + two):
            # More may be kept than there is: MATLAB leaves room.
            kind, content = self._next(parts)
            size = int(_NUMBERS.get(kind, "f8")[1])
            kept_values = self._values(iter([(kind, content)]), "f8", len(content) // size)
            values.append(kept_values[:count])
        if any(part.size != count for part in values):
            raise MatFileError("a sparse matrix has fewer values than places")
        at = rows[:count], np.repeat(np.arange(shape[1]), np.diff(begins))
        full[at] = values[0] + 1j * values[1] if two else values[0]
        return full

    def _characters(self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]]) -> Value:
        """Return the rows of a matrix of characters."""
        kind, content = self._next(parts)
        if kind not in _TEXTS or len(shape) != 2:
            raise MatFileError(f"text is of kind {kind} and has {len(shape)} dimensions")
        codec = _TEXTS[kind]
        if codec in ("utf-16", "utf-32"):
            codec += "-le" if self.order == "<" else "-be"
        text = bytes(content).decode(codec, "replace")
        if shape[0] == 1:
            return np.array([text])
        if len(text) != prod(shape):
            raise MatFileError(f"text of {shape[0]} by {shape[1]} has {len(text)} characters")
        return np.array(["".join(text[i :: shape[0]]) for i in range(shape[0])], dtype=np.str_)

    def _cells(
        self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], room: int, depth: int
    ) -> Value:
        _check_room(prod(shape), room)
        cells = np.empty(prod(shape), dtype=object)
        for i in range(cells.size):
            cells[i] = self._inner(parts, depth)
        return cells.reshape(shape, order="F")

    def _struct(
        self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], room: int, depth: int
    ) -> Value:
        lengths = self._integers(parts, "i4")
        kind, content = self._next(parts)
        if len(lengths) != 1 or lengths[0] < 1 or kind not in (1, 2) or len(content) % lengths[0]:
            raise MatFileError("the names of the fields of a struct are torn")
        width = lengths[0]
        names = [_word(bytes(content[i : i + width])) for i in range(0, len(content), width)]
        if not all(names) or len(set(names)) < len(names):
            raise MatFileError("fields of a struct have no name, or one that is listed twice")
        count = prod(shape)
        _check_room(count * max(1, len(names)), room)
        made = np.empty(count, dtype=[(name, object) for name in names])
        for i in range(count):
            for name in names:
                made[name][i] = self._inner(parts, depth)
        return made.reshape(shape, order="F")

    def _inner(self, parts: Iterator[tuple[int, memoryview]], depth: int) -> Value:
        kind, content = self._next(parts)
        if kind != _MATRIX:
            raise MatFileError(f"an entry of a cell or a struct is of kind {kind}, no array")
        return self.array(content, depth + 1)[1]


def _check_room(count: int, room: int) -> None:
    """Refuse more entries than there can be: each has a tag of eight bytes."""
    if 8 * count > room:
        raise MatFileError(f"{count} entries are said to be in {room} bytes")


def _word(name: bytes) -> str:
    """Return a name, which ends at its first NUL."""
    return name.split(b"\0", 1)[0].decode("latin-1")
