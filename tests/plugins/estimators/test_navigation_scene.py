"""What sensors of the stage ``navigation`` find around them, and which it refuses beforehand."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere.mission import load_mission
from hillsphere.model.ephemeris import KeplerOrbit
from hillsphere.testing import RecordingContext, example
from hillsphere.time import Epoch
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.scene import proximity_scene, sky_of
from hillsphere_sensors.heliocentric import heliocentric_scene

if TYPE_CHECKING:
    from pathlib import Path

EPOCH = "2029-03-01"
ORBIT = {"inclination_rad": 0.05814, "node_rad": 3.5682, "periapsis_rad": 2.2061}
STATION = {"station": "Goldstone", "latitude_deg": 35.4259, "longitude_deg": -116.8896}
PLACE = [29.0, -1503.4, 407.1]
MISSION = """
format = 1
name = "seen"
title = "What sensors see"
seed = 1
[body.rock]
type = "asteroid"
semi_major_axis_au = 0.9224
eccentricity = 0.1912
rotation_rate_rad_s = 5.8177e-5
semi_axes_m = [191, 135, 95]
inclination_rad = 0.05814
node_rad = 3.5682
periapsis_rad = 2.2061
[body.earth]
type = "solar_orbit"
epoch = "2000-01-01T12:00:00"
semi_major_axis_au = 1.00000261
eccentricity = 0.01671123
periapsis_deg = 102.93768193
mean_anomaly_deg = 357.52688973
[gravity.rock]
type = "point_mass"
gm_m3_s2 = 1.801599
[plant.near]
type = "proximity"
body = "rock"
gravity = "rock"
[plant.hill]
type = "hill"
body = "rock"
gravity = "rock"
[sensor.camera]
type = "camera"
body = "rock"
[sensor.lidar]
type = "lidar"
body = "rock"
[sensor.station]
type = "deep_space_station"
station = "Goldstone"
latitude_deg = 35.4
longitude_deg = -116.9
[sensor.doppler]
type = "sun_doppler"
[sensor.stars]
type = "star_tracker"
[estimator.filter]
type = "unscented"
[stage.flight]
type = "navigation"
plant = "near"
estimator = "filter"
start = { position_m = [29, -1503, 407] }
interval_h = 1
duration_h = 2
sensors = ["camera", "lidar", "station", "doppler", "stars"]
earth = "earth"
epoch = "2029-03-01"
[stage.begin]
type = "initialisation"
plant = "near"
sensors = ["camera"]
spacecraft = [{ position_m = [29, -1503, 407] }]
interval_h = 1
duration_h = 2
depths_m = [1000]
"""


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    path = tmp_path / "seen.toml"
    path.write_text(MISSION, encoding="utf-8")
    return path


def test_mission_with_a_station_is_valid(mission: Path) -> None:
    assert load_mission(mission).specs
    dated = ['body.rock.epoch="2029-03-01"', "body.rock.mean_anomaly_deg=60"]
    assert load_mission(mission, sets=dated).specs


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (["sensor.lidar.range_sigma_m=0"], "'lidar' has no noise, range_sigma_m = 0"),
        (["sensor.stars.roll_sigma_deg=0"], "'stars' has no noise, roll_sigma_rad = 0"),
        (
            ['stage.flight.plant="hill"'],
            "sensors[1]: sensor 'lidar' takes 'to_body' from the scene, and plant 'hill' gives",
        ),
        (
            ['stage.flight.truth={ plant = "hill" }'],
            "sensors[3]: sensor 'doppler' takes 'origin', 'axes', 'rate' from the scene, and plant",
        ),
        (
            ['body.rock.epoch="2029-03-02"', "body.rock.mean_anomaly_deg=60"],
            "epoch: 2029-03-01, but plant 'near' begins with the mean anomaly of body 'rock'",
        ),
        (
            ['stage.begin.sensors=["station"]'],
            "stage.begin.sensors[0]: sensor 'station' stands on the Earth: needs a stage that",
        ),
    ],
)
def test_what_does_not_fit_is_refused_beforehand(mission: Path, sets: list[str], said: str) -> None:
    with pytest.raises(HillsphereError) as caught:
        load_mission(mission, sets=sets)
    assert said in str(caught.value)


def test_what_a_station_needs_is_said_with_its_line(mission: Path) -> None:
    text = MISSION
    for line in ('earth = "earth"\n', 'epoch = "2029-03-01"\n', "node_rad = 3.5682\n"):
        assert line in text
        text = text.replace(line, "")
    mission.write_text(text, encoding="utf-8")
    number = text.splitlines().index('sensors = ["camera", "lidar", "station", "doppler", "stars"]')
    with pytest.raises(HillsphereError) as caught:
        load_mission(mission)
    assert (
        f"seen.toml:{number + 1}: stage.flight.sensors[2]: sensor 'station' stands on the Earth: "
        "needs earth (a body of type 'solar_orbit' or 'spice'); epoch (date and time, TDB, at "
        "which time is 0); node_deg of body 'rock'"
    ) in str(caught.value)


@cache
def near(**angles: float) -> Any:
    body = create(
        "body", "asteroid", name="rock", semi_major_axis_au=0.9224, eccentricity=0.1912,
        rotation_rate_rad_s=5.8177e-5, semi_axes_m=(191.0, 135.0, 95.0), **angles,
    )  # fmt: skip
    return create(
        "plant", "proximity", body=body, true_anomaly_deg=70, acceleration_noise_m_s2=1e-9,
        gravity=create("gravity", "point_mass", gm_m3_s2=1.801599),
    )  # fmt: skip


def fly(sensors: list[Any], plant: Any = None, **keys: Any) -> tuple[Any, NavigationFlight]:
    plant = near(**ORBIT) if plant is None else plant
    given: dict[str, Any] = {
        "plant": plant, "sensors": sensors, "start": {"position_m": PLACE},
        "estimator": create("estimator", "unscented", update="iterated", iterations=40),
        "law": create("compensator", "lyapunov_formation", plant=plant, period_h=1, ramp_h=2),
        "interval_h": 1, "duration_h": 3, "step_s": 120, "noise_step_s": 120, **keys,
    }  # fmt: skip
    stage = create("stage", "navigation", **given)
    flight = stage.run(RecordingContext())
    assert isinstance(flight, NavigationFlight)
    return stage, flight


def onboard(plant: Any) -> list[Any]:
    return [create("sensor", kind, body=plant.body) for kind in ("camera", "lidar")]


def test_scene_is_that_of_the_orbit_itself() -> None:
    """Against the heliocentric scene of a body on the same ellipse, and its own Sun."""
    plant, earth = near(**ORBIT), example("body", "solar_orbit")
    t = np.array([0.0, 0.0, 4e4, 9e5])
    stations = [create("sensor", "deep_space_station", **STATION)]
    sky = sky_of(stations, [plant], earth, EPOCH)
    believed = np.repeat([[100.0], [-900.0], [50.0], [0.0], [0.0], [0.0]], 4, axis=1)
    found = proximity_scene(plant, [0, 1, 2], t, believed, sky)
    e, anomaly = 0.1912, np.radians(70.0)
    eccentric = 2.0 * np.arctan(np.sqrt((1.0 - e) / (1.0 + e)) * np.tan(anomaly / 2.0))
    orbit = KeplerOrbit.of(plant.body, float(eccentric - e * np.sin(eccentric)))
    want = heliocentric_scene(t, Epoch.parse(EPOCH, "TDB"), earth, orbit)
    for name, value in want.items():
        scale = np.abs(value).max()
        np.testing.assert_allclose(found[name], value, rtol=0, atol=1e-13 * scale, err_msg=name)
    np.testing.assert_allclose(
        np.linalg.norm(found["origin"][:3], axis=0), -found["sun"][0], rtol=1e-14
    )
    np.testing.assert_array_equal(found["attitude"], np.zeros((1, 3, 1)))
    # a true world of another orbit is somewhere else
    other = proximity_scene(plant, [0, 1, 2], t, believed, sky, eccentricity=0.2)
    assert (np.abs(other["origin"] - found["origin"]).max(axis=0) > 1e8).all()
    assert sky_of(onboard(plant), [plant]) is None


@pytest.mark.parametrize("kind", ["deep_space_station", "sun_doppler", "star_tracker"])
def test_flies_with_what_looks_far(kind: str) -> None:
    """The filter stays consistent, and what it is told of its speed from afar helps."""
    plant = near(**ORBIT)
    keys: dict[str, Any] = {}
    far = create("sensor", kind, **(STATION if kind == "deep_space_station" else {}))
    if kind == "deep_space_station":
        keys = {"earth": example("body", "solar_orbit"), "epoch": EPOCH}
    _, flight = fly([*onboard(plant), far], **keys)
    low, high = chi_square_band(6, 64)
    assert flight.lost == 0
    assert (low < flight.nees.mean(axis=1)).all()
    assert (flight.nees.mean(axis=1) < high).all()
    seen = flight.seen[2].mean()
    assert seen > 0.0
    dof = float(flight.nis.sum() / flight.used.sum())
    assert 0.9 < dof < 1.1
    first, alone = flight.sigma[:, 0], _alone().sigma[:, 0]
    if kind == "sun_doppler":  # 0.1 mm/s away from the Sun, where only 1 mm/s was known
        np.testing.assert_allclose([first[3], alone[3]], [1e-4, 1e-3], rtol=0.02)
    if kind == "star_tracker":  # it knows of nothing that is estimated
        np.testing.assert_allclose(first, alone, rtol=1e-3)


@cache
def _alone() -> NavigationFlight:
    return fly(onboard(near(**ORBIT)))[1]


def test_sun_doppler_needs_no_angles_of_the_orbit() -> None:
    plant = near()
    shown: list[Array] = []
    for one in (plant, near(**ORBIT)):
        doppler = create("sensor", "sun_doppler")
        sky = sky_of([doppler], [one])
        x = np.array([*PLACE, 0.01, 0.02, -0.01])[:, None]
        scene = proximity_scene(one, [0, 1, 2], np.array([5e4]), x, sky)
        shown.append(doppler.observe(x, np.array([5e4]), scene))
    np.testing.assert_allclose(shown[0], shown[1], rtol=0, atol=1e-10)


def test_over_a_pole() -> None:
    plant = near(**ORBIT)
    _, flight = fly(onboard(plant), start={"position_m": [0.0, 0.0, 1500.0]})
    assert flight.lost == 0
    assert flight.nees.mean() < chi_square_band(6, 64)[1]


def test_refused_without_a_mission() -> None:
    station = create("sensor", "deep_space_station", **STATION)
    earth = example("body", "solar_orbit")
    with pytest.raises(InputError, match="takes 'earth', 'earth_axes' from"):
        fly([station])
    with pytest.raises(InputError, match="inclination, node and periapsis"):
        fly([station], near(), earth=earth, epoch=EPOCH)
    dated = create(
        "body", "asteroid", semi_major_axis_au=0.9, rotation_rate_rad_s=5e-5, epoch="2029-04-01",
        mean_anomaly_rad=1.0, **ORBIT,
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=1.8)
    plant = create("plant", "proximity", body=dated, gravity=gravity)
    assert sky_of([station], [plant], earth) is not None
    with pytest.raises(InputError, match="time is 0 at one date"):
        sky_of([station], [plant], earth, EPOCH)
    moon = create("plant", "hill", body=dated, gravity=gravity)
    with pytest.raises(InputError, match="takes 'to_body' from the scene"):
        sky_of(onboard(near()), [moon])


def test_report_says_how_lost_flights_ended() -> None:
    plant = near(**ORBIT)
    given = {"start": {"position_m": [0.0, -400.0, 0.0]}, "duration_h": 20, "law": None}
    stage, flight = fly(onboard(plant), **given)
    assert flight.lost > 0
    said = " ".join(stage.present(flight).verdict)
    ended = [ending for ending in flight.endings if ending != "completed"]
    assert len(ended) == flight.lost
    assert f"{flight.lost} of 64 flights were lost before their end: " in said
    assert f"{ended.count('impact')} impact" in said
