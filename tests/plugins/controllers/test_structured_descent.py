"""The parts of the search that know nothing of control: steps, descent; and peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.descent import descend, sampled_descent
from hillsphere_controllers.structured.minimax import minimax_step
from hillsphere_controllers.structured.peaks import frequencies, gains, refined_peaks


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
    lower = sampled_descent(kinked, far, np.random.default_rng(1))
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
    a = np.zeros((8, 8))
    for k in range(4):
        omega, damping = 10.0 ** random.uniform(-1.5, 1.5), 10.0 ** random.uniform(-4.0, 0.0)
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(omega**2), -2 * damping * omega]]
    b, c = random.normal(size=(8, 3)), random.normal(size=(2, 8))
    system = LtiSystem(a, b, c, np.zeros((2, 3)))
    response = Response(a, b, c, system.d)

    def whole(g: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return g

    points = frequencies(response.poles, np.zeros(0))
    values = gains(response((1j * points).astype(complex)))
    at, high = refined_peaks(response, whole, points, values)
    norm = hinf_norm(system)
    best = int(np.argmax(high))
    assert_allclose(high[best], norm.value, rtol=1e-8)
    assert_allclose(at[best], norm.frequency_rad_s, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("shape", [(1, 4), (2, 3), (4, 3)])
def test_fast_gains(shape: tuple[int, int]) -> None:
    """The largest are exact, and none is above the truth."""
    random = np.random.default_rng(0)
    many = random.normal(size=(30, *shape)) + 1j * random.normal(size=(30, *shape))
    many *= 10.0 ** random.uniform(-2.0, 0.0, 30)[:, None, None]
    truth, found = np.linalg.svd(many, compute_uv=False)[:, 0], gains(many)
    assert_allclose(found.max(), truth.max(), rtol=1e-13)
    assert (found <= truth * (1.0 + 1e-12)).all()
    near = truth > 0.8 * truth.max()
    assert_allclose(found[near], truth[near], rtol=1e-13)
