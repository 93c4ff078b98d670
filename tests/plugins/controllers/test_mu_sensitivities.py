from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.sensitivities import sensitivities
from hillsphere_controllers.mu.upper_bound import upper_bound


@settings(derandomize=True, deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4))
def test_shares_sum_to_one(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    kinds = [repeated_real(2), repeated_complex(), repeated_complex(2), full(2), full(1, 2)]
    chosen = [kinds[k] for k in random.integers(len(kinds), size=count)]
    structure = BlockStructure([*chosen, full(1)])
    m = random.normal(size=(*structure.shape, 2)) @ np.array([1.0, 1j])
    found = sensitivities(m, structure)
    assert_allclose(found.sum(), 1.0, rtol=0.0, atol=3e-4)
    assert found.min() >= -1e-3


def test_rank_one_in_closed_form() -> None:
    """µ of a bᴴ is the sum of |a_k||b_k|: each term over the sum is the block's share."""
    a, b = np.array([1.0, 2.0, -0.5]), np.array([0.5, 1.0 + 1.0j, 2.0])
    found = sensitivities(np.outer(a, b.conj()), BlockStructure([full(1)] * 3))
    terms = np.abs(a) * np.abs(b)
    assert_allclose(found, terms / terms.sum(), rtol=0.0, atol=1e-5)


def test_a_block_without_effect_has_no_share() -> None:
    m = np.diag([2.0, 0.1])
    found = sensitivities(m, BlockStructure([full(1), full(1)]))
    assert_allclose(found, [1.0, 0.0], rtol=0.0, atol=1e-6)


def test_zero_has_no_shares() -> None:
    with pytest.raises(InputError, match="µ is zero"):
        sensitivities(np.zeros((2, 2)), BlockStructure([full(2)]))


def test_blocks_that_act_one_way_have_shares_that_sum_to_one() -> None:
    random = np.random.default_rng(3)
    structure = BlockStructure([repeated_complex(2), full(2), repeated_real(1)])
    for _ in range(4):
        m = np.triu(random.normal(size=(5, 5)) + 1j * random.normal(size=(5, 5)))
        m = 10.0 ** random.uniform(-4.0, 4.0, 5)[:, None] * m
        shares = sensitivities(m, structure)
        assert_allclose(shares.sum(), 1.0, rtol=1e-9)
        assert shares.min() >= 0.0


def test_shares_are_slopes_of_the_bound() -> None:
    random = np.random.default_rng(1)
    structure = BlockStructure([repeated_real(2), repeated_complex(), full(2)])
    m = random.normal(size=(*structure.shape, 2)) @ np.array([1.0, 1j])
    found, step = sensitivities(m, structure), 1e-4
    for k, span in enumerate(structure.spans()):
        logs = []
        for sign in (1.0, -1.0):
            scaled = m.copy()
            scaled[span] *= np.exp(sign * step)
            logs.append(np.log(upper_bound(scaled, structure, tolerance=1e-10).value))
        assert found[k] == pytest.approx((logs[0] - logs[1]) / (2.0 * step), abs=2e-4)


@pytest.mark.parametrize("decades", [0.0, 4.0, 8.0])
def test_units_of_the_blocks_do_not_matter(decades: float) -> None:
    """A change of the units of what passes through a block leaves µ and the shares."""
    random = np.random.default_rng(2)
    structure = BlockStructure([repeated_real(2), repeated_real(1), full(2)])
    m = random.normal(size=structure.shape) + 0.1j * random.normal(size=structure.shape)
    unit = np.repeat(10.0 ** (decades * np.array([0.0, 0.5, -0.5])), [2, 1, 2])
    scaled = unit[:, None] * m / unit
    exact = upper_bound(m, structure, tolerance=1e-8).value
    assert upper_bound(scaled, structure).value == pytest.approx(exact, rel=1e-5)
    assert_allclose(
        sensitivities(scaled, structure), sensitivities(m, structure), rtol=0.0, atol=1e-3
    )
