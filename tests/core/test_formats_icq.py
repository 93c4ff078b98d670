"""Shapes as implicitly connected quadrilaterals: the six faces of a cube."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.formats.plates import read_shape

_AXES = (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, -1), (-1, 0, 0)), ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    ((0, -1, 0), (0, 0, -1), (1, 0, 0)), ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
)  # fmt: skip
"""Of each face of the cube the directions along and across its rows, and its normal."""


def _text(q: int, mirrored: bool = False) -> str:
    """Return a cube of edge 2, whose vertices are exact."""
    along = np.linspace(-1.0, 1.0, q + 1)
    rows = [f"   {q}"]
    for first, second, normal in np.array(_AXES):
        for v in along:
            for u in along:
                x, y, z = normal + u * first + v * second
                rows.append(f" {x:.8f} {y:.8f} {-z if mirrored else z:.8f}")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("q", [1, 2, 8])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", ["cube.icq", "cube.tab"])
def test_a_cube(q: int, mirrored: bool, name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(_text(q, mirrored))
    vertices, faces = read_shape(path)
    # Euler: V = F / 2 + 2 for a closed mesh of triangles
    assert (len(vertices), len(faces)) == (6 * q * q + 2, 12 * q * q)
    shape = create("shape", "polyhedron", file=str(path), length_unit="m")
    assert shape.mesh.volume_m3 == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            (" 1.00000000\n", " nan\n"),
            r"c.icq:\d+: coordinate: expected a finite number, got 'nan'",
        ),
        ((" 1.00000000\n", "\n"), r"c.icq:\d+: expected a vertex of 3 columns, got 2"),
        (("   2\n", "   3\n"), "c.icq"),
    ],
)
def test_faults_are_named(change: tuple[str, str], match: str, tmp_path: Path) -> None:
    path = tmp_path / "c.icq"
    path.write_text(_text(2).replace(*change, 1))
    with pytest.raises(InputError, match=match):
        read_shape(path)


def test_edges_that_do_not_agree_leave_the_mesh_open(tmp_path: Path) -> None:
    path = tmp_path / "c.icq"
    path.write_text(_text(2).replace(" 1.00000000\n", " 1.01000000\n", 1))
    with pytest.raises(InputError, match="the mesh is not closed"):
        create("shape", "polyhedron", file=str(path), length_unit="m")
