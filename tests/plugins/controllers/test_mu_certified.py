from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.optimize import brentq

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu import certified
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak, find_unproved
from hillsphere_controllers.mu.scalings import Scalings
from hillsphere_controllers.mu.upper_bound import upper_bound
from hillsphere_controllers.systems.bilinear import discrete

Complex = NDArray[np.complex128]


def random_system(
    seed: int, structure: BlockStructure, modes: int, *, damping: float, decades: float
) -> LtiSystem:
    """Oscillators of about the same gain, the least damped as given, mixed by a rotation."""
    random = np.random.default_rng(seed)
    p, m = structure.shape
    n = 2 * modes
    a, root = np.zeros((n, n)), np.ones(n)
    for k in range(modes):
        omega = 10.0 ** random.uniform(-0.5 * decades, 0.5 * decades)
        zeta = 10.0 ** random.uniform(np.log10(damping), -0.3)
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = omega * np.array([[-zeta, 1.0], [-1.0, -zeta]])
        root[2 * k : 2 * k + 2] = np.sqrt(omega * zeta)
    turn = np.linalg.qr(random.normal(size=(n, n)))[0]
    b = turn @ (root[:, None] * random.normal(size=(n, m)))
    c = (random.normal(size=(p, n)) * root) @ turn.T
    return LtiSystem(turn @ a @ turn.T, b, c, 0.3 * random.normal(size=(p, m)))


def modal_frequencies(system: LtiSystem, spread: int) -> Array:
    """Zero, and around every pole out to three of its half widths."""
    poles = system.poles
    around = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * np.linspace(-3, 3, spread)
    omega = np.concatenate([[0.0], np.abs(poles), np.abs(poles.imag), around.ravel()])
    return np.asarray(np.unique(omega[omega >= 0.0]))


def least_form(m: Complex, scalings: Scalings, beta: float) -> Array:
    """Return the smallest eigenvalue of F for matrices (K, n, n), relative to F's size."""
    d, g = scalings.d, scalings.g
    mh = m.conj().swapaxes(1, 2)
    f = beta**2 * d - mh @ d @ m - 1j * (g @ m - mh @ g)
    return np.asarray(np.linalg.eigvalsh(f)[:, 0] / np.linalg.norm(f, axis=(1, 2)))


def largest_over(system: LtiSystem, structure: BlockStructure, omega: Array) -> float:
    """Return the largest of the least upper bounds at frequencies.

    Scalings of one frequency bound µ at the others: where they do so below the largest known, that
    frequency is passed over.
    """
    m = structure.pad_to_square(system.response(omega))
    square = BlockStructure([b.enclosing_square() for b in structure.blocks])
    best, left = 0.0, np.ones(omega.size, dtype=bool)
    gains = np.linalg.norm(m, 2, axis=(1, 2))
    left = gains > 0.0
    while left.any():
        k = int(np.flatnonzero(left)[np.argmax(gains[left])])
        found = upper_bound(m[k], square)
        best = max(best, found.value)
        left[k] = False
        left[left] = least_form(m[left], found.scalings, best) <= 0.0
    return best


def assert_certified(
    found: CertifiedPeak, system: LtiSystem, structure: BlockStructure, omega: Array
) -> None:
    """Check that the intervals cover everything, and that F is positive within each."""
    end = 0.0
    for one in sorted(found.intervals, key=lambda one: one.low_rad_s):
        assert one.low_rad_s <= end
        end = max(end, one.high_rad_s)
        assert one.bound <= found.upper
    assert end == np.inf
    m = structure.pad_to_square(system.response(omega))
    seen = np.zeros(omega.size, dtype=bool)
    for one in found.intervals:
        inside = (omega >= one.low_rad_s) & (omega <= one.high_rad_s)
        seen |= inside
        if inside.any():
            assert least_form(m[inside], one.scalings, found.upper).min() > -1e-12
    assert seen.all()


def blocks_of(random: np.random.Generator, count: int) -> BlockStructure:
    kinds = [
        repeated_real(1), repeated_real(2), repeated_complex(1), repeated_complex(2), full(2),
        full(1, 2),
    ]  # fmt: skip
    return BlockStructure([kinds[k] for k in random.integers(len(kinds), size=count)])


@settings(derandomize=True, deadline=None, max_examples=10)
@given(
    seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4), modes=st.integers(1, 4),
    damping=st.sampled_from([1e-1, 1e-2, 1e-4]), decades=st.sampled_from([1.0, 3.0]),
)  # fmt: skip
# One real scalar, whose µ is zero at the two floating-point numbers next to its peak.
@example(seed=30, count=1, modes=1, damping=0.1, decades=1.0)
def test_no_frequency_exceeds_the_certified_peak(
    seed: int, count: int, modes: int, damping: float, decades: float
) -> None:
    structure = blocks_of(np.random.default_rng(seed), count)
    system = random_system(seed, structure, modes, damping=damping, decades=decades)
    found = certified_peak(system, structure)
    omega = np.concatenate([modal_frequencies(system, 21), np.logspace(-3, 3, 400)])
    assert_certified(found, system, structure, omega)
    at_peak = np.append(omega, found.frequency_rad_s)
    largest = largest_over(system, structure, at_peak)
    if structure.purely_real:  # whose µ jumps: scalings for both sides bound it in between
        sides = found.frequency_rad_s * np.array([1.0 - 1e-7, 1.0, 1.0 + 1e-7])
        largest = max(largest, upper_bound(system.response(sides), structure).value)
    assert largest <= found.upper <= 1.02 * largest + 1e-6 * hinf_norm(system).value


@settings(derandomize=True, deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4), modes=st.integers(1, 3),
    damping=st.sampled_from([1e-1, 1e-3]), discretely=st.booleans(),
)  # fmt: skip
def test_a_limit_is_proved_above_the_peak_and_refuted_below_it(
    seed: int, count: int, modes: int, damping: float, discretely: bool
) -> None:
    structure = blocks_of(np.random.default_rng(seed), count)
    system = random_system(seed, structure, modes, damping=damping, decades=1.0)
    if discretely:
        system = discrete(system, 0.3)
    peak = certified_peak(system, structure, gap=1e-3)
    assume(peak.peak > 1e-6 * hinf_norm(system).value)
    assert find_unproved(system, structure, 1.002 * peak.upper) is None
    limit = 0.998 * peak.peak
    found = find_unproved(system, structure, limit)
    assert found is not None
    omega, bound = found
    at = system.response(np.array([omega]))[0]
    assert limit <= bound <= peak.upper
    there = upper_bound(at, structure).value
    assert there <= bound * (1.0 + 1e-5)
    if not structure.purely_real:  # whose µ jumps: then the bound is that of both sides
        assert_allclose(there, bound, rtol=1e-5)


def test_a_limit_is_refuted_between_the_frequencies_of_the_first_look() -> None:
    structure = BlockStructure([full(1), full(1)])
    # two modes whose sum peaks between their poles and off the grid, by another phase each
    a = np.array([[-0.5, 1.0, 0, 0], [-1.0, -0.5, 0, 0], [0, 0, -0.5, 1.7], [0, 0, -1.7, -0.5]])
    b = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.4], [0.3, 1.0]])
    system = LtiSystem(a, b, b.T, np.zeros((2, 2)))
    peak = certified_peak(system, structure, gap=1e-6)
    first = 0.9999 * peak.peak
    found = find_unproved(system, structure, first)
    assert found is not None
    assert first <= found[1] <= peak.upper
    assert find_unproved(system, structure, 1.0001 * peak.upper) is None


def test_a_limit_just_above_a_bound_that_is_the_same_everywhere() -> None:
    """µ is one at all frequencies, proved at each by another D: 5e-5 above it no D reaches far."""
    structure = BlockStructure([full(1), full(1)])
    # (s + 1)/(s + 10) from the second to the first, its inverse back
    crossed = np.array([[0.0, 1.0], [1.0, 0.0]])
    system = LtiSystem(np.diag([-10.0, -1.0]), crossed, np.diag([-9.0, 9.0]), crossed)
    at = system.response(np.geomspace(1e-2, 1e3, 50))
    assert_allclose(np.abs(at[:, 0, 1] * at[:, 1, 0]), 1.0, rtol=1e-12)
    assert find_unproved(system, structure, 1.01) is None
    found = find_unproved(system, structure, 1.00005)
    assert found is not None
    assert 0.1 < found[0] < 100.0
    assert_allclose(found[1], 1.0, rtol=1e-6)


def resonant() -> tuple[LtiSystem, BlockStructure]:
    """Narrow peaks, with two real scalars and two blocks."""
    structure = BlockStructure([repeated_real(), repeated_real(), full(1), full(2)])
    return random_system(3, structure, 4, damping=1e-3, decades=2.0), structure


def test_1e4_frequencies() -> None:
    system, structure = resonant()
    found = certified_peak(system, structure)
    omega = np.concatenate([modal_frequencies(system, 201), np.logspace(-3, 3, 9000)])
    largest = largest_over(system, structure, omega)
    assert largest <= found.upper <= 1.02 * largest
    assert_certified(found, system, structure, omega)


@pytest.mark.slow
def test_1e5_frequencies() -> None:
    system, structure = resonant()
    found = certified_peak(system, structure)
    omega = np.concatenate([modal_frequencies(system, 4001), np.logspace(-3, 3, 90000)])
    assert omega.size > 100_000
    largest = largest_over(system, structure, omega)
    assert largest <= found.upper <= 1.02 * largest
    assert_certified(found, system, structure, omega)


def test_20_blocks_and_20_states() -> None:
    structure = BlockStructure([repeated_real() if k % 2 else full(1) for k in range(20)])
    system = random_system(0, structure, 10, damping=0.05, decades=2.0)
    found = certified_peak(system, structure)
    omega = np.concatenate([modal_frequencies(system, 11), np.logspace(-3, 3, 300)])
    assert_certified(found, system, structure, omega)
    assert found.peak <= found.upper <= 1.0101 * found.peak


def test_poles_spread_over_nine_decades() -> None:
    structure = BlockStructure([repeated_real(), repeated_complex(), full(2)])
    system = random_system(5, structure, 5, damping=1e-3, decades=9.0)
    found = certified_peak(system, structure)
    omega = np.concatenate([modal_frequencies(system, 21), np.logspace(-6, 6, 1000)])
    assert_certified(found, system, structure, omega)
    assert largest_over(system, structure, omega) <= found.upper


def test_one_full_block_gives_the_norm() -> None:
    structure = BlockStructure([full(3, 2)])
    system = random_system(1, structure, 4, damping=1e-3, decades=2.0)
    norm = hinf_norm(system).value
    found = certified_peak(system, structure, gap=1e-4)
    assert norm * (1.0 - 1e-9) <= found.upper <= norm * (1.0 + 2e-4)


def test_three_real_coefficients_by_hurwitz() -> None:
    """s³ + (2 + δ₁) s² + (3 + δ₂) s + 2 + δ₃ is stable while (2 − k)(3 − k) > 2 + k for |δ| ≤ k.

    That is up to k = 3 − √5; the three enter one equation, so that the bound is exact.
    """
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-2.0, -3.0, -2.0]])
    b = -np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    c = np.eye(3)[::-1]
    system = LtiSystem(a, b, c, np.zeros((3, 3)))
    structure = BlockStructure([repeated_real()] * 3)
    exact = 1.0 / (3.0 - np.sqrt(5.0))
    found = certified_peak(system, structure, gap=1e-3)
    assert exact * (1.0 - 1e-6) <= found.upper <= exact * (1.0 + 2e-3)


def test_a_jump_at_one_frequency_is_not_missed() -> None:
    """s³ + 2 s² + 3 s + 5 + δ: µ is 1/5 at zero, 1 at √3 rad/s, and zero at every other."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-5.0, -3.0, -2.0]])
    b, c = np.array([[0.0], [0.0], [-1.0]]), np.array([[1.0, 0.0, 0.0]])
    system = LtiSystem(a, b, c, np.zeros((1, 1)))
    found = certified_peak(system, BlockStructure([repeated_real()]))
    assert 1.0 - 1e-6 <= found.upper <= 1.02
    assert_allclose(found.peak, 1.0, rtol=1e-5)
    assert_allclose(found.frequency_rad_s, np.sqrt(3.0), rtol=1e-6)


@settings(derandomize=True, deadline=None, max_examples=12)
@given(
    seed=st.integers(0, 2**32 - 1), modes=st.integers(1, 5),
    damping=st.sampled_from([0.3, 1e-2, 1e-4]), decades=st.sampled_from([1.0, 3.0, 6.0]),
)  # fmt: skip
def test_one_real_scalar_matters_where_the_response_is_real(
    seed: int, modes: int, damping: float, decades: float
) -> None:
    """µ is zero but at the frequencies where the imaginary part changes its sign."""
    structure = BlockStructure([repeated_real()])
    system = random_system(seed, structure, modes, damping=damping, decades=decades)

    def at(omega: float) -> complex:
        return complex(system.response(np.array([omega]))[0, 0, 0])

    omega = np.unique([*modal_frequencies(system, 201)[1:], *np.logspace(-5, 5, 4001)])
    sign = np.sign(system.response(omega)[:, 0, 0].imag)
    turns = [
        brentq(lambda w: at(w).imag, omega[k], omega[k + 1], xtol=1e-15, rtol=1e-14)
        for k in np.flatnonzero(sign[1:] != sign[:-1])
    ]
    exact = max(abs(at(w).real) for w in [0.0, np.inf, *turns])
    assert exact * (1.0 - 1e-7) <= certified_peak(system, structure).upper <= 1.0201 * exact


def test_discrete_time_is_that_of_the_image() -> None:
    structure = BlockStructure([repeated_real(), full(2)])
    system = random_system(2, structure, 3, damping=1e-2, decades=1.0)
    one, two = (certified_peak(s, structure) for s in (system, discrete(system, 0.1)))
    assert_allclose(two.upper, one.upper, rtol=0.02)
    highest = max(i.high_rad_s for i in two.intervals)
    assert_allclose(highest, np.pi / 0.1, rtol=1e-12)
    omega = np.linspace(0.0, highest, 500)
    assert largest_over(discrete(system, 0.1), structure, omega) <= two.upper


def test_smaller_gap_means_a_tighter_bound() -> None:
    structure = BlockStructure([repeated_complex(), full(2)])
    system = random_system(4, structure, 3, damping=1e-2, decades=1.0)
    wide, tight = (certified_peak(system, structure, gap=gap) for gap in (0.1, 1e-3))
    assert tight.upper <= wide.upper
    assert tight.upper <= 1.0011 * tight.peak


def test_skewed_peak_is_the_worst_gain_of_a_circle() -> None:
    """One complex scalar δ and one channel: the largest gain at each frequency is known."""
    structure = BlockStructure([full(1), full(1)])
    system = random_system(6, structure, 2, damping=0.1, decades=1.0)
    small = hinf_norm(LtiSystem(system.a, system.b[:, :1], system.c[:1], system.d[:1, :1])).value
    scale = np.array([0.7 / small, 1.0])[:, None]
    system = LtiSystem(system.a, system.b, scale * system.c, scale * system.d)
    m = system.response(np.logspace(-2, 2, 4000))
    phase = np.exp(2j * np.pi * np.arange(400) / 400)
    gains = np.abs(
        m[:, 1, 1, None]
        + m[:, 1, 0, None] * phase * m[:, 0, 1, None] / (1.0 - m[:, 0, 0, None] * phase)
    )
    found = certified_peak(system, structure, skewed=[1])
    assert gains.max() <= found.upper <= 1.02 * gains.max()


def test_skewed_peak_is_infinite_where_the_others_may_destabilise() -> None:
    structure = BlockStructure([full(1), full(1)])
    system = random_system(6, structure, 2, damping=0.1, decades=1.0)
    small = hinf_norm(LtiSystem(system.a, system.b[:, :1], system.c[:1], system.d[:1, :1])).value
    scale = np.array([1.1 / small, 1.0])[:, None]
    system = LtiSystem(system.a, system.b, scale * system.c, scale * system.d)
    assert certified_peak(system, structure, skewed=[1]).upper == np.inf


def test_constant_and_silent_systems() -> None:
    structure = BlockStructure([full(1), full(1)])
    none = np.zeros((0, 0))
    d = np.array([[0.0, 4.0], [1.0, 0.0]])
    constant = LtiSystem(none, np.zeros((0, 2)), np.zeros((2, 0)), d)
    assert_allclose(certified_peak(constant, structure).upper, 2.0, rtol=1e-6)
    silent = LtiSystem(-np.eye(1), np.zeros((1, 2)), np.zeros((2, 1)), np.zeros((2, 2)))
    assert certified_peak(silent, structure).upper == 0.0


def test_errors_say_what_to_do() -> None:
    structure = BlockStructure([full(1)])
    one = np.ones((1, 1))
    with pytest.raises(InputError, match=r"pole at 1.*stabilise it first"):
        certified_peak(LtiSystem(one, one, one, one), structure)
    with pytest.raises(InputError, match="1 outputs and 1 inputs, got 2 and 2"):
        certified_peak(LtiSystem(-one, np.ones((1, 2)), np.ones((2, 1)), np.eye(2)), structure)
    with pytest.raises(InputError, match="gap must be"):
        certified_peak(LtiSystem(-one, one, one, one), structure, gap=0.0)


def test_too_many_intervals_widen_the_gap_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """With hardly any intervals allowed, the bound is wider, and still one at all frequencies."""
    structure = BlockStructure([repeated_real(2), full(2, 2)])
    system = random_system(3, structure, 8, damping=0.01, decades=3.0)
    plain = certified_peak(system, structure, gap=1e-4)
    assert plain.undecided_gap == 0.0
    monkeypatch.setattr(certified, "_CHECKED", 4)
    monkeypatch.setattr(certified, "_MOST_INTERVALS", 4)
    few = certified_peak(system, structure, gap=1e-4)
    assert few.undecided_gap == pytest.approx(few.upper / few.peak - 1.0)
    assert few.undecided_gap > 1e-4
    assert few.upper >= plain.peak
    ends = sorted((one.low_rad_s, one.high_rad_s) for one in few.intervals)
    reached = 0.0
    for low, high in ends:
        assert low <= reached
        reached = max(reached, high)
    assert reached == np.inf
    # the widest gap at once: the norm with the scalings D of the peak
    monkeypatch.setattr(certified, "_WIDEST", 0.5)
    norm = certified_peak(system, structure, gap=1e-4)
    assert norm.upper >= plain.peak
    skewed = certified_peak(system, structure, gap=1e-4, skewed=[1])
    assert skewed.upper == np.inf
