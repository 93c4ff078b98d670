"""Minimum-fuel and convex guidance: known optima, necessary conditions, and requirements kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, GuidanceTask, GuidedFlight
from hillsphere.testing import check_guidance
from hillsphere_guidance.errors import InfeasibleGuidanceError
from hillsphere_guidance.held_steps import fly_held_steps
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.replays import replay_continuous
from hillsphere_guidance.specs import ConvexSpec


def sizes(flight: GuidedFlight) -> Array:
    return np.asarray(np.linalg.norm(flight.command(flight.breaks_s[:-1]), axis=0))


def cost(flight: GuidedFlight) -> float:
    return float(sizes(flight) @ np.diff(flight.breaks_s))


def test_bang_off_bang(line: Any) -> None:
    """Rest to rest: a for two holds, coast, −a for two; 2 a t (T − t) is the way."""
    most, burn, time = 0.5, 20.0, 100.0
    way = most * burn * (time - burn)
    task = GuidanceTask(np.zeros(2), np.array([way]), np.zeros(1), time)
    guidance = create("guidance", "minimum_fuel", hold_s=10.0, maximum_m_s2=most)
    flight = check_guidance(guidance, line, task)
    u = flight.command(flight.breaks_s[:-1])[0]
    np.testing.assert_allclose(u, [0.5, 0.5, *[0.0] * 6, -0.5, -0.5], rtol=0, atol=1e-6)


def test_unbounded_fuel_is_two_impulses_of_one_hold(line: Any) -> None:
    task = GuidanceTask(np.zeros(2), np.array([900.0]), np.zeros(1), 100.0)
    flight = create("guidance", "minimum_fuel", hold_s=10.0).plan(line, task)
    u = flight.command(flight.breaks_s[:-1])[0]
    np.testing.assert_allclose(u[[0, -1]], [1.0, -1.0], rtol=0, atol=1e-6)
    assert cost(flight) == pytest.approx(2.0 * 900.0 / 90.0, rel=1e-7)


def test_landing_on_the_primer_vector(phobos: Any, landing: GuidanceTask) -> None:
    """Necessary conditions of the optimum by an adjoint that the search never saw.

    With λ carried back by the transposes of the steps' derivatives, p = Bᵀλ/h points along every
    command, has length 1 where it is within the bound, more at the bound, less where it is off.
    """
    most = 5e-3
    guidance = create("guidance", "minimum_fuel", hold_s=120.0, maximum_m_s2=most)
    flight = guidance.plan(phobos, landing)
    motion, t = motion_of(phobos), flight.breaks_s
    h, u = np.diff(t), flight.command(t[:-1])
    size = np.linalg.norm(u, axis=0)
    steps = fly_held_steps(motion, flight.states(t[:-1]), u, h, t[:-1])
    onwards, primer = np.eye(6), np.empty((3, 6, len(h)))
    for k in range(len(h) - 1, -1, -1):
        primer[:, :, k] = (onwards @ steps.by_command[:, :, k]).T / h[k]
        onwards = onwards @ steps.by_state[:, :, k]
    on, full = size > 1e-3 * most, size > most * (1.0 - 1e-4)
    within = on & ~full
    assert 3 <= np.count_nonzero(on) < 40
    assert np.count_nonzero(full) > 3
    rows = []
    known = []
    for k in np.flatnonzero(on).tolist():
        way = u[:, k] / size[k]
        across = np.linalg.svd(way[None])[2][1:]
        rows += [*(across @ primer[:, :, k])]
        known += [0.0, 0.0]
        if within[k]:
            rows.append(way @ primer[:, :, k])
            known.append(1.0)
    unit = np.array([1e3] * 3 + [1.0] * 3)
    adjoint = np.linalg.lstsq(np.array(rows) / unit, np.array(known), rcond=None)[0] / unit
    p = np.einsum("ijk,j->ik", primer, adjoint)
    along = np.einsum("ik,ik->k", p, u) / np.maximum(size, 1e-300)
    np.testing.assert_allclose(p[:, on], along[on] * u[:, on] / size[on], rtol=0, atol=1e-2)
    assert (along[full] > 1.0 - 1e-2).all()
    assert (np.linalg.norm(p[:, ~on], axis=0) < 1.0 + 1e-2).all()
    np.testing.assert_allclose(along[within], 1.0, rtol=0, atol=1e-2)


def test_fuel_costs_less_than_energy_and_more_when_bounded(
    phobos: Any, landing: GuidanceTask
) -> None:
    energy = create("guidance", "convex", hold_s=240.0, objective="energy").plan(phobos, landing)
    free = create("guidance", "minimum_fuel", hold_s=240.0).plan(phobos, landing)
    bounded = create("guidance", "minimum_fuel", hold_s=240.0, maximum_m_s2=5e-3)
    flight = bounded.plan(phobos, landing)
    assert cost(free) < cost(flight) < 0.9 * cost(energy)
    assert sizes(flight).max() <= 5e-3 * (1.0 + 1e-5)
    goal = flight.states(np.array([7980.0]))[:, 0]
    end = replay_continuous(motion_of(phobos), flight, landing.start, 0.0)
    np.testing.assert_allclose(end[:3], goal[:3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(goal[:3], landing.end_position_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(goal[3:6], landing.end_velocity_m_s, rtol=0, atol=1e-9)


def test_requirements_are_kept_together(phobos: Any, landing: GuidanceTask) -> None:
    guidance = create(
        "guidance",
        "convex",
        hold_s=120.0,
        minimum_m_s2=2e-4,
        maximum_m_s2=6e-3,
        glide_slope_deg=30.0,
        glide_slope_time_s=1200.0,
        touchdown_tilt_deg=10.0,
    )
    flight = guidance.plan(phobos, landing)
    up = landing.up
    assert up is not None
    size, last = sizes(flight), flight.command(flight.breaks_s[-2:-1])[:, 0]
    assert size.min() >= 2e-4 * (1.0 - 1e-5)
    assert size.max() <= 6e-3 * (1.0 + 1e-5)
    assert last @ up >= np.cos(np.radians(10.0)) * np.linalg.norm(last) * (1.0 - 1e-5)
    t = flight.breaks_s[(flight.breaks_s >= 7980.0 - 1200.0) & (flight.breaks_s < 7980.0)]
    away = flight.states(t)[:3] - landing.end_position_m[:, None]
    slope = np.degrees(np.arcsin(up @ away / np.linalg.norm(away, axis=0)))
    assert slope.min() > 30.0 - 1e-3
    # each condition is felt: without them the optimum breaks it
    plain = create("guidance", "minimum_fuel", hold_s=120.0, maximum_m_s2=6e-3)
    free = plain.plan(phobos, landing)
    away = free.states(t)[:3] - landing.end_position_m[:, None]
    assert np.degrees(np.arcsin(up @ away / np.linalg.norm(away, axis=0))).min() < 25.0
    assert sizes(free).min() < 1e-6
    assert cost(free) < cost(flight)


def test_path_keeps_above_the_surface(phobos: Any, landing: GuidanceTask) -> None:
    """From beyond the body the path of the least energy, which asks for nothing, is through it."""
    start = np.array([-16560.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    task = GuidanceTask(start, landing.end_position_m, landing.end_velocity_m_s, 7980.0)
    axes = np.array([13030.0, 11400.0, 9140.0])
    levels = []
    for guidance in (
        create("guidance", "minimum_energy"),
        create("guidance", "minimum_fuel", hold_s=240.0),
    ):
        r = guidance.plan(phobos, task).states(np.arange(0.0, 7980.0, 240.0))[:3]
        levels.append(np.sum((r / axes[:, None]) ** 2, axis=0).min())
    assert levels[0] < 0.8
    assert levels[1] > 1.0 - 1e-5


def test_what_cannot_be_flown_is_named(line: Any) -> None:
    task = GuidanceTask(np.zeros(2), np.array([2000.0]), np.zeros(1), 100.0)
    guidance = create("guidance", "minimum_fuel", hold_s=10.0, maximum_m_s2=0.5)
    with pytest.raises(InfeasibleGuidanceError, match=r"no flight meets all requirements.*gaps"):
        guidance.plan(line, task)


def test_a_glide_slope_needs_a_site(uniform: Any) -> None:
    task = GuidanceTask(np.full(6, 10.0), np.ones(3), np.zeros(3), 10.0)
    with pytest.raises(InputError, match="give the descent a site"):
        create("guidance", "convex", glide_slope_deg=10.0).plan(uniform, task)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"minimum_mm_s2": 2, "maximum_mm_s2": 1}, "must not be above the maximum"),
        ({"glide_slope_time_s": 100}, "belongs to glide_slope"),
    ],
)
def test_rules(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ConvexSpec.model_validate(keys)
