"""The stage ``navigation``: filters in the loop, and what goes wrong in it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import HillsphereError
from hillsphere.interfaces import Array
from hillsphere.plant_model import PlantModel
from hillsphere.plugins import validate
from hillsphere.sensor_suite import SensorSuite
from hillsphere.testing import RecordingContext
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.comparison import paired_rms_ratio
from hillsphere_estimators.navigation.metrics import moment
from hillsphere_estimators.navigation.specs import NavigationSpec
from hillsphere_estimators.navigation.stage import NavigationStage
from hillsphere_estimators.navigation.world import Faults, ShakenReference

FIRST = [29.0, -1503.4, 407.1]
SECOND = [-1.2, -2126.2, 550.5]


@cache
def part(name: str) -> Any:
    """Return a piece of the world of the formation navigation paper."""
    if name == "body":
        return create(
            "body", "asteroid", name="apophis", semi_major_axis_au=0.9224, eccentricity=0.1912,
            rotation_rate_rad_s=5.8177e-5, semi_axes_m=(191.0, 135.0, 95.0),
        )  # fmt: skip
    if name == "gravity":
        return create("gravity", "point_mass", gm_m3_s2=1.801599)
    if name == "plant":
        craft = {"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}
        return create(
            "plant", "proximity", body=part("body"), gravity=part("gravity"),
            spacecraft=[craft] * 2, acceleration_noise_m_s2=1e-9, radiation_noise=0.2,
        )  # fmt: skip
    if name == "law":
        return create(
            "compensator", "lyapunov_formation", plant=part("plant"), period_h=1, ramp_h=2
        )
    if name == "link":
        return create("sensor", "inter_satellite", partner=2)
    kind, number = name[:-1], int(name[-1])
    return create("sensor", kind, body=part("body"), spacecraft=number)


SENSORS = ("camera1", "lidar1", "camera2", "lidar2", "link")


def stage(names: tuple[str, ...] = SENSORS, **keys: Any) -> NavigationStage:
    given: dict[str, Any] = {
        "plant": "plant", "law": "law", "sensors": names, "estimator": "iterated",
        "start": {"position_m": FIRST + SECOND}, "interval_h": 1, "duration_h": 3, "step_s": 120,
        "noise_step_s": 120, **keys,
    }  # fmt: skip
    given = {key: value for key, value in given.items() if value is not None}
    spec = validate(NavigationSpec, given, where="test")

    def lookup(kind: str, name: str) -> Any:
        if kind == "estimator":
            return create("estimator", "unscented", update=name, iterations=40)
        return part(name)

    bound = spec.bound(lookup)
    assert isinstance(bound, NavigationSpec)
    return NavigationStage(bound)


@cache
def joint() -> Any:
    return stage(report_at_h=[1]).run(RecordingContext())


def test_joint_filter_is_consistent_and_as_good_as_its_bound() -> None:
    flight = joint()
    low, high = chi_square_band(12, flight.nees.shape[1])
    assert flight.lost == 0
    assert (low < flight.nees.mean(axis=1)).all()
    assert (flight.nees.mean(axis=1) < high).all()
    rms = np.sqrt(np.mean(flight.position_error_m[:, -1] ** 2, axis=1))
    np.testing.assert_array_less(0.8 * flight.bound_m[:, -1], rms)
    np.testing.assert_array_less(rms, 1.4 * flight.bound_m[:, -1])


def test_one_linear_update_is_inconsistent() -> None:
    """Angles of 1.7e-6 rad after a prior of 150 to 220 m: as the paper's filter does it."""
    flight = stage(estimator="plain", duration_h=1).run(RecordingContext())
    assert np.mean(flight.nees[0]) > 10 * chi_square_band(12, 64)[1]


def test_metrics_are_those_of_the_flights() -> None:
    flight = joint()
    value = dict(zip(flight.metrics, flight.values, strict=True))
    np.testing.assert_array_equal(value["position_error_1_at_1h"], flight.position_error_m[0, 1])
    np.testing.assert_array_equal(value["position_error_2"], flight.position_error_m[1, -1])
    np.testing.assert_array_equal(value["nees"], flight.nees[-1])
    np.testing.assert_array_equal(value["rejected"], 0.0)
    assert [moment(t) for t in (7200.0, 5400.0, 20.0)] == ["2h", "90min", "20s"]


def test_silence_lets_the_uncertainty_grow() -> None:
    keys: dict[str, Any] = {"outages": [{"interval_h": [0.5, 2.5]}]}
    flight = stage(**keys).run(RecordingContext())
    sigma, heard = flight.position_sigma_m[0].mean(axis=1), joint().position_sigma_m[0].mean(axis=1)
    assert (flight.sent[[1, 2]] == 0).all()
    assert sigma[0] == heard[0]
    assert sigma[2] > sigma[1] > 1.5 * heard[1]
    assert sigma[3] < 0.5 * sigma[2]


def test_covariance_intersection_is_not_overconfident() -> None:
    members = [["camera1", "lidar1", "link"], ["camera2", "lidar2"]]
    flight = stage(members=members, duration_h=2).run(RecordingContext())
    high = chi_square_band(12, 64)[1]
    assert flight.nees[-1].mean() < high
    assert (flight.position_sigma_m[:, -1].mean(axis=1)
            > joint().position_sigma_m[:, 2].mean(axis=1)).all()  # fmt: skip


def test_a_wrong_thrust_is_restored_by_biases() -> None:
    """Two per cent of thrust, unknown to the filter, over three hours."""
    names = ("camera1", "lidar1", "camera2", "lidar2")
    keys: dict[str, Any] = {"truth": {"thrust": 1.02}, "interval_h": 3, "duration_h": 3}
    unaware = stage(names, **keys).run(RecordingContext())
    biases = [{"of": "thrust", "sigma": 0.02}]
    aware = stage(names, biases=biases, **keys).run(RecordingContext())
    high = chi_square_band(12, 64)[1]
    assert unaware.nees[-1].mean() > 2 * high
    assert aware.nees[-1].mean() < high
    assert not unaware.matched


def test_accelerations_beside_the_law() -> None:
    """What a model's motion is told beside estimate and reference pushes the states."""
    model = PlantModel(part("plant"), SensorSuite([part("link")]), law=part("law"), step_s=100.0)
    x = np.array([*FIRST, 0, 0, 0, *SECOND, 0, 0, 0], dtype=float)[:, None]
    told, push = np.concatenate([x, x]), np.array([1e-7, 0, 0, 0, -2e-7, 3e-7])[:, None]
    ends = (np.zeros(1), np.full(1, 200.0))
    case = np.zeros(1, dtype=np.int64)
    still = model.advance(x, *ends, told, case)
    moved = model.advance(x, *ends, np.concatenate([told, push]), case)
    want = np.concatenate([2e4 * push[:3], 200 * push[:3], 2e4 * push[3:], 200 * push[3:]])
    # the frame turns, gravity falls off: both are small in 200 s
    atol = np.tile(np.repeat([1e-6, 1e-8], 3), 2)[:, None]
    assert (np.abs(moved - still - want) <= atol).all()


def test_flights_of_different_intervals_are_shaken_alike() -> None:
    def shaken(interval_s: float, samples: int) -> Array:
        one = ShakenReference(
            np.zeros((6, samples)), interval_s, 60.0, np.zeros(4), lambda t: np.ones((3, len(t))),
            np.ones(4), 1, "x", np.arange(4),
        )  # fmt: skip
        steps = [one.feedforward(k, np.zeros(4), np.arange(4)) for k in range(samples - 1)]
        assert one.feedforward(samples - 1, np.zeros(4), np.arange(4)) is None
        return np.concatenate([s.u for s in steps if s is not None])

    fine, coarse = shaken(600.0, 7), shaken(3600.0, 2)
    np.testing.assert_array_equal(fine, coarse)
    assert fine.shape == (60, 3, 4)
    assert abs(fine.std() - 1.0) < 0.15


def test_dropouts_and_outliers_come_as_often_as_asked() -> None:
    suite = SensorSuite(
        [part("link"), create("sensor", "inter_satellite", spacecraft=2, partner=1)]
    )
    faults = Faults(suite, 0.3, 0.02, 30.0, [([1], 10.0, 20.0)])
    count = 20000
    x = np.repeat(np.array([*FIRST, 0, 0, 0, *SECOND, 0, 0, 0], dtype=float)[:, None], count, 1)
    t = np.zeros(count)
    scene = {"sun": np.array([[-1e11], [0.0], [0.0]])}
    w = np.random.default_rng(1).normal(size=(faults.noise, count))
    sigma = suite.sigma(x, t, scene)
    constant = np.zeros((suite.draws[0], count))
    found = faults.measurements(x, t, 0.0, scene, constant, w, sigma)
    assert found.present.mean() == pytest.approx(0.7, abs=0.015)
    off = np.abs(found.values[0] - suite.observe(x, t, scene)[0]) / sigma[0]
    # beyond five sigma lies what is an outlier, but for those of its 30 sigma that are small
    assert np.mean(off[found.present[0]] > 5.0) == pytest.approx(0.02 * 0.868, abs=0.004)
    silent = faults.measurements(x, t, 15.0, scene, constant, w, sigma)
    assert not silent.present[3:].any()
    np.testing.assert_array_equal(silent.present[:3], found.present[:3])


def test_paired_ratio_of_rms() -> None:
    random = np.random.default_rng(5)
    base = np.abs(random.normal(size=(2, 300)))
    draw = np.arange(300.0)
    half = paired_rms_ratio(np.vstack([0.5 * base, draw]), np.vstack([base, draw]), 0.95)
    np.testing.assert_allclose(half, 0.5, rtol=1e-12)
    other = np.abs(random.normal(size=(2, 300)))
    low, value, high = paired_rms_ratio(np.vstack([other, draw]), np.vstack([base, draw]), 0.95)
    assert low < value < high
    assert low < 1.0 < high
    # only common draws count
    some = paired_rms_ratio(np.vstack([0.5 * base, draw])[:, 100:], np.vstack([base, draw]), 0.95)
    np.testing.assert_allclose(some, 0.5, rtol=1e-12)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"sensors": []}, "nothing measures"),
    ({"sensors": ["link", "link"]}, "stands twice"),
    ({"duration_h": 0.5}, "longer than the flight"),
    ({"report_at_h": [4]}, "after the end"),
    ({"rms_from_h": 4}, "after the end"),
    ({"gate_after": 2}, "needs opening"),
    ({"members": [["camera1"], ["lidar1"]]}, "must belong to one member"),
    ({"outages": [{"sensors": ["radar"], "interval_h": [1, 2]}]}, "'radar' is none of the sensors"),
    ({"biases": [{"of": "radar", "sigma": 1}]}, "'radar' is none of the sensors"),
    ({"biases": [{"of": "lidar1", "channel": "colour", "sigma": 1}]}, "no channel 'colour'"),
    ({"start": None}, "where"),
    ({"start": {"position_m": FIRST}}, "3 numbers, the plant has 6"),
    ({"truth": {"scale": {"mass": 2}}}, "no parameter mass"),
    ({"belief": {"velocity_mm_s": 1}}, "zero is no belief"),
    ({"truth": {"sensors": ["link"]}}, "their channels must be those"),
]


@pytest.mark.parametrize(("keys", "message"), BAD)
def test_bad_input(keys: dict[str, Any], message: str) -> None:
    others = {key: value for key, value in keys.items() if key != "sensors"}
    with pytest.raises(HillsphereError, match=message):
        flown(tuple(keys.get("sensors", SENSORS)), others)


def flown(names: tuple[str, ...], keys: dict[str, Any]) -> None:
    stage(names, **keys).run(RecordingContext())
