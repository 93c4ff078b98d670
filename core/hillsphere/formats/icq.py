"""Meshes as implicitly connected quadrilaterals (ICQ): the six faces of a cube, drawn on a body.

References
----------
.. [1] R. W. Gaskell et al. (2008), Characterizing and navigating small bodies with imaging data,
   Meteoritics & Planetary Science 43, 1049-1061 (the shape models in this format).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.formats.bulk import parse_table
from hillsphere.formats.coefficients import LineReader

__all__ = ["is_icq", "read_icq"]

_FACES = 6
"""Faces of the cube."""
_MOST = 4096
"""Most squares along an edge: 100 million vertices, more than a file of `MAX_TEXT_BYTES` holds."""


def is_icq(path: str | Path) -> bool:
    """Return whether a file has one number q in its first line, then 6 (q + 1)² rows and no more.

    A plate model of q vertices has as many rows of these, and further ones of plates: a closed one
    3 q − 3 altogether, which is never that number.
    """
    rows = LineReader(Path(path)).rows()
    words = next(rows, "").split()
    if len(words) != 1 or not words[0].isdecimal() or not 0 < int(words[0]) <= _MOST:
        return False
    return sum(1 for _ in rows) == _FACES * (int(words[0]) + 1) ** 2


def read_icq(path: str | Path) -> tuple[Array, Integers]:
    """Read a mesh of implicitly connected quadrilaterals.

    Parameters
    ----------
    path : str or Path
        The file, one that `is_icq` recognises: after q the vertices ``x y z`` of the six faces, on
        each (q + 1)² in rows [1]_. The edges of the cube are listed twice and its corners three
        times; vertices of equal coordinates are made one. Each quadrilateral is split from its
        first corner to its third, and all triangles are turned to look outward.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file, which the format does not state; 6 q² + 2 if the edges agree.
    faces : ndarray of int, shape (12 q², 3)
        Rows of `vertices`, counted from 0.

    Raises
    ------
    InputError
        If a row has not three finite numbers. The message names file and line.
    """
    lines = LineReader(Path(path))
    rows = lines.rows()
    q = int(next(rows))
    points = parse_table(rows, np.dtype([(name, "f8") for name in "xyz"]))
    if points is None:
        for line in lines:
            words = line.partition("#")[0].replace(",", " ").split()
            for word in words:
                lines.real(word, "coordinate")
            if len(words) not in (0, 1, 3):
                raise lines.fault(f"expected a vertex of 3 columns, got {len(words)}")
        raise lines.fault("expected vertices of 3 columns", line=0)
    listed = np.stack([points[name] for name in "xyz"], axis=1) + 0.0  # −0 + 0 is 0
    equal, first, group = np.unique(listed, axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(equal), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(equal))  # in the order of the file
    grid = rank[group.reshape(-1)].reshape(_FACES, q + 1, q + 1)
    a, b, c, d = grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    vertices = listed[np.sort(first)]
    corners = vertices[faces]
    six_volumes = np.einsum("fk,fk->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return vertices, faces if six_volumes.sum() > 0.0 else faces[:, ::-1]
