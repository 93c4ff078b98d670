"""Files that are either complete or absent: written beside their place, then renamed into it.

A rename puts the new file in the place of whatever stands there. A device or a FIFO is therefore
refused, and a link that the user has named is followed, lest either be replaced by a file.
"""

from __future__ import annotations

import errno
import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISLNK
from typing import BinaryIO

from hillsphere.base.regular_files import check_regular

__all__ = ["PART_SUFFIX", "output_place", "replacing", "write_bytes", "write_text"]

PART_SUFFIX = ".part"
"""Ending of a file that is still being written; one that stays behind is the trace of a crash."""


def output_place(path: Path) -> Path:
    """Return where a file that the user has named is to be written: links are followed.

    Parameters
    ----------
    path : Path
        The name; there need be no such file yet.

    Raises
    ------
    OSError
        If something stands there that is no regular file: a device, a FIFO, a socket, a directory
        or a link in a circle. It is not opened. Its `strerror` says which.
    """
    try:
        place = Path(os.path.realpath(path))
    except ValueError as error:  # a null character
        raise OSError(errno.EINVAL, str(error), str(path)) from error
    with suppress(FileNotFoundError):
        check_regular(os.lstat(place), str(place))
    return place


@contextmanager
def replacing(
    path: Path, *, follow_links: bool = False, mode: int | None = None
) -> Iterator[BinaryIO]:
    """Open a file that takes its place only when the block ends without an error.

    Parameters
    ----------
    path : Path
        Final place; its directory exists.
    follow_links : bool
        Whether a link there is followed, as for a file that the user has named; else the file takes
        the place of the link.
    mode : int, optional
        Permissions of the file whatever the umask, ``0o600``; left out: those of a new file.

    Yields
    ------
    BinaryIO
        The part file. It is flushed to the disk before the rename, so that a crash leaves the old
        content, or none, but never half of the new one.

    Raises
    ------
    OSError
        If writing fails, or what stands there is neither a regular file nor a link; the part file
        is removed and what stood at `path` is untouched.
    """
    if follow_links:
        path = output_place(path)
    else:
        with suppress(FileNotFoundError):
            standing = os.lstat(path)
            if not S_ISLNK(standing.st_mode):
                check_regular(standing, str(path))
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART_SUFFIX}")
    try:
        with part.open("xb") as stream:
            if mode is not None and sys.platform != "win32":
                os.fchmod(stream.fileno(), mode)
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, data: bytes, *, follow_links: bool = False) -> None:
    """Write a whole file, or leave what stood there; see `replacing`."""
    with replacing(path, follow_links=follow_links) as stream:
        stream.write(data)


def write_text(path: Path, text: str, *, follow_links: bool = False) -> None:
    """Write a whole UTF-8 file, or leave what stood there; see `replacing`.

    A lone surrogate (from an undecodable file name in a message) is written as an escape.
    """
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"), follow_links=follow_links)
