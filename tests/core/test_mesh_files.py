"""Meshes as STL, PLY and DSK, vertices that are listed twice, and what is wrong with bad files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.core.mutations import damaged

from hillsphere import create
from hillsphere.base.arrays import Array, Integers
from hillsphere.errors import InputError
from hillsphere.formats import bulk, obj, plates
from hillsphere.formats.mesh_files import read_mesh_file
from hillsphere.formats.plates import read_shape
from hillsphere.mission import load_mission
from hillsphere.model.shapes.merging import merge_vertices
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.runs.mission_check import check_mission

DATA = Path(__file__).parents[1] / "data" / "shapes"
STL = {"merge_vertices": True}
# The octahedron of semi-axes 2, 1.5, 1 has the volume 4/3 · 2 · 1.5 · 1 = 4; the box 4 · 2 · 1 = 8;
# the house of 3 m over a square of 2 m with a gable of 1 m has 3 · (4 + 1) = 15.
OCTAHEDRON, BOX, HOUSE = (4.0, 8), (8.0, 12), (15.0, 16)


@pytest.mark.parametrize(
    ("name", "keys", "expected"),
    [
        ("octahedron.stl", STL, OCTAHEDRON),
        ("crlf.stl", STL, OCTAHEDRON),
        ("binary.stl", STL, OCTAHEDRON),
        ("octahedron.ply", {}, OCTAHEDRON),
        ("little.ply", {}, OCTAHEDRON),
        ("big.ply", {}, OCTAHEDRON),
        ("quads.ply", {}, BOX),
        ("quads-little.ply", {}, BOX),
        ("polygons.ply", {}, HOUSE),
    ],
)
def test_volume(name: str, keys: dict[str, Any], expected: tuple[float, int]) -> None:
    shape = create("shape", "polyhedron", file=str(DATA / name), length_unit="m", **keys)
    # binary STL has single precision, in which these corners are exact
    assert (shape.mesh.volume_m3, len(shape.mesh.faces)) == (
        pytest.approx(expected[0]),
        expected[1],
    )
    # the 24 corners of eight facets are six vertices
    assert shape.merged_vertices == (18 if keys else 0)
    assert len(shape.describe()) == (2 if keys else 1)


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("bad-torn.stl", ": no line 'endsolid' at the end"),
        ("bad-cut.stl", ": no STL file: a text begins with 'solid', and a binary file of 8 facets"),
        ("bad-corner.stl", ":4: expected 'vertex x y z'"),
        ("bad-number.stl", ":4: expected 'vertex x y z'"),
        ("bad-facet.stl", ":8: the facet before has not three corners"),
        ("bad-open.stl", ": the mesh is not closed: 3 edges belong to one face only"),
        ("bad-inward.stl", ": the faces look inward"),
        ("bad-lists.ply", ": no readable PLY file: its length does not fit its head"),
        ("bad-vertex.ply", ": a face names vertex 6, but they are counted from 0 to 5"),
        ("bad-negative.ply", ": a face names vertex -1, but they are counted from 0 to 5"),
        ("bad-count.ply", ": the head states 8 rows of 'face', got 7"),
        ("bad-fraction.ply", ": a face must name its vertices by integers: '3 0 3 4.5'"),
        ("bad-nan.ply", ": coordinates must be finite numbers"),
        ("bad-word.ply", ": no readable PLY file: string or file could not be read to its end"),
        ("bad-head.ply", ": the head has no line 'end_header'"),
        ("bad-points.ply", ": no faces"),
        ("absent.ply", ": cannot be read: No such file or directory"),
        ("octahedron.stl", ": an STL file lists the corners of each face anew"),
    ],
)
def test_faults(name: str, fault: str) -> None:
    keys = STL if name.startswith("bad") else {}
    with pytest.raises(InputError) as caught:
        create("shape", "polyhedron", file=str(DATA / name), length_unit="m", **keys)
    assert f"{DATA / name}{fault}" in str(caught.value)


@pytest.mark.parametrize("name", ["octahedron.stl", "binary.stl", "octahedron.ply", "little.ply"])
def test_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    """A damaged file never gives another error, nor a mesh of fewer faces than it has."""
    path = tmp_path / name
    for seed in range(60):
        path.write_bytes(damaged((DATA / name).read_bytes(), seed))
        try:
            vertices, faces = read_mesh_file(path)
        except InputError as error:
            assert str(error).startswith(str(path))  # noqa: PT017
        else:
            assert np.isfinite(vertices).all()
            assert 0 <= faces.min() <= faces.max() < len(vertices)


def test_without_trimesh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'hillsphere\[mesh\]'"):
        read_mesh_file(DATA / "octahedron.ply")


def test_vertices_are_merged_only_when_asked() -> None:
    """One of the seven vertices is 1e-7 m from another."""
    path = str(DATA / "doubled.plt")
    for keys in ({}, STL, {**STL, "merge_tolerance_m": 5e-8}):
        with pytest.raises(InputError, match="4 edges belong to one face only"):
            create("shape", "polyhedron", file=path, length_unit="m", **keys)
    shape = create("shape", "polyhedron", file=path, length_unit="m", **STL, merge_tolerance_m=2e-7)
    assert (shape.merged_vertices, shape.collapsed_faces) == (1, 0)
    assert shape.mesh.volume_m3 == pytest.approx(4.0, rel=1e-6)
    # in km the same distance of the file is 1e-4 m
    shape = create(
        "shape", "polyhedron", file=path, length_unit="km", **STL, merge_tolerance_m=2e-4
    )
    assert shape.merged_vertices == 1


def test_merging_keeps_order_counts_collapsed_faces_and_refuses_chains() -> None:
    vertices = np.array([[1.0, 0, 0], [0, 1, 0], [0.0, 0, 1], [1, 0, 0], [-0.0, 1, 0]])
    merged, faces, count, collapsed = merge_vertices(
        vertices, np.array([[0, 1, 2], [3, 4, 2], [0, 3, 1]]), 0.0
    )
    np.testing.assert_array_equal(merged, vertices[:3])
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 1, 2]])
    assert (count, collapsed) == (2, 1)
    line = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    with pytest.raises(InputError, match="form chains, 1 of them"):
        merge_vertices(line, np.array([[0, 1, 2]]), 1.0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"file": "a.obj"}, "length_unit: give the unit of the vertices"),
        ({"file": "a.stl"}, "length_unit: give the unit of the vertices"),
        ({"file": "a.ply"}, "length_unit: give the unit of the vertices"),
        ({"vertices_file": "a", "plates_file": "b"}, "length_unit: give the unit"),
        (
            {"file": "a.bds", "length_unit": "m"},
            "length_unit: the vertices of a DSK file",
        ),
        ({"file": "a.obj", "length_unit": "m", "segment": 1}, "segment: goes with a DSK file"),
        ({"file": "a.obj", "length_unit": "m", "merge_tolerance_m": 1}, "merge_vertices = true"),
    ],
)
def test_keys(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("shape", "polyhedron", **keys)


@pytest.mark.parametrize(
    ("beginning", "program"), [(b"\x1f\x8b", "gzip"), (b"PK\x03\x04", "zip"), (b"BZh", "bzip2")]
)
def test_compressed_files_are_refused_by_name(
    tmp_path: Path, beginning: bytes, program: str
) -> None:
    path = tmp_path / "body.obj"
    path.write_bytes(beginning + b"v 1 2 3\n")
    with pytest.raises(InputError, match=f"compressed by {program}"):
        read_shape(path)


def _box(shift: float, turned: bool = False) -> tuple[Array, Integers]:
    vertices, faces = read_shape(DATA / "quads.obj")
    return vertices + np.array([shift, 0, 0]), faces[:, ::-1] if turned else faces


def test_doubled_and_degenerate_faces_and_several_surfaces() -> None:
    vertices, faces = _box(0.0)
    with pytest.raises(InputError, match="faces 1 and 13 have the same corners"):
        Mesh(vertices, np.vstack([faces, np.roll(faces[:1], 1, axis=1)]))
    with pytest.raises(InputError, match=r"face 13 is degenerate \(as are 1 more\)"):
        Mesh(vertices, np.vstack([faces, [[0, 0, 1], [1, 1, 2]]]))
    other, turned = _box(20.0)
    both = Mesh(np.vstack([vertices, other]), np.vstack([faces, turned + len(vertices)]))
    np.testing.assert_allclose(both.component_volumes_m3, [8.0, 8.0])
    # a cavity of half the size
    _, inner = _box(0.0, turned=True)
    hollow = Mesh(
        np.vstack([vertices, 0.5 * (vertices - vertices.mean(axis=0)) + vertices.mean(axis=0)]),
        np.vstack([faces, inner + len(vertices)]),
    )
    np.testing.assert_allclose(hollow.component_volumes_m3, [8.0, -1.0])


@pytest.mark.parametrize(
    "name", ["rows.tab", "quads.obj", "one-count.plt", "two-counts.plt", "from-zero.plt"]
)
def test_whole_and_line_by_line_agree(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is parsed as a whole is what the lines give, also of damaged files."""
    path = tmp_path / name
    sound = (DATA / name).read_bytes()

    def read() -> Any:
        try:
            return [part.tolist() for part in read_shape(path)]
        except InputError as error:
            return str(error)

    for seed in range(80):
        path.write_bytes(damaged(sound, seed) if seed else sound)
        whole = read()
        with monkeypatch.context() as patch:
            for module in (obj, plates):
                patch.setattr(module, "parse_table", lambda *_args, **_keys: None)
            assert read() == whole, f"seed {seed}"


def test_a_table_is_parsed_only_if_it_is_uniform() -> None:
    fields = np.dtype([("n", "i8"), ("c", "f8")])
    table = bulk.parse_table(["1 2.5D1", "2 .5"], fields)
    assert table is not None
    assert table.tolist() == [(1, 25.0), (2, 0.5)]
    for row in ("1.0 2", "1 nan", "1 2 3", "1", "1 2x", "1 inf", "99999999999999999999 1"):
        assert bulk.parse_table(["1 2.5", row], fields) is None
    assert bulk.parse_table([], fields) is None


@pytest.fixture(scope="module")
def dsk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Make files of one and of two segments of type 2: the octahedron."""
    spice = pytest.importorskip("spiceypy")
    vertices, faces = read_shape(DATA / "one-count.plt")
    folder = tmp_path_factory.mktemp("shapes")
    paths = (folder / "one.bds", folder / "two.bds")
    for count, path in enumerate(paths, start=1):
        handle = spice.dskopn(str(path), "made for a test", 0)
        for surface in range(1, count + 1):
            # scales of voxels and sizes of work space as NAIF's MKDSK would take for few plates
            reals, integers = spice.dskmi2(
                surface * vertices, faces + 1, 0.4, 1, 10_000, 1000, 10_000, True, 200_000
            )
            spice.dskw02(
                handle, 499, surface, 1, "IAU_MARS", 1, np.zeros(10), -np.pi, np.pi, -np.pi / 2,
                np.pi / 2, 0.5, 9.0, 0.0, 1.0, surface * vertices, faces + 1, reals, integers,
            )  # fmt: skip
        spice.dskcls(handle, True)
    return paths


def test_dsk_files(dsk: tuple[Path, Path], tmp_path: Path) -> None:
    one, two = map(str, dsk)
    shape = create("shape", "polyhedron", file=one)
    assert shape.mesh.volume_m3 == pytest.approx(4e9, rel=1e-14)  # km, without a key
    with pytest.raises(InputError, match=r"2 segments \(1: body 499, surface 1, 2: body 499"):
        create("shape", "polyhedron", file=two)
    second = create("shape", "polyhedron", file=two, segment=2)
    assert second.mesh.volume_m3 == pytest.approx(32e9, rel=1e-14)
    with pytest.raises(InputError, match="segment must be ≤ 2, got 3"):
        create("shape", "polyhedron", file=two, segment=3)
    cut = tmp_path / "cut.bds"
    cut.write_bytes(dsk[0].read_bytes()[:1500])
    no_dsk = tmp_path / "plates.dsk"
    no_dsk.write_bytes((DATA / "one-count.plt").read_bytes())
    for path, fault in ((cut, "damaged|cannot be read"), (no_dsk, "no DSK file")):
        with pytest.raises(InputError, match=f"{path.name}.*{fault}"):
            create("shape", "polyhedron", file=str(path))


def test_a_mission_tells_of_its_shapes_and_gravity(tmp_path: Path) -> None:
    """The density of the mission's body of 4 km³ follows from its GM: 2000 · 6.6743e-11 · 4e9."""
    path = tmp_path / "small.toml"
    path.write_text(
        f"""format = 1
name = "small"
title = "Small"
seed = 5
[shape.body]
type = "polyhedron"
file = "{DATA / "octahedron.stl"}"
length_unit = "km"
merge_vertices = true
[gravity.body]
type = "polyhedron"
shape = "body"
gm_m3_s2 = 533.944
[body.moon]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
[plant.hill]
type = "hill"
body = "moon"
gravity = "body"
[stage.one]
type = "equilibria"
plant = "hill"
""",
        "utf-8",
    )
    mission = load_mission(path, allow_path=True)
    assert check_mission(mission).descriptions == {
        "shape.body": (
            "8 triangles, extent 4 × 3 × 2 km, volume 4 km³",
            "18 vertices were merged with others at the same place; 0 faces collapsed and were "
            "left out",
        ),
        "gravity.body": ("GM 5.33944e-07 km³/s², density 2 g/cm³",),
    }
