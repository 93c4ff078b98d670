"""Legs that are flown before they are proved: results are those of legs proved one by one.

The plant is a spring between a floor and a ceiling. Its legs are longer than a swing, so that a
flight that passes the floor is back above it at the next sample: only the proof notices. From the
amplitude after each impulse follows by hand in which leg a flight ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from math import pi
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hillsphere.engine.simulation.ahead import Ahead
from hillsphere.engine.simulation.ends import Watch
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.simulation import Cases, Flights, Limit, NavigationErrors, Simulator
from hillsphere.symbolic import Expr, Params

MIDDLE, FLOOR, CEILING = 500.0, 100.0, 1000.0
PERIOD_S = 2.0 * pi
LEG_S = 1.25 * PERIOD_S


class Spring:
    """A swing of 2π s about the middle; it ends on the floor."""

    frame = "hill:toy"
    states = (Variable("height", 1), Variable("speed", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(100.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("stiffness", 1.0, "1/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], p["stiffness"] * (MIDDLE - x[0]))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": x[0] / FLOOR - 1.0}


class Kicks:
    """Impulses that make the swings wider, by what the law has seen so far."""

    actuation: Literal["hold", "impulse"] = "impulse"
    period_s = LEG_S

    def initial(self, n_cases: int) -> Array:
        return np.zeros((1, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return 20.0 * np.sign(y[1:2]) + 0.01 * xc, xc + 1.0


class Strict(Kicks):
    """The same, refusing swings that no flight has before it ends on the floor."""

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        if (np.hypot(y[0] - MIDDLE, y[1]) > MIDDLE - FLOOR + 25.0).any():
            raise ValueError("beyond the floor")
        return super().step(k, t_s, y, ref, xc)


class Counts:
    """What an observer is told."""

    def __init__(self) -> None:
        self.samples: list[int] = []

    def recorder(self, first: int, count: int) -> Any:
        return lambda now: self.samples.append(now.k)


def starts(cases: int) -> Array:
    """Return starts of swings of 100 m and more, the last cases on the ceiling's side."""
    swing = np.linspace(100.0, 398.0, cases)
    phase = np.linspace(0.3, 5.0, cases)
    return np.array([MIDDLE + swing * np.cos(phase), -swing * np.sin(phase)])


def fly(
    x0: Array, observer: Counts | None = None, law: Kicks | None = None, **options: Any
) -> Flights:
    limit = Limit("roof", lambda t, x, cases: 1.0 - x[0] / CEILING, lipschitz=[1 / CEILING, 0.0])
    simulator = Simulator(Spring(), law or Kicks(), limits=[limit], substeps=24, **options)
    return simulator.fly(Cases(x0), 14, history=True, observer=observer)


def assert_same(one: Flights, other: Flights) -> None:
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name == "history":
            for part in fields(a):
                assert_array_equal(getattr(a, part.name), getattr(b, part.name))
        else:
            assert_array_equal(a, b, err_msg=field.name)


@pytest.mark.parametrize("cases", [1, 70])
def test_results_are_those_of_legs_proved_one_by_one(
    cases: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = NavigationErrors([5.0, 0.5])
    together = fly(starts(cases), navigation=errors)
    monkeypatch.setattr(Ahead, "tries", False)
    assert_same(together, fly(starts(cases), navigation=errors))


def test_flights_end_in_the_leg_in_which_their_swing_reaches_the_floor() -> None:
    x0 = starts(40)
    flights = fly(x0)
    height, speed = x0[0] - MIDDLE, x0[1].copy()
    never = 99
    ends = np.full(40, never)
    seen = np.zeros(40)
    for k in range(14):
        speed = speed + 20.0 * np.sign(speed) + 0.01 * seen
        seen += 1.0
        # A leg of five quarters of a swing passes every height within the amplitude.
        reaches = np.hypot(height, speed) > MIDDLE - FLOOR
        ends = np.where((ends == never) & reaches, k + 1, ends)
        c, s = np.cos(LEG_S), np.sin(LEG_S)
        height, speed = c * height + s * speed, c * speed - s * height
    assert_array_equal(flights.samples, np.minimum(ends, 14))
    assert_array_equal(np.array(flights.status) == "impact", ends < never)
    assert 5 < np.count_nonzero(ends < never) < 35


class Reusing(Kicks):
    """The same, with one array for all its commands, and memory that it changes in place."""

    def __init__(self) -> None:
        self.out: dict[int, Array] = {}

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        command, _ = super().step(k, t_s, y, ref, xc)
        out = self.out.setdefault(y.shape[1], np.empty_like(command))
        out[:] = command
        xc += 1.0
        return out, xc


def test_a_law_may_write_into_its_own_arrays() -> None:
    assert_same(fly(starts(40)), fly(starts(40), law=Reusing()))


def test_samples_are_heard_while_the_flight_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """No leg waits for its proof: the observer hears of it 64 samples later at the latest."""
    monkeypatch.setattr(Ahead, "tries", False)
    heard, late = Counts(), []

    class Listening(Kicks):
        def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
            late.append(k - len(heard.samples))
            return np.zeros_like(y[1:2]), xc

    simulator = Simulator(Spring(), Listening(), substeps=24)
    x0 = np.array([[MIDDLE + 10.0], [0.0]])
    simulator.fly(Cases(x0), 300, observer=heard)
    assert len(heard.samples) == 301
    assert max(late) <= 64


def test_a_law_may_refuse_what_lies_beyond_the_end_of_a_flight() -> None:
    x0 = starts(40)
    assert_same(fly(x0), fly(x0, law=Strict()))
    # What it refuses of a flight that goes on is an error all the same.
    with pytest.raises(ValueError, match="beyond the floor"):
        fly(np.array([[MIDDLE], [430.0]]), law=Strict())


def test_an_observer_is_told_of_each_sample_once() -> None:
    counts = Counts()
    flights = fly(starts(40), counts)
    assert "impact" in flights.status
    assert counts.samples == list(range(15))


def test_many_legs_are_proved_together(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    prove = Watch.count_proved

    def spy(self: Watch, flown: Any, cases: int) -> int:
        asked.append(len(flown))
        return prove(self, flown, cases)

    monkeypatch.setattr(Watch, "count_proved", spy)
    x0 = starts(40)[:, :3]
    flights = fly(x0)
    assert set(flights.status) == {"completed"}
    assert asked == [14]
    # A leg whose proof fails is repeated with its own; legs before it stay proved.
    asked.clear()
    monkeypatch.setattr(Watch, "count_proved", lambda self, flown, cases: 0)
    assert_same(flights, fly(x0))


def test_simulators_share_what_proofs_have_learnt_of_equal_limits() -> None:
    roofs = [
        Limit("roof", lambda t, x, cases: 1.0 - x[0] / CEILING, lipschitz=[1 / CEILING, 0.0])
        for _ in range(2)
    ]
    plant = Spring()
    simulators = [
        Simulator(plant, Kicks(), limits=[limit], substeps=24)
        for limit in (*roofs, replace(roofs[0], lipschitz=[2 / CEILING, 0.0]))
    ]
    proofs = [one._watch(False, ())._proof for one in simulators]
    assert proofs[0] is proofs[1]
    assert proofs[2] is not proofs[0]
