"""Lower bounds of µ from some blocks alone: a family is no more robust than a part of it."""

from __future__ import annotations

import numpy as np
import pytest

import hillsphere_controllers as hc
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.algebra import state_space
from hillsphere_controllers.linear_fractional.left_out import cover_error, without_cover
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_real
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.mu.restrictions import restrictions

CONTROLLER = hc.transfer_function([0.8, 0.4], [0.1, 1.0])


def two_masses(cover: float) -> Lft:
    """Return the loop of two masses of 1 kg on springs, with a block that covers what is left out.

    The spring between them, 1 ± 0.3 N/m, alone couples the second mass: without it a pole is at
    zero, whatever the controller of the first mass. The margin of the spring alone is 1/0.3.
    """
    k = hc.ureal("k", 1.0, plusminus=0.3)
    base = np.array(
        [[0, 1, 0, 0, 0], [-1, -0.15, 0, 0.05, 1], [0, 0, 0, 1, 0], [0, 0.05, 0, -0.05, 0],
         [1, 0, 0, 0, 0]]
    )  # fmt: skip
    force, stretch = np.array([[0, -1, 0, 1, 0]]).T, np.array([[1, 0, -1, 0, 0]])
    plant = state_space(base + force * k * stretch, 4)
    left, right = np.zeros((5, 1)), np.zeros((1, 5))
    left[1], right[0, 0] = cover, cover  # a little of the first mass's own spring
    return hc.feedback(cover_error(plant, left, right), CONTROLLER)


@pytest.mark.parametrize("gap", [0.01, 1e-3])
def test_a_covered_family_has_no_larger_margin_than_the_bare_system(gap: float) -> None:
    loop = two_masses(0.1)
    found = hc.robstab(loop, gap=gap)
    # beside the block's complex Δ, the search found only a Δ of size 5, and said that all is known
    assert found.upper_bound == pytest.approx(1.0 / 0.3, rel=1e-6)
    assert found.lower_bound <= found.upper_bound <= 1.002 * (1.0 + gap) * found.lower_bound
    assert found.worst["k"] == pytest.approx(0.0, abs=1e-9)
    assert found.undecided_gap == 0.0
    assert hc.robstab(without_cover(loop)).upper_bound == pytest.approx(found.upper_bound)


def test_the_gain_has_no_bound_where_stability_is_lost() -> None:
    loop = two_masses(0.1)
    nominal = hc.hinfnorm(loop.nominal).value
    found = hc.robgain(loop, 100.0 * nominal)
    assert found.lower_bound <= found.upper_bound <= 1.0 / 0.3 * (1.0 + 1e-6)


def test_what_is_left_between_the_bounds_is_said() -> None:
    """A real parameter that only turns the poles −1 ± jδ: no Δ is found, none that is excluded."""
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    system = LtiSystem(-np.eye(2), np.eye(2), turn, np.zeros((2, 2)))
    loop = Lft(system, hc.ureal("p", 0.0).uncertainties, (2,))
    found = hc.robstab(loop)
    assert found.upper_bound == np.inf
    assert np.isfinite(found.lower_bound)
    assert found.undecided_gap == np.inf


def test_restrictions_are_each_taken_once_and_keep_performance() -> None:
    blocks = BlockStructure(
        [repeated_real(2, "a"), full(1, 2, "b"), full(1, name="c"), full(2, 1, "performance")]
    )
    p, m = blocks.shape
    system = LtiSystem(
        -np.eye(1), np.ones((1, m)), np.ones((p, 1)), np.arange(float(p * m)).reshape(p, m)
    )
    made = list(restrictions(system, blocks, kept=3))
    names = [tuple(block.name for block in one.structure.blocks) for one in made]
    assert names == [
        ("a", "performance"), ("b", "c", "performance"), ("a", "c", "performance"),
        ("a", "b", "performance"),
    ]  # fmt: skip
    for one in made:
        assert one.system.shape == one.structure.shape
        assert one.rows.size == one.structure.shape[1]


def test_a_peak_of_zero_has_no_relative_gap() -> None:
    """Δ acts on a mode that no output shows: µ is zero, and its certificate ends all the same."""
    system = LtiSystem(
        np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))
    )
    made = certified_peak(system, BlockStructure([full(1)]), gap=1e-6)
    assert made.undecided_gap == 0.0
    assert made.upper == pytest.approx(0.0, abs=1e-6)
