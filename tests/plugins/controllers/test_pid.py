"""PID: its difference equations, its limits, and the loop on a double integrator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.plugins import default_registry, validate
from hillsphere.simulation import Cases, simulate
from hillsphere.symbolic import Expr, Params
from hillsphere_controllers.pid import Pid
from hillsphere_controllers.specs import PidSpec


class Axis:
    """A double integrator with a constant push."""

    frame = "hill:toy"
    states = (Variable("x", 1), Variable("v", 1, -1))
    controls = (Variable("a", 1, -2),)
    scales = Scales(1.0, 1.0)

    def __init__(self, push: float = 0.0) -> None:
        self.push = push

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] + self.push)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


def pid(**keys: Any) -> Pid:
    return Pid(PidSpec.model_validate({"period_s": 2.0, "proportional": [0.02], **keys}))


def test_the_loop_on_a_double_integrator_is_a_power_of_a_matrix() -> None:
    # States x, v, I with u = −(Kp x + I + Kd v), held over h: the exact discrete system.
    kp, ki, kd, h, push = 0.02, 1e-3, 0.2, 2.0, 0.3
    law = pid(integral=[ki], derivative=[kd])
    held = np.array([[h * h / 2], [h], [0.0]])
    free = np.array([[1.0, h, 0.0], [0.0, 1.0, 0.0], [h * ki, 0.0, 1.0]])
    step = free - held @ np.array([[kp, kd, 1.0]])
    affine = np.block([[step, held * push], [np.zeros((1, 3)), np.ones((1, 1))]])
    exact = np.linalg.matrix_power(affine, 60) @ np.array([1.0, 0.5, 0.0, 1.0])
    flights = simulate(Axis(push), law, Cases([[1.0], [0.5]]), 60)
    assert_allclose(flights.x[:, 0], exact[:2], rtol=0, atol=1e-13)


def test_integral_action_removes_the_offset() -> None:
    def end(**keys: Any) -> float:
        law = pid(derivative=[0.2], **keys)
        return float(simulate(Axis(0.3), law, Cases([[1.0], [0.5]]), 1000).x[0, 0])

    assert_allclose(end(), 0.3 / 0.02, rtol=1e-9)
    assert_allclose(end(integral=[1e-3]), 0.0, rtol=0, atol=1e-9)


def stepped(law: Pid, errors: list[float], rates: list[float] | None = None) -> Array:
    """Commands for a sequence of errors."""
    xc, found = law.initial(1), []
    for k, e in enumerate(errors):
        y = np.array([[e], [rates[k] if rates else 0.0]])
        u, xc = law.step(k, np.array([2.0 * k]), y, np.zeros((2, 1)), xc)
        found.append(float(u[0, 0]))
    return np.array(found)


def test_rate_from_positions_is_the_difference_of_two_samples() -> None:
    found = stepped(pid(derivative=[0.2], rate="position"), [1.0, 3.0, 2.0])
    assert_allclose(found, [-0.02, -(0.06 + 0.2 * 1.0), -(0.04 - 0.2 * 0.5)])


def test_derivative_filter_is_the_backward_difference() -> None:
    # D_k = (Tf D + h Kd v) / (Tf + h), with Tf = 6, h = 2: a quarter of the way each time.
    law = pid(derivative=[0.2], derivative_filter_s=6.0)
    found = stepped(law, [0.0] * 3, [1.0, 1.0, 1.0])
    assert_allclose(found, [-0.2 * (1 - 0.75 ** (k + 1)) for k in range(3)])


def test_commands_are_cut_and_the_integral_does_not_wind_up() -> None:
    keys = {"integral": [0.01], "derivative": [0.2], "maximum_m_s2": 0.05}
    long = [10.0] * 50
    cut = stepped(pid(**keys), [*long, -1.0])
    assert_array_equal(cut[:50], -0.05)
    # With tracking in one period I stays at the limit, 0.05: −(Kp e + I) = −(−0.02 + 0.05).
    assert_allclose(cut[50], -0.03, rtol=1e-13)
    slow = stepped(pid(**keys, tracking_time_s=1e9), [*long, -1.0])
    assert slow[50] == -0.05


def test_axes_have_their_own_gains() -> None:
    law = Pid(PidSpec(period_s=1.0, proportional=(1.0, 2.0), derivative=(3.0, 4.0)))
    y = np.array([[1.0], [1.0], [0.5], [0.25]])
    u, _ = law.step(0, np.zeros(1), y, np.zeros((4, 1)), law.initial(1))
    assert_allclose(u[:, 0], [-2.5, -3.0])


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(InputError, match="needs 2 rows"):
        pid().step(0, np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((3, 1)))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"integral": [1.0, 2.0]}, "one gain per axis, 1, got 2"),
        ({"period_s": 0}, "must be > 0"),
        ({"maximum_m_s2": -1}, "must be > 0"),
        ({"proportional": []}, "proportional"),
    ],
)
def test_bad_specs(keys: dict[str, Any], message: str) -> None:
    spec = default_registry().get("compensator", "pid").load_spec()
    with pytest.raises(InputError, match=message):
        validate(spec, {"period_s": 2, "proportional": [0.1], **keys}, where="here")
