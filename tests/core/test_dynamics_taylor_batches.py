"""How lanes fly together: ends beside singularities, the start's rounding, a switch's hair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi

import numpy as np
import pytest
from tests.core.test_dynamics_taylor import Oscillator, Valley

from hillsphere.cli.self_test import KeplerPlant
from hillsphere.dynamics import Taylor, system
from hillsphere.interfaces import Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, cos


@pytest.mark.parametrize(("t0", "duration"), [(0.0, 1000.0), (1000.0, -1000.0)])
def test_rounding_of_either_time_puts_no_crossing_beside_the_start(
    t0: float, duration: float
) -> None:
    """Zeros of sin 2(t − t*); up to 1e-15 of the larger time, 1e-12, from the start are none."""
    s = system(Oscillator())
    after = np.array([7e-13, 1.4e-12])
    phase = -2.0 * np.sign(duration) * after
    crossings = (
        Taylor(s, record={"zero": s.x[0]})
        .fly([np.sin(phase), 2.0 * np.cos(phase)], duration, t0=t0)
        .crossings["zero"]
    )
    firsts = [abs(times[0] - t0) for times, _ in crossings]
    np.testing.assert_allclose(firsts, [pi / 2 + 7e-13, 1.4e-12], rtol=0, atol=2e-13)
    assert [len(times) for times, _ in crossings] == [636, 637]  # 2000/π, and the one at the start


def test_dense_output_of_one_that_records_events() -> None:
    s = system(Oscillator())
    times = np.linspace(0.0, 3.0, 7)
    for x in ([1.0, 0.0], np.array([[1.0, 2.0], [0.0, 0.0]])):
        found = Taylor(s, record={"zero": s.x[0]}).sample(x, times)
        amplitude = np.atleast_1d(x[0])
        exact = np.cos(2.0 * times[:, None]) * amplitude
        np.testing.assert_allclose(found[0].reshape(exact.shape), exact, rtol=0, atol=3e-15)


@dataclass(frozen=True)
class Exploding:
    """ẋ = k x² (1 + cos ωt): with τ = t + sin(ωt)/ω, 1/x = 1/x₀ − k τ, infinite at τ = 1/(k x₀).

    ωt = 10π at t = 0.1, so that τ is t there and at its multiples; and ω asks for many steps.
    """

    omega = 100.0 * pi
    frame = "inertial"
    states = (Variable("x"),)
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", 1.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (p["k"] * x[0] * x[0] * (1.0 + cos(self.omega * t)),)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"large": 10.0 - x[0]}


@pytest.mark.parametrize("run_time", [False, True])
def test_an_end_before_a_singularity_spares_the_other_lanes(run_time: bool) -> None:
    s = system(Exploding(), run_time=["k"] if run_time else [])
    # From 5 with k = 1 or 2 the flight ends at τ = 0.1/k, and would be infinite at 0.2/k.
    k = np.array([1.0, 1.0, 1.0, 1.0, 1.0])
    x0 = np.array([5.0, -1.0, 5.0, -2.0, -1.0])
    if run_time:
        k, x0 = np.array([1.0, -1.0, 1.0, -2.0, -1.0]), np.array([5.0, 1.0, 5.0, 1.0, 1.0])
    flight = Taylor(s, events=["large"]).fly(x0[None], 10.0, [k] if run_time else None)
    assert flight.ended_by == ("large", None, "large", None, None)
    np.testing.assert_allclose(flight.time, [0.1, 10.0, 0.1, 10.0, 10.0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(flight.x[0], 1.0 / (1.0 / x0 - k * flight.time), rtol=1e-12)


def test_an_event_may_be_met_at_once_by_the_next_flight() -> None:
    # x = sin(2(1e-15 − t)): its zero is 1e-15 from the start, less than from a repeated event.
    taylor = Taylor(system(Oscillator()), events=["zero"])
    alone = taylor.fly([2e-15, -2.0], 1.0)
    assert alone.ended_by == ("zero",)
    again = taylor.fly([2e-15, -2.0], 1.0)
    assert (again.ended_by, float(again.time)) == (alone.ended_by, float(alone.time))


@pytest.mark.parametrize(("tol", "hair"), [(1e-15, 1e-12), (1e-9, 1.6e-8), (1e-4, 1.6e-3)])
def test_a_series_ends_a_hair_beyond_the_switch(tol: float, hair: float) -> None:
    """The valley's force acts a hair too far at each crossing, which adds 2 hairs to the energy."""
    s = system(Valley())
    height = np.array([0.5, 0.9, 1.3])
    x = np.array([height, np.zeros(3)])
    flight = Taylor(s, tol, record={"floor": s.events["floor"]}).fly(x, 6.5)
    crossed = np.array([len(times) for times, _ in flight.crossings["floor"]])
    assert crossed.tolist() == [3, 2, 2]  # at odd multiples of √(2 height)
    energy = 0.5 * flight.x[1] ** 2 + np.abs(flight.x[0])
    np.testing.assert_allclose((energy - height) / hair, 2.0 * crossed, rtol=0, atol=0.02)


def test_a_flight_has_the_same_bits_in_whatever_company() -> None:
    """Ends at one time of others' events, and flights of 20 to 2000 steps beside each other."""
    s = system(KeplerPlant(), normalised=True)
    rng = np.random.default_rng(5)
    speed = rng.uniform(0.03, 1.2, 41)
    x = np.zeros((len(s.x), 41))
    x[0], x[len(s.x) // 2 + 1] = 1.0, speed
    duration = rng.uniform(0.5, 40.0, 41)
    events = {"far": 1.3 - s.x[0], "axis": s.x[1] + 0.2}
    flown = replace(s, events=events)
    for names in ((), ("far", "axis")):
        taylor = Taylor(flown, events=names, record={"crossing": s.x[0]})
        together = taylor.fly(x, duration)
        assert (len({*together.ended_by} - {None}) > 0) == bool(names)
        for some in (np.arange(41)[::-1], np.arange(3, 14), np.arange(20, 23), [40, 7]):
            apart = taylor.fly(np.ascontiguousarray(x[:, some]), duration[some])
            np.testing.assert_array_equal(apart.x, together.x[:, some])
            np.testing.assert_array_equal(apart.time, together.time[some])
            for i, lane in enumerate(some):
                for one, other in zip(
                    apart.crossings["crossing"][i], together.crossings["crossing"][lane],
                    strict=True,
                ):  # fmt: skip
                    np.testing.assert_array_equal(one, other)


def test_a_lane_at_a_singularity_waits_for_no_other_to_end() -> None:
    """Flights of no duration end at once, where another lane turns non-finite at its start."""
    s = system(KeplerPlant(), normalised=True)
    x = np.zeros((len(s.x), 40))
    x[0], x[len(s.x) // 2 + 1] = 1.0, np.linspace(0.8, 1.1, 40)
    taylor, duration = Taylor(s), np.linspace(1.0, 30.0, 40)
    duration[[2, 3, 20]] = 0.0
    expected = taylor.propagate(x, duration)
    x[:, [1, 21]] = 0.0
    flown = taylor.fly(x, duration, strict=False)
    assert np.isnan(flown.x[:, [1, 21]]).all()
    others = np.setdiff1d(np.arange(40), [1, 21])
    np.testing.assert_array_equal(flown.x[:, others], expected[:, others])
