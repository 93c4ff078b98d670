"""Shapes of bodies: meshes that are checked, rays and contact, grids and harmonics."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.polyhedron import MeshSurface
from hillsphere.model.shapes.rays import RayTable
from hillsphere.model.shapes.sphere import icosphere, unit_vectors
from hillsphere.model.shapes.triangulation import triangulate
from hillsphere.testing import ContractViolation, check_shape, example

OCTAHEDRON = [
    [1, 3, 5], [3, 2, 5], [2, 4, 5], [4, 1, 5], [3, 1, 6], [2, 3, 6], [4, 2, 6], [1, 4, 6],
]  # fmt: skip
CORNERS = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
AXES = (13030.0, 11400.0, 9140.0)


def rays(count: int = 500, seed: int = 4) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(3, count))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0))


def ellipsoid() -> Any:
    return create("shape", "ellipsoid", axes_m=AXES)


def octahedron(faces: Any = OCTAHEDRON, corners: Any = CORNERS) -> Mesh:
    return Mesh(np.array(corners, dtype=float), np.array(faces) - 1)


def test_octahedron() -> None:
    mesh = octahedron()
    assert mesh.volume_m3 == pytest.approx(4 / 3, rel=1e-15)
    np.testing.assert_allclose(mesh.centroid_m, 0.0, rtol=0, atol=1e-16)
    np.testing.assert_allclose(mesh.heights, 1 / np.sqrt(3), rtol=1e-15)
    assert len(mesh.edges[0]) == 12
    ends, faces = mesh.edges
    for (i, j), (one, other) in zip(ends.tolist(), faces.tolist(), strict=True):
        sides = [
            [(a[k], a[(k + 1) % 3]) for k in range(3)] for a in mesh.faces[[one, other]].tolist()
        ]
        assert (i, j) in sides[0]
        assert (j, i) in sides[1]
    moved = Mesh(mesh.vertices + np.array([5.0, 0, 0]), mesh.faces)
    np.testing.assert_allclose(moved.centroid_m, [5.0, 0, 0], rtol=1e-14, atol=1e-15)
    assert mesh.is_star_shaped
    assert not moved.is_star_shaped


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f[1:], "not closed: 3 edges belong to one face only, first that between"),
        (lambda f: [f[0][::-1], *f[1:]], "in the same direction"),
        (lambda f: [a[::-1] for a in f], "look inward"),
        (lambda f: [*f[1:], [1, 3, 3]], "degenerate"),
        (lambda f: [*f[1:], [1, 3, 7]], "faces name vertices 1 to 6"),
        (lambda f: f[:3], "at least four triangles"),
        (lambda f: [*f, f[0]], "same direction"),
    ],
)
def test_bad_meshes(change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        octahedron(change([list(a) for a in OCTAHEDRON]))
    with pytest.raises(InputError, match="finite"):
        octahedron(corners=[[np.nan, 0, 0], *CORNERS[1:]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        # without the faces 1-3-5 and 4-2-6 the sides 1-5, 2-4, 3-1, 4-6, 5-3, 6-2 are alone
        (lambda f: f[1:6] + f[7:], "6 edges .* first that between vertices 1 and 5;"),
        (lambda f: [*f[1:], f[0][::-1]], "from vertex 1 to vertex 5 in the same direction"),
        (lambda f: [*f, [3, 5, 1]], "faces 1 and 9 have the same corners, in the same direction"),
    ],
)
def test_the_first_bad_edge_is_named(change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        octahedron(change([list(a) for a in OCTAHEDRON]))


def test_a_mesh_in_blocks_is_the_mesh_and_takes_little_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    directions, faces = icosphere(5)
    whole = Mesh(directions, faces)
    monkeypatch.setattr("hillsphere.model.shapes.mesh._BLOCK", 1000)
    tracemalloc.start()
    try:
        mesh = Mesh(directions, faces)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # three sides of a face: their sorted numbers, one array to compare them, two of truth values
    assert peak < 1.1 * len(faces) * 3 * (8 + 8 + 2)
    assert (mesh.volume_m3, mesh.centroid_m.tolist()) == (
        whole.volume_m3, whole.centroid_m.tolist()
    )  # fmt: skip
    with pytest.raises(InputError, match="face 2000 is degenerate"):
        Mesh(directions, np.vstack([faces[:1999], [[5, 6, 5]], faces[1999:]]))


@pytest.mark.parametrize("subdivisions", [0, 2, 4])
def test_rays_meet_the_face_that_all_faces_tell(subdivisions: int) -> None:
    mesh = triangulate(ellipsoid(), subdivisions)
    way = np.concatenate([rays(), np.eye(3), -np.eye(3), mesh.vertices[:50].T], axis=1)
    found = RayTable(mesh).faces(way)
    # the least distance to the planes of a convex body's faces is the right one
    along = mesh.normals.T @ way
    distance = np.where(along > 0, mesh.heights[:, None] / np.where(along > 0, along, 1.0), np.inf)
    own = np.take_along_axis(distance, found[None], axis=0)[0]
    np.testing.assert_allclose(own, distance.min(axis=0), rtol=1e-12)


def test_a_triangulated_ellipsoid_becomes_the_ellipsoid() -> None:
    shape, way = ellipsoid(), rays()
    volume = 4 / 3 * np.pi * np.prod(AXES)
    lost, gaps = [], []
    for k in (2, 3, 4):
        mesh = triangulate(shape, k)
        assert len(mesh.faces) == 20 * 4**k
        lost.append(1.0 - mesh.volume_m3 / volume)
        surface = MeshSurface(mesh)
        gaps.append(np.max(np.abs(surface.radius_array(way) / shape.radius_array(way) - 1)))
    np.testing.assert_allclose(np.array(lost[:-1]) / lost[1:], 4.0, rtol=0.05)
    assert gaps[0] > 3 * gaps[1] > 9 * gaps[2]
    assert gaps[2] < 2e-3


def overhanging() -> Mesh:
    """Bend a bump of a sphere over: some rays meet it three times."""
    directions, faces = icosphere(3)
    vertices = 1e3 * directions
    top = directions[:, 2] > 0.85
    vertices[top] *= 1.8
    vertices[top] += [900.0, 0.0, 0.0]
    return Mesh(vertices, faces)


def test_contact_with_an_overhang() -> None:
    """Inside and outside by counting the faces above a point on a vertical line."""
    mesh = overhanging()
    assert not mesh.is_star_shaped
    surface = MeshSurface(mesh)
    rng = np.random.default_rng(5)
    points = rng.uniform(-2e3, 2.4e3, size=(3, 400))
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 2, 0)

    def side(p: Array, q: Array, x: Array) -> Array:
        return np.asarray(np.sign((q - p)[0] * (x[1] - p[1]) - (q - p)[1] * (x[0] - p[0])))

    expected = []
    for x in points.T:
        signs = np.array([side(a, b, x), side(b, c, x), side(c, a, x)])
        over = np.abs(signs.sum(axis=0)) == 3
        n = mesh.normals[:, over]
        height = mesh.heights[over] - n[0] * x[0] - n[1] * x[1]
        expected.append(np.count_nonzero(height / n[2] > x[2]) % 2 == 1)
    inside = np.array(expected)
    assert 20 < inside.sum() < 380
    np.testing.assert_array_equal(surface.surface_array(points) < 0, inside)
    # beyond the outermost point of a ray there is nothing, just under it the body
    way = rays(60)
    radius = surface.radius_array(way)
    assert (surface.surface_array((radius + 1e-3) * way) > 0).all()
    assert (surface.surface_array((radius - 1e-3) * way) < 0).all()
    assert (np.sum(surface.normal_array(way) * way, axis=0) > 0).all()
    outside = Mesh(mesh.vertices + np.array([0, 0, 1e4]), mesh.faces)
    with pytest.raises(InputError, match="the centre lies outside"):
        MeshSurface(outside).radius_array(-np.eye(3))
    assert MeshSurface(outside).surface_array(np.array([[0.0], [0.0], [1e4]]))[0] < 0


def test_grid_is_linear_between_its_points(tmp_path: Path) -> None:
    lat, lon = np.linspace(-90, 90, 7), np.arange(0, 360, 45.0)
    radii = np.random.default_rng(8).uniform(8.0, 12.0, (7, 8))
    radii[0], radii[-1] = radii[0, 0], radii[-1, 0]
    shape = create("shape", "grid", radii=radii.tolist(), length_unit="km")
    np.testing.assert_allclose(
        shape.radius_array(unit_vectors(lat, lon)), 1e3 * radii.ravel(), rtol=1e-12
    )
    middle = shape.radius_array(unit_vectors(lat[3:4] + 15, [337.5, -22.5, 22.5]))
    corners = [[7, 0], [7, 0], [0, 1]]
    expected = [1e3 * radii[3:5][:, pair].mean() for pair in corners]
    np.testing.assert_allclose(middle, expected, rtol=1e-12)
    check_shape(shape, rays(100))
    path = tmp_path / "grid.txt"
    rows = "\n".join(", ".join(f"{q:.17g}" for q in row) for row in radii)
    path.write_text(f"# latitudes from -90\n{rows}\n")
    other = create("shape", "grid", file=str(path), length_unit="km")
    np.testing.assert_array_equal(other.radius_array(rays()), shape.radius_array(rays()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: [row[:2] for row in r], "three or more radii"),
        (lambda r: [*r[:-1], r[-1][:-1]], "rows of \\[3, 4\\]"),
        (lambda r: [[1, 2, 3, 4], *r[1:]], "are the poles"),
        (lambda r: [r[0], [1, -1, 1, 1], *r[2:]], "must be positive"),
        (lambda r: [], "give radii or file"),
    ],
)
def test_bad_grids(change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("shape", "grid", radii=change([[2.0] * 4] * 5), length_unit="km")


def test_harmonics_of_low_degree_in_closed_form() -> None:
    """R = C00 + √5 C20 (3 sin²φ − 1)/2 + √(5/12)·3 cos²φ (C22 cos 2λ + S22 sin 2λ)."""
    rows = [[0, 0, 7.0, 0], [2, 0, -1.0, 0], [2, 1, 0, 0], [2, 2, 0.8, -0.3]]
    shape = create("shape", "harmonics", coefficients=rows, length_unit="km")
    x, y, z = rays()
    expected = 7.0 - np.sqrt(5) * (1.5 * z**2 - 0.5)
    expected += np.sqrt(5 / 12) * 3 * (0.8 * (x**2 - y**2) - 0.3 * 2 * x * y)
    np.testing.assert_allclose(shape.radius_array(rays()), 1e3 * expected, rtol=1e-12)
    most = 7 + np.sqrt(5) / 2 + np.sqrt(15 / 4) * np.hypot(0.8, 0.3)
    assert shape.largest_radius_m == pytest.approx(1e3 * most, rel=1e-8)
    mean = create("shape", "harmonics", coefficients=rows, length_unit="km", max_degree=0)
    np.testing.assert_allclose(mean.radius_array(rays()), 7e3, rtol=1e-14)


@pytest.mark.parametrize(
    ("rows", "keys", "message"),
    [
        ([[0, 0, 1.0, 0], [2, 0, -3.0, 0]], {}, "not positive everywhere"),
        ([[1, 0, 1.0, 0]], {}, "mean radius"),
        ([[0, 0, 1.0, 0], [1, 2, 0.1, 0]], {}, "no term of a series"),
        ([[0, 0, 1.0, 0], [1, 0, 0.1, 0.2]], {}, "S of order 0"),
        ([[0, 0, 1.0, 0], [1, 0, 0.1, 0], [1, 0, 0.1, 0]], {}, "are listed twice"),
        ([[0, 0, 1.0, 0]], {"max_degree": 3}, "must be ≤ 0"),
        ([[0, 0, 1.0, 0]], {"file": "x.tab"}, "keep one"),
        ([], {}, "give coefficients or file"),
    ],
)
def test_bad_harmonics(rows: Any, keys: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("shape", "harmonics", coefficients=rows, length_unit="km", **keys)


def test_a_polyhedron_from_a_file_names_it(tmp_path: Path) -> None:
    path = tmp_path / "open.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {i} {j} {k}" for i, j, k in OCTAHEDRON]
    path.write_text("\n".join(lines))
    shape = create("shape", "polyhedron", file=str(path), length_unit="km")
    assert shape.semi_axes_m() == (1e3, 1e3, 1e3)
    check_shape(shape, rays(50))
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(InputError, match=r"open\.obj: the mesh is not closed"):
        create("shape", "polyhedron", file=str(path), length_unit="km")
    with pytest.raises(InputError, match="length_unit"):
        create("shape", "polyhedron", file=str(path))


def test_lanes_that_are_lost_stay_lost() -> None:
    """And disturb nobody: NaN in, NaN out."""
    r = 2e4 * rays(4)
    lost = r.copy()
    lost[:, 1] = np.nan
    for type_ in ("grid", "polyhedron"):
        shape = example("shape", type_, 0)
        expected = shape.surface_array(r)
        found = shape.surface_array(lost)
        assert np.isnan(found[1])
        np.testing.assert_array_equal(np.delete(found, 1), np.delete(expected, 1))


class Wrong:
    """An ellipsoid with something wrong in it."""

    def __init__(self, **methods: Any) -> None:
        self._own = ellipsoid()
        for name, method in methods.items():
            setattr(self, name, method)

    def semi_axes_m(self) -> tuple[float, float, float]:
        return AXES

    def surface_array(self, r: Array) -> Array:
        return np.asarray(np.linalg.norm(r, axis=0) / self._own.radius_array(r) - 1.0)

    def normal_array(self, r: Array) -> Array:
        slope = r / np.array(AXES)[:, None] ** 2
        return np.asarray(slope / np.linalg.norm(slope, axis=0))


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ({"surface_array": lambda r: np.ones(r.shape[1])}, "negative near the centre"),
        ({"surface_array": lambda r: -np.ones(r.shape[1])}, "positive outside"),
        ({"semi_axes_m": lambda: (10e3, 10e3, 10e3)}, "leaves the box"),
        ({"largest_radius_m": 11e3}, "exceeds the largest"),
        ({"radius_array": lambda d: np.full(d.shape[1], 1e4)}, "radius_array"),
        ({"normal_array": lambda r: 2.0 * r}, "must be unit vectors"),
        ({"normal_array": lambda r: r / np.linalg.norm(r, axis=0)}, "against the surface function"),
    ],
)
def test_the_conformance_kit_finds_faults(methods: Any, message: str) -> None:
    check_shape(Wrong(), rays(50))
    with pytest.raises(ContractViolation, match=message):
        check_shape(Wrong(**methods), rays(50))
