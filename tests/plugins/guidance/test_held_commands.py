"""Commands in steps that follow a path, and flights that repeat it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import GuidanceTask, GuidedFlight
from hillsphere_guidance.held_commands import solve_held_command
from hillsphere_guidance.held_steps import command_times, fly_held_steps
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.replays import replay_continuous, replay_held


@pytest.fixture(scope="module")
def flight(phobos: Any, landing: GuidanceTask) -> GuidedFlight:
    planned: GuidedFlight = create("guidance", "minimum_energy").plan(phobos, landing)
    return planned


@pytest.mark.parametrize(
    ("hold", "times"),
    [(10.0, [0, 10, 20, 25]), (11.0, [0, 11, 25]), (20.0, [0, 12.5, 25]), (90.0, [0, 12.5, 25])],
)
def test_no_command_is_held_for_very_short(hold: float, times: list[float]) -> None:
    np.testing.assert_allclose(command_times(25.0, hold), times, rtol=1e-15)


@pytest.mark.parametrize(("step", "size"), [(30.0, 8e-4), (60.0, 3e-3), (70.0, 4e-3)])
def test_held_flight_meets_the_path(
    phobos: Any, landing: GuidanceTask, flight: GuidedFlight, step: float, size: float
) -> None:
    """Every second state, and the end after an even, an odd and a broken number of steps."""
    motion, t = motion_of(phobos), command_times(7980.0, step)
    x = flight.states(t)
    mean = flight.command(0.5 * (t[1:] + t[:-1]))
    u = solve_held_command(motion, t, x, mean, 0.0)
    flown = replay_held(motion, t, u, landing.start, 0.0)
    gap = flown - x
    even = len(t) - 1 - (len(t) - 1) % 2 * 3
    assert np.abs(gap[:3, : even + 1 : 2]).max() < 1e-4
    assert np.abs(gap[:3, -1]).max() < 1e-4
    assert np.abs(gap[3:6, -1]).max() < 1e-7
    assert np.abs(gap[3:6]).max() < size


def test_open_loop_replay_ends_where_planned(
    phobos: Any, landing: GuidanceTask, flight: GuidedFlight
) -> None:
    end = replay_continuous(motion_of(phobos), flight, landing.start, 0.0)
    goal = flight.states(np.array([7980.0]))[:, 0]
    np.testing.assert_allclose(end[:3], goal[:3], rtol=0, atol=3e-7)
    np.testing.assert_allclose(end[3:6], goal[3:6], rtol=0, atol=1e-9)


def test_steps_that_are_too_long_are_refused(phobos: Any, flight: GuidedFlight) -> None:
    t = np.array([0.0, 3990.0, 7980.0])
    with pytest.raises(ConvergenceError, match="take shorter steps"):
        solve_held_command(motion_of(phobos), t, flight.states(t), np.zeros((3, 2)), 0.0)


def test_derivatives_of_steps(phobos: Any, flight: GuidedFlight) -> None:
    """Against differences of the flights themselves."""
    motion, t = motion_of(phobos), np.array([0.0, 3000.0, 7900.0])
    x, u, h = flight.states(t), flight.command(t), np.full(3, 80.0)
    steps = fly_held_steps(motion, x, u, h, t)
    rows = [*motion.positions, *motion.velocities]
    sizes = [10.0] * 3 + [0.01] * 3
    for column, size in enumerate(sizes):
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[rows[column]] += sign * size
            ends.append(fly_held_steps(motion, moved, u, h, t).end[rows])
        difference = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(
            steps.by_state[:, column] * np.array(sizes)[column] / np.array(sizes)[:, None],
            difference * np.array(sizes)[column] / np.array(sizes)[:, None],
            rtol=0, atol=3e-7,
        )  # fmt: skip
    push = 1e-5
    for axis in range(3):
        ends = []
        for sign in (1.0, -1.0):
            pushed = u.copy()
            pushed[axis] += sign * push
            ends.append(fly_held_steps(motion, x, pushed, h, t).end[rows])
        difference = (ends[0] - ends[1]) / (2.0 * push)
        np.testing.assert_allclose(steps.by_command[:, axis], difference, rtol=0, atol=1e-2)
