"""Clusters of faces as series: the stated error, and what is conserved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, ArrayGravityModel
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.sphere import icosphere
from hillsphere.symbolic import variable
from hillsphere_gravity.polyhedron_sums import OpenParts, PolyhedronSums
from hillsphere_gravity.polyhedron_tree import Choice, Pairs, PolyhedronTree
from hillsphere_gravity.quadrupole import Quadrupole
from hillsphere_gravity.solid_harmonics import (
    differentiate_irregular,
    irregular_harmonics,
    pack,
    regular_harmonics,
    unpack,
)

QUANTITIES = ("potential", "acceleration", "gradient")


def rough_mesh(subdivisions: int) -> Mesh:
    """Return an ellipsoid of 13 × 11 × 9 km with waves of 4 %, roughness of 0.4 % and a dent."""
    directions, faces = icosphere(subdivisions)
    rng = np.random.default_rng(1)
    radii = 1.0 + 0.004 * rng.normal(size=len(directions))
    for _ in range(12):
        wave = rng.normal(size=3) * rng.uniform(1.0, 6.0)
        radii += 0.04 * np.sin(directions @ wave + rng.uniform(0.0, 6.0))
    radii -= 0.3 * np.exp(-20.0 * (1.0 - directions @ [0.6, 0.8, 0.0]))
    return Mesh(radii[:, None] * directions * [13e3, 11e3, 9e3], faces)


def places(mesh: Mesh, count: int, low: float, high: float) -> Array:
    rng = np.random.default_rng(0)
    some = mesh.vertices[rng.integers(0, len(mesh.vertices), count)].T
    return np.ascontiguousarray(some * np.exp(rng.uniform(np.log(low), np.log(high), count)))


def scales(mesh: Mesh, r: Array) -> dict[str, Array]:
    s = np.maximum(np.linalg.norm(r, axis=0), mesh.largest_radius_m)
    return {q: mesh.volume_m3 / s**power for power, q in enumerate(QUANTITIES, start=1)}


def errors(mesh: Mesh, field: Any, exact: Any, r: Array) -> dict[str, float]:
    """Largest errors, of GM/s, GM/s², GM/s³, Euclidean and Frobenius norms."""
    found = {}
    for quantity, scale in scales(mesh, r).items():
        difference = getattr(field, quantity)() - getattr(exact, quantity)()
        size = np.linalg.norm(difference.reshape(-1, r.shape[1]), axis=0)
        found[quantity] = float(np.max(size / scale))
    return found


def test_harmonics_and_their_slopes() -> None:
    """The generating function of solid harmonics, and its derivative, the field of a mass point."""
    rng = np.random.default_rng(3)
    y, rho = 0.03 * rng.normal(size=(3, 1)), rng.normal(size=(3, 40))
    rho *= 4.0 / np.linalg.norm(rho, axis=0)
    moments = unpack(regular_harmonics(15)(y)[:, 0])
    way = y - rho
    distance = np.linalg.norm(way, axis=0)
    series = pack(moments) @ irregular_harmonics(15)(rho)
    np.testing.assert_allclose(series, 1.0 / distance, rtol=1e-14)
    slopes = pack(differentiate_irregular(moments)) @ irregular_harmonics(16)(rho)
    np.testing.assert_allclose(slopes, way / distance**3, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    "relative_error", [1e-2, 1e-6, pytest.param(1e-12, marks=pytest.mark.slow)]
)
def test_error_is_below_its_bound(relative_error: float) -> None:
    """From inside the body and the surface itself to a hundred radii."""
    mesh = rough_mesh(3)
    tree, direct = PolyhedronTree(mesh, relative_error), PolyhedronSums(mesh)
    for low, high in ((0.1, 0.95), (0.999, 1.001), (1.01, 3.0), (3.0, 30.0)):
        r = places(mesh, 120, low, high)
        # the direct sum itself errs by 1e-13, which the distance in radii multiplies
        rounding = 3e-13 * max(1.0, high) ** 2
        for error in errors(mesh, tree(r), direct(r), r).values():
            assert error <= relative_error + rounding
    assert tree.choose(r).far.point.size < 10 * r.shape[1], "clusters are taken from afar"


def test_no_cluster_errs_by_more_than_its_share() -> None:
    """Each cluster alone, at the least distance at which its series is used, all round."""
    mesh, relative_error = rough_mesh(3), 1e-4
    tree, parts = PolyhedronTree(mesh, relative_error), OpenParts(mesh)
    clusters = tree._clusters
    rng = np.random.default_rng(8)
    ways = rng.normal(size=(3, 64))
    ways /= np.linalg.norm(ways, axis=0)
    areas = mesh.doubled_areas / mesh.doubled_areas.sum()
    largest = 0.0
    for k in range(1, len(clusters.first)):
        faces = clusters.order[clusters.first[k] : clusters.last[k]]
        centre, distance = clusters.centres[:, k, None], clusters.distances[k]
        r = mesh.largest_radius_m * (centre + distance * ways)
        point = np.arange(64)
        alone = Choice(Pairs.of([(np.full(64, k), point)]), Pairs.of([(point[:0], point[:0])]))
        rows, rho = tree.series(alone, r, slice(0, 8))
        square = np.sum(rho * rho, axis=0)
        exact = parts.part(faces).rows(r)
        potential = 0.5 * exact[0] - np.sum(r * exact[1:4], axis=0)
        xx, yy, zz, xy, xz, yz = exact[4:10]
        turned = np.einsum("ijN,jN->iN", np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), r)
        potential += 0.5 * np.sum(r * turned, axis=0)
        pull = rows[5:] + square * rows[2:5] + 2.0 * rows[1] * rho
        share = relative_error * areas[faces].sum() * mesh.volume_m3
        unit = mesh.largest_radius_m
        off = np.abs(unit**2 * (rows[0] + square * rows[1]) - potential) * unit / share
        assert off.max() <= 1.0
        off = np.linalg.norm(unit * pull - (turned - exact[1:4]), axis=0) * unit**2 / share
        assert off.max() <= 1.0
        largest = max(largest, float(off.max()))
    # the bound takes all terms of a degree to be in phase: a hundred times too much, not more
    assert largest > 3e-3


def test_far_away_no_digits_are_lost() -> None:
    """At 1e4 radii the second moments of the body leave an error of 1e-12."""
    mesh = rough_mesh(2)
    r = places(mesh, 20, 1e4, 2e4)
    tree, far = PolyhedronTree(mesh, 1e-6)(r), GravityField(Quadrupole(mesh))
    for quantity in QUANTITIES:
        exact = getattr(far, quantity)(r)
        size = np.abs(exact).max()
        np.testing.assert_allclose(getattr(tree, quantity)(), exact, rtol=0, atol=3e-12 * size)


def test_acceleration_is_the_slope_of_the_same_potential() -> None:
    """With errors of 1e-5 of both, they agree to 1e-9, the error of the differences."""
    mesh = rough_mesh(2)
    tree, direct = PolyhedronTree(mesh, 1e-2), PolyhedronSums(mesh)
    r = places(mesh, 40, 1.2, 2.5)
    pull, h = tree(r).acceleration(), 20.0
    scale = scales(mesh, r)["acceleration"]
    by_differences = np.empty_like(pull)
    same = np.ones(r.shape[1], dtype=bool)
    here = tree.choose(r)
    for axis, step in enumerate(h * np.eye(3)[:, :, None]):
        moved = [tree(r + k * step).potential() for k in (-2, -1, 1, 2)]
        by_differences[axis] = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
        for k in (-2, -1, 1, 2):
            there = tree.choose(r + k * step)
            for point in range(r.shape[1]):
                one, other = (c.far.cluster[c.far.point == point] for c in (here, there))
                same[point] &= np.array_equal(np.unique(one), np.unique(other))
    assert same.sum() >= 20
    off = np.linalg.norm(by_differences - pull, axis=0) / scale
    assert off[same].max() < 3e-9
    error = np.linalg.norm(pull - direct(r).acceleration(), axis=0) / scale
    assert np.median(error[same]) > 1e-6


def test_work_along_a_closed_path_is_less_than_the_error() -> None:
    """It is the sum of the potential's jumps, and less than the bound times the path."""
    mesh, relative_error = rough_mesh(2), 1e-2
    angle = 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
    radius = 1.25 * mesh.largest_radius_m
    r = radius * np.array([np.cos(angle), np.sin(angle), 0.2 * np.ones(4000)])
    along = np.array([-np.sin(angle), np.cos(angle), np.zeros(4000)])
    for field, most in (
        (PolyhedronTree(mesh, relative_error)(r), relative_error),
        (PolyhedronSums(mesh)(r), 1e-12),
    ):
        work = np.sum(field.acceleration() * along) * radius * 2.0 * np.pi / 4000
        assert abs(work) <= most * mesh.volume_m3 / radius**2 * 2.0 * np.pi * radius


@pytest.mark.slow
def test_jacobi_constant_of_a_flight() -> None:
    """In the frame of a turning body, from 1.3 to 3 radii, three flights at once."""
    mesh = rough_mesh(2)
    vertices, faces = mesh.vertices.tolist(), (mesh.faces + 1).tolist()
    shape = create("shape", "polyhedron", vertices=vertices, faces=faces, length_unit="m")
    model = create("gravity", "polyhedron", shape=shape, density_kg_m3=1900.0, relative_error=1e-12)
    field, rate = GravityField(model), 2e-4
    r = np.array([[18e3, 0.0, 0.0], [0.0, 20e3, 4e3], [0.0, -15e3, 15e3]]).T
    speed = np.sqrt(model.gm_m3_s2 / np.linalg.norm(r, axis=0))
    v = np.cross(np.array([0.1, 0.3, 1.0]), r, axisb=0).T
    v *= 1.1 * speed / np.linalg.norm(v, axis=0)

    def slope(_: float, state: Array) -> Array:
        q, w = state.reshape(2, 3, -1)
        a = field.acceleration(q)
        a[:2] += rate**2 * q[:2] + 2.0 * rate * np.array([w[1], -w[0]])
        return np.concatenate([w.ravel(), a.ravel()])

    def jacobi(state: Array) -> Array:
        q, w = state.reshape(2, 3, -1)
        turning = 0.5 * rate**2 * (q[0] ** 2 + q[1] ** 2)
        return np.asarray(0.5 * np.sum(w * w, axis=0) - turning - field.potential(q))

    start = np.concatenate([r.ravel(), v.ravel()])
    end = solve_ivp(slope, (0.0, 1.5e4), start, "DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    size = model.gm_m3_s2 / np.linalg.norm(r, axis=0)
    assert np.max(np.abs(jacobi(end) - jacobi(start)) / size) < 3e-12


def test_bits_do_not_depend_on_the_other_points() -> None:
    mesh = rough_mesh(2)
    tree, r = PolyhedronTree(mesh, 1e-6), places(mesh, 130, 0.9, 4.0)
    whole = tree(r)
    for some in (slice(0, 1), slice(5, 22), slice(64, 128)):
        part = tree(np.ascontiguousarray(r[:, some]))
        for quantity in QUANTITIES:
            np.testing.assert_array_equal(
                getattr(part, quantity)(), getattr(whole, quantity)()[..., some]
            )


def test_the_option_of_a_mission() -> None:
    shape = create("shape", "ellipsoid", axes_m=(13e3, 11e3, 9e3))
    keys: dict[str, Any] = {"shape": shape, "subdivisions": 3, "density_kg_m3": 1900.0}
    exact: Any = create("gravity", "polyhedron", **keys)
    model: Any = create("gravity", "polyhedron", **keys, relative_error=1e-6)
    as_created: object = model
    assert isinstance(as_created, ArrayGravityModel)
    r = places(model.mesh, 60, 1.1, 3.0)
    p = np.full((1, 60), 1900.0)
    assert not np.array_equal(model.acceleration_array(r, p), exact.acceleration_array(r, p))
    strength = model.gm_m3_s2 / model.mesh.volume_m3
    for quantity, scale in scales(model.mesh, r).items():
        one, other = (getattr(m, f"{quantity}_array")(r, p) for m in (model, exact))
        assert np.all(np.abs(one - other) <= 1e-6 * strength * scale)
    assert np.abs(model.laplacian_array(r, p)).max() < 1e-6 * strength
    np.testing.assert_allclose(model.laplacian_array(0.5 * r / 3.0, p), -4 * np.pi * strength)
    assert "1.0e-06" in model.describe()[-1]
    distance = variable("distance")
    bounds = [m.acceleration_bound(distance, {"density": 1900.0}) for m in (model, exact)]
    most, usual = ArrayFunction(bounds, [distance])([[1e3, 1.5e4, 5e4]])
    np.testing.assert_allclose(most / usual, 1.0 + 1e-6, rtol=1e-14)
    for wrong in (0.0, -1e-6, 1e-13, 0.1, float("nan"), "fine"):
        with pytest.raises(InputError, match="relative_error"):
            create("gravity", "polyhedron", **keys, relative_error=wrong)
