"""The Sun: where an almanac has it, and the shadow of the Earth."""

from __future__ import annotations

import erfa
import numpy as np
import pytest

from hillsphere.base.geodetic import WGS84, Ellipsoid
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.time import Epoch
from hillsphere_tracking.sun import SUN_RADIUS_M, shadow_margin, sun_earth_fixed, sun_gcrs

AU = 1.495978707e11


def test_meeus_example_25b() -> None:
    """Meeus, Astronomical Algorithms, 1998: 1992 October 13.0 TD, from the full VSOP87.

    Apparent right ascension 13h13m30.749s, declination −7°47′01.74″, 0.99760775 au.
    """
    epoch = Epoch.parse("1992-10-13", "TT")
    sun = sun_gcrs(epoch, np.zeros(1))[:, 0]
    of_date = erfa.pnm06a(epoch.day, epoch.fraction) @ sun
    longitude, latitude = erfa.c2s(of_date)
    ascension = 15.0 * (13.0 + 13.0 / 60.0 + 30.749 / 3600.0)
    declination = -(7.0 + 47.0 / 60.0 + 1.74 / 3600.0)
    assert np.degrees(longitude) % 360.0 == pytest.approx(ascension, abs=3e-5)
    assert np.degrees(latitude) == pytest.approx(declination, abs=3e-5)
    assert np.linalg.norm(sun) / AU == pytest.approx(0.99760775, abs=1e-6)


def test_low_precision_formula_over_years() -> None:
    """Montenbruck and Gill (2000), eq. (3.43)-(3.47): a few arc minutes near 2000."""
    epoch = Epoch.parse("2000-01-01T12:00:00", "TT")
    t_s = np.linspace(-10.0, 10.0, 401) * 365.25 * 86400.0
    century = t_s / 86400.0 / 36525.0
    anomaly = np.radians(357.5256 + 35999.049 * century)
    longitude = np.radians(282.94) + anomaly + np.radians(
        6892.0 / 3600.0 * np.sin(anomaly) + 72.0 / 3600.0 * np.sin(2.0 * anomaly)
    )  # fmt: skip
    distance = 1e9 * (149.619 - 2.499 * np.cos(anomaly) - 0.021 * np.cos(2.0 * anomaly))
    tilt = np.radians(23.43929111)
    direction = np.array(
        [np.cos(longitude), np.sin(longitude) * np.cos(tilt), np.sin(longitude) * np.sin(tilt)]
    )
    sun = sun_gcrs(epoch, t_s)
    size = np.linalg.norm(sun, axis=0)
    apart = np.arccos(np.clip(np.sum(direction * sun, axis=0) / size, -1.0, 1.0))
    assert np.degrees(apart).max() * 60.0 < 3.0
    np.testing.assert_allclose(size, distance, rtol=1e-3, atol=0)


def test_any_times_at_once_or_one_by_one() -> None:
    epoch = Epoch.parse("2026-03-20", "UTC")
    t_s = np.array([0.0, 1e4, 1e6, -3e5])
    together = sun_gcrs(epoch, t_s)
    for k in range(4):
        assert np.array_equal(sun_gcrs(epoch, t_s[k : k + 1])[:, 0], together[:, k])


def test_turned_to_the_earth_as_erfa_does() -> None:
    """UT1 − UTC = 0.1 s, without polar motion, by the matrix of IAU 2006/2000A."""
    epoch = Epoch.parse("2019-12-10T12:00:00", "UTC")
    orientation = ConstantOrientation(0.1)
    sun = sun_earth_fixed(epoch, np.zeros(1), orientation)[:, 0]
    tt = epoch.to("TT")
    turn = erfa.c2t06a(tt.day, tt.fraction, epoch.day, epoch.fraction + 0.1 / 86400.0, 0.0, 0.0)
    expected = turn @ sun_gcrs(epoch, np.zeros(1))[:, 0]
    np.testing.assert_allclose(sun, expected, rtol=0, atol=1e-9 * AU)
    # noon at Greenwich: the Sun is south of it, in winter as far south as it goes
    assert abs(np.degrees(np.arctan2(sun[1], sun[0]))) < 4.0
    assert np.degrees(np.arcsin(sun[2] / np.linalg.norm(sun))) == pytest.approx(-22.9, abs=0.1)


def test_shadow_of_a_sphere() -> None:
    """On the axis, and at the edges of the cones of umbra and penumbra."""
    sphere = Ellipsoid(6378137.0, np.inf)
    distance, far = 4.2e7, AU
    # the cones' tips are where the discs fit each other: edges by similar triangles
    umbra = 6378137.0 - distance * (SUN_RADIUS_M - 6378137.0) / far
    penumbra = 6378137.0 + distance * (SUN_RADIUS_M + 6378137.0) / far
    sun = np.array([[far], [0.0], [0.0]])
    for edge, part in ((umbra, "umbra"), (penumbra, "penumbra")):
        for off, sign in ((-20e3, 1.0), (20e3, -1.0)):
            r = np.array([[-distance], [edge + off], [0.0]])
            margin = shadow_margin(r, sun, part, sphere)  # type: ignore[arg-type]
            assert np.sign(margin[0]) == sign
    assert shadow_margin(np.array([[-distance], [0.0], [0.0]]), sun, "umbra", sphere)[0] > 0.1
    assert shadow_margin(np.array([[distance], [0.0], [0.0]]), sun, "umbra", sphere)[0] < -2.0


def test_the_shadow_is_as_flat_as_the_earth() -> None:
    sun = np.array([[AU], [0.0], [0.0]])
    for along, radius in ((1, 6378137.0), (2, 6356752.3)):
        r = np.array([[-7e6], [0.0], [0.0]])
        edge = radius - 7e6 * (SUN_RADIUS_M - radius) / AU
        r[along] = edge - 3e3
        assert shadow_margin(r, sun, "umbra", WGS84)[0] > 0.0
        r[along] = edge + 3e3
        assert shadow_margin(r, sun, "umbra", WGS84)[0] < 0.0
