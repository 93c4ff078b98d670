"""The outcome of a flight does not depend on its neighbours, nor on what was flown before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hillsphere.interfaces import Array, Integers
from hillsphere.simulation import Cases, Flights, Limit, Simulator, simulate

from .test_event_study import (
    Approach,
    Coasting,
    Filtered,
    Held,
    Law,
    draw_starts,
    ellipsoid_world,
    exact_flights,
    excesses,
    surface,
)
from .test_simulation_ends import CEILING, FLOOR, GRAVITY, Push, Shaft, Steady

ROOF = 0.9 * CEILING


def below_roof(t: Array, x: Array, cases: Integers) -> Array:
    return np.asarray((ROOF - x[0]) / CEILING)


STEEP = Limit("roof", below_roof, lipschitz=[1.0 / CEILING, 0.0])
"""Only its slope is bounded: an approach to e leaves some 1/√e pieces of a step undecided."""


def thrown(number: int, seed: int) -> tuple[Array, Array]:
    """Return throws whose tops are within 1 mm to 100 m of the roof, and their excess (m)."""
    rng = np.random.default_rng(seed)
    excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-3.0, 2.0, number)
    rise = rng.uniform(15.0, 30.0, number)
    return np.array([ROOF + excess - 0.5 * rise**2 / GRAVITY, rise]), excess


def fly_once(x0: Array) -> Flights:
    return simulate(Shaft(), Push(0.0, period_s=40.0), Cases(x0), 1, limits=[STEEP])


def test_a_block_of_close_approaches_decides_what_each_lane_decides_alone() -> None:
    x0, excess = thrown(64, 3)
    far = np.repeat([[500.0], [10.0]], 63, axis=1)
    together = fly_once(x0)
    assert np.array_equal(np.array(together.status) == "constraint", excess > 0.0)
    assert "unresolved" not in together.status
    for lane in range(0, 64, 8):
        for other in (x0[:, [lane]], np.concatenate([x0[:, [lane]], far], axis=1)):
            flights = fly_once(other)
            assert flights.status[0] == together.status[lane]
            assert flights.time_s[0] == together.time_s[lane]
            assert (flights.x[:, 0] == together.x[:, lane]).all()


def assert_same(base: Flights, again: Flights, which: Integers) -> None:
    """Demand equal bits of the flights `which` of `base`, in this order."""
    assert again.status == tuple(base.status[i] for i in which)
    assert again.cause == tuple(base.cause[i] for i in which)
    assert np.array_equal(again.time_s, base.time_s[which])
    assert np.array_equal(again.x, base.x[:, which])
    assert np.array_equal(again.step_error, base.step_error[which])


def assert_composition_does_not_matter(
    make: Callable[[], Simulator], cases: Callable[[Integers], Cases], count: int, samples: int
) -> Flights:
    """Fly cases in other orders, few at a time, in fresh simulators and in used ones."""
    rng = np.random.default_rng(count)
    used = make()
    base = used.fly(cases(np.arange(count)), samples)
    for simulator in (make(), used):
        order = rng.permutation(count)
        assert_same(base, simulator.fly(cases(order), samples), order)
    grown = make()
    for _ in range(6):
        few = rng.choice(count, 2)
        assert_same(base, grown.fly(cases(few), samples), few)
        assert_same(base, make().fly(cases(few), samples), few)
    return base


def difficult_throws() -> Array:
    """Return throws that touch, cross twice in a sub-step, or cross at 1/64, 2/64 … of it."""
    rng = np.random.default_rng(5)
    number = 80
    rise = rng.uniform(5.0, 40.0, number)
    excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-15.0, 2.0, number)
    excess[:8] = 0.0
    touching = [CEILING + excess - 0.5 * rise**2 / GRAVITY, rise]
    at, speed = 40.0 * rng.integers(1, 64, number) / 64.0, rng.uniform(5.0, 60.0, number)
    dyadic = [CEILING - speed * at + 0.5 * GRAVITY * at**2, speed]
    falling = [FLOOR - speed * at + 0.5 * GRAVITY * at**2, speed]
    x0 = np.concatenate([touching, dyadic, falling], axis=1)
    return np.asarray(x0[:, (x0[0] > FLOOR) & (x0[0] < CEILING)])


@pytest.mark.parametrize("substeps", [1, pytest.param(2, marks=pytest.mark.slow), 40])
@pytest.mark.parametrize("law", ["held", "impulse", "continuous"])
def test_throws_end_alike_in_any_company(law: str, substeps: int) -> None:
    x0 = difficult_throws()
    steady = Steady(0.0)
    steady.period_s = 40.0
    laws: dict[str, Any] = {
        "held": Push(0.0, period_s=40.0),
        "impulse": Push(3.0, "impulse", period_s=40.0),
        "continuous": steady,
    }
    flights = assert_composition_does_not_matter(
        lambda: Simulator(Shaft(), laws[law], substeps=substeps, limits=[STEEP]),
        lambda which: Cases(x0[:, which], numbers=which),
        x0.shape[1],
        2,
    )
    assert {"impact", "constraint"} <= set(flights.status)


@pytest.mark.parametrize(
    ("law", "substeps"),
    [(Coasting(), 1), (Filtered("held", 0.3), 6),
     pytest.param(Held(), 2, marks=pytest.mark.slow),
     pytest.param(Filtered("continuous", 0.1), 6, marks=pytest.mark.slow)],
)  # fmt: skip
def test_grazing_flights_end_alike_in_any_company(law: Law, substeps: int) -> None:
    """Chords all about a body, of which no region of bounds holds more than a few."""
    world, x0 = ellipsoid_world(), draw_starts(70, 3)
    approach = Approach(surface(world), exact_flights(world, law, x0))
    closer = 10.0 ** np.random.default_rng(1).uniform(-7.0, 0.0, 70)
    size = (approach.least + 1.0) / (1.0 + excesses(70, 3) * closer)
    flights = assert_composition_does_not_matter(
        lambda: Simulator(world.plant, law, run_time=["size"], substeps=substeps),
        lambda which: Cases(x0[:, which], p=size[None, which], numbers=which),
        70,
        4,
    )
    assert {"impact", "completed"} <= set(flights.status)


@pytest.mark.parametrize("substeps", [1, 4])
def test_flights_that_touch_a_limit_end_alike_whatever_was_flown_before(substeps: int) -> None:
    """Which pieces stay open is a matter of their own bounds, not of those of a region."""
    rng = np.random.default_rng(2)
    rise, count = rng.uniform(5.0, 39.0, 40), 40
    below = 10.0 ** rng.uniform(-14.0, -3.0, count)
    x0 = np.array([ROOF - below - 0.5 * rise**2 / GRAVITY, rise])
    cases = Cases(x0, p=np.full((1, count), GRAVITY))
    others = np.array([rng.uniform(100.0, 880.0, 64), rng.uniform(-30.0, 30.0, 64)])

    def loop() -> Simulator:
        law = Push(0.0, period_s=40.0)
        return Simulator(Shaft(), law, run_time=["gravity"], limits=[STEEP], substeps=substeps)

    fresh, used = loop(), loop()
    used.fly(Cases(others, p=rng.uniform(1.0, 9.0, (1, 64))), 1)
    used.fly(Cases(others, p=rng.uniform(1.9, 2.1, (1, 64))), 2)
    base = fresh.fly(cases, 1)
    assert "unresolved" in base.status
    assert_same(base, used.fly(cases, 1), np.arange(count))
