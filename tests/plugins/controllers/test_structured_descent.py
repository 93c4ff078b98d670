"""The parts of the search that know nothing of control: steps, descent; and peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.descent import descend, gradient_sampling
from hillsphere_controllers.structured.minimax import minimax_step
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.peaks import (
    frequencies,
    gains,
    local_peaks,
    refine_peaks,
    responses,
)
from hillsphere_controllers.structured.pieces import Piece
from hillsphere_controllers.structured.polish import _Linear
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.structure import static


@dataclass
class Spot:
    x: Array
    value: float


class Kinked:
    """8|x₁² − x₂| + (1 − x₁)²: a curved kink with the minimum 0 at (1, 1)."""

    def evaluate(self, x: Array, above: float = np.inf) -> Spot:
        value = 8.0 * abs(x[0] ** 2 - x[1]) + (1.0 - x[0]) ** 2
        return Spot(x, float(value) if value <= above else np.inf)

    def slope(self, point: Spot) -> Array:
        x = point.x
        side = 8.0 * np.sign(x[0] ** 2 - x[1])
        return np.array([side * 2.0 * x[0] - 2.0 * (1.0 - x[0]), -side])


def test_descent_along_a_kink() -> None:
    """BFGS reaches the minimum of a function without a gradient there; sampling gets nearer it."""
    kinked = Kinked()
    found = descend(kinked, kinked.evaluate(np.array([-1.2, 1.0])), iterations=300)
    assert found.value < 1e-4
    far = kinked.evaluate(np.array([0.5, 0.25]))
    lower = gradient_sampling(kinked, far, np.random.default_rng(1))
    assert lower.value < 0.9 * far.value


def test_descent_refuses_points_that_are_higher_when_looked_at_closely() -> None:
    """What `accepted` returns counts, not what the line search saw."""

    def wary(spot: Spot) -> Spot:
        return Spot(spot.x, spot.value + 10.0) if spot.x[0] > 0.0 else spot

    kinked = Kinked()
    start = kinked.evaluate(np.array([-1.2, 1.0]))
    found = descend(kinked, start, iterations=60, accepted=wary)
    assert found.value < start.value
    assert found.x[0] <= 0.0


@pytest.mark.parametrize("seed", range(5))
def test_step_meets_the_conditions_of_a_minimum(seed: int) -> None:
    """H d = −Σ λ g, Σ λ = 1, and multipliers only where the linear functions are highest."""
    random = np.random.default_rng(seed)
    count, n = 6, 4
    slopes, levels = random.normal(size=(count, n)), -random.uniform(0.0, 1.0, count)
    root = random.normal(size=(n, n))
    hessian = root @ root.T + 0.1 * np.eye(n)
    hard = np.arange(count) >= 4
    found = minimax_step(levels, slopes, hard, hessian, 100.0)
    assert found is not None
    assert_allclose(hessian @ found.step, -found.multipliers @ slopes, rtol=0, atol=1e-8)
    assert_allclose(found.multipliers[~hard].sum(), 1.0, rtol=1e-9)
    model = levels + slopes @ found.step
    slack = np.where(hard, -model, model[~hard].max() - model)
    assert (slack > -1e-9).all()
    assert_allclose(found.multipliers * slack, 0.0, rtol=0, atol=1e-8)
    fall = levels[~hard].max() - model[~hard].max() - 0.5 * found.step @ hessian @ found.step
    assert_allclose(found.predicted, fall, rtol=1e-9)


def test_no_step_without_a_positive_hessian() -> None:
    none = np.zeros(1, dtype=bool)
    assert minimax_step(np.zeros(1), np.ones((1, 2)), none, np.diag([1.0, -1.0]), 1.0) is None


@pytest.mark.parametrize("seed", range(12))
def test_peaks_reach_the_norm(seed: int) -> None:
    """Resonances of damping 1e-4 … 1: the fast search finds what the level sets certify."""
    random = np.random.default_rng(seed)
    systems = []
    for _ in range(2):
        a = np.zeros((8, 8))
        for k in range(4):
            omega, damping = 10.0 ** random.uniform(-1.5, 1.5), 10.0 ** random.uniform(-4.0, 0.0)
            place = slice(2 * k, 2 * k + 2)
            a[place, place] = [[0, 1], [-(omega**2), -2 * damping * omega]]
        b, c = random.normal(size=(8, 3)), random.normal(size=(2, 8))
        systems.append(LtiSystem(a, b, c, np.zeros((2, 3))))
    many = [Response(s.a, s.b, s.c, s.d, modes=True) for s in systems]
    points, owner = frequencies(np.array([r.poles for r in many]), [np.zeros(0), np.ones(1)])
    values = gains(responses(many, points, owner), owner)
    at, high, owner = refine_peaks(many, lambda g: g, points, values, owner)
    for j, system in enumerate(systems):
        norm = hinf_norm(system)
        best = int(np.argmax(np.where(owner == j, high, 0.0)))
        assert_allclose(high[best], norm.value, rtol=1e-8)
        assert_allclose(at[best], norm.frequency_rad_s, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("multiple", [False, True])
def test_derivatives_of_a_response(multiple: bool) -> None:
    """By modes, and with a double pole that has one eigenvector, by the Schur form."""
    a = np.array([[-1.0, 1.0 if multiple else 0.0, 0.3], [0.0, -1.0, 0.0], [0.0, 0.0, -0.2]])
    random = np.random.default_rng(0)
    b, c, d = random.normal(size=(3, 2)), random.normal(size=(4, 3)), random.normal(size=(4, 2))
    response, omega, step = Response(a, b, c, d, modes=True), np.array([0.0, 0.3, 2.0]), 1e-5
    exact = [c @ np.linalg.inv(1j * w * np.eye(3) - a) @ b + d for w in omega]
    g, first, second = response.derivatives(omega)
    assert_allclose(g, exact, rtol=1e-12)
    assert_allclose(response(1j * omega), exact, rtol=1e-12)
    above, below = response.derivatives(omega + step), response.derivatives(omega - step)
    assert_allclose(first, (above[0] - below[0]) / (2.0 * step), rtol=0, atol=1e-6)
    assert_allclose(second, (above[1] - below[1]) / (2.0 * step), rtol=0, atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 4), (2, 3), (4, 3)])
def test_fast_gains(shape: tuple[int, int]) -> None:
    """The largest is exact, and none is above the truth."""
    random = np.random.default_rng(0)
    many = random.normal(size=(30, *shape)) + 1j * random.normal(size=(30, *shape))
    many *= 10.0 ** random.uniform(-2.0, 0.0, 30)[:, None, None]
    truth, found = np.linalg.svd(many, compute_uv=False)[:, 0], gains(many)
    assert_allclose(found.max(), truth.max(), rtol=1e-13)
    assert (found <= truth * (1.0 + 1e-12)).all()


@pytest.mark.parametrize("shape", [(1, 4), (2, 3), (4, 3)])
def test_local_maxima_of_fast_gains_are_the_true_ones(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    many = random.normal(size=(60, *shape)) + 1j * random.normal(size=(60, *shape))
    owner = np.repeat([0, 1, 3], [30, 1, 29])
    many[owner == 1] *= 1e-3
    truth = np.linalg.svd(many, compute_uv=False)[:, 0]
    found = local_peaks(gains(many, owner), owner)
    assert found.tolist() == local_peaks(truth, owner).tolist()
    assert_allclose(gains(many, owner)[found], truth[found], rtol=1e-13)
    for k in np.unique(owner):
        assert np.argmax(np.where(owner == k, truth, 0.0)) in found


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_gain_that_a_parameter_alone_makes_holds_the_step(side: float) -> None:
    """The largest of 1 − s x and |10 x + 1e-6| is least at s/11, on either side of zero."""
    falls = Piece(0.0, np.array([-side]), 0, 0, 1.0, 0, False)
    grows = Piece(float(np.log(1e-6)), np.array([1e7]), 0, 1, np.inf, 0, False)
    found = _Linear.of([falls, grows], 0.0).step(1e-9 * np.eye(1), 10.0)
    assert found is not None
    assert_allclose(found.step, [side / 11.0], rtol=1e-5)
    assert_allclose(found.predicted, 1.0 / 11.0, rtol=1e-5)


def test_what_many_plants_have_in_common_counts_once() -> None:
    a, b, c = -np.eye(2), np.ones((2, 2)), np.array([[1.0, 0.5], [0.0, 0.0], [1.0, 0.0]])
    d = np.array([[0.0, 0.0], [0.0, 4.0], [1.0, 0.0]])
    plants = [LtiSystem(k * a, b, c, d) for k in (1.0, 1.0, 1.1)]
    structure = static(1, 1)
    loops = [OpenLoop(DesignPlant(one), structure) for one in plants]
    objective = Objective(loops, structure, np.zeros(1), np.ones(1))
    point = objective.evaluate(np.array([-0.4]))
    pieces = objective.pieces(point)
    direct = [p for p in pieces if np.isinf(p.omega_rad_s)]
    assert [p.plant for p in direct] == [0]
    assert_allclose(np.exp(direct[0].level), 1.6, rtol=1e-12)
    assert_allclose(direct[0].slope, [-2.5], rtol=1e-12)
    # the first two plants are the same: their gains at zero count once, that of the third by itself
    assert sorted(p.plant for p in pieces if p.omega_rad_s == 0.0) == [0, 2]


def test_a_plant_without_states_has_modes_without_any(capfd: pytest.CaptureFixture[str]) -> None:
    none = np.zeros((0, 0))
    d = np.array([[1.0, 0.5], [0.0, 0.3], [1.0, 0.0]])
    for one in (
        *Response.of_many(np.zeros((2, 0, 0)), np.zeros((2, 0, 2)), np.zeros((2, 3, 0)), d[None]
                          * np.array([1.0, 2.0])[:, None, None]),
        Response(none, np.zeros((0, 2)), np.zeros((3, 0)), d, modes=True),
    ):  # fmt: skip
        assert one.poles.size == 0
        assert one(np.array([1j])).shape == (1, 3, 2)
    assert capfd.readouterr() == ("", "")  # LAPACK tells of what it refuses
