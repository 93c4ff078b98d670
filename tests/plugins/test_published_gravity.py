"""Gravity against published fields and closed forms: Phobos' harmonics, spheroids, ellipsoids.

References
----------
.. [1] B. F. Chao and D. P. Rubincam (1989), "The gravitational field of Phobos", Geophysical
   Research Letters 16(8), 859-862: coefficients to degree 4.
.. [2] S. Chandrasekhar (1969), "Ellipsoidal Figures of Equilibrium", Yale University Press,
   chapter 3: index symbols, spheroids, exterior potential.
.. [3] W. M. Kaula (1966), "Theory of Satellite Geodesy", Blaisdell, chapter 1: normalisation.
"""

from __future__ import annotations

from math import asin, atanh, factorial, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import legendre, polynomial
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.gravity import GravityField

Array = NDArray[Any]

GM = 7.087546066894452e5  # m³/s², Phobos, JPL ephemeris MAR097
RADIUS = 11_100.0  # m

# (n, m): fully normalised C, S [1]
COEFFICIENTS = {
    (2, 0): (-4.698e-2, 0.0),
    (2, 1): (0.136e-2, 0.138e-2),
    (2, 2): (2.276e-2, -0.0202e-2),
    (3, 0): (0.293e-2, 0.0),
    (3, 1): (-0.309e-2, 0.181e-2),
    (3, 2): (-0.847e-2, -0.0655e-2),
    (3, 3): (0.224e-2, -1.392e-2),
    (4, 0): (0.762e-2, 0.0),
    (4, 1): (0.347e-2, -0.0776e-2),
    (4, 2): (-0.288e-2, -0.112e-2),
    (4, 3): (-0.280e-2, 0.337e-2),
    (4, 4): (-0.120e-2, -0.0622e-2),
}

PHOBOS_AXES_M = (13_030.0, 11_400.0, 9_140.0)
PHOBOS_MU = 705_965.07848715136715  # m³/s² = (4π/3) G ρ abc, G = 6.674e-11 SI, ρ = 1860 kg/m³
GRAVITATIONAL_CONSTANT = 6.674e-11

# Largest relative residuals measured: 1.3e-15 in values and gradients, 1.6e-14 in the scaled trace
# of the gradient.
EXACT = 5e-15
LAPLACE = 5e-14


def norm(n: int, m: int) -> float:
    """Factor from the unnormalised to the fully normalised Legendre function [3]."""
    return sqrt((2 if m else 1) * (2 * n + 1) * factorial(n - m) / factorial(n + m))


def phobos_harmonics(normalisation: str = "full") -> GravityField:
    rows = []
    for (n, m), (c, s) in COEFFICIENTS.items():
        factor = 1.0 if normalisation == "full" else norm(n, m)
        rows.append({"n": n, "m": m, "c": c * factor, "s": s * factor})
    return GravityField(
        create(
            "gravity",
            "harmonics",
            gm_m3_s2=GM,
            reference_radius_km=RADIUS / 1e3,
            normalisation=normalisation,
            tide_system="unknown",
            coefficients=rows,
        )
    )


def ellipsoid(axes_m: tuple[float, float, float], gm_m3_s2: float) -> GravityField:
    return GravityField(create("gravity", "ellipsoid", axes_m=list(axes_m), gm_m3_s2=gm_m3_s2))


def phobos_ellipsoid() -> GravityField:
    return GravityField(
        create(
            "gravity",
            "ellipsoid",
            axes_km=[13.03, 11.40, 9.14],
            density_g_cm3=1.860,
            gravitational_constant=GRAVITATIONAL_CONSTANT,
        )
    )


def column(*r: float) -> NDArray[np.float64]:
    return np.array(r, dtype=float)[:, None]


def random_directions(count: int, seed: int) -> NDArray[np.float64]:
    raw = np.random.default_rng(seed).normal(size=(3, count))
    unit: NDArray[np.float64] = raw / np.linalg.norm(raw, axis=0)
    return unit


def solid_harmonics_potential(r: Array) -> Array:
    """U as polynomials of x, y and of z/r: no angle, no pole, analytic in each coordinate.

    P_nm = (1 - u²)^(m/2) d^m P_n/du^m and cos^m(φ) e^(imλ) = ((x + iy)/r)^m.
    """
    x, y, z = r
    distance = np.sqrt(x * x + y * y + z * z)
    total: Array = GM / distance
    for (n, m), (c, s) in COEFFICIENTS.items():
        derivative = polynomial.polyder(legendre.leg2poly([0.0] * n + [1.0]), m)
        real, imaginary = np.ones_like(x), np.zeros_like(x)
        for _ in range(m):
            real, imaginary = real * x - imaginary * y, real * y + imaginary * x
        total = total + (
            GM
            / RADIUS
            * (RADIUS / distance) ** (n + 1)
            * norm(n, m)
            * polynomial.polyval(z / distance, derivative)
            * (c * real + s * imaginary)
            / distance**m
        )
    return total


# The sum with the coefficients above, evaluated and differentiated with 40 digits:
# r m; U m²/s²; ∇U m/s²; ∇∇U 1/s² as xx, xy, xz, yy, yz, zz.
HARMONICS_VALUES = [
    (
        (16560.0, 0.0, 0.0),
        44.874432632544968,
        (-2.9791914826388179e-3, -7.2095678836581342e-5, -5.8757407835835363e-5),
        (
            *(4.126803635382704e-7, 2.1768706257909796e-8, 1.9441439552036837e-8),
            *(-1.9374876214883811e-7, 2.2318629672802021e-9, -2.189316013894323e-7),
        ),
    ),
    (
        (12000.0, 5000.0, 3000.0),
        55.091653346025469,
        (-3.7814401669161703e-3, -1.7902879750267892e-3, -1.3412771167223029e-3),
        (
            *(4.207349644506738e-7, 3.5316238623558769e-7, 3.1270662775682745e-7),
            *(-1.383992145759088e-7, 1.7433680981910399e-7, -2.82335749874765e-7),
        ),
    ),
    (
        (0.0, 0.0, 14000.0),
        47.935103914841772,
        (2.2921900389149324e-5, 2.2770821856196856e-5, -3.1189215410867683e-3),
        (
            *(-2.0370633593929726e-7, -3.2916439187127621e-9, -1.0691179831765945e-8),
            *(-1.98153805044776e-7, -6.5132171133328274e-9, 4.0186014098407326e-7),
        ),
    ),
    (
        (0.0, 0.0, -9140.0),
        68.309149895583662,
        (-9.777401531665333e-4, 2.4723594795291982e-4, 6.1787898191511695e-3),
        (
            *(-4.8085724551866206e-7, -3.5422417210668331e-8, -5.9412618565782989e-7),
            *(-7.7676008218679501e-7, 1.5743086827973526e-7, 1.2576173277054571e-6),
        ),
    ),
]

# Exterior and interior potential of a homogeneous ellipsoid [2] for PHOBOS_AXES_M and PHOBOS_MU,
# evaluated with 30 digits: the integrals by quadrature and by Carlson's forms, which agree to 20.
# Same columns as above.
# The gradient jumps at the surface, so points on it have none.
ELLIPSOID_VALUES = [
    (
        (20000.0, -7000.0, 5000.0),
        33.133090574583484,
        (-1.4421156346457529e-3, 5.3167539760100401e-4, -4.0556807032272494e-4),
        (
            *(1.1300760796405355e-7, -7.0600503229763584e-8, 5.631693531403142e-8),
            *(-4.9027261289660441e-8, -2.1478748674263235e-8, -6.398034667439311e-8),
        ),
    ),
    (
        (-90000.0, 60000.0, 30000.0),
        6.2929042257990091,
        (4.4964086085681835e-5, -3.0032980630392042e-5, -1.5049831800028356e-5),
        (
            *(4.6315512177708036e-10, -6.4386942629311933e-10, -3.2312726926393907e-10),
            *(-6.9944410204991415e-11, 2.1610018796383071e-10, -3.9321071157208895e-10),
        ),
    ),
    (
        (0.0, 13000.0, 0.0),
        54.678318472353772,
        (0.0, -4.2900101182758769e-3, 0.0),
        (-2.8974830154260907e-7, 0.0, 0.0, 6.8827412348287099e-7, 0.0, -3.9852582194026192e-7),
    ),
    (
        (3000.0, -2000.0, 1000.0),
        91.617308781347108,
        (-1.2621448109893687e-3, 9.9308985760122075e-4, -6.4268414333526944e-4),
        (-4.2071493699645622e-7, 0.0, 0.0, -4.9654492880061038e-7, 0.0, -6.4268414333526944e-7),
    ),
    ((13030.0, 0.0, 0.0), 59.1102776037492, (-5.4819156290638246e-3, 0.0, 0.0), None),
    ((0.0, 0.0, 9140.0), 67.980169796814479, (0.0, 0.0, -5.8741330700843627e-3), None),
]


def symmetric(six: tuple[float, ...]) -> NDArray[np.float64]:
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("normalisation", ["full", "none"])
@pytest.mark.parametrize(("r", "u", "g", "gradient"), HARMONICS_VALUES)
def test_phobos_harmonics_chao_rubincam_1989(
    r: tuple[float, ...],
    u: float,
    g: tuple[float, ...],
    gradient: tuple[float, ...],
    normalisation: str,
) -> None:
    field = phobos_harmonics(normalisation)
    assert field.potential(column(*r))[0] == pytest.approx(u, rel=EXACT)
    np.testing.assert_allclose(field.acceleration(column(*r))[:, 0], g, rtol=EXACT)
    np.testing.assert_allclose(
        field.gradient(column(*r))[:, :, 0],
        symmetric(gradient),
        rtol=EXACT,
        atol=EXACT * np.abs(gradient).max(),
    )


@pytest.mark.parametrize("z", [9140.0, -9140.0, 14_000.0, -14_000.0, 60_000.0])
def test_harmonics_at_the_poles(z: float) -> None:
    """On the axis only the orders 0, 1 and 2 are left, each a power of R/r.

    As cos φ → 0: P_n1 → cos φ n(n+1)/2 and P_n2 → cos²φ (n+2)!/(8 (n-2)!), with a sign
    (-1)^(n+m) at the south pole.
    """
    r, north = abs(z), np.sign(z)
    u = GM / r
    g = np.array([0.0, 0.0, -GM / r**2 * north])
    hessian = GM / r**3 * np.diag([-1.0, -1.0, 2.0])
    for (n, m), (c, s) in COEFFICIENTS.items():
        size = GM / r * (RADIUS / r) ** n * norm(n, m) * north ** (n + m)
        if m == 0:
            u += size * c
            g[2] -= (n + 1) * size * c / r * north
            hessian += (n + 1) * (n + 2) * size * c / r**2 * np.diag([-0.5, -0.5, 1.0])
        elif m == 1:
            slope = size / r * n * (n + 1) / 2 * np.array([c, s])
            g[:2] += slope
            hessian[:2, 2] -= (n + 2) * slope / r * north
            hessian[2, :2] -= (n + 2) * slope / r * north
        elif m == 2:
            bend = 2 * size / r**2 * factorial(n + 2) / (8 * factorial(n - 2))
            hessian[:2, :2] += bend * np.array([[c, s], [s, -c]])
    field = phobos_harmonics()
    assert field.potential(column(0, 0, z))[0] == pytest.approx(u, rel=EXACT)
    np.testing.assert_allclose(field.acceleration(column(0, 0, z))[:, 0], g, rtol=EXACT)
    np.testing.assert_allclose(
        field.gradient(column(0, 0, z))[:, :, 0],
        hessian,
        rtol=EXACT,
        atol=EXACT * np.abs(hessian).max(),
    )


def test_harmonics_against_solid_harmonics_and_complex_step() -> None:
    """Everywhere on the sphere, within a whisker of the poles too."""
    directions = np.concatenate(
        [random_directions(300, 1), [[1e-9, -1e-7], [1e-8, 0.0], [1.0, -1.0]]], axis=1
    )
    r = directions * np.random.default_rng(2).uniform(12e3, 80e3, directions.shape[1])
    field = phobos_harmonics()
    np.testing.assert_allclose(field.potential(r), solid_harmonics_potential(r), rtol=EXACT)
    step = 1e-30
    for axis in range(3):
        shifted = r.astype(complex)
        shifted[axis] += 1j * step
        slope = solid_harmonics_potential(shifted).imag / step
        size = np.linalg.norm(field.acceleration(r), axis=0)
        assert (np.abs(field.acceleration(r)[axis] - slope) / size).max() <= EXACT


@pytest.mark.parametrize(("r", "u", "g", "gradient"), ELLIPSOID_VALUES)
def test_phobos_ellipsoid_chandrasekhar_integrals(
    r: tuple[float, ...],
    u: float,
    g: tuple[float, ...],
    gradient: tuple[float, ...] | None,
) -> None:
    field = phobos_ellipsoid()
    assert field.potential(column(*r))[0] == pytest.approx(u, rel=EXACT)
    size = np.abs(g).max()
    np.testing.assert_allclose(field.acceleration(column(*r))[:, 0], g, rtol=0, atol=EXACT * size)
    if gradient is not None:
        expected = symmetric(gradient)
        np.testing.assert_allclose(
            field.gradient(column(*r))[:, :, 0],
            expected,
            rtol=0,
            atol=EXACT * np.abs(expected).max(),
        )


def test_phobos_mu_of_the_qso_paper() -> None:
    """μ = (4π/3) G σ αβγ (Phobos QSO bifurcation paper, eq. 1)."""
    field = phobos_ellipsoid()
    far = column(1e12, 0.0, 0.0)
    assert field.potential(far)[0] * 1e12 == pytest.approx(PHOBOS_MU, rel=1e-14)


def quadrature(r: NDArray[np.float64], axes: tuple[float, float, float], gm: float) -> float:
    """U = (3/4) GM ∫_Λ^∞ (1 - Σ x²/(a²+s)) ds/Δ(s) [2], with s = Λ + c² w²/(1 - w)²."""
    squares = np.square(axes)

    def secular(s: float) -> float:
        return float((r * r / (squares + s)).sum() - 1.0)

    root = brentq(secular, 0.0, float(r @ r), xtol=1e-6, rtol=1e-15) if secular(0.0) > 0 else 0.0
    scale = squares.min() + root

    def integrand(w: float) -> float:
        s = root + scale * w * w / (1.0 - w) ** 2
        jacobian = 2.0 * scale * w / (1.0 - w) ** 3
        return float(-secular(s) / np.sqrt((squares + s).prod()) * jacobian)

    integral: float = quad(integrand, 0.0, 1.0, epsabs=0.0, epsrel=1e-12, limit=200)[0]
    return 0.75 * gm * integral


@pytest.mark.parametrize(
    "axes",
    [PHOBOS_AXES_M, (12e3, 4e3, 2e3), (9e3, 8.9999e3, 8.9998e3), (5e3, 9e3, 7e3)],
    ids=["phobos", "six_to_one", "near_sphere", "unsorted"],
)
def test_ellipsoid_against_quadrature(axes: tuple[float, float, float]) -> None:
    field = ellipsoid(axes, PHOBOS_MU)
    scale = np.random.default_rng(3).uniform(0.1, 4.0, 40)
    r = random_directions(40, 4) * scale * np.array(axes)[:, None]
    expected = [quadrature(point, axes, PHOBOS_MU) for point in r.T]
    np.testing.assert_allclose(field.potential(r), expected, rtol=EXACT)


def spheroid_symbols(equator: float, pole: float) -> tuple[float, float]:
    """Index symbols (equatorial, polar) of an oblate or prolate spheroid [2]."""
    if pole < equator:
        e = sqrt(1.0 - (pole / equator) ** 2)
        flat = sqrt(1.0 - e * e) / e**3 * asin(e)
        return flat - (1.0 - e * e) / e**2, 2.0 / e**2 - 2.0 * flat
    e = sqrt(1.0 - (equator / pole) ** 2)
    long = (1.0 - e * e) / e**3 * atanh(e)
    return 1.0 / e**2 - long, 2.0 * long - 2.0 * (1.0 - e * e) / e**2


@pytest.mark.parametrize(("equator", "pole"), [(13e3, 9e3), (12e3, 2e3), (9e3, 13e3), (2e3, 12e3)])
def test_surface_gravity_of_spheroids(equator: float, pole: float) -> None:
    """Gravity is -2πGρ A x on the axes, and everywhere inside."""
    equatorial, polar = spheroid_symbols(equator, pole)
    two_pi_g_rho = 1.5 * PHOBOS_MU / (equator * equator * pole)
    field = ellipsoid((equator, equator, pole), PHOBOS_MU)
    r = np.array(
        [[equator, 0.0, 0.3 * equator], [0.0, 0.0, -0.4 * equator], [0.0, pole, 0.5 * pole]]
    )
    expected = -two_pi_g_rho * np.array([[equatorial], [equatorial], [polar]]) * r
    size = np.linalg.norm(expected, axis=0)
    assert (np.abs(field.acceleration(r) - expected) / size).max() <= EXACT


def test_a_sphere_is_a_point_mass_outside() -> None:
    """Newton's shell theorem; linear inside."""
    radius = 11e3
    field = ellipsoid((radius, radius, radius), GM)
    point = GravityField(create("gravity", "point_mass", gm_m3_s2=GM))
    outside = random_directions(50, 5) * np.geomspace(1.0001 * radius, 100 * radius, 50)
    np.testing.assert_allclose(field.potential(outside), point.potential(outside), rtol=EXACT)
    for exact, ours in (
        (point.acceleration(outside), field.acceleration(outside)),
        (point.gradient(outside), field.gradient(outside)),
    ):
        size = np.abs(exact).reshape(-1, 50).max(axis=0)
        assert (np.abs(ours - exact) / size).max() <= EXACT
    inside = random_directions(20, 6) * np.linspace(0.0, 0.99 * radius, 20)
    np.testing.assert_allclose(
        field.acceleration(inside), -GM / radius**3 * inside, rtol=EXACT, atol=1e-25
    )


def test_point_mass_closed_form() -> None:
    field = GravityField(create("gravity", "point_mass", gm_km3_s2=GM / 1e9))
    r = random_directions(50, 7) * np.geomspace(1e2, 1e9, 50)
    d = np.linalg.norm(r, axis=0)
    np.testing.assert_allclose(field.potential(r), GM / d, rtol=EXACT)
    np.testing.assert_allclose(field.acceleration(r), -GM * r / d**3, rtol=EXACT)
    gradient = GM * (3.0 * r[:, None] * r[None, :] / d**5 - np.eye(3)[:, :, None] / d**3)
    assert (np.abs(field.gradient(r) - gradient) / (GM / d**3)).max() <= EXACT


def test_ellipsoid_far_out_is_its_own_harmonics() -> None:
    """To degree 4; what is left falls as (a/r)^6, so by 64 at twice the distance.

    Unnormalised coefficients of the homogeneous ellipsoid from its moments:
    C20 = (2c²-a²-b²)/10R², C22 = (a²-b²)/20R², C40 = 15/7 (C20² + 2 C22²), C42 = 5/7 C20 C22,
    C44 = 5/28 C22².
    """
    a, b, c = PHOBOS_AXES_M
    c20 = (2 * c * c - a * a - b * b) / (10 * RADIUS**2)
    c22 = (a * a - b * b) / (20 * RADIUS**2)
    table = {
        (2, 0): c20,
        (2, 2): c22,
        (4, 0): 15 / 7 * (c20**2 + 2 * c22**2),
        (4, 2): 5 / 7 * c20 * c22,
        (4, 4): 5 / 28 * c22**2,
    }
    series = GravityField(
        create(
            "gravity",
            "harmonics",
            gm_m3_s2=PHOBOS_MU,
            reference_radius_m=RADIUS,
            normalisation="none",
            tide_system="unknown",
            coefficients=[{"n": n, "m": m, "c": v, "s": 0.0} for (n, m), v in table.items()],
        )
    )
    field = phobos_ellipsoid()
    directions = random_directions(60, 8)

    def left(distance: float) -> float:
        r = directions * distance
        potential = field.potential(r)
        return float((np.abs(potential - series.potential(r)) / potential).max())

    near, middle, far = left(75e3), left(150e3), left(300e3)
    assert far < 1e-10
    assert 55 < near / middle < 70
    assert 60 < middle / far < 66


@pytest.mark.parametrize("axes", [PHOBOS_AXES_M, (12e3, 4e3, 2e3), (9e3, 9e3, 9e3 * (1 - 1e-9))])
def test_laplace_outside_and_poisson_inside(axes: tuple[float, float, float]) -> None:
    """The trace of ∇∇U over the sum of its terms' sizes, so that far points count as near ones."""
    field = ellipsoid(axes, PHOBOS_MU)
    shape = np.array(axes)[:, None]
    outside = random_directions(400, 9) * np.geomspace(1.001, 30.0, 400) * shape
    diagonal = np.einsum("iin->in", field.gradient(outside))
    assert (np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)).max() <= LAPLACE
    inside = random_directions(100, 10) * np.linspace(0.0, 0.999, 100) * shape
    trace = np.einsum("iin->n", field.gradient(inside))
    four_pi_g_rho = 3.0 * PHOBOS_MU / np.prod(axes)
    np.testing.assert_allclose(trace, -four_pi_g_rho, rtol=EXACT)


def test_laplace_of_the_harmonics() -> None:
    r = random_directions(200, 11) * np.geomspace(9e3, 1e6, 200)
    diagonal = np.einsum("iin->in", phobos_harmonics().gradient(r))
    assert (np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)).max() <= LAPLACE
