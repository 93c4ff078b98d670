from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from hillsphere.errors import InputError
from hillsphere_controllers.mu.blocks import (
    Block,
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.lower_bound import lower_bound
from hillsphere_controllers.mu.upper_bound import UpperBound, upper_bound, upper_bounds

Complex = NDArray[np.complex128]


def random_matrix(random: np.random.Generator, rows: int, columns: int) -> Complex:
    return np.asarray(random.normal(size=(rows, columns, 2)) @ np.array([1.0, 1j]))


def random_blocks(random: np.random.Generator, count: int) -> BlockStructure:
    kinds = [
        repeated_real(1), repeated_real(2), repeated_complex(1), repeated_complex(2), full(2),
        full(1, 2), full(3, 1),
    ]  # fmt: skip
    return BlockStructure([kinds[k] for k in random.integers(len(kinds), size=count)])


def assert_proved(m: Complex, structure: BlockStructure, found: UpperBound) -> None:
    """D and G belong to the structure, and F is positive just above the bound."""
    d, g = found.scalings.d, found.scalings.g
    assert_allclose(d, d.conj().T, rtol=0.0, atol=1e-12 * float(np.abs(d).max()))
    assert_allclose(g, g.conj().T, rtol=0.0, atol=1e-12 * max(float(np.abs(g).max()), 1.0))
    outside = np.ones(d.shape, dtype=bool)
    for span, block in zip(structure.spans(), structure.blocks, strict=True):
        outside[span, span] = False
        if block.kind == "full":
            assert_allclose(d[span, span], d[span.start, span.start] * np.eye(len(d[span, span])))
        if block.kind != "real":
            assert not g[span, span].any()
    assert not d[outside].any()
    assert not g[outside].any()
    squared = structure.pad_to_square(m)
    mh = squared.conj().T
    beta = found.value * (1.0 + 1e-9)
    f = beta**2 * d - mh @ d @ squared - 1j * (g @ squared - mh @ g)
    np.linalg.cholesky(f)


def exact_of_rank_one(a: Complex, b: Complex, structure: BlockStructure) -> float:
    """µ of a bᴴ, which is singular with Δ just if bᴴ Δ a = 1.

    That sum can be any point of t·(segments of the real blocks + disc of the others); the largest
    real one is the minimum of a convex function of one variable.
    """
    real, radius = [], 0.0
    for span, block in zip(structure.spans(), structure.blocks, strict=True):
        if block.kind == "full":
            radius += float(np.linalg.norm(a[span]) * np.linalg.norm(b[span]))
        elif block.kind == "complex":
            radius += float(abs(np.vdot(b[span], a[span])))
        else:
            real.append(complex(np.vdot(b[span], a[span])))
    c = np.array(real)

    def supported(y: float) -> float:
        return float(np.abs(c.real + y * c.imag).sum() + radius * np.hypot(1.0, y))

    kinks = [float(-one.real / one.imag) for one in real]
    smooth = minimize_scalar(supported, bracket=(-1.0, 1.0), tol=1e-12)
    return min([float(smooth.fun), *(supported(y) for y in kinks)])


@settings(derandomize=True, deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6))
def test_matrices_of_rank_one_have_an_exact_solution(seed: int, count: int) -> None:
    """P. M. Young (1994), The rank one mixed µ problem and Kharitonov-type analysis."""
    random = np.random.default_rng(seed)
    kinds = [repeated_real(1), repeated_real(2), repeated_complex(2), full(1), full(3)]
    structure = BlockStructure([kinds[k] for k in random.integers(len(kinds), size=count)])
    a, b = (random_matrix(random, structure.size, 1)[:, 0] for _ in range(2))
    exact = exact_of_rank_one(a, b, structure)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    m = np.outer(a, b.conj())
    upper = upper_bound(m, structure, tolerance=1e-8)
    assert_allclose(upper.value, exact, rtol=1e-6, atol=1e-6 * size)
    lower = lower_bound(m, structure, scalings=upper.scalings, starts=2).value
    assert lower <= upper.value * (1.0 + 1e-9)
    if not structure.purely_real:
        assert_allclose(lower, exact, rtol=1e-6)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5))
def test_scalings_prove_the_bound(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    structure = random_blocks(random, count)
    m = random_matrix(random, *structure.shape)
    found = upper_bound(m, structure)
    if found.value > 1e-4:  # zero is approached only
        assert_proved(m, structure, found)
    assert found.value <= np.linalg.norm(m, 2) * (1.0 + 1e-9)


def slicot(m: Complex, blocks: list[Block]) -> float:
    slycot = pytest.importorskip("slycot")
    kinds = np.array([1 if b.kind == "real" else 2 for b in blocks])
    return float(slycot.ab13md(m, np.array([b.rows for b in blocks]), kinds)[0])


@pytest.mark.parametrize("seed", range(12))
def test_complex_blocks_agree_with_slicot(seed: int) -> None:
    random = np.random.default_rng(seed)
    blocks = [full(int(n)) for n in random.integers(1, 4, size=2 + seed % 5)]
    structure = BlockStructure(blocks)
    m = random_matrix(random, *structure.shape)
    assert_allclose(upper_bound(m, structure).value, slicot(m, blocks), rtol=1e-6)


def test_mixed_blocks_are_never_above_slicot() -> None:
    """Where its iteration stops early, by up to 3 %, the proof of ours is checked."""
    agree = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        kinds = [repeated_real(1), full(1), full(2)][: 1 + seed % 3]
        blocks = [kinds[k] for k in random.integers(len(kinds), size=2 + seed % 5)]
        structure = BlockStructure(blocks)
        m = random_matrix(random, *structure.shape)
        found, other = upper_bound(m, structure), slicot(m, blocks)
        small = 1e-5 * float(np.linalg.norm(m, 2))
        assert found.value <= other * (1.0 + 1e-6) + small
        if found.value >= other * (1.0 - 1e-5) - small:
            agree += 1
        else:
            assert_proved(m, structure, found)
    assert agree >= 34


def test_purely_real_bound_is_below_that_of_slicot_and_right() -> None:
    """Two real scalars where SLICOT stops at 1.3432: the perturbation found proves ours."""
    random = np.random.default_rng(3)
    structure = BlockStructure([repeated_real(), repeated_real()])
    gaps = []
    for _ in range(60):
        m = random_matrix(random, 2, 2)
        found, other = upper_bound(m, structure), slicot(m, list(structure.blocks))
        if found.value > 0.1 and found.value < other * (1.0 - 1e-4):
            assert_proved(m, structure, found)
            lower = lower_bound(m, structure, scalings=found.scalings).value
            gaps.append(found.value / lower - 1.0)
    assert len(gaps) >= 1
    assert min(gaps) <= 1e-5


def test_24_by_24_with_19_blocks() -> None:
    """The size of a satellite's flexible modes; value agrees with SLICOT."""
    random = np.random.default_rng(0)
    blocks = [*[repeated_real()] * 10, *[full(1)] * 6, full(2), full(3), full(3)]
    structure = BlockStructure(blocks)
    m = random_matrix(random, 24, 24)
    found = upper_bound(m, structure)
    assert_allclose(found.value, slicot(m, blocks), rtol=1e-5)
    assert_proved(m, structure, found)


def test_one_block_has_a_closed_form() -> None:
    random = np.random.default_rng(5)
    m = random_matrix(random, 3, 3)
    norm = upper_bound(m, BlockStructure([full(3)]))
    assert_allclose(norm.value, np.linalg.norm(m, 2), rtol=1e-9)
    radius = float(np.abs(np.linalg.eigvals(m)).max())
    assert_allclose(upper_bound(m, BlockStructure([repeated_complex(3)])).value, radius, rtol=1e-5)
    real = np.array([[1.0, 7.0, 0.0], [0.0, -2.0, 3.0], [0.0, 0.0, 1.5]])
    assert_allclose(upper_bound(real, BlockStructure([repeated_real(3)])).value, 2.0, rtol=1e-5)
    turning = np.array([[0.0, 3.0], [-3.0, 0.0]])  # no real eigenvalue
    assert upper_bound(turning, BlockStructure([repeated_real(2)])).value <= 1e-4 * 3.0
    wide = random_matrix(random, 2, 4)
    assert_allclose(
        upper_bound(wide, BlockStructure([full(4, 2)])).value, np.linalg.norm(wide, 2), rtol=1e-9
    )


def test_four_blocks_of_packard_and_doyle() -> None:
    """The bound is 1 although µ is about 0.87, Packard and Doyle (1993), Automatica 29, 71-109."""
    assert_allclose(upper_bound(four_blocks(), BlockStructure([full(1)] * 4)).value, 1.0, rtol=1e-6)


def four_blocks() -> Complex:
    gamma, beta = 3.0 + np.sqrt(3.0), np.sqrt(3.0) - 1.0
    a, b = np.sqrt(2.0 / gamma), 1.0 / np.sqrt(gamma)
    d, f = -np.sqrt(beta / gamma), (1.0 + 1.0j) / np.sqrt(gamma * beta)
    u = np.array([[a, 0.0], [b, b], [b, 1j * b], [d, f]])
    v = np.array([[0.0, a], [b, -b], [b, -1j * b], [-1j * f, -d]])
    return np.asarray(u @ v.conj().T)


def test_zero_and_nearly_zero() -> None:
    structure = BlockStructure([full(1), repeated_real(1)])
    assert upper_bound(np.zeros((2, 2)), structure).value == 0.0
    nilpotent = np.array([[0.0, 1.0], [0.0, 0.0]])
    assert upper_bound(nilpotent, structure).value <= 1e-3
    # one real scalar meets a number with an imaginary part: µ is zero, G without bound
    assert upper_bound(np.array([[1.0 + 0.5j]]), BlockStructure([repeated_real()])).value == 0.0


@pytest.mark.parametrize("factor", [1e-12, 1e9])
def test_size_of_the_matrix_does_not_matter(factor: float) -> None:
    random = np.random.default_rng(8)
    structure = random_blocks(random, 4)
    m = random_matrix(random, *structure.shape)
    assert_allclose(
        upper_bound(factor * m, structure).value, factor * upper_bound(m, structure).value,
        rtol=1e-12,
    )  # fmt: skip


def test_more_freedom_of_the_perturbation_never_lowers_the_bound() -> None:
    random = np.random.default_rng(4)
    m = random_matrix(random, 4, 4)
    real, complex_, whole = (
        upper_bound(m, BlockStructure(blocks)).value
        for blocks in ([repeated_real(2)] * 2, [repeated_complex(2)] * 2, [full(2)] * 2)
    )
    assert real <= complex_ * (1.0 + 1e-6)
    assert complex_ <= whole * (1.0 + 1e-6)


def test_several_frequencies_begin_where_the_last_one_ended() -> None:
    random = np.random.default_rng(6)
    structure = random_blocks(random, 4)
    first, second = (random_matrix(random, *structure.shape) for _ in range(2))
    m = np.array([first + share * second for share in np.linspace(0.0, 0.2, 5)])
    for one, found in zip(m, upper_bounds(m, structure), strict=True):
        assert_allclose(found.value, upper_bound(one, structure).value, rtol=1e-5)


def test_one_bound_for_several_matrices() -> None:
    random = np.random.default_rng(7)
    structure = BlockStructure([repeated_real(), full(1), full(2)])
    m = np.array([random_matrix(random, 4, 4) for _ in range(3)])
    common = upper_bound(m, structure)
    assert common.value >= max(upper_bound(one, structure).value for one in m) * (1.0 - 1e-6)
    for one in m:
        assert_proved(one, structure, common)


def test_a_target_ends_the_search() -> None:
    random = np.random.default_rng(9)
    structure = BlockStructure([full(1)] * 5)
    m = random_matrix(random, 5, 5)
    least = upper_bound(m, structure).value
    enough = upper_bound(m, structure, target=1.05 * least)
    assert least * (1.0 - 1e-6) <= enough.value < 1.05 * least
    assert_proved(m, structure, enough)
    assert_allclose(upper_bound(m, structure, target=0.9 * least).value, least, rtol=1e-5)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.2, 0.95))
def test_skewed_bound_is_the_largest_gain(seed: int, size: float) -> None:
    """Three full blocks or fewer leave no gap.

    m₂₂ + m₂₁ δ m₁₂/(1 − m₁₁ δ) maps the unit circle onto a circle, whose farthest point is known.
    """
    random = np.random.default_rng(seed)
    m = random_matrix(random, 2, 2)
    m[0] *= size / abs(m[0, 0])
    angle = 2.0 * np.pi * np.arange(3) / 3.0
    delta = np.exp(1j * angle)
    points = m[1, 1] + m[1, 0] * delta * m[0, 1] / (1.0 - m[0, 0] * delta)
    found = upper_bound(m, BlockStructure([full(1), full(1)]), skewed=[1])
    assert_allclose(found.value, farthest(points), rtol=1e-5)


def farthest(points: Complex) -> float:
    """Return the largest distance from zero of the circle through three points."""
    x, y, z = points
    w = (z - x) / (y - x)
    centre = x + (y - x) * (w - abs(w) ** 2) / (2j * w.imag)
    return float(abs(centre) + abs(x - centre))


def test_skewed_bound_without_a_proof_for_the_others_is_infinite() -> None:
    m = np.array([[1.2, 1.0], [1.0, 0.0]])
    structure = BlockStructure([full(1), full(1)])
    assert upper_bound(m, structure, skewed=[1]).value == np.inf
    assert np.isfinite(upper_bound(0.8 * m, structure, skewed=[1]).value)


def test_what_does_not_fit() -> None:
    structure = BlockStructure([full(1, 2), repeated_real()])
    with pytest.raises(InputError, match="close a matrix of 3 × 2, got 2 × 3"):
        upper_bound(np.ones((2, 3)), structure)
    with pytest.raises(InputError, match="no block 2"):
        upper_bound(np.ones((3, 2)), structure, skewed=[2])


def test_what_bounds_nothing_is_refused() -> None:
    structure = BlockStructure([repeated_complex(), full(1)])
    with pytest.raises(InputError, match="a skewed problem needs a block"):
        upper_bound(np.eye(2), structure, skewed=[])
    with pytest.raises(InputError, match="tolerance"):
        upper_bound(np.eye(2), structure, tolerance=np.nan)
    assert upper_bound(1e-300 * np.eye(2), structure).value == pytest.approx(1e-300)


def test_a_bound_far_below_the_norm_is_found() -> None:
    """µ of a strictly triangular matrix is zero: Δ feeds nothing back."""
    structure = BlockStructure([repeated_complex(1)] * 3)
    assert upper_bound(np.triu(np.ones((3, 3)), 1), structure).value < 1e-8


def test_skewed_bound_where_only_g_shows_that_the_others_are_harmless() -> None:
    """With δ real in [−1, 1] and M22 = 2j I, the gain c δ (1 − 2j δ)⁻¹ b is |c b|/√5 at most.

    No D alone proves that I − M22 δ is invertible: its norm is two. For one repeated real scalar
    beside one full block the bound is exact (Meinsma, Shrivastava, Iwasaki 1997).
    """
    c, b = np.array([1.0, -2.0]), np.array([[0.5], [3.0]])
    m = np.block([[2j * np.eye(2), b], [c, np.zeros((1, 1))]])
    structure = BlockStructure([repeated_real(2), full(1)])
    found = upper_bound(m, structure, skewed=[1])
    assert_allclose(found.value, abs(c @ b)[0] / np.sqrt(5.0), rtol=1e-4)
    # two outputs and inputs: the largest singular value of the same, for a row and a column more
    rows = np.array([c, np.zeros(2)])
    wide = np.block([[2j * np.eye(2), np.hstack([b, 2.0 * b])], [rows, np.zeros((2, 2))]])
    found = upper_bound(wide, BlockStructure([repeated_real(2), full(2)]), skewed=[1])
    assert_allclose(found.value, abs(c @ b)[0], rtol=1e-4)  # |(b, 2 b)| = √5 |b|
