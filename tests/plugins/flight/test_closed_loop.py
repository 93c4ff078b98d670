"""The stage ``closed_loop`` on plants and laws of a third party, with solutions written out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from hillsphere.engine.flying_stage import metric_errors
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array, CaseStage, Parameter, Scales, Variable
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults
from hillsphere.plugins import validate
from hillsphere.products import FlightSet, Trajectories
from hillsphere.symbolic import Expr, Params
from hillsphere.testing import RecordingContext, check_case_stage, check_presentation, check_stage
from hillsphere_flight import closed_loop as closed_loop_stage
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.metrics import METRICS
from hillsphere_flight.parts import unit_of
from hillsphere_flight.specs import ClosedLoopSpec

PERIOD, KP, KD = 10.0, 4e-3, 0.08


class Drifting:
    """Three double integrators, a steady push along x, and a clock as seventh state."""

    frame = "toy:inertial"
    states = (
        *(Variable(n, 1) for n in ("x", "y", "z")),
        *(Variable(n, 1, -1) for n in ("vx", "vy", "vz")),
    )
    controls = tuple(Variable(n, 1, -2) for n in ("ax", "ay", "az"))
    scales = Scales(100.0, 10.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("push", 0.0, "m/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (*x[3:6], u[0] + p["push"], u[1], u[2])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": x[2] + 1000.0}


class Clocked(Drifting):
    """The same with an angle that runs: seven states."""

    states = (*Drifting.states, Variable("angle", unit="rad"))

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (*super().derivative(x, u, t, p), p["push"] * 0.0 + 1e-3)


class Renamed(Drifting):
    """The same with other names of its controls."""

    controls = tuple(Variable(n, 1, -2) for n in ("fx", "fy", "fz"))


class Pair:
    """Two such spacecraft in one state, each with its positions before its velocities."""

    frame = "toy:inertial"
    states = tuple(
        Variable(f"{n}{i}", 1, power) for i in (1, 2) for power, ns in
        ((0, "xyz"), (-1, ("vx", "vy", "vz"))) for n in ns
    )  # fmt: skip
    controls = tuple(Variable(f"a{n}{i}", 1, -2) for i in (1, 2) for n in "xyz")
    scales = Scales(100.0, 10.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (*x[3:6], *u[:3], *x[9:12], *u[3:])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


class Direct:
    """u = Kp (r − y) + Kd (ṙ − ẏ), or an impulse that nulls the velocity error."""

    period_s = PERIOD

    def __init__(self, actuation: Literal["hold", "impulse"] = "hold", rows: int = 6) -> None:
        self.actuation, self.rows = actuation, rows

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        assert len(y) == self.rows
        gap = (ref - y).reshape(-1, 6, y.shape[1])
        if self.actuation == "impulse":
            return gap[:, 3:].reshape(-1, y.shape[1]), xc
        return (KP * gap[:, :3] + KD * gap[:, 3:]).reshape(-1, y.shape[1]), xc


class Inside:
    """The same law, acting all the time on the true states."""

    period_s = PERIOD
    measurement: Literal["held", "continuous"] = "continuous"
    inputs = 6
    states: tuple[Variable, ...] = ()

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(self, *signals: Any) -> tuple[Expr, ...]:
        return ()

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        return tuple(KP * (ref[i] - y[i]) + KD * (ref[i + 3] - y[i + 3]) for i in range(3))


def stage(plant: Any = None, law: Any = None, **keys: Any) -> ClosedLoopStage:
    table = {"plant": plant or Drifting(), "law": law or Direct(), **keys}
    if "needs" not in table:
        table.setdefault("target", {"position_m": [0, 0, 0]})
    if "duration_s" not in table and "needs" not in table:
        table.setdefault("samples", 20)
    return made_of(table)


def made_of(table: dict[str, Any]) -> ClosedLoopStage:
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec)


def block(
    names: tuple[str, ...] = (), values: Any = None, draws: Any = None, seed: int = 1
) -> CaseBatch:
    lanes = np.arange(LANES)
    table = np.zeros((len(names), LANES))
    if values is not None:
        table[:] = np.asarray(values, dtype=float).reshape(len(names), -1)
    drawn = lanes if draws is None else np.broadcast_to(draws, (LANES,)).astype(np.int64)
    return CaseBatch(
        lanes + 500, drawn, np.zeros(LANES, dtype=bool), names, table, seed, "campaign"
    )


def metric(found: CaseResults, name: str) -> Array:
    return np.asarray(found.values[found.metrics.index(name)])


def by_hand(x0: Any, samples: int, push: float = 0.0, gain: Any = 1.0) -> tuple[Array, Array]:
    """States (6, K + 1) and what was done (3, K): the double integrator is exact by parts."""
    h, x, states, done = PERIOD, np.array(x0, dtype=float), [], []
    for _ in range(samples):
        states.append(x)
        u = np.dot(gain, -KP * x[:3] - KD * x[3:]) if np.ndim(gain) else gain * (
            -KP * x[:3] - KD * x[3:]
        )  # fmt: skip
        done.append(u)
        a = u + np.array([push, 0.0, 0.0])
        x = np.concatenate([x[:3] + h * x[3:] + 0.5 * h * h * a, x[3:] + h * a])
    return np.array([*states, x]).T, np.array(done).T


def densely(x: Array, u: Array, places: int = 20001) -> Array:
    """Return distances of the double integrator between samples under held commands, exactly."""
    s = np.linspace(0.0, PERIOD, places)[:, None, None]
    return np.asarray(
        np.linalg.norm(x[:3, :-1] + s * x[3:, :-1] + 0.5 * s**2 * u, axis=1), dtype=float
    )


START = {"position_m": [100, -50, 20], "velocity_m_s": [0.5, 0, -0.25]}
X0 = [100.0, -50.0, 20.0, 0.5, 0.0, -0.25]


def test_metrics_are_those_of_the_exact_solution() -> None:
    made = stage(start=START)
    assert isinstance(made, CaseStage)
    x, u = by_hand(X0, 20)
    product = made.run(RecordingContext())
    assert_allclose(product.x, x, rtol=0, atol=1e-11)
    assert_allclose(product.u, u, rtol=0, atol=1e-13)
    assert (product.status, product.failed) == ("completed", False)
    values = dict(zip(product.metrics, product.values, strict=True))
    distance = np.linalg.norm(x[:3], axis=0)
    speed = np.linalg.norm(x[3:], axis=0)
    assert_allclose(values["dv"], PERIOD * np.linalg.norm(u, axis=0).sum(), rtol=1e-13)
    assert_allclose(values["final_position_error"], distance[-1], rtol=1e-12)
    assert_allclose(values["final_velocity_error"], speed[-1], rtol=1e-12)
    # Over the flight, not at samples: the nearest of them is 0.14 % low. A held command moves it
    # along a parabola, here looked at every 0.5 ms: the top lies at most 0.25 ms beside, which at
    # 0.4 m/s² of bend is 1e-8 m, 1e-10 of it.
    assert_allclose(values["largest_position_error"], densely(x, u).max(), rtol=1e-8)
    assert values["largest_position_error"] > 1.001 * distance.max()
    assert_allclose(values["largest_velocity_error"], speed.max(), rtol=1e-10)
    assert values["duration"] == 200.0
    assert values["firings"] == 20.0
    assert_allclose(product.position_error_m, distance, rtol=1e-10)
    assert product.step_error_m is not None
    assert product.step_error_m < 1e-12


def test_errors_may_count_from_later_on() -> None:
    x, u = by_hand(X0, 20)
    found = stage(start=START, errors_from_s=95).run_cases(block())
    # Sample 10, at 100 s, is the first that counts.
    assert_allclose(
        metric(found, "largest_position_error"),
        densely(x[:, 10:], u[:, 10:]).max(),
        rtol=1e-8,
    )


def test_the_nominal_flight_is_a_case_of_a_campaign() -> None:
    made = stage(
        start=START,
        navigation={"position_m": 3, "velocity_m_s": 0.01, "correlation_time_s": 30},
        actuator={"magnitude": 0.02, "pointing_deg": 1},
    )
    product = made.run(RecordingContext(seed=7))
    batch = block(draws=np.roll(np.arange(LANES), 5), seed=7)
    found = made.run_cases(CaseBatch(**{**vars(batch), "stream": "closed_loop"}), history=True)
    assert_array_equal(product.values, found.values[:, 5])
    assert not np.array_equal(product.values, found.values[:, 6])
    assert found.histories is not None
    names = found.histories.names
    assert names[:6] == tuple(v.name for v in Drifting.states)
    assert names[6] == "seen.x"
    assert names[12] == "ref.x"
    assert names[18:21] == ("u.ax", "u.ay", "u.az")
    assert found.histories.units[18] == "m/s2"
    assert found.histories.units[9] == "m/s"
    assert_array_equal(found.histories.values[:6, :, 5], product.x)
    assert_array_equal(found.histories.values[18:21, :-1, 5], product.u)
    assert np.isnan(found.histories.values[18:24, -1]).all()


def test_noise_follows_draws_seed_and_stream_and_not_numbers() -> None:
    made = stage(start=START, navigation={"position_m": 3})
    one = made.run_cases(block(draws=3))
    assert np.ptp(one.values, axis=1).max() == 0.0
    assert metric(made.run_cases(block(draws=4)), "dv")[0] != metric(one, "dv")[0]
    assert metric(made.run_cases(block(draws=3, seed=2)), "dv")[0] != metric(one, "dv")[0]
    other = CaseBatch(**{**vars(block(draws=3)), "stream": "another"})
    assert metric(made.run_cases(other), "dv")[0] != metric(one, "dv")[0]
    renumbered = CaseBatch(**{**vars(block(draws=3)), "numbers": np.arange(LANES)})
    assert_array_equal(made.run_cases(renumbered).values, one.values)


def test_start_and_offsets() -> None:
    made = stage(start=START)
    x, _ = by_hand([103.0, *X0[1:]], 20)
    moved = made.run_cases(block(("offset.x",), [3.0]))
    assert_array_equal(moved.values, made.run_cases(block(("state.x",), [103.0])).values)
    assert_allclose(metric(moved, "final_position_error"), np.linalg.norm(x[:3, -1]), rtol=1e-12)


def test_parameters_of_the_plant_are_compiled_in_unless_they_differ() -> None:
    made = stage(start=START)
    pushes = np.linspace(-0.2, 0.2, LANES)
    found = made.run_cases(block(("plant.push", "offset.y"), [pushes, np.zeros(LANES)]))
    for lane in (0, 40):
        x, _ = by_hand(X0, 20, push=float(pushes[lane]))
        expected = np.linalg.norm(x[:3, -1])
        assert_allclose(metric(found, "final_position_error")[lane], expected, rtol=1e-12)
    loop = made._plan()
    made.run_cases(block(("offset.y", "plant.push"), np.zeros((2, LANES))))
    assert list(loop.simulators) == [(("push",), 1)]
    made.run_cases(block())
    assert list(loop.simulators) == [(("push",), 1), ((), 1)]


@pytest.mark.parametrize("law", [Direct(), Inside()])
def test_effectiveness_is_scale_times_turn_times_gain(law: Any) -> None:
    made = stage(law=law, start=START, samples=3, substeps=20)
    names = (
        "actuator.scale", "actuator.gain.ay", "actuator.turn.ax", "actuator.turn.az",
    )  # fmt: skip
    found = made.run_cases(block(names, [1.1, 0.8, 0.3, -0.5]), history=True)
    turn = Rotation.from_rotvec([0.3, 0.0, -0.5]).as_matrix()
    gain = 1.1 * turn @ np.diag([1.0, 0.8, 1.0])
    assert found.histories is not None
    x = found.histories.values[:6, :, 9]
    if isinstance(law, Direct):
        expected, _ = by_hand(X0, 3, gain=gain)
        assert_allclose(x, expected, rtol=0, atol=1e-11)
    else:
        from scipy.linalg import expm

        a = np.zeros((6, 6))
        a[:3, 3:], a[3:, :3], a[3:, 3:] = np.eye(3), -KP * gain, -KD * gain
        assert_allclose(x[:, -1], expm(a * 3 * PERIOD) @ np.array(X0), rtol=0, atol=1e-9)
    plain = made.run_cases(block())
    assert_array_equal(made.run_cases(block(("actuator.scale",), [1.0])).values, plain.values)


def test_budget_of_a_case() -> None:
    made = stage(start=START, limits={"dv_m_s": 100})
    whole = metric(made.run_cases(block()), "dv")[0]
    budgets = np.where(np.arange(LANES) % 2, 0.5, 2.0) * whole
    found = made.run_cases(block(("dv_budget",), budgets))
    assert found.status[:2] == ("completed", "propellant")
    assert_array_equal(found.failed, np.arange(LANES) % 2 == 1)
    assert_allclose(metric(found, "dv")[1], 0.5 * whole, rtol=1e-9)
    assert "dv_budget" not in [q.name for q in stage(start=START).case_inputs()]


def test_a_landing_wants_to_touch() -> None:
    keys: dict[str, Any] = {
        "samples": 80,
        "start": {"position_m": [0, 0, 0]},
        "target": {"position_m": [0, 0, -1100]},
    }
    found = stage(success=["impact"], **keys).run_cases(block())
    assert found.status[0] == "impact"
    assert not found.failed.any()
    # It is on the surface, 100 m above where it is sent.
    assert_allclose(metric(found, "final_position_error"), 100.0, rtol=1e-9)
    assert np.isfinite(found.values).all()
    failed = stage(**keys).run_cases(block())
    assert failed.failed.all()
    assert failed.status == found.status


def test_requirements_fail_a_flight_that_ends_well() -> None:
    starts = np.linspace(10.0, 200.0, LANES)
    plain = stage(samples=3).run_cases(block(("state.x",), starts))
    dv = metric(plain, "dv")
    limit = float(np.sort(dv)[20])
    found = stage(samples=3, require={"dv_m_s": limit}).run_cases(block(("state.x",), starts))
    assert_array_equal(found.failed, dv > limit)
    assert found.status[-1] == "requirement"
    assert found.cause[-1] == "dv"
    assert found.status[0] == "completed"
    assert found.cause[0] == ""
    assert_array_equal(found.values, plain.values)


def test_a_loose_estimate_is_replaced_by_a_flight_with_half_the_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What estimates a thousand times too large leave open is decided by flying it again."""
    reached = float(metric(stage(start=START).run_cases(block()), "final_position_error")[0])

    def loose(*given: Any, **keys: Any) -> Array:
        return np.full_like(metric_errors(*given, **keys), 0.1 * reached)

    monkeypatch.setattr(closed_loop_stage, "metric_errors", loose)
    for most, status in ((0.95, "requirement"), (1.05, "completed")):
        made = stage(start=START, require={"final_position_error_m": most * reached})
        found = made.run_cases(block())
        assert set(found.status) == {status}
    # Where half the steps give something else, it stays open.
    fly = ClosedLoopStage._fly_block

    def other(self: ClosedLoopStage, *given: Any, finer: bool = False, **keys: Any) -> Any:
        flown = fly(self, *given, finer=finer, **keys)
        moved = replace(flown.flights, x=flown.flights.x + 0.1 * reached)
        return replace(flown, flights=moved) if finer else flown

    monkeypatch.setattr(ClosedLoopStage, "_fly_block", other)
    assert set(made.run_cases(block()).status) == {"step_error"}


def test_limits_end_a_flight_where_they_are_crossed() -> None:
    keys: dict[str, Any] = {
        "start": {"position_m": [50, 0, 0], "velocity_m_s": [-1, 0, 0]},
        "target": {"position_m": [0, 0, 0]},
    }
    # Overshoots: nearest and farthest from the centre follow from the exact path.
    x, _ = by_hand([50, 0, 0, -1, 0, 0], 20)
    assert x[0].min() < -5.0
    found = stage(limits={"velocity_error_m_s": 1.5}, substeps=4, **keys).run_cases(block())
    assert found.status[0] == "constraint"
    assert found.cause[0] == "velocity_error"
    assert_allclose(metric(found, "final_velocity_error"), 1.5, rtol=1e-9)
    found = stage(limits={"distance_min_m": 30}, substeps=4, **keys).run_cases(block())
    assert found.cause[0] == "distance_min"
    assert_allclose(metric(found, "final_position_error"), 30.0, rtol=1e-9)
    away = {"start": {"velocity_m_s": [30, 0, 0]}}
    found = stage(limits={"distance_max_m": 80}, **away).run_cases(block())
    assert (found.status[0], found.cause[0]) == ("escape", "distance_max")
    assert_allclose(metric(found, "final_position_error"), 80.0, rtol=1e-9)


def circle(t: Array) -> Array:
    """Return a circle of 100 m in 400 s: states, then the acceleration that it needs (9, K)."""
    w = 2 * np.pi / 400.0
    c, s, zero = 100 * np.cos(w * t), 100 * np.sin(w * t), 0 * t
    return np.array([c, s, zero, -w * s, w * c, zero, -w * w * c, -w * w * s, zero])


def flights(t: Array, *, command: bool = False, frame: str = "toy:inertial") -> FlightSet:
    x = circle(t)
    return FlightSet(
        Trajectories(
            frame=frame,
            states=tuple(v.name for v in Drifting.states),
            plans=("around",),
            labels=("circle",),
            t_s=t[:, None],
            x=x[:6, :, None],
            controls=("ax", "ay", "az") if command else (),
            u=x[6:, :, None] if command else None,
        )
    )


def test_a_trajectory_is_followed_with_its_command() -> None:
    product = flights(np.arange(0.0, 401.0, PERIOD), command=True)
    made = stage(needs={"reference": "guidance"}, start={"time_s": 50})
    flown = made.run(RecordingContext(), reference=product)
    assert flown.x.shape == (6, 41)
    assert_array_equal(flown.goal, circle(np.arange(0.0, 401.0, PERIOD))[:6])
    # Forty held steps of the exact acceleration leave some metres to the law, which alone lags.
    assert flown.position_error_m.max() < 12.0
    alone = made.run(RecordingContext(), reference=flights(np.arange(0.0, 401.0, PERIOD)))
    assert alone.position_error_m.max() > 2 * flown.position_error_m.max()
    assert flown.time_s[0] == 50.0
    assert flown.end_s == 450.0
    check_presentation(made.present(flown, reference=product))


def test_a_coarse_trajectory_is_followed_along_its_cubics() -> None:
    made = stage(needs={"reference": "guidance"}, samples=50)
    flown = made.run(RecordingContext(), reference=flights(np.arange(0.0, 401.0, 25.0)))
    t = np.arange(51) * PERIOD
    # Cubic Hermite: h⁴/384 of the fourth derivative; its slope, one order less.
    w = 2 * np.pi / 400.0
    exact = circle(np.minimum(t, 400.0))
    bound = 100 * w**4 * 25.0**4 / 384
    assert np.abs(flown.goal[:3] - exact[:3]).max() < 1.05 * bound
    assert np.abs(flown.goal[3:] - exact[3:6]).max() < 100 * w**4 * 25.0**3 / 60
    # Beyond its end the reference stays at its last state.
    assert_array_equal(flown.goal[:, 41:], np.repeat(exact[:6, -1:], 10, axis=1))


def test_a_tube_moves_with_the_reference_and_the_start_time() -> None:
    product = flights(np.arange(0.0, 401.0, PERIOD))
    made = stage(
        needs={"reference": "guidance"}, limits={"position_error_m": 60}, success=["completed"]
    )
    names = ("start_time", "actuator.scale")
    scale = np.where(np.arange(LANES) < 32, 1.0, 0.0)
    times = np.linspace(0.0, 1e4, LANES)
    found = made.run_cases(block(names, [times, scale]), reference=product)
    # Without thrust the tangent leaves the circle: √(c² + …) = 60 m at the same time for all.
    lost = np.arange(LANES) >= 32
    assert_array_equal(np.array(found.status) == "constraint", lost)
    assert_allclose(metric(found, "final_position_error")[lost], 60.0, rtol=1e-5)
    assert_allclose(np.ptp(metric(found, "duration")[lost]), 0.0, atol=1e-6)


def test_start_of_a_product_is_no_number_beforehand() -> None:
    made = stage(needs={"reference": "guidance"}, start={"velocity_m_s": [0, 0, 0]})
    nominal = {q.name: q.value for q in made.case_inputs()}
    assert np.isnan(nominal["state.x"])
    assert nominal["state.vx"] == 0.0
    assert nominal["offset.x"] == 0.0
    product = flights(np.arange(0.0, 401.0, PERIOD))
    found = made.run_cases(block(("offset.x",), [2.0]), history=True, reference=product)
    assert found.histories is not None
    assert_array_equal(found.histories.values[:6, 0, 0], [102.0, 0, 0, 0, 0, 0])


def test_two_references_are_not_mixed_up() -> None:
    made = stage(needs={"reference": "guidance"})
    first = flights(np.arange(0.0, 401.0, PERIOD))
    second = flights(np.arange(0.0, 201.0, PERIOD))
    durations = [
        metric(made.run_cases(block(), reference=one), "duration")[0]
        for one in (first, second, first)
    ]
    assert durations == [400.0, 200.0, 400.0]


def test_a_law_for_six_states_sees_six_of_seven() -> None:
    made = stage(Clocked(), start={"others": {"angle": 0.25}, **START})
    found = made.run_cases(block(), history=True)
    assert_array_equal(found.values, stage(start=START).run_cases(block()).values)
    assert found.histories is not None
    angle = found.histories.values[6, :, 0]
    assert found.histories.names[6] == "angle"
    assert found.histories.units[6] == "rad"
    assert_allclose(angle, 0.25 + 1e-3 * np.arange(21) * PERIOD, rtol=1e-12)
    seen = stage(Clocked(), Direct(rows=7), start={"others": {"angle": 0.0}, **START},
                 sees=["angle", "x", "y", "z", "vx", "vy", "vz"], samples=1)  # fmt: skip
    with pytest.raises(ValueError, match="reshape"):
        seen.run_cases(block())  # the toy law cannot use the seventh, but it was given it


def test_two_spacecraft_in_one_state() -> None:
    target = [0.0, 0, 0, 100, 0, 0]
    made = stage(Pair(), Direct(rows=12), target={"position_m": target})
    assert made.commands == ("ax1", "ay1", "az1", "ax2", "ay2", "az2")
    found = made.run_cases(
        block(("offset.x1", "offset.z2", "actuator.gain.ax1"), [30.0, 40.0, 1.0]), history=True
    )
    first, u1 = by_hand([30, 0, 0, 0, 0, 0], 20)
    second, u2 = by_hand([0, 0, 40, 0, 0, 0], 20)
    # The larger of the two distances; Δv of both.
    distances = np.linalg.norm([first[:3], second[:3]], axis=1)
    assert_allclose(metric(found, "largest_position_error"), 40.0, rtol=1e-13)
    assert_allclose(metric(found, "final_position_error"), distances[:, -1].max(), rtol=1e-11)
    spent = PERIOD * sum(np.linalg.norm(u, axis=0).sum() for u in (u1, u2))
    assert_allclose(metric(found, "dv"), spent, rtol=1e-12)
    product = made.run(RecordingContext())
    check_presentation(made.present(product))
    tube = stage(Pair(), Direct(rows=12), target={"position_m": target},
                 limits={"position_error_m": 35})  # fmt: skip
    found = tube.run_cases(block(("offset.x1", "offset.z2"), [30.0, 40.0]))
    assert (found.status[0], found.cause[0]) == ("constraint", "position_error")


def test_impulses_in_their_own_units() -> None:
    made = stage(
        law=Direct("impulse"),
        start=START,
        samples=2,
        actuator={"maximum_impulse_m_s": 0.25},
    )
    assert made.commands == ("vx", "vy", "vz")
    found = made.run_cases(block())
    # √0.3125 = 0.559 m/s in pieces of 0.25
    assert_allclose(metric(found, "dv"), 0.5, rtol=1e-12)
    with pytest.raises(InputError, match="impulses; limit those"):
        stage(law=Direct("impulse"), actuator={"maximum_acceleration_mm_s2": 1})
    with pytest.raises(InputError, match="held acceleration; limit those"):
        stage(actuator={"minimum_impulse_mm_s": 1})
    with pytest.raises(InputError, match="where no actuator model applies"):
        stage(law=Inside(), actuator={"magnitude": 0.01})


def test_a_case_that_never_begins_is_failed_and_no_other_is() -> None:
    values = np.where(np.arange(LANES) == 9, np.nan, 1.0)
    found = stage(start=START).run_cases(block(("offset.vy",), values))
    assert_array_equal(np.flatnonzero(found.failed), [9])
    assert found.status[9] == "diverged"
    assert np.isfinite(np.delete(found.values, 9, axis=1)).all()


def test_units_of_variables() -> None:
    assert [unit_of(v) for v in (*Clocked.states[::3], *Drifting.controls[:1])] == [
        "m", "m/s", "rad", "m/s2"
    ]  # fmt: skip
    assert unit_of(Variable("n", 0, -1)) == "1/s"
    assert unit_of(Variable("q")) == "-"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"target": {"position_m": [1.0]}}, r"target.position_m: the plant has 3 \(x, y, z\)"),
        ({"start": {"velocity_m_s": [1.0] * 6}}, r"start.velocity_m_s: .* got 6 numbers"),
        ({"start": {"others": {"anomaly": 1.0}}}, "no state anomaly .* the plant has none"),
        ({"sees": ["x", "range"]}, "no state range; it has x, y, z"),
        ({"plant": Clocked()}, "start.others: give the value of angle"),
        ({"target": None}, "where\\? give target.position_m"),
        ({"samples": None}, "how long\\? give a duration"),
        ({"duration_s": 5, "samples": 3}, "the duration says it already"),
        ({"follow": "circle"}, "needs.reference, which is not given"),
        ({"sees": ["x", "x"]}, "a value is listed twice"),
        ({"tolerance": 1e-9, "substeps": 600}, "at least twice substeps"),
        ({"success": ["diverged"]}, "success"),
        ({"law": Inside(), "sees": ["x"]}, "sees all states"),
    ],
)
def test_what_does_not_fit_is_said(keys: dict[str, Any], message: str) -> None:
    table = {"samples": 5, "target": {"position_m": [0, 0, 0]}} | keys
    table = {key: value for key, value in table.items() if value is not None}
    with pytest.raises(HillsphereError, match=message):
        made_of({"plant": Drifting(), "law": Direct(), **table})


@pytest.mark.parametrize(
    ("product", "keys", "error", "message"),
    [
        (flights(np.arange(0.0, 99.0, 10)), {"follow": "ellipse"}, InputError, "has 'circle'"),
        (flights(np.arange(0.0, 99.0, 10), frame="toy:other"), {}, StageError, "toy:other"),
        (flights(np.zeros(1)), {}, StageError, "two rising times"),
        (flights(np.arange(0.0, 99.0, 10), command=True), {"law": Direct("impulse")},
         InputError, "the law commands impulses"),
        (flights(np.arange(0.0, 99.0, 10), command=True), {"plant": Renamed()}, StageError,
         "the plant's controls are"),
    ],
)  # fmt: skip
def test_what_cannot_be_followed(
    product: FlightSet, keys: dict[str, Any], error: type[Exception], message: str
) -> None:
    made = stage(needs={"reference": "guidance"}, **keys)
    with pytest.raises(error, match=message):
        made.run(RecordingContext(), reference=product)


def test_an_unknown_input_is_refused() -> None:
    with pytest.raises(InputError, match=r"no input state\.w"):
        stage(start=START).run_cases(block(("state.w",), [0.0]))


def test_contract_with_everything_on() -> None:
    keys = {
        "plant": Clocked(),
        "law": Direct(),
        "start": {"others": {"angle": 0.1}, **START},
        "target": {"position_m": [0, 0, 0]},
        "samples": 30,
        "tolerance": 1e-9,
        "navigation": {"position_m": 1, "velocity_mm_s": 5, "correlation_time_s": 60},
        "actuator": {"magnitude": 0.05, "pointing_deg": 3, "maximum_acceleration_m_s2": 0.4},
        "limits": {"position_error_m": 200, "distance_max_km": 1, "dv_m_s": 30},
        "require": {"final_position_error_m": 3},
    }
    check_stage("closed_loop", keys)
    found = check_case_stage("closed_loop", keys, spread=0.3, inert=["dv_budget"])
    # Starts and effectiveness differ so much that flights end in more than one way.
    assert len(set(found.status)) > 1
    assert found.metrics == tuple(metric.name for metric in METRICS)
