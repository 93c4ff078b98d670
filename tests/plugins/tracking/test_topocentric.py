"""Topocentric angles: against skyfield, against themselves backwards, and refraction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skyfield.api import EarthSatellite, load, wgs84

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.errors import InputError
from hillsphere_tracking.satellites import earth_fixed_states, orbits_of
from hillsphere_tracking.topocentric import (
    angles,
    apparent_elevation,
    geometric_elevation,
    rates,
    refraction,
    satellite_positions,
    satellite_states,
)

ALCANTARA = Station("Alcântara", np.radians(-2.18), np.radians(-44.26), 39.0)
NORTH = Station("Svalbard", np.radians(78.23), np.radians(15.39), 450.0)
STATION = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)
# of the verification of SGP4 by Vallado and others (2006, AIAA 2006-6753)
MOLNIYA = (
    "1 08195U 75081A   06176.33215444  .00000099  00000-0  11873-3 0   813",
    "2 08195  64.1586 279.0717 6877146 264.7651  20.2257  2.00491383225656",
)
GEOSTATIONARY = (
    "1 28626U 05008A   06176.46683397 -.00000205  00000-0  10000-3 0  2190",
    "2 28626   0.0019 286.9433 0000335  13.7918  55.6504  1.00270176  4891",
)
SUN_SYNCHRONOUS = (
    "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836",
    "2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550",
)


def test_space_station_over_alcantara() -> None:
    """One value computed with skyfield, UT1 − UTC = −0.17258 s."""
    (orbit,) = orbits_of("\n".join(STATION), "tle")
    orientation = ConstantOrientation(-0.17258)
    x = earth_fixed_states(orbit, orbit.epoch, np.array([390.0 * 60.0]), orientation)
    azimuth, elevation, distance = angles(ALCANTARA, x[:3])
    assert np.degrees(azimuth[0]) == pytest.approx(47.551038, abs=5e-6)
    assert np.degrees(elevation[0]) == pytest.approx(20.253369, abs=5e-6)
    assert distance[0] == pytest.approx(1020887.3, abs=0.5)


@pytest.mark.parametrize(
    "lines", [STATION, MOLNIYA, GEOSTATIONARY, SUN_SYNCHRONOUS],
    ids=["low", "molniya", "geo", "sun-synchronous"],
)  # fmt: skip
@pytest.mark.parametrize("station", [ALCANTARA, NORTH], ids=["equator", "arctic"])
def test_skyfield_over_a_day(lines: tuple[str, str], station: Station) -> None:
    clock = load.timescale(builtin=True)
    (orbit,) = orbits_of("\n".join(lines), "tle")
    t_s = np.linspace(0.0, 86400.0, 400)
    tai = orbit.epoch.to("TAI")
    when = clock.tai_jd(tai.day, tai.fraction + t_s / 86400.0)
    place = wgs84.latlon(
        np.degrees(station.latitude_rad), np.degrees(station.longitude_rad), station.height_m
    )
    seen = (EarthSatellite(*lines, ts=clock) - place).at(when)
    elevation, azimuth, distance, d_elevation, d_azimuth, d_distance = seen.frame_latlon_and_rates(
        place
    )
    orientation = ConstantOrientation(float(when.dut1[0]))
    # what the day changes in UT1 − UTC, as an angle; skyfield's table moves with every time
    drift = 7.3e-5 * np.ptp(when.dut1)
    assert drift < np.radians(1e-6)
    x = earth_fixed_states(orbit, orbit.epoch, t_s, orientation)
    ours = rates(station, x)
    limit = np.radians(1e-5)
    level = np.cos(ours[1])
    turned = (ours[0] - azimuth.radians + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(turned * level).max() < limit
    assert np.abs(ours[1] - elevation.radians).max() < limit
    np.testing.assert_allclose(ours[2], distance.m, rtol=0, atol=3.0)
    np.testing.assert_allclose(ours[3] * level, d_azimuth.radians.per_second * level,
                               rtol=0, atol=2e-8)  # fmt: skip
    np.testing.assert_allclose(ours[4], d_elevation.radians.per_second, rtol=0, atol=2e-8)
    np.testing.assert_allclose(ours[5], d_distance.m_per_s, rtol=0, atol=0.02)


@given(
    azimuth=st.floats(0.0, 6.28),
    elevation=st.floats(-1.57, 1.57),
    distance=st.floats(1e4, 5e7),
    latitude=st.floats(-1.57, 1.57),
)
def test_there_and_back(azimuth: float, elevation: float, distance: float, latitude: float) -> None:
    station = Station("s", latitude, 1.0, 100.0)
    given_angles = (np.array([azimuth]), np.array([elevation]), np.array([distance]))
    found = angles(station, satellite_positions(station, *given_angles))
    np.testing.assert_allclose(found[1], elevation, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[2], distance, rtol=1e-12, atol=1e-8)
    turned = (found[0] - azimuth + np.pi) % (2.0 * np.pi) - np.pi
    # 1e-9 m of rounding in the Earth-fixed position
    assert abs(turned[0]) * np.cos(elevation) * distance < 1e-7 * max(1.0, distance / 1e7)
    d_given = tuple(np.array([q]) for q in (1e-3, -2e-3, 700.0))
    back = rates(station, satellite_states(station, *given_angles, *d_given))
    if np.cos(elevation) > 1e-3:
        np.testing.assert_allclose(back[3], 1e-3, rtol=1e-5, atol=0)
    np.testing.assert_allclose(back[4], -2e-3, rtol=1e-6, atol=0)
    np.testing.assert_allclose(back[5], 700.0, rtol=1e-6, atol=0)


def test_rates_are_derivatives() -> None:
    (orbit,) = orbits_of("\n".join(MOLNIYA), "tle")
    h = 0.01
    t_s = np.arange(0.0, 43200.0, 600.0)
    x = earth_fixed_states(orbit, orbit.epoch, t_s)
    ahead, behind = (
        np.concatenate([x[:3] + sign * h * x[3:], x[3:]]) for sign in (1.0, -1.0)
    )  # fmt: skip
    now, after, before = (rates(NORTH, y) for y in (x, ahead, behind))
    for k in range(3):
        step = (after[k] - before[k] + np.pi) % (2.0 * np.pi) - np.pi if k == 0 else (
            after[k] - before[k]
        )  # fmt: skip
        np.testing.assert_allclose(now[3 + k], step / (2.0 * h), rtol=1e-5, atol=1e-6)


def test_zenith_and_north() -> None:
    up = ALCANTARA.ecef_m + 5e5 * ALCANTARA.axes[2]
    x = np.concatenate([up, 7e3 * ALCANTARA.axes[0]])[:, None]
    azimuth, elevation, distance, d_azimuth, d_elevation, d_distance = rates(ALCANTARA, x)
    assert elevation[0] == pytest.approx(np.pi / 2, abs=1e-8)
    assert distance[0] == pytest.approx(5e5)
    assert np.isfinite([azimuth, d_azimuth, d_distance]).all()
    # rounding puts the satellite a nanometre off the zenith, on whatever side
    assert abs(d_elevation[0]) <= 7e3 / 5e5 * (1.0 + 1e-12)
    # a hair west of north is not a full turn
    station = Station("s", 0.0, 0.0, 0.0)
    near = station.ecef_m + np.array([0.0, -1e-20, 1e6])
    assert angles(station, near[:, None])[0][0] == 0.0


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(InputError, match=r"positions must be \(3, N\), got \(6, 2\)"):
        angles(NORTH, np.zeros((6, 2)))
    with pytest.raises(InputError, match=r"states must be \(6, N\), got \(3,\)"):
        rates(NORTH, np.zeros(3))


def test_bennetts_refraction() -> None:
    """Bennett (1982): 34.5′ at the horizon, 9.88′ (0.165°) at 5°, 5.3′ at 10°; 0 at the zenith."""
    minutes = np.degrees(refraction(np.radians([0.0, 5.0, 10.0, 90.0]))) * 60.0
    np.testing.assert_allclose(minutes, [34.48, 9.88, 5.40, 0.0], rtol=0, atol=0.01)
    assert np.degrees(refraction(np.radians([5.0])))[0] == pytest.approx(0.165, abs=5e-4)
    # proportional to the density of the air
    thin = refraction(np.radians([5.0]), 505.0, 10.0)
    assert np.degrees(thin[0]) * 120.0 == pytest.approx(minutes[1])


@given(st.floats(-1.5, 1.5707), st.floats(0.0, 1085.0), st.floats(-60.0, 50.0))
def test_refraction_there_and_back(elevation: float, pressure: float, temperature: float) -> None:
    seen = apparent_elevation(np.array([elevation]), pressure, temperature)
    assert seen[0] >= elevation
    back = geometric_elevation(seen, pressure, temperature)
    np.testing.assert_allclose(back, elevation, rtol=0, atol=1e-13)
