"""Times, rotation and places of the Earth against skyfield, over half a century and the globe.

Skyfield (B. Rhodes) has its own precession, nutation, sidereal time and ellipsoid; it shares no
code with ERFA. What both take from outside, UT1 − UTC, is given from one to the other.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skyfield.api import load, wgs84
from skyfield.framelib import itrs
from skyfield.positionlib import Geocentric
from skyfield.sgp4lib import TEME
from skyfield.units import Distance, Velocity

from hillsphere.base.geodetic import Station, geodetic
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame, earth_angle, earth_fixed, to_earth_fixed
from hillsphere.time import Epoch

DAY = 86400.0
DEGREE = np.pi / 180.0
# the paper's epoch, a day with a leap second, the day of a published space station, the present
DATES = ("1989-01-31T09:58:00", "2005-12-31T18:00:00", "2019-12-09T16:38:29", "2026-11-21T00:00:00")
PLACES = [(-2.18, -44.26, 39.0), (-15.53, -56.07, 277.0), (78.23, 15.39, 450.0),
          (-89.9, 179.9, 2800.0), (0.0, -180.0, -400.0), (51.5, 0.0, 35.8e6)]  # fmt: skip


@cache
def clock() -> Any:
    return load.timescale(builtin=True)


def at(epoch: Epoch, t_s: Array) -> Any:
    tai = epoch.to("TAI")
    return clock().tai_jd(tai.day, tai.fraction + t_s / DAY)


def matrices(frame: InertialFrame, when: Any) -> Array:
    """Return skyfield's turn from the frame to the Earth, without polar motion."""
    fixed = itrs.rotation_at(when)
    if frame == "teme":
        fixed = np.einsum("ij...,kj...->ik...", fixed, TEME.rotation_at(when))
    return np.asarray(fixed)


def test_sidereal_time_of_kuga_and_carrara_1990() -> None:
    """GMST of 1982 at their epoch with UT1 := UTC: 280.10106735°, from the equation itself."""
    # JD 2447557.5 and 9 h 58 min; Aoki et al. (1982), seconds of time at 0 h UT1
    centuries = (2447557.5 - 2451545.0) / 36525.0
    zero_hours = 24110.54841 + centuries * (
        8640184.812866 + centuries * (0.093104 - 6.2e-6 * centuries)
    )
    part = (9.0 + 58.0 / 60.0) / 24.0
    # of sidereal to universal time
    ratio = 1.0 + (8640184.812866 + 2.0 * 0.093104 * centuries) / (36525.0 * DAY)
    expected = (zero_hours / 240.0 + 360.0 * ratio * part) % 360.0
    found = earth_angle("teme", Epoch.parse(DATES[0], "UTC"), np.zeros(1))[0] / DEGREE
    assert found == pytest.approx(expected, abs=1e-10)
    # at the Julian date rounded to nine digits, 1e-5 s off
    assert found == pytest.approx(280.10106735, abs=1e-7)


@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize("frame", ["teme", "gcrs"])
def test_the_earth_stands_as_in_skyfield(frame: InertialFrame, date: str) -> None:
    """Half a day: to 1e-9 rad (6 mm), by IAU 2000A and 2006 on both sides."""
    epoch = Epoch.parse(date, "UTC")
    t_s = np.linspace(0.0, DAY / 2.0, 13)
    when = at(epoch, t_s)
    # UT1 − UTC of the epoch, from where UT1 runs on through the leap second; −ΔT does not jump
    ut1 = float(when[0].dut1) - (when.delta_t - when.delta_t[0])
    for k in range(t_s.size):
        orientation = ConstantOrientation(float(ut1[k]))
        ours = earth_fixed(frame, epoch, t_s[k : k + 1], orientation)[:, :, 0]
        assert_allclose(ours, matrices(frame, when[k]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("date", DATES)
def test_states_turn_as_in_skyfield(date: str) -> None:
    epoch = Epoch.parse(date, "UTC")
    random = np.random.default_rng(1989)
    x = np.concatenate([random.normal(0.0, 7e6, (3, 1)), random.normal(0.0, 7e3, (3, 1))])
    when = at(epoch, np.zeros(1))[0]
    ours = to_earth_fixed("gcrs", x, epoch, np.zeros(1), ConstantOrientation(float(when.dut1)))
    there = Geocentric(
        Distance(m=x[:3, 0]).au, Velocity(km_per_s=x[3:, 0] / 1e3).au_per_d, when, center=399
    )
    place, speed = there.frame_xyz_and_velocity(itrs)
    assert_allclose(ours[:3, 0], place.m, rtol=0, atol=0.02)
    assert_allclose(ours[3:, 0], speed.m_per_s, rtol=0, atol=1e-4)


@pytest.mark.parametrize(("latitude", "longitude", "height"), PLACES)
def test_places_are_those_of_skyfield(latitude: float, longitude: float, height: float) -> None:
    station = Station("s", latitude * DEGREE, longitude * DEGREE, height)
    theirs = wgs84.latlon(latitude, longitude, height)
    assert_allclose(station.ecef_m, theirs.itrs_xyz.m, rtol=0, atol=1e-7)
    found = geodetic(station.ecef_m[:, None])
    when = clock().utc(2020, 1, 1)
    back = wgs84.geographic_position_of(theirs.at(when))
    assert found[0][0] == pytest.approx(back.latitude.radians, abs=1e-9)
    around = abs(float(found[1][0]) - back.longitude.radians)
    assert min(around, 2.0 * np.pi - around) < 1e-9  # ±180° are one
    assert found[2][0] == pytest.approx(back.elevation.m, abs=1e-2)
