from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import ConvergenceError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm, h2_norm_bounds
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.systems.algebra import append, gain, series
from hillsphere_controllers.systems.conversion import transfer_function


def system(seed: int, order: int, dt_s: float | None = None) -> LtiSystem:
    """Poles left of −0.1, or within 0.9 of the origin."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order))
    poles = np.linalg.eigvals(a)
    if dt_s is None:
        a -= (poles.real.max() + 0.1) * np.eye(order)
    else:
        a *= 0.9 / np.abs(poles).max()
    b, c = random.normal(size=(order, 2)), random.normal(size=(3, order))
    d = random.normal(size=(3, 2)) if dt_s else np.zeros((3, 2))
    return LtiSystem(a, b, c, d, dt_s)


def test_first_and_second_order_in_closed_form() -> None:
    """∫|G|² dω/2π: 1/(2a) for 1/(s + a), 1/(4 ζ ω³) for 1/(s² + 2 ζ ω s + ω²)."""
    assert_allclose(h2_norm(transfer_function([3.0], [1.0, 2.0])), 3.0 / np.sqrt(4.0), rtol=1e-13)
    zeta, omega = 0.02, 30.0
    flexible = transfer_function([1.0], [1.0, 2.0 * zeta * omega, omega**2])
    assert_allclose(h2_norm(flexible), np.sqrt(1.0 / (4.0 * zeta * omega**3)), rtol=1e-11)
    # in steps, the sum of the squares of the impulse response: d² + Σ a²ᵏ
    sampled = LtiSystem(np.array([[0.8]]), np.eye(1), np.eye(1), 2.0 * np.eye(1), 0.1)
    assert_allclose(h2_norm(sampled), np.sqrt(4.0 + 1.0 / (1.0 - 0.64)), rtol=1e-13)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_energy_of_the_impulse_response(seed: int, order: int) -> None:
    made = system(seed, order, 0.5)
    energy, x = float(np.sum(made.d**2)), made.b
    for _ in range(400):  # 0.9^400 is nothing, whatever a transient does first
        energy += float(np.sum((made.c @ x) ** 2))
        x = made.a @ x
    assert_allclose(h2_norm(made), np.sqrt(energy), rtol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_power_over_all_frequencies(seed: int) -> None:
    """∫ tr(G Gᴴ) dω/2π, with ω = tan(θ/2) to have the whole axis in a finite interval."""
    made = system(seed, 5)
    theta = (np.arange(40_000) + 0.5) * np.pi / 40_000
    omega = np.tan(0.5 * theta)
    power = np.sum(np.abs(made.response(omega)) ** 2, axis=(1, 2))
    integral = np.sum(power * 0.5 * (1.0 + omega**2)) * (theta[1] - theta[0]) / np.pi
    assert_allclose(h2_norm(made), np.sqrt(integral), rtol=1e-7)


def test_what_has_no_finite_norm() -> None:
    stable = transfer_function([1.0], [1.0, 1.0])
    assert h2_norm(transfer_function([1.0], [1.0, -1.0])) == np.inf
    assert h2_norm(transfer_function([1.0, 2.0], [1.0, 1.0])) == np.inf
    assert h2_norm(gain(np.zeros((2, 2)))) == 0.0
    assert_allclose(h2_norm(gain(np.array([[3.0, 4.0]]), 1.0)), 5.0)
    # what no input reaches counts for nothing
    unreached = append(stable, LtiSystem(-np.eye(1), np.zeros((1, 1)), np.eye(1), np.zeros((1, 1))))
    assert_allclose(h2_norm(unreached), np.sqrt(0.5), rtol=1e-13)


def test_states_of_very_different_units() -> None:
    """Micrometres and megametres: powers of ten in the states change nothing."""
    made = system(3, 4)
    size = 10.0 ** np.array([6.0, -6.0, 3.0, 0.0])
    scaled = LtiSystem(made.a / size[:, None] * size, made.b / size[:, None], made.c * size, made.d)
    assert_allclose(h2_norm(scaled), h2_norm(made), rtol=1e-9)


def test_spectral_abscissa() -> None:
    two = series(transfer_function([1.0], [1.0, 3.0]), transfer_function([1.0], [1.0, 0.2, 4.0]))
    assert_allclose(spectral_abscissa(two), -0.1, rtol=1e-12)
    sampled = LtiSystem(np.diag([0.5, -0.8]), np.ones((2, 1)), np.ones((1, 2)), np.eye(1), 0.1)
    assert_allclose(spectral_abscissa(sampled), np.log(0.8) / 0.1, rtol=1e-12)
    assert spectral_abscissa(gain(np.eye(1))) == -np.inf
    delay = LtiSystem(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)), 0.1)
    assert spectral_abscissa(delay) == -np.inf


@pytest.mark.parametrize("slow", [1e-6, 1e-10, 1e-12])
def test_a_slow_pole_beside_a_fast_one(slow: float) -> None:
    """1/((s + e)(s + f)) has the square 1/(2 e f (e + f)), however far e and f are apart."""
    fast = 1e6
    given = LtiSystem(
        np.array([[-slow, 1.0], [0.0, -fast]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]),
        np.zeros((1, 1)),
    )  # fmt: skip
    assert_allclose(h2_norm(given), np.sqrt(0.5 / (slow * fast * (slow + fast))), rtol=1e-12)


def test_a_pole_near_minus_one() -> None:
    """1/(z − a) has the square 1/(1 − a²)."""
    a = -1.0 + 1e-12
    given = LtiSystem(np.array([[a]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), 1.0)
    assert_allclose(h2_norm(given), np.sqrt(1.0 / (1.0 - a * a)), rtol=1e-9)


@pytest.mark.parametrize("slow", [2.0**-10, 2.0**-20, 2.0**-30])
@pytest.mark.parametrize("dt_s", [None, 0.5])
def test_the_norm_is_between_close_bounds(slow: float, dt_s: float | None) -> None:
    """Entries without rounding: T = [[1, 3], [0, 1]], a fast pole and a slow one."""
    t, back = np.array([[1.0, 3.0], [0.0, 1.0]]), np.array([[1.0, -3.0], [0.0, 1.0]])
    poles = np.array([-1.0, -slow]) if dt_s is None else np.array([0.5, 1.0 - slow])
    b, c = np.array([[1.0], [2.0]]), np.array([[1.0, -1.0]])
    made = LtiSystem(t * poles @ back, t @ b, c @ back, np.zeros((1, 1)), dt_s)
    weights = b[:, 0] * c[0]
    sums = poles[:, None] + poles if dt_s is None else np.outer(poles, poles) - 1.0
    exact = float(np.sqrt(np.sum(-np.outer(weights, weights) / sums)))
    bounds = h2_norm_bounds(made)
    assert bounds.lower * (1.0 - 1e-15) <= exact <= bounds.upper * (1.0 + 1e-15)
    assert bounds.upper - bounds.lower <= 1e-7 * exact
    assert_allclose(h2_norm(made), exact, rtol=1e-7)


def test_a_norm_that_rounding_hides_is_not_stated() -> None:
    """A pole at −1e-13 in coordinates that hide it: rounding of the entries is as large."""
    random = np.random.default_rng(5)
    t = random.normal(size=(4, 4))
    made = LtiSystem(
        t * np.array([-1.0, -2.0, -30.0, -1e-13]) @ np.linalg.inv(t),
        t @ np.ones((4, 1)), np.ones((1, 4)) @ np.linalg.inv(t), np.zeros((1, 1)),
    )  # fmt: skip
    bounds = h2_norm_bounds(made)
    assert bounds.upper == np.inf or bounds.upper > 1.00001 * bounds.lower
    if made.is_stable:
        with pytest.raises(ConvergenceError, match="only known to be from"):
            h2_norm(made)


def test_bounds_of_what_has_no_states_or_is_unstable() -> None:
    bounds = h2_norm_bounds(gain(np.array([[3.0, 4.0]]), 1.0))
    assert bounds.lower <= 5.0 <= bounds.upper <= 5.0 * (1.0 + 1e-12)
    assert h2_norm_bounds(transfer_function([1.0], [1.0, -1.0])).lower == np.inf
