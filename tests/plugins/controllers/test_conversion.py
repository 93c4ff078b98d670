from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import cont2discrete

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import gain, series
from hillsphere_controllers.systems.conversion import from_control, to_control, transfer_function
from hillsphere_controllers.systems.holding import zero_order_hold

OMEGA = np.array([0.0, 0.7, 20.0])


def system(dt_s: float | None = None) -> LtiSystem:
    random = np.random.default_rng(0)
    return LtiSystem(
        0.5 * random.normal(size=(3, 3)), random.normal(size=(3, 2)), random.normal(size=(2, 3)),
        random.normal(size=(2, 2)), dt_s, ("u", "v"), ("y", "z"), ("a", "b", "c"),
    )  # fmt: skip


def test_transfer_function() -> None:
    made = transfer_function([0.0, 2.0, 3.0, 1e4], [4.0, 1.0, 5e3])
    with pytest.raises(InputError, match="not proper"):
        transfer_function([1.0, 0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InputError, match="zero"):
        transfer_function([1.0], [0.0])
    s = 1j * OMEGA
    expected = (2.0 * s**2 + 3.0 * s + 1e4) / (4.0 * s**2 + s + 5e3)
    assert_allclose(made.response(OMEGA)[:, 0, 0], expected, rtol=1e-12)
    assert transfer_function([3.0], [2.0]).d == 1.5
    assert transfer_function([1.0], [1.0, 0.5], dt_s=0.1).dt_s == 0.1


@pytest.mark.parametrize("dt_s", [None, 0.25])
def test_python_control_and_back(dt_s: float | None) -> None:
    pytest.importorskip("control", reason="python-control is not installed")
    given = system(dt_s)
    there = to_control(given)
    back = from_control(there)
    for name in "abcd":
        assert_allclose(getattr(back, name), getattr(given, name), rtol=0.0)
    assert (back.dt_s, back.inputs, back.outputs, back.states) == (
        dt_s, given.inputs, given.outputs, given.states,
    )  # fmt: skip
    at = 1j * OMEGA if dt_s is None else np.exp(1j * OMEGA * dt_s)
    assert_allclose(np.moveaxis(there(at), 2, 0), given.response(OMEGA), rtol=1e-10)
    assert from_control(to_control(gain(np.ones((1, 2))))).shape == (1, 2)


def test_other_objects_of_python_control() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    lag = from_control(control.tf([2.0], [1.0, 3.0]))
    assert_allclose(lag.response(np.array([1.0]))[0, 0, 0], 2.0 / (3.0 + 1j), rtol=1e-14)
    with pytest.raises(InputError, match="sampling period"):
        from_control(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], True))
    with pytest.raises(InputError, match="got ndarray"):
        from_control(np.eye(2))
    with pytest.raises(InputError, match="not proper"):
        from_control(control.tf([1.0, 0.0, 0.0], [1.0, 1.0]))


def test_hold_against_scipy() -> None:
    given = system()
    a, b, c, d, _ = cont2discrete((given.a, given.b, given.c, given.d), 0.4)
    made = zero_order_hold(given, 0.4)
    for mine, other in ((made.a, a), (made.b, b), (made.c, c), (made.d, d)):
        assert_allclose(mine, other, rtol=1e-12)
    assert made.states == given.states


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4, 0.55, 0.8, 1.3])
def test_hold_and_delay_against_exact_steps(delay: float) -> None:
    """ẋ = −x + u: piecewise exponential between the changes of u, followed one by one."""
    dt, steps = 0.4, 12
    u = np.random.default_rng(1).normal(size=steps)
    made = zero_order_hold(LtiSystem(-np.eye(1), np.eye(1), np.eye(1), 0.5 * np.eye(1)), dt, delay)
    x, seen = np.zeros(made.order), []
    for value in u:
        seen.append(float((made.c @ x + made.d @ [value])[0]))
        x = made.a @ x + made.b @ [value]

    def at(t: float) -> float:
        """Return the state by superposition of the held inputs."""
        total = 0.0
        for k, value in enumerate(u):
            start, end = k * dt + delay, (k + 1) * dt + delay
            if t > start:
                total += value * (np.exp(-(t - min(t, end))) - np.exp(-(t - start)))
        return total

    for k in range(steps):
        # the input that acts just before or, without a part of a period, at the sample
        now = int(np.floor((k * dt - delay) / dt + 1e-9))
        direct = 0.5 * u[now] if now >= 0 else 0.0
        assert_allclose(seen[k], at(k * dt) + direct, rtol=0, atol=1e-12)


def test_hold_refuses() -> None:
    with pytest.raises(InputError, match="discrete time already"):
        zero_order_hold(system(0.1), 0.1)
    with pytest.raises(InputError, match="sampling period"):
        zero_order_hold(system(), 0.0)
    with pytest.raises(InputError, match="delay"):
        zero_order_hold(system(), 0.1, -1.0)


def test_delay_has_unit_gain_and_its_phase() -> None:
    delayed = zero_order_hold(gain(np.eye(1)), 0.2, 0.6)
    response = delayed.response(np.array([1.0, 5.0]))[:, 0, 0]
    assert_allclose(response, np.exp(-0.6j * np.array([1.0, 5.0])), rtol=1e-13)
    assert series(delayed, delayed).order == 6
