"""Several sensors as one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.sensor_suite import SensorSuite

COUNT = 50


def sensors(**keys: Any) -> list[Any]:
    return [
        create("sensor", "inter_satellite", partner=2, sun_cone_deg=60, **keys),
        create("sensor", "sun_sensor", dropout_probability=0.5),
        create("sensor", "inter_satellite", spacecraft=2, partner=1, angles=False),
    ]


def world() -> tuple[Array, Array, dict[str, Array]]:
    x = np.random.default_rng(1).normal(size=(12, COUNT)) * 1e3
    return x, np.zeros(COUNT), {"sun": np.array([[-1e11], [0.0], [0.0]])}


def numbers(suite: SensorSuite) -> tuple[Array, Array]:
    random = np.random.default_rng(2)
    return random.normal(size=(suite.draws[0], COUNT)), random.normal(size=(suite.draws[1], COUNT))


def test_rows_follow_one_another() -> None:
    x, t, scene = world()
    suite = SensorSuite(sensors())
    assert suite.rows == 7
    assert [len(block) for block in suite.blocks] == [3, 1, 1]
    first, second, third = suite.sensors
    shown = suite.observe(x, t, scene)
    np.testing.assert_array_equal(shown[:3], first.observe(x, t, scene))
    np.testing.assert_array_equal(shown[3:6], second.observe(x, t, scene))
    np.testing.assert_array_equal(shown[6], shown[0])
    np.testing.assert_array_equal(suite.sigma(x, t, scene)[6], third.sigma(x, t, scene)[0])


def test_set_of_measurements() -> None:
    x, t, scene = world()
    suite = SensorSuite(sensors())
    constant, noise = numbers(suite)
    found = suite.measurements(x, t, scene, constant, noise)
    visible = suite.visible(x, t, scene)
    assert not (found.present & ~visible).any()
    assert found.present[3:6].all(axis=0).sum() == found.present[3:6].any(axis=0).sum()
    assert 0.2 < found.present[3].mean() < 0.8
    np.testing.assert_array_equal(found.present[:3], visible[:3])
    # a sensor alone, with its own part of the numbers, measures the same
    alone = suite.sensors[2].measure(x, t, scene, constant[5:], noise[9:])
    np.testing.assert_array_equal(found.values[6], alone[0])
    stated = suite.measurements(x, t, scene, constant, noise, np.ones((7, 1)))
    np.testing.assert_array_equal(stated.sigma, np.ones((7, COUNT)))


def test_refused() -> None:
    x, t, scene = world()
    with pytest.raises(InputError, match="at least one"):
        SensorSuite([])
    with pytest.raises(InputError, match="got a str"):
        SensorSuite(["camera"])  # type: ignore[list-item]
    suite = SensorSuite(sensors())
    with pytest.raises(InputError, match="takes 6 constant and 12"):
        suite.measure(x, t, scene, np.zeros((3, COUNT)), np.zeros((3, COUNT)))
