"""Passes whose times have a closed form, and the keyhole that a pass over the zenith runs into.

The satellite of Kuga and Carrara (1990) shows what keeps an antenna from following: near the
zenith the azimuth turns by half a revolution at once.
"""

from __future__ import annotations

from math import acos, asin, cos, inf, pi, radians, sin, sqrt, tau

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from hillsphere.base.geodetic import Ellipsoid, Station
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S, earth_angle
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.mean_elements import EARTH_FIELD, ZonalField
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.passes.passes import Passes, find_passes, peak_azimuth_rates
from hillsphere_tracking.satellites import MeanElementsOrbit
from hillsphere_tracking.topocentric import angles, line_of_sight

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
GM, RADIUS = 398600.4418e9, 6378137.0
SPHERE = Ellipsoid(RADIUS, inf)
OMEGA = ROTATION_RATES_RAD_S["teme"]


def circular(a: float, i: float) -> EarthTrack:
    """Return a day of a circular orbit about a point mass, at the node at the epoch."""
    field = ZonalField(GM, RADIUS, 0.0, 0.0)
    elements = np.array([a, 0.0, i, 0.0, 0.0, 0.0])
    return EarthTrack(MeanElementsOrbit("circle", EPOCH, elements, field), EPOCH, 86400.0)


def whole(found: Passes) -> Array:
    """Return rise, culmination and set of the passes that are not cut (3, P)."""
    kept = ~(found.begun | found.unfinished)
    return np.array([found.rise_s, found.culmination_s, found.set_s])[:, kept]


def half_width(a: float, mask: float) -> float:
    """Return the angle at the Earth's centre at which a satellite stands at the mask."""
    return acos(RADIUS / a * cos(mask)) - mask


@pytest.mark.parametrize("mask_deg", [0.0, 5.0, 40.0])
@pytest.mark.parametrize("i", [0.0, pi])
@pytest.mark.parametrize("a", [6.8e6, 7.18e6, 1.2e7])
def test_circular_equatorial_orbits_over_the_equator(a: float, i: float, mask_deg: float) -> None:
    """Satellite and station turn about one axis: with it at n − ω, against it at n + ω."""
    longitude = 0.7
    station = Station("equator", 0.0, longitude, 0.0, SPHERE)
    mask = radians(mask_deg)
    times = whole(find_passes(station, circular(a, i), HorizonMask((mask,))))
    sense = 1.0 if i == 0.0 else -1.0
    rate = sqrt(GM / a**3) - sense * OMEGA
    away = float(earth_angle("teme", EPOCH, np.zeros(1))[0]) + longitude
    tops = (sense * away % tau + tau * np.arange(20)) / rate
    half = half_width(a, mask) / rate
    tops = tops[(tops - half > 0.0) & (tops + half < 86400.0)]
    assert times.shape[1] == tops.size > 3
    # GMST's polynomial and the constant rate differ by 1e-11 of a turn in a day
    assert_allclose(times, [tops - half, tops, tops + half], rtol=0, atol=1e-5)


@pytest.mark.parametrize("pole", [0.5 * pi, -0.5 * pi])
@pytest.mark.parametrize("mask_deg", [0.0, 5.0, 30.0])
@pytest.mark.parametrize("i_deg", [75.0, 90.0, 98.2])
def test_circular_orbits_over_the_poles(i_deg: float, mask_deg: float, pole: float) -> None:
    """A pole does not turn: the satellite is above the mask while sin i sin u > cos λ."""
    a, i, mask = 7.4e6, radians(i_deg), radians(mask_deg)
    times = whole(
        find_passes(Station("pole", pole, 0.3, 0.0, SPHERE), circular(a, i), HorizonMask((mask,)))
    )
    n = sqrt(GM / a**3)
    sine = cos(half_width(a, mask)) / sin(i)
    if sine >= 1.0:  # too far from the pole for this mask
        assert times.shape[1] == 0
        return
    half = (0.5 * pi - asin(sine)) / n
    tops = ((0.5 * pi if pole > 0.0 else 1.5 * pi) + tau * np.arange(20)) / n
    tops = tops[(tops - half > 0.0) & (tops + half < 86400.0)]
    assert times.shape[1] == tops.size > 8
    assert_allclose(times, [tops - half, tops, tops + half], rtol=0, atol=2e-6)


def over(track: EarthTrack, t_s: float, highest_deg: float) -> Station:
    """Return the station that sees the satellite culminate so high, beside its track at t_s."""
    x = track.states(np.array([t_s]))[:, 0]
    below = Station.at("below", x[:3])
    side = np.cross(below.axes[2], x[3:])
    side /= np.linalg.norm(side)

    def moved(angle: float) -> Station:
        place = Station.at("beside", below.ecef_m * cos(angle) + RADIUS * sin(angle) * side)
        return Station("beside", place.latitude_rad, place.longitude_rad)

    def missing(angle: float) -> float:
        near = np.linspace(t_s - 20.0, t_s + 20.0, 4001)
        return float(angles(moved(angle), track.states(near)[:3])[1].max()) - radians(highest_deg)

    found = brentq(missing, 1e-5, 0.08, xtol=1e-12)
    return moved(float(found))


@pytest.mark.parametrize(
    ("highest_deg", "highest_half_digit", "rate_deg_s", "rate_half_digit"),
    [(81.3, 0.05, 2.3, 0.05), (88.6, 0.05, 14.0, 0.5), (89.93, 0.005, 264.0, 0.5)],
)
def test_the_azimuth_rate_peaks_in_high_passes(
    highest_deg: float, highest_half_digit: float, rate_deg_s: float, rate_half_digit: float
) -> None:
    """2.3°/s at 81.3°, 14°/s at 88.6°, 264°/s at 89.93°, for stations beside one flight.

    The momentary rate is that of the satellite's path over the ground as seen, times tan h: 284°/s
    in the last of them, where 264°/s is the mean over 0.2 s, in which the azimuth turns by 53°. The
    elevations are known to their last digit.
    """
    elements = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
    track = EarthTrack(MeanElementsOrbit("paper", EPOCH, elements, EARTH_FIELD), EPOCH, 86400.0)
    home = Station("Alcântara", radians(-2.18), radians(-44.26), 39.0)
    passes = find_passes(home, track, HorizonMask((radians(5.0),)))
    tops = angles(home, track.states(passes.culmination_s)[:3])[1]
    (high,) = np.flatnonzero(np.abs(np.degrees(tops) - 81.3) < 0.1)
    station = over(track, float(passes.culmination_s[high]), highest_deg)
    found = find_passes(station, track, HorizonMask((radians(5.0),)))
    k = int(np.argmin(np.abs(found.culmination_s - passes.culmination_s[high])))
    peak = np.degrees(peak_azimuth_rates(station, track, found))[k]

    x = track.states(found.culmination_s[k : k + 1])
    east, north, _ = line_of_sight(station, x[:3])[:, 0]
    v_east, v_north, _ = station.axes @ x[3:, 0]
    at_top = abs(np.degrees((v_east * north - v_north * east) / (east**2 + north**2)))
    # the azimuth is fastest at the top but for what the track bends
    assert peak == pytest.approx(at_top, rel=0.02)
    around = track.states(found.culmination_s[k] + np.array([-0.1, 0.1]))
    turned = np.diff(np.unwrap(angles(station, around[:3])[0]))[0]
    rounding = highest_half_digit / (90.0 - highest_deg) + rate_half_digit / rate_deg_s
    assert abs(np.degrees(turned)) / 0.2 == pytest.approx(rate_deg_s, rel=rounding)
