"""The start from the controller of full order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.structured.reduced_start import reduced_start
from hillsphere_controllers.structured.single_loop import Pid
from hillsphere_controllers.structured.structure import (
    Structure,
    controller_of,
    free_state_space,
    mask_gains,
    static,
)
from hillsphere_controllers.systems.algebra import lower_lft


def plant(seed: int, controls: int = 1) -> LtiSystem:
    """Make an unstable plant of two states, two w, one y, with a direct term from u to y."""
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(2, 2)),
        random.normal(size=(2, 2 + controls)),
        random.normal(size=(controls + 2, 2)),
        0.3 * random.normal(size=(controls + 2, 2 + controls)),
    )


def start(system: LtiSystem, controller: LtiSystem, structure: Structure) -> Array | None:
    return reduced_start(system, controller, structure, np.zeros(structure.size), 1.0)


def gain(value: float) -> LtiSystem:
    return LtiSystem(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[value]]))


@pytest.mark.parametrize("seed", range(3))
def test_with_its_order_it_is_the_controller(seed: int) -> None:
    """With one state more too: the added one is neither driven nor seen."""
    system = plant(seed)
    design = hinf_synthesis(system, 1, 1)
    for order in (design.controller.order, design.controller.order + 1):
        structure = free_state_space(order, 1, 1)
        theta = start(system, design.controller, structure)
        assert theta is not None
        loop = lower_lft(system, controller_of(structure, theta))
        assert loop.is_stable
        assert_allclose(hinf_norm(loop).value, design.norm.value, rtol=1e-6)


def test_constant_gain_of_a_constant_controller_is_itself() -> None:
    """Whatever the direct term from u to y: ẋ = x + w + u, y = x + w₂ + d u."""
    for through in (0.0, 0.1):
        system = LtiSystem(
            np.ones((1, 1)),
            np.array([[1.0, 0.0, 1.0]]),
            np.array([[1.0], [1.0]]),
            np.array([[0.0, 0.0, 1.0], [0.0, 1.0, through]]),
        )
        theta = start(system, gain(-3.0), static(1, 1))
        assert theta is not None
        assert_allclose(theta, [-3.0], rtol=1e-9)


def test_constant_gain_is_the_nearest_in_the_mean_square() -> None:
    """That of a lag in its loop, by the moments of the two states."""
    system = LtiSystem(
        np.array([[-1.0]]), np.array([[1.0, 1.0]]), np.ones((2, 1)), np.zeros((2, 2))
    )
    lag = LtiSystem(np.array([[-2.0]]), np.ones((1, 1)), -np.ones((1, 1)), np.zeros((1, 1)))
    theta = start(system, lag, static(1, 1))
    assert theta is not None
    # ẋ = −x − ξ + w, ξ̇ = x − 2ξ, u = −ξ: from d/dt of E x², E xξ, E ξ² = 0, E xξ/E x² = 2/7
    assert_allclose(theta, [-2.0 / 7.0], rtol=1e-9)


def test_entries_that_are_fixed_stay_and_what_is_not_linear_is_left_out() -> None:
    system = LtiSystem(
        np.array([[-1.0]]), np.array([[1.0, 1.0]]), np.ones((2, 1)), np.zeros((2, 2))
    )
    lag = LtiSystem(np.array([[-2.0]]), np.ones((1, 1)), -np.ones((1, 1)), np.array([[0.5]]))
    fixed = mask_gains(np.array([[-3.0, 1.0], [np.nan, np.nan]]), 1)
    theta = start(system, lag, fixed)
    assert theta is not None
    assert_allclose(theta, [-1.0, 0.5], rtol=1e-12)
    assert start(system, gain(-1.0), Pid(integral=False)) is None


def test_more_unstable_states_than_the_order_are_left_out() -> None:
    unstable = LtiSystem(np.diag([1.0, 2.0]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    assert start(plant(0), unstable, free_state_space(1, 1, 1)) is None
