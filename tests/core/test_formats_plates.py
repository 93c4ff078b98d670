"""Plate models and meshes as one meets them, and what is wrong with bad ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.formats.obj import read_obj
from hillsphere.formats.plates import read_plate_files, read_plates, read_shape

DATA = Path(__file__).parents[1] / "data" / "shapes"
# An octahedron with semi-axes 2, 1.5, 1, of volume 4/3 · 2 · 1.5 · 1 = 4.
VERTICES = [[2, 0, 0], [-2, 0, 0], [0, 1.5, 0], [0, -1.5, 0], [0, 0, 1], [0, 0, -1]]
FACES = [
    [0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4],
    [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5],
]  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [
        "one-count.plt",
        "two-counts.plt",
        "two-counts-mixed.plt",
        "from-zero.plt",
        "rows.tab",
        "rows-from-zero.tab",
    ],
)
def test_an_octahedron(name: str) -> None:
    vertices, faces = read_shape(DATA / name)
    np.testing.assert_array_equal(vertices, VERTICES)
    np.testing.assert_array_equal(faces, FACES)
    shape = create("shape", "polyhedron", file=str(DATA / name), length_unit="km")
    assert shape.mesh.volume_m3 == pytest.approx(4e9, rel=1e-14)
    assert shape.semi_axes_m() == (2000.0, 1500.0, 1000.0)


@pytest.mark.parametrize("corners", ["vertices.txt", "vertices-bare.txt"])
@pytest.mark.parametrize("plates", ["plates.txt", "plates-counted.txt"])
def test_an_octahedron_in_two_files(corners: str, plates: str) -> None:
    vertices, faces = read_plate_files(DATA / corners, DATA / plates)
    np.testing.assert_array_equal(vertices, VERTICES)
    np.testing.assert_array_equal(faces, FACES)
    keys = {"vertices_file": str(DATA / corners), "plates_file": str(DATA / plates)}
    shape = create("shape", "polyhedron", length_unit="m", **keys)
    assert shape.mesh.volume_m3 == pytest.approx(4.0, rel=1e-14)


def test_quadrangles_are_split() -> None:
    vertices, faces = read_obj(DATA / "quads.obj")
    assert len(vertices) == 8
    np.testing.assert_array_equal(
        faces,
        [
            [0, 3, 2], [0, 2, 1], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
            [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [0, 4, 7], [0, 7, 3],
        ],
    )  # fmt: skip
    shape = create("shape", "polyhedron", file=str(DATA / "quads.obj"), length_unit="m")
    assert shape.mesh.volume_m3 == pytest.approx(4.0 * 2.0 * 1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("bad-five-corners.obj", ":6: faces must be triangles or quadrangles, got 5 corners"),
        ("bad-count.plt", ": expected 8 plates, got 7"),
        ("bad-no-plates.plt", ": expected the number of plates after 6 vertices"),
        ("bad-too-many.plt", ":15: a row after the last of 7 plates"),
        ("bad-index-gap.plt", ":5: vertices must be counted without gaps: expected 4, got 5"),
        ("bad-start.plt", ":2: vertices must be counted from 0 or 1, got 2"),
        ("bad-plate.plt", ":15: a plate names vertex 7, but there are 1 to 6"),
        ("bad-plate-zero.plt", ":12: a plate names vertex 6, but there are 0 to 5"),
        ("bad-columns.plt", ":7: expected vertices of 3, got 2"),
        ("bad-nan.plt", ":7: coordinate: expected a finite number, got 'nan'"),
        ("bad-counts.plt", ":1: expected the number of vertices, or those of vertices and plates"),
        ("bad-rows-zero.tab", ":14: a face names vertex 6, but with a vertex 0 they end at 5"),
        ("bad-rows-relative.tab", ": faces name vertex 0 and count others from the end"),
        ("bad-open.plt", ": the mesh is not closed"),
    ],
)
def test_faults(name: str, fault: str) -> None:
    with pytest.raises(InputError) as caught:
        create("shape", "polyhedron", file=str(DATA / name), length_unit="m")
    assert f"{DATA / name}{fault}" in str(caught.value)


@pytest.mark.parametrize(
    ("vertices", "plates", "fault"),
    [
        ("bad-vertices-counted.txt", "plates.txt", ":1: expected 5 vertices, got 6"),
        ("absent.txt", "plates.txt", ": cannot be read"),
    ],
)
def test_faults_of_two_files(vertices: str, plates: str, fault: str) -> None:
    with pytest.raises(InputError) as caught:
        read_plate_files(DATA / vertices, DATA / plates)
    assert str(caught.value).startswith(f"{DATA / vertices}{fault}")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"vertices_file": "a"}, "plates_file: vertices_file and plates_file belong together"),
        ({"plates_file": "a"}, "vertices_file: vertices_file and plates_file belong together"),
        ({"vertices_file": "a", "plates_file": "b", "file": "c"}, "two sources of the shape"),
        ({"file": str(DATA / "rows.tab"), "length_unit": "mile"}, "length_unit"),
    ],
)
def test_sources_of_a_shape(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("shape", "polyhedron", **{"length_unit": "m", **keys})


SEEDS = ("one-count.plt", "two-counts.plt", "two-counts-mixed.plt", "from-zero.plt", "rows.tab",
         "rows-from-zero.tab", "quads.obj")  # fmt: skip
NUMERIC = st.from_regex(rb"[0-9 .,+e\n-]{0,8}", fullmatch=True)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_mutated_files_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(SEEDS))
    content = (DATA / name).read_bytes()
    start = data.draw(st.integers(0, len(content)))
    stop = data.draw(st.integers(start, min(len(content), start + 30)))
    patch = data.draw(st.one_of(st.binary(max_size=8), NUMERIC))
    path = tmp_path / name
    path.write_bytes(content[:start] + patch + content[stop:])
    for read in (read_shape, read_plates):
        try:
            vertices, faces = read(path)
        except InputError as error:
            assert str(error).startswith(str(path))  # noqa: PT017
        else:
            assert np.isfinite(vertices).all()
            assert faces.min() >= 0
            assert faces.max() < len(vertices)
