"""Block structure of an uncertainty: repeated real and complex scalars, full complex blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers

__all__ = ["Block", "BlockStructure", "full", "repeated_complex", "repeated_real"]

Complex = NDArray[np.complex128]
_LARGEST = 1e150
"""Size of an entry whose square is still a number of double precision (1e308)."""
Kind = Literal["real", "complex", "full"]


@dataclass(frozen=True)
class Block:
    """One block of Δ = diag(Δ₁, Δ₂ …).

    Parameters
    ----------
    kind : {"real", "complex", "full"}
        δ I with δ real, δ I with δ complex, or any complex matrix.
    rows, columns : int
        Its size; rows enter M, columns come from it. A repeated scalar is square.
    name : str
        Of the uncertainty.

    Raises
    ------
    InputError
        If there is no such kind, a size is not a positive integer, or a repeated scalar not square.
    """

    kind: Kind
    rows: int
    columns: int
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError(f"no kind of block {self.kind!r}; {', '.join(get_args(Kind))} exist")
        if not all(isinstance(size, Integral) for size in (self.rows, self.columns)):
            raise InputError(f"the size of a block is a whole number, got {self}")
        if self.rows < 1 or self.columns < 1:
            raise InputError(f"a block needs at least one row and column, got {self}")
        if self.kind != "full" and self.rows != self.columns:
            raise InputError(f"a repeated scalar is square, got {self.rows} × {self.columns}")

    def enclosing_square(self) -> Block:
        """Return the smallest square block that contains this one."""
        size = max(self.rows, self.columns)
        return Block(self.kind, size, size, self.name)


def repeated_real(times: int = 1, name: str = "") -> Block:
    """Return the block δ I with a real δ, of `times` rows and columns.

    Parameters
    ----------
    times : int
        Its size.
    name : str
        Name in results.

    Returns
    -------
    Block
        The block.
    """
    return Block("real", times, times, name)


def repeated_complex(times: int = 1, name: str = "") -> Block:
    """Return the block δ I with a complex δ, of `times` rows and columns.

    Parameters
    ----------
    times : int
        Its size.
    name : str
        Name in results.

    Returns
    -------
    Block
        The block.
    """
    return Block("complex", times, times, name)


def full(rows: int, columns: int | None = None, name: str = "") -> Block:
    """Return a full complex block, square if no columns are given.

    Parameters
    ----------
    rows : int
        Rows of Δ: inputs of M that it drives.
    columns : int, optional
        Columns of Δ.
    name : str
        Name in results.

    Returns
    -------
    Block
        The block.
    """
    return Block("full", rows, rows if columns is None else columns, name)


class BlockStructure:
    """Blocks one after the other along the diagonal of Δ.

    Bounds of µ work on a matrix whose blocks are all square: `pad_to_square` adds rows and columns
    of zeros, which change no µ. A full block of one by one is a complex scalar.

    Parameters
    ----------
    blocks : sequence of Block
        At least one; real ones of different names, or without.

    Attributes
    ----------
    blocks : tuple of Block
        As given.
    shape : tuple of int
        Of the matrix M that Δ closes: all columns of Δ by all its rows.
    sizes : ndarray of int, shape (k,)
        Of the squared blocks.
    starts : ndarray of int, shape (k,)
        First index of each squared block.
    size : int
        Of the squared matrix.
    """

    def __init__(self, blocks: Sequence[Block]) -> None:
        if not blocks:
            raise InputError("a block structure needs at least one block")
        self.blocks = tuple(blocks)
        real = [b.name or str(k) for k, b in enumerate(blocks) if b.kind == "real"]
        if len(set(real)) < len(real):
            raise InputError(
                f"real blocks of one name are one, repeated (`repeated_real(2, {real[0]!r})`), got "
                f"{', '.join(real)}"
            )
        self.shape = (sum(b.columns for b in blocks), sum(b.rows for b in blocks))
        self.sizes: Integers = np.array([max(b.rows, b.columns) for b in blocks])
        self.starts: Integers = np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(np.int64)
        self.size = int(self.sizes.sum())
        self._rows = self._places([b.columns for b in self.blocks])
        self._columns = self._places([b.rows for b in self.blocks])

    def _places(self, counts: list[int]) -> Integers:
        return np.concatenate(
            [start + np.arange(count) for start, count in zip(self.starts, counts, strict=True)]
        )

    def spans(self) -> list[slice]:
        """Return the place of each squared block."""
        return [slice(int(a), int(a + b)) for a, b in zip(self.starts, self.sizes, strict=True)]

    def pad_to_square(self, matrix: NDArray[np.inexact[Any]]) -> Complex:
        """Return a matrix (..., p, m) with zeros where a block lacks rows or columns.

        Raises
        ------
        InputError
            If the matrix does not fit the blocks, or is not of finite numbers.
        """
        given = np.asarray(matrix)
        if given.dtype.kind not in "biufc" or not np.isfinite(given).all():
            raise InputError("M must consist of finite numbers")
        if np.abs(given).max(initial=0.0) > _LARGEST:
            raise InputError(f"M must be below {_LARGEST:g} in size: scale its rows and columns")
        if given.shape[-2:] != self.shape:
            raise InputError(
                f"these blocks close a matrix of {self.shape[0]} × {self.shape[1]}, got "
                f"{given.shape[-2]} × {given.shape[-1]}"
            )
        made = np.zeros((*given.shape[:-2], self.size, self.size), dtype=complex)
        made[..., self._rows[:, None], self._columns] = given
        return made

    def places(self) -> tuple[Integers, Integers]:
        """Return the indices of the rows and of the columns of M in the squared matrix."""
        return self._rows, self._columns

    def parts(self) -> list[tuple[slice, slice]]:
        """Return the rows and columns of each block in Δ (m, p), without squaring."""
        rows = np.cumsum([0, *(b.rows for b in self.blocks)]).tolist()
        columns = np.cumsum([0, *(b.columns for b in self.blocks)]).tolist()
        return [
            (slice(rows[k], rows[k + 1]), slice(columns[k], columns[k + 1]))
            for k in range(len(self.blocks))
        ]

    def real_values(self, delta: Complex) -> dict[str, float]:
        """Return the scalars of the real blocks of Δ by their name, or their number without one."""
        return {
            block.name or str(k): float(delta[rows, columns][0, 0].real)
            for k, (block, (rows, columns)) in enumerate(
                zip(self.blocks, self.parts(), strict=True)
            )
            if block.kind == "real"
        }

    def remove_padding(self, delta: Complex) -> Complex:
        """Return Δ (m, p) without the rows and columns that squaring added."""
        return np.asarray(delta[self._columns[:, None], self._rows])

    def indices(self, blocks: Iterable[int]) -> NDArray[np.bool_]:
        """Say which indices of the squared matrix belong to some blocks, (size,).

        Raises
        ------
        InputError
            If there is no such block.
        """
        belong = np.zeros(self.size, dtype=bool)
        spans = self.spans()
        for block in blocks:
            if not 0 <= block < len(spans):
                raise InputError(f"no block {block}; they are numbered 0 to {len(spans) - 1}")
            belong[spans[block]] = True
        return belong

    def scalar(self, block: int) -> bool:
        """Say whether a block is δ I, or one by one."""
        return self.blocks[block].kind != "full" or int(self.sizes[block]) == 1

    def real(self) -> NDArray[np.bool_]:
        """Say which indices of the squared matrix belong to real blocks, (size,)."""
        kinds = np.array([b.kind == "real" for b in self.blocks])
        return np.repeat(kinds, self.sizes)

    @property
    def purely_real(self) -> bool:
        """Whether every block is real."""
        return all(b.kind == "real" for b in self.blocks)

    def perturbation(self, values: Sequence[complex | Array | Complex]) -> Complex:
        """Return the squared Δ of scalars and matrices, one per block."""
        delta = np.zeros((self.size, self.size), dtype=complex)
        for span, block, value in zip(self.spans(), self.blocks, values, strict=True):
            size = span.stop - span.start
            delta[span, span] = value * np.eye(size) if block.kind != "full" else value
        return delta
