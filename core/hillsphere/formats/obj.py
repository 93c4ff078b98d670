"""Triangle meshes in the Wavefront OBJ format: vertices ``v x y z`` and faces ``f i j k``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.formats.bulk import parse_table
from hillsphere.formats.coefficients import LineReader

__all__ = ["read_obj"]

_COMMENT = re.compile(r"#.*")
_TEXTURE = re.compile(r"(?<=\d)/\S*")
"""Texture and normal of a corner, which are not used."""
_IGNORED = (
    "vn", "vt", "vp", "l", "p", "o", "g", "s", "mg", "usemtl", "mtllib", "usemap", "maplib",
    "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj",
)  # fmt: skip
"""Keywords that are ignored, since they do not affect the surface: among them lines and points."""


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
    if (parsed := _parse_triangles(lines)) is not None:
        return parsed
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


def _parse_triangles(lines: LineReader) -> tuple[Array, Integers] | None:
    """Return vertices and faces of a sound file of triangles that are counted from 1, else None."""
    vertices: list[Array] = []
    faces: list[Integers] = []
    known = 0
    for block in lines.blocks():
        text = _COMMENT.sub("", block) if "#" in block else block
        text = _TEXTURE.sub("", text) if "/" in text else text
        rows = [row for row in (line.lstrip() for line in text.split("\n")) if row]
        corners = [row for row in rows if row.startswith("v ")]
        triangles = [row for row in rows if row.startswith("f ")]
        if len(corners) + len(triangles) < len(rows) and not all(
            row.split(maxsplit=1)[0] in (*_IGNORED, "v", "f") for row in rows
        ):
            return None
        if any(row[:2] in ("v\t", "f\t") for row in rows):
            return None
        # Each face may name the vertices that precede it.
        preceding: Integers | int = known + len(corners)
        if corners and triangles:
            is_corner = np.array([row.startswith("v ") for row in rows])
            is_triangle = np.array([row.startswith("f ") for row in rows])
            preceding = (known + np.cumsum(is_corner))[is_triangle]
        if corners:
            part = parse_table(corners, np.dtype("f8"), columns=(1, 2, 3))
            if part is None:
                return None
            vertices.append(np.asarray(part, dtype=float).reshape(-1, 3))
        if triangles:
            part = parse_table((row[1:] for row in triangles), np.dtype("i8"))
            if part is None or part.size != 3 * len(triangles):
                return None
            numbers: Integers = np.asarray(part, dtype=np.int64).reshape(-1, 3)
            if numbers.min() < 1 or (numbers.max(axis=1) > preceding).any():
                return None
            faces.append(numbers - 1)
        known += len(corners)
    if not faces:
        return None
    return np.concatenate(vertices), np.concatenate(faces)


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
