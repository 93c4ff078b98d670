"""Observables of the stage ``orbit_fit`` against computations that share no code with it.

Stations are those of skyfield, orbits are circles or straight lines, and light times are roots by
bisection.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import erfa
import numpy as np
import pytest
from scipy.optimize import brentq
from skyfield.api import load, wgs84

from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.observables import Observable
from hillsphere_estimators.orbit_fit.sight import aberrate, line_angles
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.tracking_model import TrackingModel
from hillsphere_estimators.orbit_fit.trajectory import Trajectory
from hillsphere_estimators.orbit_fit.uplink import Transmission

C = 299792458.0
GM = 398600.4418e9
RADIUS = 7.2e6
RATE = np.sqrt(GM / RADIUS**3)
TILT = 0.9
DATE = "2024-03-01T00:00:00"
PLACES = {"A": (40.0, 5.0, 200.0), "B": (-2.2, -44.3, 39.0)}
ARCSECOND = np.pi / 648000.0
TAG = 740.0


def craft(t: float) -> Array:
    """Return the state of a satellite on a circle, in the axes of the ICRF."""
    angle = RATE * t + 0.3
    c, s, ci, si = np.cos(angle), np.sin(angle), np.cos(TILT), np.sin(TILT)
    place = RADIUS * np.array([c, s * ci, s * si])
    return np.concatenate([place, RADIUS * RATE * np.array([-s, c * ci, c * si])])


@cache
def clock() -> Any:
    return load.timescale(builtin=True)


def when(t: float) -> Any:
    tai = Epoch.parse(DATE, "UTC").to("TAI")
    return clock().tai_jd(tai.day, tai.fraction + t / 86400.0)


def place(name: str, t: float) -> Array:
    """Return the position of a station by skyfield."""
    latitude, longitude, height = PLACES[name]
    return np.asarray(wgs84.latlon(latitude, longitude, height).at(when(t)).position.m)


def there(name: str, t: float) -> Array:
    return craft(t)[:3] if name == "S" else place(name, t)


def back(path: tuple[str, ...], t: float) -> list[float]:
    """Return the times at which a signal received at t left each participant."""
    times = [t]
    for sender, receiver in zip(path[-2::-1], path[:0:-1], strict=True):
        now = times[0]
        end = there(receiver, now)

        def off(tau: float, sender: str = sender, now: float = now, end: Array = end) -> float:
            return float(np.linalg.norm(there(sender, now - tau) - end) - C * tau)

        times.insert(0, now - float(brentq(off, 0.0, 1.0, xtol=1e-16, rtol=1e-15)))
    return times


def elapsed(path: tuple[str, ...], t: float) -> float:
    times = back(path, t)
    return times[-1] - times[0]


@cache
def model_parts() -> tuple[Any, Any]:
    orientation = ConstantOrientation(float(when(TAG).dut1))
    plant = create(
        "plant", "earth_orbit", epoch=DATE, frame="gcrs",
        body=create("body", "planet", orientation="constant"),
        gravity=create("gravity", "point_mass", gm_m3_s2=GM),
    )  # fmt: skip
    stations = {
        name: Station(name, np.radians(a), np.radians(b), h) for name, (a, b, h) in PLACES.items()
    }
    zero = Epoch.parse(DATE, "UTC")
    return plant, Surroundings(plant, zero, orientation, stations, {}, None, (0.0, 2000.0))


def expected(
    observable: Observable, aberration: Any = "none", sent: Transmission | None = None
) -> Array:
    plant, surroundings = model_parts()
    transmissions = {} if sent is None else {observable.path[0]: sent}
    model = TrackingModel(
        plant, [observable], surroundings, "S", aberration, transmissions, {}, step_s=20.0
    )
    x = craft(TAG)[:, None]
    return np.asarray(model.observe(x, np.array([TAG]), np.zeros(1, dtype=int))[:, 0])


def line_of_sight(name: str) -> Array:
    """Return the unit vector to where the light left the satellite."""
    left = back(("S", name), TAG)[0]
    way = craft(left)[:3] - place(name, TAG)
    return np.asarray(way / np.linalg.norm(way))


@pytest.mark.parametrize("name", list(PLACES))
def test_azimuth_and_elevation_are_those_of_skyfield(name: str) -> None:
    """To 1e-3 arcseconds; skyfield's rows are north, east and up."""
    latitude, longitude, height = PLACES[name]
    axes = wgs84.latlon(latitude, longitude, height).rotation_at(when(TAG))
    north, east, up = axes @ line_of_sight(name)
    azimuth, elevation = np.arctan2(east, north) % (2.0 * np.pi), np.arcsin(up)
    found = expected(Observable("angles", ("S", name), "AZEL"))
    assert abs(found[0] - azimuth) * np.cos(elevation) < 1e-3 * ARCSECOND
    assert abs(found[1] - elevation) < 1e-3 * ARCSECOND
    x, y = expected(Observable("angles", ("S", name), "XEYN"))
    assert np.tan(x) == pytest.approx(east / up, rel=1e-8)
    assert np.sin(y) == pytest.approx(north, abs=5e-9)
    x, y = expected(Observable("angles", ("S", name), "XSYE"))
    assert np.tan(x) == pytest.approx(-north / up, rel=1e-8)
    assert np.sin(y) == pytest.approx(east, abs=5e-9)


def test_right_ascension_and_declination_are_those_of_skyfield() -> None:
    """In the ICRF, and of date by skyfield's precession and nutation."""
    line = line_of_sight("A")
    found = expected(Observable("angles", ("S", "A"), "RADEC", "ICRF"))
    assert abs(found[0] - np.arctan2(line[1], line[0]) % (2 * np.pi)) < 1e-3 * ARCSECOND
    assert abs(found[1] - np.arcsin(line[2])) < 1e-3 * ARCSECOND
    line = when(TAG).M @ line_of_sight("A")
    found = expected(Observable("angles", ("S", "A"), "RADEC", "TOD"))
    assert abs(found[0] - np.arctan2(line[1], line[0]) % (2 * np.pi)) < 1e-3 * ARCSECOND
    assert abs(found[1] - np.arcsin(line[2])) < 1e-3 * ARCSECOND
    # EME2000 is off by the frame bias of 23 mas, in skyfield as ICRS_to_J2000
    from skyfield.framelib import ICRS_to_J2000

    line = ICRS_to_J2000 @ line_of_sight("A")
    found = expected(Observable("angles", ("S", "A"), "RADEC", "EME2000"))
    assert abs(found[0] - np.arctan2(line[1], line[0]) % (2 * np.pi)) < 1e-3 * ARCSECOND
    assert abs(found[1] - np.arcsin(line[2])) < 1e-3 * ARCSECOND


def test_aberration_is_that_of_the_observers_velocity() -> None:
    """By the textbook's angle between direction and velocity, and by ERFA for the Earth's."""
    velocity = np.array([[0.0], [0.0], [3e4]])
    seen = aberrate(np.array([[1.0], [0.0], [1.0]]), velocity)[:, 0]
    beta, angle = 1e-4 * 3e8 / C, np.pi / 4.0
    # cos θ' = (cos θ + β)/(1 + β cos θ)
    cosine = (np.cos(angle) + beta) / (1.0 + beta * np.cos(angle))
    assert seen[2] == pytest.approx(cosine, abs=1e-15)
    # against stars: the light's direction as seen from the barycentre, where the Earth moves
    light = TAG - back(("S", "A"), TAG)[0]
    days = Epoch.parse(DATE, "UTC").to("TDB").day - 2451545.0 + TAG / 86400.0
    earth = erfa.epv00(2451545.0, days)[1]["v"] * 1.495978707e11 / 86400.0
    way = line_of_sight("A") * C * light - earth * light
    way /= np.linalg.norm(way)
    found = expected(Observable("angles", ("S", "A"), "RADEC", "ICRF"), "stars")
    assert abs(found[1] - np.arcsin(way[2])) < 2e-3 * ARCSECOND
    plain = expected(Observable("angles", ("S", "A"), "RADEC", "ICRF"))
    assert 5.0 < np.hypot(*(found - plain)) / ARCSECOND < 25.0


@pytest.mark.parametrize("path", [("S", "A"), ("A", "S", "A"), ("A", "S", "B")])
def test_ranges_and_their_rates(path: tuple[str, ...]) -> None:
    """Ranges to the 2 cm by which Earth orientations differ, rates by a difference of ranges."""
    range_m = C * elapsed(path, TAG)
    assert expected(Observable("range", path))[0] == pytest.approx(range_m, abs=0.02)
    assert expected(Observable("range", path, share=0.5))[0] == pytest.approx(
        0.5 * range_m, abs=0.01
    )
    h = 0.5
    slope = C * (elapsed(path, TAG + h) - elapsed(path, TAG - h)) / (2.0 * h)
    # the third derivative of a range times h²/6 is below 1e-3 m/s
    assert expected(Observable("range_rate", path))[0] == pytest.approx(slope, abs=2e-3)
    for middle, shift in ((-0.5, -5.0), (0.0, 0.0), (0.5, 5.0)):
        mean = C * (elapsed(path, TAG + shift + 5.0) - elapsed(path, TAG + shift - 5.0)) / 10.0
        found = expected(Observable("range_rate", path, interval_s=10.0, middle=middle))[0]
        assert found == pytest.approx(mean, abs=1e-5)


def test_delays_and_tags_of_the_transmitter() -> None:
    """Each delay lengthens the range by itself, and moves the times at which all are elsewhere."""
    path, receive, transmit = ("A", "S", "A"), (1e-3, 2e-3, 3e-3), (4e-3, 5e-3, 6e-3)
    reach = TAG - receive[2]
    down = back(("S", "A"), reach)
    up = back(("A", "S"), down[0] - transmit[1] - receive[1])
    # 5 · 1e-3 of delays moves the stations and the satellite by some metres
    range_m = C * (TAG - up[0] + transmit[0])
    observable = Observable("range", path, receive_delays_s=receive, transmit_delays_s=transmit)
    assert expected(observable)[0] == pytest.approx(range_m, abs=0.02)
    without = C * (elapsed(path, TAG) + 1e-3 * (3 + 4 + 5 + 2))
    assert abs(range_m - without) > 1.0
    # the signal that was sent at the tag is received where its own range says
    late = expected(Observable("range", path, tagged="transmit"))[0] / C
    assert back(path, TAG + late)[0] == pytest.approx(TAG, abs=1e-10)


def test_two_way_doppler_counts_the_cycles_that_were_sent() -> None:
    """Phases by hand: a ramped uplink, a turnaround ratio, ten seconds; three-way alike."""
    ratio, rate, f0 = 240.0 / 221.0, 1500.0, 2.1e9
    # a second ramp begins between the two transmissions
    ramp = Transmission(np.array([0.0, TAG - 3.0]), np.array([f0, f0 + rate * (TAG - 3.0)]),
                        np.array([rate, -0.5 * rate]))  # fmt: skip

    def cycles(dt: float) -> float:
        """Cycles sent since three seconds before the tag."""
        return (f0 + rate * (TAG - 3.0)) * dt + 0.5 * dt * dt * (rate if dt < 0 else -0.5 * rate)

    for path in (("A", "S", "A"), ("A", "S", "B")):
        first, last = (back(path, TAG + side * 5.0)[0] - TAG + 3.0 for side in (-1.0, 1.0))
        mean = ratio * (cycles(last) - cycles(first)) / 10.0
        observable = Observable("frequency", path, interval_s=10.0, turnaround=ratio)
        found = expected(observable, sent=ramp)[0] + ratio * f0
        # 1e-5 m/s of range rate, by Earth orientations, are 1e-4 Hz
        assert found == pytest.approx(mean, abs=3e-4)
        h = 0.02
        first, last = (back(path, TAG + side * h)[0] - TAG + 3.0 for side in (-1.0, 1.0))
        now = ratio * (cycles(last) - cycles(first)) / (2.0 * h)
        found = expected(Observable("frequency", path, turnaround=ratio), sent=ramp)[0]
        # rounding of light times, 1e-13 s of 0.04 s at 2 GHz
        assert found + ratio * f0 == pytest.approx(now, abs=0.02)


def test_one_way_doppler_of_a_beacon() -> None:
    beacon = Transmission(np.zeros(1), np.array([8.4e9]), np.zeros(1))
    observable = Observable("frequency", ("S", "A"), interval_s=1.0)
    found = expected(observable, sent=beacon)[0]
    grown = elapsed(("S", "A"), TAG + 0.5) - elapsed(("S", "A"), TAG - 0.5)
    assert found == pytest.approx(-8.4e9 * grown, abs=1e-3)


def test_a_spacecraft_about_phobos_seen_from_the_earth() -> None:
    """Through the moon's orientation and a given trajectory of the moon, two-way."""
    zero = Epoch.parse("2027-06-01T00:00:00", "TDB")
    moon = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0,
        pole_right_ascension_deg=317.68, pole_declination_deg=52.90, prime_meridian_deg=35.06,
    )  # fmt: skip
    plant: Any = create("plant", "hill", body=moon,
                   gravity=create("gravity", "point_mass", gm_km3_s2=7.1e-4))  # fmt: skip
    t = np.linspace(-9000.0, 9000.0, 61)
    start = np.array([1e11, -8e10, 3e10, 9e3, 1.1e4, -4e3])
    pull = np.array([2e-3, 1e-3, -3e-3])
    way = np.concatenate([start[:3, None] + start[3:, None] * t + 0.5 * pull[:, None] * t**2,
                          start[3:, None] + pull[:, None] * t])  # fmt: skip
    centre = Trajectory("centre", t, way)
    surroundings = Surroundings(plant, zero, ConstantOrientation(0.0), {}, {"E": None}, centre,
                                (0.0, 100.0))  # fmt: skip
    path = ("E", "S", "E")
    model = TrackingModel(plant, [Observable("range", path)], surroundings, "S", "none", {}, {})
    x = np.array([3e4, 1e4, 5e3, 1.0, -20.0, 3.0])[:, None]
    found = float(model.observe(x, np.array([50.0]), np.zeros(1, dtype=int))[0, 0])

    def earth(s: float) -> Array:
        days = (zero.day - 2451545.0) + zero.fraction + s / 86400.0
        return np.asarray(erfa.epv00(2451545.0, days)[1]["p"]) * 1.495978707e11

    # backward from the state at the tag by Hill's equations, and to axes that do not turn by hand
    from scipy.integrate import solve_ivp

    n, gm = float(plant.mean_motion_rad_s), 7.1e5

    def rate(_: float, y: Array) -> Array:
        r3 = np.linalg.norm(y[:3]) ** 3
        pull = -gm * y[:3] / r3
        return np.array([*y[3:], 2 * n * y[4] + 3 * n * n * y[0] + pull[0],
                         -2 * n * y[3] + pull[1], -n * n * y[2] + pull[2]])  # fmt: skip

    way = solve_ivp(rate, (50.0, -900.0), x[:, 0], rtol=1e-12, atol=1e-9, dense_output=True)
    flown = way.sol

    def body_fixed(angle: float, k: int) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[[1, 0, 0], [0, c, -s], [0, s, c]], [[c, -s, 0], [s, c, 0], [0, 0, 1]]][k])

    node = body_fixed(np.radians(317.68 + 90.0), 1) @ body_fixed(np.radians(90.0 - 52.90), 0)
    rotation = moon.orientation.rate_rad_s * zero.seconds_since(Epoch(2451544.5, 0.5, "TDB"))
    meridian = np.radians(35.06) + rotation - float(plant.prime_meridian_rad)

    def probe(s: float) -> Array:
        place = node @ body_fixed(meridian + n * s, 1) @ flown(s)[:3]
        return np.asarray(place + earth(s) + start[:3] + start[3:] * s + 0.5 * pull * s * s)

    t2 = 50.0 - brentq(
        lambda tau: np.linalg.norm(probe(50.0 - tau) - earth(50.0)) - C * tau, 0, 900, xtol=1e-14
    )
    up = brentq(
        lambda tau: np.linalg.norm(probe(t2) - earth(t2 - tau)) - C * tau, 0, 900, xtol=1e-14
    )
    # the rounding of places at 1e11 m, and of an angle after 27 years
    assert found == pytest.approx(C * (50.0 - t2 + up), abs=0.02)
    with pytest.raises(InputError, match="centre"):
        Surroundings(plant, zero, ConstantOrientation(0.0), {}, {"E": None}, None, (0.0, 1.0))


def test_angles_of_all_octants_are_inverted() -> None:
    random = np.random.default_rng(5)
    line = random.normal(size=(3, 50))
    line /= np.linalg.norm(line, axis=0)
    a, b = line_angles(line, "AZEL")
    assert np.allclose([np.sin(a) * np.cos(b), np.cos(a) * np.cos(b), np.sin(b)], line)
    a, b = line_angles(line, "XEYN")
    assert np.allclose([np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)], line)
    a, b = line_angles(line, "XSYE")
    assert np.allclose([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)], line)
    a, b = line_angles(line, "RADEC")
    assert np.allclose([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], line)
