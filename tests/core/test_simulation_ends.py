"""How flights end: events, limits, budgets, and what goes wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Array, Integers, Parameter, Scales, Variable
from hillsphere.simulation import Cases, Limit, Simulator, simulate
from hillsphere.symbolic import Expr, Params, constant, power

FLOOR, CEILING, GRAVITY = 10.0, 1000.0, 2.0


class Shaft:
    """A vertical fall in uniform gravity between a floor and a ceiling."""

    frame = "hill:toy"
    states = (Variable("height", 1), Variable("speed", 1, -1))
    controls = (Variable("lift", 1, -2),)
    scales = Scales(100.0, 10.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gravity", GRAVITY, "m/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] - p["gravity"])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {
            "impact": x[0] / FLOOR - 1.0,
            "escape": 1.0 - x[0] / CEILING,
            "curfew": 1.0 - t / 1e6,
        }


class Singular(Shaft):
    """A fall into a point."""

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] - power(x[0], -2.5))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


class Push:
    """The same command always."""

    def __init__(
        self, u: float, actuation: Literal["hold", "impulse"] = "hold", period_s: float = 5.0
    ) -> None:
        self.u, self.actuation, self.period_s = u, actuation, period_s

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return np.full((1, y.shape[1]), self.u), xc


class Steady:
    """The same command always, as part of the equations."""

    period_s, inputs = 5.0, 2
    measurement: Literal["held", "continuous"] = "held"
    states: tuple[Variable, ...] = ()

    def __init__(self, u: float) -> None:
        self.u = u

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(self, xc: Any, y: Any, ref: Any, t: Expr) -> tuple[Expr, ...]:
        return ()

    def control(self, xc: Any, y: Any, ref: Any, t: Expr) -> tuple[Expr, ...]:
        return (constant(self.u),)


IDLE = Push(0.0)


def fall_time(height: float, speed: float) -> float:
    return float((speed + np.sqrt(speed**2 + 2 * GRAVITY * (height - FLOOR))) / GRAVITY)


def test_impact_and_escape_are_located() -> None:
    x0 = np.array([[300.0, 900.0, 500.0, 500.0], [-3.0, 80.0, 0.0, 44.0]])
    flights = simulate(Shaft(), IDLE, Cases(x0, t0_s=100.0), 6, substeps=2, history=True)
    assert flights.status == ("impact", "escape", "impact", "completed")
    assert flights.cause == ("impact", "escape", "impact", "")
    up = (80.0 - np.sqrt(80.0**2 - 2 * GRAVITY * 100.0)) / GRAVITY
    times = [fall_time(300.0, -3.0), up, fall_time(500.0, 0.0), 30.0]
    assert_allclose(flights.time_s, 100.0 + np.array(times), rtol=0, atol=1e-12)
    assert_allclose(flights.x[0, :3], [FLOOR, CEILING, FLOOR], rtol=1e-13)
    assert_allclose(flights.x[1], x0[1] - GRAVITY * (flights.time_s - 100.0), rtol=1e-12)
    assert_array_equal(flights.samples, [4, 1, 5, 6])
    assert flights.history is not None
    ended = np.isnan(flights.history.x[0])
    assert_array_equal(ended.sum(axis=0), [3, 6, 2, 0])
    assert flights.counts() == {"completed": 1, "impact": 2, "escape": 1}


def test_the_earlier_of_two_ends_counts() -> None:
    limits = [
        Limit("slow", lambda t, x, cases: x[1] + 12.0),
        Limit("high", lambda t, x, cases: x[0] - 250.0, "escape"),
    ]
    flights = simulate(Shaft(), IDLE, Cases([[300.0], [-3.0]]), 4, limits=limits)
    # −12 m/s after 4.5 s; 250 m after 5.73 s: in different samples, then in one.
    assert flights.status == ("constraint",)
    assert flights.cause == ("slow",)
    assert_allclose(flights.time_s, 4.5, rtol=1e-13)
    once = simulate(Shaft(), Push(0.0, period_s=20.0), Cases([[300.0], [-3.0]]), 1, limits=limits)
    assert once.cause == ("slow",)
    assert_allclose(once.time_s, 4.5, rtol=1e-13)


def test_limits_differ_by_number_of_case() -> None:
    lowest = np.array([100.0, 200.0, 250.0])

    def height(t: Array, x: Array, cases: Integers) -> Array:
        return np.asarray(x[0] - lowest[cases])

    cases = Cases(np.array([[300.0, 300.0], [0.0, 0.0]]), numbers=[2, 0])
    flights = simulate(Shaft(), IDLE, cases, 10, limits=[Limit("height", height)])
    assert flights.status == ("constraint", "constraint")
    assert_allclose(flights.x[0], [250.0, 100.0], rtol=1e-12)


def test_any_other_event_of_the_plant_is_a_constraint() -> None:
    cases = Cases([[500.0], [0.0]], t0_s=1e6 - 7.0)
    flights = simulate(Shaft(), IDLE, cases, 4)
    assert (flights.status, flights.cause) == (("constraint",), ("curfew",))
    assert_allclose(flights.time_s, 1e6, rtol=1e-15)


def test_a_start_beyond_an_end_is_that_end() -> None:
    x0 = np.array([[5.0, 2000.0, FLOOR, FLOOR], [0.0, 0.0, 20.0, -1.0]])
    flights = simulate(Shaft(), IDLE, Cases(x0), 3, history=True)
    # On the floor itself: upwards it flies, downwards it has landed.
    assert flights.status == ("impact", "escape", "completed", "impact")
    assert_array_equal(flights.time_s, [0.0, 0.0, 15.0, 0.0])
    assert_array_equal(flights.x[:, [0, 1, 3]], x0[:, [0, 1, 3]])
    assert_array_equal(flights.samples, [0, 0, 3, 1])


def test_divergence_keeps_the_last_finite_state() -> None:
    x0 = np.array([[1.0, 1e3, np.nan], [-1.0, 0.0, 0.0]])
    flights = simulate(Singular(), Push(0.0, period_s=1.0), Cases(x0), 40, substeps=4)
    assert flights.status == ("diverged", "completed", "diverged")
    assert flights.cause == ("state not finite", "", "state not finite")
    assert np.isfinite(flights.x[:, :2]).all()
    assert np.isfinite(flights.time_s).all()
    assert 0.25 <= flights.time_s[0] < 1.0
    assert flights.time_s[2] == 0.0


def test_a_command_that_is_not_finite_ends_its_flight_only() -> None:
    class Faulty(Push):
        def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
            u = np.zeros((1, y.shape[1]))
            u[0, (y[0] > 550.0) & (k == 2)] = np.inf
            return u, xc

    flights = simulate(Shaft(), Faulty(0.0), Cases([[500.0, 400.0], [20.0, 20.0]]), 4)
    assert flights.status == ("diverged", "completed")
    assert flights.cause == ("command not finite", "")
    assert_array_equal(flights.time_s, [10.0, 20.0])
    assert flights.dv_m_s[0] == 0.0


@pytest.mark.parametrize("law", [Push(2.5), Steady(2.5)])
def test_propellant_runs_out_in_time(law: Push | Steady) -> None:
    x0 = np.array([[500.0, 500.0], [0.0, 0.0]])
    flights = simulate(Shaft(), law, Cases(x0, dv_budget_m_s=[32.0, 60.0]), 4, history=True)
    assert flights.status == ("propellant", "completed")
    assert flights.cause == ("dv_budget", "")
    assert_allclose(flights.time_s, [32.0 / 2.5, 20.0], rtol=1e-13)
    assert_allclose(flights.dv_m_s, [32.0, 50.0], rtol=1e-13)
    assert_allclose(flights.x[1], 0.5 * flights.time_s, rtol=1e-12)
    assert_array_equal(flights.samples, [3, 4])


def test_an_impulse_beyond_the_budget_is_not_done() -> None:
    x0 = np.array([[500.0, 500.0], [0.0, 0.0]])
    law = Push(10.0, "impulse")
    flights = simulate(Shaft(), law, Cases(x0, dv_budget_m_s=[35.0, 40.0]), 4)
    assert flights.status == ("propellant", "completed")
    assert_array_equal(flights.dv_m_s, [30.0, 40.0])
    assert_array_equal(flights.firings, [3, 4])
    assert_array_equal(flights.time_s, [15.0, 20.0])
    assert_allclose(flights.x[1], [0.0, 0.0], rtol=0, atol=1e-12)


def test_a_tolerance_takes_the_steps_it_needs_lane_by_lane() -> None:
    # Away from a singularity, one from close by.
    x0 = np.array([[1.0, 50.0], [2.0, 1.0]])
    law = Push(0.3, period_s=10.0)
    fine = simulate(Singular(), law, Cases(x0), 2, substeps=4096)
    checked = simulate(
        Singular(), law, Cases(x0), 2, substeps=2, tolerance=1e-11, most_substeps=2048
    )
    rough = simulate(Singular(), law, Cases(x0), 2, substeps=2)
    assert checked.status == ("completed", "completed")
    assert_allclose(checked.x, fine.x, rtol=1e-9)
    assert abs(rough.x[0, 0] / fine.x[0, 0] - 1.0) > 1e-6


def test_steps_that_do_not_suffice_end_the_flight() -> None:
    x0 = np.array([[1.0, 50.0], [2.0, 1.0]])
    law = Push(0.3, period_s=10.0)
    flights = simulate(Singular(), law, Cases(x0), 2, substeps=2, tolerance=1e-11, most_substeps=8)
    assert flights.status == ("step_size", "completed")
    assert flights.time_s[0] == 0.0
    assert_array_equal(flights.x[:, 0], x0[:, 0])


def test_events_are_located_with_a_tolerance_too() -> None:
    x0 = np.array([[300.0, 900.0], [-3.0, 80.0]])
    flights = simulate(Shaft(), IDLE, Cases(x0), 6, tolerance=1e-12)
    assert flights.status == ("impact", "escape")
    assert_allclose(flights.time_s[0], fall_time(300.0, -3.0), rtol=1e-13)


def test_a_block_that_takes_too_long_is_stopped() -> None:
    loop = Simulator(Shaft(), IDLE, wall_limit_s=1e-9)
    flights = loop.fly(Cases([[500.0], [0.0]]), 3)
    assert flights.status == ("time_limit",)
    assert flights.time_s[0] == 0.0


def test_an_interruption_comes_through() -> None:
    def stopped(count: int) -> None:
        raise Interrupted("the run was asked to stop")

    with pytest.raises(Interrupted):
        simulate(Shaft(), IDLE, Cases([[500.0], [0.0]]), 3, advance=stopped)


def test_a_limit_of_the_wrong_shape_is_refused() -> None:
    bad = Limit("bad", lambda t, x, cases: x)
    with pytest.raises(InputError, match="limit 'bad' must return"):
        simulate(Shaft(), IDLE, Cases([[500.0], [0.0]]), 3, limits=[bad])
    with pytest.raises(InputError, match="status must be one of"):
        Limit("bad", lambda t, x, cases: t, "lost")


def test_a_lane_that_ended_disturbs_no_other() -> None:
    x0 = np.array([[300.0, 500.0], [-3.0, 44.0]])
    alone = simulate(Shaft(), IDLE, Cases(x0[:, 1:]), 6)
    beside = simulate(Shaft(), IDLE, Cases(x0), 6)
    assert beside.status == ("impact", "completed")
    assert_array_equal(alone.x[:, 0], beside.x[:, 1])


def test_what_a_tolerance_leaves_in_doubt_is_each_lanes_own() -> None:
    """Of the first only the middle of the sample is close to the limit, of the other both ends."""

    def below(t: Array, x: Array, cases: Integers) -> Array:
        return np.asarray((900.0 - x[0]) / CEILING)

    x0 = np.array([[750.0, 820.0], [20.0, 1.0]])
    for which in ([0], [0, 1], [1, 0]):
        flights = simulate(
            Shaft(), Push(0.0, period_s=20.0), Cases(x0[:, which]), 1,
            limits=[Limit("roof", below)], tolerance=1e-6,
        )  # fmt: skip
        assert set(flights.status) == {"unresolved"}


@pytest.mark.parametrize("substeps", [1, 4])
def test_what_comes_close_beyond_the_end_of_a_flight_is_not_in_doubt(substeps: int) -> None:
    def deep(t: Array, x: Array, cases: Integers) -> Array:
        return np.asarray((500.0 + x[0]) / CEILING)

    # The first ends by the floor long before it would be deep; the other is close to its limit.
    x0 = np.array([[60.0, 60.0], [-20.0, -20.0]])

    def low(t: Array, x: Array, cases: Integers) -> Array:
        return np.where(cases == 1, 0.05, 0.5) + 0.0 * t

    flights = simulate(
        Shaft(), Push(0.0, period_s=20.0), Cases(x0), 1,
        limits=[Limit("deep", deep), Limit("low", low)], substeps=substeps,
    )  # fmt: skip
    assert flights.status == ("impact", "unresolved")
    assert flights.cause == ("impact", "low")
