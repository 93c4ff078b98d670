from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.analysis.margins import loop_margins
from hillsphere_controllers.full_order.sampled_data import sampled_cost, sampled_noise
from hillsphere_controllers.systems.algebra import feedback, gain, series
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.sampling import sampled_controller, sampled_loop


def positive(random: np.random.Generator, n: int) -> Array:
    root = random.normal(size=(n, n))
    return np.asarray(root @ root.T)


@pytest.mark.parametrize("h", [0.01, 1.0, 40.0])
def test_cost_of_a_period_is_the_integral(h: float) -> None:
    """A mode of 1 s and one of a quarter of an hour, over up to 40 s."""
    random = np.random.default_rng(1)
    a = np.array([[0.0, 1.0, 0.0], [-1e-4, -0.01, 0.3], [0.0, 0.0, -1.0]])
    b, q, r = random.normal(size=(3, 2)), positive(random, 3), positive(random, 2)
    x, u = random.normal(size=3), random.normal(size=2)

    def rate(_: float, y: Array) -> Array:
        state = y[:3]
        return np.append(a @ state + b @ u, state @ q @ state + u @ r @ u)

    end = solve_ivp(rate, (0.0, h), np.append(x, 0.0), method="DOP853", rtol=1e-12, atol=1e-14)
    ad, bd, qd, rd, nd = sampled_cost(a, b, q, r, h)
    assert_allclose(ad @ x + bd @ u, end.y[:3, -1], rtol=1e-9)
    cost = x @ qd @ x + u @ rd @ u + 2.0 * x @ nd @ u
    assert_allclose(cost, end.y[3, -1], rtol=1e-9)


def test_no_mode_drowns_another() -> None:
    """A pole at −1000 1/s and one at zero over 1 s: e^{1000} must never stand in a sum."""
    cost = sampled_cost(np.diag([-1000.0, 0.0]), np.ones((2, 1)), np.eye(2), np.eye(1), 1.0)
    assert_allclose(np.diag(cost[2]), [1.0 / 2000.0, 1.0], rtol=1e-10)
    assert_allclose(cost[0], np.diag([0.0, 1.0]), rtol=0, atol=1e-12)


def test_noise_of_a_period() -> None:
    """A random walk in velocity: [h³/3 h²/2; h²/2 h]; a lag: (1 − e^{−2h})/2."""
    chain, h = np.array([[0.0, 1.0], [0.0, 0.0]]), 7.0
    found = sampled_noise(chain, np.diag([0.0, 2.0]), h)
    assert_allclose(found, 2.0 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]), rtol=1e-12)
    lag = sampled_noise(-np.eye(1), np.eye(1), 0.3)
    assert_allclose(lag, [[0.5 * (1.0 - np.exp(-0.6))]], rtol=1e-12)
    with pytest.raises(InputError, match="period must be > 0"):
        sampled_noise(chain, np.eye(2), 0.0)


def test_controllers_at_samples() -> None:
    lag, dt = transfer_function([1.0], [2.0, 1.0]), 0.05
    held = sampled_controller(lag, dt, "held")
    assert_allclose(held.a, expm(np.array([[-0.5 * dt]])), rtol=1e-14)
    # the bilinear one has the phase of the lag, the held one half a period more
    omega = np.array([0.3])
    exact = np.angle(lag.response(omega)[0, 0, 0])
    late = np.angle(held.response(omega)[0, 0, 0])
    same = np.angle(sampled_controller(lag, dt).response(omega)[0, 0, 0])
    assert_allclose(same, exact, rtol=0, atol=1e-5)
    assert_allclose(late, exact - 0.5 * dt * omega[0], rtol=0, atol=1e-4)
    assert sampled_controller(held, dt) is held
    with pytest.raises(InputError, match=r"made for a period of 0\.05 s"):
        sampled_controller(held, 0.06)


def test_margins_of_what_flies() -> None:
    """Hold and delay each take their phase at the crossover."""
    plant = transfer_function([1.0], [1.0, 0.0, 0.0])
    controller = transfer_function([1.2, 0.4], [0.2, 1.0])
    (smooth,) = loop_margins(series(plant, controller))
    dt = 0.05
    for delay, lost in ((0.0, 0.5), (0.1, 2.5)):
        loop = sampled_loop(plant, controller, dt, delay_s=delay)
        assert feedback(loop, gain(np.eye(1), dt)).is_stable
        (found,) = loop_margins(loop)
        assert_allclose(
            smooth.phase_rad - found.phase_rad, lost * dt * smooth.phase_rad_s, rtol=0.03
        )


def test_what_does_not_fit_a_period_is_said() -> None:
    one: Array = np.eye(1)
    for q, match in ((one, "Q must be 2 × 2"), (np.full((2, 2), np.nan), "finite")):
        with pytest.raises(InputError, match=match):
            sampled_cost(np.zeros((2, 2)), np.ones((2, 1)), q, one, 1.0)
    with pytest.raises(InputError, match="the density must be"):
        sampled_noise(np.zeros((2, 2)), one, 1.0)
    wrong: Any = "zoh"
    with pytest.raises(InputError, match="no method 'zoh'; there are: bilinear"):
        sampled_controller(transfer_function([1.0], [1.0, 1.0]), 0.1, wrong)
