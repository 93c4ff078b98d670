"""Paths of the least ∫|a|²: exact where the optimum is known, and RT1–RT3 over Phobos."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, GuidanceTask, GuidedFlight, Scales, Variable
from hillsphere.testing import check_guidance
from hillsphere_guidance.requirements import Requirements
from hillsphere_guidance.splines import gauss_nodes
from hillsphere_guidance.successive_convex import fly_successively


def effort(flight: GuidedFlight, power: int = 2) -> float:
    t, weights = gauss_nodes(np.linspace(0.0, flight.duration_s, 200), 6)
    size = np.linalg.norm(flight.command(t), axis=0)
    return float(weights @ size**power)


def change_task(task: GuidanceTask, **keys: Any) -> GuidanceTask:
    given = {
        name: getattr(task, name)
        for name in ("start", "end_position_m", "end_velocity_m_s", "duration_s", "time_s", "up")
    }
    return GuidanceTask(**{**given, **keys})


def test_command_is_linear_in_time_in_a_uniform_field(uniform: Any) -> None:
    start = np.array([500.0, -200.0, 900.0, -1.0, 0.5, 2.0])
    end = np.array([0.0, 100.0, 0.0]), np.array([0.0, 0.0, -1.0])
    task = GuidanceTask(start, *end, 400.0)
    flight = check_guidance(create("guidance", "minimum_energy"), uniform, task, tol=1e-12)
    miss = end[0] - start[:3] - 400.0 * start[3:] - 0.5 * 400.0**2 * np.array(uniform.field)
    slow = end[1] - start[3:] - 400.0 * np.array(uniform.field)
    first = 6.0 * miss / 400.0**2 - 2.0 * slow / 400.0
    last = -6.0 * miss / 400.0**2 + 4.0 * slow / 400.0
    t = np.linspace(0.0, 400.0, 9)
    wanted = first[:, None] + (last - first)[:, None] * t / 400.0
    np.testing.assert_allclose(flight.command(t), wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("count", [7, 12, 20])
def test_rest_to_rest_costs_twelve_distance_squared_over_time_cubed(line: Any, count: int) -> None:
    task = GuidanceTask(np.array([0.0, 0.0]), np.array([300.0]), np.zeros(1), 60.0)
    flight = create("guidance", "minimum_energy", control_points=count).plan(line, task)
    assert effort(flight) == pytest.approx(12.0 * 300.0**2 / 60.0**3, rel=1e-12)


def test_landing_on_phobos(phobos: Any, landing: GuidanceTask) -> None:
    flight = check_guidance(create("guidance", "minimum_energy"), phobos, landing)
    assert effort(flight, 1) == pytest.approx(8.0548, abs=1e-3)


def test_twelve_control_points_have_converged(phobos: Any, landing: GuidanceTask) -> None:
    few, many = (
        create("guidance", "minimum_energy", control_points=count).plan(phobos, landing)
        for count in (12, 24)
    )
    assert effort(few) == pytest.approx(effort(many), rel=1e-5)
    assert effort(few) >= effort(many)
    assert effort(few, 1) == pytest.approx(effort(many, 1), abs=1e-3)


def test_no_held_command_needs_less(phobos: Any, landing: GuidanceTask) -> None:
    """Successive convex programming, which knows nothing of splines, finds the same optimum."""
    spline = create("guidance", "minimum_energy", control_points=24).plan(phobos, landing)
    held = fly_successively(phobos, landing, Requirements("energy", 120.0))
    # what a hold of 120 s costs falls with its square
    assert effort(spline) < effort(held) < effort(spline) * (1.0 + 3e-3)


def test_start_time_and_anomaly_matter(phobos: Any, landing: GuidanceTask) -> None:
    later = landing.start.copy()
    later[6] = 2.0
    flight = check_guidance(
        create("guidance", "minimum_energy"),
        phobos,
        change_task(landing, start=later, time_s=500.0),
    )
    anomaly = flight.states(np.array([0.0, 7980.0]))[6]
    assert anomaly[0] == 2.0
    assert anomaly[1] == pytest.approx(phobos.true_anomaly_after(2.0, np.array([7980.0]))[0])


class Odd:
    """A plant that is not fit for guidance."""

    frame = "odd"
    scales = Scales(1.0, 1.0)
    states: tuple[Variable, ...] = (Variable("x", 1), Variable("v", 1, -1), Variable("m"))
    controls: tuple[Variable, ...] = (Variable("a", 1, -2),)

    def __init__(self, kind: str) -> None:
        self.kind = kind
        if kind == "few":
            self.controls = ()

    def parameters(self) -> tuple[Any, ...]:
        return ()

    def derivative(self, x: Any, u: Any, t: Any, p: Any) -> Any:
        push = u[0] if u else 0.0 * x[0]
        rates = {"mass": -1.0 * push, "few": 0.0 * x[2]}
        gain = 2.0 if self.kind == "gain" else 1.0
        return (x[1], gain * push, rates.get(self.kind, 0.0 * x[2]))

    def events(self, x: Any, t: Any, p: Any) -> Any:
        return {}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("few", "as many positions as velocities and controls"),
        ("mass", "the rate of m depends on"),
        ("gain", "added to the accelerations"),
    ],
)
def test_plants_that_are_refused(kind: str, message: str) -> None:
    task = GuidanceTask(np.array([0.0, 0.0, 1.0]), np.ones(1), np.zeros(1), 10.0)
    with pytest.raises(InputError, match=message):
        create("guidance", "minimum_energy").plan(Odd(kind), task)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"start": np.zeros(3)}, "start: 6 finite numbers"),
        ({"end_position_m": np.array([0.0, np.nan, 0.0])}, "end_position_m: 3 finite numbers"),
        ({"duration_s": 0.0}, "duration_s must be positive"),
    ],
)
def test_tasks_that_are_refused(uniform: Any, keys: dict[str, Any], message: str) -> None:
    task = GuidanceTask(np.zeros(6), np.ones(3), np.zeros(3), 10.0)
    with pytest.raises(InputError, match=message):
        create("guidance", "minimum_energy").plan(uniform, change_task(task, **keys))


def test_path_is_a_minimum(phobos: Any, landing: GuidanceTask) -> None:
    """Neighbouring splines with the same ends cost more, to second order in the distance."""
    flight = create("guidance", "minimum_energy").plan(phobos, landing)
    t, weights = gauss_nodes(flight.breaks_s, 8)
    from hillsphere_guidance.motion import motion_of
    from hillsphere_guidance.splines import ClampedSpline

    motion, spline = motion_of(phobos), ClampedSpline(7980.0, 12)
    x, rise = flight.states(t), flight.command(t) + motion.field(flight.states(t), t)[0]

    def cost(step: Array) -> float:
        bent = x.copy()
        bent[:3] += (spline.basis(t) @ step).T
        bent[3:6] += (spline.basis(t, 1) @ step).T
        a = rise + (spline.basis(t, 2) @ step).T - motion.field(bent, t)[0]
        return float(weights @ np.sum(a * a, axis=0))

    random = np.random.default_rng(5)
    here = cost(np.zeros((12, 3)))
    for _ in range(5):
        step = np.zeros((12, 3))
        step[2:-2] = random.normal(size=(8, 3))
        up, down = cost(10.0 * step) - here, cost(-10.0 * step) - here
        assert min(up, down) > 0.0
        assert up == pytest.approx(down, rel=1e-2)
