from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.weights import (
    on_every_channel,
    performance_weight,
    shelving_weight,
)


def gains(weight: LtiSystem, *omega: float) -> np.ndarray:
    return np.abs(weight.response(np.array(omega))[:, 0, 0])


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.floats(1e-4, 1e4), st.floats(1e-4, 1e4), st.floats(0.01, 0.99), st.floats(1e-3, 1e3),
    st.integers(1, 4), st.booleans(),
)  # fmt: skip
def test_three_gains_are_met(
    low: float, high: float, share: float, omega: float, order: int, sampled: bool
) -> None:
    """At zero frequency, at infinity or half the sampling rate, and at the one given."""
    if max(low, high) < 1.01 * min(low, high):
        high = 2.0 * low
    gain = float(low ** (1.0 - share) * high**share)
    dt = 0.7 * np.pi / omega if sampled else None
    weight = shelving_weight(low, high, omega, gain, order=order, dt_s=dt)
    last = np.inf if dt is None else np.pi / dt
    assert weight.is_stable
    assert weight.order == order
    assert_allclose(gains(weight, 0.0, omega, last), [low, gain, high], rtol=1e-6)


def test_makeweight_of_first_order() -> None:
    """Gains from 100 to 0.5, one at 20 rad/s."""
    low, high, omega = 100.0, 0.5, 20.0
    p = omega * np.sqrt((1.0 - high**2) / (low**2 - 1.0))
    s = 1j * np.array([0.1, 3.0, 70.0])
    expected = (high * s + low * p) / (s + p)
    made = shelving_weight(low, high, omega).response(s.imag)[:, 0, 0]
    assert_allclose(made, expected, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_performance_weight(order: int) -> None:
    m, omega, a = 1.5, 10.0, 1e-4
    s = 1j * np.array([0.0, 1e-3, 0.5, 10.0, 1e4])
    root = 1.0 / order
    expected = ((s / m**root + omega) / (s + omega * a**root)) ** order
    weight = performance_weight(omega, m, a, order=order)
    assert_allclose(weight.response(s.imag)[:, 0, 0], expected, rtol=1e-10)


def test_on_every_channel() -> None:
    one = shelving_weight(10.0, 0.1, 2.0)
    three = on_every_channel(one, 3).response(np.array([1.0]))[0]
    assert_allclose(three, np.eye(3) * one.response(np.array([1.0]))[0, 0, 0], rtol=1e-14)
    with pytest.raises(InputError, match="1 × 1"):
        on_every_channel(on_every_channel(one, 2), 2)


def test_what_makes_no_weight_is_refused() -> None:
    for arguments, message in (
        ((10.0, 2.0, 1.0), "between"),
        ((np.inf, 0.1, 1.0), "integrator"),
        ((10.0, 0.1, -1.0), "frequency"),
    ):
        with pytest.raises(InputError, match=message):
            shelving_weight(*arguments)
    with pytest.raises(InputError, match="half the sampling rate"):
        shelving_weight(10.0, 0.1, 40.0, dt_s=0.1)
    with pytest.raises(InputError, match="order"):
        shelving_weight(10.0, 0.1, 4.0, order=0)
    with pytest.raises(InputError, match="steady_error"):
        performance_weight(1.0, 2.0, 0.0)
    with pytest.raises(InputError, match="bandwidth"):
        performance_weight(0.0)
