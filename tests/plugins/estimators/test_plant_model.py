"""What estimators believe, made of a plant, a law and sensors."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import StepMap, system
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.sensor_suite import SensorSuite
from hillsphere.simulation import Cases, simulate
from hillsphere_controllers.lyapunov_formation import LyapunovFormation
from hillsphere_estimators.plant_model import PlantModel

START = np.array([29.0, -1503.4, 407.1, 1e-3, -2e-4, 1e-4])
NOTHING = np.zeros((0, 1))


def plant() -> Any:
    body = create(
        "body", "asteroid", semi_major_axis_au=0.9224, eccentricity=0.1912,
        rotation_rate_rad_s=5.8177e-5, semi_axes_m=(191.0, 135.0, 95.0),
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=1.8)
    return create("plant", "proximity", body=body, gravity=gravity)


PLANT = plant()
LAW = create(
    "compensator", "lyapunov_formation", LyapunovFormation, plant=PLANT, period_s=600.0,
    ramp_s=7200.0,
)  # fmt: skip
SUITE = SensorSuite([create("sensor", "sun_sensor"), create("sensor", "camera", body=PLANT.body)])


def noise(t_s: Array) -> Array:
    return np.array([[3e-8], [1e-9], [2e-9]]) * np.ones(t_s.size)


def columns(x: Array, count: int) -> Array:
    return np.ascontiguousarray(np.repeat(x[:, None], count, axis=1))


def test_free_flight_and_held_control() -> None:
    model = PlantModel(PLANT, SUITE)
    x, t = columns(START, 3), np.full(3, 100.0)
    case = np.zeros(3, dtype=np.int64)
    later = t + np.array([600.0, 600.0, 1200.0])
    equations = StepMap(system(PLANT, controls=True), "rk6")
    for control in (NOTHING, columns(np.array([1e-6, 0.0, -1e-6]), 3)):
        u = control if len(control) else np.zeros((3, 3))
        want = equations.propagate(x, later - t, 40, u, t)
        found = model.advance(x, t, later, control, case)
        np.testing.assert_allclose(found[:3], want[:3], rtol=0, atol=1e-8)
        np.testing.assert_allclose(found[3:], want[3:], rtol=0, atol=1e-12)


def test_a_law_commands_by_its_estimate_alone() -> None:
    """The believed mean flies as the loop does; a deviation from it flies freely."""
    model = PlantModel(PLANT, SUITE, law=LAW)
    ref = 0.9 * START
    off = np.array([20.0, -10.0, 5.0, 1e-3, 2e-3, 0.0])
    x = np.column_stack([START, START + off])
    t, case = np.full(2, 7200.0), np.zeros(2, dtype=np.int64)
    control = np.concatenate([columns(START, 2), columns(ref, 2)])
    found = model.advance(x, t, t + 600.0, control, case)
    flown = simulate(
        PLANT, LAW, Cases(START[:, None], t0_s=7200.0), 1, reference=ref, substeps=10, method="rk6"
    )
    np.testing.assert_allclose(found[:, 0], flown.x[:, 0], rtol=0, atol=1e-9)
    free = PlantModel(PLANT, SUITE).advance(x, t, t + 600.0, NOTHING, case)
    want = free[:, 1] - free[:, 0]
    # the two flights differ by the command, so their gravity gradients a little
    np.testing.assert_allclose(found[:, 1] - found[:, 0], want, rtol=0, atol=5e-4)


@pytest.mark.parametrize("duration", [60.0, 1800.0])
def test_process_noise_is_that_of_held_accelerations(duration: float) -> None:
    """Each push of each step, flown by itself."""
    model = PlantModel(PLANT, SUITE, noise=noise)
    x, t = START[:, None], np.array([500.0])
    root = model.process_noise(x, t, t + duration, NOTHING)[0]
    flow = StepMap(system(PLANT, controls=True), "rk6")
    steps = round(duration / 60.0)
    want = np.zeros((6, 6))
    for k in range(steps):
        for axis in range(3):
            ends = []
            for size in (1e-6, -1e-6):
                u = np.zeros((3, 1))
                y = flow.propagate(x, 60.0 * k, k, u, t) if k else x
                u[axis] = size
                y = flow.propagate(y, 60.0, 1, u, t + 60.0 * k)
                if left := steps - k - 1:
                    y = flow.propagate(y, 60.0 * left, left, 0.0 * u, t + 60.0 * (k + 1))
                ends.append(y[:, 0])
            answer = (ends[0] - ends[1]) / 2e-6 * noise(t)[axis, 0]
            want += np.outer(answer, answer)
    unit = np.sqrt(np.diag(want))
    unit = np.where(unit > 1e-15, unit, 1.0)
    found = root @ root.T
    np.testing.assert_allclose(
        found / np.outer(unit, unit), want / np.outer(unit, unit), rtol=0, atol=2e-6
    )
    assert root.shape[1] <= 6


def test_noise_of_several_cases() -> None:
    model = PlantModel(PLANT, SUITE, noise=noise)
    x = np.column_stack([START, 1.3 * START])
    t = np.zeros(2)
    both = model.process_noise(x, t, t + 600.0, NOTHING)
    for i in (0, 1):
        alone = model.process_noise(x[:, i : i + 1], t[:1], t[:1] + 600.0, NOTHING)[0]
        np.testing.assert_allclose(both[i] @ both[i].T, alone @ alone.T, rtol=1e-9, atol=1e-30)
    assert not PlantModel(PLANT, SUITE).process_noise(x, t, t + 600.0, NOTHING).any()


def test_noise_of_unequal_durations() -> None:
    """A short case beside a long one has its own steps, not the long one's."""
    model = PlantModel(PLANT, SUITE, noise=noise)
    lasts = np.array([60.0, 3600.0, 60.0, 90.0, 0.0])
    x, t = columns(START, 5) * np.array([1.0, 1.0, 1.2, 1.0, 1.0]), np.full(5, 100.0)
    every = model.process_noise(x, t, t + lasts, np.zeros((0, 5)))
    for i in range(5):
        alone = model.process_noise(x[:, i : i + 1], t[:1], t[:1] + lasts[i], NOTHING)[0]
        np.testing.assert_allclose(every[i] @ every[i].T, alone @ alone.T, rtol=1e-9, atol=1e-30)
    # one push of a minute: σ dt
    sigma = np.sqrt(np.diagonal(every[0] @ every[0].T)[3:])
    np.testing.assert_allclose(sigma, 60.0 * noise(t[:1])[:, 0], rtol=1e-3)


def test_sensors_see_the_scene_of_the_case() -> None:
    looks = -(START[:3, None] + np.array([[0.0, 10.0], [0.0, 0.0], [0.0, 0.0]]))
    sun = np.array([[-1e11], [0.0], [0.0]])
    model = PlantModel(PLANT, SUITE).within({"boresight": looks[None], "sun": sun})
    x, case = columns(START, 4), np.array([0, 1, 1, 0])
    found = model.observe(x, np.zeros(4), case)
    assert found.shape == (5, 4)
    np.testing.assert_array_equal(found[:, 0], found[:, 3])
    np.testing.assert_array_equal(found[:, 1], found[:, 2])
    np.testing.assert_allclose(found[3:, 0], 0.0, atol=1e-12)
    assert abs(found[3, 1]) > 5e-3
    with pytest.raises(InputError, match="lacks 'sun'"):
        PlantModel(PLANT, SUITE).observe(x, np.zeros(4), case)


def test_a_lane_that_is_lost_is_named() -> None:
    model = PlantModel(PLANT, SUITE)
    x, t, case = columns(START, 3), np.zeros(3), np.zeros(3, dtype=np.int64)
    x[:, 1] = 0.0
    with pytest.raises(PropagationError, match=r"lane 1 .*turned non-finite"):
        model.advance(x, t, t + 600.0, NOTHING, case)
    x[0, 1] = np.nan
    with pytest.raises(InputError, match=r"lane 1 .*start with non-finite"):
        model.advance(x, t, t + 600.0, NOTHING, case)


def test_refused() -> None:
    with pytest.raises(InputError, match="must be positive"):
        PlantModel(PLANT, SUITE, step_s=0.0)
    x, t, case = START[:, None], np.zeros(1), np.zeros(1, dtype=np.int64)
    with pytest.raises(InputError, match="estimate and reference, 12 rows"):
        PlantModel(PLANT, SUITE, law=LAW).advance(x, t, t + 60.0, NOTHING, case)
    with pytest.raises(InputError, match="3 rows or none"):
        PlantModel(PLANT, SUITE).advance(x, t, t + 60.0, np.zeros((2, 1)), case)


def test_equations_are_compiled_on_first_use_and_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def counted(*args: Any) -> StepMap:
        made.append(args[1])
        return StepMap(*args)

    monkeypatch.setattr("hillsphere_estimators.plant_flow.StepMap", counted)
    monkeypatch.setattr("hillsphere_estimators.plant_flow._COMPILED", {})
    monkeypatch.setattr("hillsphere.engine.simulation.flow._KEPT", OrderedDict())
    one, other = PlantModel(PLANT, SUITE), PlantModel(plant(), SUITE)
    commanded = PlantModel(PLANT, SUITE, law=LAW)
    assert made == []
    x, t, case = columns(START, 2), np.zeros(2), np.zeros(2, dtype=np.int64)
    first = one.advance(x, t, t + 60.0, NOTHING, case)
    np.testing.assert_array_equal(other.within({}).advance(x, t, t + 60.0, NOTHING, case), first)
    assert made == ["rk6"]
    commanded.advance(x, t, t + 60.0, columns(np.tile(START, 2), 2), case)
    finer = PlantModel(PLANT, SUITE, method="dop853")
    np.testing.assert_allclose(finer.advance(x, t, t + 60.0, NOTHING, case), first, rtol=1e-12)
    assert made == ["rk6", "rk6", "dop853"]
    with pytest.raises(InputError, match="rk7"):
        PlantModel(PLANT, SUITE, method="rk7")
