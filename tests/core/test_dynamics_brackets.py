"""All zeros along a trajectory, against throws and circles in closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from hillsphere.dynamics import Brackets, ProvedBrackets, StepMap, System, system
from hillsphere.engine.dynamics.expression_bounds import bounds_of_event
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, exp


@dataclass(frozen=True)
class Throw:
    """z̈ = −1."""

    frame = "inertial"
    states = (Variable("z", 1), Variable("v", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], 0.0 * x[0] - 1.0)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"ceiling": 1.0 - x[0]}


@dataclass(frozen=True)
class Circle(Throw):
    """ẍ = −x: with v a circle."""

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], -x[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


def bracketed(s: System, functions: list[str | Expr], x: Array, h: float, steps: int) -> Brackets:
    """Fly and bracket."""
    step_map = StepMap(s)
    values = s.function(*(s.events[f] if isinstance(f, str) else f for f in functions))
    p = s.parameters(None, 1)
    way = step_map.trajectory(x, steps * h, steps)

    def halve(base: Array, tau: Array) -> tuple[Array, Array]:
        y = step_map.step(np.ascontiguousarray(base), tau)
        return y, values(y, p)

    flat = values(way.reshape(len(way), -1), p).reshape(len(functions), *way.shape[1:])
    inside = np.ones((steps, x.shape[1]), dtype=bool)
    return ProvedBrackets(s, functions)(way, flat, h, halve, inside)


def assert_held(found: Brackets, lane: int, h: float, exact: Array, within: float) -> None:
    """Assert that a lane's brackets hold the given times, one each."""
    own = np.flatnonzero(found.lane == lane)
    ends = np.array([found.begin[own], found.end[own]]) + h * found.step[own]
    ends = np.sort(ends, axis=0)[:, np.argsort(ends[0])]
    assert ends.shape[1] == exact.size
    assert np.all(ends[0] <= np.sort(exact) + within)
    assert np.all(ends[1] >= np.sort(exact) - within)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("apart", [1e-1, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("steps", [1, 7, 13])
def test_pairs_in_one_step(apart: float, sense: float, steps: int) -> None:
    """Of throws that pass the ceiling by apart²/8, and of others that stay as far below it."""
    v = np.random.default_rng(5).uniform(0.4, 0.9, 20)
    over = np.concatenate([np.ones(10), -np.ones(10)])
    x = np.array([1.0 + over * apart**2 / 8.0 - 0.5 * v**2, sense * v])
    h = sense * 1.3 / steps
    s = system(Throw())
    found = bracketed(s, ["ceiling", s.x[0] * s.x[0] + s.x[0] - 2.0], x, h, steps)
    # of 1.3e-13 that the last throws pass the ceiling by, 1e-13 may be rounding
    assert found.resolved.all() or apart == 1e-6
    for lane in np.flatnonzero(found.resolved).tolist():
        two = (v[lane] + 0.5 * apart * np.array([-1.0, 1.0])) * sense
        exact = np.tile(two if over[lane] > 0 else two[:0], 2)
        assert_held(found, lane, h, exact, 1e-15 / apart)


def test_circles_from_all_sides() -> None:
    """Every passage of x = c, some of them twice in one step."""
    phase = np.linspace(0.1, 6.0, 40)
    x = np.array([np.cos(phase), np.sin(-phase)])
    s = system(Circle())
    h, steps, c = 0.05, 253, 0.99
    found = bracketed(s, [s.x[0] - c], x, h, steps)
    assert found.resolved.all()
    turns = 2.0 * np.pi * np.arange(-1, 4)[:, None] + np.arccos(c) * np.array([[-1.0, 1.0]])
    for lane in range(40):
        times = turns.ravel() - phase[lane]
        assert_held(found, lane, h, times[(times > 0) & (times < steps * h)], 1e-9)


def test_a_touch_is_said_not_to_be_decided() -> None:
    x = np.array([[1.0 - 0.5 * 0.7**2, 0.5], [0.7, 0.1]])
    found = bracketed(system(Throw()), ["ceiling"], x, 1.3, 1)
    assert found.resolved.tolist() == [False, True]


def test_a_function_without_a_bound() -> None:
    """Only its sign at the ends of steps is seen, and near zero that is said."""
    s = system(Throw())
    x = np.array([[0.5, 0.5], [0.9, 0.1]])
    found = bracketed(s, [exp(s.x[0]) - np.exp(1.0)], x, 0.1, 10)
    assert found.resolved.tolist() == [True, True]
    found = bracketed(s, [exp(s.x[0]) - np.exp(0.9)], x, 0.1, 10)
    assert found.resolved.tolist() == [False, True]


def test_every_polynomial_of_degree_two_has_a_bound() -> None:
    s = system(Throw())
    z, v = s.x
    for event in (z * z + v * v - 9.0, 2.0 * z * v - z, z**2.0, (z - 1.0) * (v + 3.0)):
        assert bounds_of_event(s, event) is not None
    assert bounds_of_event(s, z * z * v) is None
