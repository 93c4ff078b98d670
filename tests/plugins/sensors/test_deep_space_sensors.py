"""Stations on the Earth and the Doppler shift of sunlight, by other ways."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2 as GM
from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.ephemeris import KeplerOrbit, hill_axes, kepler_step
from hillsphere.testing import example
from hillsphere.time import Epoch
from hillsphere_sensors.heliocentric import heliocentric_scene

EPOCH = Epoch.parse("2029-03-01T00:00:00", "TDB")
C = 299792458.0
GOLDSTONE = {"station": "Goldstone", "latitude_deg": 35.4259, "longitude_deg": -116.8896,
             "height_m": 986.0}  # fmt: skip


def asteroid() -> Any:
    return create(
        "body", "asteroid", name="apophis", semi_major_axis_au=0.9224, eccentricity=0.1912,
        inclination_rad=0.05814, node_rad=3.5682, periapsis_rad=2.2061, mean_anomaly_rad=1.0,
        rotation_rate_rad_s=5.8177e-5,
    )  # fmt: skip


EARTH = example("body", "solar_orbit")
ORBIT = KeplerOrbit.of(asteroid())


def station(**keys: Any) -> Any:
    return create("sensor", "deep_space_station", **{**GOLDSTONE, **keys})


def spacecraft(t: Array) -> Array:
    """Return states on a heliocentric orbit 1e7 m from the asteroid."""
    start = ORBIT.states(np.zeros(1))
    start += np.array([[6e6], [-7e6], [4e6], [0.3], [-0.1], [0.2]])
    return kepler_step(np.repeat(start, t.size, axis=1), t, GM)


def place_of_station(t: float) -> Array:
    """Return the heliocentric place, m."""
    scene = heliocentric_scene(np.array([t]), EPOCH, EARTH)
    latitude, longitude = np.radians([35.4259, -116.8896])
    fixed = Station("Goldstone", float(latitude), float(longitude), 986.0).ecef_m
    return np.asarray(scene["earth"][:3, 0] + scene["earth_axes"][:, :, 0].T @ fixed)


def test_light_time() -> None:
    """Range by a bracketed search for the time at which the light left, and its rate by it."""
    t = np.array([0.0, 3e4, 7e4])
    found = station().observe(spacecraft(t), t, heliocentric_scene(t, EPOCH, EARTH))

    def distance(now: float) -> float:
        there = place_of_station(now)

        def miss(delay: float) -> float:
            r = spacecraft(np.array([now - delay]))[:3, 0]
            return float(np.linalg.norm(r - there)) / C - delay

        return C * float(brentq(miss, 0.0, 5000.0, xtol=1e-14, rtol=1e-15))

    want = [distance(now) for now in t]
    np.testing.assert_allclose(found[0], want, rtol=0, atol=1e-3)
    rates = [(distance(now + 10.0) - distance(now - 10.0)) / 20.0 for now in t]
    np.testing.assert_allclose(found[1], rates, rtol=0, atol=1e-4)
    # the rotation of the Earth stands out
    assert np.ptp(found[1]) > 50.0


def test_visibility_by_the_elevation() -> None:
    """Half a turn of the Earth later it is on the other side."""
    t = np.arange(0.0, 86400.0, 600.0)
    x, scene = spacecraft(t), heliocentric_scene(t, EPOCH, EARTH)
    seen = station(mask_elevation_deg=10).visible(x, t, scene)
    up = np.array([place_of_station(now) for now in t]).T - scene["earth"][:3]
    way = x[:3] - scene["earth"][:3]
    angle = np.pi / 2 - np.arccos(
        np.sum(up * way, axis=0) / np.linalg.norm(up, axis=0) / np.linalg.norm(way, axis=0)
    )
    off = np.abs(angle - np.radians(10.0)) > 0.005  # geodetic against geocentric zenith
    np.testing.assert_array_equal(seen[off], angle[off] > np.radians(10.0))
    assert 0.2 < seen.mean() < 0.7


def test_angles_and_night() -> None:
    t = np.arange(0.0, 86400.0, 1200.0)
    x, scene = spacecraft(t), heliocentric_scene(t, EPOCH, EARTH)
    telescope = station(measures=["angles"], mask_elevation_deg=0, sun_below_deg=12)
    way = x[:3] - scene["earth"][:3]
    found = telescope.observe(x, t, scene)
    # light time moves it by v/c, 1e-4 rad
    np.testing.assert_allclose(found[0], np.arctan2(way[1], way[0]), rtol=0, atol=4e-4)
    latitude = np.arcsin(way[2] / np.linalg.norm(way, axis=0))
    np.testing.assert_allclose(found[1], latitude, rtol=0, atol=4e-4)
    by_day = station(measures=["angles"], mask_elevation_deg=0)
    night, any_time = telescope.visible(x, t, scene), by_day.visible(x, t, scene)
    assert (night <= any_time).all()
    assert night.sum() < any_time.sum()
    sigma = telescope.sigma(x, t, scene)
    np.testing.assert_allclose(sigma[0] * np.cos(found[1]), sigma[1], rtol=1e-12)


@pytest.mark.parametrize("kind", ["deep_space_station", "sun_doppler"])
def test_hill_and_heliocentric_states_agree(kind: str) -> None:
    t = np.array([0.0, 4e4])
    made = station() if kind == "deep_space_station" else create("sensor", kind)
    x, origin = spacecraft(t), ORBIT.states(t, EPOCH)
    axes, rate = hill_axes(origin)
    away = np.einsum("ijn,in->jn", axes, (x - origin)[:3])
    speed = np.einsum("ijn,in->jn", axes, (x - origin)[3:]) - np.cross(rate, away, axis=0)
    inside = np.concatenate([away, speed])
    seen = made.observe(inside, t, heliocentric_scene(t, EPOCH, EARTH, asteroid()))
    want = made.observe(x, t, heliocentric_scene(t, EPOCH, EARTH))
    np.testing.assert_allclose(seen, want, rtol=0, atol=2e-4)
    np.testing.assert_allclose(seen[-1], want[-1], rtol=0, atol=1e-9)


def test_doppler_is_the_rate_of_the_distance() -> None:
    t = np.array([5e3])
    found = create("sensor", "sun_doppler").observe(
        spacecraft(t), t, heliocentric_scene(t, EPOCH, EARTH)
    )[0]
    later, before = (np.linalg.norm(spacecraft(t + h)[:3], axis=0) for h in (100.0, -100.0))
    np.testing.assert_allclose(found, (later - before) / 200.0, rtol=0, atol=1e-5)


def test_second_spacecraft_and_refusals() -> None:
    t = np.zeros(1)
    scene = heliocentric_scene(t, EPOCH, EARTH)
    two = np.concatenate([spacecraft(t + 1e5), spacecraft(t)])
    one = station().observe(spacecraft(t), t, scene)
    np.testing.assert_array_equal(station(spacecraft=2).observe(two, t, scene), one)
    with pytest.raises(InputError, match="lacks 'earth'"):
        station().observe(two, t, {k: v for k, v in scene.items() if k != "earth"})
    with pytest.raises(InputError, match="names something twice"):
        station(measures=["range", "range"])
