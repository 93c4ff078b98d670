"""Orbits carried along parameters of the equations, against orbits of plants made so.

The independent orbit is that of another plant, with the parameters at the end of the path as its
own numbers, found by following its own family.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, power
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.libration.families import Halo, LibrationFamily
from hillsphere_orbits.members import coordinate, members_at
from hillsphere_orbits.parameter_continuation import (
    HeldQuantity,
    ParameterPath,
    ParameterProblem,
    hold_integral,
    hold_orbit_quantity,
)
from hillsphere_orbits.parameter_paths import Method, carry, refine_orbits
from hillsphere_orbits.qso.families import Family, Qso
from hillsphere_orbits.shooting import PeriodicShooting, SymmetricShooting

GM = 7.0596507848715e-4  # km³/s²
AXES = (13.03, 11.40, 9.14)  # km
SPHERE = (11.074, 11.074, 11.074)  # km, of the ellipsoid's volume to 5 digits
METHODS: tuple[Method, ...] = ("arclength", "natural")
ARCLENGTH_SLOW = [pytest.param("arclength", marks=pytest.mark.slow), "natural"]

DISTANCE_M, RATE = 1e8, 1e-5
EARTH_MOON = 0.01215


def hill(gravity: Any) -> Any:
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    return create("plant", "hill", body=moon, gravity=gravity)


@cache
def about_ellipsoid(axes: tuple[float, ...]) -> Any:
    return hill(create("gravity", "ellipsoid", axes_km=list(axes), gm_km3_s2=GM))


@cache
def about_point() -> Any:
    return hill(create("gravity", "point_mass", gm_km3_s2=GM))


def quasi_satellites(plant: Any) -> Family:
    if plant not in FOLLOWED:
        family = create("orbit_family", "qso", plant=plant)
        assert isinstance(family, Qso)
        FOLLOWED[plant] = family.family(17e3, 60e3, 61)
    return FOLLOWED[plant]


FOLLOWED: dict[Any, Family] = {}


def at_amplitudes(family: Family, scale: float = 1.0) -> Array:
    """Return the members whose amplitudes are 20, 30 and 50 km, times a factor."""
    wanted = scale * np.array([20e3, 30e3, 50e3]) / family.plant.scales.length_m
    return members_at(family.problem, family.branch, family.amplitude, wanted).z


@cache
def circular(mu: float) -> Any:
    total = DISTANCE_M**3 * RATE**2
    moon = create("body", "moon", primary_gm_m3_s2=(1.0 - mu) * total, semi_major_axis_m=DISTANCE_M)
    gravity = create("gravity", "point_mass", gm_m3_s2=mu * total)
    return create("plant", "three_body", body=moon, gravity=gravity)


@cache
def halos(mu: float, most: float) -> LibrationFamily:
    family = create("orbit_family", "halo", plant=circular(mu), point="L1")
    assert isinstance(family, Halo)
    return family.family(None, most * DISTANCE_M, 61)


def to_mass_ratio(mu: float) -> dict[str, float]:
    total = DISTANCE_M**3 * RATE**2
    return {"primary_gm": (1.0 - mu) * total, "gravity.gm": mu * total}


@cache
def rounding() -> ParameterProblem:
    """Return the way from a sphere to the ellipsoid."""
    family = quasi_satellites(about_ellipsoid(SPHERE))
    ends = dict(zip(("axis_x", "axis_y", "axis_z"), AXES, strict=True))
    path = ParameterPath.of(
        family.plant, {f"gravity.{name}": 1e3 * value for name, value in ends.items()}
    )
    return ParameterProblem.of(
        quasi_satellites(about_ellipsoid(SPHERE)).problem, family.plant, path
    )


def slopes_by_differences(function: Callable[[Array], Array], z: Array, step: float) -> Array:
    """Return (k, m, N): central differences of fourth order."""
    found = []
    for i in range(len(z)):
        h = np.zeros_like(z)
        h[i] = step
        far, near = function(z + 2 * h) - function(z - 2 * h), function(z + h) - function(z - h)
        found.append((8.0 * near - far) / (12.0 * step))
    return np.moveaxis(np.array(found), 0, 1)


def with_fractions(family: Family) -> Array:
    z = at_amplitudes(family)
    return np.concatenate([z + 1e-2, [[0.2, 0.5, 0.9]]])


@pytest.mark.slow
def test_gradients_by_differences() -> None:
    problem = rounding()
    z = with_fractions(quasi_satellites(about_ellipsoid(SPHERE)))
    _, slopes = problem.residual(z)
    by_hand = slopes_by_differences(lambda v: problem.residual(v)[0], z, 3e-4)
    np.testing.assert_allclose(slopes, by_hand, rtol=0, atol=8e-10)
    # the orbits do depend on the axes, so that a missing derivative would show
    assert np.min(np.max(np.abs(slopes[:, -1]), axis=0)) > 1e-4


@pytest.mark.parametrize(
    "kind",
    [*(pytest.param(kind, marks=pytest.mark.slow) for kind in ("integral", "amplitude")), "period"],
)
def test_gradients_of_what_is_held(kind: str) -> None:
    problem = rounding()
    family = quasi_satellites(about_ellipsoid(SPHERE))
    z = with_fractions(family)
    held: HeldQuantity = {
        "integral": hold_integral(problem),
        "amplitude": hold_orbit_quantity(family.amplitude),
        "period": hold_orbit_quantity(family.period),
    }[kind]
    _, gradient = held(z)
    by_hand = slopes_by_differences(lambda v: held(v)[0][None], z, 3e-4)[0]
    np.testing.assert_allclose(gradient, by_hand, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_gradients_over_a_full_period() -> None:
    """The problem without a mirror: closure of all states from a section."""
    plant = about_point()
    base = PeriodicShooting(flow_of(plant), "y", ("z", "vz"), steps=160)
    path = ParameterPath.of(plant, {"gravity.gm": 1.2e9 * GM})
    problem = ParameterProblem.of(base, plant, path)
    z = np.array([[2.5], [0.01], [-5.1], [5.9], [0.4]])
    _, slopes = problem.residual(z)
    by_hand = slopes_by_differences(lambda v: problem.residual(v)[0], z, 3e-4)
    np.testing.assert_allclose(slopes, by_hand, rtol=0, atol=3e-9)
    assert np.max(np.abs(slopes[:, -1])) > 1e-2


@pytest.mark.slow
def test_problem_is_the_plants_own_at_the_ends_of_the_path() -> None:
    problem = rounding()
    for axes, fraction in ((SPHERE, 0.0), (AXES, 1.0)):
        family = quasi_satellites(about_ellipsoid(axes))
        base = family.problem.with_steps(problem.base.steps)
        z = at_amplitudes(family)
        expected, slopes = base.residual(z)
        found, wide = problem.residual(np.concatenate([z, np.full((1, 3), fraction)]))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(wide[:, :-1], slopes, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", ARCLENGTH_SLOW)
def test_sphere_to_ellipsoid_at_fixed_jacobi(method: Method) -> None:
    start, there = (
        quasi_satellites(about_ellipsoid(SPHERE)),
        quasi_satellites(about_ellipsoid(AXES)),
    )
    problem = rounding()
    z = at_amplitudes(start)
    jacobi = start.integral(z)[0]
    held = hold_integral(problem)
    found = carry(problem, z, held, method=method)
    assert found.status == ("reached",) * 3
    expected = members_at(there.problem, there.branch, there.integral, jacobi).z
    np.testing.assert_allclose(found.z[:-1], expected, rtol=0, atol=1e-12)
    assert np.max(np.abs(expected - z)) > 1e-3
    for k, way in enumerate(found.ways):
        assert np.all(np.diff(way[-1]) > 0.0)
        np.testing.assert_allclose(way[:-1, 0], z[:, k], rtol=0, atol=1e-12)
        np.testing.assert_allclose(held(way)[0], jacobi[k], rtol=0, atol=1e-11)
    orbits = problem.orbits(found.z, ("a", "b", "c"))
    assert orbits.residual.max() < 1e-12
    there_m = there.problem.monodromy(expected)
    np.testing.assert_allclose(orbits.monodromy, there_m, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_fixed_period_in_gm(method: Method) -> None:
    """About a point mass Hill's problem scales: at the same period x ∝ GM^(1/3)."""
    family = quasi_satellites(about_point())
    path = ParameterPath.of(family.plant, {"gravity.gm": 1.2e9 * GM})
    problem = ParameterProblem.of(family.problem, family.plant, path)
    z = at_amplitudes(family)
    found = carry(problem, z, hold_orbit_quantity(family.period), method=method)
    assert found.status == ("reached",) * 3
    expected = z * np.array([1.2 ** (1 / 3), 1.2 ** (1 / 3), 1.0])[:, None]
    np.testing.assert_allclose(found.z[:-1], expected, rtol=0, atol=1e-12)
    assert problem.orbits(found.z, ("",) * 3).residual.max() < 1e-11


def test_fixed_amplitude_in_the_rate_of_the_frame() -> None:
    """Faster by s, an amplitude counts s^(2/3) times as many units of length (GM/n²)^(1/3)."""
    family = quasi_satellites(about_point())
    rate = 1.1
    own = {q.name: q.value for q in family.plant.parameters()}["mean_motion"]
    path = ParameterPath.of(family.plant, {"mean_motion": rate * own})
    problem = ParameterProblem.of(family.problem, family.plant, path)
    found = carry(
        problem, at_amplitudes(family), hold_orbit_quantity(family.amplitude), method="natural"
    )
    same = at_amplitudes(family, rate ** (2 / 3))
    expected = same * np.array([rate ** (-2 / 3), rate ** (1 / 3), 1.0 / rate])[:, None]
    np.testing.assert_allclose(found.z[:-1], expected, rtol=0, atol=1e-12)
    jacobi = family.integral(same)[0] * rate ** (2 / 3)
    np.testing.assert_allclose(problem.integral(found.z), jacobi, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", ARCLENGTH_SLOW)
def test_halo_orbits_from_one_mass_ratio_to_another(method: Method) -> None:
    """From µ = 0.04 to that of Earth and Moon at a fixed z₀, in the plant's own three bodies."""
    start, there = halos(0.04, 0.25), halos(EARTH_MOON, 0.12)
    path = ParameterPath.of(start.plant, to_mass_ratio(EARTH_MOON))
    problem = ParameterProblem.of(start.problem, start.plant, path)
    height = np.array([0.05, 0.1]) * DISTANCE_M
    z = members_at(
        start.problem, start.branch, start.amplitude, height / start.plant.scales.length_m
    ).z
    held = hold_orbit_quantity(start.amplitude)
    found = carry(problem, z, held, method=method)
    assert found.status == ("reached",) * 2
    finer = problem.with_steps(problem.steps_for(found.z, 1e-12))
    end = refine_orbits(finer, found.z, held, held(found.z)[0])
    expected = members_at(
        there.problem, there.branch, there.amplitude, height / there.plant.scales.length_m
    ).z
    x = there.problem.state(expected) * there.problem.flow.system.unit[:, None]
    size = start.problem.flow.system.unit[:, None]
    np.testing.assert_allclose(finer.state(end), x / size, rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_orbits_that_end_before(method: Method) -> None:
    """Held at its period, a low halo orbit falls back to the plane on the way to a smaller µ.

    The period of the planar orbit at which halos branch off grows as µ falls, so that halo orbits
    of a given period near it cease to exist; their curve comes back as the mirror image, south.
    """
    family = halos(0.04, 0.25)
    path = ParameterPath.of(family.plant, to_mass_ratio(EARTH_MOON))
    problem = ParameterProblem.of(family.problem, family.plant, path)
    heights = np.array([0.04, 0.2]) * DISTANCE_M / family.plant.scales.length_m
    z = members_at(family.problem, family.branch, family.amplitude, heights).z
    done: list[int] = []
    found = carry(
        problem, z, hold_orbit_quantity(family.period), method=method, advance=done.append
    )
    assert list(found.reached) == [False, True]
    assert sum(done) == 2
    way = found.ways[0]
    assert 0.09 < way[-1].max() < 0.1
    if method == "arclength":
        assert found.status[0].startswith("the parameters turn back and return to their start")
        mirror = np.array([1.0, -1.0, 1.0, 1.0])
        np.testing.assert_allclose(found.z[:-1, 0], mirror * z[:, 0], rtol=0, atol=1e-8)
    else:
        assert found.status[0].startswith("not_converged: no orbit beyond the fraction 0.095")
        assert way[1, -1] < 0.2 * z[1, 0]


def test_nothing_to_carry() -> None:
    for method in METHODS:
        found = carry(rounding(), np.empty((3, 0)), hold_integral(rounding()), method=method)
        assert found.z.shape == (4, 0)
        assert found.status == ()


class WithoutIntegral:
    """Hill's equations in the plane, and nothing said of an integral."""

    frame = "hill:moon"
    states = (Variable("x", 1), Variable("y", 1), Variable("u", 1, -1), Variable("v", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 1.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        px, py, vx, vy = x
        pull = p["gm"] * power(px * px + py * py, -1.5)
        return vx, vy, 2.0 * vy + 3.0 * px - pull * px, -2.0 * vx - pull * py

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


def test_plant_without_integral() -> None:
    plant = WithoutIntegral()
    base = SymmetricShooting(flow_of(plant), (1, -1, -1, 1))
    problem = ParameterProblem.of(base, plant, ParameterPath.of(plant, {"gm": 1.1}))
    with pytest.raises(InputError, match="WithoutIntegral has no integral of motion to hold"):
        hold_integral(problem)
    z = correct(base, np.array([[2.0], [-4.1], [2.9]]), fix_component(0, 2.0)).require_converged(
        "orbit"
    )
    found = carry(problem, z, hold_orbit_quantity(coordinate(2)))
    np.testing.assert_allclose(
        found.z[:-1], z * np.array([[1.1 ** (1 / 3)], [1.1 ** (1 / 3)], [1.0]]), rtol=0, atol=1e-12
    )
    assert np.isnan(problem.integral(found.z)).all()


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: ParameterPath.of(about_ellipsoid(AXES), {"gravity.mass": 1.0}), "no parameter"),
        (lambda: ParameterPath.of(about_ellipsoid(AXES), {}), "no parameter changes"),
        (
            lambda: ParameterPath.of(about_ellipsoid(AXES), {"gravity.axis_x": 1e3 * AXES[0]}),
            "no parameter changes",
        ),
        (
            lambda: ParameterPath.of(about_ellipsoid(AXES), {"mean_motion": np.inf}),
            "must be finite",
        ),
        (
            lambda: carry(rounding(), np.zeros((2, 1)), hold_integral(rounding())),
            r"z must be \(3, N\)",
        ),
        (
            lambda: carry(
                rounding(), np.zeros((3, 1)), hold_integral(rounding()), method="guess",  # type: ignore[arg-type]
            ),
            "'arclength' or 'natural'",
        ),
    ],
)  # fmt: skip
def test_bad_input(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        call()
