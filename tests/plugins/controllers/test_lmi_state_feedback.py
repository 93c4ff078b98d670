from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import solve_continuous_are

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import (
    NotStabilisableError,
    SingularProblemError,
    SynthesisFailedError,
)
from hillsphere_controllers.lmi.state_feedback import state_feedback
from hillsphere_controllers.structured.requirements import Channel, PoleRegion


def scalar(a: float) -> LtiSystem:
    """ẋ = a x + w + u, z = (x, u)."""
    return LtiSystem(
        np.array([[a]]), np.array([[1.0, 1.0]]), np.array([[1.0], [0.0]]),
        np.array([[0.0, 0.0], [0.0, 1.0]]),
    )  # fmt: skip


def random_plant(seed: int, order: int) -> LtiSystem:
    random = np.random.default_rng(seed)
    d = np.zeros((5, 5))
    d[3:, 3:] = np.eye(2)
    c = np.vstack([random.normal(size=(3, order)), np.zeros((2, order))])
    return LtiSystem(
        random.normal(size=(order, order)), random.normal(size=(order, 5)), c, d
    )  # fmt: skip


def spring(stiffness: float) -> LtiSystem:
    """Position and velocity of a mass with little damping; force w, force u; z = position, u."""
    return LtiSystem(
        np.array([[0.0, 1.0], [-stiffness, -0.1]]), np.array([[0.0, 0.0], [1.0, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [0.0, 1.0]]),
    )  # fmt: skip


@pytest.mark.parametrize("a", [-2.0, -0.5, 0.0, 0.5, 2.0])
def test_scalar_problem_in_closed_form(a: float) -> None:
    """At rest z² is least (x = −a u …): 1/√(1 + a²); what is not stable costs a gain of one."""
    found = state_feedback(scalar(a), 1)
    assert_allclose(found.least, 1.0 / np.sqrt(1.0 + min(a, 0.0) ** 2), rtol=1e-4)
    assert found.least * (1.0 - 1e-4) < found.channels[0].norm <= 1.0101 * found.least
    assert_allclose(hinf_norm(found.closed_loops[0]).value, found.channels[0].norm, rtol=1e-9)
    quadratic = state_feedback(scalar(a), 1, [Channel(norm="h2")])
    assert_allclose(quadratic.least, np.sqrt(a + np.sqrt(a * a + 1.0)), rtol=1e-5)


@pytest.mark.parametrize("order", [3, 8])
def test_least_h2_norm_is_that_of_the_riccati_equation(order: int) -> None:
    plant = random_plant(order, order)
    found = state_feedback(plant, 2, [Channel(norm="h2")])
    x = solve_continuous_are(plant.a, plant.b[:, 3:], plant.c.T @ plant.c, np.eye(2))
    best = np.sqrt(np.trace(plant.b[:, :3].T @ x @ plant.b[:, :3]))
    assert_allclose(found.least, best, rtol=1e-4)
    assert best * (1.0 - 1e-6) <= h2_norm(found.closed_loops[0]) <= 1.0101 * best


def test_least_hinf_norm_is_that_of_the_riccati_equation() -> None:
    """AᵀX + XA + X(B₁B₁ᵀ/γ² − B₂B₂ᵀ)X + CᵀC = 0 has a stabilising X ≥ 0 just above the least γ."""
    plant = random_plant(5, 5)
    found = state_feedback(plant, 2)

    def solvable(gamma: float) -> bool:
        b1, b2 = plant.b[:, :3], plant.b[:, 3:]
        s = b2 @ b2.T - b1 @ b1.T / gamma**2
        hamiltonian = np.block([[plant.a, -s], [-plant.c.T @ plant.c, -plant.a.T]])
        values, vectors = np.linalg.eig(hamiltonian)
        if np.abs(values.real).min() < 1e-9:
            return False
        stable = vectors[:, values.real < 0.0]
        x = np.linalg.solve(stable[:5].T, stable[5:].T).T.real
        return bool(np.linalg.eigvalsh(0.5 * (x + x.T))[0] > -1e-9)

    assert solvable(found.least * 1.001)
    assert not solvable(found.least * 0.999)


def test_poles_lie_in_the_region() -> None:
    region = PoleRegion(decay_1_s=1.0, damping=0.6, fastest_rad_s=12.0)
    found = state_feedback(spring(4.0), 1, [Channel(norm="h2")], region)
    poles = found.closed_loops[0].poles
    assert poles.real.max() <= -1.0 * (1.0 - 1e-4)
    assert (-poles.real / np.abs(poles)).min() >= 0.6 * (1.0 - 1e-4)
    assert np.abs(poles).max() <= 12.0 * (1.0 + 1e-4)
    without = state_feedback(spring(4.0), 1, [Channel(norm="h2")])
    assert without.closed_loops[0].poles.real.max() > -1.0
    assert without.least < found.least
    placed = state_feedback(spring(4.0), 1, [], PoleRegion(decay_1_s=3.0))
    assert placed.closed_loops[0].poles.real.max() <= -3.0 * (1.0 - 1e-4)


def test_a_limit_is_kept_and_costs() -> None:
    plant = random_plant(6, 4)
    free = state_feedback(plant, 2, [Channel(norm="h2")])
    peak = hinf_norm(free.closed_loops[0]).value
    least = state_feedback(plant, 2).least
    limit = 0.5 * (least + peak)
    mixed = state_feedback(plant, 2, [Channel(norm="h2"), Channel(limit=limit)])
    assert hinf_norm(mixed.closed_loops[0]).value <= limit * (1.0 + 1e-4)
    assert mixed.least > free.least * (1.0 - 1e-6)
    with pytest.raises(SynthesisFailedError, match=r"no solution|Clarabel"):
        state_feedback(plant, 2, [Channel(norm="h2"), Channel(limit=0.9 * least)])


def test_weights_and_parts_of_channels() -> None:
    plant = random_plant(7, 3)
    part = Channel(outputs=(0, 3, 4), inputs=(1,), weight=2.0)
    found = state_feedback(plant, 2, [part])
    loop = found.closed_loops[0]
    direct = LtiSystem(loop.a, loop.b[:, [1]], loop.c[[0, 3, 4]], loop.d[np.ix_([0, 3, 4], [1])])
    assert_allclose(found.channels[0].norm, 2.0 * hinf_norm(direct).value, rtol=1e-9)
    plain = state_feedback(plant, 2, [Channel(outputs=(0, 3, 4), inputs=(1,))])
    assert_allclose(found.least, 2.0 * plain.least, rtol=1e-4)


def test_one_gain_for_a_polytope() -> None:
    corners = [spring(1.0), spring(9.0)]
    found = state_feedback(corners, 1)
    for stiffness in (1.0, 3.0, 6.0, 9.0):
        plant = spring(stiffness)
        loop = LtiSystem(
            plant.a + plant.b[:, 1:] @ found.gain, plant.b[:, :1],
            plant.c + plant.d[:, 1:] @ found.gain, plant.d[:, :1],
        )  # fmt: skip
        assert hinf_norm(loop).value <= 1.0101 * found.least
    assert found.least >= max(state_feedback(plant, 1).least for plant in corners) * (1.0 - 1e-5)


def test_uneven_units_do_not_matter() -> None:
    """States in units of 1e5 and 1e-4, controls in units of 1e6."""
    plant = random_plant(8, 4)
    t = np.array([1e5, 1.0, 1e-4, 1.0])
    u = np.array([1.0, 1.0, 1.0, 1e6, 1e-3])
    uneven = LtiSystem(
        plant.a / t[:, None] * t, plant.b / t[:, None] / u, plant.c * t, plant.d / u
    )  # fmt: skip
    assert_allclose(state_feedback(uneven, 2).least, state_feedback(plant, 2).least, rtol=1e-4)


def test_what_cannot_be_done_is_said() -> None:
    unreached = LtiSystem(
        np.diag([1.0, -1.0]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.eye(2), np.zeros((2, 2))
    )  # fmt: skip
    with pytest.raises(NotStabilisableError, match="controls do not reach"):
        state_feedback(unreached, 1)
    with pytest.raises(InputError, match="orders from 1 to 20, got 21"):
        state_feedback(random_plant(1, 21), 2)
    with pytest.raises(InputError, match="use lqr"):
        state_feedback(replace(scalar(0.5), dt_s=0.1), 1)
    with pytest.raises(InputError, match="from 0 to 1"):
        state_feedback(scalar(1.0), 1, [Channel(outputs=(2,))])
    with pytest.raises(InputError, match="do not fit"):
        state_feedback(scalar(1.0), 2)
    with pytest.raises(InputError, match="same numbers"):
        state_feedback([scalar(1.0), spring(1.0)], 1)
    with pytest.raises(InputError, match="at least one plant"):
        state_feedback([], 1)
    direct = replace(scalar(0.5), d=np.eye(2))
    with pytest.raises(SingularProblemError, match="infinite power"):
        state_feedback(direct, 1, [Channel(norm="h2")])
