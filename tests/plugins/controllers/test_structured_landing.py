"""Designs with parts that are alike, at a given bandwidth, with stable controllers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.requirements import Channel, DesignPlant
from hillsphere_controllers.structured.structure import (
    Alike,
    Diagonal,
    Sizes,
    free_state_space,
    static,
)
from hillsphere_controllers.structured.synthesis import synthesise

BANDWIDTH = 5e-3


def axis(pull: float) -> LtiSystem:
    """Make r̈ = pull r + u; z = (W_S (r_cmd − r), W_A u), y = (r_cmd, r, v).

    W_S = (s + c)/(2 (s + 5e-6)) with c = 5e-3, W_A = (s + 1e-3)/(1e-9 s + 5.5e-7): the weights
    span nine decades, their poles 5e-6 to 550 rad/s.
    """
    corner, steady, fast = 5e-3, 5e-6, 550.0
    a = np.zeros((4, 4))
    a[0, 1], a[1, 0] = 1.0, pull
    a[2, 0], a[2, 2] = -0.5 * (corner - steady), -steady
    a[3, 3] = -fast
    b = np.array([[0.0, 0.0], [0.0, 1.0], [0.5 * (corner - steady), 0.0], [0.0, 1e9]])
    c = np.zeros((5, 4))
    c[0, 0], c[0, 2], c[1, 3] = -0.5, 1.0, 1e-3 - fast
    c[3, 0], c[4, 1] = 1.0, 1.0
    d = np.array([[0.5, 0.0], [0.0, 1e9], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    return LtiSystem(a, b, c, d)


def axes(*pulls: float) -> DesignPlant:
    """Make axes beside each other, the controls and the measurements of each together."""
    count, each = len(pulls), [axis(pull) for pull in pulls]
    a, b, c, d = (_blocks([getattr(one, key) for one in each]) for key in ("a", "b", "c", "d"))
    rows = [5 * k + i for some in ([0], [1], [2, 3, 4]) for k in range(count) for i in some]
    columns = [2 * k + j for j in (0, 1) for k in range(count)]
    system = LtiSystem(a, b[:, columns], c[rows], d[np.ix_(rows, columns)])
    error, effort = tuple(range(count)), tuple(range(count, 2 * count))
    return DesignPlant(system, (Channel(error), Channel(effort)))


def _blocks(parts: list[Array]) -> Array:
    made = np.zeros(np.sum([part.shape for part in parts], axis=0))
    row = column = 0
    for part in parts:
        made[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return made


def test_parts_that_are_alike_have_one_set_of_parameters() -> None:
    whole = Diagonal([free_state_space(1, 1, 2)] * 3, alike=True)
    structure = Alike(whole)
    random = np.random.default_rng(1)
    theta, slope = random.normal(size=6), random.normal(size=(6, 9))
    assert structure.size == 6
    assert_allclose(structure.gains(theta), whole.gains(np.tile(theta, 3)), rtol=0, atol=0)
    for k, step in enumerate(1e-6 * np.eye(6)):
        change = structure.gains(theta + step) - structure.gains(theta - step)
        expected = float(np.sum(slope * change)) / 2e-6
        assert_allclose(structure.pull_back(theta, slope)[k], expected, rtol=1e-8, atol=1e-9)


def test_typical_parameters_of_alike_parts_are_means() -> None:
    structure = Alike(Diagonal([static(1, 1)] * 2, alike=True))
    middle, spread = structure.typical(Sizes(np.array([1.0, 4.0]), np.ones(2), 1.0))
    assert_allclose(middle, [0.0], rtol=0, atol=0)
    assert_allclose(spread, [2.0], rtol=1e-14)


def test_parts_that_differ_are_not_alike() -> None:
    with pytest.raises(InputError, match="to be alike"):
        Diagonal([static(1, 1), free_state_space(1, 1, 1)], alike=True)


def test_sizes_at_a_bandwidth_are_those_of_the_plant_there() -> None:
    loop = OpenLoop(axes(0.0), free_state_space(1, 1, 3))
    found = loop.sizes_at(BANDWIDTH)
    s = 1j * BANDWIDTH
    error = abs((s + 5e-3) / (2.0 * (s + 5e-6)) / s**2)
    effort = abs((s + 1e-3) / (1e-9 * s + 5.5e-7))
    u = 1.0 / max(error, effort)
    assert_allclose(found.controls, [u], rtol=1e-9)
    assert_allclose(found.measurements, [1.0, u / BANDWIDTH**2, u / BANDWIDTH], rtol=1e-9)
    assert found.rate == BANDWIDTH


def test_poles_of_the_controller_are_constraints_with_gradients() -> None:
    structure, random = free_state_space(2, 1, 1), np.random.default_rng(3)
    one, no = np.ones((1, 1)), np.zeros((1, 1))
    plant = LtiSystem(-one, np.ones((1, 2)), np.ones((2, 1)), np.block([[no, no], [no, no]]))
    loop = OpenLoop(DesignPlant(plant), structure)
    made = Objective([loop], structure, np.zeros(9), np.ones(9), controller_stable=True)
    # (s + 1)(s − 0.1) + 0.5 is stable, and so is the other pole of the controller
    x = np.array([[0.1, 0.0, 1.0], [0.0, -2.0, 0.1], [-0.5, 0.1, 0.0]]).ravel()
    x += 1e-3 * random.normal(size=9)
    point = made.evaluate(x)
    assert np.isfinite(point.objective)
    assert_allclose(point.excess, 0.1 / loop.rate, rtol=0.1)
    piece = max((p for p in made.pieces(point) if p.hard), key=lambda p: p.level)
    assert piece.plant == -2
    move = random.normal(size=9)
    up, down = (made.evaluate(x + h * move).excess for h in (1e-5, -1e-5))
    assert_allclose(float(piece.slope @ move), (up - down) / 2e-5, rtol=1e-6)


@pytest.mark.slow
def test_starts_agree_on_plants_that_are_badly_scaled() -> None:
    """Parameters span eight decades, and the gain of the error has a kink at ω = 0."""
    plant = axes(7.8e-7, -4.4e-7)
    structure = Diagonal([free_state_space(1, 1, 3)] * 2, alike=True)
    found = synthesise(
        plant, structure, starts=2, bandwidth_rad_s=BANDWIDTH, controller_stable=True, shaken=False
    )
    assert found.shaken.size == 0
    assert found.starts.max() < found.starts.min() * 1.002
    assert found.gamma < 0.88  # of both channels at once: 0.89 is the least of full order
    assert found.controller.poles.real.max() < 0.0
    own = [
        synthesise(
            axes(pull), free_state_space(1, 1, 3), starts=0, initial=[found.theta[part]],
            bandwidth_rad_s=BANDWIDTH, shaken=False,
        ).gamma
        for pull, part in ((7.8e-7, slice(0, 8)), (-4.4e-7, slice(8, 16)))
    ]  # fmt: skip
    assert max(own) <= found.gamma * (1.0 + 1e-6)


def test_a_controller_that_is_to_be_stable_is() -> None:
    """(s − 1)/((s − 2)(s + 1)): a zero between a pole and infinity, no stable one stabilises it."""
    plant = DesignPlant(
        LtiSystem(
            np.array([[0.0, 1.0], [2.0, 1.0]]),
            np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]),
            np.array([[-1.0, 1.0], [0.0, 0.0], [-1.0, 1.0]]),
            np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.1, 0.0]]),
        )
    )
    free = synthesise(plant, free_state_space(1, 1, 1), starts=1, effort="quick", shaken=False)
    assert free.controller.poles.real.max() > 0.0
    with pytest.raises(SynthesisFailedError, match="keeps the constraints"):
        synthesise(
            plant, free_state_space(1, 1, 1), starts=0, initial=[free.theta], controller_stable=True
        )


def test_ties_are_broken_by_what_is_preferred() -> None:
    plant = DesignPlant(
        LtiSystem(
            np.array([[0.0, 1.0], [-1.0, -0.1]]),
            np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]),
            np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]),
            np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.1, 0.0]]),
        )
    )
    asked: list[float] = []

    def prefer(controller: LtiSystem) -> float:
        asked.append(float(controller.b[0, 0]))  # the gains of one controller are not unique
        return asked[-1]

    first = synthesise(plant, free_state_space(1, 1, 1), starts=1, effort="quick", shaken=False)
    same = first.theta * [1.0, -2.0, -0.5, 1.0]
    found = synthesise(
        plant, free_state_space(1, 1, 1), starts=0, initial=[first.theta, same], prefer=prefer,
        shaken=False,
    )  # fmt: skip
    assert len(asked) == 2
    assert min(asked) < 0.0 < max(asked)
    assert float(found.controller.b[0, 0]) == min(asked)
    assert_allclose(found.gamma, first.gamma, rtol=1e-3)


def test_bandwidth_and_starts_are_checked() -> None:
    with pytest.raises(InputError, match="bandwidth"):
        synthesise(axes(0.0), free_state_space(1, 1, 3), bandwidth_rad_s=0.0)
    with pytest.raises(InputError, match="a start"):
        synthesise(axes(0.0), free_state_space(1, 1, 3), starts=0)
