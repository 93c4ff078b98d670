"""Ground tracks, and where they leave a map."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from skyfield.api import EarthSatellite, load, wgs84

from hillsphere.base.orientation import ConstantOrientation
from hillsphere_tracking.ground_track import EarthTrack, ground_points, split_at_wrap
from hillsphere_tracking.satellites import orbits_of

LINES = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)


def test_ground_points_are_those_of_skyfield() -> None:
    (orbit,) = orbits_of("\n".join(LINES), "tle")
    clock = load.timescale(builtin=True)
    t_s = np.linspace(0.0, 20000.0, 60)
    tai = orbit.epoch.to("TAI")
    when = clock.tai_jd(tai.day, tai.fraction + t_s / 86400.0)
    path = EarthTrack(orbit, orbit.epoch, 86400.0, ConstantOrientation(float(when.dut1[0])))
    latitude, longitude, height = ground_points(path.states(t_s)[:3])
    theirs = wgs84.geographic_position_of(EarthSatellite(*LINES, ts=clock).at(when))
    limit = np.radians(1e-5)
    np.testing.assert_allclose(latitude, theirs.latitude.radians, rtol=0, atol=limit)
    turned = (longitude - theirs.longitude.radians + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(turned).max() < limit
    np.testing.assert_allclose(height, theirs.elevation.m, rtol=0, atol=1.0)


def test_ascending_nodes_are_where_the_track_crosses_the_equator() -> None:
    (orbit,) = orbits_of("\n".join(LINES), "tle")
    path = EarthTrack(orbit, orbit.epoch, 86400.0)
    nodes = path.node_times()
    # 15.5 revolutions a day
    assert nodes.size in (15, 16)
    x = path.states(nodes)
    assert np.abs(x[2]).max() < 7e3
    assert (x[5] > 0.0).all()


def test_what_every_station_asks_first_is_computed_once() -> None:
    (orbit,) = orbits_of("\n".join(LINES), "tle")
    path = EarthTrack(orbit, orbit.epoch, 86400.0)
    assert path.states(path.times_s) is path.states(path.times_s.copy())


def test_a_track_is_broken_at_the_date_line() -> None:
    longitude, latitude = split_at_wrap(
        np.array([170.0, 178.0, -178.0, -170.0, 175.0]), np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 360.0
    )
    np.testing.assert_allclose(
        longitude,
        [170.0, 178.0, 180.0, np.nan, -180.0, -178.0, -170.0, -180.0, np.nan, 180.0, 175.0],
    )
    np.testing.assert_allclose(
        latitude,
        [0.0, 1.0, 1.5, np.nan, 1.5, 2.0, 3.0, 3.0 + 10.0 / 15.0, np.nan, 3.0 + 10.0 / 15.0, 4.0],
    )


@given(st.lists(st.floats(-170.0, 170.0), min_size=1, max_size=30), st.floats(-180.0, 179.9))
def test_no_line_ever_crosses_the_map(steps: list[float], first: float) -> None:
    longitude = (np.cumsum([first, *steps]) + 180.0) % 360.0 - 180.0
    x, y = split_at_wrap(longitude, np.zeros(longitude.size), 360.0)
    assert x.size == y.size
    step = np.abs(np.diff(x))
    assert not (step > 180.0).any()
    assert np.array_equal(np.isnan(x), np.isnan(y))
