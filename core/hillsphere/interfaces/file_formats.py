"""A file format that `hillsphere convert` reads or writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

__all__ = ["FileFormat"]


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
