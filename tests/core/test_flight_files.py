"""Orbits and flights of the library are drawn and written as orbit ephemeris messages."""

from __future__ import annotations

from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hillsphere as hs
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment, read_oem
from hillsphere.interfaces import Array, Plant
from hillsphere.model.frame_motion import frame_motion
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere.time import Epoch

EPOCH = "2027-06-01T00:00:00"
STATES = ("x", "y", "z", "vx", "vy", "vz")


def hill(**body: float) -> Plant:
    moon = hs.create(
        "body", "moon", name="phobos", primary_name="mars", primary_gm_km3_s2=42828.37,
        semi_major_axis_km=9377, **body,
    )  # fmt: skip
    gravity = hs.create("gravity", "point_mass", gm_m3_s2=7.1e5)
    return hs.create("plant", "hill", body=moon, gravity=gravity)


@pytest.fixture(scope="module")
def plant() -> Plant:
    return hill(
        pole_right_ascension_deg=317.67, pole_declination_deg=52.88, prime_meridian_deg=35.19
    )


@pytest.fixture(scope="module")
def orbits(plant: Plant) -> PeriodicOrbits:
    """Two Kepler circles close in, which nearly close: what is tested is how they are written."""
    unit = plant.scales
    radius = np.array([0.05, 0.08])
    rate = radius**-1.5 - 1.0
    zero = np.zeros(2)
    x0 = np.stack([radius, zero, zero, zero, rate * radius, zero]) * unit.of(plant.states)[:, None]
    return PeriodicOrbits(
        plant.frame, STATES, x0, 2.0 * np.pi / rate * unit.time_s, np.full(2, np.nan),
        np.zeros((6, 6, 2)), zero, ("near", "far"), unit.length_m, unit.time_s,
    )  # fmt: skip


def read(path: Path) -> list[OemSegment]:
    return read_oem(path.read_text("utf-8"))


def assert_printed(segment: OemSegment, x: Array) -> None:
    """Compare to the printed digits: 1 µm and 1 nm/s, and rounding of the numbers read."""
    np.testing.assert_allclose(segment.x[:3], x[:3], rtol=1e-15, atol=0.51e-6)
    np.testing.assert_allclose(segment.x[3:], x[3:], rtol=1e-15, atol=0.51e-9)


def test_one_revolution_comes_back(plant: Plant, orbits: PeriodicOrbits, tmp_path: Path) -> None:
    orbits["near"].write_oem(tmp_path / "near.oem", plant, epoch=EPOCH, points=50)
    (segment,) = read(tmp_path / "near.oem")
    assert (segment.object_name, segment.center_name) == ("NEAR", "PHOBOS")
    assert (segment.ref_frame, segment.epoch.scale) == ("ICRF", "TDB")
    flight = hs.Motion(plant).propagate(orbits.x0[:, 0], orbits.period_s[0], times_s=50)
    np.testing.assert_allclose(segment.t_s, flight.t_s, rtol=0, atol=1e-6)
    motion = frame_motion(plant, Epoch.parse(EPOCH), flight.t_s, {})
    turned = motion.to_inertial(flight.x)
    assert_printed(segment, turned)
    np.testing.assert_allclose(  # turning keeps distances
        np.linalg.norm(segment.x[:3], axis=0), np.linalg.norm(flight.x[:3], axis=0), rtol=1e-9
    )


def test_the_origin_may_be_the_primary(
    plant: Plant, orbits: PeriodicOrbits, tmp_path: Path
) -> None:
    for centre in ("Phobos", "Mars"):
        orbits[0].write_oem(tmp_path / centre, plant, epoch=EPOCH, centre=centre, points=9)
    moon, mars = (read(tmp_path / centre)[0] for centre in ("Phobos", "Mars"))
    assert mars.center_name == "MARS"
    apart = np.linalg.norm((mars.x - moon.x)[:3], axis=0)
    np.testing.assert_allclose(apart, 9377e3, rtol=1e-12)


def test_states_in_an_inertial_frame_are_written_as_they_are(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    x = random.normal(size=(6, 4, 2)) * 7e6
    t_s = np.array([[0.0, 300.0], [100.0, 400.0], [200.0, np.nan], [300.0, np.nan]])
    flights = Trajectories("gcrs", STATES, ("up", "up"), ("first", "second"), t_s, x)
    flights.write_oem(tmp_path / "up.oem", epoch=Epoch.parse(EPOCH, "UTC"))
    first, second = read(tmp_path / "up.oem")
    assert (first.center_name, first.ref_frame, first.epoch.scale) == ("EARTH", "GCRF", "UTC")
    assert_printed(first, x[:, :, 0])
    assert_printed(second, x[:, :2, 1])
    assert second.epoch.seconds_since(first.epoch) == pytest.approx(300.0, abs=1e-6)


def test_a_trajectory_is_written(plant: Plant, orbits: PeriodicOrbits, tmp_path: Path) -> None:
    flight = hs.Motion(plant).propagate(orbits.x0[:, 1], 600.0, times_s=5)
    flight.write_oem(tmp_path / "a.oem", epoch=EPOCH, plant=plant, name="CRAFT")
    orbits[1:].write_oem(
        tmp_path / "b.oem", plant, epoch=EPOCH, points=5, revolutions=600.0 / orbits.period_s[1]
    )
    one, other = read(tmp_path / "a.oem")[0], read(tmp_path / "b.oem")[0]
    assert one.object_name == "CRAFT"
    np.testing.assert_allclose(one.x, other.x, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "epoch: "),
        ({"epoch": "tomorrow"}, "tomorrow"),
        ({"epoch": EPOCH}, "plant: the states are given in hill:phobos"),
        ({"epoch": EPOCH, "plant": "unplaced"}, "no orientation"),
        ({"epoch": EPOCH, "plant": "placed", "centre": "venus"}, "centre: must be phobos or mars"),
    ],
)
def test_what_a_message_needs_is_named(
    keys: dict[str, Any], message: str, plant: Plant, orbits: PeriodicOrbits, tmp_path: Path
) -> None:
    plants = {"unplaced": hill(), "placed": plant}
    keys = {key: plants.get(value, value) for key, value in keys.items()}
    flight = orbits[0].fly(plant, points=3)
    with pytest.raises(InputError, match=message):
        flight.write_oem(tmp_path / "none.oem", **keys)
    assert not list(tmp_path.iterdir())


def test_a_message_is_of_one_object(plant: Plant, orbits: PeriodicOrbits, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"2 plans.*flights\['near'\]"):
        orbits.write_oem(tmp_path / "both.oem", plant, epoch=EPOCH)
    with pytest.raises(InputError, match="plant: it has the states"):
        orbits.fly(hs.create("plant", "hill", body=hs.create("body", "moon",
                   primary_gm_km3_s2=42828.37, semi_major_axis_km=9377, name="deimos"),
                   gravity=hs.create("gravity", "point_mass", gm_m3_s2=1e5)))  # fmt: skip


def test_flights_are_chosen(plant: Plant, orbits: PeriodicOrbits) -> None:
    flights = orbits.fly(plant, points=4)
    assert (len(flights), flights["far"].labels, flights[-1].labels) == (2, ("far",), ("far",))
    assert [one.plans for one in flights] == [("near",), ("far",)]
    np.testing.assert_array_equal(flights[1:].x, flights["far"].x)
    np.testing.assert_allclose(flights.x[:, 0], orbits.x0)
    with pytest.raises(InputError, match="did you mean 'near'"):
        flights["nera"]


@pytest.mark.parametrize("renderer", ["plotly", "matplotlib"])
def test_a_figure_has_a_curve_per_orbit(
    renderer: Any, plant: Plant, orbits: PeriodicOrbits
) -> None:
    figure = orbits.plot(plant, renderer, points=30)
    if renderer == "plotly":
        assert [line.name for line in figure.data] == ["near", "far"]
        x = np.frombuffer(b64decode(figure.data[0].x["bdata"]), figure.data[0].x["dtype"])
        assert x.shape == (30,)
        assert np.max(x) == pytest.approx(orbits.x0[0, 0] / 1e3, rel=1e-2)
    else:
        lines = [line for line in figure.axes[0].get_lines() if len(line.get_data_3d()[0]) == 30]
        assert len(lines) == 2


def test_nothing_is_not_drawn(plant: Plant, orbits: PeriodicOrbits) -> None:
    with pytest.raises(InputError, match="no flight to draw"):
        orbits[:0].plot(plant)
