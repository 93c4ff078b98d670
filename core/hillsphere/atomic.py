"""Files that are either complete or absent: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

__all__ = ["PART_SUFFIX", "replacing", "write_bytes", "write_text"]

PART_SUFFIX = ".part"
"""Ending of a file that is still being written; one that stays behind is the trace of a crash."""


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes its place only when the block ends without an error.

    Parameters
    ----------
    path : Path
        Final place; its directory exists.

    Yields
    ------
    BinaryIO
        The part file. It is flushed to the disk before the rename, so that a crash leaves the old
        content, or none, but never half of the new one.

    Raises
    ------
    OSError
        If writing fails; the part file is removed and what stood at `path` is untouched.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART_SUFFIX}")
    try:
        with part.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what stood there."""
    with replacing(path) as stream:
        stream.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a whole UTF-8 file, or leave what stood there.

    A lone surrogate (from an undecodable file name in a message) is written as an escape.
    """
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))
