from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import (
    NotStabilisableError,
    SingularProblemError,
    SynthesisFailedError,
)
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.lmi import output_feedback as module
from hillsphere_controllers.lmi.output_feedback import output_feedback
from hillsphere_controllers.structured.requirements import Channel, PoleRegion
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.bilinear import discrete


def plant(seed: int, order: int, controls: int = 2, measurements: int = 1) -> LtiSystem:
    """Weight on the controls, noise on the measurements, D22 not zero."""
    random = np.random.default_rng(seed)
    k, q = controls, measurements
    d = np.zeros((2 + k + q, 2 + q + k))
    d[2 : 2 + k, 2 + q :] = np.eye(k)
    d[2 + k :, 2 : 2 + q] = np.eye(q)
    d[2 + k :, 2 + q :] = random.normal(size=(q, k))
    b, c = random.normal(size=(order, 2 + q + k)), random.normal(size=(2 + k + q, order))
    b[:, 2 : 2 + q] = 0.0
    c[2 : 2 + k] = 0.0
    a = random.normal(size=(order, order)) - 0.5 * np.eye(order)
    return LtiSystem(a, b, c, d)


@pytest.mark.parametrize(("seed", "order"), [(1, 1), (3, 3), (6, 6)])
def test_least_norms_are_those_of_the_riccati_equations(seed: int, order: int) -> None:
    given = plant(seed, order)
    found = output_feedback(given, 2, 1)
    riccati = hinf_synthesis(given, 2, 1)
    assert_allclose(found.least, riccati.least, rtol=5e-4)
    loop = lower_lft(given, found.controller)
    assert loop.is_stable
    assert riccati.least <= hinf_norm(loop).value <= found.least * 1.0101
    assert found.controller.order == order
    quadratic = output_feedback(given, 2, 1, [Channel(norm="h2")])
    best = h2_synthesis(given, 2, 1).norm
    assert_allclose(quadratic.least, best, rtol=5e-4)
    assert best * (1.0 - 1e-6) <= quadratic.channels[0].norm <= 1.031 * best


def test_h2_under_a_limit_of_the_hinf_norm() -> None:
    given = plant(3, 3)
    best = h2_synthesis(given, 2, 1)
    peak, least = hinf_norm(best.closed_loop).value, hinf_synthesis(given, 2, 1).least
    limits = [least + share * (peak - least) for share in (0.3, 0.7)]
    made = [
        output_feedback(given, 2, 1, [Channel(norm="h2"), Channel(limit=limit)]) for limit in limits
    ]
    for found, limit in zip(made, limits, strict=True):
        loop = lower_lft(given, found.controller)
        assert hinf_norm(loop).value <= limit * (1.0 + 1e-4)
        assert found.channels[0].norm >= best.norm * (1.0 - 1e-6)
    # a tighter limit costs more
    assert made[0].least > made[1].least > best.norm * (1.0 - 1e-4)


def test_poles_lie_in_the_region() -> None:
    given = plant(3, 3)
    region = PoleRegion(decay_1_s=1.2, damping=0.5, fastest_rad_s=30.0)
    free = output_feedback(given, 2, 1, [Channel(norm="h2")])
    assert free.closed_loop.poles.real.max() > -1.2
    found = output_feedback(given, 2, 1, [Channel(norm="h2")], region)
    poles = found.closed_loop.poles
    assert poles.real.max() <= -1.2 * (1.0 - 1e-4)
    assert (-poles.real / np.abs(poles)).min() >= 0.5 * (1.0 - 1e-4)
    assert np.abs(poles).max() <= 30.0 * (1.0 + 1e-4)
    assert found.least > free.least


def test_channels_of_their_own() -> None:
    """H∞ from the first disturbance, H2 from the others; both computed anew from the loop."""
    given = plant(4, 4)
    peak = Channel(inputs=(0,), outputs=(0, 2, 3))
    power = Channel(norm="h2", inputs=(1, 2), outputs=(1, 2, 3), weight=2.0)
    limit = 1.3 * output_feedback(given, 2, 1, [power]).least
    power = replace(power, limit=limit)
    found = output_feedback(given, 2, 1, [peak, power])
    loop = lower_lft(given, found.controller)
    rows, columns = [0, 2, 3], [0]
    part = LtiSystem(loop.a, loop.b[:, columns], loop.c[rows], loop.d[np.ix_(rows, columns)])
    assert_allclose(found.channels[0].norm, hinf_norm(part).value, rtol=1e-9)
    rows, columns = [1, 2, 3], [1, 2]
    assert_allclose(loop.d[np.ix_(rows, columns)], 0.0, rtol=0, atol=1e-9)
    part = LtiSystem(loop.a, loop.b[:, columns], loop.c[rows], np.zeros((3, 2)))
    assert_allclose(found.channels[1].norm, 2.0 * h2_norm(part), rtol=1e-9)
    assert found.channels[1].norm <= limit * (1.0 + 1e-4)


def test_a_plant_without_weights_and_noise_is_solved_too() -> None:
    """D12 = 0 and D21 = 0, where the Riccati equations are not defined."""
    given = LtiSystem(
        np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 1.0]]),
        np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)),
    )  # fmt: skip
    with pytest.raises(SingularProblemError):
        hinf_synthesis(given, 1, 1, regularisation=0.0)
    found = output_feedback(
        given, 1, 1, [Channel(limit=0.5)], PoleRegion(decay_1_s=0.2, fastest_rad_s=20.0)
    )
    assert hinf_norm(lower_lft(given, found.controller)).value <= 0.5 * (1.0 + 1e-4)
    assert found.closed_loop.poles.real.max() <= -0.2 * (1.0 - 1e-4)


def test_discrete_time_by_the_bilinear_map() -> None:
    given = discrete(plant(3, 3), 0.2)
    found = output_feedback(given, 2, 1)
    assert found.controller.dt_s == 0.2
    loop = lower_lft(given, found.controller)
    assert np.abs(loop.poles).max() < 1.0
    assert_allclose(found.least, hinf_synthesis(given, 2, 1).least, rtol=5e-4)
    assert hinf_norm(loop).value <= 1.0101 * found.least
    with pytest.raises(InputError, match="in discrete time"):
        output_feedback(given, 2, 1, [Channel(norm="h2")])


def test_what_cannot_be_done_is_said() -> None:
    given = plant(3, 3)
    least = hinf_synthesis(given, 2, 1).least
    with pytest.raises(SynthesisFailedError, match=r"no solution|Clarabel"):
        output_feedback(given, 2, 1, [Channel(limit=0.9 * least)])
    with pytest.raises(InputError, match="orders from 1 to 20, got 22"):
        output_feedback(plant(1, 22), 2, 1)
    with pytest.raises(InputError, match="do not fit"):
        output_feedback(given, 2, 5)
    hidden = LtiSystem(
        np.diag([1.0, -1.0]), np.ones((2, 2)), np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 2))
    )
    with pytest.raises(NotStabilisableError, match="measurements do not show"):
        output_feedback(hidden, 1, 1)


def test_a_controller_that_does_not_pass_the_check_is_not_returned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def wrong(self: object, factor: float) -> LtiSystem:
        return LtiSystem(-np.eye(1), np.ones((1, 1)), np.ones((2, 1)), 1e3 * np.ones((2, 1)))

    monkeypatch.setattr(module._Problem, "controller", wrong)
    with pytest.raises(SynthesisFailedError, match=r"not stable|promise"):
        output_feedback(plant(3, 3), 2, 1)
