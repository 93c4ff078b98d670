"""Held inputs and delays against the solution of the differential equation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.holding import zero_order_hold

PERIOD, SAMPLES = 0.4, 9


def plant() -> LtiSystem:
    random = np.random.default_rng(3)
    return LtiSystem(
        random.normal(size=(3, 3)), random.normal(size=(3, 2)), random.normal(size=(2, 3)),
        random.normal(size=(2, 2)), None, ("u", "v"), ("y", "z"),
    )  # fmt: skip


def by_steps(system: LtiSystem, commands: Array) -> Array:
    x, seen = np.zeros(system.order), []
    for u in commands:
        seen.append(system.c @ x + system.d @ u)
        x = system.a @ x + system.b @ u
    return np.array(seen)


@pytest.mark.parametrize("delay", [0.0, 0.1, PERIOD, 1.3 * PERIOD, 2 * PERIOD])
def test_outputs_at_the_samples_are_those_of_the_equation(delay: float) -> None:
    """Each command begins `delay` after its sample; a change at a sample is not yet seen there."""
    given = plant()
    commands = np.random.default_rng(4).normal(size=(SAMPLES, 2))

    def acting(t: float) -> Array:
        k = int(np.floor((t - delay) / PERIOD + 1e-9))
        return commands[k] if k >= 0 else np.zeros(2)

    whole = delay > 0.0 and abs(delay / PERIOD - round(delay / PERIOD)) < 1e-9
    changes = np.arange(SAMPLES) * PERIOD
    times = np.unique(np.round(np.concatenate([changes, changes + delay]), 12))
    times = times[times <= changes[-1] + 1e-9]
    x, states = np.zeros(3), {0.0: np.zeros(3)}
    for left, right in pairwise(times):
        u = acting(0.5 * (left + right))
        x = solve_ivp(
            lambda t, x, u=u: given.a @ x + given.b @ u, (left, right), x,
            method="DOP853", rtol=1e-12, atol=1e-13,
        ).y[:, -1]  # fmt: skip
        states[float(right)] = x
    expected = [
        given.c @ states[float(np.round(t, 12))]
        + given.d @ acting(t if whole or delay == 0.0 else t - 1e-6)
        for t in changes
    ]
    made = zero_order_hold(given, PERIOD, delay)
    assert_allclose(by_steps(made, commands), np.array(expected), rtol=0, atol=1e-9)
    assert (made.inputs, made.outputs) == (("u", "v"), ("y", "z"))
    assert made.order == 3 + 2 * int(np.ceil(delay / PERIOD - 1e-9))


def test_a_delay_of_almost_whole_periods_counts_as_whole() -> None:
    exact, near = zero_order_hold(plant(), 0.1, 0.3), zero_order_hold(plant(), 0.1, 0.1 + 0.1 + 0.1)
    assert near.order == exact.order == 9
    assert_allclose(near.a, exact.a, rtol=0, atol=1e-14)


def test_the_hold_costs_half_a_period() -> None:
    """Below the sampling rate the response is that of the plant, half a period late."""
    plain = transfer_function([2.0], [1.0, 0.5])
    omega, dt = np.array([0.3, 1.0]), 1e-3
    for delay in (0.0, 0.4e-3, 2e-3):
        late = np.exp(-1j * omega * (0.5 * dt + delay))
        found = zero_order_hold(plain, dt, delay).response(omega)[:, 0, 0]
        assert_allclose(found, plain.response(omega)[:, 0, 0] * late, rtol=1e-6)


def test_what_cannot_be_held() -> None:
    for arguments, message in (
        ((zero_order_hold(plant(), 0.1), 0.1), "discrete time already"),
        ((plant(), 0.0), "period must be > 0"),
        ((plant(), 0.1, -0.1), "a delay must be"),
        ((plant(), 0.1, 2000.0), "a delay must be"),
    ):
        with pytest.raises(InputError, match=message):
            zero_order_hold(*arguments)
