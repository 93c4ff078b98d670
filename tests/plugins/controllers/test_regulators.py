"""Regulators worked out from a motion and weights, flown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.plugins import default_registry, validate
from hillsphere.testing import RecordingContext, example
from hillsphere_controllers.errors import NotStabilisableError
from hillsphere_controllers.full_order.sampled_data import sampled_cost, sampled_noise
from hillsphere_controllers.law_specs import LqgSpec, LqrSpec
from hillsphere_controllers.regulators import LinearQuadraticGaussian, LinearQuadraticRegulator
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

AXIS: dict[str, Any] = {"a": [[0.0, 1.0], [0.0, 0.0]], "b": [[0.0], [1.0]]}
SIZES: dict[str, Any] = {
    "state_sizes": [10.0] * 3 + [0.1] * 3,
    "control_sizes": [1e-4] * 3,
}
POINT = [20e3, 0.0, 0.0]


def lqr(**keys: Any) -> LinearQuadraticRegulator:
    return LinearQuadraticRegulator(LqrSpec.model_validate({"period_s": 60.0, **keys}))


def lqg(**keys: Any) -> LinearQuadraticGaussian:
    return LinearQuadraticGaussian(LqgSpec.model_validate({"period_s": 60.0, **keys}))


def at_the_point(**keys: Any) -> dict[str, Any]:
    return {"plant": example("plant", "hill"), "point": {"position_m": POINT}, **SIZES, **keys}


def test_fast_samples_have_the_gains_of_continuous_time() -> None:
    """ẍ = u, sizes of 10 m and 1e-5 m/s²: u = −x/ρ − √(2/ρ) ẋ, ρ = 1e6 s²."""
    keys = {**AXIS, "q": [[1e-2, 0.0], [0.0, 0.0]], "control_sizes": [1e-5]}
    rho = 1e6
    slow, fast = lqr(**keys), lqr(**{**keys, "period_s": 0.1})
    exact = np.array([[1.0 / rho, np.sqrt(2.0 / rho)]])
    assert_allclose(fast.gain, exact, rtol=1e-3)
    assert np.abs(slow.gain / exact - 1.0).max() > 0.03  # a minute of hold is not nothing


def cost_of(law: LinearQuadraticRegulator, gain: Array, start: Array) -> float:
    """∫ xᵀ Q x + uᵀ R u dt of the held feedback, by summing periods."""
    spec = law.spec
    a, b = np.array(spec.a), np.array(spec.b)
    q, r = np.array(spec.q), np.diag(1.0 / np.array(spec.control_sizes) ** 2)
    ad, bd, qd, rd, nd = sampled_cost(a, b, q, r, spec.period_s)
    x, total = start, 0.0
    for _ in range(300):
        u = -gain @ x
        total += float(x @ qd @ x + u @ rd @ u + 2.0 * x @ nd @ u)
        x = ad @ x + bd @ u
    return total


def test_no_other_held_feedback_costs_less() -> None:
    keys = {**AXIS, "q": [[1.0, 0.0], [0.0, 100.0]], "control_sizes": [0.01]}
    law = lqr(**{**keys, "period_s": 20.0})
    start = np.array([3.0, -0.2])
    best = cost_of(law, law.gain, start)
    random = np.random.default_rng(1)
    for _ in range(20):
        other = law.gain * (1.0 + 0.05 * random.normal(size=law.gain.shape))
        assert cost_of(law, other, start) > best
    # the gains of continuous time do not even hold it
    smooth = lqr(**{**keys, "period_s": 1e-2}).gain
    held = np.array([[1.0, 20.0], [0.0, 1.0]]) - np.array([[200.0], [20.0]]) @ smooth
    assert np.abs(np.linalg.eigvals(held)).max() > 1.0
    assert np.abs(law.poles).max() < 1.0


def flown(law: Any, samples: int = 200, **keys: Any) -> ClosedLoopFlight:
    table: dict[str, Any] = {
        "plant": example("plant", "hill"), "law": law, "target": {"position_m": POINT},
        "start": {"position_m": [20.05e3, 30.0, -20.0], "velocity_m_s": [0, 0.01, 0]},
        "samples": samples, **keys,
    }  # fmt: skip
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec).run(RecordingContext())


def test_the_flight_near_the_point_is_that_of_the_poles() -> None:
    """With what balances the plant at the point; without, the push leaves an error."""
    law = lqr(**at_the_point(trim=True))
    flight = flown(law)
    # the motion is linear only near the point: each period as the poles say, to a part in 1e2
    spectral = np.abs(law.poles).max()
    assert flight.position_error_m[0] > 60.0
    assert flight.position_error_m[-1] < 60.0 * 100.0 * spectral**200 + 1e-3
    loose = flown(lqr(**at_the_point()))
    assert 1.0 < loose.position_error_m[-1] < 1e3


def test_integral_action_takes_the_push_away() -> None:
    law = lqr(**at_the_point(integral_sizes=[3e3] * 3))
    assert law.gain.shape == (3, 9)
    assert np.abs(law.poles).max() < 1.0
    flight = flown(law, 400)
    assert flight.position_error_m[-1] < 0.01
    # the sums are those of the first three values seen, times the period
    y = np.arange(12.0).reshape(6, 2)
    u, sums = law.step(0, np.zeros(2), y, np.ones((6, 2)), law.initial(2))
    assert_allclose(sums, 60.0 * (y - 1.0)[:3], rtol=1e-14)
    assert_allclose(u, -law.gain[:, :6] @ (y - 1.0), rtol=1e-12)


def test_filter_and_regulator_by_a_recursion_of_the_covariance() -> None:
    """The Kalman filter's steady state is where its recursion ends."""
    keys = {
        **AXIS, "state_sizes": [10.0, 0.1], "control_sizes": [1e-3], "c": [[1.0, 0.0]],
        "control_noise": [1e-4], "measurement_sizes": [2.0],
    }  # fmt: skip
    law = lqg(**keys)
    a = np.array([[1.0, 60.0], [0.0, 1.0]])
    w = sampled_noise(np.array(AXIS["a"]), np.diag([0.0, 1e-8]), 60.0)
    p = 1e4 * np.eye(2)
    update = np.zeros((2, 1))
    for _ in range(500):
        p = a @ p @ a.T + w
        update = p[:, :1] / (p[0, 0] + 4.0)
        p = p - update @ p[:1]
    assert_allclose(law.update, update, rtol=1e-8)
    assert np.abs(law.poles).max() < 1.0
    # as regulator the same as without filter
    both = {k: keys[k] for k in ("a", "b", "state_sizes", "control_sizes")}
    assert_allclose(law.gain, lqr(**both).gain, rtol=1e-12)


def test_poles_of_the_loop_are_those_of_regulator_and_filter() -> None:
    """x⁺ = A x + B u with the law in the loop, column by column."""
    law = lqg(
        **AXIS, state_sizes=[10.0, 0.1], control_sizes=[1e-3], c=[[1.0, 0.0]],
        control_noise=[1e-4], measurement_sizes=[2.0],
    )  # fmt: skip
    h = 60.0
    a, b = np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]])
    columns = []
    for unit in np.eye(4):
        x, xc = unit[:2, None], unit[2:, None]
        u, after = law.step(0, np.zeros(1), x[:1], np.zeros((1, 1)), xc)
        columns.append(np.concatenate([a @ x + b @ u, after])[:, 0])
    poles = np.linalg.eigvals(np.array(columns).T)
    assert_allclose(np.sort_complex(poles), np.sort_complex(law.poles), rtol=1e-6, atol=1e-9)


def test_estimates_of_noisy_positions_make_quieter_commands() -> None:
    """Of the same noise: the filter knows the motion, the regulator takes what it sees."""
    noise = {"navigation": {"position_m": 5.0, "velocity_m_s": 0.05}}
    settings = at_the_point(trim=True)
    plain = flown(lqr(**settings), 300, **noise)
    filtered = flown(
        lqg(**settings, control_noise=[3e-5] * 3, measurement_sizes=[5.0] * 3 + [0.05] * 3),
        300, **noise,
    )  # fmt: skip
    late = slice(150, None)
    assert filtered.status == plain.status == "completed"
    assert (np.std(filtered.u[:, late], axis=1) < 0.5 * np.std(plain.u[:, late], axis=1)).all()
    assert np.abs(filtered.position_error_m[late]).mean() < plain.position_error_m[late].mean()


def test_what_does_not_fit_is_named() -> None:
    for keys, message in (
        ({**at_the_point(), "state_sizes": [1.0] * 4}, "state_sizes: 6 numbers are needed, got 4"),
        ({**at_the_point(), "point": {"position_m": [1.0]}}, "position_m: the plant has x, y, z"),
        ({**AXIS, "q": [[1, 0], [0, 1]], "r": [[1]], "integral_sizes": [1.0] * 3}, "3 of 2 states"),
    ):
        with pytest.raises(InputError, match=message):
            lqr(**keys)
    with pytest.raises(NotStabilisableError, match="do not reach"):
        lqr(a=[[0.1]], b=[[0.0]], q=[[1.0]], r=[[1.0]])
    law = lqr(**AXIS, q=[[1, 0], [0, 1]], r=[[1]])
    three = np.zeros((3, 1))
    with pytest.raises(InputError, match="made for 2 values, it sees 3"):
        law.step(0, np.zeros(1), three, three, law.initial(1))
    with pytest.raises(InputError, match="measurement_sizes: 6 values are seen, got 1"):
        lqg(**at_the_point(), control_noise=[1e-6] * 3, measurement_sizes=[1.0])
    with pytest.raises(InputError, match="control_noise: 3 numbers"):
        lqg(**at_the_point(), control_noise=[1e-6], measurement_sizes=[1.0] * 6)


GOOD = {**AXIS, "q": [[1, 0], [0, 1]], "r": [[1]]}


@pytest.mark.parametrize(
    ("type_", "keys", "message"),
    [
        ("lqr", {**GOOD, "plant": "hill"}, "either a plant, with a point, or the matrices"),
        ("lqr", {"q": [[1]], "r": [[1]]}, "either a plant"),
        ("lqr", {"plant": "hill", **SIZES}, "belong together"),
        ("lqr", {**GOOD, "trim": True}, "it needs the plant"),
        ("lqr", {**GOOD, "b": []}, "a and b belong together"),
        ("lqr", {**GOOD, "b": [[0.0]]}, "must be 2 × 1"),
        ("lqr", {**GOOD, "state_sizes": [1, 1]}, "one of q and state_sizes"),
        ("lqr", {**AXIS, "r": [[1]], "state_sizes": [1]}, "must have 2 entries"),
        ("lqr", {**GOOD, "q": [[1, 0]]}, "must be 2 × 2"),
        ("lqg", {**GOOD, "measurement_sizes": [1, 1]}, "one of w and control_noise"),
        (
            "lqg",
            {**GOOD, "control_noise": [1], "c": [[1, 0]], "measurement_sizes": [1, 1]},
            "must have 1 entries",
        ),
    ],
)
def test_bad_specs(type_: str, keys: dict[str, Any], message: str) -> None:
    spec = default_registry().get("compensator", type_).load_spec()
    with pytest.raises(InputError, match=message):
        validate(spec, {"period_s": 1, **keys}, where="here")
