"""Plate models of SPICE (DSK segments of type 2 [1]_), read through spiceypy (the extra ``spice``).

References
----------
.. [1] NAIF, "DSK Required Reading": segments of type 2, whose vertices are in km.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import open_regular
from hillsphere.model.spice_calls import run_spice

__all__ = ["read_dsk"]

_LIMIT_S = 180.0
"""Time limit for SPICE, which reads three million plates in a few seconds; a machine under load may
be many times slower. A damaged file can make it loop for ever."""


def read_dsk(path: str | Path, segment: int | None = None) -> tuple[Array, Integers]:
    """Read a plate model from a DSK file, in a process of its own, see `hillsphere.model.spice`.

    Parameters
    ----------
    path : str or Path
        The file.
    segment : int, optional
        Which of several segments, counted from 1; a file of one segment needs none.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        km, in the body-fixed frame of the segment.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0.

    Raises
    ------
    InputError
        If spiceypy is not installed, the file is no DSK file or damaged, the segment is not of type
        2, or there are several and none is chosen.
    """
    try:
        with open_regular(path) as stream:
            word = stream.read(8)
            if word != b"DAS/DSK ":
                raise InputError(f"{path}: no DSK file: it begins with {word!r}, not b'DAS/DSK '")
            held = f"/proc/self/fd/{stream.fileno()}"
            name, descriptors = (
                (held, (stream.fileno(),)) if os.path.exists(held) else (str(path), ())
            )
            answer, content = run_spice(
                "hillsphere.model.shapes.dsk_process", {"file": name, "segment": segment},
                file=str(path), user=f"{path}: a DSK file", limit_s=_LIMIT_S,
                descriptors=descriptors,
            )  # fmt: skip
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if text := answer.get("fault"):
        raise InputError(f"{path}: {text}")
    many = answer["vertices"]
    vertices = np.frombuffer(content[: 24 * many], dtype=float).reshape(-1, 3)
    faces = np.frombuffer(content[24 * many :], dtype=np.int64).reshape(-1, 3) - 1
    if len(vertices) != many or len(faces) != answer["plates"] or not np.isfinite(vertices).all():
        raise InputError(f"{path}: damaged: SPICE gives vertices or plates that are none")
    return vertices.copy(), faces
