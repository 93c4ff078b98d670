"""Spherical harmonics against published values, closed forms and independent recursions."""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import lpmv

from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere_gravity.harmonics import Harmonics, normalisation_factor
from hillsphere_gravity.specs import HarmonicsSpec

Array = NDArray[np.float64]
Triangle = Mapping[tuple[int, int], tuple[float, float]]

# Chao and Rubincam (1989), The gravitational field of Phobos, GRL 16(8), 859: 1e-2, normalised.
PHOBOS: Triangle = {
    (2, 0): (-4.698, 0.0), (2, 1): (0.136, 0.138), (2, 2): (2.276, -0.0202),
    (3, 0): (0.293, 0.0), (3, 1): (-0.309, 0.181), (3, 2): (-0.847, -0.0655),
    (3, 3): (0.224, -1.392),
    (4, 0): (0.762, 0.0), (4, 1): (0.347, -0.0776), (4, 2): (-0.288, -0.112),
    (4, 3): (-0.280, 0.337), (4, 4): (-0.120, -0.0622),
}  # fmt: skip
GM = 7.087546066894452e5
RADIUS = 11100.0


def keys(
    triangle: Triangle, *, factor: float = 1.0, gm: float = GM, **changes: Any
) -> dict[str, Any]:
    return {
        "gm_m3_s2": gm,
        "reference_radius_m": RADIUS,
        "normalisation": "full",
        "tide_system": "none",
        "coefficients": [
            {"n": n, "m": m, "c": factor * c, "s": factor * s}
            for (n, m), (c, s) in triangle.items()
        ],
        **changes,
    }


def model(triangle: Triangle, **options: Any) -> Harmonics:
    return Harmonics(HarmonicsSpec.model_validate(keys(triangle, **options)))


def phobos() -> GravityField:
    return GravityField(model(PHOBOS, factor=1e-2))


def random_triangle(degree: int, seed: int = 5) -> Triangle:
    """Coefficients that fall with Kaula's 1/n²."""
    rng = np.random.default_rng(seed)
    return {
        (n, m): (float(rng.normal()) / n**2, float(rng.normal()) / n**2 if m else 0.0)
        for n in range(1, degree + 1)
        for m in range(n + 1)
    }


def random_points(n: int, seed: int = 6) -> Array:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(3, n))
    return np.asarray(
        directions / np.linalg.norm(directions, axis=0) * RADIUS * rng.uniform(1.1, 4.0, n)
    )


def legendre_series(triangle: Triangle, r: Array) -> Array:
    """U summed term by term with SciPy's associated Legendre functions."""
    distance = np.linalg.norm(r, axis=0)
    sine, longitude = r[2] / distance, np.arctan2(r[1], r[0])
    total = np.ones_like(distance)
    for (n, m), (c, s) in triangle.items():
        norm = sqrt((2 - (m == 0)) * (2 * n + 1) * factorial(n - m) / factorial(n + m))
        # SciPy's functions hold the Condon–Shortley phase.
        legendre = (-1) ** m * norm * lpmv(m, n, sine)
        wave = c * np.cos(m * longitude) + s * np.sin(m * longitude)
        total += (RADIUS / distance) ** n * legendre * wave
    return np.asarray(GM / distance * total)


def cunningham_series(triangle: Triangle, r: NDArray[Any]) -> Any:
    """U by Cunningham's Cartesian recursion, unnormalised; holds for complex r.

    Montenbruck and Gill (2000), Satellite Orbits, eqs. 3.29–3.31 (V_nm + i W_nm).
    """
    degree = max(n for n, _ in triangle)
    square = np.sum(r**2)
    x, y, z = RADIUS * r / square
    v = np.zeros((degree + 1, degree + 1), dtype=complex)
    w = np.zeros_like(v)
    v[0, 0] = RADIUS / np.sqrt(square)
    for m in range(degree + 1):
        if m:
            v[m, m] = (2 * m - 1) * (x * v[m - 1, m - 1] - y * w[m - 1, m - 1])
            w[m, m] = (2 * m - 1) * (x * w[m - 1, m - 1] + y * v[m - 1, m - 1])
        for n in range(m + 1, degree + 1):
            for q in (v, w):
                below = q[n - 2, m] if n - 2 >= m else 0.0
                q[n, m] = (
                    (2 * n - 1) * z * q[n - 1, m] - (n + m - 1) * RADIUS**2 / square * below
                ) / (n - m)
    total = v[0, 0]
    for (n, m), (c, s) in triangle.items():
        norm = sqrt((2 - (m == 0)) * (2 * n + 1) * factorial(n - m) / factorial(n + m))
        total += norm * (c * v[n, m] + s * w[n, m])
    return GM / RADIUS * total


def test_phobos_chao_rubincam_degree_4() -> None:
    # Potential, acceleration and Hessian of this field, evaluated with R = 11.1 km and the GM of
    # ephemeris MAR097; the independent recursions below give the same digits.
    r = np.array([[16560.0, 0.0, 0.0], [12000.0, 5000.0, 3000.0]]).T
    field = phobos()
    np.testing.assert_allclose(
        field.potential(r), [44.87443263254497, 55.09165334602548], rtol=1e-15
    )
    first = [-2.979191482638818e-3, -7.209567883658134e-5, -5.875740783583535e-5]
    second = [-3.781440166916e-3, -1.790287975027e-3, -1.341277116722e-3]
    np.testing.assert_allclose(field.acceleration(r)[:, 0], first, rtol=3e-15)
    # Thirteen digits are printed.
    np.testing.assert_allclose(field.acceleration(r)[:, 1], second, rtol=4e-13)
    xx, xy, xz = 4.207349644506737e-7, 3.531623862355876e-7, 3.127066277568274e-7
    yy, yz = -1.383992145759088e-7, 1.743368098191040e-7
    expected = [[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]]
    np.testing.assert_allclose(field.gradient(r)[..., 1], expected, rtol=3e-15)


@pytest.mark.parametrize("degree", [1, 2, 4, 8, 20])
def test_agrees_with_independent_recursions(degree: int) -> None:
    triangle = random_triangle(degree)
    field = GravityField(model(triangle))
    points = random_points(25)
    np.testing.assert_allclose(
        field.potential(points), legendre_series(triangle, points), rtol=1.3e-14
    )
    found = field.acceleration(points)
    step = 1e-20
    for k in range(points.shape[1]):
        r = points[:, k]
        expected = [cunningham_series(triangle, r + 1j * step * e).imag / step for e in np.eye(3)]
        assert np.linalg.norm(found[:, k] - expected) <= 6e-15 * np.linalg.norm(expected)


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_poles_closed_form(pole: float) -> None:
    # At z = ±r only m = 0 acts along z and m = 1 across: Pn0(±1) = (±1)^n and
    # Pn1 → (±1)^(n+1) n(n+1)/2 cos φ.
    triangle = random_triangle(12)
    distance = 1.4 * RADIUS
    expected = np.zeros(3)
    expected[2] = -pole * GM / distance**2
    for (n, m), (c, s) in triangle.items():
        power = GM / distance**2 * (RADIUS / distance) ** n
        if m == 0:
            expected[2] -= pole * power * (n + 1) * sqrt(2 * n + 1) * pole**n * c
        if m == 1:
            slope = sqrt(2 * (2 * n + 1) / (n * (n + 1))) * n * (n + 1) / 2 * pole ** (n + 1)
            expected[:2] += power * slope * np.array([c, s])
    field = GravityField(model(triangle))
    at_pole = np.array([0.0, 0.0, pole * distance])
    np.testing.assert_allclose(field.acceleration(at_pole), expected, rtol=1e-14)
    gradient = field.gradient(at_pole)
    assert np.all(np.isfinite(gradient))
    near = field.gradient(at_pole + np.array([1e-6, -2e-6, 0.0]))
    assert np.max(np.abs(near - gradient)) <= 3e-9 * np.max(np.abs(gradient))


def test_laplace() -> None:
    field = phobos()
    diagonal = np.einsum("iiN->iN", field.gradient(random_points(300)))
    assert np.max(np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)) <= 2.5e-14


def test_unnormalised_equals_normalised() -> None:
    triangle = random_triangle(10)
    conventional = {
        (n, m): (c * normalisation_factor(n, m), s * normalisation_factor(n, m))
        for (n, m), (c, s) in triangle.items()
    }
    points = random_points(20)
    plain = GravityField(model(conventional, normalisation="none"))
    full = GravityField(model(triangle))
    np.testing.assert_allclose(plain.potential(points), full.potential(points), rtol=1e-15)
    size = np.linalg.norm(full.acceleration(points), axis=0)
    difference = plain.acceleration(points) - full.acceleration(points)
    assert np.max(np.linalg.norm(difference, axis=0) / size) <= 1e-15


@pytest.mark.parametrize(
    ("n", "m", "expected"), [(0, 0, 1.0), (1, 1, sqrt(3)), (2, 0, sqrt(5)), (2, 2, sqrt(5 / 12))]
)
def test_normalisation_factor(n: int, m: int, expected: float) -> None:
    assert normalisation_factor(n, m) == pytest.approx(expected, rel=1e-15)


def test_normalisation_factor_bears_high_degrees() -> None:
    # √(2 (2n+1) / (2n)!) at n = m = 80, the factorial an exact integer.
    exact = sqrt(322) / sqrt(factorial(160))
    assert normalisation_factor(80, 80) == pytest.approx(exact, rel=1e-15)


def test_truncation_equals_the_shorter_table() -> None:
    triangle = random_triangle(6)
    points = random_points(15)
    cut = {(n, m): v for (n, m), v in triangle.items() if n <= 4 and m <= 2}
    long = model(triangle, max_degree=4, max_order=2)
    short = model(cut)
    assert (long.degree, long.order) == (4, 2)
    assert {q.name for q in long.parameters()} == {q.name for q in short.parameters()}
    np.testing.assert_array_equal(
        GravityField(long).potential(points), GravityField(short).potential(points)
    )
    point_mass = GravityField(model(triangle, max_degree=0))
    np.testing.assert_allclose(
        point_mass.potential(points), GM / np.linalg.norm(points, axis=0), rtol=1e-15
    )


def test_zonal_terms_may_go_further_than_tesseral_ones() -> None:
    triangle = random_triangle(6)
    points = random_points(15)
    cut = {(n, m): v for (n, m), v in triangle.items() if m == 0 or n <= 4}
    np.testing.assert_array_equal(
        GravityField(model(triangle, max_tesseral_degree=4)).potential(points),
        GravityField(model(cut)).potential(points),
    )


def test_degree_one_moves_the_centre_of_mass() -> None:
    # To first order C̄10 = z/(√3 R), C̄11 = x/(√3 R), S̄11 = y/(√3 R).
    offset = np.array([30.0, -20.0, 10.0])
    c11, s11, c10 = offset / (sqrt(3) * RADIUS)
    field = GravityField(model({(1, 0): (c10, 0.0), (1, 1): (c11, s11)}))
    r = np.array([1e7, 2e7, -1.5e7])
    distance = np.linalg.norm(r)
    expected = GM / distance + GM * (offset @ r) / distance**3
    assert field.potential(r) == pytest.approx(expected, rel=1e-15)


def test_c00_multiplies_the_mass() -> None:
    half = model({(0, 0): (0.5, 0.0), (2, 0): (0.01, 0.0)})
    assert half.gm_m3_s2 == 0.5 * GM
    assert [q.name for q in half.parameters()] == ["gm", "C2,0"]
    r = np.array([1e9, 0.0, 0.0])
    assert GravityField(half).potential(r) == pytest.approx(0.5 * GM / 1e9, rel=1e-11)


def test_run_time_coefficients_equal_compiled_constants() -> None:
    names = ["S2,2", "gm", "C3,0"]
    field = GravityField(model(PHOBOS, factor=1e-2), names)
    points = random_points(12)
    changed = dict(PHOBOS)
    changed[2, 2], changed[3, 0] = (2.276, 1.5), (-0.7, 0.0)
    other = GravityField(model(changed, factor=1e-2, gm=8e5))
    values = np.array([1.5e-2, 8e5, -0.7e-2])
    for name in ("potential", "acceleration", "gradient"):
        found, expected = getattr(field, name)(points, values), getattr(other, name)(points)
        scale = np.abs(expected).max(axis=tuple(range(expected.ndim - 1)))
        assert np.all(np.abs(found - expected) <= 2e-15 * scale)
    # One value per point.
    spread = np.repeat(values[:, None], points.shape[1], axis=1)
    spread[0] = np.linspace(-1e-2, 1e-2, points.shape[1])
    assert len(set(field.potential(points, spread) - field.potential(points, values))) > 10


GFC = """free text; radius 1
begin_of_head ====
product_type gravity_field
modelname test
earth_gravity_constant 7.087546066894452d+05
radius 1.11D+04
max_degree 3
errors no
{head}
end_of_head ====
gfc 0 0 1.0 0.0
gfc 2 0 -4.698d-02 0
gfc 2 2 2.276e-02 -2.02e-04
gfc 3 1 -3.09e-03 1.81e-03
"""
ROWS: Triangle = {
    (2, 0): (-4.698e-2, 0.0),
    (2, 2): (2.276e-2, -2.02e-4),
    (3, 1): (-3.09e-3, 1.81e-3),
}


def from_file(tmp_path: Path, head: str, **options: Any) -> Harmonics:
    path = tmp_path / "field.gfc"
    path.write_text(GFC.format(head=head))
    return Harmonics(HarmonicsSpec.model_validate({"file": str(path), **options}))


def test_icgem_file_equals_the_table(tmp_path: Path) -> None:
    found = from_file(tmp_path, "norm fully_normalized\ntide_system zero_tide")
    assert (found.normalisation, found.tide_system) == ("full", "zero_tide")
    assert found.reference_radius_m == RADIUS
    points = random_points(10)
    np.testing.assert_allclose(
        GravityField(found).potential(points),
        GravityField(model(ROWS)).potential(points),
        rtol=1e-15,
    )


def test_shadr_file_equals_the_table(tmp_path: Path) -> None:
    path = tmp_path / "field.tab"
    rows = "\n".join(f"{n}, {m}, {c:.17E}, {s:.17E}" for (n, m), (c, s) in ROWS.items())
    path.write_text(f"11.1, 7.087546066894452E-04, 0.0, 3, 3, 1, 0.0, 0.0\n{rows}\n")
    found = Harmonics(HarmonicsSpec.model_validate({"file": str(path), "tide_system": "none"}))
    points = random_points(10)
    np.testing.assert_allclose(
        GravityField(found).potential(points),
        GravityField(model(ROWS)).potential(points),
        rtol=2e-15,
    )


@pytest.mark.parametrize(
    ("head", "options", "message"),
    [
        ("norm fully_normalized", {}, "field.gfc does not state tide_system; give it beside file"),
        ("tide_system zero_tide", {}, "field.gfc does not state normalisation; give it"),
        (
            "norm fully_normalized\ntide_system zero_tide",
            {"tide_system": "tide_free"},
            "tide_system is tide_free, but .*field.gfc states zero_tide; leave it out",
        ),
        (
            "norm fully_normalized\ntide_system zero_tide",
            {"gm_m3_s2": 7e5},
            "gm_m3_s2 is 700000.0, but .*field.gfc states 708754.6",
        ),
        (
            "norm fully_normalized\ntide_system zero_tide",
            {"max_degree": 4},
            "max_degree must be ≤ 3, the degree of .*field.gfc, got 4",
        ),
        (
            "norm fully_normalized\ntide_system zero_tide",
            {"max_order": 4},
            "max_order must be ≤ 3, the degree used, got 4",
        ),
        (
            "norm fully_normalized\ntide_system zero_tide",
            {"max_tesseral_degree": 4},
            "max_tesseral_degree must be ≤ 3, the degree used, got 4",
        ),
    ],
)
def test_file_against_the_spec(
    tmp_path: Path, head: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        from_file(tmp_path, head, **options)
