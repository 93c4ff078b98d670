"""The motion near a point against Hill's equations and differences of the plant's own rates."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.dynamics import system
from hillsphere.errors import InputError
from hillsphere.testing import example
from hillsphere_controllers.linearisation import linearise_plant


def test_derivatives_are_those_of_the_plant() -> None:
    plant = example("plant", "hill")
    point, speed = [20e3, -5e3, 3e3], [1.0, 0.0, -2.0]
    found = linearise_plant(plant, point, speed)
    equations = system(plant, controls=True)
    rate = equations.function(*equations.rhs)
    x, u = np.array([*point, *speed]), np.zeros(3)
    assert_allclose(found.drift, rate(x, u), rtol=1e-12)
    for i in range(6):
        step = np.zeros(6)
        step[i] = 10.0 if i < 3 else 1e-3
        slope = (rate(x + step, u) - rate(x - step, u)) / (2.0 * step[i])
        assert_allclose(found.a[:, i], slope, rtol=1e-6, atol=1e-11)
    assert_allclose(found.b, np.vstack([np.zeros((3, 3)), np.eye(3)]), rtol=0, atol=1e-15)
    assert found.names == ("x", "y", "z", "vx", "vy", "vz")


def test_far_from_the_body_hill_without_gravity_is_left() -> None:
    """ẍ = 2 n ẏ + 3 n² x, ÿ = −2 n ẋ, z̈ = −n² z."""
    found = linearise_plant(example("plant", "hill"), [0.0, 1e9, 0.0])
    n = found.a[3, 4] / 2.0
    expected = np.zeros((6, 6))
    expected[:3, 3:] = np.eye(3)
    expected[3, 0], expected[3, 4], expected[4, 3], expected[5, 2] = (
        3 * n**2,
        2 * n,
        -2 * n,
        -(n**2),
    )
    assert_allclose(found.a, expected, rtol=1e-5, atol=1e-13)


def test_a_true_anomaly_counts_as_constant() -> None:
    """On an ellipse, where the moon is must be said; it is none of the deviations."""
    plant = example("plant", "three_body", 1)
    found = linearise_plant(plant, [20e3, 0.0, 0.0], [], {"true_anomaly": 1.0})
    assert found.a.shape == (6, 6)
    assert found.names == ("x", "y", "z", "vx", "vy", "vz")
    with pytest.raises(InputError, match=r"others: .* true_anomaly; got none"):
        linearise_plant(plant, [20e3, 0.0, 0.0])


def test_what_does_not_fit_the_plant_is_named() -> None:
    plant = example("plant", "hill")
    for arguments, message in (
        (([1.0, 2.0],), "position_m: the plant has x, y, z; got 2"),
        (([1e5, 0.0, 0.0], [1.0]), "velocity_m_s: the plant has vx, vy, vz; got 1"),
        (([1e5, 0.0, 0.0], [], {"anomaly": 1.0}), "others: .* none; got anomaly"),
    ):
        with pytest.raises(InputError, match=message):
            linearise_plant(plant, *arguments)
