"""Meshes in the formats STL and PLY, text and binary, read by trimesh (the extra ``mesh``).

References
----------
.. [1] Dawson-Haggerty, M., et al., trimesh, https://trimesh.org (MIT licence).
"""

from __future__ import annotations

import importlib.util
import re
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import MAX_FILE_BYTES, read_bytes

__all__ = ["MESH_SUFFIXES", "read_mesh_file"]

MESH_SUFFIXES = (".stl", ".ply")
"""Suffixes of the files that `read_mesh_file` reads."""
_HEADER, _FACET = 84, 50
"""Bytes of a binary STL before its facets, and of each."""
_NUMBER = rb"[ \t]+[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_VERTEX = re.compile(rb"vertex" + 3 * _NUMBER + rb"\s*", re.IGNORECASE)
_STL_WORDS = re.compile(rb"(?:solid|endsolid|facet|endfacet|outer|endloop|vertex)\b", re.IGNORECASE)


def read_mesh_file(path: str | Path) -> tuple[Array, Integers]:
    """Read a mesh from an STL or PLY file.

    Parameters
    ----------
    path : str or Path
        The file, whose suffix says its format. Faces of more than three corners, which PLY allows,
        are divided into triangles that have the first corner in common.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the unit of the file, which neither format states. STL lists the corners of each facet
        anew, so that V is three times the number of facets.
    faces : ndarray of int, shape (F, 3)
        Rows of `vertices`, counted from 0.

    Raises
    ------
    InputError
        If trimesh is not installed, or the file is malformed or torn. The message names the file.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if importlib.util.find_spec("trimesh") is None:
        raise InputError(
            f"{path}: {kind.upper()} files are read by trimesh, which is not installed: "
            "pip install 'hillsphere[mesh]'"
        )
    try:
        content = read_bytes(path, MAX_FILE_BYTES)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{path}: cannot be read: {reason}") from error
    if kind == "stl":
        expected = _count_facets(path, content)
    else:
        content = _check_ply(path, content)
    import trimesh

    with warnings.catch_warnings():
        # numpy warns of a word that is no number, and goes on without the rest of the line
        warnings.simplefilter("error")
        try:
            loaded: Any = trimesh.load_mesh(
                BytesIO(content), file_type=kind, process=False, validate=False,
                fix_texture=False, skip_materials=True,
            )  # fmt: skip
            vertices = np.array(loaded.vertices, dtype=float).reshape(-1, 3)
            faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64).reshape(-1, 3)
            raw = loaded.metadata.get("_ply_raw", {})
        except MemoryError:
            raise
        except Exception as error:
            said = " ".join(str(error).split())[:_MOST_SHOWN] or type(error).__name__
            if "unexpected length" in said:
                said = (
                    "its length does not fit its head: it is torn, or its faces have different "
                    "numbers of corners, which are read from a text file only"
                )
            raise InputError(f"{path}: no readable {kind.upper()} file: {said}") from error
    if kind == "stl" and len(faces) != expected:
        raise InputError(f"{path}: it has {expected} facets, of which {len(faces)} could be read")
    for name, count in (("vertex", len(vertices)), ("face", None)):
        _check_element(path, raw.get(name), name, count)
    if not len(faces):
        raise InputError(f"{path}: no faces")
    if not np.isfinite(vertices).all():
        raise InputError(f"{path}: coordinates must be finite numbers")
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = faces.min() if faces.min() < 0 else faces.max()
        raise InputError(
            f"{path}: a face names vertex {wrong}, but they are counted from 0 to "
            f"{len(vertices) - 1}"
        )
    return vertices, faces


_MOST_SHOWN = 200
"""Longest part of a message of trimesh that is passed on, in characters."""


def _count_facets(path: Path, content: bytes) -> int:
    """Return the number of facets of an STL file, whose structure trimesh does not check."""
    stated = int.from_bytes(content[80:_HEADER], "little")
    if len(content) >= _HEADER and len(content) == _HEADER + _FACET * stated:
        return stated
    if not content.lstrip()[:5].lower() == b"solid" or b"\0" in content:
        raise InputError(
            f"{path}: no STL file: a text begins with 'solid', and a binary file of {stated} "
            f"facets has {_HEADER + _FACET * stated} bytes, not {len(content)}"
        )
    facets = corners = 0
    for number, line in enumerate(content.replace(b"\r\n", b"\n").split(b"\n"), start=1):
        line = line.strip()
        word = _STL_WORDS.match(line)
        if word is None:
            if line:
                raise InputError(f"{path}:{number}: expected a line of an STL file")
        elif word.group().lower() == b"vertex":
            corners += 1
            if not _VERTEX.fullmatch(line):
                raise InputError(f"{path}:{number}: expected 'vertex x y z'")
        elif word.group().lower() == b"facet":
            if corners != 3 * facets:
                raise InputError(f"{path}:{number}: the facet before has not three corners")
            facets += 1
    if corners != 3 * facets:
        raise InputError(f"{path}: {facets} facets have {corners} corners; each must have three")
    if not content.rstrip().split(b"\n")[-1].strip().lower().startswith(b"endsolid"):
        raise InputError(f"{path}: no line 'endsolid' at the end: the file is torn")
    return facets


def _check_ply(path: Path, content: bytes) -> bytes:
    """Return the content with the ends of lines that trimesh expects, if its head is complete."""
    if not content.startswith(b"ply"):
        raise InputError(f"{path}: no PLY file: it must begin with 'ply'")
    head, end, body = content.partition(b"end_header")
    if not end:
        raise InputError(f"{path}: the head has no line 'end_header'")
    words = head.split()
    if b"ascii" in words and b"list" in words:
        # An index such as 1.5 would be cut to 1.
        lines = [line for line in body.splitlines() if line.strip()]
        count = words[words.index(b"vertex") + 1] if b"vertex" in words else b"0"
        first = int(count) if count.isdigit() else 0
        is_simple = head.count(b"element") == 2 and head.count(b"property list") == 1
        if is_simple and head.find(b"face") > head.find(b"vertex"):
            lists = head[head.find(b"element face") :].count(b"property")
            for line in lines[first:] if lists == 1 else ():
                if not all(word.lstrip(b"-").isdigit() for word in line.split()):
                    shown = line.decode("latin-1")[:_MOST_SHOWN]
                    raise InputError(
                        f"{path}: a face must name its vertices by integers: {shown!r}"
                    )
    return content


def _check_element(path: Path, element: Any, name: str, count: int | None) -> None:
    """Refuse a PLY file that has fewer rows than its head says, or lists that are read wrongly."""
    if element is None:
        return
    data = element.get("data")
    if isinstance(data, dict):
        lengths = {len(column) for column in data.values()}
    else:
        lengths = {0 if data is None else len(data)}
        names = getattr(getattr(data, "dtype", None), "names", None) or ()
        for column in names:
            fields = data.dtype[column].names or ()
            # Binary lists are read with the length of the first.
            if (
                fields
                and len(data)
                and (data[column][fields[0]] != data[column][fields[0]][0]).any()
            ):
                raise InputError(
                    f"{path}: lists of different lengths in a binary file are not read; "
                    "triangulate the mesh, or save it as text"
                )
    if count is not None:
        lengths.add(count)
    if lengths != {element["length"]}:
        raise InputError(
            f"{path}: the head states {element['length']} rows of '{name}', got {min(lengths)}"
        )
