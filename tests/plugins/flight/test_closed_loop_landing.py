"""What a landing asks of ``closed_loop``: a command on a finer grid, touchdown, actuator errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.engine.course import Rows, course_along
from hillsphere.engine.surroundings import Surroundings
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults
from hillsphere.plugins import validate
from hillsphere.presentation import Arrows, Surface
from hillsphere.products import FlightSet, Trajectories
from hillsphere.symbolic import Expr, Params
from hillsphere.testing import RecordingContext, check_case_stage, check_presentation
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.specs import ClosedLoopSpec

PERIOD, KP, KD = 60.0, 1e-4, 0.012
GRID_S = 20.0


class Ground:
    """Three double integrators over a ground at z = 0."""

    frame = "toy:inertial"
    states = (
        *(Variable(n, 1) for n in ("x", "y", "z")),
        *(Variable(n, 1, -1) for n in ("vx", "vy", "vz")),
    )
    controls = tuple(Variable(n, 1, -2) for n in ("ax", "ay", "az"))
    scales = Scales(100.0, 100.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("push", 0.0, "m/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (*x[3:6], u[0], u[1], u[2] + p["push"])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": x[2]}


class Solid(Ground):
    """The same about a body with a surface, for figures."""

    body_name = "rock"
    semi_axes_m = (3000.0, 2500.0, 2000.0)
    prime_meridian_rad = 0.0
    series_radius_m = None


class Direct:
    period_s = PERIOD
    actuation = "hold"

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        gap = ref - y
        return KP * gap[:3] + KD * gap[3:], xc


class Idle(Direct):
    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return 0.0 * y[:3], xc


class Impulses(Direct):
    actuation = "impulse"


def descent(count: int = 31, seed: int = 2) -> FlightSet:
    """Return a flight under a command that is held for 20 s each, exact at the grid's times.

    It falls 0.5 m/s at the ground, at its end.
    """
    random = np.random.default_rng(seed)
    u = 1e-3 * random.normal(size=(3, count))
    u[:, -1] = 0.0
    r, v = np.zeros((3, count)), np.zeros((3, count))
    r[:, -1], v[:, -1] = [3000.0, -50.0, 0.0], [0.1, 0.0, -0.5]
    for j in range(count - 2, -1, -1):  # backwards from the ground
        v[:, j] = v[:, j + 1] - GRID_S * u[:, j]
        r[:, j] = r[:, j + 1] - GRID_S * v[:, j] - 0.5 * GRID_S**2 * u[:, j]
    assert r[2, :-1].min() > 0.0
    times: Array = GRID_S * np.arange(count, dtype=float)
    return FlightSet(
        Trajectories(
            frame="toy:inertial", states=("x", "y", "z", "vx", "vy", "vz"), plans=("down",),
            labels=("down",), t_s=times[:, None],
            x=np.concatenate([r, v])[:, :, None], controls=("ax", "ay", "az"), u=u[:, :, None],
        )
    )  # fmt: skip


def stage(plant: Any = None, law: Any = None, **keys: Any) -> ClosedLoopStage:
    table = {
        "plant": plant or Ground(), "law": law or Direct(), "needs": {"reference": "guidance"},
        "success": ["completed", "impact"], **keys,
    }  # fmt: skip
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec)


def block(names: tuple[str, ...] = (), values: Any = 0.0) -> CaseBatch:
    lanes = np.arange(LANES)
    table = np.zeros((len(names), LANES))
    table[:] = np.asarray(values, dtype=float).reshape(len(names) or 1, -1)[: len(names)]
    return CaseBatch(lanes, lanes, np.zeros(LANES, dtype=bool), names, table, 1, "campaign")


def metric(found: CaseResults, name: str) -> Array:
    return np.asarray(found.values[found.metrics.index(name)])


def test_a_command_on_a_finer_grid_is_flown_between_samples() -> None:
    product = descent()
    assert product.flights.u is not None
    found = stage().run(RecordingContext(), reference=product)
    # The reference flies itself to the ground; the law has nothing to do.
    assert_allclose(found.position_error_m[:-1], 0.0, rtol=0, atol=1e-9)
    assert_allclose(found.end_x, product.flights.x[:, -1, 0], rtol=0, atol=1e-9)
    assert_allclose(found.own, 0.0, rtol=0, atol=1e-12)
    assert_allclose(found.u, product.flights.u[:, :-1:3, 0], rtol=0, atol=1e-12)
    assert_array_equal(found.feedforward, product.flights.u[:, :-1:3, 0])
    u = product.flights.u[:, :-1, 0]
    spent = np.concatenate([[0.0], np.cumsum(GRID_S * np.linalg.norm(u, axis=0))])
    assert_allclose(found.dv_m_s[:-1], spent[:-1:3], rtol=1e-9)
    # With only the commands at the samples it would be far off.
    coarse = FlightSet(
        Trajectories(**{**vars(product.flights), "t_s": product.flights.t_s[::3],
                        "x": product.flights.x[:, ::3], "u": product.flights.u[:, ::3]})
    )  # fmt: skip
    assert stage().run(RecordingContext(), reference=coarse).position_error_m[:-1].max() > 1.0


@pytest.mark.parametrize("period", [10.0, 20.0, 45.0, 50.0, 60.0])
def test_steps_of_a_grid_and_a_period(period: float) -> None:
    product = descent(10)  # 180 s
    plant = Ground()
    course = course_along(plant, Rows(plant), product, "")
    times = np.arange(0.0, 200.0, period)
    steps = course.steps(times, period)
    assert product.flights.u is not None
    u = product.flights.u[0, :, 0]
    if period <= GRID_S:
        assert steps is None
        return
    assert steps is not None
    for begin, one in zip(times, steps, strict=True):
        edges = begin + period * np.concatenate([[0.0], np.cumsum(one.shares)])
        inside = np.arange(10) * GRID_S
        inside = inside[(inside > begin + 1e-3) & (inside < begin + period - 1e-3)]
        assert_allclose(edges, [begin, *inside, begin + period], rtol=1e-12)
        middle = 0.5 * (edges[1:] + edges[:-1])
        wanted = u[np.clip((middle // GRID_S).astype(int), 0, 9)]
        assert_array_equal(one.u[:, 0, 0], wanted)


def test_impulses_have_no_reference_with_a_command() -> None:
    with pytest.raises(InputError, match="the law commands impulses"):
        stage(law=Impulses()).run(RecordingContext(), reference=descent())


def test_metrics_of_a_touchdown() -> None:
    pushes = np.linspace(-1e-4, 1e-4, LANES)
    product = descent()
    found = stage().run_cases(block(("plant.push",), pushes), history=True, reference=product)
    units = dict(zip(found.metrics, found.units, strict=True))
    assert {name: units[name] for name in ("final_speed", "early", "largest_command")} == {
        "final_speed": "m/s",
        "early": "s",
        "largest_command": "m/s2",
    }
    touched = np.array(found.status) == "impact"
    assert 10 < touched.sum() < LANES - 10
    assert not found.failed.any()
    early = metric(found, "early")
    assert_array_equal(early[~touched], 0.0)
    assert (early[touched] > 0).all()
    assert_allclose(early + metric(found, "duration"), 600.0, rtol=1e-13)
    assert found.histories is not None
    names = found.histories.names
    whole = dict(zip(names, found.histories.values, strict=True))
    own = np.array([whole[f"law.{name}"] for name in ("ax", "ay", "az")])
    assert_allclose(
        metric(found, "largest_command"), np.sqrt(np.nanmax((own**2).sum(axis=0), axis=0)),
        rtol=1e-13,
    )  # fmt: skip
    assert_allclose(whole["command"], np.linalg.norm(own, axis=0), rtol=1e-12)
    u = np.array([whole[f"u.{name}"] for name in ("ax", "ay", "az")])
    assert product.flights.u is not None
    feed = product.flights.u[:, :-1:3]
    assert_allclose(u[:, :-1], own[:, :-1] + feed, rtol=0, atol=1e-15)
    free = ~touched
    speed = np.linalg.norm([whole[n][-1] for n in ("vx", "vy", "vz")], axis=0)
    assert_allclose(metric(found, "final_speed")[free], speed[free], rtol=1e-13)
    assert_allclose(whole["dv"][-1, free], metric(found, "dv")[free], rtol=1e-13)
    assert (np.diff(whole["dv"], axis=0)[:, free] > 0).all()
    for name, error in (("position_error", "position"), ("velocity_error", "velocity")):
        most = np.nanmax(whole[name], axis=0)
        # Over the flight: no less than at samples, and here more by up to a few parts in 10⁵.
        ratio = metric(found, f"largest_{error}_error")[free] / most[free]
        assert (ratio >= 1.0 - 1e-12).all()
        assert (ratio < 1.001).all()
    # What is asked for is kept, and nothing else.
    some = stage().run_cases(
        block(("plant.push",), pushes), history=("dv", "position_*"), reference=product
    )
    assert some.histories is not None
    assert some.histories.names == ("position_error", "dv")
    assert_array_equal(some.histories.values[1], whole["dv"])


def test_rules_of_a_landing() -> None:
    """Contact a minute early, a hard touch or a miss; a flight that floats at the end is none."""
    rules = {"early_min": 1, "touchdown_speed_m_s": 1, "final_position_error_m": 100}
    # Nobody steers: what is off at the start stays so, and grows with the velocity. The reference
    # comes down at 0.5 m/s.
    cases = {
        (0.0, 0.0, 0.0): ("", False),
        (0.0, -20.0, 0.0): ("", True),
        (0.0, -80.0, 0.0): ("early", True),
        (150.0, -80.0, 0.0): ("early", True),  # and beside the site
        (0.0, 50.0, 0.0): ("", False),
        (0.0, 200.0, 0.0): ("final_position_error", False),
        (150.0, -1.0, 0.0): ("final_position_error", True),
        (0.0, 895.0, -1.5): ("touchdown_speed", True),
        (0.0, 905.0, -1.5): ("", False),  # as fast, but it has not touched
    }
    values = np.zeros((3, LANES))
    values[:, : len(cases)] = np.array(list(cases)).T
    batch = block(("offset.x", "offset.z", "offset.vz"), values)
    plain = stage(law=Idle()).run_cases(batch, reference=descent())
    found = stage(law=Idle(), require=rules).run_cases(batch, reference=descent())
    for lane, (cause, touches) in enumerate(cases.values()):
        if lane:  # the undisturbed one ends at the ground, to the last bit of either side
            assert (plain.status[lane] == "impact") == touches
        assert found.failed[lane] == bool(cause)
        if cause:
            assert (found.status[lane], found.cause[lane]) == ("requirement", cause)
    assert_array_equal(found.values, plain.values)


def test_a_hard_touch_is_a_failure_and_a_fast_end_in_space_is_none() -> None:
    """From 30 m/s sideways nothing touches; down the same speed does."""
    keys: dict[str, Any] = {
        "needs": {}, "target": {"position_m": [0, 0, 1e6]}, "samples": 1,
        "require": {"touchdown_speed_m_s": 1.0},
    }  # fmt: skip
    start = {"position_m": [0, 0, 1e6], "velocity_m_s": [30, 0, 0]}
    away = stage(start=start, **keys).run_cases(block())
    assert metric(away, "final_speed")[0] > 1.0
    assert away.status[0] == "completed"
    assert not away.failed.any()
    low = {"position_m": [0, 0, 100], "velocity_m_s": [0, 0, -3]}
    keys["target"] = {"position_m": [0, 0, 100]}
    hit = stage(start=low, **keys).run_cases(block())
    assert (hit.status[0], hit.cause[0]) == ("requirement", "touchdown_speed")
    assert hit.failed.all()
    keys["require"] = {"final_speed_m_s": 1.0}
    assert (
        stage(start=start, **{**keys, "target": {"position_m": [0, 0, 1e6]}})
        .run_cases(block())
        .cause[0]
        == "final_speed"
    )


def test_early_counts_from_the_end_of_the_reference() -> None:
    product = descent()
    longer = stage(samples=14, success=["impact"]).run_cases(block(), reference=product)
    # The command ends with the reference, which falls on at 0.5 m/s: contact is at its end.
    assert longer.status[0] == "impact"
    assert_allclose(metric(longer, "early"), 0.0, rtol=0, atol=1e-6)
    shorter = stage(samples=6).run_cases(block(), reference=product)
    assert_array_equal(metric(shorter, "early"), 0.0)


def test_largest_command_of_an_impulsive_law() -> None:
    keys: dict[str, Any] = {
        "needs": {}, "target": {"position_m": [0, 0, 500]}, "samples": 4, "success": ["completed"],
        "start": {"position_m": [0, 3, 500]}, "law": Impulses(),
    }  # fmt: skip
    found = stage(**keys).run_cases(block(), history=True)
    assert found.units[-1] == "m/s"
    assert_allclose(metric(found, "largest_command")[0], 3.0 * KP, rtol=1e-12)
    failed = stage(**keys, require={"largest_impulse_mm_s": 0.1}).run_cases(block())
    assert failed.cause[0] == "largest_command"
    with pytest.raises(InputError, match="largest_acceleration_m_s2: the law commands impulses"):
        stage(**keys, require={"largest_acceleration_mm_s2": 1})


def test_actuator_errors_are_those_of_the_whole_command() -> None:
    product = descent()
    delta = np.random.default_rng(4).uniform(-1, 1, size=(4, LANES))
    names = (*(f"actuator.gain.a{n}" for n in "xyz"), "actuator.coupling")
    values = np.concatenate([1.0 + 0.05 * delta[:3], 0.02 * delta[3:]])
    found = stage().run_cases(block(names, values), history=True, reference=product)
    assert found.histories is not None
    whole = dict(zip(found.histories.names, found.histories.values, strict=True))
    u, own = (np.array([whole[f"{kind}.a{n}"][:-1] for n in "xyz"]) for kind in ("u", "law"))
    assert product.flights.u is not None
    feed = product.flights.u[:, :-1:3]
    ones = np.ones((3, 3)) - np.eye(3)
    for lane in range(0, LANES, 9):
        d = delta[:, lane]
        matrix = np.eye(3) + np.diag(0.05 * d[:3]) + 0.02 * d[3] * ones
        there = np.isfinite(u[0, :, lane])
        total = (own[:, :, lane] + feed[:, :, 0])[:, there]
        assert_allclose(u[:, there, lane], matrix @ total, rtol=0, atol=1e-16)
    assert metric(found, "largest_position_error").min() > 1e-3


def test_contract_of_a_landing() -> None:
    keys: dict[str, Any] = {
        "plant": Solid(), "law": Direct(), "target": {"position_m": [0, 0, 50]},
        "start": {"position_m": [20, 9, 80]}, "samples": 20, "success": ["completed", "impact"],
        "require": {"touchdown_speed_m_s": 1, "early_min": 1, "largest_acceleration_mm_s2": 50},
    }  # fmt: skip
    check_case_stage("closed_loop", keys, spread=0.3)


def test_a_flight_of_its_own_may_differ_from_nominal() -> None:
    product = descent()
    inputs = {"plant.push": -2e-5, "actuator.coupling": 0.02}
    made = stage(Solid(), flight_inputs=inputs)
    flown = made.run(RecordingContext(), reference=product)
    shown = made.present(flown, reference=product)
    check_presentation(shown)
    assert "plant.push = -2e-05, actuator.coupling = 0.02" in shown.tables["closed_loop"].notes[0]
    assert shown.verdict[0].startswith("Flight: ")
    assert flown.own[2].max() > 1e-5
    # In a campaign the same inputs make the same flight, and without them it is nominal.
    batch = block(tuple(inputs), [[value] for value in inputs.values()])
    values = made.run_cases(batch, reference=product).values[:, 0]
    assert_allclose(values, flown.values, rtol=1e-12)
    plain = stage(Solid()).run_cases(block(), reference=product)
    assert_array_equal(made.run_cases(block(), reference=product).values, plain.values)
    with pytest.raises(InputError, match=r"no input .plant\.pull"):
        stage(flight_inputs={"plant.pull": 1.0}).run(RecordingContext(), reference=product)


class Cube:
    """Of sides of 2 km."""

    def radius_array(self, directions: Array) -> Array:
        largest = np.abs(directions).max(axis=0)
        return np.asarray(1000.0 * np.linalg.norm(directions, axis=0) / largest)


class Cubic(Solid):
    surface = Cube()
    prime_meridian_rad = 0.5


def test_the_surface_of_a_body_is_that_of_its_shape() -> None:
    round_ = Surroundings.of(Solid()).surface_m
    assert round_ is not None
    level = np.sum((round_ / np.array(Solid.semi_axes_m)[:, None, None]) ** 2, axis=0)
    assert_allclose(level, 1.0, rtol=1e-12)
    made = Surroundings.of(Cubic()).surface_m
    assert made is not None
    c, s = np.cos(0.5), np.sin(0.5)
    own = np.array([c * made[0] + s * made[1], -s * made[0] + c * made[1], made[2]])
    assert_allclose(np.abs(own).max(axis=0), 1000.0, rtol=1e-12)
    assert Surroundings.of(Ground()).surface_m is None


def test_the_figure_of_a_descent_has_arrows() -> None:
    product = descent()
    made = stage(Solid())
    flown = made.run(RecordingContext(), reference=product)
    shown = made.present(flown, reference=product)
    check_presentation(shown)
    figures: Any = shown.figures
    solids = figures["closed_loop_accelerations"].panels[0].solids
    assert sum(isinstance(solid, Arrows) for solid in solids) == 3
    assert sum(isinstance(solid, Surface) for solid in solids) == 1
    assert "closed_loop_accelerations" not in stage(
        Solid(), needs={}, target={"position_m": [0, 0, 9]}, samples=1
    ).present(
        stage(Solid(), needs={}, target={"position_m": [0, 0, 9]}, start={"position_m": [0, 0, 9]},
              samples=1).run(RecordingContext())
    ).figures  # fmt: skip


def test_overtime_flies_on_until_contact() -> None:
    """Late flights touch where the reference, continued at its last velocity, takes them."""
    heights = np.linspace(-20.0, 40.0, LANES)
    product = descent()
    batch = block(("offset.z",), heights)
    keys: dict[str, Any] = {"law": Idle(), "require": {"touchdown_speed_m_s": 1}}
    plain = stage(**keys).run_cases(batch, history=True, reference=product)
    found = stage(**keys, overtime_s=100).run_cases(batch, history=True, reference=product)
    high, low = heights > 1e-6, heights < -1e-6
    assert (np.array(plain.status)[high] == "completed").all()
    assert (np.array(found.status) == "impact").all()
    # Nobody steers: contact is as much later as 0.5 m/s takes for the height.
    assert_allclose(metric(found, "early")[high], -heights[high] / 0.5, rtol=0, atol=1e-6)
    assert_allclose(metric(found, "final_speed")[high], np.hypot(0.1, 0.5), rtol=1e-9)
    assert_allclose(metric(found, "final_position_error")[high], heights[high], rtol=1e-6)
    # What is largest, and flights that end before, are as without overtime.
    for name in ("largest_position_error", "largest_velocity_error", "largest_command"):
        assert_allclose(metric(found, name), metric(plain, name), rtol=0, atol=1e-9)
    assert_array_equal(found.values[:, low], plain.values[:, low])
    # Too little of it: still above the ground, which is no success where contact is asked for.
    short = stage(**keys, overtime_s=45, success=["impact"]).run_cases(batch, reference=product)
    assert_array_equal(np.array(short.status) == "completed", heights > 30.0)  # to a whole period
    assert_array_equal(short.failed, heights > 30.0)
    late = stage(law=Idle(), overtime_s=100, require={"late_s": 30})
    judged = late.run_cases(batch, reference=product)
    assert_array_equal(judged.failed, heights > 15.0)
    assert set(judged.cause) == {"impact", "late"}


def test_histories_go_on_to_the_contact() -> None:
    """It is between two samples: beside them, with what is known of it."""
    heights = np.linspace(-20.0, 40.0, LANES)
    product = descent()
    batch = block(("offset.z",), heights)
    made = stage(law=Idle(), overtime_s=100)
    found = made.run_cases(batch, history=True, reference=product)
    h = found.histories
    assert h is not None
    assert h.end_s is not None
    assert h.end_values is not None
    last = np.nanmax(h.time_s, axis=0)
    between = np.isfinite(h.end_s)
    assert between.sum() > LANES - 4  # but where contact is at a sample
    assert (h.end_s[between] > last[between]).all()
    assert_allclose(h.end_s[between], metric(found, "duration")[between], rtol=1e-13)
    ends = dict(zip(h.names, h.end_values[:, between], strict=True))
    assert_allclose(ends["z"], 0.0, rtol=0, atol=1e-6)
    for name in ("position_error", "velocity_error"):
        assert_array_equal(ends[name], metric(found, f"final_{name}")[between])
    assert_array_equal(ends["dv"], metric(found, "dv")[between])
    for name in ("command", "u.ax", "law.ax", "seen.z", "ref.z"):
        assert np.isnan(ends[name]).all()
    # Those that fly all samples have no other end; nor have those that diverged a place.
    plain = stage(law=Idle()).run_cases(batch, history=("z",), reference=product)
    assert plain.histories is not None
    assert plain.histories.end_s is not None
    whole = np.array(plain.status) == "completed"
    assert_array_equal(np.isnan(plain.histories.end_s[whole]), True)


def test_figures_of_a_flight_go_on_to_the_contact() -> None:
    """30 m too high it touches a minute after the reference's end, when no sample is."""
    product = descent()
    start = (product.flights.x[:3, 0, 0] + [0.0, 0.0, 35.0]).tolist()
    made = stage(Solid(), law=Idle(), overtime_s=100, start={"position_m": start})
    flown = made.run(RecordingContext(), reference=product)
    assert flown.status == "impact"
    assert flown.end_s == pytest.approx(670.0)
    assert np.nanmax(flown.time_s) == 660.0
    shown = made.present(flown, reference=product)
    check_presentation(shown)
    figures: Any = shown.figures
    for panel, error in zip(
        figures["closed_loop_errors"].panels, ("position", "velocity"), strict=True
    ):
        line = np.array([panel.marks[0].x, panel.marks[0].y])
        here = line[:, np.isfinite(line).all(axis=0)]
        final = flown.values[flown.metrics.index(f"final_{error}_error")]
        assert_allclose(here[:, -1], [670.0 / 3600.0, final], rtol=1e-9)
    times = np.asarray(figures["closed_loop_command"].panels[0].marks[0].x)
    assert_allclose(times[np.isfinite(times)][-1], 670.0 / 3600.0)
    path = figures["closed_loop_path"].panels[0].solids[0]
    wanted = flown.end_x[:3] - flown.goal[:3, 0]  # less than a kilometre: from the reference
    assert_allclose(path.points[:, -1], wanted, rtol=1e-12)
    assert_allclose(path.times[-1], 670.0 / 3600.0)


@pytest.mark.filterwarnings("error")
def test_a_flight_that_begins_below_ground_is_refused_and_a_case_has_no_history() -> None:
    product = descent()
    made = stage(Solid(), start={"position_m": [10, 0, -5]}, limits={"position_error_m": 5e3})
    with pytest.raises(InputError, match="ended where it begins, by 'impact'"):
        made.run(RecordingContext(), reference=product)
    inputs = tuple(f"state.{name}" for name in "xyz")
    batch = block(inputs, np.array([10.0, 0.0, -5.0])[:, None])
    found = made.run_cases(batch, history=True, reference=product)
    # A start below ground is an impossible draw: neither a failure nor, with "impact" among what
    # succeeds, a success.
    assert set(zip(found.status, found.cause, strict=True)) == {("input", "start (impact)")}
    assert not found.failed.any()
    kept = found.histories
    assert kept is not None
    for name in ("u.ax", "law.az", "seen.x", "ref.vz", "command"):
        assert np.isnan(kept.values[kept.names.index(name)]).all()


def test_overtime_steers_towards_the_continued_reference() -> None:
    """The law works on; what is largest until the reference's end is as without."""
    pushes = np.full(LANES, 4e-5)
    product = descent()
    found = stage(overtime_s=600).run_cases(block(("plant.push",), pushes), reference=product)
    plain = stage().run_cases(block(("plant.push",), pushes), reference=product)
    assert found.status[0] == "impact"
    assert plain.status[0] == "completed"
    for name in ("largest_position_error", "largest_velocity_error", "largest_command"):
        assert_allclose(metric(found, name)[0], metric(plain, name)[0], rtol=1e-12)
    # An integral-free law leaves push / KP of height: contact as much later.
    assert -2.0 < metric(found, "early")[0] < 0.0
    assert_allclose(metric(found, "final_speed")[0], np.hypot(0.1, 0.5), rtol=0.01)


def test_the_landing_miss_is_from_the_site() -> None:
    """A late flight touches at the site; the reference has gone on below the ground by then."""
    heights = np.linspace(0.0, 40.0, LANES)
    product = descent()
    batch = block(("offset.z",), heights)
    keys: dict[str, Any] = {"law": Idle(), "overtime_s": 100}
    found = stage(**keys, require={"landing_miss_m": 5.0}).run_cases(batch, reference=product)
    assert found.metrics[-1] == "landing_miss"
    # Nobody steers: 0.1 m/s sideways for as long as the height takes at 0.5 m/s.
    assert_allclose(metric(found, "landing_miss")[1:], 0.2 * heights[1:], rtol=1e-6)
    assert metric(found, "final_position_error")[-1] == pytest.approx(40.0)
    assert_array_equal(found.failed, metric(found, "landing_miss") > 5.0)
    assert {"landing_miss", "impact"} == set(found.cause)
    sideways = block(("offset.x", "offset.z"), np.array([[30.0], [1.0]]) * np.ones(LANES))
    assert_allclose(
        metric(stage(**keys).run_cases(sideways, reference=product), "landing_miss"),
        np.hypot(30.2, 0.0), rtol=1e-6,
    )  # fmt: skip
    with pytest.raises(InputError, match="landing_miss_m"):
        stage(success=["completed"], require={"landing_miss_m": 5.0})


@pytest.mark.parametrize("kind", ["held", "zero"])
@pytest.mark.parametrize("overtime", [20.0, 200.0])
def test_the_planned_end_counts_where_it_is_no_sample(overtime: float, kind: str) -> None:
    """Velocity that goes astray between the last sample and the planned end is seen there."""
    product = descent()  # 600 s
    u = np.array(product.flights.u)
    u[:, -1] = [[0.0], [0.0], [2e-4]]
    lifted = FlightSet(Trajectories(**{**vars(product.flights), "u": u}))
    law = Idle()
    law.period_s = 440.0
    push = np.linspace(-2e-4, 2e-4, LANES)  # some touch early, some late, some never
    batch = block(("plant.push",), push)
    keys: dict[str, Any] = {"overtime_s": overtime, "overtime_command": kind, "substeps": 40}
    found = stage(law=law, **keys).run_cases(batch, reference=lifted)
    late = metric(found, "early") < -1e-6
    assert 8 < late.sum() < LANES - 8
    most = metric(found, "largest_velocity_error")[late]
    assert_allclose(most, 600.0 * push[late], rtol=1e-7)
    most = metric(found, "largest_position_error")[late]
    assert_allclose(most, 0.5 * 600.0**2 * push[late], rtol=1e-7)


@pytest.mark.parametrize("period", [60.0, 45.0])
@pytest.mark.parametrize("kind", ["held", "zero"])
def test_the_command_of_the_overtime(period: float, kind: str) -> None:
    """Held or zero from the reference's end on, which need not be a sample."""
    product = descent()
    u = np.array(product.flights.u)
    u[:, -1] = [[0.0], [0.0], [2e-4]]
    lifted = FlightSet(Trajectories(**{**vars(product.flights), "u": u}))
    law = Idle()
    law.period_s = period
    flown = stage(
        law=law,
        overtime_s=100,
        overtime_command=kind,
        start={"position_m": (lifted.flights.x[:3, 0, 0] + [0, 0, 500.0]).tolist()},
    )
    found = flown.run(RecordingContext(), reference=lifted)
    beyond = found.time_s[-1] - 600.0
    assert 100.0 <= beyond < 100.0 + period
    gain = 2e-4 * beyond if kind == "held" else 0.0
    assert_allclose(found.end_x[5], -0.5 + gain, rtol=0, atol=1e-9)
    end = lifted.flights.x[:, -1, 0]
    assert_allclose(found.goal[:3, -1], end[:3] + beyond * end[3:], rtol=1e-12)
    assert_allclose(found.goal[3:, -1], end[3:], rtol=1e-12)
    shown = flown.present(found)
    check_presentation(shown)
    assert f"with the command {kind}" in str([vars(table) for table in shown.tables.values()])


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"overtime_s": 60, "samples": 3}, "samples"),
        ({"overtime_s": 60, "duration_s": 600}, "duration_s"),
        ({"overtime_s": 60, "needs": {}, "target": {"position_m": [0, 0, 9]}, "samples": 2},
         "overtime_s"),
        ({"overtime_command": "zero"}, "overtime_command"),
        ({"require": {"late_s": 60}}, "require"),
    ],
)  # fmt: skip
def test_overtime_needs_a_reference_with_an_end(keys: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match=key):
        stage(**keys)
