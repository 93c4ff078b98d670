"""Tracking data of known orbits, simulated without the code that fits them.

Orbits are integrated by SciPy's DOP853, stations are skyfield's, light times are fixed points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import erfa
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from skyfield.api import load, wgs84
from skyfield.sgp4lib import TEME

from hillsphere import create
from hillsphere.interfaces import Array
from hillsphere.time import Epoch

C = 299792458.0
AU = 1.495978707e11
DATE = "2024-03-01T00:00:00"
GM, RADIUS, J2 = 398600.4418e9, 6378137.0, 1.08262668e-3
PLACES = {"A": (-2.2, -44.3, 39.0), "B": (-15.5, -56.1, 277.0)}
START = np.array([1040e3, 6375e3, -3401e3, -6264.0, 2591.0, 2941.0])
"""State at the date, TEME: over both stations ten minutes later, and low over A two hours later."""
Motion = Callable[[float], Array]


@cache
def clock() -> Any:
    return load.timescale(builtin=True)


def when(t: Any) -> Any:
    tai = Epoch.parse(DATE, "UTC").to("TAI")
    return clock().tai_jd(tai.day, tai.fraction + t / 86400.0)


@cache
def station(name: str) -> Motion:
    """Return the place of a station in TEME, interpolated between instants of skyfield."""
    t = np.arange(-300.0, 8300.0, 50.0)
    now = when(t)
    place = np.einsum(
        "ijn,jn->ni", TEME.rotation_at(now), wgs84.latlon(*PLACES[name]).at(now).position.m
    )
    way = make_interp_spline(t, place, k=7)
    return lambda t: np.asarray(way(t))


def horizon(name: str, line: Array, t: float) -> tuple[float, float]:
    """Return azimuth and elevation of a line in TEME."""
    now = when(t)
    north, east, up = wgs84.latlon(*PLACES[name]).rotation_at(now) @ TEME.rotation_at(now).T @ line
    return float(np.arctan2(east, north) % (2 * np.pi)), float(np.arcsin(up / np.linalg.norm(line)))


@cache
def satellite() -> Motion:
    """Return the satellite's flight about an oblate Earth, in TEME."""

    def rate(_: float, y: Array) -> Array:
        r2 = float(y[:3] @ y[:3])
        r, z2 = np.sqrt(r2), y[2] ** 2 / r2
        factor = 1.5 * J2 * RADIUS**2 / r2
        pull = -GM / r**3 * y[:3] * (1.0 + factor * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2))
        return np.concatenate([y[3:], pull])

    ways = [
        solve_ivp(rate, (0.0, end), START, "DOP853", rtol=1e-13, atol=1e-6, dense_output=True,
                  max_step=20.0).sol
        for end in (-100.0, 8000.0)
    ]  # fmt: skip
    return lambda t: np.asarray(ways[int(t >= 0.0)](t)[:3])


def sent_at(sender: Motion, end: Array, t: float) -> float:
    """Return the time at which a signal left that is at a place at t."""
    then = t
    for _ in range(8):
        then = t - float(np.linalg.norm(sender(then) - end)) / C
    return then


def elapsed(path: Sequence[Motion], t: float) -> float:
    """Return the time of a signal along a path that is received at t."""
    now, light = t, 0.0
    for sender, receiver in zip(path[-2::-1], path[:0:-1], strict=True):
        end = receiver(now)
        # as a sum of light times, which keeps their digits
        back = 0.0
        for _ in range(8):
            back = float(np.linalg.norm(sender(now - back) - end)) / C
        now, light = now - back, light + back
    return light


def earth_plant() -> Any:
    """Return the plant of the satellite; UT1 is that of skyfield."""
    return create(
        "plant", "earth_orbit", epoch=DATE, frame="teme",
        body=create("body", "planet", orientation="constant",
                    ut1_minus_utc_s=float(when(600.0).dut1)),
        gravity=create("gravity", "harmonics", gm_m3_s2=GM, reference_radius_m=RADIUS,
                       normalisation="none", tide_system="none",
                       coefficients=[{"n": 2, "m": 0, "c": -J2}]),
    )  # fmt: skip


# an asteroid, a spacecraft about it, and another one that observes it from 900 km

ASTEROID = {"a": 1.3 * AU, "e": 0.15, "i": 0.1, "node": 0.7, "peri": 1.9, "mean": 0.4}
SUN, SMALL = 1.32712440018e20, 40.0
NEAR = np.array([4e3, -3e3, 2e3, 0.03, 0.05, -0.02])
"""State of the spacecraft at the date, about the asteroid, in the axes of the ICRF."""
_TILT = 84381.448 / 3600.0 * np.pi / 180.0
ECLIPTIC = np.array(
    [[1, 0, 0], [0, np.cos(_TILT), -np.sin(_TILT)], [0, np.sin(_TILT), np.cos(_TILT)]]
)
"""From ecliptic and equinox J2000 to the ICRF."""


def asteroid(t: float) -> Array:
    """Return the heliocentric place of the asteroid in the ICRF, by Kepler's equation."""
    a, e = ASTEROID["a"], ASTEROID["e"]
    mean = ASTEROID["mean"] + np.sqrt(SUN / a**3) * t
    anomaly = mean
    for _ in range(20):
        anomaly = mean + e * np.sin(anomaly)
    flat = np.array([a * (np.cos(anomaly) - e), a * np.sqrt(1 - e * e) * np.sin(anomaly), 0.0])

    def about(angle: float, axis: int) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        if axis == 0:
            return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    turn = about(ASTEROID["node"], 2) @ about(ASTEROID["i"], 0) @ about(ASTEROID["peri"], 2)
    return np.asarray(ECLIPTIC @ turn @ flat)


@cache
def prober(span: float) -> Motion:
    """Return the flight about the asteroid, of the Sun's tide and a point mass."""

    def rate(t: float, y: Array) -> Array:
        away = asteroid(t)
        sun = -SUN * ((away + y[:3]) / np.linalg.norm(away + y[:3]) ** 3
                      - away / np.linalg.norm(away) ** 3)  # fmt: skip
        return np.concatenate([y[3:], sun - SMALL * y[:3] / np.linalg.norm(y[:3]) ** 3])

    ways = [
        solve_ivp(rate, (0.0, end), NEAR, "DOP853", rtol=1e-12, atol=1e-9, dense_output=True,
                  max_step=600.0).sol
        for end in (-3000.0, span)
    ]  # fmt: skip
    return lambda t: np.asarray(ways[int(t >= 0.0)](t)[:3])


def observer(t: float) -> Array:
    """Return the place of the observing spacecraft about the asteroid."""
    return np.array([-6e5, 5e5, 4e5]) + np.array([3.0, 2.0, -1.0]) * t


def earth(t: float) -> Array:
    """Return the barycentric place of the Earth."""
    zero = Epoch.parse(DATE, "TDB")
    days = (zero.day - 2451545.0) + zero.fraction + t / 86400.0
    return np.asarray(erfa.epv00(2451545.0, days)[1]["p"]) * AU


def centre_from_earth(t: float) -> Array:
    """Return the asteroid less the Earth."""
    zero = Epoch.parse(DATE, "TDB")
    days = (zero.day - 2451545.0) + zero.fraction + t / 86400.0
    return asteroid(t) - np.asarray(erfa.epv00(2451545.0, days)[0]["p"]) * AU


def small_body_plant() -> Any:
    body = create(
        "body", "asteroid", name="stone", semi_major_axis_m=ASTEROID["a"],
        eccentricity=ASTEROID["e"], inclination_rad=ASTEROID["i"], node_rad=ASTEROID["node"],
        periapsis_rad=ASTEROID["peri"], mean_anomaly_rad=ASTEROID["mean"], epoch=DATE,
        rotation_rate_rad_s=4e-4, semi_axes_m=[200, 200, 200], primary_gm_m3_s2=SUN,
    )  # fmt: skip
    return create("plant", "proximity", body=body,
                  gravity=create("gravity", "point_mass", gm_m3_s2=SMALL))  # fmt: skip


def derivative(motion: Motion, t: float, h: float) -> Array:
    """Return the velocity by a difference of fourth order."""
    return np.asarray(
        (8 * (motion(t + h) - motion(t - h)) - motion(t + 2 * h) + motion(t - 2 * h)) / (12 * h)
    )
