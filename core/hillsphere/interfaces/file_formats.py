"""A file format that `hillsphere convert` reads or writes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.base.time import Epoch

__all__ = ["ElementFormat", "FileFormat", "StatedOrbit"]


class FileFormat(Protocol):
    """Reader and writer of one format.

    Formats with the same `content` share the object that `read` returns first and `write` takes, so
    that each can be converted into every other one.
    """

    content: str
    """What such a file holds, in words: ``"gravity field"``."""
    suffixes: tuple[str, ...]
    """Endings of its files, in small letters; the first one is the usual one."""

    def recognises(self, beginning: str) -> bool:
        """Return whether the first lines of a file are those of this format."""
        ...

    def read(self, path: Path) -> tuple[Any, tuple[str, ...]]:
        """Return the content of a file, and what of the file the content does not hold.

        Raises
        ------
        InputError
            If it cannot be read, or the format is only written.
        """
        ...

    def write(self, content: Any) -> tuple[str, tuple[str, ...]]:
        """Return the text of a file, and what of the content the format cannot hold.

        Raises
        ------
        InputError
            If the content cannot be written in this format at all.
        """
        ...


class StatedOrbit(Protocol):
    """An orbit about the Earth, as a file of elements defines it."""

    @property
    def name(self) -> str:
        """Name of the satellite."""
        ...

    @property
    def catalogue_number(self) -> str:
        """Number of the satellite in the catalogue, without leading zeros."""
        ...

    @property
    def epoch(self) -> Epoch:
        """Epoch of the elements."""
        ...

    @property
    def frame(self) -> str:
        """Inertial axes of the states, ``"teme"`` or ``"gcrs"``."""
        ...

    def states(self, t_s: Array) -> Array:
        """Return osculating states (6, N), m and m/s, at times (N,), s after the epoch.

        Raises
        ------
        PropagationError
            If there is no orbit at one of the times.
        """
        ...


@runtime_checkable
class ElementFormat(FileFormat, Contract, Protocol):
    """A `FileFormat` of elements, each set of which defines an orbit about the Earth."""

    def orbits(self, content: Any) -> Sequence[StatedOrbit]:
        """Return the orbits of the content that `FileFormat.read` returns, in its order."""
        ...
