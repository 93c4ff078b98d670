"""The series of a mesh against closed forms and against the polyhedron itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext
from hillsphere_gravity.mesh_harmonics import mesh_coefficients, mesh_series
from hillsphere_gravity.polyhedron import mesh_of
from hillsphere_orbits.qso.forecast import warn_of_slow_gravity

DENSITY = 1860.0
AXES = (13030.0, 11400.0, 9140.0)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(x: Any, y: Any, z: Any) -> Any:
    corners = [(a, b, c) for a in x for b in y for c in z]
    faces = [(side[0] + 1, side[i] + 1, side[i + 1] + 1) for side in SIDES for i in (1, 2)]
    return create("shape", "polyhedron", vertices=corners, faces=faces, length_unit="m")


def ellipsoid() -> Any:
    return create("shape", "ellipsoid", axes_m=AXES)


CUBE = box(*3 * [(-3e3, 3e3)])
LOPSIDED = box((-3e3, 5e3), (-2e3, 2.5e3), (-1e3, 4e3))


def rays(count: int) -> Array:
    vectors = np.random.default_rng(11).normal(size=(3, count))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0))


def degree_two(second_moments: Array, radius: float) -> tuple[float, float]:
    """C̄20 and C̄22 of the means of x², y², z² (Montenbruck and Gill 2000, equation 3.27)."""
    xx, yy, zz = second_moments / radius**2
    return (zz - 0.5 * (xx + yy)) / np.sqrt(5.0), (xx - yy) / 4.0 * np.sqrt(12.0 / 5.0)


def test_ellipsoid_in_closed_form() -> None:
    """⟨x²⟩ = a²/5; with 20 480 faces the triangles lie 2e-3 of the radius inside at most."""
    mesh = mesh_of(ellipsoid(), 5)
    table = mesh_coefficients(mesh, 3)
    c20, c22 = degree_two(np.square(AXES) / 5.0, mesh.largest_radius_m)
    assert table[0, 0] == pytest.approx(1.0, abs=1e-13)
    assert table[2, 0].real == pytest.approx(c20, rel=2e-3)
    assert table[2, 2].real == pytest.approx(c22, rel=2e-3)
    assert np.abs(table[[1, 3]]).max() < 1e-6


def test_cuboid_in_closed_form() -> None:
    """Centre of mass and, of a box about the origin, ⟨x²⟩ = (side/2)²/3; a cube has none of two."""
    table = mesh_coefficients(LOPSIDED.mesh, 2)
    radius = LOPSIDED.mesh.largest_radius_m
    centre = np.array([1e3, 250.0, 1.5e3]) / radius / np.sqrt(3.0)
    np.testing.assert_allclose(
        [table[1, 1].real, table[1, 1].imag, table[1, 0].real], centre, atol=1e-14
    )
    bar = box((-4e3, 4e3), (-3e3, 3e3), (-1e3, 1e3)).mesh
    c20, c22 = degree_two(np.array([16e6, 9e6, 1e6]) / 3.0, bar.largest_radius_m)
    two = mesh_coefficients(bar, 2)[2]
    np.testing.assert_allclose([two[0].real, two[2].real], [c20, c22], atol=1e-14)
    assert np.abs(mesh_coefficients(CUBE.mesh, 3)[1:]).max() < 1e-15


@pytest.mark.parametrize("shape", ["ellipsoid", "cube", "lopsided"])
def test_the_bound_is_never_exceeded(shape: str) -> None:
    """At 200 points from the sphere out to three times as far, for degree 4."""
    made = {"ellipsoid": ellipsoid(), "cube": CUBE, "lopsided": LOPSIDED}[shape]
    divided = {"subdivisions": 1} if shape == "ellipsoid" else {}
    keys = {"shape": made, "density_kg_m3": DENSITY, **divided}
    exact: Any = create("gravity", "polyhedron", **keys)
    start = 1.5 * exact.largest_radius_m
    series: Any = create("gravity", "shape_harmonics", **keys, series_from_m=start, max_degree=4)
    r = rays(200) * np.concatenate([np.full(100, start), np.linspace(1.0, 3.0, 100) * start])
    distance = np.linalg.norm(r, axis=0)
    difference = GravityField(series).acceleration(r) - GravityField(exact).acceleration(r)
    error = np.linalg.norm(difference, axis=0) * distance**2 / exact.gm_m3_s2
    assert error.max() <= series.error_bound
    # a bound far above the error would ask for degrees that nothing needs
    assert series.error_bound < 60.0 * error.max()
    potential = GravityField(series).potential(r) - GravityField(exact).potential(r)
    # each degree of the potential is at most 1/(n+1) of the bound of its gradient
    assert np.all(np.abs(potential) * distance / exact.gm_m3_s2 <= series.error_bound / 5.0)
    relative = np.linalg.norm(difference, axis=0)
    relative /= np.linalg.norm(GravityField(exact).acceleration(r), axis=0)
    np.testing.assert_allclose(series.acceleration_error(r), relative, rtol=1e-6)


def test_the_bound_falls_to_the_tolerance() -> None:
    mesh = mesh_of(ellipsoid(), 1)
    start = 2.0 * mesh.largest_radius_m
    found = [mesh_series(mesh, start, tolerance, 30) for tolerance in (1e-3, 1e-6, 1e-9)]
    for series, tolerance in zip(found, (1e-3, 1e-6, 1e-9), strict=True):
        assert series.bound <= tolerance
        assert series.degree == series.enough
    assert found[0].degree < found[1].degree < found[2].degree


def test_the_default_compiles_soon_and_tells_its_error(caplog: pytest.LogCaptureFixture) -> None:
    series: Any = create(
        "gravity", "shape_harmonics", shape=ellipsoid(), subdivisions=2, density_kg_m3=DENSITY
    )
    assert series.degree == 8
    assert series.holds_from_m == 1.5 * series.largest_radius_m
    assert f"errs by up to {series.error_bound:.1e} of GM/r²" in caplog.text
    assert "needs max_degree = " in caplog.text
    assert f"{series.error_bound:.1e}" in series.describe()[1]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match=r"likely in km instead of m, which would be 13\.0"):
        create(
            "gravity", "shape_harmonics", density_kg_m3=DENSITY, subdivisions=1,
            shape=create("shape", "ellipsoid", axes_m=(13.03, 11.4, 9.14)),
        )  # fmt: skip
    with pytest.raises(InputError, match=r"outside the sphere that holds it"):
        create(
            "gravity", "shape_harmonics", shape=CUBE, density_kg_m3=DENSITY, series_from_m=5100.0
        )


def hill(gravity: Any) -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377
    )
    return create("plant", "hill", body=body, gravity=gravity)


@pytest.mark.slow  # the equations compile for several seconds
def test_a_family_ends_at_the_sphere_and_states_the_error() -> None:
    """Degree 2 of 80 faces: small, so that the equations compile soon."""
    series: Any = create(
        "gravity", "shape_harmonics", shape=ellipsoid(), subdivisions=1, density_kg_m3=DENSITY,
        max_degree=2,
    )  # fmt: skip
    stage = create(
        "stage", "qso_family", plant=hill(series), x_amplitudes_km=[40], x_max_km=50,
        curve_members=21, drift_revolutions=1,
    )  # fmt: skip
    product = stage.run(RecordingContext())
    assert "the sphere of 19.5" in product.ends[1]
    assert product.nearest_m == pytest.approx(series.holds_from_m, rel=1e-3)
    metric = float(stage.present(product).metrics["gravity_error_max"].value)
    assert 0.0 < metric < 1.2 * series.error_bound


def test_a_polyhedron_in_a_family_is_told_before(caplog: pytest.LogCaptureFixture) -> None:
    """Of 20 480 faces it takes minutes on any processor; a series is no matter of evaluations."""
    many = create("gravity", "polyhedron", shape=ellipsoid(), subdivisions=5, density_kg_m3=DENSITY)
    create("stage", "qso_family", plant=hill(many), x_amplitudes_km=[40])
    assert "min of CPU time" in caplog.text
    assert "shape_harmonics" in caplog.text
    caplog.clear()
    warn_of_slow_gravity(hill(create("gravity", "point_mass", gm_m3_s2=7e5)))
    assert not caplog.messages
