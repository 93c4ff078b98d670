"""Controllers of a synthesis whose states move between samples, with filters before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag, expm

from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array, Parameter, Scales, SynthesisedLaw, Variable
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.products import ControlDesign
from hillsphere.simulation import ContinuousLaw, KnownPoles
from hillsphere.symbolic import Expr, Params
from hillsphere.testing import RecordingContext
from hillsphere_controllers.law_specs import LtiSpec
from hillsphere_controllers.lti import ContinuousLti, Lti, lti
from hillsphere_controllers.systems.algebra import series
from hillsphere_controllers.systems.holding import zero_order_hold
from hillsphere_flight.closed_loop import ClosedLoopStage
from hillsphere_flight.specs import ClosedLoopSpec

PERIOD, CORNER = 60.0, 2 * np.pi * 0.05
SIGNALS = tuple(f"{name}[{i}]" for name in ("r_cmd", "r_hat", "v_hat") for i in range(3))
START = [0.0, 200.0, -100.0], [0.1, 0.0, -0.2]


class Free:
    """Three double integrators."""

    frame = "toy:inertial"
    states = (
        *(Variable(n, 1) for n in ("x", "y", "z")),
        *(Variable(n, 1, -1) for n in ("vx", "vy", "vz")),
    )
    controls = tuple(Variable(n, 1, -2) for n in ("ax", "ay", "az"))
    scales = Scales(100.0, 100.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (*x[3:6], *u)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


def law(**keys: Any) -> Any:
    table = {"period_s": PERIOD, "sees": "deviation", **keys}
    spec = validate(LtiSpec, table, where="test")
    assert isinstance(spec, LtiSpec)
    return lti(spec)


def structured(kp: float = 4e-5, kd: float = 0.011) -> LtiSystem:
    """Three controllers of order one, each of one command, one position and one velocity."""
    parts = []
    for k in (0.9, 1.0, 1.1):
        a, b = np.array([[-1e-4]]), np.array([[-1e-2, 1e-2, 0.0]])
        c, d = np.array([[-3e-6 * k]]), k * np.array([[kp, -kp, -kd]])
        parts.append((a, b, c, d))
    order = np.arange(9).reshape(3, 3).T.ravel()  # r_cmd, r_hat, v_hat of each axis
    a, b, c, d = (block_diag(*m) for m in zip(*parts, strict=True))
    place = np.argsort(order)
    return LtiSystem(a, b[:, place], c, d[:, place], None, SIGNALS, ("a[0]", "a[1]", "a[2]"))


def stage(made: Any, **keys: Any) -> ClosedLoopStage:
    table = {
        "plant": Free(), "law": made, "needs": {"controller": "synthesis"},
        "target": {"position_m": [0, 0, 0]},
        "start": {"position_m": START[0], "velocity_m_s": START[1]}, "samples": 12, **keys,
    }  # fmt: skip
    spec = validate(ClosedLoopSpec, table, where="test")
    assert isinstance(spec, ClosedLoopSpec)
    return ClosedLoopStage(spec)


def seen_part(k: LtiSystem) -> LtiSystem:
    return LtiSystem(k.a, k.b[:, 3:], k.c, k.d[:, 3:])


def filtered(k: LtiSystem) -> LtiSystem:
    one = np.eye(6)
    return series(LtiSystem(-CORNER * one, CORNER * one, one, 0 * one), k)


def test_between_samples_it_is_the_exact_solution() -> None:
    """Plant, filters and controller are linear: one matrix exponential per period."""
    made = law(states="continuous", low_pass_hz=0.05, measurements=["r_hat", "v_hat"])
    assert isinstance(made, SynthesisedLaw)
    assert isinstance(made, ContinuousLaw)
    assert not made.complete
    design = ControlDesign(structured())
    flown = stage(made, substeps=24).run(RecordingContext(), controller=design)
    assert flown.status == "completed"
    k = filtered(seen_part(design.controller))
    n = 6 + k.order
    a = np.zeros((n + 6, n + 6))
    a[:3, 3:6], a[3:6, 6:n] = np.eye(3), k.c
    a[6:n, 6:n], a[6:n, n:] = k.a, k.b
    period, state = expm(a * PERIOD), np.concatenate([*START, np.zeros(k.order)])
    for sample in range(12):
        assert_allclose(flown.x[:, sample], state[:6], rtol=0, atol=1e-8)
        assert_allclose(flown.own[:, sample], k.c @ state[6:], rtol=0, atol=1e-11)
        state = (period @ np.concatenate([state, state[:6]]))[:n]
    assert_allclose(flown.x[:, -1], state[:6], rtol=0, atol=1e-8)
    assert_array_equal(flown.u, flown.own)
    # it is a loop that works, and its Δv that of what it commands
    assert flown.position_error_m[-1] < 0.2 * flown.position_error_m[0]
    assert flown.dv_m_s[-1] > 0.1
    values = dict(zip(flown.metrics, flown.values, strict=True))
    assert_allclose(values["largest_command"], np.linalg.norm(flown.own, axis=0).max(), rtol=1e-12)


def test_at_samples_it_is_the_exact_discretisation_of_the_chain() -> None:
    made = law(method="held", low_pass_hz=0.05, measurements=["r_hat", "v_hat"])
    assert isinstance(made, Lti)
    flying = made.flying(structured())
    wanted = zero_order_hold(filtered(seen_part(structured())), PERIOD)
    assert isinstance(flying, Lti)
    for name in "abcd":
        assert_allclose(getattr(flying.controller, name), getattr(wanted, name), rtol=1e-14)
    y = np.random.default_rng(1).normal(size=(6, 4))
    xc = np.random.default_rng(2).normal(size=(wanted.order, 4))
    u, after = flying.step(0, np.zeros(4), y, np.zeros((6, 4)), xc)
    assert_allclose(u, wanted.c @ xc + wanted.d @ y, rtol=1e-12)
    assert_allclose(after, wanted.a @ xc + wanted.b @ y, rtol=1e-12)


def test_the_mean_over_a_period_has_the_same_dv() -> None:
    """The first flight is exact between samples; the same ∫u of each period moves it little."""
    keys = {"low_pass_hz": 0.05, "measurements": ["r_hat", "v_hat"]}
    design = ControlDesign(structured())
    made = law(method="mean", **keys).flying(structured())
    inside = law(states="continuous", **keys)
    chain = filtered(seen_part(structured()))
    n = chain.order
    a = np.zeros((n + 9, n + 9))
    a[:n, :n], a[:n, n : n + 6] = chain.a, chain.b
    a[n + 6 :, :n], a[n + 6 :, n : n + 6] = chain.c, chain.d
    z = np.random.default_rng(5).normal(size=n + 6)
    over = expm(a * PERIOD) @ np.concatenate([z, np.zeros(3)])
    u, xc = made.step(0, np.zeros(1), z[n:, None], np.zeros((6, 1)), z[:n, None])
    assert_allclose(u[:, 0], over[n + 6 :] / PERIOD, rtol=1e-10)
    assert_allclose(xc[:, 0], over[:n], rtol=1e-12)
    ends = [
        stage(one, substeps=24, samples=40).run(RecordingContext(), controller=design)
        for one in (law(method="mean", **keys), inside)
    ]
    apart = np.linalg.norm(ends[0].x[:3] - ends[1].x[:3], axis=0)
    assert apart.max() < 0.05 * ends[0].position_error_m[0]
    # the exact discretisation begins a period later, and is far from it
    late = stage(law(method="held", **keys), samples=40).run(RecordingContext(), controller=design)
    far = np.linalg.norm(late.x[:3] - ends[1].x[:3], axis=0)
    assert far.max() > 5 * apart.max()


def test_inputs_of_a_controller_by_name() -> None:
    k = structured()
    y = np.random.default_rng(3).normal(size=(6, 2))
    zero = np.zeros((6, 2))

    def command(**keys: Any) -> Array:
        made = law(method="held", **keys).flying(k)
        u, _ = made.step(0, np.zeros(2), y, zero, made.initial(2))
        return np.asarray(u)

    plain = command(measurements=["r_hat", "v_hat"])
    assert_allclose(plain, k.d[:, 3:] @ y, rtol=1e-13)
    turned = command(measurements=["v_hat", "r_hat"])
    assert_allclose(turned, k.d[:, [6, 7, 8, 3, 4, 5]] @ y, rtol=1e-13)
    single = command(measurements=["r_hat[2]", "r_cmd", "v_hat[0]", "v_hat[1]"])
    assert_allclose(single, k.d[:, [5, 0, 1, 2, 6, 7]] @ y, rtol=1e-13)
    with pytest.raises(InputError, match=r"measurements: no signal 'r_hut'; .*r_hat"):
        law(measurements=["r_hut"]).flying(k)
    with pytest.raises(InputError, match="the signals have no names"):
        law(measurements=["r_hat"]).flying(replace(k, inputs=()))


def test_signs_of_error_and_deviation() -> None:
    keys = {"d": structured().d[:, 3:].tolist(), "low_pass_hz": 0.05, "states": "continuous"}
    flights = [
        stage(law(sees=sees, **keys), needs={}, substeps=24, samples=3).run(RecordingContext())
        for sees in ("deviation", "error")
    ]
    # the second is the same loop with the wrong sign
    assert_allclose(flights[0].own[:, 1], -flights[1].own[:, 1], rtol=1e-3)
    assert flights[0].position_error_m[-1] < flights[1].position_error_m[-1]


def test_sub_steps_must_fit_the_filter() -> None:
    made = law(states="continuous", low_pass_hz=0.05, measurements=["r_hat", "v_hat"])
    flying = made.flying(structured())
    assert isinstance(flying, KnownPoles)
    assert_allclose(flying.fastest_rad_s, CORNER, rtol=1e-12)
    design = ControlDesign(structured())
    with pytest.raises(InputError, match=r"0\.3142 1/s, requires dop853 .* 11\.14 s .* at least 6"):
        stage(made, substeps=5).run(RecordingContext(), controller=design)
    with pytest.raises(InputError, match="requires rk6"):
        stage(made, substeps=17, method="rk6").run(RecordingContext(), controller=design)
    found = [
        stage(made, substeps=n).run(RecordingContext(), controller=design).end_x for n in (6, 48)
    ]
    assert_allclose(found[0][:3], found[1][:3], rtol=0, atol=0.05)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"states": "continuous", "form": "discrete", "d": [[1.0]]}, "need form = 'continuous'"),
        ({"states": "continuous", "method": "held"}, "not brought to samples"),
        ({"low_pass_hz": 0.05}, "ring from sample"),
        ({"low_pass_hz": 0.05, "form": "discrete", "d": [[1.0]]}, "belongs into its matrices"),
        ({"measurements": ["r"], "d": [[1.0]]}, "have no names"),
    ],
)
def test_what_does_not_go_together(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(HillsphereError, match=message):
        law(**keys)


def test_a_discrete_controller_has_no_continuous_states() -> None:
    discrete = LtiSystem(
        np.zeros((0, 0)), np.zeros((0, 6)), np.zeros((3, 0)), np.ones((3, 6)), 60.0
    )
    with pytest.raises(
        InputError, match="states = 'continuous': the controller is one in discrete"
    ):
        law(states="continuous").flying(discrete)
    with pytest.raises(InputError, match="low_pass_hz: the controller is one in discrete"):
        law(low_pass_hz=0.05, method="held").flying(discrete)
    waiting = law(states="continuous")
    assert isinstance(waiting, ContinuousLti)
    with pytest.raises(InputError, match="the law has no controller"):
        waiting.initial(1)
