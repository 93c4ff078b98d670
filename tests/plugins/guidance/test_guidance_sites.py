"""Landing sites: outermost points along rays, and the normals there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere_guidance.sites import Ground

AXES = np.array([13030.0, 11400.0, 9140.0])


@pytest.mark.parametrize(
    ("lat", "lon", "place", "down"),
    [
        (12, 25, (11028.690721, 5142.762943, 2586.561225), (-0.395495, -0.240931, -0.188511)),
        (-15, 15, (11653.511524, 3122.549002, -3232.700604), (-0.416612, -0.145836, 0.234875)),
        (-11, -165, (-12014.966528, -3219.400578, -2417.859472), (0.440259, 0.154113, 0.180058)),
    ],
)
def test_sites_on_phobos(phobos: Any, lat: float, lon: float, place: Any, down: Any) -> None:
    site = Ground(phobos, np.zeros(7)).site(*np.radians([lat, lon]))
    np.testing.assert_allclose(site.position_m, place, rtol=0, atol=1e-6)
    np.testing.assert_allclose(-0.5 * site.up, down, rtol=0, atol=1e-6)


def test_sites_turn_with_the_frame() -> None:
    """In the Hill frame longitude 0 of a locked moon is towards the primary, at −x."""
    body = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    gravity = create("gravity", "ellipsoid", axes_m=tuple(AXES), density_g_cm3=1.86)
    plant = create("plant", "hill", body=body, gravity=gravity)
    ground = Ground(plant, np.zeros(6))
    np.testing.assert_allclose(ground.site(0.0, 0.0).position_m, [-13030, 0, 0], atol=1e-8, rtol=0)
    site = ground.site(0.3, np.pi / 2)
    assert site.position_m[1] < 0.0
    np.testing.assert_allclose(np.sum((site.position_m / AXES) ** 2), 1.0, rtol=1e-13)


def test_heights_and_mesh(phobos: Any) -> None:
    ground = Ground(phobos, np.zeros(7))
    random = np.random.default_rng(2)
    way = random.normal(size=(3, 30))
    way /= np.linalg.norm(way, axis=0)
    surface = 1.0 / np.sqrt(np.sum((way / AXES[:, None]) ** 2, axis=0))
    above = random.uniform(-3000.0, 20000.0, 30)
    np.testing.assert_allclose(ground.heights(way * (surface + above)), above, rtol=0, atol=1e-8)
    mesh = ground.mesh(7, 13)
    np.testing.assert_allclose(np.sum((mesh / AXES[:, None, None]) ** 2, axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(mesh[:, :, 0], mesh[:, :, -1], rtol=0, atol=1e-9)


def test_plant_without_a_surface_is_refused() -> None:
    body = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    plant = create(
        "plant", "hill", body=body, gravity=create("gravity", "point_mass", gm_km3_s2=7.1e-4)
    )
    with pytest.raises(InputError, match="no surface to land on"):
        Ground(plant, np.zeros(6))


def test_sites_on_a_polyhedron() -> None:
    """An octahedron: the faces' planes and normals are known."""
    a, b, c = 10e3, 9e3, 8e3
    shape = create(
        "shape",
        "polyhedron",
        length_unit="m",
        vertices=[(a, 0, 0), (-a, 0, 0), (0, b, 0), (0, -b, 0), (0, 0, c), (0, 0, -c)],
        faces=[
            (1, 3, 5), (3, 2, 5), (2, 4, 5), (4, 1, 5),
            (3, 1, 6), (2, 3, 6), (4, 2, 6), (1, 4, 6),
        ],
    )  # fmt: skip
    body = create(
        "body", "asteroid", semi_major_axis_m=2.2e11, rotation_rate_deg_d=1600.0, shape=shape
    )
    gravity = create("gravity", "point_mass", gm_m3_s2=4.46e5)
    plant = create(
        "plant", "three_body", body=body, gravity=gravity, orbit="elliptic", rotation="spin"
    )
    ground = Ground(plant, np.zeros(len(plant.states)))
    for lat, lon in ((0.4, 1.1), (-0.7, 2.5)):
        site = ground.site(lat, lon)
        x, y, z = site.position_m
        assert abs(x) / a + abs(y) / b + abs(z) / c == pytest.approx(1.0, rel=1e-12)
        normal = np.array([np.sign(x) / a, np.sign(y) / b, np.sign(z) / c])
        np.testing.assert_allclose(site.up, normal / np.linalg.norm(normal), rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.arctan2(y, x), lon, rtol=1e-12)


def contact_binary() -> Any:
    """Spheres of 700 m and, 1100 m off along x, of 500 m that meet in a neck, of triangles."""
    neck = (700.0**2 - 500.0**2 + 1100.0**2) / 2200.0
    first = np.linspace(np.pi, np.arccos(neck / 700.0), 13)[1:]
    second = np.linspace(np.arccos((neck - 1100.0) / 500.0), 0.0, 11)[1:-1]
    along = np.concatenate([700.0 * np.cos(first), 1100.0 + 500.0 * np.cos(second)])
    radius = np.concatenate([700.0 * np.sin(first), 500.0 * np.sin(second)])
    rings, sides = len(along), 17
    turn = 2.0 * np.pi * np.arange(sides) / sides
    vertices = [(-700.0, 0.0, 0.0), (1600.0, 0.0, 0.0)]
    for x, r in zip(along, radius, strict=True):
        vertices += [(x, r * c, r * s) for c, s in zip(np.cos(turn), np.sin(turn), strict=True)]
    faces = []
    for j in range(sides):
        k = (j + 1) % sides
        faces += [(1, 3 + k, 3 + j), (2, 3 + (rings - 1) * sides + j, 3 + (rings - 1) * sides + k)]
        for i in range(rings - 1):
            low, high = 3 + i * sides, 3 + (i + 1) * sides
            faces += [(low + j, low + k, high + j), (low + k, high + k, high + j)]
    return create("shape", "polyhedron", length_unit="m", vertices=vertices, faces=faces)


def spinning(shape: Any, prime_meridian_deg: float = 0.0) -> Any:
    body = create(
        "body", "asteroid", semi_major_axis_km=2e8, rotation_rate_deg_d=700.0, shape=shape
    )
    gravity = create("gravity", "point_mass", gm_m3_s2=40.0)
    return create("plant", "hill", body=body, gravity=gravity,
                  prime_meridian_deg=prime_meridian_deg)  # fmt: skip


def test_normals_of_a_contact_binary() -> None:
    """Some rays meet it three times: the normals are those of the faces met last."""
    shape = contact_binary()
    assert not shape.mesh.is_star_shaped
    ground = Ground(spinning(shape, 30.0), np.zeros(6))
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    a, b, c = shape.mesh.corners
    places = [(0.1, 0.2), (0.3, -0.28), (-0.41, 0.1), (0.7, 2.5), (-0.4, -2.0), (0.02, 0.01)]
    for lat, lon in places:
        site = ground.site(lat, lon)
        own = turn.T @ site.position_m
        # the face's plane that the site is on, and inside of its three sides
        beside = [np.sum(np.cross(q - p, own[:, None] - p, axis=0) * shape.mesh.normals, axis=0)
                  for p, q in ((a, b), (b, c), (c, a))]  # fmt: skip
        on = np.abs(shape.mesh.heights - shape.mesh.normals.T @ own) < 1e-6
        (face,) = np.flatnonzero(on & (np.min(beside, axis=0) > 0.0))
        np.testing.assert_allclose(turn.T @ site.up, shape.mesh.normals[:, face], atol=1e-9)


def test_normals_of_an_ellipsoid_and_of_harmonics() -> None:
    """Analytic; and two degrees of harmonics by differences of the event."""
    ground = Ground(spinning(create("shape", "ellipsoid", axes_m=tuple(AXES))), np.zeros(6))
    harmonics = create(
        "shape", "harmonics", length_unit="km",
        coefficients=[[0, 0, 7.3, 0], [2, 0, -1.1, 0], [2, 2, 1.1, -0.9]],
    )  # fmt: skip
    other = Ground(spinning(harmonics, 40.0), np.zeros(6))
    for lat, lon in ((0.4, 1.1), (-0.7, 2.5)):
        site = ground.site(lat, lon)
        normal = site.position_m / AXES**2
        np.testing.assert_allclose(site.up, normal / np.linalg.norm(normal), rtol=0, atol=1e-9)
        site = other.site(lat, lon)
        slope = other.slopes(site.position_m[:, None])[:, 0]
        np.testing.assert_allclose(site.up, slope / np.linalg.norm(slope), rtol=0, atol=1e-9)


def test_a_tilted_body_has_no_sites() -> None:
    shape = create("shape", "ellipsoid", axes_m=(800.0, 500.0, 300.0))
    body = create(
        "body", "asteroid", semi_major_axis_km=2e8, rotation_rate_deg_d=700.0, obliquity_deg=30.0,
        shape=shape,
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=40.0)
    plant = create("plant", "proximity", body=body, gravity=gravity, spacecraft=[{}])
    with pytest.raises(InputError, match="tilted"):
        Ground(plant, np.zeros(6)).site(0.4, 1.0)
