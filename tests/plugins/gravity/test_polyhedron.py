"""Gravity of a polyhedron against closed forms, limits and itself in parts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere_gravity.ellipsoid import CODATA_2018_G

DENSITY = 1860.0
STRENGTH = CODATA_2018_G * DENSITY
AXES = (13030.0, 11400.0, 9140.0)
BOX = ((-3e3, 5e3), (-2e3, 2.5e3), (-1e3, 4e3))
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(limits: Any = BOX) -> Any:
    x, y, z = limits
    corners = [(a, b, c) for a in x for b in y for c in z]
    faces = [(side[0] + 1, side[i] + 1, side[i + 1] + 1) for side in SIDES for i in (1, 2)]
    return create("shape", "polyhedron", vertices=corners, faces=faces, length_unit="m")


def polyhedron(shape: Any = None, **keys: Any) -> Any:
    mass = keys or {"density_kg_m3": DENSITY}
    return create("gravity", "polyhedron", shape=shape or box(), **mass)


def rays(count: int, seed: int = 2) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(3, count))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0))


def points(count: int = 60, inside: bool = False) -> Array:
    rng = np.random.default_rng(6)
    low, high = np.array(BOX).T[:, :, None]
    part = rng.uniform(0.02, 0.98, (3, count))
    if inside:
        return np.asarray(low + part * (high - low))
    return rays(count) * rng.uniform(7e3, 30e3, count)


def prism(r: Array) -> tuple[Array, Array]:
    """Potential and acceleration of the box, in closed form for Gρ = 1.

    W. D. MacMillan (1930), The Theory of the Potential, section 43: eight corners of
    xy ln(z+d) + yz ln(x+d) + zx ln(y+d) − ½x² atan(yz/xd) − ½y² atan(zx/yd) − ½z² atan(xy/zd).
    """
    potential, pull = np.zeros(r.shape[1]), np.zeros(r.shape)
    for i, x_end in enumerate(BOX[0]):
        for j, y_end in enumerate(BOX[1]):
            for k, z_end in enumerate(BOX[2]):
                sign = -((-1.0) ** (i + j + k))
                x, y, z = x_end - r[0], y_end - r[1], z_end - r[2]
                d = np.sqrt(x * x + y * y + z * z)
                lx, ly, lz = np.log(x + d), np.log(y + d), np.log(z + d)
                ax, ay, az = (
                    np.arctan(q) for q in (y * z / (x * d), z * x / (y * d), x * y / (z * d))
                )
                potential += sign * (
                    x * y * lz + y * z * lx + z * x * ly
                    - 0.5 * (x * x * ax + y * y * ay + z * z * az)
                )  # fmt: skip
                pull -= sign * np.array(
                    [y * lz + z * ly - x * ax, z * lx + x * lz - y * ay, x * ly + y * lx - z * az]
                )
    return potential, pull


@pytest.mark.parametrize("inside", [False, True])
def test_cuboid_in_closed_form(inside: bool) -> None:
    r = points(inside=inside)
    field = GravityField(polyhedron())
    potential, pull = prism(r)
    np.testing.assert_allclose(field.potential(r), STRENGTH * potential, rtol=2e-12)
    size = np.linalg.norm(field.acceleration(r), axis=0).max()
    np.testing.assert_allclose(
        field.acceleration(r), STRENGTH * pull, rtol=0, atol=(2e-12 if inside else 2e-11) * size
    )


def test_gradient_and_laplacian() -> None:
    model = polyhedron()
    field, p = GravityField(model), np.full((1, 60), DENSITY)
    for inside in (False, True):
        r = points(inside=inside)
        gradient = field.gradient(r)
        np.testing.assert_allclose(gradient, np.swapaxes(gradient, 0, 1), rtol=0, atol=1e-19)
        h = 0.5
        for axis in range(3):
            step = h * np.eye(3)[axis][:, None]
            by_differences = (field.acceleration(r + step) - field.acceleration(r - step)) / (2 * h)
            size = np.abs(gradient).max()
            np.testing.assert_allclose(gradient[:, axis], by_differences, rtol=0, atol=1e-5 * size)
        laplacian = model.laplacian_array(r, p)
        expected = -4 * np.pi * STRENGTH if inside else 0.0
        np.testing.assert_allclose(laplacian, expected, rtol=0, atol=1e-13 * STRENGTH)
        trace = np.einsum("iiN->N", gradient)
        np.testing.assert_allclose(trace, expected, rtol=0, atol=1e-13 * STRENGTH)
    far = rays(3) * 1e8
    np.testing.assert_array_equal(model.laplacian_array(far, p[:, :3]), 0.0)


def test_on_edges_and_corners_it_is_finite() -> None:
    """And the limit of what it is near."""
    field = GravityField(polyhedron())
    corner, edge = np.array([5e3, 2.5e3, 4e3]), np.array([5e3, 0.0, 4e3])
    for place in (corner, edge):
        near = place[:, None] + 1e-5 * rays(5)
        assert np.isfinite(field.potential(place))
        np.testing.assert_allclose(field.potential(place), field.potential(near), rtol=1e-8)
        size = np.linalg.norm(field.acceleration(place))
        gap = np.linalg.norm(field.acceleration(near) - field.acceleration(place)[:, None], axis=0)
        assert np.max(gap) < 1e-6 * size


def test_parts_add_up_to_the_whole() -> None:
    (x0, x1), y, z = BOX
    parts = [polyhedron(box(((x0, 400.0), y, z))), polyhedron(box(((400.0, x1), y, z)))]
    r = np.concatenate([points(), points(inside=True)], axis=1)
    fields, whole = [GravityField(part) for part in parts], GravityField(polyhedron())
    np.testing.assert_allclose(sum(f.potential(r) for f in fields), whole.potential(r), rtol=1e-12)
    total = fields[0].acceleration(r) + fields[1].acceleration(r)
    size = np.abs(total).max()
    np.testing.assert_allclose(total, whole.acceleration(r), rtol=0, atol=1e-12 * size)


def test_ellipsoid_is_its_limit() -> None:
    """The error falls by four with each subdivision; extrapolated, by sixteen."""
    shape = create("shape", "ellipsoid", axes_m=AXES)
    exact = GravityField(create("gravity", "ellipsoid", axes_m=AXES, density_kg_m3=DENSITY))
    r = rays(12) * np.linspace(14e3, 30e3, 12)
    errors, values = [], []
    for k in (2, 3, 4):
        model = polyhedron(shape, subdivisions=k, density_kg_m3=DENSITY)
        values.append(GravityField(model).acceleration(r))
        errors.append(np.max(np.abs(values[-1] / exact.acceleration(r) - 1.0)))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    better = (4.0 * values[2] - values[1]) / 3.0
    assert np.max(np.abs(better / exact.acceleration(r) - 1.0)) < errors[2] / 20
    heavy = polyhedron(shape, subdivisions=3, gm_m3_s2=7.0875e5)
    assert heavy.gm_m3_s2 == pytest.approx(7.0875e5, rel=1e-15)


def test_point_mass_is_its_limit() -> None:
    """The field of an icosahedron differs from a sphere's only from degree six on."""
    shape = create("shape", "ellipsoid", axes_m=(1e4, 1e4, 1e4))
    model = polyhedron(shape, subdivisions=0, density_kg_m3=DENSITY)
    field = GravityField(model)
    for distance, bound in ((3e4, 3e-4), (1e5, 1e-7)):
        r = distance * rays(30)
        np.testing.assert_allclose(field.potential(r), model.gm_m3_s2 / distance, rtol=bound)


def test_from_afar_its_moments_serve() -> None:
    """Both descriptions agree where one takes over from the other."""
    field = GravityField(polyhedron())
    way, radius = rays(40), 1000.0 * np.linalg.norm([5e3, 2.5e3, 4e3])
    near, far = (1.0 - 1e-9) * radius * way, (1.0 + 1e-9) * radius * way
    for quantity, bound in (("potential", 1e-7), ("acceleration", 3e-8), ("gradient", 1e-5)):
        one, other = (getattr(field, quantity)(r) for r in (near, far))
        size = np.abs(one).max(axis=tuple(range(one.ndim - 1)))
        assert np.max(np.abs(one - other) / size) < bound
    # the centre of mass off the origin shows: a point mass there is nearer than one here
    far = 1e5 * radius * way / np.linalg.norm(way, axis=0)
    centre = np.array([[1e3], [250.0], [1500.0]])
    gm = polyhedron().gm_m3_s2
    expected = gm / np.linalg.norm(far - centre, axis=0)
    np.testing.assert_allclose(field.potential(far), expected, rtol=1e-14)


def test_bits_do_not_depend_on_the_neighbours() -> None:
    field, r = GravityField(polyhedron()), points(64)
    whole = field.acceleration(r)
    again = field.acceleration(np.concatenate([r[:, :1], 2.0 * r[:, 1:]], axis=1))
    np.testing.assert_array_equal(whole[:, 0], again[:, 0])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match=r"a density of .* check gm and the length_unit"):
        polyhedron(gm_m3_s2=7e14)
    sphere = create("shape", "ellipsoid", axes_m=AXES)
    with pytest.raises(InputError, match="no polyhedron but a EllipsoidShape; give subdivisions"):
        polyhedron(sphere, density_kg_m3=1.0)
    with pytest.raises(InputError, match="polyhedron already"):
        polyhedron(subdivisions=3, density_kg_m3=DENSITY)
    with pytest.raises(InputError, match="keep one"):
        polyhedron(density_kg_m3=DENSITY, gm_m3_s2=1e5)
    with pytest.raises(InputError, match="mass is missing"):
        polyhedron(gravitational_constant=6.7e-11)


def werner_scheeres(mesh: Any, r: Array) -> tuple[Any, Any, Any]:
    """Potential, acceleration and gradient in extended precision, for Gρ = 1.

    Werner and Scheeres (1997), equations 10, 15 and 16, edge by edge and face by face, with the
    logarithm and the vector form of the solid angle as they are printed.
    """
    r = r.astype(np.longdouble)
    vertices = mesh.vertices.astype(np.longdouble)
    to = vertices[:, :, None] - r[None]
    distance = np.sqrt(np.sum(to * to, axis=1))
    normals = np.cross(
        vertices[mesh.faces[:, 1]] - vertices[mesh.faces[:, 0]],
        vertices[mesh.faces[:, 2]] - vertices[mesh.faces[:, 0]],
    )
    normals /= np.sqrt(np.sum(normals**2, axis=1))[:, None]
    u, a, g = 0.0, np.zeros_like(r), np.zeros((3, *r.shape), dtype=np.longdouble)
    ends, owners = mesh.edges
    for (i, j), (one, other) in zip(ends, owners, strict=True):
        side = vertices[j] - vertices[i]
        length = np.sqrt(side @ side)
        form = np.outer(normals[one], np.cross(side, normals[one]) / length)
        form += np.outer(normals[other], np.cross(-side, normals[other]) / length)
        s = distance[i] + distance[j]
        log = np.log((s + length) / (s - length))
        u = u + np.einsum("iN,ij,jN->N", to[i], form, to[i]) * log
        a -= form @ to[i] * log
        g += form[:, :, None] * log
    for (i, j, k), n in zip(mesh.faces, normals, strict=True):
        p, q, w = to[i], to[j], to[k]
        dp, dq, dw = distance[i], distance[j], distance[k]
        top = np.sum(p * np.cross(q, w, axis=0), axis=0)
        dots = dp * np.sum(q * w, axis=0) + dq * np.sum(w * p, axis=0) + dw * np.sum(p * q, axis=0)
        angle = 2.0 * np.arctan2(top, dp * dq * dw + dots)
        height = n @ p
        u = u - height**2 * angle
        a += n[:, None] * height * angle
        g -= np.outer(n, n)[:, :, None] * angle
    return 0.5 * u, a, g


@pytest.mark.skipif(
    bool(np.finfo(np.longdouble).eps > 1e-18), reason="this processor has no extended precision"
)
def test_against_extended_precision() -> None:
    """To 1e-12 of the size of each quantity, from the surface to ten radii, and inside."""
    shape = create("shape", "ellipsoid", axes_m=AXES)
    model = polyhedron(shape, subdivisions=2, density_kg_m3=DENSITY)
    r = rays(70) * np.geomspace(2e3, 130e3, 70)
    expected = werner_scheeres(model.mesh, r)
    field = GravityField(model)
    for name, values in zip(("potential", "acceleration", "gradient"), expected, strict=True):
        ours = getattr(field, name)(r)
        axes = tuple(range(ours.ndim - 1))
        size = STRENGTH * np.abs(values).max(axis=axes).astype(float)
        error = np.abs(ours - STRENGTH * values.astype(float)).max(axis=axes) / size
        assert error.max() < 1e-12


def test_points_are_not_taken_for_the_last_ones() -> None:
    """The sums of the last points are kept; an array that was changed since is another one."""
    field, r = GravityField(polyhedron()), points(3)
    first = field.acceleration(r)
    r += 100.0
    moved = field.acceleration(r)
    assert np.all(np.abs(moved - first).max(axis=0) > 1e-3 * np.abs(first).max(axis=0))
    np.testing.assert_array_equal(GravityField(polyhedron()).gradient(r), field.gradient(r))
