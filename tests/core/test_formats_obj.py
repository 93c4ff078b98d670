"""Triangle meshes from OBJ files, tables of shape harmonics, and what is wrong with bad ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.formats.obj import read_obj
from hillsphere.formats.shape_harmonics import read_shape_harmonics

TETRAHEDRON = """# four corners
mtllib none.mtl
o body
v 0 0 0 1.0
v 1.0 0 0
v 0 1e0 0   # a corner
v 0 0 1.D0
vn 0 0 1
s off
f 1 3 2
f 1/1 2/2/1 4//1
f -4 -1 -2
f 2 3 4
"""


def test_a_tetrahedron(tmp_path: Path) -> None:
    path = tmp_path / "body.obj"
    path.write_text(TETRAHEDRON)
    vertices, faces = read_obj(path)
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(faces, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    (tmp_path / "windows.obj").write_text(TETRAHEDRON.replace("\n", "\r\n"), newline="")
    np.testing.assert_array_equal(read_obj(tmp_path / "windows.obj")[1], faces)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("f 2 3 4", "f 2 3 4 1 2", r":13: faces must be triangles or quadrangles, got 5"),
        ("f 2 3 4", "f 2 3 5", r":13: a face names vertex 5, but only 4 precede it"),
        ("f 2 3 4", "f 0 3 4", r"names vertex 0"),
        ("f -4 -1 -2", "f -5 -1 -2", r"names vertex -5"),
        ("f 2 3 4", "f 2 x 4", r"vertex of a face: expected an integer"),
        ("v 1.0 0 0", "v 1.0 0", r":5: a vertex has three coordinates, got 2"),
        ("v 1.0 0 0", "v nan 0 0", r"expected a finite number, got 'nan'"),
        ("s off", "<html>", r":9: expected 'v x y z' or 'f i j k', got '<html>'"),
        (TETRAHEDRON[TETRAHEDRON.index("f 1") :], "", r"no face"),
    ],
)
def test_bad_meshes_name_the_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "bad.obj"
    path.write_text(TETRAHEDRON.replace(old, new))
    with pytest.raises(InputError, match=message):
        read_obj(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_obj(tmp_path / "absent.obj")


def test_shape_harmonics(tmp_path: Path) -> None:
    path = tmp_path / "shape.tab"
    path.write_text(
        "# n m C S\n  0   0  7.3E+03  0.0\n 1 0 -119.4 0.0\n 2, 0, -1.09D3, 0\n 2 2 9 8\n"
    )
    rows = read_shape_harmonics(path)
    assert [row[:4] for row in rows] == [
        (0, 0, 7300.0, 0.0), (1, 0, -119.4, 0.0), (2, 0, -1090.0, 0.0), (2, 2, 9.0, 8.0),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 7 0\n3 0 1 0\n", "no row of degree 2"),
        ("0 0 7 0\n2 3 1 0\n", "order m must be ≤ degree n"),
        ("0 0 7 0\n1 0 1\n", "got 3 columns"),
        ("0 0 7 0\n1 0 1 0\n1 0 2 0\n", ":3: degree 1, order 0 is already given in line 2"),
        ("1 0 1 0\n", "no row '0 0 C 0'"),
        ("", "no row '0 0 C 0'"),
    ],
)
def test_bad_shape_harmonics(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "shape.tab"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_shape_harmonics(path)


def test_lines_and_points_are_passed_over(tmp_path: Path) -> None:
    """The format's elements of a wireframe, its groups and display attributes are no surface."""
    path = tmp_path / "body.obj"
    path.write_text(TETRAHEDRON)
    expected = read_obj(path)
    path.write_text("g a\n" + TETRAHEDRON + "l 1 2 3\np 1\nmg off\nlod 1\ng b\n")
    for one, other in zip(read_obj(path), expected, strict=True):
        np.testing.assert_array_equal(one, other)
    path.write_text(TETRAHEDRON + "curv 0 1 1 2\n")
    with pytest.raises(InputError, match="got 'curv'"):
        read_obj(path)
