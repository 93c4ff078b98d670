"""Structured synthesis for sampled plants, on the double integrator with a held input."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.requirements import Channel, DesignPlant
from hillsphere_controllers.structured.sampled_plants import sampled_norms, synthesise_sampled
from hillsphere_controllers.structured.single_loop import Pid
from hillsphere_controllers.structured.structure import free_state_space, mask_gains
from hillsphere_controllers.systems.algebra import lower_lft

PERIOD = 2.0
LIMIT = 2.5


def plant(period: float = PERIOD) -> LtiSystem:
    """Return r, v and a disturbance d that an impulse makes a step; z = r, and u at the plant."""
    t = period
    a = np.array([[1, t, t * t / 2], [0, 1, t], [0, 0, 0.9999]])
    push = np.array([t * t / 2, t, 0])
    b = np.column_stack([[0, 0, 1.0], push, push])
    c = np.array([[2 / t**2, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    d = np.zeros((4, 3))
    d[1, 1:] = 1.0
    return LtiSystem(a, b, c, d, period)


def design() -> DesignPlant:
    return DesignPlant(
        plant(), (Channel((0,), (0,), "h2"), Channel((1,), (1,), "hinf", 1.0, LIMIT))
    )


def test_norms_are_those_of_the_sampled_loop_and_limits_hold() -> None:
    found = synthesise_sampled(design(), free_state_space(1, 1, 2), starts=1, seed=1)
    assert found.controller.dt_s == PERIOD
    loop = lower_lft(plant(), found.controller)
    assert np.abs(loop.poles).max() < 1.0
    # the response to an impulse, summed up sample by sample
    x, squares = loop.b[:, 0].copy(), loop.d[0, 0] ** 2
    for _ in range(20_000):
        squares += float(loop.c[0] @ x) ** 2
        x = loop.a @ x
    assert found.gamma == pytest.approx(np.sqrt(squares), rel=1e-6)
    theta = np.linspace(1e-4, np.pi, 20_000)
    peak = np.abs(loop.response(theta / PERIOD)[:, 1, 1]).max()
    assert peak <= LIMIT * (1 + 1e-5)
    assert peak > 0.99 * LIMIT  # the limit holds the design


def test_a_loop_that_is_not_stable_has_no_norm() -> None:
    none = LtiSystem(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.zeros((1, 2)), PERIOD)
    assert sampled_norms(design(), none) == [np.inf, np.inf]


def test_faults() -> None:
    with pytest.raises(InputError, match="every entry of the controller must be free"):
        synthesise_sampled(design(), mask_gains(np.array([[np.nan, 0.0]])))
    with pytest.raises(InputError, match="every entry of the controller must be free"):
        synthesise_sampled(design(), Pid())
    with pytest.raises(InputError, match="of one period, got"):
        synthesise_sampled(
            [design(), DesignPlant(plant(1.0), design().channels)], free_state_space(1, 1, 2)
        )
