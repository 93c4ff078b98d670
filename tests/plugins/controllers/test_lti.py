"""Controllers of a synthesis, of files and of matrices, flown."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, SynthesisedLaw
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.lti import LtiSystem
from hillsphere.plugins import default_registry, validate
from hillsphere.products import ControlDesign, load_product, save_product
from hillsphere.testing import RecordingContext, example
from hillsphere_controllers.full_order.mixed_sensitivity import mixed_sensitivity
from hillsphere_controllers.law_specs import LtiSpec
from hillsphere_controllers.lti import Lti
from hillsphere_controllers.systems.algebra import append, feedback, gain
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.exchange import save_mat
from hillsphere_controllers.systems.holding import zero_order_hold
from hillsphere_controllers.systems.weights import performance_weight
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

PERIOD = 10.0


def law(**keys: Any) -> Lti:
    table = {"period_s": PERIOD, **keys}
    return Lti(LtiSpec.model_validate({k: v.tolist() if isinstance(v, np.ndarray) else v
                                       for k, v in table.items()}))  # fmt: skip


def controller(seed: int = 1, dt_s: float | None = None) -> LtiSystem:
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(4, 4)) * 0.1 - 0.3 * np.eye(4), random.normal(size=(4, 6)),
        1e-5 * random.normal(size=(3, 4)), 1e-4 * random.normal(size=(3, 6)), dt_s,
    )  # fmt: skip


def commands(made: Lti, seen: Array, wanted: Array) -> Array:
    xc, found = made.initial(1), []
    for k, (y, ref) in enumerate(zip(seen, wanted, strict=True)):
        u, xc = made.step(k, np.zeros(1), y[:, None], ref[:, None], xc)
        found.append(u[:, 0])
    return np.array(found)


def by_steps(system: LtiSystem, inputs: Array) -> Array:
    x, found = np.zeros(system.order), []
    for e in inputs:
        found.append(system.c @ x + system.d @ e)
        x = system.a @ x + system.b @ e
    return np.array(found)


@pytest.mark.parametrize("method", ["bilinear", "held"])
def test_samples_of_a_controller_in_continuous_time(method: str) -> None:
    """Bilinear: the trapezoidal rule for states and inputs; held: exact for held inputs."""
    k = controller()
    made = law(method=method, a=k.a, b=k.b, c=k.c, d=k.d)
    e = np.random.default_rng(2).normal(size=(6, 6))
    found = commands(made, -e, np.zeros((6, 6)))
    if method == "held":
        assert_allclose(found, by_steps(zero_order_hold(k, PERIOD), e), rtol=1e-12)
        return
    # x(k+1) − x(k) = h/2 (ẋ(k) + ẋ(k+1)), so that x(0) is what half a step of e(0) brings about
    one, half = np.eye(4), 0.5 * PERIOD
    x = np.linalg.solve(one - half * k.a, half * k.b @ e[0])
    expected = [k.c @ x + k.d @ e[0]]
    for before, now in pairwise(e):
        right = x + half * (k.a @ x + k.b @ before + k.b @ now)
        x = np.linalg.solve(one - half * k.a, right)
        expected.append(k.c @ x + k.d @ now)
    assert_allclose(found, expected, rtol=1e-10)


def test_signs_of_error_and_deviation() -> None:
    k = controller(3, PERIOD)
    keys = {"form": "discrete", "a": k.a, "b": k.b, "c": k.c, "d": k.d}
    random = np.random.default_rng(4)
    seen, wanted = random.normal(size=(5, 6)), random.normal(size=(5, 6))
    assert_allclose(commands(law(**keys), seen, wanted), by_steps(k, wanted - seen), rtol=1e-12)
    turned = commands(law(sees="deviation", **keys), seen, wanted)
    assert_allclose(turned, by_steps(k, seen - wanted), rtol=1e-12)


def test_a_controller_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "controller.mat"
    save_mat(path, {"K": controller(), "G": np.eye(2)})
    e = np.random.default_rng(5).normal(size=(4, 6))
    zero = np.zeros((4, 6))
    k = controller()
    given = commands(law(a=k.a, b=k.b, c=k.c, d=k.d), -e, zero)
    assert_allclose(commands(law(file=str(path)), -e, zero), given, rtol=1e-14)
    with pytest.raises(InputError, match=r"no system 'G'; its systems: K"):
        law(file=str(path), variable="G")


def synthesised() -> ControlDesign:
    """On each axis 1/s² with a disturbance at its control, from the error of its position."""
    axis = transfer_function([1.0], [1.0, 0.0, 0.0])
    # time in units of 100 s, accelerations in units of 1e-4 m/s² of a metre
    design = mixed_sensitivity(axis, performance_weight(0.5, 2.0, 1e-2), 0.3, disturbance=0.3)
    k = design.controller
    slow = LtiSystem(k.a / 100.0, k.b / 100.0, 1e-4 * k.c, 1e-4 * k.d)
    return ControlDesign(append(slow, slow, slow))


def stage(**keys: Any) -> ClosedLoopStage:
    table: dict[str, Any] = {
        "plant": example("plant", "hill"), "target": {"position_m": [300e3, 0, 0]},
        "start": {"position_m": [300.1e3, 50.0, -20.0], "velocity_m_s": [0, 0, 0]},
        "samples": 200, "sees": ["x", "y", "z"], **keys,
    }  # fmt: skip
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec)


def test_the_controller_of_a_synthesis_is_flown(tmp_path: Path) -> None:
    """The flight waits for it; the product comes back from its file."""
    design = synthesised()
    save_product(tmp_path / "design.npz", design)
    again = load_product(tmp_path / "design.npz")
    assert isinstance(again, ControlDesign)
    waiting = law()
    assert isinstance(waiting, SynthesisedLaw)
    assert not waiting.complete
    flight = stage(law=waiting, needs={"controller": "synthesis"})
    flown = flight.run(RecordingContext(), controller=again)
    assert isinstance(flown, ClosedLoopFlight)
    assert not waiting.complete
    # near the loop of three double integrators that it was made for
    axis = zero_order_hold(transfer_function([1.0], [1.0, 0.0, 0.0]), PERIOD)
    whole = append(axis, axis, axis)
    sampled = law().flying(design.controller)
    assert sampled._controller is not None
    assert feedback(whole, LtiSystem(
        sampled._controller.a, sampled._controller.b, sampled._controller.c,
        sampled._controller.d, PERIOD,
    )).is_stable  # fmt: skip
    assert flown.status == "completed"
    assert flown.position_error_m[0] > 100.0
    assert flown.position_error_m[-1] < 20.0
    # repeated by a campaign: the nominal case without errors, in every lane
    block = CaseBatch(
        np.arange(64), np.zeros(64, dtype=np.int64), np.arange(64) > 0, (), np.zeros((0, 64)), 1,
        "campaign",
    )  # fmt: skip
    flight.prepare_cases((), controller=again)
    results = flight.run_cases(block, controller=again)
    assert_allclose(results.values[:, 0], flown.values, rtol=1e-9, atol=1e-12)
    # and another controller makes another flight
    weaker = ControlDesign(
        LtiSystem(again.controller.a, again.controller.b, 0.5 * again.controller.c,
                  0.5 * again.controller.d)
    )  # fmt: skip
    other = flight.run(RecordingContext(), controller=weaker)
    assert np.abs(other.u[:, 0] - 0.5 * flown.u[:, 0]).max() < 1e-12
    # as does one at which another search of the same synthesis ended
    both = ControlDesign(again.controller, others=(weaker.controller,))
    save_product(tmp_path / "both.npz", both)
    second = stage(law=waiting, needs={"controller": "synthesis"}, design=2)
    found = second.run(RecordingContext(), controller=load_product(tmp_path / "both.npz"))
    assert_array_equal(found.u, other.u)
    with pytest.raises(InputError, match="there is no design 2; the synthesis has 1"):
        second.run(RecordingContext(), controller=again)


def test_law_and_flight_must_agree_on_who_brings_the_controller() -> None:
    with pytest.raises(InputError, match=r"law: it has no controller"):
        stage(law=law())
    with pytest.raises(InputError, match=r"needs\.controller: the law has a controller"):
        stage(law=law(d=np.ones((3, 3))), needs={"controller": "synthesis"})
    with pytest.raises(InputError, match=r"needs\.controller: the law has a controller"):
        stage(law=example("compensator", "pid"), needs={"controller": "synthesis"})
    with pytest.raises(InputError, match="design: the law waits for no synthesis"):
        stage(law=example("compensator", "pid"), design=2)
    with pytest.raises(InputError, match="the law has no controller"):
        law().step(0, np.zeros(1), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((0, 1)))


def test_what_does_not_fit_is_named() -> None:
    made, three = law(d=np.ones((3, 6))), np.zeros((3, 1))
    with pytest.raises(InputError, match="the controller takes 6 values, the law sees 3"):
        made.step(0, np.zeros(1), three, three, made.initial(1))
    with pytest.raises(InputError, match="made for a period of 7 s"):
        law().flying(gain(np.eye(3), 7.0))
    spec = default_registry().get("compensator", "lti").load_spec()
    for keys, message in (
        ({"d": [[1.0]], "file": "k.mat"}, "keep one of the two"),
        ({"a": [[1.0]], "b": [[1.0]]}, "neither c nor d"),
        ({"d": [[1.0, 2.0], [1.0]]}, "must be 2 × 2"),
    ):
        with pytest.raises(InputError, match=message):
            validate(spec, {"period_s": 1, **keys}, where="here")
