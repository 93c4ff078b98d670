"""Atomic writing of files: to a temporary file in the same directory, which is then renamed.

A rename replaces any existing entry. A device or a FIFO is therefore refused, and a link that the
user has named is followed; otherwise the new file would replace them.
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
"""Ending of a temporary file; a crash can leave one behind."""


def output_place(path: Path) -> Path:
    """Return the path at which a file that the user has named is written, with links followed.

    Parameters
    ----------
    path : Path
        The name; the file need not exist yet.

    Raises
    ------
    OSError
        If the path leads to a device, a FIFO, a socket, a directory or a circle of links. Nothing
        is opened. Its `strerror` names the kind.
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
    """Open a temporary file that is renamed to `path` if the block ends without an error.

    Parameters
    ----------
    path : Path
        Final path; its directory must exist.
    follow_links : bool
        Whether a link at `path` is followed, as for a file that the user has named; otherwise the
        file replaces the link.
    mode : int, optional
        Permissions of the file, independent of the umask, e.g. ``0o600``; by default those of any
        new file.

    Yields
    ------
    BinaryIO
        The temporary file. It is flushed to the disk before the rename, so that a crash leaves the
        old content or none, never a part of the new one.

    Raises
    ------
    OSError
        If writing fails, or `path` is neither a regular file nor a link. The temporary file is
        removed and `path` stays as it was.
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
    """Write a whole file, or leave the old one unchanged; see `replacing`."""
    with replacing(path, follow_links=follow_links) as stream:
        stream.write(data)


def write_text(path: Path, text: str, *, follow_links: bool = False) -> None:
    """Write a whole UTF-8 file, or leave the old one unchanged; see `replacing`.

    A lone surrogate (from an undecodable file name in a message) is written as an escape.
    """
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"), follow_links=follow_links)
