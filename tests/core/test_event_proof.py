"""Events between the ends of steps: proved, found, or said not to be decided."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere import create
from hillsphere.dynamics import StepMap, Taylor, system
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.enclosures import enclose
from hillsphere.engine.simulation.regions import Boxes, Columns, Regions, Store
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.simulation import Cases, Limit, simulate
from hillsphere.symbolic import atan2, cos, exp, power, sin, sqrt

from .test_simulation_ends import CEILING, GRAVITY, Push, Shaft, Steady


def fly(x0: Array, period_s: float, **options: object) -> object:
    return simulate(Shaft(), Push(0.0, period_s=period_s), Cases(x0), 1, **options)


class Coast:
    """No command."""

    actuation: Literal["hold", "impulse"] = "hold"
    period_s = 60.0

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return np.zeros((3, y.shape[1])), xc


def grazing(number: int, seed: int) -> tuple[Array, Array]:
    """Return throws whose tops are within 1 mm to 100 m of the ceiling, and their excess."""
    rng = np.random.default_rng(seed)
    excess = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-3.0, 2.0, number)
    rise = rng.uniform(5.0, 40.0, number)
    below = 0.5 * rise**2 / GRAVITY
    return np.array([CEILING + excess - below, rise]), excess


@pytest.mark.parametrize("law", ["held", "continuous"])
def test_grazing_throws_are_all_decided(law: str) -> None:
    """Top v²/2g above the start: over the ceiling the flight ends when it first meets it."""
    x0, _excess = grazing(1000, 7)
    x0 = x0[:, (x0[0] > 20.0) & (x0[0] < CEILING)]
    top = x0[0] + 0.5 * x0[1] ** 2 / GRAVITY - CEILING
    assert x0.shape[1] > 900
    if law == "held":
        flights = simulate(Shaft(), Push(0.0, period_s=40.0), Cases(x0), 1)
    else:
        steady = Steady(0.0)
        steady.period_s = 40.0
        flights = simulate(Shaft(), steady, Cases(x0), 1)
    status = np.array(flights.status)
    assert_array_equal(status[top > 0] == "escape", True)  # none missed
    assert not (status[top < 0] == "escape").any()
    assert np.mean(status == "unresolved") <= 0.05
    rest = np.maximum(x0[1] ** 2 - 2.0 * GRAVITY * (CEILING - x0[0]), 0.0)
    first = (x0[1] - np.sqrt(rest)) / GRAVITY
    assert_allclose(flights.time_s[top > 0], first[top > 0], rtol=0, atol=1e-6)


def test_a_flight_under_the_surface_between_samples_is_an_impact() -> None:
    """50 m/s along a chord that is under the surface for 14 s, in one step of 60 s."""
    gravity = create("gravity", "point_mass", gm_m3_s2=7.0875e5)
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0,
        semi_axes_km=[13.03, 11.40, 9.14],
    )  # fmt: skip
    plant = create("plant", "hill", body=body, gravity=gravity)
    x0 = np.array([[13005.0], [-1500.0], [0.0], [0.0], [50.0], [0.0]])
    flights = simulate(plant, Coast(), Cases(x0), 5)
    fine = simulate(plant, Coast(), Cases(x0), 5, substeps=600)
    assert flights.status == fine.status == ("impact",)
    assert_allclose(flights.time_s, fine.time_s, rtol=0, atol=1e-6)
    found = StepMap(system(plant)).locate("impact", x0, 300.0, 5)
    assert found.found.all()
    assert found.resolved.all()
    assert_allclose(found.time, fine.time_s, rtol=0, atol=1e-6)
    by_series = Taylor(system(plant), events=["impact"]).fly(x0, 300.0)
    assert_allclose(by_series.time, fine.time_s, rtol=0, atol=1e-6)


def test_two_roots_in_one_step_are_located_in_either_direction() -> None:
    """From 900 m at 30 m/s the ceiling is met at t = (30 ± √(30² − 2 g 100))/g."""
    flow = StepMap(system(Shaft()))
    root = np.sqrt(30.0**2 - 2.0 * GRAVITY * 100.0)
    times = (30.0 - root) / GRAVITY, (30.0 + root) / GRAVITY
    for event, direction, expected in (
        ("escape", -1, times[0]), ("escape", 1, times[1]), ("escape", 0, times[0])
    ):  # fmt: skip
        found = flow.locate(event, [900.0, 30.0], 29.0, 1, direction=direction)  # type: ignore[arg-type]
        assert found.found
        assert found.resolved
        assert_allclose(found.time, expected, rtol=1e-12)
    found = flow.locate(flow.system.x[0] - 1000.0, [900.0, 30.0], 29.0, 1, direction=1)
    assert found.found
    assert found.resolved
    assert_allclose(found.time, times[0], rtol=1e-12)


def test_a_limit_without_bound_is_not_resolved_near_zero() -> None:
    def gap(t: Array, x: Array, cases: Integers) -> Array:
        return np.asarray(0.05 + 0.0 * t)

    assert fly(np.array([[500.0], [0.0]]), 5.0, limits=[Limit("gap", gap)]).status == (  # type: ignore[attr-defined]
        "unresolved",
    )
    bounded = Limit("gap", gap, lipschitz=[0.0, 0.0])
    assert fly(np.array([[500.0], [0.0]]), 5.0, limits=[bounded]).status == ("completed",)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("bound", "message"),
    [
        ({"lipschitz": [1e-3]}, "one number for each of the 2 states"),
        ({"lipschitz": [1e-3, 0.0, 0.0]}, "one number for each of the 2 states"),
        ({"lipschitz": [-1e-3, 0.0]}, "a number ≥ 0 for each state"),
        ({"lipschitz": [np.nan, 0.0]}, "a number ≥ 0 for each state"),
        ({"lipschitz": 1e-3}, "a number ≥ 0 for each state"),
        ({"lipschitz": [0.0, 0.0], "drift": -1.0}, "drift and margin"),
        ({"margin": -1.0}, "drift and margin"),
    ],
)
def test_a_bound_that_bounds_nothing_is_refused(bound: dict[str, Any], message: str) -> None:
    """A negative slope once let a flight complete through a roof."""

    def fly_under_roof() -> None:
        limit = Limit("roof", lambda t, x, cases: 900.0 - x[0], **bound)
        fly(np.array([[850.0], [20.0]]), 20.0, limits=[limit])

    with pytest.raises(InputError, match=message):
        fly_under_roof()


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
@settings(max_examples=200, deadline=None)
def test_bounds_contain_sampled_values(ends: list[float], s: float, t: float) -> None:
    a, b = sorted(ends[:2]), sorted(ends[2:])
    # The sum may round beyond the end.
    x, y = min(a[0] + s * (a[1] - a[0]), a[1]), min(b[0] + t * (b[1] - b[0]), b[1])
    p, q = (Bound((np.array([e[0]]), np.array([e[1]]))) for e in (a, b))
    with np.errstate(all="ignore"):
        pairs = [
            (p + q, x + y), (p - q, x - y), (p * q, x * y), (p * p, x * x),
            (sin(p), np.sin(x)), (cos(p), np.cos(x)), (exp(p), np.exp(x)),
            (sqrt(p * p + q * q), np.hypot(x, y)),
            (power(p * p + 1.0, -1.5), (x * x + 1.0) ** -1.5),
            (atan2(q, p), np.arctan2(y, x)),
        ]  # fmt: skip
    for bound, value in pairs:
        low, high = bound.value  # type: ignore[attr-defined]
        assert low <= value + 1e-15
        assert high >= value - 1e-15


def test_sine_knows_its_extremes_within_an_interval() -> None:
    low, high = iv.sin((np.array([1.0, 4.0]), np.array([2.0, 5.0])))
    assert high[0] == 1.0
    assert low[1] == -1.0


def test_an_enclosure_holds_a_dense_reference() -> None:
    flow = system(Shaft())
    y = np.array([[500.0], [3.0]])
    end = StepMap(flow).propagate(y, 10.0, 1)
    assert flow.bounded is not None
    box = enclose(flow.bounded, np.zeros(1), np.full(1, 10.0), y, np.zeros((0, 1)), end)
    path = StepMap(flow).trajectory(y, 10.0, 200)
    assert box.holds.all()
    assert (path >= box.lo[:, None]).all()
    assert (path <= box.hi[:, None]).all()


def test_step_errors_follow_the_order_of_the_formula() -> None:
    """Twice as many steps of rk6: the sum falls by about 2⁶, and is above the true error."""
    gravity = create("gravity", "point_mass", gm_m3_s2=7.0875e5)
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    plant = create("plant", "hill", body=body, gravity=gravity)
    x0 = np.array([[30e3], [0.0], [0.0], [0.0], [-10.0], [0.0]])
    exact = simulate(plant, Coast(), Cases(x0), 60, substeps=16).x
    size = plant.scales.of(plant.states)[:, None]
    errors = []
    for substeps in (1, 2):
        flights = simulate(plant, Coast(), Cases(x0), 60, method="rk6", substeps=substeps)
        true = float(np.max(np.abs(flights.x - exact) / size))
        errors.append(float(flights.step_error[0]))
        assert errors[-1] > 0.0
        if true > 1e-13:
            assert 0.1 < errors[-1] / true < 1e3
    assert errors[0] / errors[1] > 20.0


def test_a_region_of_one_column_is_none_if_its_tube_is_no_number() -> None:
    """Two states of a law, of which the second may do anything: 0 · ∞ says nothing of the first."""

    class Anything:
        def with_room(self, boxes: Boxes, once: bool = False) -> Boxes:
            return boxes

        def rates(self, boxes: Boxes) -> tuple[Array, Array]:
            most = np.array([[1.0], [np.inf]]) + np.zeros_like(boxes.lo)
            return -most, most

        def regions(self, boxes: Boxes, low: Array, high: Array) -> Regions:
            return Regions(boxes, low, high, np.zeros((4, 1, len(boxes.t_lo))), 0.0 * boxes.lo)

    store = Store(Anything(), np.array([0]), lambda h: (slice(0, 2), h * np.eye(2)))
    at, none, one = np.ones((2, 1)), np.zeros((0, 1)), np.ones(1)
    columns = Columns(
        Boxes(at, at, none, none, one, one), np.zeros(1, int), one, one, np.ones((1, 1))
    )
    with np.errstate(invalid="ignore"):
        assert (store.indices(columns) == -1).all()


def test_lanes_of_a_time_share_a_region_that_holds_long_steps() -> None:
    """An oscillator x'' = -x, in steps nearly as long as the one radian that any box can hold."""

    class Oscillator:
        def with_room(self, boxes: Boxes, once: bool = False) -> Boxes:
            # No region serves more than once: it would hold the whole orbit.
            return boxes if once else replace(boxes, hi=np.nan * boxes.hi)

        def rates(self, boxes: Boxes) -> tuple[Array, Array]:
            return (
                np.array([boxes.lo[1], -boxes.hi[0]]), np.array([boxes.hi[1], -boxes.lo[0]]),
            )  # fmt: skip

        def regions(self, boxes: Boxes, low: Array, high: Array) -> Regions:
            slopes = np.array([low[:1], high[:1], 0.0 * low[:1], 0.0 * low[:1]])
            return Regions(boxes, low, high, slopes, 0.0 * low)

    lanes, chunks, h = 16, 4, 0.7
    chunk = np.repeat(np.arange(chunks), lanes)
    phase = 1.3 * chunk + np.tile(np.linspace(0.0, 1e-3, lanes), chunks)
    y, none, when = np.array([np.cos(phase), -np.sin(phase)]), np.zeros((0, 64)), 1.0 * chunk
    step = np.full(64, h)
    columns = Columns(
        Boxes(y, y, none, none, when, when), chunk, step, step, np.full((1, 64), 10.0)
    )
    store = Store(Oscillator(), np.array([0]), None)
    index = store.indices(columns)
    assert store.decided(index, columns).all()
    assert store.kept is not None
    assert len(np.unique(index)) <= chunks
    box = store.kept.boxes.taken(index)
    for part in np.linspace(0.0, h, 6):
        flown = np.array([np.cos(phase + part), -np.sin(phase + part)])
        assert ((box.lo <= flown) & (flown <= box.hi)).all()
