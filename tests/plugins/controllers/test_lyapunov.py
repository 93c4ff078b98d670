"""The Lyapunov function in flight, and the command against all others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.plugins import default_registry, validate
from hillsphere.products import FlightSet, Trajectories
from hillsphere.simulation import Cases, simulate
from hillsphere.testing import RecordingContext, example
from hillsphere_controllers.law_specs import LyapunovSpec
from hillsphere_controllers.lyapunov import Lyapunov
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

PERIOD = 60.0


def law(**keys: Any) -> Lyapunov:
    table = {"period_s": PERIOD, **keys}
    if "p" not in table:
        table.setdefault("time_constant_s", 300.0)
    return Lyapunov(LyapunovSpec.model_validate(table))


def motion(h: float) -> tuple[Array, Array]:
    return np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]])


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.1, 1e3), st.floats(0.5, 1e2), st.floats(0.1, 3.0), st.integers(0, 1000))
def test_the_function_falls_and_no_command_lets_it_fall_more(
    period: float, ratio: float, damping: float, seed: int
) -> None:
    """By xᵀ Q x or more, Q of ones for positions and rates times the time constant."""
    constant = ratio * period
    made = law(period_s=period, time_constant_s=constant, damping=damping)
    a, b = motion(period)
    random = np.random.default_rng(seed)
    x = random.normal(size=2) * np.array([1.0, 1.0 / constant])
    u = -made.gain @ x
    step, _ = made.step(0, np.zeros(1), x[:, None], np.zeros((2, 1)), made.initial(1))
    assert_allclose(step[:, 0], u, rtol=1e-12)

    def value(u: Array) -> float:
        after = a @ x + b @ u
        return float(after @ made.p @ after)

    before = float(x @ made.p @ x)
    assert value(u) <= before - (x[0] ** 2 + (constant * x[1]) ** 2) * (1.0 - 1e-6)
    for factor in 1.0 + 0.1 * random.normal(size=10):
        assert value(factor * u) >= value(u) * (1.0 - 1e-9)


def test_time_constant_and_damping_of_fast_samples() -> None:
    """ω² and 2 ζ ω would be the gains of a P of continuous time; here V falls as fast or faster."""
    made = law(period_s=0.5, time_constant_s=100.0, damping=0.7)
    a, b = motion(0.5)
    poles = np.log(np.linalg.eigvals(a - b @ made.gain).astype(complex)) / 0.5
    assert poles.real.max() < -0.5 / 100.0


def stage(made: Lyapunov, **keys: Any) -> ClosedLoopStage:
    table: dict[str, Any] = {
        "plant": example("plant", "hill"), "law": made, "target": {"position_m": [20e3, 0, 0]},
        "start": {"position_m": [20.5e3, 300.0, -200.0], "velocity_m_s": [0, 0.1, 0]},
        "samples": 100, **keys,
    }  # fmt: skip
    if "needs" in table:
        del table["target"]
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec)


def values(made: Lyapunov, flight: ClosedLoopFlight) -> Array:
    """V at the samples, of three axes."""
    x = flight.x - flight.goal
    pairs = np.stack([x[:3], x[3:]])
    return np.asarray(np.einsum("iak,ij,jak->k", pairs, made.p, pairs))


def test_the_function_falls_in_every_period_of_a_flight() -> None:
    """Above a rotating body's field that is cancelled, until what the hold leaves of it shows."""
    made = law(plant=example("plant", "hill"))
    flight = stage(made).run(RecordingContext())
    v = values(made, flight)
    assert flight.status == "completed"
    large = v[:-1] > 1e-4 * v[0]
    assert large.sum() > 10
    assert (v[1:][large] < v[:-1][large]).all()
    assert flight.position_error_m[-1] < 0.1
    # uncancelled, the steady push leaves an error
    loose = stage(law()).run(RecordingContext())
    assert loose.position_error_m[-1] > 10.0


def test_a_flight_of_the_plant_is_followed_without_effort() -> None:
    """'difference': on the trajectory itself nothing is commanded; beside it the error goes."""
    plant = example("plant", "hill")
    start = np.array([[60e3], [10e3], [0.0], [0.0], [-10.0], [1.0]])

    class Nothing:
        period_s, actuation = PERIOD, "hold"

        def initial(self, n: int) -> Array:
            return np.zeros((0, n))

        def step(self, k: int, t: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
            return np.zeros((3, y.shape[1])), xc

    coast = simulate(plant, Nothing(), Cases(start), 100, history=True)  # type: ignore[arg-type]
    assert coast.history is not None
    history = coast.history
    product = FlightSet(
        Trajectories(
            plant.frame, tuple(v.name for v in plant.states), ("coast",), ("coast",),
            history.time_s, history.x,
        )
    )  # fmt: skip
    made = law(plant=plant, cancel="difference")
    keys = {"needs": {"reference": "coast"}, "samples": 99}
    on = {"position_m": start[:3, 0].tolist(), "velocity_m_s": start[3:, 0].tolist()}
    quiet = stage(made, start=on, **keys).run(RecordingContext(), product)
    assert np.abs(quiet.u).max() < 1e-9
    beside = {**on, "position_m": (start[:3, 0] + [200.0, -100.0, 50.0]).tolist()}
    found = stage(made, start=beside, **keys).run(RecordingContext(), product)
    assert found.position_error_m[0] > 200.0
    assert found.position_error_m[-1] < 0.1


def test_a_maximum_keeps_the_direction() -> None:
    made, cut = law(), law(maximum_m_s2=1e-3)
    y = np.random.default_rng(3).normal(size=(6, 5)) * np.array([[1e3]] * 3 + [[1.0]] * 3)
    y[:, 4] *= 1e-4
    zero = np.zeros((6, 5))
    u, _ = made.step(0, np.zeros(5), y, zero, made.initial(5))
    less, _ = cut.step(0, np.zeros(5), y, zero, cut.initial(5))
    size = np.linalg.norm(u, axis=0)
    assert (size[:4] > 1e-3).all()
    assert_allclose(less[:, :4], u[:, :4] / size[:4] * 1e-3, rtol=1e-12)
    assert_allclose(less[:, 4], u[:, 4], rtol=1e-14)
    rest, _ = cut.step(0, np.zeros(5), zero, zero, cut.initial(5))
    assert not rest.any()


def test_a_function_of_all_axes() -> None:
    """P of three axes that is that of one: the same commands; a coupled one acts across."""
    one = law()
    whole = law(p=np.kron(one.p, np.eye(3)).tolist())
    y, zero = np.random.default_rng(4).normal(size=(2, 6, 3))
    first, _ = one.step(0, np.zeros(3), y, zero, one.initial(3))
    second, _ = whole.step(0, np.zeros(3), y, zero, whole.initial(3))
    assert_allclose(second, first, rtol=1e-9)
    turned = np.kron(np.eye(2), [[1.0, 0.3, 0.0], [-0.2, 1.0, 0.1], [0.0, 0.4, 1.0]])
    p = turned.T @ np.kron(one.p, np.eye(3)) @ turned
    coupled = law(p=(0.5 * (p + p.T)).tolist())
    assert np.abs(coupled.gain[0, 1]) < 1e-9 * np.abs(coupled.gain[0, 0])
    scaled = np.kron(one.p, np.diag([1.0, 4.0, 9.0])) + np.kron([[0.0, 0.0], [0.0, 3e4]],
        [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # fmt: skip
    assert np.abs(law(p=scaled.tolist()).gain[0, 1]) > 1e-9


def test_what_is_no_lyapunov_function_is_named() -> None:
    for p, message in (
        ([[1.0, 0.0], [0.0, 1e4]], "p gives no Lyapunov function"),
        ([[1.0, 0.0], [0.0, -1.0]], "positive definite"),
        ([[1.0, 2.0], [2.0, 1.0]], "positive definite"),
        ([[1.0, 2.0], [0.0, 9.0]], "symmetric"),
    ):
        with pytest.raises(InputError, match=message):
            law(p=p)
    made = law()
    for y in (np.zeros((3, 1)), np.zeros((0, 1))):
        with pytest.raises(InputError, match="positions, then as many velocities"):
            made.step(0, np.zeros(1), y, y, made.initial(1))
    spec = default_registry().get("compensator", "lyapunov").load_spec()
    for keys, message in (
        ({}, "one of time_constant_s and p"),
        ({"time_constant_s": 1, "p": [[1, 0], [0, 1]]}, "one of time_constant_s and p"),
        ({"p": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "must be square"),
    ):
        with pytest.raises(InputError, match=message):
            validate(spec, {"period_s": 1, **keys}, where="here")


def test_a_plant_of_other_states_is_refused() -> None:
    """On an ellipse, the true anomaly is not among what the law sees."""
    with pytest.raises(InputError, match="plant: its states must be positions, then as many"):
        law(plant=example("plant", "three_body", 1))
