"""What is asked of single flights: their draws, which states are seen, limits, observers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.interfaces import Array, Integers, Parameter, Scales, Variable
from hillsphere.simulation import (
    BLOCK,
    Cases,
    Limit,
    Moment,
    NavigationErrors,
    PerfectNavigation,
    SeenStates,
    Simulator,
)
from hillsphere.symbolic import Expr, Params

PERIOD = 10.0


class Free:
    """A double integrator with an angle between position and velocity."""

    frame = "toy:line"
    states = (Variable("x", 1), Variable("angle", unit="rad"), Variable("v", 1, -1))
    controls = (Variable("a", 1, -2),)
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[2], x[2] * 0.0 + 0.01, u[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


class Damped:
    """A law for velocity and position, in this order."""

    period_s = PERIOD
    actuation: Literal["hold", "impulse"] = "hold"

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        assert y.shape == ref.shape == (2, len(t_s))
        return -0.1 * y[:1] - 0.002 * y[1:], xc


def simulator(sigma: float = 0.0) -> Simulator:
    inner = NavigationErrors([0.0, sigma]) if sigma else PerfectNavigation()
    return Simulator(Free(), Damped(), navigation=SeenStates([2, 0], inner))


def starts(count: int) -> Array:
    return np.array([np.linspace(10.0, 20.0, count), np.zeros(count), np.ones(count)])


def test_a_law_sees_the_states_it_names_in_its_order() -> None:
    flights = simulator().fly(Cases(starts(3)), 5, history=True)
    x, v = 15.0, 1.0
    for _ in range(5):
        u = -0.1 * v - 0.002 * x
        x, v = x + PERIOD * v + 0.5 * PERIOD**2 * u, v + PERIOD * u
    assert_allclose(flights.x[:, 1], [x, 0.5, v], rtol=1e-12)
    assert flights.history is not None
    assert_array_equal(flights.history.y, flights.history.x[[2, 0], :-1])


def test_noise_follows_draws_and_lookups_follow_numbers() -> None:
    loop = simulator(sigma=0.5)
    x0 = np.repeat(starts(1), 4, axis=1)
    one = loop.fly(Cases(x0, draws=np.array([7, 8, 7, 9])), 5)
    assert_array_equal(one.x[:, 0], one.x[:, 2])
    assert np.unique(one.x[0]).size == 3
    # As if these had been their numbers; which are asked for where something is looked up.
    assert_array_equal(loop.fly(Cases(x0, numbers=np.array([7, 8, 7, 9])), 5).x, one.x)
    asked: list[Integers] = []

    def told(t_s: Array, x: Array, cases: Integers) -> Array:
        asked.append(cases)
        return np.ones(len(t_s))

    loop.fly(Cases(x0, draws=np.array([7, 8, 7, 9])), 1, limits=[Limit("told", told)])
    assert_array_equal(asked[0][:4], np.arange(4))


def test_limits_of_one_call_are_gone_at_the_next() -> None:
    loop = simulator()
    below = Limit("below", lambda t_s, x, cases: x[0] - 12.0, "escape")
    first = loop.fly(Cases(starts(2)), 5, limits=[below])
    assert first.status == ("escape", "escape")
    assert_allclose(first.x[0, 1], 12.0, rtol=1e-12)
    assert loop.fly(Cases(starts(2)), 5).status == ("completed", "completed")


class Largest:
    """Keeps the largest position of each case, and how often it was told."""

    def __init__(self, total: int) -> None:
        self.largest = np.full(total, -np.inf)
        self.calls: list[tuple[int, int, bool]] = []

    def recorder(self, first: int, count: int) -> Callable[[Moment], None]:
        best = np.full(BLOCK, -np.inf)

        def record(now: Moment) -> None:
            self.calls.append((first, now.k, now.y is None))
            np.maximum(best, now.x[0], out=best, where=now.flying)
            self.largest[first : first + count] = best[:count]

        return record


def test_an_observer_sees_every_sample_of_every_block() -> None:
    loop, count = simulator(), BLOCK + 6
    seen = Largest(count)
    flights = loop.fly(Cases(starts(count)), 4, history=True, observer=seen)
    assert flights.history is not None
    assert_array_equal(seen.largest, flights.history.x[0].max(axis=0))
    expected = [(first, k, k == 4) for first in (0, BLOCK) for k in range(5)]
    assert seen.calls == expected
    alone = Largest(count)
    again = loop.fly(Cases(starts(count)), 4, observer=alone)
    assert_array_equal(alone.largest, seen.largest)
    assert_array_equal(again.x, flights.x)
