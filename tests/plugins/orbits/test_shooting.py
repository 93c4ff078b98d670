"""Both shooting problems on a plant of the test's own: planar Hill with a point mass.

Closed forms at the libration point: the linear motion has multipliers of planar frequency
ω² = 2√7 − 1 and growth λ² = 2√7 + 1 (Szebehely, Theory of Orbits, 1967, section 10.4).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from hillsphere.dynamics import Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, power, sum_of
from hillsphere_orbits.continuation import Boundary, StepControl, follow
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.shooting import PeriodicShooting, Shooting, SymmetricShooting
from hillsphere_orbits.stability import stability_indices

L2 = 3.0 ** (-1.0 / 3.0)
OMEGA, GROWTH = np.sqrt(2 * np.sqrt(7) - 1), np.sqrt(2 * np.sqrt(7) + 1)


class PlanarHill:
    """ẍ = 2ẏ + 3x − x/r³, ÿ = −2ẋ − y/r³; nothing of it comes from a plugin."""

    frame = "hill:moon"
    states = (Variable("x", 1), Variable("y", 1), Variable("u", 1, -1), Variable("v", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)
    integral_variable = Variable("c", 2, -2)
    mirrors: Mapping[str, tuple[int, ...]] = {"x": (1, -1, -1, 1)}

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        px, py, vx, vy = x
        pull = power(px * px + py * py, -1.5)
        return vx, vy, 2.0 * vy + 3.0 * px - pull * px, -2.0 * vx - pull * py

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        px, py, vx, vy = x
        speed = vx * vx + vy * vy
        return sum_of([1.5 * px * px, power(px * px + py * py, -0.5), -0.5 * speed])


class Forced(PlanarHill):
    """The same with a push that depends on time."""

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        vx, vy, ax, ay = super().derivative(x, u, t, p)
        return vx, vy, ax + 0.1 * t, ay


@pytest.fixture(scope="module")
def flow() -> Flow:
    return Flow(system(PlanarHill()))


def symmetric(flow: Flow) -> SymmetricShooting:
    return SymmetricShooting(flow, (1, -1, -1, 1), steps=60)


def near_l2(problem: Shooting, amplitude: float) -> Array:
    """Return the Lyapunov orbit that crosses the axis at x = L2 − amplitude, from the linear one.

    With ξ = −a cos ωt: η = a κ sin ωt, κ = (ω² + 9)/(2ω), hence v = a κ ω at the crossing.
    """
    v = amplitude * (OMEGA**2 + 9.0) / 2.0
    x = np.array([[L2 - amplitude, 0.0, 0.0, v]]).T
    guess = problem.unknowns_at(x, np.array([2 * np.pi / OMEGA]))
    return correct(problem, guess, fix_component(0, L2 - amplitude)).require_converged("near L2")


def test_small_lyapunov_orbit_has_the_linear_period_and_index(flow: Flow) -> None:
    problem = symmetric(flow)
    z = near_l2(problem, 1e-4)
    # corrections are of the order of the amplitude squared
    assert problem.period(z)[0] == pytest.approx(2 * np.pi / OMEGA, abs=1e-6)
    planar, _ = stability_indices(problem.monodromy(z))
    assert planar[0] == pytest.approx(2 * np.cosh(2 * np.pi * GROWTH / OMEGA), rel=1e-5)


@pytest.mark.parametrize("kind", ["symmetric", "periodic"])
def test_exact_jacobian(flow: Flow, kind: str) -> None:
    half = symmetric(flow)
    problem: Shooting = half if kind == "symmetric" else PeriodicShooting(flow, "y")
    orbit = near_l2(half, 0.02)
    z = problem.unknowns_at(half.state(orbit), half.period(orbit)) + 1e-3
    _, slopes = problem.residual(z)
    step = 1e-5
    for j in range(len(problem.unknowns)):
        shift = np.zeros_like(z)
        shift[j] = step
        change = problem.residual(z + shift)[0] - problem.residual(z - shift)[0]
        # derivatives of the order of the multiplier, 2000, to the square of the step
        np.testing.assert_allclose(slopes[:, j], change / (2 * step), rtol=1e-4, atol=1e-3)


def test_lyapunov_family_both_problems_agree(flow: Flow) -> None:
    """Follow the family on a mirror; correct its members without using the mirror."""
    problem = symmetric(flow)
    start = near_l2(problem, 1e-3)[:, 0]
    edge = Boundary("x = 0.45", lambda z: z[0] - 0.45)
    control = StepControl(first=0.01, largest=0.1)
    branch = follow(problem, start, np.array([-1.0, 0.0, 0.0]), boundaries=[edge], control=control)
    assert branch.ends[1] == "x = 0.45"
    z, x = branch.z, problem.state(branch.z)
    whole = PeriodicShooting(flow, "y", steps=120)
    guess = whole.unknowns_at(x, problem.period(z)) + 1e-7
    found = correct(whole, guess, fix_component(0, x[0]), tolerance=1e-11).require_converged(
        "no mirror"
    )
    np.testing.assert_allclose(whole.state(found), x, rtol=0, atol=3e-10)
    np.testing.assert_allclose(whole.period(found), problem.period(z), rtol=0, atol=3e-10)
    index, other = (stability_indices(p.monodromy(v))[0] for p, v in ((problem, z), (whole, found)))
    np.testing.assert_allclose(index, other, rtol=1e-6)


def test_closure_by_taylor_series(flow: Flow) -> None:
    problem = symmetric(flow)
    z = near_l2(problem, 0.05)
    end = Taylor(flow.system).propagate(problem.state(z), problem.period(z))
    # rounding, times a multiplier of about 2000
    assert np.max(np.abs(end - problem.state(z))) < 1e-11


def test_more_sub_steps_give_the_same_orbit(flow: Flow) -> None:
    problem = symmetric(flow)
    z = near_l2(problem, 0.03)
    finer = near_l2(problem.with_steps(150), 0.03)
    assert problem.with_steps(150).steps == 150
    np.testing.assert_allclose(finer, z, rtol=0, atol=1e-13)


def test_mirrors_are_tried(flow: Flow) -> None:
    x = np.random.default_rng(5).normal(size=(4, 20)) + 1.0
    assert flow.keeps((1, -1, -1, 1), x, reverses_time=True)
    assert flow.keeps((-1, 1, 1, -1), x, reverses_time=True)
    assert flow.keeps((-1, -1, -1, -1), x, reverses_time=False)
    assert not flow.keeps((1, -1, 1, -1), x, reverses_time=True)


def test_bad_problems_are_refused(flow: Flow) -> None:
    with pytest.raises(InputError, match="one sign per state"):
        SymmetricShooting(flow, (1, -1))
    with pytest.raises(InputError, match="3 unknown states for 1 conditions"):
        SymmetricShooting(flow, (1, -1, 1, 1))
    with pytest.raises(InputError, match="no state 'z'; it has x, y, u, v"):
        PeriodicShooting(flow, "z")


def test_explicit_time_is_refused() -> None:
    with pytest.raises(InputError, match="without explicit time"):
        Flow(system(Forced()))


def test_stages_of_one_plant_share_its_code() -> None:
    plant = PlanarHill()
    assert flow_of(plant) is flow_of(plant)
