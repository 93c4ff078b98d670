"""Interval functions that are recorded and compiled give the bounds that are interpreted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hillsphere import build
from hillsphere import symbolic as sym
from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.interval_programs import Program, RepeatedFunction, record
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.system import system

Function = Callable[[Any, Any], Any]

FUNCTIONS: dict[str, Function] = {
    "sum": lambda x, y: x + y - 3.7 * x,
    "product": lambda x, y: x * y * -0.3,
    "quotient": lambda x, y: x / y,
    "product with zero": lambda x, y: (x * 0.0 + y) * (0.0 - y) + 0.0 * x,
    "square": lambda x, y: (x - y) ** 2,
    "cube": lambda x, y: (x - y) ** 3 + x**4,
    "high powers": lambda x, y: (x - y) ** 9 + (x**2 + y**2) ** -8.5,
    "inverse cube": lambda x, y: (x**2 + y**2) ** -1.5,
    "square root": lambda x, y: sym.sqrt(x + 4.0) * y,
    "length": lambda x, y: sym.norm([x, y]),
    "sine": lambda x, y: sym.sin(3.0 * x) - sym.cos(y),
    "tangent": lambda x, y: sym.tan(0.3 * x) + y,
    "exponential": lambda x, y: sym.exp(x) + sym.log(y + 5.0),
    "inverse sine": lambda x, y: sym.asin(0.2 * x) + sym.acos(0.2 * y),
    "angle": lambda x, y: sym.atan2(y, x),
    "smaller": lambda x, y: sym.minimum(x, y * y),
    "branch": lambda x, y: sym.select(sym.less(x, y), x, 2.0 * y),
    "anomaly": lambda x, y: y.symbolic_eccentric_anomaly(Bound.of(0.3)) * x,
}


def traced(function: Function) -> Callable[[Sequence[Interval]], list[Interval | None]]:
    """Return value and both derivatives of a function of two moving quantities."""

    def all_parts(given: Sequence[Interval]) -> list[Interval | None]:
        one = function(Bound(given[0], given[1], given[2]), Bound(*given[3:6]))
        return [one.value, one.rate, one.second]

    return all_parts


def some_intervals(rng: np.random.Generator, lanes: int) -> tuple[Array, Array]:
    """Return bounds, narrow and wide, some of them numbers, with zero at an end, or infinite."""
    middle = rng.uniform(-3.0, 3.0, (6, lanes))
    half = rng.choice([0.0, 1e-9, 1e-3, 0.3, 3.0], (6, lanes))
    lo, hi = middle - half, middle + half
    lo[rng.random(lo.shape) < 0.03] = -np.inf
    hi[rng.random(hi.shape) < 0.03] = np.inf
    at_zero = rng.random(lo.shape) < 0.05
    lo[at_zero], hi[at_zero] = 0.0, np.abs(hi[at_zero])
    return lo, hi


def interpreted(function: Callable[..., list[Interval | None]], lo: Array, hi: Array) -> Array:
    parts = function([*zip(lo, hi, strict=True)])
    zero = np.zeros(lo.shape[1])
    return np.array([np.broadcast_arrays(zero, *(p or (zero, zero)))[1:] for p in parts])


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_compiled_bounds_are_those_interpreted(name: str) -> None:
    lo, hi = some_intervals(np.random.default_rng(7), 2000)
    function = traced(FUNCTIONS[name])
    below, above = Program(record(function, 6))(lo, hi)
    for part, low, high in zip(interpreted(function, lo, hi), below, above, strict=True):
        known = ~np.isnan(part).any(axis=0)
        assert np.array_equal(known, ~(np.isnan(low) | np.isnan(high)))
        for end, same in ((part[0][known], low[known]), (part[1][known], high[known])):
            finite = np.isfinite(end)
            assert np.array_equal(end[~finite], same[~finite])
            size = np.maximum(np.abs(part[0][known]), np.abs(part[1][known]))[finite]
            assert (np.abs(end[finite] - same[finite]) <= 1e-12 * size + 1e-250).all()


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_values_lie_within_compiled_bounds(name: str) -> None:
    rng = np.random.default_rng(11)
    lo, hi = (np.repeat(ends, 50, axis=1) for ends in some_intervals(rng, 200))
    inside = np.isfinite(lo).all(axis=0) & np.isfinite(hi).all(axis=0)
    lo, hi = lo[:, inside], hi[:, inside]
    function = traced(FUNCTIONS[name])
    below, above = Program(record(function, 6))(lo, hi)
    at = np.clip(lo + rng.choice([0.0, 0.5, 1.0, -1.0], lo.shape) % 1.1 * (hi - lo), lo, hi)
    points = interpreted(function, at, at)
    # What is interpreted at a point contains the exact value, so that the two intervals meet.
    for part, low, high in zip(points, below, above, strict=True):
        assert not ((part[1] < low) | (part[0] > high)).any()


def test_ends_are_rounded_outward() -> None:
    def operations(given: Sequence[Interval]) -> list[Interval | None]:
        x, y = given
        return [iv.add(x, y), iv.multiply(x, y), iv.square(x), iv.reciprocal(y)]

    x, y = np.random.default_rng(2).uniform(1.0, 3.0, (2, 500))
    below, above = Program(record(operations, 2))(np.stack([x, y]), np.stack([x, y]))
    for i in range(len(x)):
        a, b = Fraction(x[i]), Fraction(y[i])
        for exact, low, high in zip((a + b, a * b, a * a, 1 / b), below, above, strict=True):
            assert Fraction(low[i]) < exact < Fraction(high[i])
            assert high[i] - low[i] <= 4.5e-16 * float(exact) * 2.0


@pytest.mark.parametrize(
    ("mission", "name"),
    [("phobos-landing", "descent"), ("phobos-qso", "hill"), ("phobos-3d-qso", "elliptic")],
)
def test_equations_are_recorded_whole(mission: str, name: str) -> None:
    plant = build(mission, "plant", name)
    equations = system(plant, controls=True).bounded
    assert equations is not None
    scale = plant.scales.of(plant.states)
    n, k = len(scale), 3

    def rates(given: Sequence[Interval]) -> list[Interval | None]:
        y = [Bound(part) for part in given[1 : 1 + n]]
        return [one.value for one in equations.rates(Bound(given[0]), y, given[1 + n :])]

    rng = np.random.default_rng(3)
    middle = np.concatenate(
        [
            rng.uniform(0, 1e4, (1, 40)),
            scale[:, None] * rng.uniform(1, 3, (n, 40)),
            np.zeros((k, 40)),
        ]
    )
    half = 1e-3 * np.abs(middle) + 1e-9
    below, above = Program(record(rates, 1 + n + k))(middle - half, middle + half)
    parts = interpreted(rates, middle - half, middle + half)
    wide = parts[:, 1] - parts[:, 0]
    assert (np.abs(below - parts[:, 0]) <= 1e-9 * wide).all()
    assert (np.abs(above - parts[:, 1]) <= 1e-9 * wide).all()


def test_lanes_do_not_depend_on_their_neighbours() -> None:
    program = Program(record(traced(FUNCTIONS["anomaly"]), 6))
    lo, hi = some_intervals(np.random.default_rng(5), 37)
    both = np.array(program(lo, hi))
    for i in (0, 7, 8, 36):
        alone = np.array(program(lo[:, i : i + 1], hi[:, i : i + 1]))
        assert np.array_equal(alone[:, :, 0], both[:, :, i], equal_nan=True)


def test_no_lanes_are_none_and_leave_the_program_as_it_was() -> None:
    program = Program(record(traced(FUNCTIONS["sum"]), 6))
    lo, hi = some_intervals(np.random.default_rng(5), 5)
    before = np.array(program(lo, hi))
    assert program(lo[:, :0], hi[:, :0])[0].shape == (3, 0)
    assert np.array_equal(np.array(program(lo, hi)), before, equal_nan=True)


def test_what_is_unknown_stays_so_beside_a_zero() -> None:
    def of_zero(given: Sequence[Interval]) -> list[Interval | None]:
        return [iv.multiply(iv.point(0.0), given[0])]

    program = Program(record(of_zero, 1))
    for end in (np.nan, np.inf):
        low, high = program(np.array([[-end]]), np.array([[end]]))
        assert np.isnan(low[0, 0])
        assert np.isnan(high[0, 0])


def test_numbers_are_arguments_of_one_program() -> None:
    def scaled(factor: float) -> Callable[[Sequence[Interval]], list[Interval | None]]:
        return lambda given: [(Bound(given[0]) * factor + 1.25 * factor).value]

    first, second = record(scaled(3.0), 1), record(scaled(7.0), 1)
    assert first.operations == second.operations
    assert first.constants != second.constants
    lo, hi = np.array([[1.0]]), np.array([[2.0]])
    assert Program(second)(lo, hi)[0] == pytest.approx(7.0 + 8.75, rel=1e-14)


def test_what_asks_for_a_value_stays_interpreted() -> None:
    def asking(given: Sequence[Interval]) -> list[Interval | None]:
        return [iv.negate(given[0]) if np.all(given[0][0] > 0.0) else given[0]]

    function = RepeatedFunction(asking, 5)
    for _ in range(10):
        low, high = function(np.array([[1.0]]), np.array([[2.0]]))
        assert (float(low[0, 0]), float(high[0, 0])) == (-2.0, -1.0)


def test_a_function_that_is_called_often_is_compiled() -> None:
    calls = []

    def doubled(given: Sequence[Interval]) -> list[Interval | None]:
        calls.append(1)
        return [iv.add(given[0], given[0]), None]

    function = RepeatedFunction(doubled, 5)
    for _ in range(20):
        low, high = function(np.array([[1.0]]), np.array([[2.0]]))
        assert low[0] < 2.0 < low[0] + 1e-14
        assert high[0] > 4.0 > high[0] - 1e-14
        assert low[1] == high[1] == 0.0
    assert len(calls) <= 6
