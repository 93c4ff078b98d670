"""A delay as a rational function: gain one, and the right phase up to about its order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere_controllers.systems.delay import pade_delay


def test_first_order_is_the_bilinear_one() -> None:
    made = pade_delay(30.0)
    omega = np.array([0.0, 0.01, 0.1, 10.0])
    s = 1j * omega
    assert_allclose(made.response(omega)[:, 0, 0], (1 - 15 * s) / (1 + 15 * s), rtol=1e-14)


@pytest.mark.parametrize("order", range(1, 9))
def test_gain_is_one_and_the_phase_right_at_low_frequency(order: int) -> None:
    made = pade_delay(2.0, order)
    assert made.is_stable
    omega = np.logspace(-2, 2, 40)
    response = made.response(omega)[:, 0, 0]
    assert_allclose(np.abs(response), 1.0, rtol=0.0, atol=1e-9)
    # the error is of the order 2 N + 1 of ω T
    small = omega[omega * 2.0 < 0.5 * order]
    error = np.abs(response[: small.size] - np.exp(-2j * small))
    assert error.max() < 0.05 * 0.6 ** (2 * order)


@pytest.mark.parametrize(("time_s", "order"), [(0.0, 1), (np.inf, 1), (1.0, 0), (1.0, 9)])
def test_faults(time_s: float, order: int) -> None:
    with pytest.raises(InputError, match="delay"):
        pade_delay(time_s, order)
