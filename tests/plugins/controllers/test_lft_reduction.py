from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.linear_fractional.algebra import (
    dynamics,
    join_inputs,
    matrix_block,
    parameter,
    stack_outputs,
    state_space,
)
from hillsphere_controllers.linear_fractional.polynomials import affine, polynomial
from hillsphere_controllers.linear_fractional.reduction import (
    ReducedLft,
    gain_bound,
    minimal,
    reduce_lft,
)
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import (
    corners,
    random_values,
    real_parameter,
)
from hillsphere_controllers.systems.algebra import gain

A, B = real_parameter("a", 1.0, 3.0), real_parameter("b", -1.0, 1.0, 0.5)


def difference(one: Lft, other: Lft, count: int = 2_000) -> float:
    """Return the largest singular value at random values and all corners, of [A B; C D]."""
    values = random_values((A, B), count, seed=77)
    for u, ends in corners((A, B)).items():
        values[u] = np.concatenate([values[u], ends])

    def whole(of: Lft) -> Array:
        a, b, c, d = of.matrices({u.name: values[u.name] for u in of.uncertainties})
        return np.concatenate(
            [np.concatenate([a, b], axis=2), np.concatenate([c, d], axis=2)], axis=1
        )

    return float(np.linalg.norm(whole(one) - whole(other), 2, axis=(1, 2)).max())


def nearly_of_low_rank(seed: int, size: int = 3) -> Lft:
    random = np.random.default_rng(seed)
    terms: dict[tuple[int, ...], Array] = {(0, 0): random.normal(size=(size, size))}
    for e in [(1, 0), (0, 1), (1, 1)]:
        strong = np.outer(random.normal(size=size), random.normal(size=size))
        terms[e] = 0.2 * strong + 1e-3 * random.normal(size=(size, size))
    return polynomial(terms, (A, B))


def test_what_is_not_reached_or_not_seen_goes() -> None:
    a, b = parameter(A), parameter(B)
    vanishing = a @ b - a @ b + b
    assert vanishing.size == 5
    assert minimal(vanishing).times == (1,)
    # a multiplied by what no input drives, and what nobody reads
    unreached = join_inputs(b, a @ b @ np.zeros((1, 1)))
    assert minimal(unreached).times == (1,)
    unseen = stack_outputs(b, np.zeros((1, 1)) @ a @ b)
    assert minimal(unseen).times == (1,)


def test_products_in_another_order_are_not_the_same() -> None:
    """A b − b a is zero for numbers, but not for the matrices of which minimality is proved."""
    a, b = parameter(A), parameter(B)
    assert minimal(a @ b - b @ a).size > 0
    assert_allclose(difference(a @ b - b @ a, Lft(gain(np.zeros((1, 1))))), 0.0, rtol=0, atol=1e-14)


def test_minimal_in_uneven_units_loses_nothing() -> None:
    rows, columns = np.diag([1e-9, 1.0, 1e9]), np.diag([1e6, 1e-6, 1.0])
    made = nearly_of_low_rank(3)
    uneven = rows @ (made + (made - made)) @ columns
    found = minimal(uneven)
    assert found.size == made.size
    values = random_values((A, B), 100)
    expected = rows @ made.matrices(values)[3] @ columns
    error = np.abs(found.matrices(values)[3] - expected).max(axis=0)
    assert (error <= 1e-11 * np.abs(expected).max(axis=0)).all()


def test_full_blocks_stay() -> None:
    made = stack_outputs(
        matrix_block("wheel", 1, 2), np.zeros((1, 1)) @ matrix_block("wheel", 1, 2)
    )
    assert minimal(made).times == (2,)
    assert minimal(Lft(gain(np.eye(2)))).size == 0


def assert_covered(whole: Lft, found: ReducedLft) -> None:
    """At 200 corners the error is L Δ R with a Δ of norm one at most."""
    random = np.random.default_rng(5)
    names = {u.name: u for u in whole.uncertainties}
    values = {n: random.choice([u.lower, u.upper], 200) for n, u in names.items()}
    kept = {u.name for u in found.truncated.uncertainties}
    there = whole.matrices(values)
    here = found.truncated.matrices({n: v for n, v in values.items() if n in kept})
    error = np.block([[a - b for a, b in zip(there[k : k + 2], here[k : k + 2], strict=True)]
                      for k in (0, 2)])  # fmt: skip
    cover, (out, into) = found.lft.uncertainties[-1], found.truncated.closed_channels
    assert cover.covers
    m11, m12, m21, _ = found.lft.parts()
    left, right = m21[:, into:], m12[out:]
    assert not m11[out:].any()
    assert not m11[:, into:].any()
    delta = np.linalg.pinv(left) @ error @ np.linalg.pinv(right)
    assert_allclose(left @ delta @ right, error, rtol=0, atol=1e-9 * np.abs(error).max())
    sizes = np.linalg.norm(delta, 2, axis=(1, 2))
    assert 0.05 < sizes.max() <= 1.0 + 1e-6


@pytest.mark.parametrize("tolerance", [0.003, 0.02, 1.0])
def test_the_error_is_below_its_bound_and_that_below_the_tolerance(tolerance: float) -> None:
    full = nearly_of_low_rank(0)
    found = reduce_lft(full, tolerance)
    assert found.truncated.size < full.size
    assert found.bound <= tolerance
    assert difference(full, found.truncated) <= found.bound * (1.0 + 1e-6)
    assert_covered(full, found)
    assert found.sampled <= found.bound * (1.0 + 1e-6)
    assert found.sampled > 0.5 * found.bound
    assert_allclose(found.lft.nominal.d, full.nominal.d, rtol=0, atol=1e-12)


def test_the_weak_part_of_a_matrix_of_low_rank_goes() -> None:
    """P_a = u vᵀ + ε: one copy of a of three is left, and the error is what is left out."""
    u, v = np.array([1.0, 2.0, 0.0]), np.array([0.5, -1.0, 1.0])
    weak = 1e-3 * np.diag([1.0, -1.0, 1.0])
    made = affine(np.eye(3), {"a": np.outer(u, v) + weak, "b": np.diag([0.3, 0.0, 0.0])}, (A, B))
    assert made.times == (3, 1)
    found = reduce_lft(made, 2e-3)
    assert found.truncated.times == (1, 1)
    assert [u.name for u in found.lft.uncertainties] == ["a", "b", "left_out"]
    kept = np.linalg.svd(np.outer(u, v) + weak)
    # half the range of a is 1
    assert_allclose(found.bound, kept.S[1], rtol=1e-3)


def test_reduction_with_states_counts_their_matrices() -> None:
    made = state_space(nearly_of_low_rank(1, 4), 2)
    found = reduce_lft(made, 0.02)
    assert found.truncated.size < made.size
    assert found.lft.system.order == 2
    assert difference(made, found.truncated) <= found.bound * (1.0 + 1e-6) <= 0.02
    assert_covered(made, found)


def test_without_a_tolerance_nothing_changes() -> None:
    made = nearly_of_low_rank(2)
    found = reduce_lft(made + (made - made), 0.0)
    assert found.lft.size == made.size
    assert found.bound == 0.0
    assert found.sampled < 1e-13
    with pytest.raises(InputError, match="≥ 0"):
        reduce_lft(made, -1.0)


def test_gain_bound_in_closed_form() -> None:
    """1/(1 + δ/2): at most 2, at δ = −1; and 1 + 0.3 Δ with any Δ of norm one: 1.3."""
    made = Lft(gain(np.array([[-0.5, 1.0], [-0.5, 1.0]])), (real_parameter("d", -1.0, 1.0),), (1,))
    assert_allclose(gain_bound(made), 2.0, rtol=1e-5)
    assert gain_bound(made) >= 2.0
    assert_allclose(gain_bound(np.eye(1) + 0.3 * dynamics("error")), 1.3, rtol=1e-5)
    assert_allclose(gain_bound(Lft(gain(np.diag([3.0, 1.0])))), 3.0, rtol=1e-15)


def test_without_existence_there_is_no_bound() -> None:
    """1/(1 + 2 δ) has a pole at δ = −1/2."""
    made = Lft(gain(np.array([[-2.0, 1.0], [-2.0, 1.0]])), (real_parameter("d", -1.0, 1.0),), (1,))
    assert gain_bound(made) == np.inf
