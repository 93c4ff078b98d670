"""The plant ``hill``: equations, symmetries, events and array gravity."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import Derivatives, StepMap, system
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, Parameter
from hillsphere.testing import check_plant
from hillsphere_plants.hill import ArrayHill, Hill
from hillsphere_plants.rotation import AxialRotation

GM = 7.0875e5
AXES_M = (13030.0, 11400.0, 9140.0)


def phobos(**keys: Any) -> Any:
    return create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, **keys
    )


def hill(gravity: Any, **keys: Any) -> Any:
    body = keys.pop("body", None) or phobos()
    return create("plant", "hill", body=body, gravity=gravity, **keys)


def harmonics(c22: float, s22: float) -> Any:
    return create(
        "gravity", "harmonics", gm_m3_s2=GM, reference_radius_km=11.1, normalisation="full",
        tide_system="none",
        coefficients=[{"n": 2, "m": 0, "c": -0.047}, {"n": 2, "m": 2, "c": c22, "s": s22}],
    )  # fmt: skip


class TabulatedPointMass:
    """A point mass that hides its formula, as a table or a polyhedron would."""

    frame = "body"
    gm_m3_s2 = GM

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"),)

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(p[0] / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-p[0] * r / np.linalg.norm(r, axis=0) ** 3)


class TabulatedHarmonics:
    """Harmonics that hide their formula; unlike a point mass they show which way a body turns."""

    frame = "body"
    gm_m3_s2 = GM

    def __init__(self) -> None:
        self._field = GravityField(harmonics(0.0228, -0.013))

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def potential_array(self, r: Array, p: Array) -> Array:
        return self._field.potential(r)

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return self._field.acceleration(r)

    def gradient_array(self, r: Array, p: Array) -> Array:
        return self._field.gradient(r)


def states(count: int = 12, *, nearest_m: float = 18e3) -> Array:
    rng = np.random.default_rng(7)
    direction = rng.normal(size=(3, count))
    place = direction / np.linalg.norm(direction, axis=0) * rng.uniform(nearest_m, 90e3, count)
    return np.concatenate([place, 5.0 * rng.normal(size=(3, count))])


def rates(plant: Any, x: Array) -> Array:
    made = system(plant)
    return made.function(*made.rhs)(x)


@pytest.fixture(scope="module")
def point_mass() -> Any:
    return hill(create("gravity", "point_mass", gm_m3_s2=GM))


def test_equations_against_a_transcription(point_mass: Any) -> None:
    x = states()
    n = sqrt(42828.37e9 / 9377e3**3)
    pull = -GM * x[:3] / np.linalg.norm(x[:3], axis=0) ** 3
    expected = np.array([
        x[3], x[4], x[5],
        2 * n * x[4] + 3 * n**2 * x[0] + pull[0],
        -2 * n * x[3] + pull[1],
        -(n**2) * x[2] + pull[2],
    ])  # fmt: skip
    np.testing.assert_allclose(rates(point_mass, x), expected, rtol=1e-14, atol=1e-18)


def test_natural_units_and_frame(point_mass: Any) -> None:
    n = sqrt(42828.37e9 / 9377e3**3)
    assert point_mass.scales.time_s == pytest.approx(1 / n, rel=1e-15)
    assert point_mass.scales.length_m == pytest.approx((GM / n**2) ** (1 / 3), rel=1e-15)
    assert point_mass.frame == "hill:phobos"


def test_libration_points_are_equilibria(point_mass: Any) -> None:
    """X = ±(1/3)^(1/3) L, Hill's closed form."""
    x = np.zeros((6, 2))
    x[0] = np.array([1.0, -1.0]) * 3.0 ** (-1 / 3) * point_mass.scales.length_m
    size = point_mass.scales.length_m / point_mass.scales.time_s**2
    assert np.max(np.abs(rates(point_mass, x))) < 5e-15 * size


def test_jacobi_constant_of_a_state_at_rest(point_mass: Any) -> None:
    """At the libration point C = 3^(4/3)/2 in natural units."""
    made = system(point_mass, normalised=True)
    assert made.integral is not None
    at = np.array([[3.0 ** (-1 / 3), 0, 0, 0, 0, 0]]).T
    assert made.function(made.integral)(at)[0, 0] == pytest.approx(3 ** (4 / 3) / 2, rel=1e-14)


def test_controls_are_accelerations(point_mass: Any) -> None:
    made = system(point_mass, controls=True)
    rhs = made.function(*made.rhs)
    x, push = states(3), np.array([1e-3, -2e-3, 3e-3])
    change = rhs(x, push) - rhs(x, np.zeros(3))
    np.testing.assert_allclose(change[3:], np.repeat(push[:, None], 3, 1), rtol=1e-12)
    assert np.all(change[:3] == 0)


@pytest.mark.parametrize("kind", ["point_mass", "ellipsoid"])
def test_contract(kind: str) -> None:
    keys = {"axes_m": AXES_M, "gm_m3_s2": GM} if kind == "ellipsoid" else {"gm_m3_s2": GM}
    check_plant(hill(create("gravity", kind, **keys), escape_radius_km=500), states())


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [(0.0, (1, 0)), (90.0, (0, 1)), (180.0, (-1, 0)), (270.0, (0, -1)), (-90.0, (0, -1)),
     (540.0, (-1, 0))],
)  # fmt: skip
def test_quarter_turns_are_exact(degrees: float, expected: tuple[float, float]) -> None:
    assert tuple(AxialRotation.by(radians(degrees))) == expected


def test_other_turns_are_turns() -> None:
    turn = AxialRotation.by(0.3)
    assert tuple(turn) == (cos(0.3), sin(0.3))
    assert tuple(AxialRotation.by(pi / 2 + 1e-9)) != (0.0, 1.0)


@pytest.mark.parametrize("angle", [0.0, pi, 0.4])
def test_prime_meridian_turns_the_gravity(angle: float) -> None:
    gravity, x = harmonics(0.022, 0.005), states()
    c, s = cos(angle), sin(angle)
    to_body = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    pull = to_body.T @ GravityField(gravity).acceleration(to_body @ x[:3])
    n = sqrt(42828.37e9 / 9377e3**3)
    found = rates(hill(gravity, prime_meridian_rad=angle), x)
    np.testing.assert_allclose(found[4], -2 * n * x[3] + pull[1], rtol=1e-12)
    np.testing.assert_allclose(found[5], -(n**2) * x[2] + pull[2], rtol=1e-12)


def test_mirror_is_exact_at_the_iau_meridian_and_broken_by_sine_terms() -> None:
    x = states()
    for s22, kept in ((0.0, True), (1e-3, False)):
        plant = hill(harmonics(0.022, s22))
        flip = np.array(plant.mirrors["xz"])[:, None]
        difference = np.abs(rates(plant, flip * x) + flip * rates(plant, x)).max(axis=0)
        size = np.abs(rates(plant, x)).max(axis=0)
        if kept:
            assert np.all(difference <= 1e-15 * size)
        else:
            assert np.all(difference > 1e-9 * size)


def test_impact_by_the_body_or_by_the_gravity_model() -> None:
    ellipsoid = create("gravity", "ellipsoid", axes_m=AXES_M, gm_m3_s2=GM)
    point = create("gravity", "point_mass", gm_m3_s2=GM)
    own = hill(point, body=phobos(semi_axes_m=(1e4, 9e3, 8e3)))
    assert own.semi_axes_m == (1e4, 9e3, 8e3)
    assert hill(ellipsoid).semi_axes_m == AXES_M
    assert hill(point).semi_axes_m is None
    x = np.zeros((6, 2))
    for plant, reach in ((own, 9e3), (hill(ellipsoid), AXES_M[1])):
        made = system(plant)
        x[1] = reach * np.array([1 + 1e-6, 1 - 1e-6])
        outside, inside = made.function(made.events["impact"])(x)[0]
        assert outside > 0 > inside
    assert dict(system(hill(point)).events) == {}


def test_turned_body_turns_its_surface() -> None:
    gravity = create("gravity", "point_mass", gm_m3_s2=GM)
    plant = hill(gravity, body=phobos(semi_axes_m=(3e4, 1e4, 1e4)), prime_meridian_deg=90)
    made = system(plant)
    x = np.zeros((6, 2))
    x[0, 0] = x[1, 1] = 2e4
    along_x, along_y = made.function(made.events["impact"])(x)[0]
    assert along_x > 0 > along_y


def test_escape_radius() -> None:
    plant = hill(create("gravity", "point_mass", gm_m3_s2=GM), escape_radius_km=100)
    made = system(plant)
    x = np.zeros((6, 2))
    x[2] = (99e3, 101e3)
    inside, outside = made.function(made.events["escape"])(x)[0]
    assert inside > 0 > outside


def test_array_gravity_gives_the_same_motion() -> None:
    symbolic = hill(create("gravity", "point_mass", gm_m3_s2=GM), prime_meridian_deg=30)
    tabulated = hill(TabulatedPointMass(), prime_meridian_deg=30)
    assert isinstance(symbolic, Hill)
    assert isinstance(tabulated, ArrayHill)
    one, other = (system(p, normalised=True) for p in (symbolic, tabulated))
    x = states(5) / one.unit[:, None]
    end, phi = StepMap(one, stm=True).propagate(x, 0.5, 40)
    end_a, phi_a = StepMap(other, stm=True).propagate(x, 0.5, 40)
    np.testing.assert_allclose(end_a, end, rtol=0, atol=1e-13)
    # the gradient is by differences there
    np.testing.assert_allclose(phi_a, phi, rtol=0, atol=1e-9)
    made = system(symbolic)
    assert made.integral is not None
    np.testing.assert_allclose(
        tabulated.integral_array(states(5)), made.function(made.integral)(states(5))[0], rtol=1e-13
    )


def test_array_gravity_turns_with_the_prime_meridian() -> None:
    symbolic = hill(harmonics(0.0228, -0.013), prime_meridian_rad=0.4)
    tabulated = hill(TabulatedHarmonics(), prime_meridian_rad=0.4)
    one, other = (system(p, normalised=True) for p in (symbolic, tabulated))
    x = states(6) / one.unit[:, None]
    rate, jacobian = Derivatives(one).both(x)
    rate_a, jacobian_a = Derivatives(other).both(x)
    np.testing.assert_allclose(rate_a, rate, rtol=0, atol=1e-14)
    np.testing.assert_allclose(jacobian_a, jacobian, rtol=0, atol=1e-13)
    made = system(symbolic)
    assert made.integral is not None
    np.testing.assert_allclose(
        tabulated.integral_array(states(6)), made.function(made.integral)(states(6))[0], rtol=1e-13
    )


@pytest.mark.parametrize(
    ("gravity", "axes_km", "radius_m"),
    [("series", None, 11.1e3), ("series", [13.03, 11.4, 9.14], 13.03e3), ("none", None, None)],
)
def test_series_is_sure_outside_the_brillouin_sphere(
    gravity: str, axes_km: list[float] | None, radius_m: float | None
) -> None:
    model = harmonics(0.02, 0.0)
    if gravity == "none":
        model = create("gravity", "point_mass", gm_m3_s2=GM)
    body = phobos() if axes_km is None else phobos(semi_axes_km=axes_km)
    assert hill(model, body=body).series_radius_m == radius_m


def test_bad_keys_are_named() -> None:
    with pytest.raises(InputError, match="escape_radius_m"):
        hill(create("gravity", "point_mass", gm_m3_s2=GM), escape_radius_m=-1.0)
    with pytest.raises(InputError, match="gravity"):
        create("plant", "hill", body=phobos())
