"""The Taylor propagator against exact solutions and against the step map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from hillsphere.cli.self_test import KeplerPlant, kepler_state
from hillsphere.dynamics import Flight, StepMap, Taylor, system
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, cos, dot, exp, greater, norm, select, sin

Watched = Mapping[str, Callable[[tuple[Expr, ...], Expr], Expr]]


@dataclass(frozen=True)
class Oscillator:
    """ẍ = −k x + push, with events."""

    watched: Watched = field(
        default_factory=lambda: {
            "ground": lambda x, t: x[0] + 0.5,
            "late": lambda x, t: 1.25 - t,
            "zero": lambda x, t: x[0],
        }
    )
    frame = "inertial"
    states = (Variable("x", 1), Variable("v", 1, -1))
    controls = (Variable("push", 1, -2),)
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", 4.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], -p["k"] * x[0] + u[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {name: function(x, t) for name, function in self.watched.items()}


@dataclass(frozen=True)
class Scalar:
    """One equation ẋ = f(x, t)."""

    law: Callable[[Expr, Expr], Expr]
    frame = "inertial"
    states = (Variable("x"),)
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (self.law(x[0], t),)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


ECCENTRICITIES = (0.0, 0.2, 0.5, 0.7, 0.9, 0.35, 0.05)


@pytest.mark.parametrize("lanes", [1, 3, 4, 7])
def test_kepler_closed_form_for_any_number_of_lanes(lanes: int) -> None:
    e = ECCENTRICITIES[-lanes:]
    times = np.linspace(-5.0, 9.0, lanes)
    x0 = np.array([kepler_state(0.0, each) for each in e]).T
    found = Taylor(system(KeplerPlant())).propagate(x0, times)
    exact = np.array([kepler_state(t, each) for t, each in zip(times, e, strict=True)]).T
    np.testing.assert_allclose(found, exact, rtol=0, atol=5e-13)  # measured 1e-13, at e = 0.9


def test_tolerance_is_kept() -> None:
    x0, exact = kepler_state(0.0, 0.5), kepler_state(20.0, 0.5)
    errors = [
        np.abs(Taylor(system(KeplerPlant()), tol).propagate(x0, 20.0) - exact).max()
        for tol in (1e-5, 1e-9, 1e-15)
    ]
    assert errors[2] < 2e-13 < errors[1] < 1e-6 < errors[0] < 1e-2


def test_taylor_agrees_with_the_step_map_on_states_and_stm() -> None:
    s = system(KeplerPlant())
    x0 = np.array([kepler_state(0.3, e) for e in (0.1, 0.3, 0.5, 0.2, 0.4)]).T
    x0[2] += 0.1
    times = np.array([3.0, -2.0, 5.0, 6.0, 1.0])
    a, phi_a = Taylor(s, stm=True).propagate(x0, times)
    b, phi_b = StepMap(s, stm=True).propagate(x0, times, 800)
    np.testing.assert_allclose(a, b, rtol=0, atol=2e-13)
    np.testing.assert_allclose(phi_a, phi_b, rtol=0, atol=3e-12)
    np.testing.assert_allclose(np.linalg.det(phi_a.transpose(2, 0, 1)), 1.0, rtol=1e-12)


def test_time_dependent_equation() -> None:
    # ẋ = x cos t − sin 2t e^{sin t} has x = (c + cos²t) e^{sin t}.
    law = Scalar(lambda x, t: x * cos(t) - sin(2.0 * t) * exp(sin(t)))
    t0 = np.array([0.0, 0.4, 2.0])
    x0 = (1.0 + np.cos(t0) ** 2) * np.exp(np.sin(t0))
    found = Taylor(system(law)).propagate(x0[None], 3.0, t0=t0)[0]
    end = t0 + 3.0
    np.testing.assert_allclose(found, (1.0 + np.cos(end) ** 2) * np.exp(np.sin(end)), rtol=6e-15)


def test_run_time_parameters_and_their_derivatives() -> None:
    s = system(Oscillator(), run_time=["k"], controls=True)
    k, push = np.array([4.0, 9.0, 1.0]), np.array([0.0, 0.7, -0.7])
    x0 = np.array([[1.0, 0.5, 1.0], [0.5, 0.5, -1.0]])
    taylor = Taylor(s, stm=True, parameters=["k", "u:push"])
    x, phi = taylor.propagate(x0, 1.3, [k, push])
    w, still = np.sqrt(k), push / k
    exact = still + (x0[0] - still) * np.cos(1.3 * w) + x0[1] / w * np.sin(1.3 * w)
    np.testing.assert_allclose(x[0], exact, rtol=1e-14, atol=1e-15)
    y, phi_map = StepMap(s, stm=True, parameters=["k", "u:push"]).propagate(x0, 1.3, 100, [k, push])
    assert phi.shape == (2, 4, 3)
    np.testing.assert_allclose(phi, phi_map, rtol=0, atol=1e-14)
    np.testing.assert_allclose(x, y, rtol=0, atol=1e-14)
    plain = Taylor(system(Oscillator())).propagate(x0[:, :1], 1.3)
    np.testing.assert_allclose(plain[:, 0], x[:, 0], rtol=1e-14)


def test_dense_output_against_the_closed_form() -> None:
    taylor = Taylor(system(KeplerPlant()))
    e = (0.1, 0.5, 0.7, 0.3, 0.6)
    x0 = np.array([kepler_state(0.0, each) for each in e]).T
    for times in (np.linspace(0.0, 7.0, 29), np.array([0.1, 0.1, 5.0]), -np.linspace(0.5, 3.0, 7)):
        found = taylor.sample(x0, times + 11.0, t0=11.0)
        assert found.shape == (6, len(times), 5)
        exact = np.array([[kepler_state(t, each) for each in e] for t in times])
        np.testing.assert_allclose(found, exact.transpose(2, 0, 1), rtol=0, atol=5e-13)
    alone = taylor.sample(x0[:, 0], [0.0, 1.0])
    assert alone.shape == (6, 2)
    np.testing.assert_array_equal(alone[:, 0], x0[:, 0])
    np.testing.assert_array_equal(taylor.sample(x0, [0.0])[:, 0], x0)


def ground_time(a: float) -> float:
    return float(np.arccos(-0.5 / a) / 2)


@pytest.mark.parametrize("lanes", [1, 2, 5, 9])
def test_terminal_events_end_each_lane_alone(lanes: int) -> None:
    a = np.array([1.0, 0.4, 2.0, 0.45, 3.0, 0.75, 0.3, 5.0, 0.6])[:lanes]
    flight = Taylor(system(Oscillator()), events=["ground"]).fly([a, np.zeros(lanes)], 7.0)
    for i, each in enumerate(a):
        if each > 0.5:
            assert flight.ended_by[i] == "ground"
            t = ground_time(each)
        else:
            assert flight.ended_by[i] is None
            t = 7.0
        assert flight.time[i] == pytest.approx(t, abs=2e-14)
        expected = [each * np.cos(2 * t), -2 * each * np.sin(2 * t)]
        np.testing.assert_allclose(flight.x[:, i], expected, rtol=0, atol=2e-14)


def test_the_first_of_several_events_ends_the_flight() -> None:
    taylor = Taylor(system(Oscillator()), events=["late", "ground"])
    flight = taylor.fly([[0.501, 3.0], [0.0, 0.0]], 7.0)
    # acos(−1/2a)/2 is 1.54 for a = 0.501, 0.87 for a = 3.
    assert flight.ended_by == ("late", "ground")
    np.testing.assert_allclose(flight.time, [1.25, ground_time(3.0)], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(taylor.propagate([[0.501, 3.0], [0.0, 0.0]], 7.0), flight.x)


def test_events_fall_along_the_flight_in_either_direction() -> None:
    # x = cos 2t rises through zero at −π/4 on the clock, which is a fall for who goes backwards.
    taylor = Taylor(system(Oscillator()), events=["zero"])
    flight = taylor.fly([[1.0, 1.0, -1.0], [0.0, 0.0, 0.0]], [9.0, -9.0, -9.0], t0=[0.0, 5.0, 0.0])
    assert flight.ended_by == ("zero", "zero", "zero")
    np.testing.assert_allclose(flight.time, [pi / 4, 5.0 - pi / 4, -3 * pi / 4], rtol=0, atol=2e-15)


def test_events_with_the_stm() -> None:
    s = system(Oscillator())
    flight = Taylor(s, stm=True, events=["ground"]).fly([1.0, 0.0], 7.0)
    t = ground_time(1.0)
    assert flight.phi is not None
    expected = [[np.cos(2 * t), np.sin(2 * t) / 2], [-2 * np.sin(2 * t), np.cos(2 * t)]]
    np.testing.assert_allclose(flight.phi, expected, rtol=0, atol=3e-15)
    assert flight.x.shape == (2,)
    assert float(flight.time) == pytest.approx(t, abs=1e-14)
    located = StepMap(s).locate("ground", [1.0, 0.0], 7.0, 300)
    assert float(located.time) == pytest.approx(t, abs=1e-12)


@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_recorded_events_of_every_lane(lanes: int) -> None:
    s = system(Oscillator())
    taylor = Taylor(s, events=["ground"], record={"top": s.x[1], "zero": s.x[0]})
    a = np.array([0.4, 2.0, 0.3])[:lanes]
    flight: Flight = taylor.fly([a, np.zeros(lanes)], 5.0, t0=1.0)
    for i, each in enumerate(a):
        end = 5.0 if each < 0.5 else ground_time(each)
        for name, phase in (("top", 0.0), ("zero", pi / 4)):
            exact = np.arange(0 if phase else 1, 9) * pi / 2 + phase
            exact = exact[exact < end]
            times, states = flight.crossings[name][i]
            np.testing.assert_allclose(times, exact + 1.0, rtol=0, atol=7e-15)
            np.testing.assert_allclose(states[0], each * np.cos(2 * exact), rtol=0, atol=3e-15)
            np.testing.assert_allclose(states[1], -2 * each * np.sin(2 * exact), rtol=0, atol=6e-15)


def test_recording_by_name_and_a_second_flight_starts_afresh() -> None:
    taylor = Taylor(system(Oscillator()), record=["zero"])
    for _ in range(2):
        times, states = taylor.fly([1.0, 0.0], 2.0).crossings["zero"][0]
        np.testing.assert_allclose(times, [pi / 4], rtol=0, atol=2e-15)
        assert states.shape == (2, 1)
    assert taylor.fly([1.0, 0.0], 0.1).crossings["zero"][0][1].shape == (2, 0)


def test_periapsis_as_an_event_of_the_two_body_problem() -> None:
    s = system(KeplerPlant())
    taylor = Taylor(s, record={"apsis": dot(s.x[:3], s.x[3:]), "far": norm(s.x[:3]) - 1.0})
    x0 = np.array([kepler_state(1.0, e) for e in (0.2, 0.5, 0.8)]).T
    flight = taylor.fly(x0, 6.0, t0=1.0)
    for i, e in enumerate((0.2, 0.5, 0.8)):
        np.testing.assert_allclose(
            flight.crossings["apsis"][i][0], [pi, 2 * pi], rtol=0, atol=8e-14
        )
        # r = a where E = ±π/2: t = π/2 − e, by Kepler's equation.
        far = [pi / 2 - e, 3 * pi / 2 + e]
        expected = [t for t in far if t > 1.0]
        np.testing.assert_allclose(flight.crossings["far"][i][0], expected, rtol=0, atol=8e-14)


def test_blow_up_is_named_and_spares_the_other_lanes() -> None:
    # ẋ = x² from x0 is infinite at 1/x0.
    taylor = Taylor(system(Scalar(lambda x, t: x * x)))
    x0 = np.array([[0.1, 5.0, 0.2, 0.3, 7.0]])
    with pytest.raises(PropagationError, match=r"lanes 1, 4 \(of 5\) turned non-finite \(Taylor"):
        taylor.propagate(x0, 3.0)
    flight = taylor.fly(x0, 3.0, strict=False)
    assert np.isnan(flight.x[0]).tolist() == [False, True, False, False, True]
    kept = [0, 2, 3]
    np.testing.assert_allclose(flight.x[0, kept], x0[0, kept] / (1 - 3 * x0[0, kept]), rtol=2e-14)
    with pytest.raises(PropagationError, match=r"lanes 1, 4 \(of 5\)"):
        taylor.sample(x0, [1.0, 3.0])


def test_lanes_of_no_duration_stay() -> None:
    x0 = np.array([kepler_state(0.0, e) for e in (0.1, 0.5)]).T
    found = Taylor(system(KeplerPlant())).propagate(x0, [0.0, 2.0])
    np.testing.assert_array_equal(found[:, 0], x0[:, 0])
    np.testing.assert_allclose(found[:, 1], kepler_state(2.0, 0.5), rtol=0, atol=1e-14)


def test_compact_mode_flies_the_same() -> None:
    x0 = kepler_state(0.0, 0.5)
    a, b = (Taylor(system(KeplerPlant()), compact=c).propagate(x0, 9.0) for c in (False, True))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("t0", [0.0, 7.3])
def test_zero_at_the_start_is_not_a_crossing(sense: float, t0: float) -> None:
    s = system(Oscillator())
    taylor = Taylor(s, record={"zero": s.x[0]})
    # x = sin 2t and, 1e-9 before its zero, sin(2t − 2e-9).
    x0 = np.array([[0.0, -np.sin(sense * 2e-9)], [2.0, 2.0 * np.cos(2e-9)]])
    crossings = taylor.fly(x0, sense * 2.0, t0=t0).crossings["zero"]
    at_zero, before = ((times - t0) * sense for times, _ in crossings)
    np.testing.assert_allclose(at_zero, [pi / 2], rtol=0, atol=5e-15)
    np.testing.assert_allclose(before, [1e-9, pi / 2 + 1e-9], rtol=0, atol=5e-15)


@dataclass(frozen=True)
class Valley:
    """ẍ = −g above the floor and g below it: parabolas, in closed form."""

    frame = "inertial"
    states = (Variable("x", 1), Variable("v", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(2.0, 0.5)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("floor", 0.0, "m"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], select(greater(x[0], p["floor"]), -1.0, 1.0))

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        return (x[0] - p["floor"],)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"ceiling": 3.0 - x[0], "late": 4.0 - t, "floor": x[0] - p["floor"]}


def valley(t: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
    """State in the valley t after rest at a height over its floor, (2, N)."""
    quarter = np.sqrt(2.0 * height)
    count, rest = np.divmod(t + quarter, 2.0 * quarter)
    since = rest - quarter  # after the last top or bottom
    side = np.where(count % 2 == 0, 1.0, -1.0)
    return np.asarray([side * (height - 0.5 * since**2), -side * since])


@pytest.mark.parametrize("lanes", [1, 3, 6])
@pytest.mark.parametrize("normalised", [False, True])
def test_a_new_series_begins_at_each_switch(lanes: int, normalised: bool) -> None:
    s = system(Valley(), run_time=["floor"], normalised=normalised)
    unit, second = s.unit[:, None], s.time_unit_s
    height = np.array([0.5, 1.3, 0.2, 2.0, 0.9, 0.4])[:lanes]
    floor = np.array([0.0, -0.4, 3.0, 0.1, 0.0, 0.0])[:lanes]
    lift = np.array([floor, np.zeros(lanes)])
    x0 = (np.array([height, np.zeros(lanes)]) + lift) / unit
    for duration in (7.0, -7.0):
        exact = (
            valley(np.full(lanes, abs(duration)), height) * [[1.0], [np.sign(duration)]]
        ) + lift
        found = Taylor(s).propagate(x0, duration / second, [floor]) * unit
        # The acceleration jumps: each crossing costs twice the hair, 2e-12, in energy, which
        # shifts all that follow. Measured 1.2e-10 after six crossings at half the speed.
        np.testing.assert_allclose(found, exact, rtol=0, atol=4e-10)
        blind = Taylor(replace(s, switches=())).propagate(x0, duration / second, [floor]) * unit
        assert np.abs(blind - exact).max(axis=0).min() > 0.1
    taylor = Taylor(s, record={"floor": s.events["floor"]})
    flight = taylor.fly(x0, 7.0 / second, [floor])
    assert flight.ended_by == (None,) * lanes
    for i, quarter in enumerate(np.sqrt(2.0 * height)):
        expected = np.arange(quarter, 7.0, 2.0 * quarter)
        np.testing.assert_allclose(
            flight.crossings["floor"][i][0] * second, expected, rtol=0, atol=4e-10
        )
    grid = np.linspace(0.0, 7.0, 12)
    sampled = Taylor(s).sample(x0, grid / second, [floor])
    for k, t in enumerate(grid):
        exact = valley(np.full(lanes, t), height) + lift
        np.testing.assert_allclose(sampled[:, k] * unit, exact, rtol=0, atol=4e-10)


def test_switches_leave_the_ends_of_flights_alone() -> None:
    s = system(Valley())
    taylor = Taylor(s, events=["ceiling", "late", "floor"])
    # Down from rest; up from just under the floor to the ceiling; up from there and back to it.
    x0 = np.array([[0.5, -1e-9, -0.5, 2.0, 0.0], [0.0, 4.0, 1.1, 2.0, 1.0]])
    flight = taylor.fly(x0, 9.0)
    assert flight.ended_by == ("floor", "ceiling", "floor", "ceiling", "floor")
    # From x below the floor the fall is upwards: v grows.
    fast = np.sqrt(1.1**2 + 1.0)
    exact = [1.0, 4.0 - np.sqrt(10.0), 3.0 * fast - 1.1, 2.0 - np.sqrt(2.0), 2.0]
    np.testing.assert_allclose(flight.time, exact, rtol=0, atol=2e-9)
    assert Taylor(s, events=["ceiling", "late"]).fly(x0[:, 0], 9.0).ended_by == ("late",)


@pytest.mark.parametrize("stm", [False, True])
def test_no_lanes_give_empty_results(stm: bool) -> None:
    s = system(Oscillator(), run_time=["k"])
    taylor = Taylor(s, stm=stm, record=["zero"])
    flight = taylor.fly(np.zeros((2, 0)), np.zeros(0), [4.0])
    assert (flight.x.shape, flight.time.shape, flight.ended_by) == ((2, 0), (0,), ())
    assert (None if flight.phi is None else flight.phi.shape) == ((2, 2, 0) if stm else None)
    assert dict(flight.crossings) == {"zero": ()}
    assert taylor.sample(np.zeros((2, 0)), [0.5, 1.0, 1.0]).shape == (2, 3, 0)
    assert taylor.sample(np.zeros((2, 3)), []).shape == (2, 0, 3)


def test_bad_input() -> None:
    s = system(Oscillator(), run_time=["k"])
    with pytest.raises(InputError, match=r"tol must be in \[1e-16, 0.001\], got 0.5"):
        Taylor(s, 0.5)
    with pytest.raises(InputError, match="no event 'impact'; the system has: ground, late, zero"):
        Taylor(s, events=["impact"])
    with pytest.raises(InputError, match="no event 'top'"):
        Taylor(s, record=["top"])
    with pytest.raises(InputError, match="give stm=True"):
        Taylor(s, parameters=["k"])
    taylor = Taylor(s)
    with pytest.raises(InputError, match=r"x must be \(2,\)"):
        taylor.propagate(np.zeros(3), 1.0)
    with pytest.raises(InputError, match="lead away from t0"):
        taylor.sample([1.0, 0.0], [1.0, 0.5])
    with pytest.raises(InputError, match="lead away from t0"):
        taylor.sample([1.0, 0.0], [-1.0, 0.5])
    with pytest.raises(InputError, match="no events to end a flight"):
        Taylor(s, events=["zero"]).sample([1.0, 0.0], [1.0])
