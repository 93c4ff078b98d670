"""Attitude errors that the sensors of a craft share: true, believed as noise, estimated."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import LANES, CaseBatch
from hillsphere.plugins import validate
from hillsphere.sensor_suite import SensorSuite
from hillsphere.testing import RecordingContext
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.attitude import TrueAttitude, attitude_states
from hillsphere_estimators.navigation.specs import AttitudeSpec, NavigationSpec
from hillsphere_estimators.navigation.stage import NavigationStage
from hillsphere_estimators.plant_model import PlantModel
from hillsphere_sensors.spacecraft import line_of_sight_frame, rotate, turn_axes

PLACE = np.array([29.0, -1503.4, 407.1, 0.0, 0.0, 0.0])
SIGMA = 2e-3
"""Size of the attitude errors, rad: four times the noise of the camera, 5.2e-4 rad."""


@cache
def part(name: str) -> Any:
    if name == "body":
        return create(
            "body", "asteroid", semi_major_axis_au=0.9224, eccentricity=0.1912,
            rotation_rate_rad_s=5.8177e-5, semi_axes_m=(191.0, 135.0, 95.0),
        )  # fmt: skip
    if name == "plant":
        gravity = create("gravity", "point_mass", gm_m3_s2=1.801599)
        return create(
            "plant", "proximity", body=part("body"), gravity=gravity, acceleration_noise_m_s2=1e-9
        )
    if name == "star_tracker":
        return create("sensor", "star_tracker", sigma_rad=1e-4, roll_sigma_rad=1e-3)
    if name in ("range", "precise_range"):
        sigma_m = 10.0 if name == "range" else 0.1
        return create("sensor", "lidar", body=part("body"), angles=False, range_sigma_m=sigma_m)
    return create("sensor", "camera", body=part("body"))


def scene(turns: Array, count: int) -> tuple[Array, dict[str, Array]]:
    x = np.repeat(PLACE[:, None], count, axis=1)
    return x, {
        "boresight": -x[None, :3], "attitude": turns, "to_body": np.eye(3)[:, :, None],
        "sun": np.array([[-1e11], [2e10], [3e10]]),
    }  # fmt: skip


def test_rotation_vector() -> None:
    """About z by 30 degrees; and the third-order terms of a general one, by its matrix."""
    turn = np.array([[0.0], [0.0], [np.pi / 6.0]])
    np.testing.assert_allclose(
        turn_axes(turn, np.eye(3))[:, :1], [[np.cos(np.pi / 6.0)], [-0.5], [0.0]], atol=1e-15
    )
    vectors, turns = np.random.default_rng(3).normal(size=(2, 3, 20))
    want = Rotation.from_rotvec(turns.T).inv().apply(vectors.T).T
    np.testing.assert_allclose(turn_axes(turns, vectors), want, rtol=0, atol=1e-14)


def test_every_sensor_of_a_craft_is_turned() -> None:
    """To first order: azimuth − θ_y, elevation + θ_x, and directions by the opposite turn."""
    turns = np.array([[[1e-5], [-2e-5], [3e-5]]])
    x, turned = scene(turns, 1)
    still = {**turned, "attitude": np.zeros((1, 3, 1))}
    now = np.zeros(1)
    lidar = create("sensor", "lidar", body=part("body"))
    for sensor, rows in ((part("camera"), slice(0, 2)), (lidar, slice(1, 3))):
        off = (sensor.observe(x, now, turned) - sensor.observe(x, now, still))[rows, 0]
        np.testing.assert_allclose(off, [2e-5, 1e-5], rtol=0, atol=1e-8)
    disc = create("sensor", "camera", body=part("body"), target="disc", sunlit=True)
    off = (disc.observe(x, now, turned) - disc.observe(x, now, still))[:, 0]
    np.testing.assert_allclose(off, [2e-5, 1e-5], rtol=0, atol=1e-5)
    tracker = part("star_tracker").observe(x, now, turned)
    np.testing.assert_array_equal(tracker[:, 0], turns[0, :, 0])
    sun = create("sensor", "sun_sensor")
    frame = line_of_sight_frame(turned["boresight"][0])
    true = rotate(frame, sun.observe(x, now, still))[:, 0]
    shown = rotate(frame, sun.observe(x, now, turned))[:, 0]
    np.testing.assert_allclose(shown, true - np.cross(turns[0, :, 0], true), rtol=0, atol=2e-9)
    beam = create("sensor", "lidar", body=part("body"), angles=False, spot="pointing")
    tilt = np.array([[[0.0], [0.05], [0.0]]])
    x, tilted = scene(tilt, 1)
    side = tilted["boresight"][0] + np.linalg.norm(PLACE[:3]) * np.tan(0.05) * frame[0]
    aside = {**tilted, "attitude": np.zeros((1, 3, 1)), "boresight": side[None]}
    np.testing.assert_allclose(
        beam.observe(x, now, tilted), beam.observe(x, now, aside), rtol=1e-12
    )


def test_two_cameras_of_a_craft_have_correlated_errors() -> None:
    """ρ = σ²/(σ² + σ_c²) for the attitude's σ and the camera's σ_c; none between two craft."""
    count = 20000
    random = np.random.default_rng(5)
    error = TrueAttitude(AttitudeSpec(drift_sigma_rad=4e-4, jitter_sigma_rad=3e-4), 1)
    w = random.normal(size=(error.noise, count))
    x, around = scene(error.turns(error.advance(None, 0.0, w), w), count)
    suite = SensorSuite([part("camera"), create("sensor", "camera", body=part("body"))])
    constant, noise = (random.normal(size=(k, count)) for k in suite.draws)
    off = suite.measure(x, np.zeros(count), around, constant, noise)
    own = float(suite.sigma(x, np.zeros(count), around)[0, 0])
    want = 5e-4**2 / (5e-4**2 + own**2)
    found = np.asarray(np.corrcoef(off))
    # the standard deviation of a correlation coefficient is (1 − ρ²)/√N
    for row in (0, 1):
        assert found[row, row + 2] == pytest.approx(want, abs=4.0 * (1.0 - want**2) / count**0.5)
    assert found[0, 3] == pytest.approx(0.0, abs=4.0 / count**0.5)


def test_drift_is_a_gauss_markov_process() -> None:
    """Variance σ² at each sample, correlation e^(−Δt/τ); without τ a constant."""
    w = np.random.default_rng(2).normal(size=(3, 6, 40000))
    drift = TrueAttitude(AttitudeSpec(drift_sigma_rad=0.1, drift_time_s=50.0), 1)
    first = drift.advance(None, 20.0, w[0])
    second = drift.advance(first, 20.0, w[1])
    assert second.std() == pytest.approx(0.1, rel=0.01)
    assert np.mean(first * second) == pytest.approx(0.01 * np.exp(-0.4), rel=0.02)
    constant = TrueAttitude(AttitudeSpec(drift_sigma_rad=0.1), 1)
    np.testing.assert_array_equal(constant.advance(first, 20.0, w[2]), first)


def test_believed_noise_is_common_to_the_sensors() -> None:
    """The innovation's covariance of two cameras: H P Hᵀ + σ² between them, and σ_c² of each."""
    suite = SensorSuite([part("camera"), create("sensor", "camera", body=part("body"))])
    model = PlantModel(part("plant"), suite)
    ((sigma, time),) = attitude_states(AttitudeSpec(drift_sigma_rad=3e-4, jitter_sigma_rad=4e-4))
    x, around = scene(np.zeros((1, 3, 1)), 1)
    states = BiasStates(
        np.full(3, sigma), np.full(3, time), np.zeros((4, 3)), np.zeros((3, 3)),
        np.zeros(3, dtype=bool), np.eye(3),
    )  # fmt: skip
    augmented = BiasAugmentedModel(model.within(around), 6, states)
    belief = augmented.append_biases(
        Belief.of(x, np.diag([1e-4] * 3 + [1e-8] * 3)[None], np.zeros(1))
    )
    shown = suite.observe(x, np.zeros(1), around)
    own = suite.sigma(x, np.zeros(1), around)
    measured = MeasurementSet.of(np.zeros(1), shown, own, suite.blocks)
    _, innovation = create("estimator", "unscented").update(augmented, belief, measured)
    place = (0.01 / np.linalg.norm(PLACE[:3])) ** 2  # 1 cm of position
    np.testing.assert_allclose(innovation.covariance[0, 0, 2], 25e-8 + place, rtol=1e-3)
    np.testing.assert_allclose(innovation.covariance[0, 0, 0], 25e-8 + place + own[0, 0] ** 2,
                               rtol=1e-3)  # fmt: skip
    # and independent at the next sample: nothing of it is left but its variance
    later = create("estimator", "unscented").predict(
        augmented, belief, np.full(1, 60.0), np.zeros((3, 1))
    )
    np.testing.assert_allclose(later.covariance[0, 6:, 6:], 25e-8 * np.eye(3), atol=1e-15)


def stage(sensors: tuple[str, ...] = ("camera", "range"), **attitude: Any) -> NavigationStage:
    given: dict[str, Any] = {
        "plant": "plant", "sensors": sensors, "estimator": "iterated",
        "start": {"position_m": PLACE[:3].tolist()}, "belief": {"position_m": 30},
        "interval_h": 0.5, "duration_h": 4, "step_s": 300, "noise_step_s": 300,
        "attitude": attitude or None,
    }  # fmt: skip
    spec = validate(NavigationSpec, {k: v for k, v in given.items() if v is not None}, where="test")

    def lookup(kind: str, name: str) -> Any:
        if kind == "estimator":
            return create("estimator", "unscented", update=name, iterations=20)
        return part(name)

    bound = spec.bound(lookup)
    assert isinstance(bound, NavigationSpec)
    return NavigationStage(bound)


@cache
def flight(sensors: tuple[str, ...] = ("camera", "range"), **attitude: Any) -> Any:
    return stage(sensors, **attitude).run(RecordingContext())


def test_estimated_drift_is_consistent() -> None:
    low, high = chi_square_band(6, 64)
    one = flight(drift_sigma_rad=SIGMA, drift_time_h=2.0, jitter_sigma_rad=2e-4,
                 believed="estimated")  # fmt: skip
    mean = one.nees.mean(axis=1)
    assert one.lost == 0
    assert (low < mean).all()
    assert (mean < high).all()
    assert one.matched


def test_drift_believed_as_noise_is_overconfident_but_jitter_is_not() -> None:
    """A constant σ counts K times as if independent: its variance is believed to be σ²/K."""
    _, high = chi_square_band(6, 64)
    drift = flight(drift_sigma_rad=SIGMA)
    mean = drift.nees.mean(axis=1)
    assert mean[0] < high  # a single sample cannot tell
    assert mean[-1] > 1.5 * high
    assert not drift.matched
    jitter = flight(jitter_sigma_rad=SIGMA)
    assert (jitter.nees.mean(axis=1) < high).all()
    assert jitter.matched


def test_star_tracker_measures_the_drift() -> None:
    """Without one the direction is known to σ of the misalignment; with one to its noise."""
    sensors = ("camera", "precise_range")
    alone = flight(sensors, drift_sigma_rad=SIGMA, believed="estimated")
    low, high = chi_square_band(6, 64)
    tracked = flight((*sensors, "star_tracker"), drift_sigma_rad=SIGMA, believed="estimated")
    for one in (alone, tracked):
        mean = one.nees.mean(axis=1)
        assert (low < mean).all()
        assert (mean < high).all()
    # two axes of at most 2 mrad at 1.56 km, 4.4 m, against those of the camera's noise
    away = float(np.linalg.norm(PLACE[:3]))
    sigma = [one.position_sigma_m[0, 0].mean() for one in (alone, tracked)]
    camera = 5.2334e-4
    want = [np.sqrt(2.0) * away * np.hypot(SIGMA, camera), np.sqrt(2.0) * away * camera]
    np.testing.assert_allclose(sigma, want, rtol=0.05)
    assert tracked.position_sigma_m[0, -1].mean() < 0.5 * alone.position_sigma_m[0, -1].mean()


def test_a_case_has_the_same_bits_in_any_place_of_its_block() -> None:
    """So that workers may share blocks in any way: the numbers follow the case's draws."""
    order = np.random.default_rng(1).permutation(LANES)
    keys: dict[str, Any] = {"drift_sigma_rad": SIGMA, "drift_time_h": 2, "jitter_sigma_rad": 1e-4}
    turned = stage(believed="estimated", **keys)
    here, there = (
        turned.run_cases(
            CaseBatch(n, n, np.zeros(LANES, bool), (), np.zeros((0, LANES)), 5, "x")
        ).values
        for n in (np.arange(LANES), order)
    )
    np.testing.assert_array_equal(here[:, order], there)


def test_attitude_needs_some_error() -> None:
    with pytest.raises(InputError, match="neither drift nor jitter"):
        validate(AttitudeSpec, {}, where="test")
