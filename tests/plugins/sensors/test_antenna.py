"""The antenna: where it looks, how large its errors are, and that cases keep their numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Sensor
from hillsphere.plugins import validate
from hillsphere_sensors.antenna import Antenna
from hillsphere_sensors.antenna_specs import AntennaSpec
from hillsphere_tracking.recording import draw_constants, record

ALCANTARA = {
    "station": "Alcantara",
    "latitude_deg": -2.18,
    "longitude_deg": -44.26,
    "height_m": 39.0,
}
FIXED = {"earth_fixed": np.eye(3)[:, :, None]}
SILENT = {
    "azimuth_noise_deg": [0, 0, 0],
    "elevation_noise_deg": [0, 0, 0],
    "azimuth_bias_deg": [0, 0, 0],
    "elevation_bias_deg": [0, 0, 0],
}


def antenna(**keys: Any) -> Antenna:
    spec = validate(AntennaSpec, ALCANTARA | keys, where="sensor 'antenna'")
    assert isinstance(spec, AntennaSpec)
    made = Antenna(spec)
    assert isinstance(made, Sensor)
    return made


def towards(sensor: Antenna, azimuth_deg: Any, elevation_deg: Any, range_m: Any = 1e6) -> Array:
    """Earth-fixed positions (3, N) in given directions."""
    a, h, rho = np.broadcast_arrays(
        np.radians(azimuth_deg), np.radians(elevation_deg), np.asarray(range_m, dtype=float)
    )
    local = np.array([np.sin(a) * np.cos(h), np.cos(a) * np.cos(h), np.sin(h)]) * rho
    fixed = sensor.station.axes.T @ np.atleast_2d(local.reshape(3, -1))
    return np.asarray(fixed + sensor.station.ecef_m[:, None])


def test_true_angles() -> None:
    sensor = antenna()
    azimuth, elevation = np.array([1.0, 90.0, 200.0, 359.0]), np.array([5.1, 89.9, -10.0, 45.0])
    seen = sensor.observe(towards(sensor, azimuth, elevation), np.zeros(4), FIXED)
    assert_allclose(np.degrees(seen), [azimuth, elevation], rtol=0.0, atol=1e-9)
    assert sensor.visible(towards(sensor, azimuth, elevation), np.zeros(4), FIXED).tolist() == [
        True,
        True,
        False,
        True,
    ]


def test_states_are_turned_as_the_scene_says() -> None:
    sensor = antenna()
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    inertial = turn.T @ towards(sensor, 120.0, 30.0)
    seen = sensor.observe(inertial, np.zeros(1), {"earth_fixed": turn[:, :, None]})
    assert_allclose(np.degrees(seen[:, 0]), [120.0, 30.0], rtol=0.0, atol=1e-9)


def test_sizes_of_the_errors_kuga_1990() -> None:
    # Table 2: largest biases 0.06-0.07 and 0.17-0.18 deg on passes that begin at 5 deg.
    sensor = antenna(mask_elevation_deg=0)
    x = towards(sensor, [10.0, 10.0], [5.0, 46.8], [2.5e6, 1.0e6])
    none = np.zeros((6, 2)), np.zeros((6, 2))
    bias = sensor.measure(x, np.zeros(2), FIXED, *none) - sensor.observe(x, np.zeros(2), FIXED)
    assert_allclose(np.degrees(bias[:, 0]), [0.0625478, 0.1757742], rtol=0.0, atol=1e-7)
    cosine = np.cos(np.radians(46.8))
    assert_allclose(np.degrees(bias[0, 1]), 0.05 + 0.011 / cosine, rtol=0.0, atol=1e-9)
    # with the defaults the noise has the biases' size
    assert_allclose(sensor.sigma(x, np.zeros(2), FIXED), bias, rtol=0.0, atol=1e-12)


def test_noise_has_its_standard_deviation() -> None:
    sensor = antenna(bias_sigma_deg=[0.3, 0.2])
    x = towards(sensor, np.full(20, 123.0), np.full(20, 30.0))[:, :, None]
    shown = record(sensor, x, np.arange(20.0), FIXED, seed=3, stage="s", cases=np.arange(500))
    true, sigma = (
        f(x[:, :1, 0], np.zeros(1), FIXED)[:, :, None] for f in (sensor.observe, sensor.sigma)
    )
    errors = shown - true - sigma  # the mean bias is as large as sigma
    within = errors - errors.mean(axis=1, keepdims=True)
    assert_allclose(within.std(axis=(1, 2)) / np.sqrt(0.95), sigma[:, 0, 0], rtol=0.03)
    held = errors.mean(axis=1).std(axis=1)
    assert_allclose(np.degrees(held), [0.3, 0.2], rtol=0.12)
    for row in range(2):
        standard = within[row].ravel() / (sigma[row] * np.sqrt(0.95)).ravel()
        assert kstest(standard, "norm").pvalue > 1e-3


def test_numbers_belong_to_the_case() -> None:
    sensor = antenna(dropout_probability=0.3, outlier_probability=0.2)
    x = towards(sensor, np.linspace(10.0, 60.0, 9), np.full(9, 30.0))[:, :, None]
    t = np.arange(9.0)

    def shown(cases: list[int], k: int = 9, seed: int = 7, stage: str = "s") -> Array:
        return record(sensor, x[:, :k], t[:k], FIXED, seed=seed, stage=stage, cases=np.array(cases))

    several = shown([4, 0, 11])
    assert np.array_equal(several[..., [2]], shown([11]), equal_nan=True)
    assert np.array_equal(several[:, :5], shown([4, 0, 11], 5), equal_nan=True)
    assert not np.array_equal(several, shown([4, 0, 11], seed=8), equal_nan=True)
    assert not np.array_equal(several, shown([4, 0, 11], stage="z"), equal_nan=True)


def test_dropouts_and_outliers_come_as_often_as_said() -> None:
    sensor = antenna(**SILENT, dropout_probability=0.25, outlier_probability=0.1)
    x = towards(sensor, np.full(50, 80.0), np.full(50, 30.0))[:, :, None]
    shown = record(sensor, x, np.arange(50.0), FIXED, seed=3, stage="s", cases=np.arange(200))
    missing = np.isnan(shown[0])
    assert np.array_equal(missing, np.isnan(shown[1]))
    assert_allclose(missing.mean(), 0.25, rtol=0.0, atol=0.02)
    off = np.degrees(shown[0, ~missing]) - 80.0
    outlying = np.abs(off) > 1e-6
    assert_allclose(outlying.mean(), 0.1, rtol=0.0, atol=0.02)
    assert_allclose(off[outlying].std(), 5.0, rtol=0.1)


@pytest.mark.parametrize(("probability", "missing"), [(0.0, 0), (1.0, 20)])
def test_never_and_always(probability: float, missing: int) -> None:
    sensor = antenna(dropout_probability=probability)
    x = towards(sensor, np.full(20, 80.0), np.full(20, 30.0))[:, :, None]
    shown = record(sensor, x, np.arange(20.0), FIXED, seed=3, stage="s", cases=np.arange(1))
    assert int(np.isnan(shown[0]).sum()) == missing


def test_below_the_mask_nothing_is_measured() -> None:
    sensor = antenna(mask_elevation_deg=10)
    x = towards(sensor, [1.0, 1.0], [9.9, 10.1])
    shown = sensor.measure(x, np.zeros(2), FIXED, np.zeros((6, 2)), np.zeros((6, 2)))
    assert np.isnan(shown).tolist() == [[True, False], [True, False]]


def test_errors_at_the_zenith_give_a_direction_beyond_it() -> None:
    sensor = antenna(**(SILENT | {"elevation_bias_deg": [2, 0, 0]}))
    x = towards(sensor, [30.0, 30.0], [89.0, 90.0])
    shown = sensor.measure(x, np.zeros(2), FIXED, np.zeros((6, 2)), np.zeros((6, 2)))
    assert_allclose(np.degrees(shown[:, 0]), [210.0, 89.0], rtol=0.0, atol=1e-9)
    assert_allclose(np.degrees(shown[1, 1]), 88.0, rtol=0.0, atol=1e-9)
    loud = antenna()
    shown = loud.measure(x, np.zeros(2), FIXED, np.ones((6, 2)), np.ones((6, 2)))
    assert np.isfinite(shown).all()
    assert (np.abs(shown[1]) <= 0.5 * np.pi).all()


def test_a_bias_that_grows_towards_the_horizon() -> None:
    sensor = antenna(**SILENT, mask_elevation_deg=0, horizon_bias_sigma_deg=0.01)
    x = towards(sensor, np.full(4, 70.0), [5.0, 26.5650511771, 45.0, 90.0])
    constant = np.zeros((6, 4))
    constant[5] = -2.0
    bias = sensor.bias(x, np.zeros(4), FIXED, constant)
    cotangent = 1.0 / np.tan(np.radians([5.0, 26.5650511771, 45.0, 90.0]))
    assert_allclose(np.degrees(bias), [np.zeros(4), -0.02 * cotangent], rtol=0.0, atol=1e-9)
    shown = sensor.measure(x, np.zeros(4), FIXED, constant, np.zeros((6, 4)))
    away = shown - sensor.observe(x, np.zeros(4), FIXED)
    assert_allclose(away[:, :3], bias[:, :3], rtol=0.0, atol=1e-12)
    # each case has its own
    held = draw_constants(sensor, 1, "s", np.arange(3000))
    low = towards(sensor, np.full(3000, 70.0), np.full(3000, 5.0))
    spread = sensor.bias(low, np.zeros(3000), FIXED, held)[1].std()
    assert_allclose(np.degrees(spread), 0.01 * cotangent[0], rtol=0.05)


@pytest.mark.parametrize(
    ("true", "believed", "distance_km"),
    [
        ((-2.18, -44.26, 39.0), (-2.1, -44.2, 30.0), 11.08),
        ((-15.53, -56.07, 277.0), (-15.5, -56.0, 270.0), 8.21),
    ],
)
def test_wrong_stations_kuga_1990(
    true: tuple[float, ...], believed: tuple[float, ...], distance_km: float
) -> None:
    names = ("latitude_deg", "longitude_deg", "height_m")
    sensor = antenna(
        **dict(zip(names, true, strict=True)),
        **{f"believed_{name}": value for name, value in zip(names, believed, strict=True)},
    )
    told = sensor.believed_stations(np.zeros((6, 2)))
    assert told[0] is told[1]
    apart = np.linalg.norm(told[0].ecef_m - sensor.station.ecef_m)
    assert_allclose(apart / 1e3, distance_km, rtol=0.0, atol=0.006)


def test_stations_differ_from_case_to_case() -> None:
    sensor = antenna(station_sigma_m=[100, 200, 300])
    told = sensor.believed_stations(draw_constants(sensor, 1, "s", np.arange(2000)))
    away = sensor.station.axes @ (
        np.array([s.ecef_m for s in told]).T - sensor.station.ecef_m[:, None]
    )
    assert_allclose(away.std(axis=1), [100.0, 200.0, 300.0], rtol=0.06)


def test_what_does_not_fit_is_refused() -> None:
    sensor = antenna()
    with pytest.raises(InputError, match=r"lacks 'earth_fixed'.*it has: sun"):
        sensor.observe(np.zeros((6, 1)), np.zeros(1), {"sun": np.zeros((3, 1))})
    with pytest.raises(InputError, match="must fit together"):
        sensor.observe(np.zeros((6, 2)), np.zeros(3), FIXED)
    with pytest.raises(InputError, match=r"states must be \(n, 3, 2\)"):
        record(
            sensor, np.ones((6, 2, 2)), np.zeros(3), FIXED, seed=1, stage="s", cases=np.arange(2)
        )
    with pytest.raises(InputError, match="dropout_probability"):
        antenna(dropout_probability=1.5)
