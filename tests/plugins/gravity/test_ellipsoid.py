"""The homogeneous ellipsoid against formulas that share nothing with its implementation."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from hillsphere.dynamics import ArrayFunction
from hillsphere.gravity import GravityField
from hillsphere.symbolic import constant, gradient, variables
from hillsphere_gravity.ellipsoid import Ellipsoid
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.specs import EllipsoidSpec, HarmonicsSpec

Array = NDArray[np.float64]
PHOBOS = (13030.0, 11400.0, 9140.0)
SHAPES = {
    "phobos": PHOBOS,
    "unsorted": (9140.0, 13030.0, 11400.0),
    "6:1 needle": (6.0, 1.0, 1.0),
    "6:1 disc": (6.0, 6.0, 1.0),
    "6:3:1": (6.0, 3.0, 1.0),
    "oblate along x": (2.0, 3.0, 3.0),
    "sphere": (1.0, 1.0, 1.0),
    **{f"sphere but {e:g}": (1.0, 1.0 + e, 1.0 - 0.3 * e) for e in
       (1e-12, 1e-10, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)},
}  # fmt: skip
GM = 7.0875e5
all_shapes = pytest.mark.parametrize("axes", SHAPES.values(), ids=SHAPES.keys())


def field(axes: tuple[float, float, float], gm: float = GM) -> GravityField:
    return GravityField(Ellipsoid(EllipsoidSpec(axes_m=axes, gm_m3_s2=gm)))


def shells(axes: tuple[float, float, float], factors: Array, seed: int = 1) -> Array:
    """Random points at the given multiples of the surface's radius in their direction."""
    directions = np.random.default_rng(seed).normal(size=(3, len(factors)))
    on_surface = directions / np.linalg.norm(directions, axis=0) * np.array(axes)[:, None]
    return np.asarray(on_surface * factors)


def outside(axes: tuple[float, float, float], n: int = 600) -> Array:
    return shells(axes, 1.0 + 10.0 ** np.linspace(-14, 4, n))


def inside(axes: tuple[float, float, float], n: int = 300) -> Array:
    return shells(axes, 1.0 - 10.0 ** np.linspace(-14, 0, n))


def confocal_root(axes: tuple[float, float, float], r: Array) -> float:
    squares = np.array(axes) ** 2

    def excess(root: float) -> float:
        return float(np.sum(r**2 / (squares + root)) - 1.0)

    if excess(0.0) <= 0.0:
        return 0.0
    return float(brentq(excess, 0.0, float(r @ r), xtol=1e-300, rtol=1e-15))


def chandrasekhar(axes: tuple[float, float, float], r: Array) -> tuple[float, Array]:
    """U and g by adaptive quadrature of ∫ ds/Δ and ∫ ds/((aᵢ²+s)Δ), Chandrasekhar 1969, ch. 3."""
    squares = np.array(axes) ** 2 + confocal_root(axes, r)
    top = squares.max()

    # s + top = top/t² brings the infinite range to (0, 1], where the integrands are smooth.
    def integral(power: NDArray[np.int_]) -> float:
        def integrand(t: float) -> float:
            m = (squares - top) * t * t + top
            return float(2.0 * top / np.sqrt(np.prod(m)) * np.prod((t * t / m) ** power))

        return float(quad(integrand, 0.0, 1.0, epsabs=0.0, epsrel=1e-13, limit=200)[0])

    a = [integral(row) for row in np.eye(3, dtype=int)]
    whole = integral(np.zeros(3, dtype=int))
    potential = 0.75 * GM * (whole - float(np.sum(np.array(a) * r**2)))
    return potential, -1.5 * GM * np.array(a) * r


@cache
def gauss_legendre_nodes(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t, weights = np.polynomial.legendre.leggauss(count)
    return np.asarray(t), np.asarray(weights)


def gauss_legendre(axes: tuple[float, float, float], r: NDArray[Any], nodes: int) -> NDArray[Any]:
    """Acceleration by R_D on fixed nodes, s + c² = W/t²; r may be complex, the axes fall."""
    a2, b2, c2 = np.array(axes) ** 2
    root: Any = confocal_root(axes, np.real(r))
    if root > 0.0:
        for _ in range(3):  # Newton: carries the imaginary part to the root
            m = np.array([a2, b2, c2]) + root
            root = root + (np.sum(r**2 / m) - 1.0) / np.sum(r**2 / m**2)
    w = c2 + root
    t, weights = gauss_legendre_nodes(nodes)
    t, weights = 0.5 * (t + 1.0), 0.5 * weights
    ta, tb = w + (a2 - c2) * t**2, w + (b2 - c2) * t**2
    rd = [
        3.0 / np.sqrt(w) * np.sum(weights * t**2 * f)
        for f in (w / ta**1.5 / tb**0.5, w / ta**0.5 / tb**1.5, 1.0 / (ta * tb) ** 0.5)
    ]
    return np.asarray(-GM * r * np.array(rd))


@all_shapes
def test_agrees_with_adaptive_quadrature(axes: tuple[float, float, float]) -> None:
    points = np.concatenate(
        [shells(axes, np.array([1e-3, 0.5, 0.999, 1.0, 1.0 + 1e-9, 1.001, 1.5, 4.0, 60.0]))], axis=1
    )
    model = field(axes)
    potential, acceleration = model.potential(points), model.acceleration(points)
    for k in range(points.shape[1]):
        u, g = chandrasekhar(axes, points[:, k])
        assert potential[k] == pytest.approx(u, rel=3e-15)
        assert np.linalg.norm(acceleration[:, k] - g) <= 1e-14 * np.linalg.norm(g)


# Axes, position, U/GM, its gradient: R_F and R_D of mpmath 1.4 in 40 digits, the confocal root by
# Newton's iteration. Just above the surface, at a diameter, far away.
FORTY_DIGITS: list[tuple[tuple[float, ...], tuple[float, ...], float, tuple[float, ...]]] = [
    (
        PHOBOS, (6254.4, 6840.0, 5850.514), 9.0630060967835336e-5,
        (-3.7266889552274623e-9, -4.8101323805065477e-9, -5.3249920146867543e-9),
    ),
    (
        PHOBOS, (-19545.0, 22800.0, 6855.0), 3.2627732622260655e-5,
        (6.6764747936099687e-10, -7.9863993278010403e-10, -2.4753235123142113e-10),
    ),
    (
        PHOBOS, (3909000.0, -4560000.0, 10968000.0), 7.9969061726626534e-8,
        (-1.9990863442978826e-15, 2.3320120549611032e-15, -5.6091036786381472e-15),
    ),
    (
        (10000.0, 10000.0, 4000.0), (4800.0, 6000.0, 2560.4), 0.00012968125855069746,
        (-7.4125053901728544e-9, -9.265631737716068e-9, -1.1291874258623162e-8),
    ),
    (
        (34400.0, 11200.0, 11200.0), (16512.0, 6720.0, 7169.12), 5.7423840262720838e-5,
        (-1.2122678356919251e-9, -2.0888845554772836e-9, -2.2284916732683487e-9),
    ),
    (
        (10000.0, 9999.999, 9999.998), (4800.0, 5999.999, 6400.999), 9.9993611437427043e-5,
        (-4.7990794266973829e-9, -5.9988490033332713e-9, -6.3997729130844212e-9),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("axes", "place", "potential", "acceleration"), FORTY_DIGITS)
def test_agrees_with_forty_digits(
    axes: tuple[float, float, float],
    place: tuple[float, ...],
    potential: float,
    acceleration: tuple[float, ...],
) -> None:
    """A few roundings: 1e-15 measured on random points from 1e-12 to 1e4 radii above a surface."""
    body, r = field(axes, 1.0), np.array(place)[:, None]
    assert body.potential(r)[0] == pytest.approx(potential, rel=4e-15)
    error = np.linalg.norm(body.acceleration(r)[:, 0] - acceleration)
    assert error <= 4e-15 * np.linalg.norm(acceleration)


def test_agrees_with_twelve_gauss_legendre_nodes() -> None:
    points = np.concatenate([outside(PHOBOS, 60), inside(PHOBOS, 40)[:, :-1]], axis=1)
    found = field(PHOBOS).acceleration(points)
    for k in range(points.shape[1]):
        expected = gauss_legendre(PHOBOS, points[:, k], 12)
        assert np.linalg.norm(found[:, k] - expected) <= 3e-15 * np.linalg.norm(expected)


@pytest.mark.parametrize("axes", [PHOBOS, (6.0, 3.0, 1.0), (1.0, 1.0 - 1e-9, 1.0 - 2e-9)])
def test_gradient_agrees_with_complex_step(axes: tuple[float, float, float]) -> None:
    points = np.concatenate([outside(axes, 40), inside(axes, 20)], axis=1)
    found = field(axes).gradient(points)
    step = 1e-30
    for k in range(points.shape[1]):
        columns = [
            gauss_legendre(axes, points[:, k] + 1j * step * axis, 120).imag / step
            for axis in np.eye(3)
        ]
        expected = np.array(columns).T
        assert np.max(np.abs(found[..., k] - expected)) <= 5e-14 * np.max(np.abs(expected))


@all_shapes
def test_laplace_outside_poisson_inside(axes: tuple[float, float, float]) -> None:
    model = field(axes)
    diagonal = np.einsum("iiN->iN", model.gradient(outside(axes)))
    assert np.max(np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)) <= 4e-14
    # −4πGρ = −3 GM/(abc)
    trace = np.einsum("iiN->N", model.gradient(inside(axes)))
    np.testing.assert_allclose(trace, -3.0 * GM / np.prod(axes), rtol=1e-15)


@all_shapes
def test_finite_and_symmetric_everywhere(axes: tuple[float, float, float]) -> None:
    special = [np.zeros(3)]
    for i in range(3):
        for size in (1e-300, 0.5, 1.0, np.nextafter(1.0, 2.0), np.nextafter(1.0, 0.0), 3.0, 1e8):
            special += [size * axes[i] * np.eye(3)[i], -size * axes[i] * np.eye(3)[i]]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        special.append((np.eye(3)[i] * axes[i] + np.eye(3)[j] * axes[j]) * 0.8)
    points = np.array(special).T
    model = field(axes)
    jacobian = model.gradient(points)
    assert np.all(np.isfinite(jacobian))
    assert np.all(np.isfinite(model.potential(points)))
    assert np.all(np.isfinite(model.acceleration(points)))
    size = np.abs(jacobian).max(axis=(0, 1))
    assert np.all(np.abs(jacobian - jacobian.transpose(1, 0, 2)).max(axis=(0, 1)) <= 2e-15 * size)
    np.testing.assert_array_equal(model.acceleration(np.zeros(3)), 0.0)


@all_shapes
def test_acceleration_is_the_gradient_of_the_potential(axes: tuple[float, float, float]) -> None:
    model = Ellipsoid(EllipsoidSpec(axes_m=axes, gm_m3_s2=GM))
    x, y, z = variables("x", "y", "z")
    p = {q.name: constant(q.value) for q in model.parameters()}
    slopes = ArrayFunction(gradient(model.potential((x, y, z), p), (x, y, z)), (x, y, z))
    points = np.concatenate([outside(axes), inside(axes)[:, :-1]], axis=1)
    found = GravityField(model).acceleration(points)
    difference = np.linalg.norm(slopes(points) - found, axis=0)
    assert np.max(difference / np.linalg.norm(found, axis=0)) <= 4e-14


@all_shapes
def test_on_the_surface_but_for_rounding_is_outside(axes: tuple[float, float, float]) -> None:
    # Of random points about half round to the inside; Laplace's equation tells the side.
    on = shells(axes, np.repeat([1.0 - 3e-16, 1.0, 1.0 + 3e-16], 100))
    diagonal = np.einsum("iiN->iN", field(axes).gradient(on))
    assert np.max(np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)) <= 4e-14


@all_shapes
def test_continuous_across_the_surface(axes: tuple[float, float, float]) -> None:
    # What the gradients on the two sides explain of the step is taken off: they differ, and half
    # of the way lies on each side.
    just_in = shells(axes, np.full(200, 1.0 - 1e-9))
    just_out = just_in * (1.0 + 1e-9) ** 2
    way = just_out - just_in
    model = field(axes)
    g = model.acceleration(just_in)
    potential = model.potential(just_in)
    step = model.potential(just_out) - potential - np.sum(g * way, axis=0)
    assert np.max(np.abs(step) / potential) <= 4e-15
    mean = 0.5 * (model.gradient(just_in) + model.gradient(just_out))
    jump = model.acceleration(just_out) - g - np.einsum("ijN,jN->iN", mean, way)
    assert np.max(np.linalg.norm(jump, axis=0) / np.linalg.norm(g, axis=0)) <= 1.2e-14


@pytest.mark.parametrize("radius", [1.0, 1737.4e3])
def test_sphere_is_a_point_mass_outside_and_linear_inside(radius: float) -> None:
    axes = (radius, radius, radius)
    out, within = outside(axes), inside(axes)
    model = field(axes)
    distance = np.linalg.norm(out, axis=0)
    np.testing.assert_allclose(model.potential(out), GM / distance, rtol=2e-15)
    np.testing.assert_allclose(model.acceleration(out), -GM * out / distance**3, rtol=5e-15)
    np.testing.assert_allclose(
        model.acceleration(within), -GM * within / radius**3, rtol=1e-15, atol=0.0
    )
    distance = np.linalg.norm(within, axis=0)
    np.testing.assert_allclose(
        model.potential(within), GM / (2 * radius) * (3 - (distance / radius) ** 2), rtol=2e-15
    )


def test_far_out_it_is_its_own_harmonics() -> None:
    # Homogeneous ellipsoid, conventional coefficients by integration of the solid harmonics:
    # C20 = (2c²−a²−b²)/10R², C22 = (a²−b²)/20R², C40 = 15/7 (C20² + 2 C22²),
    # C42 = 5/7 C20 C22, C44 = 5/28 C22².
    a, b, c = PHOBOS
    radius = 11100.0
    c20 = (2 * c**2 - a**2 - b**2) / (10 * radius**2)
    c22 = (a**2 - b**2) / (20 * radius**2)
    values = {
        (2, 0): c20, (2, 2): c22, (4, 0): 15 / 7 * (c20**2 + 2 * c22**2),
        (4, 2): 5 / 7 * c20 * c22, (4, 4): 5 / 28 * c22**2,
    }  # fmt: skip
    series = GravityField(
        Harmonics(
            HarmonicsSpec.model_validate(
                {
                    "gm_m3_s2": GM,
                    "reference_radius_m": radius,
                    "normalisation": "none",
                    "tide_system": "none",
                    "coefficients": [{"n": n, "m": m, "c": v} for (n, m), v in values.items()],
                }
            )
        )
    )
    near = shells((1.0, 1.0, 1.0), np.full(300, 80e3))
    closed = field(PHOBOS)
    differences = [
        np.abs(series.potential(k * near) - closed.potential(k * near)).max() for k in (1.0, 2.0)
    ]
    # What is left is degree 6, which falls with the seventh power of the distance.
    assert differences[0] <= 2e-7 * GM / 80e3
    assert differences[0] / differences[1] == pytest.approx(2.0**7, rel=0.02)
    far = 100.0 * near
    np.testing.assert_allclose(series.acceleration(far), closed.acceleration(far), rtol=4e-15)


def test_density_gives_the_mass_of_the_qso_paper() -> None:
    # μ = (4π/3) G σ αβγ = 7.0597e-4 km³/s² from the axes, σ and G of the Phobos
    # quasi-satellite bifurcation paper.
    spec = EllipsoidSpec.model_validate(
        {"axes_km": [13.03, 11.40, 9.14], "density_g_cm3": 1.860,
         "gravitational_constant": 6.674e-11}
    )  # fmt: skip
    assert Ellipsoid(spec).gm_m3_s2 == pytest.approx(7.059650784871513e5, rel=1e-15)
    codata = EllipsoidSpec(axes_m=PHOBOS, density_kg_m3=1860.0)
    assert Ellipsoid(codata).gm_m3_s2 == pytest.approx(
        7.059650784871513e5 * 6.67430e-11 / 6.674e-11, rel=1e-15
    )


def test_run_time_parameters_equal_compiled_constants() -> None:
    points = np.concatenate([outside(PHOBOS, 50), inside(PHOBOS, 20)], axis=1)
    nominal = Ellipsoid(EllipsoidSpec(axes_m=PHOBOS, density_kg_m3=1860.0))
    assert [q.name for q in nominal.parameters()] == ["density", "axis_x", "axis_y", "axis_z"]
    run_time = GravityField(nominal, ["axis_z", "density"])
    other = GravityField(Ellipsoid(EllipsoidSpec(axes_m=(13030.0, 11400.0, 8000.0),
                                                 density_kg_m3=2000.0)))  # fmt: skip
    values = np.array([8000.0, 2000.0])
    for name in ("potential", "acceleration", "gradient"):
        found, expected = getattr(run_time, name)(points, values), getattr(other, name)(points)
        scale = np.abs(expected).max(axis=tuple(range(expected.ndim - 1)))
        # Known axes need fewer duplications in Carlson's integrals than axes set at run time, so
        # that both round differently: 1.4e-15 measured for the gradient.
        assert np.all(np.abs(found - expected) <= 4e-15 * scale)
    # Left out, they are nominal.
    np.testing.assert_allclose(
        run_time.potential(points), GravityField(nominal).potential(points), rtol=3e-15
    )


def test_switch_follows_the_axes_of_the_parameters() -> None:
    model = Ellipsoid(EllipsoidSpec(axes_m=PHOBOS, gm_m3_s2=GM))
    x, y, z = variables("x", "y", "z")
    for axes in (PHOBOS, (9000.0, 20000.0, 9140.0)):
        values = {f"axis_{q}": constant(a) for q, a in zip("xyz", axes, strict=True)}
        (switch,) = model.switches((x, y, z), {"gm": constant(GM), **values})
        factors = np.array([0.0, 0.5, 1.0, 1.5])
        found = ArrayFunction((switch,), (x, y, z))(shells(axes, factors))[0]
        np.testing.assert_allclose(found, factors**2 - 1.0, rtol=0, atol=1e-15)


def test_surface_is_signed_and_reports_its_axes() -> None:
    model = Ellipsoid(EllipsoidSpec(axes_m=PHOBOS, gm_m3_s2=GM))
    x, y, z = variables("x", "y", "z")
    surface = ArrayFunction((model.surface((x, y, z)),), (x, y, z))
    factors = np.array([0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(
        surface(shells(PHOBOS, factors))[0], factors**2 - 1.0, rtol=0, atol=1e-15
    )
    assert model.semi_axes_m() == PHOBOS
    assert model.frame == "body"
