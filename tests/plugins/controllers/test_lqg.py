from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import solve_continuous_are, solve_discrete_are

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import NotStabilisableError, SingularProblemError
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.lqg import kalman, lqg, lqr
from hillsphere_controllers.systems.algebra import gain, lower_lft


def plant(seed: int, dt_s: float | None = None, n: int = 4) -> LtiSystem:
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(n, n)), random.normal(size=(n, 2)), random.normal(size=(3, n)),
        random.normal(size=(3, 2)), dt_s,
    )  # fmt: skip


def positive(seed: int, n: int) -> Any:
    root = np.random.default_rng(seed).normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def test_double_integrator_in_closed_form() -> None:
    """ẍ = u with ∫(x² + ρ² u²) dt: u = −x/ρ − √(2/ρ) ẋ."""
    axis = LtiSystem(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]),
                     np.eye(2), np.zeros((2, 1)))  # fmt: skip
    rho = 1e6
    found = lqr(axis, np.diag([1.0, 0.0]), np.array([[rho**2]]))
    assert_allclose(found.gain, [[1.0 / rho, np.sqrt(2.0 / rho)]], rtol=1e-9)
    # a Butterworth pattern at ρ^(−1/2)
    assert_allclose(np.abs(found.poles), rho**-0.5, rtol=1e-9)
    assert_allclose(-found.poles.real, np.sqrt(0.5 / rho), rtol=1e-9)


def test_filter_of_a_random_walk_in_closed_form() -> None:
    """ẋ = w, y = x + v: variance √(q r), gain √(q/r); in steps p² = q p + q r."""
    walk = LtiSystem(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)))
    q, r = 1e-6, 4.0
    found = kalman(walk, np.array([[q]]), np.array([[r]]))
    assert_allclose(found.covariance, [[np.sqrt(q * r)]], rtol=1e-9)
    assert_allclose(found.gain, [[np.sqrt(q / r)]], rtol=1e-9)
    assert_allclose(found.update_gain, [[0.0]], atol=0)
    steps = LtiSystem(np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), 10.0)
    found = kalman(steps, np.array([[q]]), np.array([[r]]))
    p = 0.5 * (q + np.sqrt(q * q + 4.0 * q * r))
    assert_allclose(found.covariance, [[p]], rtol=1e-9)
    assert_allclose(found.update_gain, [[p / (p + r)]], rtol=1e-9)
    assert_allclose(found.gain, found.update_gain, rtol=1e-12)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.booleans())
def test_regulator_and_filter_solve_their_riccati_equations(seed: int, sampled: bool) -> None:
    """Against SciPy, with cross terms."""
    dt_s = 0.2 if sampled else None
    made, whole, noise = plant(seed, dt_s), positive(seed + 1, 6), positive(seed + 2, 7)
    q, n, r = whole[:4, :4], whole[:4, 4:], whole[4:, 4:]
    solve = solve_discrete_are if sampled else solve_continuous_are
    regulator = lqr(made, q, r, n)
    x = solve(made.a, made.b, q, r, s=n)
    assert_allclose(regulator.cost, x, rtol=0, atol=1e-7 * np.abs(x).max())
    weight = r + made.b.T @ x @ made.b if sampled else r
    behind = made.a if sampled else np.eye(4)
    expected = np.linalg.solve(weight, made.b.T @ x @ behind + n.T)
    assert_allclose(regulator.gain, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    w, v, wv = noise[:4, :4], noise[4:, 4:], noise[:4, 4:]
    filtered = kalman(made, w, v, cross_noise=wv)
    y = solve(made.a.T, made.c.T, w, v, s=wv)
    assert_allclose(filtered.covariance, y, rtol=0, atol=1e-7 * np.abs(y).max())
    poles = np.linalg.eigvals(made.a - filtered.gain @ made.c)
    assert_allclose(np.sort_complex(filtered.poles), np.sort_complex(poles), rtol=1e-7)
    assert (np.abs(poles).max() < 1.0) if sampled else (poles.real.max() < 0.0)


@pytest.mark.parametrize("sampled", [False, True])
def test_filter_of_noise_that_enters_somewhere(sampled: bool) -> None:
    """G w with W is noise of the covariance G W Gᵀ on the states."""
    made, g = plant(3, 0.1 if sampled else None), np.array([[1.0], [0.0], [2.0], [-1.0]])
    v, w = positive(4, 3), np.array([[0.3]])
    one, other = kalman(made, w, v, through=g), kalman(made, g @ w @ g.T, v)
    assert_allclose(one.gain, other.gain, rtol=1e-7, atol=1e-10)


def test_lqg_is_the_h2_controller_of_its_weights() -> None:
    made = plant(5)
    q, r, w, v = positive(1, 4), positive(2, 2), positive(3, 4), positive(4, 3)
    found = lqg(made, q, r, w, v)
    root = [np.linalg.cholesky(matrix) for matrix in (q, r, w, v)]
    zero = np.zeros
    generalised = LtiSystem(
        made.a,
        np.hstack([root[2], zero((4, 3)), made.b]),
        np.vstack([root[0].T, zero((2, 4)), made.c]),
        np.block(
            [
                [zero((4, 7)), zero((4, 2))],
                [zero((2, 7)), root[1].T],
                [zero((3, 4)), root[3], made.d],
            ]
        ),
    )
    omega = np.array([0.0, 0.3, 2.0, 50.0])
    optimal = h2_synthesis(generalised, 2, 3)
    assert_allclose(
        found.controller.response(omega), optimal.controller.response(omega), rtol=1e-6, atol=1e-9
    )
    assert lower_lft(generalised, found.controller).is_stable


def test_separation_of_poles_in_discrete_time() -> None:
    made = plant(6, 0.1)
    found = lqg(made, np.eye(4), np.eye(2), np.eye(4), np.eye(3))
    assert found.controller.dt_s == 0.1
    assert not found.controller.d.any()
    poles = lower_lft(made, found.controller).poles
    expected = np.concatenate([found.regulator.poles, found.filter.poles])
    assert_allclose(np.sort_complex(poles), np.sort_complex(expected), rtol=1e-6)


def test_metres_and_metres_per_second_of_a_slow_orbit() -> None:
    """Units as a mission has them: natural frequencies of 1e-4 rad/s, accelerations of 1e-4."""
    n = 2.28e-4
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3 * n * n, 2 * n, -2 * n, -n * n
    b = np.vstack([np.zeros((3, 3)), np.eye(3)])
    hill = LtiSystem(a, b, np.eye(6), np.zeros((6, 3)))
    q, r = np.diag([1e-4] * 3 + [1.0] * 3), 1e8 * np.eye(3)
    x = lqr(hill, q, r).cost
    rest = a.T @ x + x @ a - x @ b @ np.linalg.solve(r, b.T @ x) + q
    assert np.abs(rest).max() < 1e-10 * np.abs(q).max()


def test_what_makes_no_regulator_is_named() -> None:
    made = plant(7)
    one, two = np.eye(2), np.eye(4)
    for arguments, message in (
        ((two, 0.0 * one), "controls must be positive definite"),
        ((np.eye(3), one), r"matrix of \(4, 4\)"),
        ((two + np.triu(np.ones((4, 4)), 1), one), "symmetric"),
        ((-two, one), "positive semidefinite"),
        ((two, one, np.full((4, 2), 2.0)), "positive semidefinite"),
        ((np.full((4, 4), np.nan), one), "finite numbers"),
    ):
        with pytest.raises(InputError, match=message):
            lqr(made, *arguments)
    with pytest.raises(InputError, match="measurements must be positive definite"):
        kalman(made, two, np.zeros((3, 3)))
    with pytest.raises(InputError, match="4 rows"):
        kalman(made, one, np.eye(3), through=np.ones((3, 2)))
    there = np.array([[0.0], [1.0]])
    unstable = LtiSystem(np.diag([1.0, -1.0]), there, there.T, np.zeros((1, 1)))
    with pytest.raises(NotStabilisableError, match="controls do not reach the mode at s = 1"):
        lqr(unstable, one, np.eye(1))
    with pytest.raises(NotStabilisableError, match="measurements do not show the mode at s = 1"):
        kalman(unstable, one, np.eye(1))
    free = LtiSystem(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((1, 1)))
    with pytest.raises(SingularProblemError, match="not weighted"):
        lqr(free, np.zeros((1, 1)), np.eye(1))
    with pytest.raises(InputError, match="there are none"):
        lqr(gain(np.eye(1)), np.zeros((0, 0)), np.eye(1))


@pytest.mark.parametrize("effect", [1e3, 1e6, 1e9])
def test_cheap_control_of_a_mass_in_closed_form(effect: float) -> None:
    """ẍ = e u with the weights 1, 1 and r: K = (k, √(2 k/e + k²)), k = r^(−1/2)."""
    mass = LtiSystem(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [effect]]), np.eye(2), np.zeros((2, 1))
    )
    found = lqr(mass, np.eye(2), np.array([[1e-2]]))
    assert_allclose(found.gain, [[10.0, np.sqrt(20.0 / effect + 100.0)]], rtol=1e-9)


@pytest.mark.parametrize("deviation", [1e-3, 1e-5, 1e-6])
def test_accurate_sensors_have_a_filter(deviation: float) -> None:
    """The Riccati equation is met in its factors, and the poles are those of the fast sensors."""
    random = np.random.default_rng(0)
    for _ in range(5):
        a, c = random.normal(size=(4, 4)), random.normal(size=(2, 4))
        found = kalman(
            LtiSystem(a, np.zeros((4, 1)), c, np.zeros((2, 1))), np.eye(4),
            deviation**2 * np.eye(2),
        )  # fmt: skip
        y, scaled = found.covariance, found.gain * deviation
        rest = a @ y + y @ a.T + np.eye(4) - scaled @ scaled.T
        assert_allclose(rest, 0.0, rtol=0.0, atol=1e-7)
        assert found.poles.real.max() < 0.0
        assert_allclose(scaled, y @ c.T / deviation, rtol=0.0, atol=1e-8 * np.abs(scaled).max())
