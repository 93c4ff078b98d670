"""Lyapunov and halo orbits against published values and closed forms.

Howell's orbits of the circular problem are reproduced to their printed digits; libration points
and the linear motion beside them have closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import ConvergenceError, HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch, StepControl, follow
from hillsphere_orbits.correction import correct, fix_component, on_planes
from hillsphere_orbits.libration.ends import ends_of
from hillsphere_orbits.libration.families import Halo, LibrationFamily, Lyapunov
from hillsphere_orbits.stability import multipliers, stability_indices
from hillsphere_orbits.survey import Surveyor

HOWELL = """
0.723268 0.040000 0.198019 1.300177
0.729988 0.215589 0.397259 1.348532
0.753700 0.267595 0.399909 1.211253
0.777413 0.284268 0.361870 1.101099
0.801125 0.299382 0.312474 1.017241
0.817724 0.313788 0.271306 0.978635
"""
"""x₀, z₀, ẏ₀ and half-period of halo orbits about L1, µ = 0.04, distance and rate one, from the
barycentre: Howell, K. C., Three-dimensional, periodic, 'halo' orbits, Celestial Mechanics 32, 1984,
p. 53, table of the L1 family."""

DISTANCE_M, RATE = 1e8, 1e-5
POINT_MASS = 7.0875e-4  # km³/s²


def hill(gravity: Any) -> Any:
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    return create("plant", "hill", body=moon, gravity=gravity)


@cache
def point_mass() -> Any:
    return hill(create("gravity", "point_mass", gm_km3_s2=POINT_MASS))


@cache
def ellipsoid() -> Any:
    return hill(create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.86))


@cache
def circular(mu: float) -> Any:
    """Return the circular three-body problem of a mass ratio, seen from the smaller body."""
    total = DISTANCE_M**3 * RATE**2
    moon = create("body", "moon", primary_gm_m3_s2=(1.0 - mu) * total, semi_major_axis_m=DISTANCE_M)
    gravity = create("gravity", "point_mass", gm_m3_s2=mu * total)
    return create("plant", "three_body", body=moon, gravity=gravity)


def lyapunov(plant: Any, point: str = "L1") -> Lyapunov:
    found = create("orbit_family", "lyapunov", plant=plant, point=point)
    assert isinstance(found, Lyapunov)
    return found


def halo(plant: Any, point: str = "L1", branch: str = "north") -> Halo:
    found = create("orbit_family", "halo", plant=plant, point=point, branch=branch)
    assert isinstance(found, Halo)
    return found


@cache
def howells() -> LibrationFamily:
    return halo(circular(0.04)).family(None, 0.316 * DISTANCE_M, 81)


def nearest(family: LibrationFamily, wanted: Array) -> Array:
    """Return the member (4,) of a family that is nearest to given unknowns (4,)."""
    branch: Branch = family.branch
    i = int(np.argmin(np.sum((branch.z - wanted[:, None]) ** 2, axis=0)))
    z = branch.z[:, i : i + 1]
    for _ in range(6):  # the plane normal to the family through the wanted point
        chord = branch.tangent[:, i : i + 1]
        guess = z + chord * np.sum(chord * (wanted[:, None] - z))
        z = correct(family.problem, guess, on_planes(chord, guess)).require_converged("nearest")
        if np.linalg.norm(z[:, 0] - wanted) < 1e-4:
            break
    return np.asarray(z[:, 0])


@pytest.mark.parametrize("row", range(6))
def test_howell_1984(row: int) -> None:
    """Each printed orbit is, rounded to its six decimals, a member of the family found here.

    All four numbers of five rows are met at once; those of the fourth row to 0.533 of the last
    decimal, no member comes nearer.
    """
    printed = np.array([float(v) for v in HOWELL.strip().splitlines()[row].split()])
    family = howells()
    scales = family.plant.scales
    unit = np.array([DISTANCE_M / scales.length_m] * 2 + [0.0, 1.0 / RATE / scales.time_s])
    unit[2] = DISTANCE_M * RATE / (scales.length_m / scales.time_s)
    origin = np.array([-1.0 + 0.04, 0.0, 0.0, 0.0])
    wanted = (printed + origin) * unit
    near = nearest(family, wanted)
    # along the family, which is straight over a millionth
    beside = correct(
        family.problem, near[:, None] + 1e-5 * unit[:, None],
        on_planes(np.eye(4)[:, 1:2], near[:, None] + 1e-5 * unit[1]),
    ).require_converged("beside")[:, 0]  # fmt: skip
    along = (beside - near) / unit
    steps = np.linspace(-0.5, 0.5, 4001)
    found = (near / unit - origin)[:, None] + along[:, None] * steps
    misses = np.max(np.abs(found - printed[:, None]), axis=0)
    assert misses.min() <= (0.54e-6 if row == 3 else 0.5e-6)


def test_libration_point_of_the_circular_problem() -> None:
    """Euler's quintic for the distance of L1 and L2 (Szebehely 1967, section 4.4)."""
    mu = 0.04
    for name, sign in (("L1", -1.0), ("L2", 1.0)):
        quintic = [1.0, sign * (3 - mu), 3 - 2 * mu, -mu, -sign * 2 * mu, -mu]
        roots = np.roots(quintic)
        (gamma,) = roots[np.abs(roots.imag) < 1e-9].real
        plant = circular(mu)
        found = lyapunov(plant, name).point.x * plant.scales.length_m / DISTANCE_M
        assert found == pytest.approx(sign * gamma, rel=1e-13)


@pytest.mark.parametrize("name, side", [("L1", -1.0), ("L2", 1.0)])
def test_libration_points_of_hill(name: str, side: float) -> None:
    """At ±3^(−1/3), ω² = 2√7 − 1 and growth² = 2√7 + 1 (Szebehely 1967, section 10.4)."""
    point = lyapunov(point_mass(), name).point
    assert point.x == pytest.approx(side * 3.0 ** (-1.0 / 3.0), abs=1e-14)
    assert point.frequency**2 == pytest.approx(2.0 * np.sqrt(7.0) - 1.0, rel=1e-13)
    assert point.growth**2 == pytest.approx(2.0 * np.sqrt(7.0) + 1.0, rel=1e-13)
    assert point.ratio == pytest.approx((point.frequency**2 + 9.0) / (2.0 * point.frequency))


def test_small_lyapunov_orbits_are_the_linear_motion() -> None:
    family = lyapunov(point_mass()).family(None, 300.0, 21)
    amplitude, _ = family.amplitude(family.branch.z)
    period, _ = family.period(family.branch.z)
    assert amplitude[0] == pytest.approx(1e-3 * 3.0 ** (-1.0 / 3.0))
    excess = period - 2.0 * np.pi / family.point.frequency
    # the period departs with the square of the amplitude
    assert 0.0 < excess[0] < 1e-4
    assert excess[10] / excess[5] == pytest.approx((amplitude[10] / amplitude[5]) ** 2, rel=0.05)
    vertical = stability_indices(family.problem.monodromy(family.branch.z))[1]
    # ν² = 4 along z (Szebehely 1967, section 10.4)
    assert vertical[0] == pytest.approx(2.0 * np.cos(2.0 * period[0]), abs=1e-4)


@pytest.mark.parametrize("make", [point_mass, lambda: circular(0.04)])
def test_where_halo_orbits_branch_off(make: Callable[[], Any]) -> None:
    """The vertical index is 2, and the first halo orbit is the planar one to second order."""
    family = halo(make())
    problem, z = family.planar.branching()
    vertical = stability_indices(problem.monodromy(z[:, None]))[1]
    assert vertical[0] == pytest.approx(2.0, abs=1e-9)
    first = family.family(None, 2e-2 * abs(family.point.x) * family.plant.scales.length_m, 21)
    x, height, vy, half = first.branch.z
    assert height[0] == pytest.approx(1e-3 * abs(family.point.x))
    away = np.max(np.abs(np.array([x, vy, half]) - z[:, None]), axis=0)
    assert away[0] < 1e-5
    assert away[-1] / away[10] == pytest.approx((height[-1] / height[10]) ** 2, rel=0.02)


def test_closure_by_taylor_series() -> None:
    """A whole period to 1e-12·max(1e3, λ), all along the family."""
    family = howells()
    orbits = Surveyor(family.plant, family.problem).orbits(family.branch.z, ("",) * 81)
    bound = 1e-12 * np.maximum(1e3, np.abs(multipliers(orbits.monodromy)[0]))
    assert np.all(orbits.residual <= bound)
    assert family.branch.ends == ("the first orbit computed", "largest amplitude 31600 km")


def test_the_two_points_of_hill_mirror_each_other() -> None:
    """Half a turn about z maps Hill's problem on itself: L2 orbits are L1 orbits turned."""
    first, second = (halo(point_mass(), name).family(None, 9e3, 21) for name in ("L1", "L2"))
    sign = np.array([-1.0, 1.0, -1.0, 1.0])[:, None]
    np.testing.assert_allclose(first.branch.z, sign * second.branch.z, rtol=0, atol=1e-10)


def test_south_is_the_mirror_image_of_north() -> None:
    north, south = (halo(point_mass(), "L2", b).family(None, 9e3, 21) for b in ("north", "south"))
    sign = np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(north.branch.z, sign * south.branch.z, rtol=0, atol=1e-10)
    assert north.amplitude(north.branch.z)[0][-1] == pytest.approx(
        9e3 / north.plant.scales.length_m, rel=1e-9
    )


def test_family_between_two_amplitudes() -> None:
    family = lyapunov(ellipsoid(), "L2").family(500.0, 1500.0, 21)
    amplitude, slopes = family.amplitude(family.branch.z)
    ends = amplitude[[0, -1]] * family.plant.scales.length_m
    np.testing.assert_allclose(ends, [500.0, 1500.0], rtol=1e-8)
    np.testing.assert_array_equal(slopes[0], 1.0)


def test_surface_ends_the_family() -> None:
    """About an ellipsoid of Phobos's size the planar orbits meet the surface before halos do."""
    family = lyapunov(ellipsoid()).family(None, None, 21)
    assert family.branch.ends[1] == "the orbit grazes the surface"
    x = family.problem.flow.trajectory(
        family.problem.state(family.branch.z[:, -1:]),
        family.problem.period(family.branch.z[:, -1:]), 4000,
    )[:3, :, 0] * family.plant.scales.length_m  # fmt: skip
    level = np.sum((x / np.array([[13030.0], [11400.0], [9140.0]])) ** 2, axis=0)
    assert level.min() == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(ConvergenceError, match=r"no halo orbits branch off .* grazes the surface"):
        halo(ellipsoid()).family(None, None, 21)


@pytest.mark.slow
def test_orbits_too_sensitive_end_the_family() -> None:
    """Beyond L1 of a heavy body orbits pass it and its primary ever faster, and double the errors.

    Half-periods grow smoothly on the way: no member belongs to the orbits about the primary.
    """
    family = lyapunov(circular(0.1))
    first = family.family(None, 0.01 * DISTANCE_M, 21).branch
    problem = family.problem[0].with_steps(490)
    start = correct(problem, first.z[:, :1], fix_component(0, first.z[0, 0])).require_converged(
        "start"
    )
    branch = follow(
        problem, start[:, 0], np.array([-1.0, 0.0, 0.0]), boundaries=ends_of(problem, family.plant),
        control=StepControl(first=0.05, largest=0.1),
    )  # fmt: skip
    assert branch.ends[1] == "the orbit is too sensitive to be computed"
    assert np.all(np.abs(np.diff(branch.z[2])) < 0.2)
    _, half = problem.flow.with_matrix(problem.state(branch.z), branch.z[2], 490)
    largest = np.max(np.abs(half), axis=(0, 1))
    assert largest[-1] == pytest.approx(1e-12 / 2.0**-52, rel=1e-6)
    assert np.all(largest[:-1] < largest[-1])


@pytest.mark.slow
def test_what_was_found_of_a_sensitive_family_is_kept() -> None:
    family = lyapunov(circular(0.1)).family(None, None, 41)
    assert family.branch.ends[1] == "the orbit is too sensitive to be computed"
    assert family.amplitude(family.branch.z)[0][-1] > 1.5 * abs(family.point.x)
    orbits = Surveyor(family.plant, family.problem).orbits(family.branch.z, ("",) * 41)
    bound = 1e-12 * np.maximum(1e3, np.abs(multipliers(orbits.monodromy)[0]))
    assert np.all(orbits.residual <= bound)


def lopsided() -> Any:
    return hill(
        create(
            "gravity", "harmonics", gm_km3_s2=POINT_MASS, reference_radius_km=11.1,
            normalisation="full", tide_system="none",
            coefficients=[{"n": 2, "m": 1, "c": 1e-2, "s": 2e-2}],
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: lyapunov(point_mass(), "L3"), "L1"),
        (lambda: lyapunov(lopsided()).family(None, 1e3, 21), "mirror planes xy and xz"),
        (lambda: lyapunov(point_mass()).family(2e3, 1e3, 21), "range of amplitudes is empty"),
        (lambda: lyapunov(ellipsoid()).family(4e3, 5e3, 21), "no orbit of amplitude 4 km: .*graz"),
        (lambda: lyapunov(point_mass()).family(None, 1.0, 21), "range of amplitudes is empty"),
    ],
)
def test_what_does_not_exist(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        call()


@pytest.mark.slow
def test_body_that_fills_its_sphere_of_influence() -> None:
    """Nothing balances the attraction outside an ellipsoid so long that it reaches beyond."""
    stretched = hill(create("gravity", "ellipsoid", axes_km=[40, 11, 11], gm_km3_s2=POINT_MASS))
    with pytest.raises(InputError, match="no point L1"):
        _ = lyapunov(stretched).point
