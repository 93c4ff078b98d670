"""Common parts of readers of spherical-harmonic coefficients."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Literal, NamedTuple

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text

__all__ = ["Coefficient", "CoefficientTable", "LineReader"]

# Each character can belong to one part only: of a long row of digits nothing is tried twice.
_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?", re.ASCII)
_INTEGER = re.compile(r"[0-9]{1,8}")
_COMMENT = re.compile(r"#.*")
_EMPTY_COLUMN = re.compile(r"^[ \t]*,|,[ \t]*,", re.MULTILINE)
_BYTE_ORDER_MARK = "ï»¿"
"""The mark of UTF-8, which editors of Windows write, as it reads in Latin-1."""
_BLOCK = 1 << 22
"""Characters of text that are handled at once: 4 MB, small beside any file whose size matters."""
_COMPRESSED = {"\x1f\x8b": "gzip", "PK\x03\x04": "zip", "BZh": "bzip2", "\xfd7zXZ": "xz"}
"""First characters of compressed files, as they read in Latin-1."""
_MOST_SHOWN = 300
"""Longest part of a line in a message, in characters; a damaged file may be one long line."""


class Coefficient(NamedTuple):
    """One row: degree, order, C, S and their standard deviations (0 where none are given)."""

    n: int
    m: int
    c: float
    s: float
    sigma_c: float = 0.0
    sigma_s: float = 0.0


@dataclass(frozen=True)
class CoefficientTable:
    """A gravity field as given by its file.

    Parameters
    ----------
    name : str
        Name of the model, or of the file if it has none.
    gm_m3_s2 : float
        Gravitational parameter, m³/s².
    reference_radius_m : float
        Radius to which the coefficients refer, m.
    max_degree : int
        Highest degree.
    normalisation : {"full", "none"} or None
        4π-normalised or conventional; None if the file does not say.
    tide_system : str or None
        ``"tide_free"``, ``"zero_tide"``, ``"mean_tide"``, ``"unknown"``; None if the file does not
        say.
    rows : tuple of Coefficient
        In the order of the file, each (n, m) once.
    passed_over : tuple of str
        What else the file states, in words.
    """

    name: str
    gm_m3_s2: float
    reference_radius_m: float
    max_degree: int
    normalisation: Literal["full", "none"] | None
    tide_system: str | None
    rows: tuple[Coefficient, ...]
    passed_over: tuple[str, ...] = field(default=(), compare=False)


class LineReader:
    """Line-by-line reader of a text file, whose errors name file and line.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = 0
        self._first_line: dict[tuple[int, int, Hashable], int] = {}
        try:
            # Comments of older files are in Latin-1; every number is ASCII in either. Not
            # splitlines, which counts bytes of UTF-8 comments (0x85) as ends of line.
            text = read_text(path, "latin-1").removeprefix(_BYTE_ORDER_MARK)
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise InputError(f"{path}: cannot be read: {reason}") from error
        for beginning, program in _COMPRESSED.items():
            if text.startswith(beginning):
                raise InputError(f"{path}: it is compressed by {program}; unpack it first")
        self._text = text
        self._at = 0

    def __iter__(self) -> Iterator[str]:
        self._at = self.number = 0
        while self._at <= len(self._text):
            end = self._text.find("\n", self._at)
            line = self._text[self._at : end if end >= 0 else None]
            # The text is not split as a whole: a list of lines takes three times its memory.
            self._at = end + 1 if end >= 0 else len(self._text) + 1
            self.number += 1
            yield line

    def blocks(self) -> Iterator[str]:
        """Yield what follows the present line in parts of whole lines, which stays the present."""
        at = self._at
        while at < len(self._text):
            end = self._text.rfind("\n", at, at + _BLOCK) + 1
            end = end or self._text.find("\n", at + _BLOCK) + 1 or len(self._text)
            end = len(self._text) if at + _BLOCK >= len(self._text) else end
            yield self._text[at:end]
            at = end

    def rows(self, bare: bool = False) -> Iterator[str]:
        """Yield the lines that follow the present one, without comments, commas and blank lines.

        Before a comma must stand a word: where a column is empty, the comma is left, which no
        parser of numbers takes. In a `bare` table neither ``#`` nor comma has a meaning.
        """
        for block in self.blocks():
            text = _COMMENT.sub("", block) if "#" in block and not bare else block
            if "," in text and not bare and not _EMPTY_COLUMN.search(text):
                text = text.replace(",", " ")
            for line in text.split("\n"):
                if line and not line.isspace():
                    yield line

    def fault(self, text: str, line: int | None = None) -> InputError:
        """Return an error with file and line number, by default of the present line; 0 for none."""
        number = self.number if line is None else line
        text = text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + "…"
        return InputError(f"{self.path}:{number}: {text}" if number else f"{self.path}: {text}")

    def real(self, text: str, what: str, line: int | None = None) -> float:
        """Read a real number; Fortran's D exponents are accepted."""
        if _REAL.fullmatch(text):
            value = float(text.replace("d", "e").replace("D", "e"))
            if isfinite(value):
                return value
        raise self.fault(f"{what}: expected a finite number, got {text!r}", line)

    def positive(self, text: str, what: str, line: int | None = None) -> float:
        """Read a real number > 0."""
        value = self.real(text, what, line)
        if value <= 0.0:
            raise self.fault(f"{what}: must be > 0, got {text}", line)
        return value

    def integer(self, text: str, what: str, line: int | None = None) -> int:
        """Read an integer ≥ 0."""
        if not _INTEGER.fullmatch(text):
            raise self.fault(f"{what}: expected an integer ≥ 0, got {text!r}", line)
        return int(text)

    def coefficient(
        self, words: list[str], max_degree: int, series: Hashable = None
    ) -> Coefficient:
        """Read the columns n, m, C, S and, if they are there, the two standard deviations.

        Each degree and order may stand once in a `series`, as a file with several of them has.
        """
        if len(words) < 4:
            raise self.fault(f"expected degree, order, C and S, got {len(words)} columns")
        n, m = self.integer(words[0], "degree"), self.integer(words[1], "order")
        if n > max_degree:
            raise self.fault(f"degree {n} is beyond the {max_degree} of the head")
        if m > n:
            raise self.fault(f"order m must be ≤ degree n, got n = {n}, m = {m}")
        earlier = self._first_line.setdefault((n, m, series), self.number)
        if earlier != self.number:
            raise self.fault(f"degree {n}, order {m} is already given in line {earlier}")
        row = Coefficient(
            n, m, *(self.real(w, k) for w, k in zip(words[2:6], _COLUMNS, strict=False))
        )
        if m == 0 and row.s != 0.0:
            raise self.fault(f"S of order 0 multiplies sin 0 and must be 0, got {words[3]}")
        return row

    def check_degrees(self, degrees: Iterable[int], max_degree: int) -> None:
        """Refuse a table in which a whole degree from 2 up is missing: a torn or wrong file."""
        degrees = set(degrees)
        if missing := [n for n in range(2, max_degree + 1) if n not in degrees]:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise self.fault(
                f"no row of degree {missing[0]}{more}; the head says {max_degree}", line=0
            )


_COLUMNS = ("C", "S", "sigma C", "sigma S")
