"""Safe opening of regular files that another user may have written.

A path in a mission, a run directory or on the command line may lead to a FIFO, whose opening waits
for a writer for ever, or to a device, whose opening can have effects. `open_regular` refuses both
before it opens anything, and checks the open file once more, since the name may have been given to
another file meanwhile. The framework and its plugins read files through this module only.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

__all__ = [
    "MAX_FILE_BYTES",
    "MAX_TEXT_BYTES",
    "NotRegularError",
    "check_regular",
    "open_regular",
    "read_bytes",
    "read_text",
]

MAX_FILE_BYTES = 16 << 30
"""Most bytes of any file. The largest in use, an ephemeris over 30,000 years, has 3 GB, and the
table of a campaign of a million cases 8 GB. A sparse file, which costs its maker nothing, could
otherwise keep a reader busy for ever."""

MAX_TEXT_BYTES = 512 << 20
"""Most bytes of a text file of data. The largest in use, a gravity field to degree and order 2190,
has 250 MB; twice that still fits into the memory of a small machine."""


class NotRegularError(OSError):
    """A path leads to a FIFO, a socket, a device or a link that may not be followed."""


_KINDS = (
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISLNK, "a link"),
)


def open_regular(
    path: str | os.PathLike[str], max_bytes: int = MAX_FILE_BYTES, *, follow_links: bool = True
) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path : str or path
        The file.
    max_bytes : int
        Largest size that is accepted.
    follow_links : bool
        Whether `path` itself may be a symbolic link.

    Returns
    -------
    BinaryIO
        At the beginning of the file.

    Raises
    ------
    NotRegularError
        If the path leads to a FIFO, a socket, a device or a link that may not be followed, none of
        which is opened.
    OSError
        If it cannot be opened. Its `strerror` completes the sentence "cannot be read: ". ``EINVAL``
        if the path holds a null character, ``EISDIR`` if it leads to a directory, ``EFBIG`` if the
        file is larger than `max_bytes`.
    """
    name = os.fspath(path)
    try:
        status = os.stat(name, follow_symlinks=follow_links)
    except ValueError as error:  # a null character in the path
        raise OSError(errno.EINVAL, str(error), name) from error
    check_regular(status, name)
    # The name may lead to something else by now: O_NONBLOCK keeps the opening of a FIFO from
    # waiting, and O_NOCTTY a terminal from becoming that of this process.
    flags = os.O_RDONLY | os.O_CLOEXEC if os.name != "nt" else os.O_RDONLY | os.O_BINARY  # type: ignore[attr-defined,unused-ignore]
    flags |= getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
    if not follow_links:
        flags |= getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(name, flags)
    try:
        opened = os.fstat(descriptor)
        check_regular(opened, name)
        if opened.st_size > max_bytes:
            raise OSError(errno.EFBIG, f"it is larger than {_size(max_bytes)}", name)
    except BaseException:
        os.close(descriptor)
        raise
    # Outside the block: interrupted at its end, it has closed the file already, and a second
    # closing would be an error in place of the interrupt.
    return os.fdopen(descriptor, "rb")


def check_regular(status: os.stat_result, name: str) -> None:
    """Raise the `OSError` of `open_regular` unless the status is that of a regular file."""
    if stat.S_ISREG(status.st_mode):
        return
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), name)
    kind = next((what for test, what in _KINDS if test(status.st_mode)), "of an unknown kind")
    raise NotRegularError(errno.EINVAL, f"it is {kind}, not a regular file", name)


def read_bytes(path: str | os.PathLike[str], max_bytes: int, *, follow_links: bool = True) -> bytes:
    """Return the content of a regular file; arguments and errors as for `open_regular`."""
    blocks, count = [], 0
    with open_regular(path, max_bytes, follow_links=follow_links) as stream:
        # The whole file is one block, unless it grows: joined blocks would need twice the memory.
        size = os.fstat(stream.fileno()).st_size
        while block := stream.read(max(size + 1, 1 << 20)):
            blocks.append(block)
            count += len(block)
            if count > max_bytes:  # it has grown since it was opened
                raise OSError(errno.EFBIG, f"it is larger than {_size(max_bytes)}", str(path))
    return blocks[0] if len(blocks) == 1 else b"".join(blocks)


def read_text(
    path: str | os.PathLike[str], encoding: str = "utf-8", max_bytes: int = MAX_TEXT_BYTES
) -> str:
    """Return the text of a regular file, its lines ending with a line feed.

    Parameters
    ----------
    path, max_bytes
        As for `open_regular`.
    encoding : str
        Encoding of the text.

    Raises
    ------
    OSError
        See `open_regular`.
    UnicodeDecodeError
        If it is no text of that encoding.
    """
    text = read_bytes(Path(path), max_bytes).decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _size(count: int) -> str:
    return f"{count >> 20} MiB" if count >> 20 else f"{count} bytes"
