"""A command that jumps between samples: its events are those of the exact flight, piece by piece.

All parts between two samples are proved at once from their ends, if they are far from any event.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from hillsphere.engine.simulation.ends import Watch
from hillsphere.engine.simulation.quick_look import QuickLook
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.simulation import Cases, CommandSteps, Simulator
from hillsphere.symbolic import Expr, Params, power

from .test_simulation_ends import CEILING, GRAVITY, Push, Shaft, Steady

PERIOD, SAMPLES, FASTEST = 12.0, 2, 12.0


class Lift(Shaft):
    """A shaft with a limit of the speed upward, whose slope is the command: it jumps with it."""

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {**super().events(x, t, p), "escape_speed": 1.0 - x[1] / FASTEST}


class Feed:
    """A reference of zero, and a command in steps."""

    def __init__(self, steps: list[CommandSteps]) -> None:
        self.steps = steps

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        return np.zeros_like(y)

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> CommandSteps:
        return self.steps[k]


def jumping(seed: int) -> list[CommandSteps]:
    rng, steps = np.random.default_rng(seed), []
    for _ in range(SAMPLES):
        shares = rng.uniform(0.2, 1.0, 3)
        u = GRAVITY + rng.normal(0.0, 2.0, (3, 1, 1))
        steps.append(CommandSteps(shares / shares.sum(), u - np.mean(u) + GRAVITY))
    return steps


def highest(steps: list[CommandSteps]) -> tuple[Array, Any]:
    """Return the largest gain of speed, and a function: initial speeds → largest gain of height."""
    pieces = [
        (share * PERIOD, u - GRAVITY)
        for one in steps
        for share, u in zip(one.shares, one.u[:, 0, 0], strict=True)
    ]
    h, a = np.array(pieces).T
    gained = np.concatenate([[0.0], np.cumsum(h * a)])

    def height(v0: Array) -> Array:
        z, most = np.zeros_like(v0), np.zeros_like(v0)
        for step, pull, begin in zip(h, a, gained[:-1], strict=True):
            v = v0 + begin
            top = np.clip(np.where(pull < 0.0, -v / min(pull, -1e-300), 0.0), 0.0, step)
            most = np.maximum(most, z + v * top + 0.5 * pull * top**2)
            z = z + v * step + 0.5 * pull * step**2
            most = np.maximum(most, z)
        return most

    return gained.max(), height


def count_wrong(law: str, substeps: int = 1, number: int = 24) -> int:
    """Count flights near a limit of speed or height that ended otherwise than exact ones do."""
    wrong = 0
    for seed in range(4):
        steps, rng = jumping(seed), np.random.default_rng(seed)
        gain, height = highest(steps)
        excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-6.0, -0.5, number)
        fast = rng.uniform(size=number) < 0.5
        v0 = np.where(fast, FASTEST - gain + excess, rng.uniform(-5.0, 5.0, number))
        top = CEILING - np.where(fast, 200.0, -excess) - height(v0)
        x0 = np.array([top, v0])
        over = (v0 + gain > FASTEST) | (top + height(v0) > CEILING)
        assert (top > 300.0).all()
        steady = Steady(0.0)
        steady.period_s = PERIOD
        acts: dict[str, Any] = {"held": Push(0.0, period_s=PERIOD), "continuous": steady}
        loop = Simulator(Lift(), acts[law], reference=Feed(steps), substeps=substeps)
        # What was flown far from everything leaves large regions behind.
        far = np.array([rng.uniform(400.0, 600.0, 64), rng.uniform(-3.0, 3.0, 64)])
        loop.fly(Cases(far), 1)
        # One by one: what is proved at once is proved of all flights of a block.
        flights = [loop.fly(Cases(x0[:, [i]]), SAMPLES) for i in range(x0.shape[1])]
        status = np.array([one.status[0] for one in flights])
        decided = status != "unresolved"
        assert np.count_nonzero(decided) >= 0.9 * len(status)
        wrong += int(np.count_nonzero(((status != "completed") != over)[decided]))
    return wrong


@pytest.mark.parametrize("substeps", [1, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("law", ["held", "continuous"])
def test_limits_between_jumps_of_a_command_are_met(law: str, substeps: int) -> None:
    assert count_wrong(law, substeps) == 0


def test_bends_do_not_bound_falls_over_a_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """The speed is linear in each part: its bend is zero, and its slope jumps between them."""
    look = QuickLook._of

    def by_bends(self: QuickLook, *given: Any) -> Any:
        known = look(self, *given)
        known.fall = known.need
        return known

    monkeypatch.setattr(QuickLook, "_of", by_bends)
    assert count_wrong("held") > 0


HOVERING = np.array([[CEILING - 60.0], [0.0]])
"""Flights that hover here return after a sample with a push up and down, from 90 m higher."""


def hover_then_jump(law: str) -> str:
    steps = [
        CommandSteps(
            np.array([0.25, 0.5, 0.25]), GRAVITY + push * np.array([[[1.0]], [[-1.0]], [[1.0]]])
        )
        for push in (0.0, 10.0)
    ]
    steady = Steady(0.0)
    steady.period_s = PERIOD
    acts: dict[str, Any] = {"held": Push(0.0, period_s=PERIOD), "continuous": steady}
    return Simulator(Shaft(), acts[law], reference=Feed(steps)).fly(Cases(HOVERING), 2).status[0]


@pytest.mark.parametrize("law", ["held", "continuous"])
def test_what_is_known_of_a_command_is_not_known_of_another(
    law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert hover_then_jump(law) == "escape"
    every = np.ones((1, 1, 64), dtype=bool)
    monkeypatch.setattr(QuickLook, "_departure", lambda *_: every)
    assert hover_then_jump(law) == "completed"


class Steepening(Shaft):
    """A shaft with a pull that grows with the fourth power of the height."""

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] - p["gravity"] * power(x[0] / 500.0, 4.0))


def throw_after_a_calm_flight() -> str:
    """Fly where the pull is weak; then throw something over the ceiling and back in a sample."""
    loop = Simulator(Steepening(), Push(0.0, period_s=4.5))
    assert loop.fly(Cases(np.array([[100.0], [0.0]])), 1).status == ("completed",)
    return loop.fly(Cases(np.array([[CEILING - 60.0], [60.0]])), 1).status[0]


def test_what_is_known_of_a_place_is_not_known_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    assert throw_after_a_calm_flight() == "escape"
    look = QuickLook._of

    def anywhere(self: QuickLook, *given: Any) -> Any:
        known = look(self, *given)
        known.half = known.half + np.inf
        return known

    monkeypatch.setattr(QuickLook, "_of", anywhere)
    assert throw_after_a_calm_flight() == "completed"


def test_of_a_flight_that_ends_between_jumps_only_the_end_is_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The parts of a period before the end of one flight, and after it, are proved together."""
    settled: list[Any] = []
    settle = Watch._settle

    def counted(self: Watch, *args: Any) -> Any:
        settled.append(args)
        return settle(self, *args)

    monkeypatch.setattr(Watch, "_settle", counted)
    count = 12
    steps = [CommandSteps(np.full(count, 1.0 / count), np.full((count, 1, 1), GRAVITY))] * 3
    loop = Simulator(Lift(), Push(0.0, period_s=PERIOD), reference=Feed(steps))
    x0 = np.array([np.full(64, 500.0), np.full(64, 0.0)])
    # at constant speed it meets the ceiling 4.5 s after the first sample, in the fifth part
    x0[:, 0] = CEILING - 4.5 * 4.0, 4.0
    flights = loop.fly(Cases(x0), 3)
    assert flights.cause[0] == "escape"
    assert flights.status[1:] == ("completed",) * 63
    np.testing.assert_allclose(flights.time_s[0], 4.5, rtol=1e-9)
    assert len(settled) <= 2


def test_a_flight_to_its_last_sample_ends_there() -> None:
    steps = [CommandSteps(np.ones(1), np.full((1, 1, 1), GRAVITY))] * 3
    loop = Simulator(Lift(), Push(0.0, period_s=PERIOD), reference=Feed(steps))
    # it would meet the ceiling in the period after the last sample
    x0 = np.array([[CEILING - 2.5 * PERIOD * 2.0, 400.0], [2.0, 0.0]])
    whole = loop.fly(Cases(x0), 3, history=True)
    short = loop.fly(Cases(x0), 3, history=True, to_last_sample=True)
    assert whole.status[0] != "completed"
    assert short.status == ("completed", "completed")
    np.testing.assert_array_equal(short.time_s, [2.0 * PERIOD, 2.0 * PERIOD])
    assert whole.history is not None
    assert short.history is not None
    np.testing.assert_array_equal(short.history.x[:, :3], whole.history.x[:, :3])
    with pytest.raises(InputError, match="same number of samples"):
        loop.fly(Cases(x0), [2, 3], to_last_sample=True)
