"""Bounds of µ where blocks, or performance, are in very different units."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.balance import balance, level_units
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_complex, repeated_real
from hillsphere_controllers.mu.lower_bound import lower_bound
from hillsphere_controllers.mu.upper_bound import upper_bound
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain

TWO = BlockStructure([full(1), full(1)])


@pytest.mark.parametrize("decades", [0, 8, 10, 12, 16, 20, 50])
@pytest.mark.parametrize("own", [0.0, 0.5])
def test_two_scalars_in_very_different_units(decades: int, own: float) -> None:
    """[[d, 10ᵉ], [10⁻ᵉ, 0]]: µ is the larger root of µ² = d µ + 1."""
    m = np.array([[own, 10.0**decades], [10.0**-decades, 0.0]])
    exact = 0.5 * own + np.sqrt(0.25 * own**2 + 1.0)
    assert_allclose(upper_bound(m, TWO).value, exact, rtol=1e-6)
    assert_allclose(lower_bound(m, TWO).value, exact, rtol=1e-6)


@pytest.mark.parametrize("decades", [4.0, 12.0])
def test_units_of_blocks_change_no_bound(decades: float) -> None:
    random = np.random.default_rng(5)
    structure = BlockStructure([repeated_real(2), full(2), full(1), repeated_complex(2)])
    m = random.normal(size=(7, 7, 2)) @ np.array([1.0, 1j])
    sizes = 10.0 ** random.uniform(-decades, decades, 7)
    sizes[3] = sizes[2]  # the full block
    other = sizes[:, None] * m / sizes
    assert_allclose(upper_bound(other, structure).value, upper_bound(m, structure).value, rtol=2e-6)
    skewed = [upper_bound(0.05 * one, structure, skewed=[1, 2]).value for one in (m, other)]
    assert_allclose(skewed[1], skewed[0], rtol=2e-6)


def test_rows_and_columns_are_alike() -> None:
    random = np.random.default_rng(1)
    m = random.normal(size=(2, 4, 4)) * 10.0 ** random.uniform(-9.0, 9.0, (4, 1))
    root = balance(m, BlockStructure([repeated_real(2), full(1), full(1)]))
    even = np.sum((root[:, None] * m / root) ** 2, axis=0)
    np.fill_diagonal(even, 0.0)
    assert_allclose(even.sum(axis=0), even.sum(axis=1), rtol=0.1)
    assert_allclose(np.sum(root**2), 4.0)
    assert np.ptp(balance(m, BlockStructure([full(4)]))) == 0.0


def test_what_feeds_nothing_back_is_moved_apart() -> None:
    m = np.array([[[1.0, 1e9, 0.0], [0.0, 0.5, 1e3], [0.0, 0.0, 0.2]]])
    root = balance(m, BlockStructure([full(1)] * 3))
    small = np.triu((root[:, None] * m / root)[0], 1)
    assert np.abs(small).max() <= 1.01e-9
    assert_allclose(upper_bound(m[0], BlockStructure([full(1)] * 3)).value, 1.0, rtol=1e-6)


def test_level_of_a_skewed_problem_is_in_its_own_unit() -> None:
    m = np.array([[[0.5, 1e-4], [2e4, 3.0]]])
    free = np.array([False, True])
    unit = level_units(m, TWO, free)
    for factor in (1e-12, 1e12):
        scaled = m * np.array([[1.0], [factor]])
        assert_allclose(level_units(scaled, TWO, free), unit * [1.0, factor], rtol=1e-9)


@pytest.mark.parametrize("damping", [1e-2, 1e-4, 1e-5, 1e-6])
def test_worst_gain_of_a_mode_of_very_light_damping(damping: float) -> None:
    """1/(s² + 2 ζ s + 1 + 0.1 δ) peaks at 1/(2 ζ √(0.9 − ζ²)), for δ = −1."""
    loop = LtiSystem(
        np.array([[0.0, 1.0], [-1.0, -2.0 * damping]]), np.array([[0.0, 0.0], [-0.1, 1.0]]),
        np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)),
    )  # fmt: skip
    exact = 1.0 / (2.0 * damping * np.sqrt(0.9 - damping**2))
    found = worst_case_gain(loop, BlockStructure([repeated_real(1, "k")]))
    assert 0.998 * exact <= found.lower <= exact * (1.0 + 1e-6)
    assert exact * (1.0 - 1e-9) <= found.upper <= 1.0101 * exact


def test_worst_gain_of_two_modes_far_apart() -> None:
    """A mode at 1 rad/s and one at 0.01, each 10 % uncertain; a corner gives the largest gain."""
    zeta, soft = 1e-4, 1e-4
    a = np.zeros((4, 4))
    a[:2, :2] = [[0.0, 1.0], [-1.0, -2.0 * zeta]]
    a[2:, 2:] = [[0.0, 1.0], [-soft, -2.0 * zeta * np.sqrt(soft)]]
    b = np.array([[0.0, 0.0, 0.0], [-0.1, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, -0.1 * soft, 1.0]])
    c = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]])
    loop = LtiSystem(a, b, c, np.zeros((3, 3)))
    found = worst_case_gain(loop, BlockStructure([repeated_real(1, "d"), repeated_real(1, "e")]))
    # the soft mode alone, at its softest
    alone = 1.0 / (2.0 * zeta * soft * np.sqrt(0.9 - zeta**2))
    assert_allclose([found.lower, found.upper], alone, rtol=0.011)
    assert found.lower <= found.upper
