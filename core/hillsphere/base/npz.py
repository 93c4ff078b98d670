"""Safe reading of ``.npz`` files from untrusted sources.

A malicious archive can hold members that unpack to a thousand times its size, arrays whose header
claims a terabyte, or Python objects, whose unpickling runs code. `read_arrays` compares the claimed
sizes with the size of the file before it allocates memory, and refuses objects.
"""

from __future__ import annotations

import os
import zipfile
from io import BytesIO
from math import prod
from typing import Any, BinaryIO

import numpy as np

__all__ = ["MAX_UNPACKED_BYTES", "read_arrays"]

MAX_UNPACKED_BYTES = 1 << 30
"""Most bytes that compressed members may unpack to, all together: a hundred times the largest
system (1000 states, 8 MB a matrix) that is of use here."""

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""Accepted versions of an array's header. The third exists for field names outside Latin-1."""


def read_arrays(stream: BinaryIO, *, compressed: bool) -> dict[str, np.ndarray[Any, Any]]:
    """Read the arrays of an archive.

    Parameters
    ----------
    stream : BinaryIO
        An open ``.npz`` file.
    compressed : bool
        Whether members may be compressed; otherwise a compressed one is an error.

    Returns
    -------
    dict of str to ndarray
        Name of the member, without ``.npy``, to its array.

    Raises
    ------
    zipfile.BadZipFile, ValueError, EOFError, LookupError, RuntimeError, NotImplementedError
        If the file is not such an archive, is damaged, claims more than it holds, or has Python
        objects.
    OSError, MemoryError
        If reading fails for another reason; it may succeed later.
    """
    size = os.fstat(stream.fileno()).st_size
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    with zipfile.ZipFile(stream) as archive:
        members = archive.infolist()
        for member in members:
            stored = member.compress_type == zipfile.ZIP_STORED
            if not stored and not (compressed and member.compress_type == zipfile.ZIP_DEFLATED):
                raise ValueError("its entries are compressed in a way that is not read")
        # Together, not one by one: members may lie over each other in the file.
        for is_stored, most in ((True, size), (False, MAX_UNPACKED_BYTES)):
            total = sum(
                m.file_size for m in members if (m.compress_type == zipfile.ZIP_STORED) == is_stored
            )
            if total > most:
                raise zipfile.BadZipFile(
                    f"its members would have {total} bytes, at most {most} can"
                )
        for member in members:
            # A whole member is read at once: only then does zipfile check its CRC.
            name = member.filename.removesuffix(".npy")
            if name in arrays:
                raise zipfile.BadZipFile(f"it has two arrays {name!r}")
            arrays[name] = _array(archive.read(member))
    return arrays


def _array(data: bytes) -> np.ndarray[Any, Any]:
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"an array has a header of version {version}")
    shape, _, dtype = _HEADERS[version](stream)
    # numpy allocates the memory that the header claims before it reads, so that the claim is
    # checked here. Entries without bytes count as one byte each, which bounds their number.
    there = len(data) - stream.tell()
    if min(shape, default=0) < 0 or prod(shape) * max(dtype.itemsize, 1) > there:
        raise ValueError(
            f"an array of shape {shape} and {dtype.itemsize} bytes an entry is cut off"
        )
    stream.seek(0)
    # In C order, see `hillsphere.products.product_codec.canonical`.
    return np.asarray(np.lib.format.read_array(stream, allow_pickle=False), order="C")
