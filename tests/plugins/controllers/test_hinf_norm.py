from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import lu

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.analysis.hinf_norm import _gain_with_rounding, hinf_norm
from hillsphere_controllers.systems.bilinear import discrete


def siso(a: list[list[float]], b: list[float], c: list[float], d: float = 0.0) -> LtiSystem:
    return LtiSystem(np.array(a), np.array([b]).T, np.array([c]), np.array([[d]]))


@pytest.mark.parametrize("damping", [1e-6, 1e-3, 0.1, 0.5])
def test_resonance_in_closed_form(damping: float) -> None:
    """1/(s² + 2ζs + 1) peaks at √(1 − 2ζ²) with 1/(2ζ√(1 − ζ²))."""
    found = hinf_norm(siso([[0.0, 1.0], [-1.0, -2.0 * damping]], [0.0, 1.0], [1.0, 0.0]))
    assert_allclose(found.value, 1.0 / (2 * damping * np.sqrt(1 - damping**2)), rtol=1e-9)
    assert_allclose(found.frequency_rad_s, np.sqrt(1 - 2 * damping**2), rtol=1e-5)
    assert found.value <= found.upper <= found.value * (1 + 1e-7)


def test_peaks_at_zero_and_at_infinity() -> None:
    lag = hinf_norm(siso([[-2.0]], [2.0], [3.0]))
    assert_allclose(lag.value, 3.0, rtol=1e-14)
    assert lag.frequency_rad_s == 0.0
    lead = hinf_norm(siso([[-2.0]], [2.0], [-0.5], 1.0))  # (s + 1)/(s + 2)
    assert_allclose(lead.value, 1.0, rtol=1e-14)
    assert lead.frequency_rad_s == np.inf
    assert lead.upper <= 1.0 + 1e-7


def test_all_pass_has_its_norm_everywhere() -> None:
    found = hinf_norm(siso([[-3.0]], [1.0], [-6.0], 1.0))  # (s − 3)/(s + 3)
    assert_allclose(found.value, 1.0, rtol=1e-12)


def test_constant_and_empty_systems() -> None:
    none = np.zeros((0, 0))
    constant = LtiSystem(none, np.zeros((0, 2)), np.zeros((2, 0)), np.diag([3.0, -4.0]))
    assert_allclose(hinf_norm(constant).value, 4.0, rtol=1e-15)
    silent = siso([[-1.0]], [0.0], [0.0])
    assert hinf_norm(silent).value == 0.0


def test_an_unstable_system_has_no_finite_norm() -> None:
    assert hinf_norm(siso([[1.0]], [1.0], [1.0])).value == np.inf
    with pytest.raises(InputError, match="tolerance"):
        hinf_norm(siso([[-1.0]], [1.0], [1.0]), tolerance=0.0)


def random_system(seed: int, order: int, decades: float) -> LtiSystem:
    """Stable modes whose frequencies spread over so many decades, mixed by a triangular map."""
    random = np.random.default_rng(seed)
    a = np.zeros((2 * order, 2 * order))
    for k in range(order):
        frequency = 10.0 ** random.uniform(-0.5 * decades, 0.5 * decades)
        damping = 10.0 ** random.uniform(-4, 0)
        block = [[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]]
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    mix = np.triu(0.3 * random.normal(size=a.shape), 1) + np.eye(len(a))
    b, c = random.normal(size=(len(a), 2)), random.normal(size=(3, len(a)))
    d = random.normal(size=(3, 2)) * random.integers(0, 2)
    return LtiSystem(mix @ a @ np.linalg.inv(mix), mix @ b, c @ np.linalg.inv(mix), d)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 8), st.sampled_from([2.0, 9.0]))
def test_never_below_what_the_response_reaches(seed: int, order: int, decades: float) -> None:
    """Poles from 1e-5 to 3e4 rad/s among them."""
    check_against_samples(seed, order, decades, 20_000)


@pytest.mark.slow
@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 8), st.sampled_from([2.0, 9.0]))
def test_never_below_a_hundred_thousand_samples(seed: int, order: int, decades: float) -> None:
    check_against_samples(seed, order, decades, 100_000)


def check_against_samples(seed: int, order: int, decades: float, count: int) -> None:
    system = random_system(seed, order, decades)
    if not system.is_stable:  # rounding may move a slow pole of a badly scaled system
        return
    found = hinf_norm(system)
    poles = np.abs(system.poles)
    ends = np.log10(poles.min()) - 2.0, np.log10(poles.max()) + 2.0
    omega = np.concatenate([[0.0], poles, np.abs(system.poles.imag), np.logspace(*ends, count)])
    sampled = largest_gains(system.response(omega)).max()
    assert found.upper >= sampled * (1.0 - 1e-12)
    # rounding changes what is sampled as it does the value: by no more than the error it states
    assert found.value * (1.0 + found.error) >= sampled * (1.0 - 1e-9)
    at_peak = largest_gains(system.response(np.array([found.frequency_rad_s])))[0]
    assert_allclose(found.value, at_peak, rtol=1e-12)


def test_the_peak_is_found_where_the_schur_form_is_too_rough() -> None:
    """Of a broad peak at 3e-4 rad/s beside poles of 9e2: its gains by the Schur form are noise."""
    system = random_system(1, 4, 9.0)
    found = hinf_norm(system)
    omega = found.frequency_rad_s * (1.0 + np.linspace(-1e-2, 1e-2, 2001))
    assert found.value >= largest_gains(system.response(omega)).max() * (1.0 - 1e-9)


def exact_gain(system: LtiSystem, omega: float) -> float:
    """Return |G(jω)| of one input and output, solved in fractions."""
    n, w = system.order, Fraction(omega)
    a = [[Fraction(float(v)) for v in row] for row in system.a]
    b, c = ([Fraction(float(v)) for v in part.ravel()] for part in (system.b, system.c))
    rows = []
    for i in range(n):  # real and imaginary part of (jω − A) x = b
        unit = [w if i == j else Fraction(0) for j in range(n)]
        rows.append([*(-v for v in a[i]), *(-v for v in unit), b[i]])
        rows.append([*unit, *(-v for v in a[i]), Fraction(0)])
    for i in range(2 * n):
        pivot = next(r for r in range(i, 2 * n) if rows[r][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for r in range(2 * n):
            if r != i and rows[r][i] != 0:
                factor = rows[r][i] / rows[i][i]
                rows[r] = [x - factor * y for x, y in zip(rows[r], rows[i], strict=True)]
    x = [rows[i][-1] / rows[i][i] for i in range(2 * n)]
    real, imaginary = (
        float(sum(ci * xi for ci, xi in zip(c, x[k : k + n], strict=True))) for k in (0, n)
    )
    return float(np.hypot(real, imaginary))


def rotated_triangle(seed: int) -> LtiSystem:
    """Poles from −1e-6 to −1e3 in a triangle of large couplings, turned in every second system."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    a = np.diag(-(10.0 ** random.uniform(-6, 3, n)))
    a += np.triu(random.normal(size=(n, n)) * 10.0 ** random.uniform(-1, 3), 1)
    if seed % 2:
        turn = np.linalg.qr(random.normal(size=(n, n)))[0]
        a = turn @ a @ turn.T
    b, c = random.normal(size=(n, 1)), random.normal(size=(1, n))
    return LtiSystem(a, b, c, np.zeros((1, 1)))


def test_the_upper_bound_allows_for_rounding() -> None:
    unsure = 0
    for seed in range(60):
        system = rotated_triangle(seed)
        if not system.is_stable:
            continue
        found = hinf_norm(system)
        exact = [exact_gain(system, w) for w in (0.0, found.frequency_rad_s)]
        assert max(exact) <= found.upper
        if np.isfinite(found.error):
            assert abs(found.value - exact[1]) <= found.error * found.value
        if seed % 2 == 0:  # a triangle is solved without cancellation
            assert found.upper <= found.value * (1.0 + 1e-8)
        unsure += found.error > 0.01
    assert unsure >= 3


def test_rounding_in_discrete_time() -> None:
    """Of a double pole at 1 − 1e-7 half the digits are lost: the gain at z = 1 is about 1e14."""
    turn = np.linalg.qr(np.array([[1.0, 2.0], [3.0, 4.0]]))[0]
    a = turn @ np.array([[1.0 - 1e-7, 1.0], [0.0, 1.0 - 1e-7]]) @ turn.T
    system = LtiSystem(a, turn[:, 1:], turn[:, :1].T, np.zeros((1, 1)), 0.1)
    assert system.is_stable
    at_one = LtiSystem(a - np.eye(2), system.b, system.c, system.d)  # (1 − A)⁻¹, A − 1 being exact
    found = hinf_norm(system)
    assert exact_gain(at_one, 0.0) <= found.upper
    assert 0.01 < found.error < 0.1


def test_discrete_time_through_the_bilinear_map() -> None:
    system = random_system(3, 3, 2.0)
    image = discrete(system, 0.05)
    found, expected = hinf_norm(image), hinf_norm(system)
    assert_allclose(found.value, expected.value, rtol=1e-9)
    at_peak = largest_gains(image.response(np.array([found.frequency_rad_s])))[0]
    assert_allclose(at_peak, found.value, rtol=1e-8)


def test_against_slicot() -> None:
    """AB13DD (P. Benner, V. Sima, M. Voigt) on well-scaled systems of order 1 to 60."""
    slycot = pytest.importorskip("slycot", reason="the extra 'slicot' is not installed")
    random = np.random.default_rng(0)
    for _ in range(60):
        n, m, p = (int(k) for k in random.integers([1, 1, 1], [61, 5, 5]))
        a = random.normal(size=(n, n))
        a -= (np.linalg.eigvals(a).real.max() + random.uniform(0.01, 1.0)) * np.eye(n)
        b, c = random.normal(size=(n, m)), random.normal(size=(p, n))
        d = random.normal(size=(p, m)) * random.integers(0, 2)
        oracle = slycot.ab13dd("C", "I", "S", "D", n, m, p, a, np.eye(n), b, c, d, tol=1e-11)[0]
        assert_allclose(hinf_norm(LtiSystem(a, b, c, d)).value, oracle, rtol=1e-8)


def rounding_by_lu(system: LtiSystem, omega: float) -> tuple[float, float]:
    """Return gain and bound of rounding: |C R| E (I − |R| E)⁻¹ |R B|, E = n ε |P| |L| |U|.

    R is the inverse of s I − A = P L U, by SciPy's factors; in discrete time s is rounded too.
    """
    s = 1j * omega if system.dt_s is None else np.exp(1j * omega * system.dt_s)
    n, eps = system.order, np.finfo(float).eps
    p, lower, upper = lu(s * np.eye(n) - system.a)
    change = n * eps * p @ np.abs(lower) @ np.abs(upper)
    if system.dt_s is not None:
        change = change + eps * np.eye(n)
    r = np.linalg.inv(s * np.eye(n) - system.a)
    inner = np.linalg.solve(np.eye(n) - np.abs(r) @ change, np.abs(r @ system.b))
    error = np.linalg.norm(np.abs(system.c @ r) @ change @ inner)
    gain = np.linalg.norm(system.c @ r @ system.b + system.d, 2)
    return float(gain), float(error)


@pytest.mark.parametrize("dt_s", [None, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_rounding_is_bounded_by_the_factors_of_the_resolvent(seed: int, dt_s: float | None) -> None:
    random = np.random.default_rng(seed)
    a = random.normal(size=(5, 5)) * np.geomspace(1.0, 1e3, 5)[:, None]
    a = 0.1 * a / np.abs(np.linalg.eigvals(a)).max() if dt_s else a
    system = LtiSystem(
        a, random.normal(size=(5, 2)), random.normal(size=(2, 5)), random.normal(size=(2, 2)), dt_s
    )
    for omega in (0.0, 0.7, 11.0):
        gain, error = rounding_by_lu(system, omega)
        high, relative = _gain_with_rounding(system, omega)
        np.testing.assert_allclose(high, gain + error, rtol=1e-10)
        np.testing.assert_allclose(relative, error / gain, rtol=1e-5)


def test_a_pole_at_the_frequency_is_beyond_any_bound() -> None:
    system = LtiSystem(np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    assert _gain_with_rounding(system, 0.0) == (np.inf, np.inf)
    # 1e-16 beside a pole of size one the resolvent is rounding
    near = LtiSystem(
        np.array([[-1.0, 1.0], [1.0, -1.0 - 1e-16]]), np.ones((2, 1)), np.ones((1, 2)),
        np.zeros((1, 1)),
    )  # fmt: skip
    assert _gain_with_rounding(near, 0.0) == (np.inf, np.inf)


def test_a_lower_gain_that_is_less_sure_raises_the_upper_bound() -> None:
    """A resonance of height 1.2 at ω = 50 beside (1 + q − q)/(s + 1) with q = 2·10¹⁴."""
    damping = 0.1
    height = 2.0 * damping * np.sqrt(1.0 - damping**2)
    resonance = np.array([[0.0, 50.0], [-50.0, -100.0 * damping]])
    a = np.block([[-np.eye(2), np.zeros((2, 2))], [np.zeros((2, 2)), resonance]])
    b = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 50.0]])
    c = np.array([[2e14 + 1.0, -2e14, 0.0, 0.0], [0.0, 0.0, 1.2 * height, 0.0]])
    found = hinf_norm(LtiSystem(a, b, c, np.zeros((2, 2))))
    np.testing.assert_allclose(found.value, 1.2, rtol=1e-3)
    gain, error = rounding_by_lu(LtiSystem(a, b, c, np.zeros((2, 2))), 0.0)
    assert gain + 0.99 * error > 1.3
    assert found.upper >= gain + 0.99 * error


def test_what_is_exact_bears_no_error() -> None:
    constant = LtiSystem(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[3.0]])
    )  # fmt: skip
    found = hinf_norm(constant)
    assert (found.value, found.upper, found.error, found.doubt) == (3.0, 3.0, 0.0, "")
