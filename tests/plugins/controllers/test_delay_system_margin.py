"""Delay margins: proved bounds about the values that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere_controllers.analysis.margins import loop_margins
from hillsphere_controllers.delays.algebra import delay
from hillsphere_controllers.delays.margin import delay_margin
from hillsphere_controllers.systems.conversion import transfer_function

INTEGRATOR = transfer_function([1.0], [1.0, 0.0])
LAG = transfer_function([1.0], [1.0, 1.0])


def test_integrator() -> None:
    """With e^{-0.5 s}/s, π/2 − 0.5 s are left."""
    made = delay_margin(delay(0.5) @ INTEGRATOR, 10.0)
    exact = 0.5 * np.pi - 0.5
    assert made.lower_s < exact < made.upper_s <= made.lower_s * 1.001
    assert made.reason == ""


def test_classical_margin_lies_between_the_bounds() -> None:
    loop = transfer_function([4.0, 2.0], [0.1, 1.2, 2.1, 1.0]) * 3.0
    (classical,) = loop_margins(loop)
    made = delay_margin(loop, 10.0)
    assert made.lower_s < classical.delay_s < made.upper_s <= made.lower_s * 1.001


def test_no_margin_and_no_limit() -> None:
    assert delay_margin(delay(2.0) @ INTEGRATOR, 1.0).upper_s == 0.0
    made = delay_margin(LAG * 0.9, 30.0)
    assert (made.lower_s, made.upper_s) == (30.0, np.inf)
    # with a direct term of 1.5 any delay makes a chain of poles unstable
    direct = delay_margin(LAG + 1.5, 1.0)
    assert direct.lower_s == 0.0
    assert "direct terms" in direct.reason


def test_faults() -> None:
    with pytest.raises(InputError, match="as many outputs"):
        delay_margin(np.ones((2, 1)) @ LAG, 1.0)
    with pytest.raises(InputError, match="longest delay"):
        delay_margin(LAG, 0.0)
