"""Flights of every plant in inertial axes, against positions computed another way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import Motion, create
from hillsphere.errors import InputError
from hillsphere.formats.oem import read_oem
from hillsphere.formats.opm import read_opm
from hillsphere.interfaces import Array
from hillsphere.model.frame_motion import craft_rows, epoch_of, frame_motion
from hillsphere.products import FlightSet, Trajectories
from hillsphere.testing import RecordingContext
from hillsphere.time import Epoch

POLE = {"pole_right_ascension_deg": 317.67, "pole_declination_deg": 52.88,
        "prime_meridian_deg": 35.18}  # fmt: skip
EPOCH = "2027-06-01T00:00:00"
STATES = ("x", "y", "z", "vx", "vy", "vz")
GRAVITY = create("gravity", "point_mass", gm_m3_s2=7.06e5)


def moon(**keys: Any) -> Any:
    return create("body", "moon", name="phobos", primary_name="mars", primary_gm_km3_s2=42828.37,
                  semi_major_axis_km=9376, eccentricity=0.0151, libration_amplitude_deg=-1.09,
                  **keys)  # fmt: skip


def eros(**keys: Any) -> Any:
    return create("body", "asteroid", name="eros", semi_major_axis_m=2.18e11, eccentricity=0.22,
                  rotation_rate_deg_d=1639.389, semi_axes_m=[17e3, 6e3, 5e3], **keys)  # fmt: skip


ANGLES = {"inclination_deg": 10.8, "node_deg": 304.3, "periapsis_deg": 178.9,
          "mean_anomaly_deg": 20.0}  # fmt: skip


def plants() -> dict[str, Any]:
    spacecraft = [{"name": "a"}, {"name": "b"}]
    return {
        "hill": create("plant", "hill", body=moon(**POLE), gravity=GRAVITY),
        "circle": create("plant", "three_body", body=moon(**POLE), gravity=GRAVITY),
        "ellipse": create("plant", "three_body", body=moon(**POLE), gravity=GRAVITY,
                          orbit="elliptic", rotation="libration"),
        "spin": create("plant", "three_body", body=eros(**POLE), gravity=GRAVITY,
                       orbit="elliptic", rotation="spin"),
        "proximity": create("plant", "proximity", body=eros(**ANGLES), gravity=GRAVITY,
                            spacecraft=spacecraft),
        "heliocentric": create("plant", "heliocentric", bodies=spacecraft),
    }  # fmt: skip


PLANTS = plants()


@pytest.mark.parametrize("name", PLANTS)
def test_velocities_are_the_derivatives_of_positions_and_states_come_back(name: str) -> None:
    """A point that moves uniformly in the frame: central differences over 2 s, about each body."""
    plant = PLANTS[name]
    t = 5000.0 + np.array([0.0, 4999.0, 5000.0, 5001.0])
    others = plant.others_over_time({"true_anomaly": 0.7, "rotation_angle": 0.2}, t)
    motion = frame_motion(plant, Epoch.parse(EPOCH), t, others)
    speed = np.array([3.0, 8.0, -2.0])[:, None]
    place = np.array([3e4, -5e4, 2e4])[:, None] + speed * (t - t[2])
    x = np.concatenate([place, np.broadcast_to(speed, place.shape)])
    for centre in motion.centres:
        inertial = motion.to_inertial(x, centre)
        slope = (inertial[:3, 3] - inertial[:3, 1]) / 2.0
        # the cubic term a'/6: (2.3e-4 rad/s)³ 1e7 m about Mars; rounding 1e-16 2e11 m about the Sun
        np.testing.assert_allclose(inertial[3:, 2], slope, rtol=0, atol=6e-5)
        size = np.abs(inertial[:3]).max()
        back = motion.from_inertial(inertial, centre)
        np.testing.assert_allclose(back[:3], x[:3], rtol=0, atol=1e-9 + 4e-16 * size)
        np.testing.assert_allclose(back[3:], x[3:], rtol=0, atol=1e-9)


def test_the_primary_of_an_ellipse_is_where_kepler_puts_it() -> None:
    """Distance a(1 − e cos E), and the libration that the body's own frame makes."""
    plant = PLANTS["ellipse"]
    t = np.linspace(0.0, 27000.0, 9)
    others = plant.others_over_time({"true_anomaly": 0.7}, t)
    motion = frame_motion(plant, Epoch.parse(EPOCH), t, others)
    x = motion.to_inertial(np.zeros((6, t.size)), "mars")
    e, anomaly = 0.0151, others["true_anomaly"]
    np.testing.assert_allclose(
        np.linalg.norm(x[:3], axis=0), 9376e3 * (1 - e * e) / (1 + e * np.cos(anomaly)), rtol=1e-12
    )
    # the moon's plane and the sense of its motion; its angle about the pole is the true anomaly
    node = np.cross(x[:3, 0], x[:3, 3])
    angle = np.arccos(x[:3, 0] @ x[:3, 1] / np.prod(np.linalg.norm(x[:3, :2], axis=0)))
    assert angle == pytest.approx((anomaly[1] - anomaly[0]) % (2 * np.pi), abs=1e-9)
    pole = np.radians([317.67, 52.88])
    north = [np.cos(pole[1]) * np.cos(pole[0]), np.cos(pole[1]) * np.sin(pole[0]), np.sin(pole[1])]
    np.testing.assert_allclose(node / np.linalg.norm(node), north, atol=1e-12)


def flight(frame: str, x: Array, names: tuple[str, ...] = STATES) -> FlightSet:
    """Return two coasts that meet at 100 s, with a jump in velocity there."""
    t = np.array([[0.0, 100.0], [50.0, 200.0], [100.0, np.nan]])
    states = np.full((len(names), 3, 2), np.nan)
    for row in range(len(names)):
        states[row, :, 0] = x[row]
        states[row, :2, 1] = x[row]
    states[3, :2, 1] += 0.25
    return FlightSet(Trajectories(frame, names, ("go",) * 2, ("first", "second"), t, states))


def shown(plant: Any, given: FlightSet, **keys: Any) -> dict[str, str]:
    stage = create("stage", "ephemeris", plant=plant, needs={"flights": ["a"]}, **keys)
    product = stage.run(RecordingContext(), flights=(given,))
    files = stage.present(product, flights=(given,)).files
    return {name: text for name, text in files.items() if isinstance(text, str)}


def test_impulses_are_manoeuvres_of_an_opm() -> None:
    """Turned by the axes at the impulse: the size stays, the direction is that of the frame's x."""
    plant = PLANTS["hill"]
    x = np.array([3e4, -5e4, 2e4, 1.0, 2.0, 3.0])
    files = shown(plant, flight(plant.frame, x), epoch=EPOCH)
    opm = read_opm(files["go.opm"])
    (impulse,) = opm.manoeuvres
    axes = frame_motion(plant, Epoch.parse(EPOCH), np.array([100.0]), {}).axes[:, :, 0]
    np.testing.assert_allclose(impulse.dv, 0.25 * axes[:, 0], atol=1e-9)
    assert impulse.epoch.seconds_since(Epoch.parse(EPOCH)) == pytest.approx(100.0, abs=1e-6)
    first = read_oem(files["go.oem"])[0]
    np.testing.assert_allclose(opm.x, first.x[:, 0], atol=1e-5)
    assert (opm.center_name, opm.frame) == ("PHOBOS", "ICRF")


def test_each_spacecraft_has_its_own_file() -> None:
    plant = PLANTS["proximity"]
    names = tuple(v.name for v in plant.states)
    x = np.arange(12.0) * 100.0
    files = shown(plant, flight(plant.frame, x, names), epoch=EPOCH)
    assert {"go-a.oem", "go-b.oem", "go-a.opm"} <= set(files)
    for name, rows in zip(("go-a.oem", "go-b.oem"), craft_rows(names), strict=True):
        first = read_oem(files[name])[0]
        assert first.center_name == "EROS"
        distance = np.linalg.norm(x[rows[:3]])
        np.testing.assert_allclose(np.linalg.norm(first.x[:3], axis=0), distance, atol=1e-5)


@pytest.mark.parametrize(
    ("plant", "keys", "message"),
    [
        (lambda: create("plant", "hill", body=moon(), gravity=GRAVITY), {"epoch": EPOCH},
         "pole_right_ascension_deg"),
        (lambda: create("plant", "three_body", body=moon(), gravity=GRAVITY), {"epoch": EPOCH},
         "pole_right_ascension_deg"),
        (lambda: create("plant", "proximity", body=eros(), gravity=GRAVITY,
                        spacecraft=[{"name": "a"}]), {"epoch": EPOCH}, "inclination_deg"),
        (lambda: PLANTS["hill"], {}, "^epoch: .* give it"),
        (lambda: PLANTS["spin"], {"epoch": EPOCH, "centre": "primary"}, "^centre: expected 'moon'"),
    ],
)  # fmt: skip
def test_what_is_missing_is_named(plant: Any, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        create("stage", "ephemeris", plant=plant(), needs={"flights": ["a"]}, **keys)


def test_the_epoch_of_a_plant_is_the_default() -> None:
    body = create("body", "planet")
    plant = create("plant", "earth_orbit", body=body, epoch="2026-03-01T00:00:00", frame="teme",
                   gravity=create("gravity", "point_mass", gm_m3_s2=3.986e14))  # fmt: skip
    assert epoch_of(plant, None, "UTC").isot(np.zeros(1), 0) == ["2026-03-01T00:00:00"]
    x = np.array([7e6, 0.0, 0.0, 0.0, 7.5e3, 0.0])
    files = shown(plant, flight("teme", x), time_scale="UTC")
    first = read_oem(files["go.oem"])[0]
    assert (first.ref_frame, first.center_name, first.epoch.scale) == ("TEME", "EARTH", "UTC")
    np.testing.assert_allclose(first.x[:, 0], x, atol=1e-6)


def test_coasts_of_a_closed_loop_with_impulses_are_ballistic() -> None:
    """Each one from behind its impulse to the next, flown anew by the plant alone."""
    plant = PLANTS["hill"]
    gain = [[1e-4, 0, 0, 1, 0, 0], [0, 1e-4, 0, 0, 1, 0], [0, 0, 1e-4, 0, 0, 1]]
    law = create("compensator", "impulsive", period_h=6, gain=gain)
    loop = create("stage", "closed_loop", plant=plant, law=law, samples=3, substeps=50,
                  target={"position_km": [0, 60, 0]},
                  start={"position_km": [0.1, 60, 0.1], "velocity_m_s": [0, 0, 0]})  # fmt: skip
    flown = loop.run(RecordingContext()).to_trajectories()
    assert len(flown) == 3
    for k in range(3):
        t, x = flown.t_s[:, k], flown.x[:, :, k]
        again = Motion(plant).propagate(x[:, 0], t[-1] - t[0], times_s=2).x[:, -1]
        np.testing.assert_allclose(again, x[:, -1], rtol=0, atol=1e-6)
