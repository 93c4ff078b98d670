from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.scenarios import (
    UncertainPlant,
    synthesise_robust,
    worst_case,
)
from hillsphere_controllers.structured.structure import free_state_space
from hillsphere_controllers.structured.synthesis import synthesise
from hillsphere_controllers.systems.algebra import gain, lower_lft


def uncertain(spread: float = 0.6) -> UncertainPlant:
    """Make q̈ + 0.1(1 + δ₂/2)q̇ + (1 + 0.6δ₁)q = w₁ + u, z = (q, u/2), y = q + 0.1 w₂."""
    return UncertainPlant(
        LtiSystem(
            np.array([[0.0, 1.0], [-1.0, -0.1]]),
            np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [-spread, -0.05, 1.0, 0.0, 1.0]]),
            np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]),
            np.array([[0, 0, 0, 0, 0]] * 3 + [[0, 0, 0, 0, 0.5], [0, 0, 0, 0.1, 0]], dtype=float),
        ),
        (1, 1),
        name="oscillator",
    )


def norm_at(plant: UncertainPlant, controller: LtiSystem, delta: Array) -> float:
    return hinf_norm(lower_lft(plant.at(delta).system, controller)).value


def grid(plant: UncertainPlant, controller: LtiSystem, count: int) -> float:
    one = np.linspace(-1.0, 1.0, count)
    return max(norm_at(plant, controller, np.array([a, b])) for a in one for b in one)


def test_plant_at_parameters() -> None:
    made = uncertain().at(np.array([0.5, -1.0]))
    assert_allclose(made.system.a, [[0.0, 1.0], [-1.3, -0.05]], rtol=1e-14)
    assert made.system.shape == (3, 3)


@pytest.mark.parametrize("k", [0.0, -0.7, 0.3])
def test_worst_case_is_that_of_a_grid(k: float) -> None:
    plant, controller = uncertain(), gain(np.array([[k]]))
    found = worst_case(plant, controller)
    assert found[0].gamma >= grid(plant, controller, 7) * (1.0 - 1e-9)
    for scenario in found:
        assert (np.abs(scenario.delta) <= 1.0).all()
        assert_allclose(norm_at(plant, controller, scenario.delta), scenario.gamma, rtol=1e-7)


def many(count: int = 9) -> UncertainPlant:
    """Make q̈ + 0.2 q̇ + (1 + Σ sₖ δₖ) q = w + u with signs sₖ of 0.03, z = y = q."""
    signs = 0.03 * (-1.0) ** np.arange(count)
    b, c = np.zeros((2, count + 2)), np.zeros((count + 2, 2))
    b[1], c[:, 0] = [*signs, 1.0, 1.0], 1.0
    return UncertainPlant(
        LtiSystem(np.array([[0.0, 1.0], [-1.0, -0.2]]), b, c, np.zeros((count + 2, count + 2))),
        (1,) * count,
    )


def test_slopes_point_to_the_worst_of_many_corners() -> None:
    """The softest and the stiffest plant have all δ at corners, of 512."""
    plant, controller = many(), gain(np.array([[0.2]]))
    found = worst_case(plant, controller)
    signs = -np.sign(plant.system.b[1, :9])
    assert_allclose(
        found[0].delta, signs if found[0].delta[0] * signs[0] > 0 else -signs, rtol=0, atol=1e-9
    )
    ends = [norm_at(plant, controller, end * signs) for end in (-1.0, 1.0)]
    assert_allclose(found[0].gamma, max(ends), rtol=1e-7)


def test_worst_cases_that_are_known_are_looked_at() -> None:
    plant, controller = uncertain(), gain(np.array([[-0.7]]))
    worst = worst_case(plant, controller)[0]
    again = worst_case(plant, controller, known=worst.delta[None])
    assert again[0].gamma >= worst.gamma * (1.0 - 1e-9)


def test_instability_is_the_worst_case() -> None:
    """With 1 − k − 0.6 < 0 the softest plant falls over."""
    found = worst_case(uncertain(), gain(np.array([[0.5]])))
    assert found[0].gamma == np.inf
    assert found[0].delta[0] < -0.8


@pytest.mark.slow
def test_robust_design_is_better_where_it_counts() -> None:
    plant, structure = uncertain(), free_state_space(1, 1, 1)
    nominal = synthesise(plant.at(np.zeros(2)), structure, starts=1, effort="quick")
    found = synthesise_robust(plant, structure, starts=1)
    assert found.converged
    assert found.worst.gamma <= 1.005 * found.design.gamma
    assert found.worst.gamma < 0.95 * worst_case(plant, nominal.controller)[0].gamma
    assert found.design.gamma >= nominal.gamma
    assert grid(plant, found.design.controller, 5) <= found.worst.gamma * (1.0 + 1e-6)
    assert len(found.scenarios) > 1
    assert found.starts.size == 1
    assert_allclose(found.each, [found.worst.gamma], rtol=0, atol=0)
    assert_allclose(max(s.gamma for s in found.scenarios), found.design.gamma, rtol=1e-12)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="diagonal"):
        UncertainPlant(uncertain().system, (3, 2))
    with pytest.raises(InputError, match="round"):
        synthesise_robust(uncertain(), free_state_space(1, 1, 1), rounds=0)
