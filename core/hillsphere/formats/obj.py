"""Triangle meshes in the Wavefront OBJ format: vertices ``v x y z`` and faces ``f i j k``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.formats.coefficients import LineReader

__all__ = ["read_obj"]

_IGNORED = ("vn", "vt", "vp", "o", "g", "s", "usemtl", "mtllib")
"""Keywords that are ignored, since they do not affect the shape."""


def read_obj(path: str | Path, may_count_from_0: bool = False) -> tuple[Array, Integers]:
    """Read a mesh of triangles, or of triangles and quadrangles.

    Parameters
    ----------
    path : str or Path
        The file. As the format allows, faces may give texture and normal with each vertex
        (``1/2/3``), and count vertices from the end by negative numbers. A face of four corners is
        split from its first corner to its third; where the four do not lie in a plane, the other
        diagonal would give another body.
    may_count_from_0 : bool
        Whether vertices are counted from 0 if a face names vertex 0. The format counts from 1, but
        tables of other origin borrow its rows.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file, which the format does not state.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0, in the order of the file.

    Raises
    ------
    InputError
        If there is an unknown keyword, a malformed number, or a face that has not three or four
        corners or refers to a missing vertex. The message names file and line.
    """
    lines = LineReader(Path(path))
    vertices: list[tuple[float, ...]] = []
    faces: list[tuple[int, ...]] = []
    places: list[int] = []
    relative = False
    for line in lines:
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            # A fourth number is a weight, further ones are colours.
            if len(words) < 4:
                raise lines.fault(f"a vertex has three coordinates, got {len(words) - 1}")
            vertices.append(tuple(lines.real(w, "coordinate") for w in words[1:4]))
        elif words[0] == "f":
            corners = _face(lines, words[1:], len(vertices), may_count_from_0)
            faces.append(corners[:3])
            if len(corners) == 4:
                faces.append((corners[0], *corners[2:]))
            relative |= any(word.startswith("-") for word in words[1:])
            places += [lines.number] * (len(corners) - 2)
        elif words[0] not in _IGNORED:
            raise lines.fault(
                f"expected 'v x y z' or 'f i j k', got {words[0][:20]!r}: is this an OBJ file?"
            )
    if not faces:
        raise lines.fault("no face 'f i j k': is this an OBJ file?", line=0)
    numbers: NDArray[np.int64] = np.array(faces, dtype=np.int64)
    if numbers.min() < 0:  # of a vertex 0: all are counted from there
        if relative:
            raise lines.fault("faces name vertex 0 and count others from the end", line=0)
        numbers += 1
        beyond = (numbers >= len(vertices)).any(axis=1)
        if beyond.any():
            raise lines.fault(
                f"a face names vertex {numbers.max()}, but with a vertex 0 they end at "
                f"{len(vertices) - 1}",
                places[int(np.argmax(beyond))],
            )
    return np.array(vertices), numbers


def _face(lines: LineReader, words: Sequence[str], known: int, may_be_0: bool) -> tuple[int, ...]:
    """Return the vertices of a face, counted from 0 if the file counts from 1: −1 is vertex 0."""
    if len(words) not in (3, 4):
        raise lines.fault(
            f"faces must be triangles or quadrangles, got {len(words)} corners; triangulate it"
        )
    vertices = []
    for word in words:
        text = word.partition("/")[0]
        number = lines.integer(text.removeprefix("-"), "vertex of a face")
        index = known - number if text.startswith("-") else number - 1
        is_0 = may_be_0 and text == "0"
        if not is_0 and not (number and 0 <= index < known):
            raise lines.fault(f"a face names vertex {text}, but only {known} precede it")
        vertices.append(index)
    return tuple(vertices)
