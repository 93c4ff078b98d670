from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.lower_bound import LowerBound, lower_bound, lower_bound_near
from hillsphere_controllers.mu.parameters import UnitPerturbation
from hillsphere_controllers.mu.upper_bound import upper_bound

Complex = NDArray[np.complex128]


def random_matrix(random: np.random.Generator, rows: int, columns: int) -> Complex:
    return np.asarray(random.normal(size=(rows, columns, 2)) @ np.array([1.0, 1j]))


def random_blocks(random: np.random.Generator, count: int) -> BlockStructure:
    kinds = [
        repeated_real(1), repeated_real(2), repeated_complex(1), repeated_complex(2), full(2),
        full(1, 2), full(3, 1),
    ]  # fmt: skip
    return BlockStructure([kinds[k] for k in random.integers(len(kinds), size=count)])


def assert_proved(m: Complex, structure: BlockStructure, found: LowerBound) -> None:
    """Δ belongs to the structure, is as large as claimed and makes I − M Δ singular."""
    delta = found.delta
    inside = np.zeros(delta.shape, dtype=bool)
    sizes = []
    for block, (rows, columns) in zip(structure.blocks, structure.parts(), strict=True):
        part = delta[rows, columns]
        inside[rows, columns] = True
        if block.kind != "full":
            assert_array_equal(part, part[0, 0] * np.eye(block.rows))
        if block.kind == "real":
            assert_array_equal(part.imag, 0.0)
        sizes.append(np.linalg.norm(part, 2))
    assert not delta[~inside].any()
    assert_allclose(1.0 / max(sizes), found.value, rtol=1e-12)
    product = m @ delta
    singular = np.linalg.svd(np.eye(len(m)) - product, compute_uv=False)[-1]
    assert singular <= 1e-8 * max(1.0, float(np.linalg.norm(product, 2)))


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5))
def test_lower_bound_is_proved_and_below_the_upper(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    structure = random_blocks(random, count)
    m = random_matrix(random, *structure.shape)
    upper = upper_bound(m, structure)
    found = lower_bound(m, structure, scalings=upper.scalings, starts=4)
    if found.value > 0.0:
        assert_proved(m, structure, found)
        assert found.value <= upper.value * (1.0 + 1e-9)


def largest_alone(m: Complex, structure: BlockStructure) -> float:
    """Return what one block of M gains by itself: µ of Δ that is zero elsewhere."""
    found = [0.0]
    for block, (rows, columns) in zip(structure.blocks, structure.parts(), strict=True):
        part = m[columns, rows]
        if block.kind == "full":
            found.append(float(np.linalg.norm(part, 2)))
        elif block.kind == "complex":
            found.append(float(np.abs(np.linalg.eigvals(part)).max()))
    return max(found)


def changed(
    random: np.random.Generator, m: Complex, structure: BlockStructure, kind: str
) -> Complex:
    """Return M with zeros, or scaled badly."""
    if kind == "sparse":
        return m * (random.random(m.shape) < 0.3)
    if kind == "triangular":
        return np.triu(m)
    if kind == "badly_scaled":
        return np.asarray(m * 10.0 ** random.uniform(-6.0, 6.0, m.shape))
    made = m.copy()
    for block, (rows, columns) in zip(structure.blocks, structure.parts(), strict=True):
        if kind == "no_full_gain" and block.kind == "full":
            made[columns, rows] = 0.0
    return made


KINDS = ("dense", "sparse", "triangular", "badly_scaled", "no_full_gain")


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4), kind=st.sampled_from(KINDS))
def test_no_block_alone_does_more(seed: int, count: int, kind: str) -> None:
    random = np.random.default_rng(seed)
    structure = random_blocks(random, count)
    m = changed(random, random_matrix(random, *structure.shape), structure, kind)
    found = lower_bound(m, structure, starts=2)
    assert found.value >= largest_alone(m, structure) * (1.0 - 1e-9)
    if found.value > 0.0:
        assert_proved(m, structure, found)


@pytest.mark.parametrize(("seed", "kind"), [(54, "dense"), (166, "triangular")])
def test_searches_over_all_blocks_ended_below_one(seed: int, kind: str) -> None:
    """At 0.94 instead of 1.36, and at nothing."""
    random = np.random.default_rng(seed)
    kinds = [
        repeated_real(1), repeated_real(2), repeated_complex(1), repeated_complex(2), full(2),
        full(1, 2), full(3, 1),
    ]  # fmt: skip
    numbers = random.integers(len(kinds), size=random.integers(1, 6))
    structure = BlockStructure([kinds[k] for k in numbers])
    m = changed(random, random_matrix(random, *structure.shape), structure, kind)
    found = lower_bound(m, structure)
    assert found.value >= largest_alone(m, structure) * (1.0 - 1e-12) > 0.5
    assert_proved(m, structure, found)


def test_a_full_block_that_gains_nothing_by_itself() -> None:
    """µ² = |M₁₂ M₂₁|. The search left along the lengths of vectors, on which nothing depends."""
    random = np.random.default_rng(56)
    random.integers(7, size=random.integers(1, 6))
    m = random_matrix(random, 3, 2) * (random.random((3, 2)) < 0.3)
    assert np.flatnonzero(m).tolist() == [3, 4]
    structure = BlockStructure([full(1, 2), repeated_complex()])
    upper = upper_bound(m, structure)
    found = lower_bound(m, structure, scalings=upper.scalings)
    assert_allclose(found.value, np.sqrt(abs(m[1, 1] * m[2, 0])), rtol=1e-8)
    assert_proved(m, structure, found)
    silent = BlockStructure([full(2), repeated_complex()])
    assert lower_bound(np.diag([0.0, 0.0, 2.0]), silent).value == pytest.approx(2.0, rel=1e-12)


def test_bounds_are_near_to_each_other() -> None:
    """Among random problems with a block that is not real."""
    shares = []
    for seed in range(16):
        random = np.random.default_rng(seed)
        structure = BlockStructure([*random_blocks(random, 1 + seed % 4).blocks, full(2)])
        m = random_matrix(random, *structure.shape)
        upper = upper_bound(m, structure)
        shares.append(lower_bound(m, structure, scalings=upper.scalings).value / upper.value)
    assert np.median(shares) >= 0.999
    assert min(shares) >= 0.9


def test_four_blocks_of_packard_and_doyle() -> None:
    """A. Packard, J. Doyle (1993), The complex structured singular value, Automatica 29, 71-109."""
    gamma, beta = 3.0 + np.sqrt(3.0), np.sqrt(3.0) - 1.0
    a, b = np.sqrt(2.0 / gamma), 1.0 / np.sqrt(gamma)
    d, f = -np.sqrt(beta / gamma), (1.0 + 1.0j) / np.sqrt(gamma * beta)
    u = np.array([[a, 0.0], [b, b], [b, 1j * b], [d, f]])
    v = np.array([[0.0, a], [b, -b], [b, -1j * b], [-1j * f, -d]])
    m = u @ v.conj().T
    structure = BlockStructure([full(1)] * 4)
    found = lower_bound(m, structure)
    assert_allclose(found.value, 0.87235924, rtol=0.0, atol=5e-9)
    assert_proved(m, structure, found)


def test_largest_over_all_phases() -> None:
    """Three complex scalars: two relative phases, searched densely."""
    random = np.random.default_rng(2)
    m = random_matrix(random, 3, 3)
    angle = 2.0 * np.pi * np.arange(180) / 180
    one, two = np.meshgrid(np.exp(1j * angle), np.exp(1j * angle))
    turned = np.stack([np.ones_like(one), one, two], axis=-1)[..., None] * m
    dense = np.abs(np.linalg.eigvals(turned.reshape(-1, 3, 3))).max()
    found = lower_bound(m, BlockStructure([repeated_complex()] * 3)).value
    assert dense <= found * (1.0 + 1e-9)
    assert_allclose(dense, found, rtol=1e-3)


def test_real_eigenvalue_of_a_repeated_real_scalar() -> None:
    m = np.array([[1.0, 7.0, 0.0], [0.0, -2.0, 3.0], [0.0, 0.0, 1.5]])
    structure = BlockStructure([repeated_real(3)])
    found = lower_bound(m, structure)
    assert_allclose(found.value, 2.0, rtol=1e-12)
    assert_allclose(found.delta, -0.5 * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_a_multiple_real_eigenvalue_with_one_eigenvector(seed: int) -> None:
    """Rounding finds it as three, of which two are complex: µ was found to be 0.3."""
    random = np.random.default_rng(seed)
    q = random.normal(size=(3, 3))
    m = np.zeros((4, 4), dtype=complex)
    m[:3, :3] = q @ (np.eye(3) + np.diag(np.ones(2), 1)) @ np.linalg.inv(q)
    m[3, 3] = 0.3
    structure = BlockStructure([repeated_real(3), full(1)])
    found = lower_bound(m, structure)
    assert_allclose(found.value, 1.0, rtol=1e-9)
    assert_proved(m, structure, found)


def test_nothing_is_found_where_nothing_is() -> None:
    turning = np.array([[0.0, 3.0], [-3.0, 0.0]])
    found = lower_bound(turning, BlockStructure([repeated_real(2)]))
    assert found.value == 0.0
    assert not found.delta.any()
    assert lower_bound(np.zeros((2, 2)), BlockStructure([full(2)])).value == 0.0


def test_same_seed_same_perturbation() -> None:
    random = np.random.default_rng(12)
    structure = random_blocks(random, 4)
    m = random_matrix(random, *structure.shape)
    first, second = (lower_bound(m, structure, seed=5) for _ in range(2))
    assert_array_equal(first.delta, second.delta)


def test_frequency_moves_to_where_a_real_scalar_matters() -> None:
    """s³ + 2 s² + 3 s + 5 + δ has its roots on the axis for δ = 1, at √3 rad/s and nowhere near."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-5.0, -3.0, -2.0]])
    b, c = np.array([[0.0], [0.0], [-1.0]]), np.array([[1.0, 0.0, 0.0]])
    system = LtiSystem(a, b, c, np.zeros((1, 1)))
    found = lower_bound_near(system, BlockStructure([repeated_real()]), 1.6)
    assert_allclose(found.value, 1.0, rtol=1e-9)
    assert_allclose(found.frequency_rad_s, np.sqrt(3.0), rtol=1e-9)
    assert_allclose(found.delta, 1.0, rtol=1e-9)


def test_derivatives_of_unit_perturbations() -> None:
    """Against central differences."""
    random = np.random.default_rng(1)
    structure = BlockStructure([repeated_real(2), repeated_complex(2), full(2, 2)])
    unit = UnitPerturbation(structure)
    row, column = random_matrix(random, 6, 2).T
    x = random.uniform(-0.9, 0.9, len(unit.bounds))
    step = 1e-6
    differences = [
        (row @ unit.q(x + dx) @ column - row @ unit.q(x - dx) @ column) / (2.0 * step)
        for dx in step * np.eye(x.size)
    ]
    assert_allclose(unit.derivative(x, row, column), differences, rtol=0.0, atol=1e-8)


def test_what_does_not_fit() -> None:
    with pytest.raises(InputError, match="close a matrix of 1 × 1, got 2 × 2"):
        lower_bound(np.eye(2), BlockStructure([repeated_real()]))
