"""Check of kernels before SPICE reads them.

SPICE chooses by a file's first bytes how to read it. A text kernel may be a meta-kernel, which
names further files for SPICE to load, so that a mission would read other paths than it names. Where
states are read, only the binary kernels that the framework uses are accepted; text kernels with
names, frames and orientations are where they are asked for, and none that names files.

References
----------
.. [1] NAIF, "Double Precision Array Files (DAF) Required Reading": the file record, the summary
   records and their links.
.. [2] NAIF, "Kernel Required Reading": what a meta-kernel names.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import open_regular

__all__ = ["checked_kernel", "checked_text_kernel", "is_text_kernel"]

_WORDS = (b"DAF/SPK ", b"NAIF/DAF")
"""Accepted first eight bytes. ``DAF/SPK`` is a table of states over time, the only kind that is
needed. ``NAIF/DAF`` is its form before 1993, in which JPL still distributes DE421; its summaries
identify it. Refused are text kernels (``KPL/``), which may name other files; ``DAF/PCK``,
``DAF/CK`` and ``DAS/`` (attitudes, shapes, events), which are not used; and transfer files
(``DAFETF``), which are text."""

_RECORD = 1024
"""Length of a record of a DAF in bytes [1]_."""

_LARGEST_TEXT = 50_000_000
"""Bytes of a text kernel at most: the largest of NAIF, of orientations and names, have 1 MB."""

_SPK_FORMAT = (2, 6)
"""Doubles and integers in a summary of an SPK [1]_: the span; body, centre, frame, type, places."""


@contextmanager
def checked_kernel(path: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Check a kernel, and yield a name by which another process reads the same file.

    Parameters
    ----------
    path : str
        The kernel.

    Yields
    ------
    str
        On Linux a name of the checked file itself, even if `path` leads to another file meanwhile;
        elsewhere `path`.
    tuple of int
        Descriptors that the process must inherit for the name to be valid.

    Raises
    ------
    InputError
        If it cannot be read, is not a regular file or not a binary SPK kernel, or its records form
        a circle or lead out of the file, which would make SPICE loop for ever.
    """
    name = Path(path).name
    try:
        with open_regular(path) as stream:
            word = stream.read(8)
            if word not in _WORDS:
                raise InputError(
                    f"{name!r} is no binary SPK kernel: it begins with {word!r}, not with "
                    "b'DAF/SPK '; text kernels and meta-kernels, which name other files, are not "
                    "read: name the .bsp file itself"
                )
            if fault := _structure_fault(stream):
                raise InputError(f"{name!r} is a damaged SPK kernel: {fault}")
            held = f"/proc/self/fd/{stream.fileno()}"
            yield (held, (stream.fileno(),)) if os.path.exists(held) else (path, ())
    except OSError as error:
        raise InputError(
            f"{name!r} cannot be read as a SPICE kernel: {error.strerror or error}"
        ) from error


def is_text_kernel(path: str) -> bool:
    """Return whether a file begins as a text kernel; `False` if it cannot be read."""
    try:
        with open_regular(path) as stream:
            return stream.read(4) == b"KPL/"
    except OSError:
        return False


@contextmanager
def checked_text_kernel(path: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Check a text kernel; arguments and results as those of `checked_kernel`.

    Raises
    ------
    InputError
        If it cannot be read, is no regular file, no text kernel, or a meta-kernel.
    """
    name = Path(path).name
    try:
        with open_regular(path, _LARGEST_TEXT) as stream:
            content = stream.read()
            if not content.startswith(b"KPL/"):
                raise InputError(
                    f"{name!r} is no text kernel: it begins with {content[:8]!r}, not with b'KPL/'"
                )
            if b"KERNELS_TO_LOAD" in content.upper():
                raise InputError(
                    f"{name!r} is a meta-kernel, which names other files; name those themselves"
                )
            held = f"/proc/self/fd/{stream.fileno()}"
            yield (held, (stream.fileno(),)) if os.path.exists(held) else (path, ())
    except OSError as error:
        raise InputError(
            f"{name!r} cannot be read as a SPICE kernel: {error.strerror or error}"
        ) from error


def _structure_fault(stream: BinaryIO) -> str:
    """Follow the summary records as SPICE does, and return a fault of their links, if any."""
    size = os.fstat(stream.fileno()).st_size
    stream.seek(0)
    first = stream.read(_RECORD)
    if len(first) < _RECORD:
        return "it has no file record"
    # Bytes 88 to 95 give the byte order. Files before 1993 lack it; the order is then the one in
    # which the sizes of the summary are those of an SPK.
    orders = {b"LTL-IEEE": "<", b"BIG-IEEE": ">"}
    order = orders.get(first[88:96]) or next(
        (o for o in "<>" if struct.unpack(f"{o}2i", first[8:16]) == _SPK_FORMAT), ""
    )
    if not order or struct.unpack(f"{order}2i", first[8:16]) != _SPK_FORMAT:
        return "its summaries are not those of an SPK"
    record = struct.unpack(f"{order}i", first[76:80])[0]
    visited = set()
    words = size // 8
    while record:
        if record in visited:
            return f"its summary records form a circle at record {record}"
        if not 1 < record <= size // _RECORD:
            return f"a summary record is said to be number {record} of {size // _RECORD}"
        visited.add(record)
        stream.seek((record - 1) * _RECORD)
        content = stream.read(_RECORD)
        following, _, count = struct.unpack(f"{order}3d", content[:24])
        # A record has 125 further doubles; a summary of two doubles and six integers takes 5.
        if not (0 <= count <= 25 and count == int(count)):
            return f"record {record} claims {count:g} summaries"
        for i in range(int(count)):
            start, end = struct.unpack(f"{order}2i", content[24 + 40 * i + 32 : 24 + 40 * i + 40])
            if not 1 <= start <= end <= words:
                return f"record {record} has an array from {start} to {end} of {words} numbers"
        if not (0 <= following <= size and following == int(following)):
            return f"record {record} leads to record {following:g}"
        record = int(following)
    return ""
