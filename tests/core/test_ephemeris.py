"""Keplerian orbits around the Sun, by other formulae and against an analytic theory."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2 as GM
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.ephemeris import (
    KeplerOrbit,
    anomaly_from_mean,
    from_equator,
    hill_axes,
    kepler_step,
    states_of_elements,
)
from hillsphere.symbolic import eccentric_anomaly, variables
from hillsphere.testing import example
from hillsphere.time import Epoch
from hillsphere_plants.sun_moon import sun_position

AU = 1.495978707e11
ELEMENTS = np.array(
    [[0.9224 * AU, AU, 2.2 * AU], [0.1912, 0.0, 0.93], [0.058, 0.0, 2.5], [3.57, 1.0, 0.2],
     [2.2, 0.3, -1.0], [0.4, -2.0, 11.0]]
)  # fmt: skip


@pytest.mark.parametrize("e", [0.0, 0.0167, 0.1912, 0.7, 0.97])
def test_anomalies(e: float) -> None:
    """Newton's method against a bracketed root, over three revolutions; and the engine's."""
    mean = np.linspace(-9.0, 9.0, 61)
    big = np.array(
        [brentq(lambda q, m=m: q - e * np.sin(q) - m, m - 1.1, m + 1.1, xtol=1e-15) for m in mean]
    )
    found = anomaly_from_mean(mean, e)
    np.testing.assert_allclose(np.cos(found), (np.cos(big) - e) / (1 - e * np.cos(big)), atol=4e-14)
    assert (np.abs(found - mean) < pi).all()
    assert (np.diff(found) > 0).all()
    engine = ArrayFunction([eccentric_anomaly(*variables("e", "m"))], variables("e", "m"))
    np.testing.assert_allclose(
        engine(np.array([np.full_like(mean, e), mean]))[0], big, rtol=0, atol=2e-14 / (1 - e)
    )


def test_states_are_a_flight_around_the_sun() -> None:
    x = states_of_elements(ELEMENTS, GM)
    a = 1 / (2 / np.linalg.norm(x[:3], axis=0) - np.sum(x[3:] ** 2, axis=0) / GM)
    np.testing.assert_allclose(a, ELEMENTS[0], rtol=1e-12)
    h = np.cross(x[:3], x[3:], axis=0)
    np.testing.assert_allclose(h[2] / np.linalg.norm(h, axis=0), np.cos(ELEMENTS[2]), atol=1e-14)
    node = np.arctan2(h[0], -h[1])[[0, 2]]
    np.testing.assert_allclose(np.exp(1j * node), np.exp(1j * ELEMENTS[3, [0, 2]]), atol=1e-13)

    duration = 4e6
    later = ELEMENTS.copy()
    later[5] += np.sqrt(GM / ELEMENTS[0] ** 3) * duration
    want = states_of_elements(later, GM)
    for i in range(3):
        flown = solve_ivp(
            lambda t, y: np.concatenate([y[3:], -GM * y[:3] / np.linalg.norm(y[:3]) ** 3]),
            (0, duration), x[:, i], method="DOP853", rtol=1e-12, atol=1e-3,
        ).y[:, -1]  # fmt: skip
        np.testing.assert_allclose(want[:3, i], flown[:3], rtol=0, atol=5e-11 * AU)


def test_step_along_the_ellipse() -> None:
    x = states_of_elements(ELEMENTS, GM)
    for duration in (-500.0, 3e7, 0.0):
        later = ELEMENTS.copy()
        later[5] += np.sqrt(GM / ELEMENTS[0] ** 3) * duration
        want = states_of_elements(later, GM)
        found = kepler_step(x, duration, GM)
        np.testing.assert_allclose(found[:3], want[:3], rtol=0, atol=3e-13 * AU)
        np.testing.assert_allclose(found[3:], want[3:], rtol=0, atol=1e-8)


@pytest.mark.parametrize("faster", [1.5, 2.0, 10.0])
@pytest.mark.parametrize("duration", [-1000.0, 1000.0, 1e7, -1e8])
def test_orbits_that_escape(faster: float, duration: float) -> None:
    """Against a numerical integration; ellipses beside them stay what they are."""
    x = states_of_elements(ELEMENTS[:, :2], GM)
    x[3:, 1] *= faster

    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[3:], -GM * y[:3] / np.linalg.norm(y[:3]) ** 3])

    want = solve_ivp(
        rate, (0.0, duration), x[:, 1], method="DOP853", rtol=1e-13, atol=1e-6
    ).y[:, -1]  # fmt: skip
    found = kepler_step(x, duration, GM)
    np.testing.assert_allclose(found[:3, 1], want[:3], rtol=0, atol=1e-9 * AU)
    np.testing.assert_allclose(found[3:, 1], want[3:], rtol=1e-10, atol=1e-5)
    np.testing.assert_array_equal(found[:, :1], kepler_step(x[:, :1], duration, GM))


def test_orbit_at_the_speed_of_escape() -> None:
    """On a parabola, from its periapsis q: Barker's equation, and nothing jumps beside it."""
    q, duration = AU, 1e7
    speed = np.sqrt(2.0 * GM / q)
    x = np.zeros((6, 3))
    x[0], x[4] = q, speed * np.array([1.0 - 1e-9, 1.0, 1.0 + 1e-9])
    half = np.sqrt(GM / (2.0 * q**3)) * duration
    root = np.cbrt(1.5 * half + np.sqrt(2.25 * half**2 + 1.0))
    tangent = root - 1.0 / root
    want = q * np.array([1.0 - tangent**2, 2.0 * tangent])
    found = kepler_step(x, duration, GM)
    np.testing.assert_allclose(found[:2, 1], want, rtol=0, atol=1e-9 * AU)
    np.testing.assert_allclose(found[:2] - want[:, None], 0.0, atol=1e-7 * AU)


def test_earth_against_the_analytic_theory() -> None:
    """Mean elements of the Earth–Moon barycentre at J2000, a year on either side."""
    earth = example("body", "solar_orbit")
    days = np.linspace(-365.0, 365.0, 30)
    found = earth.states(days * 86400.0)[:3]
    century = variables("T")[0]
    theory = ArrayFunction(sun_position(century), [century])(days[None] / 36525.0)
    turned = from_equator(np.broadcast_to(np.eye(3)[:, :, None], (3, 3, 30)))
    in_equator: Array = np.einsum("ijn,jn->in", turned, found)
    # perturbations by planets and Moon, and 2e-4 of the theory as it is cut off
    assert np.abs(in_equator + theory).max() < 4e-4 * AU


def test_times_count_from_an_epoch() -> None:
    earth = example("body", "solar_orbit")
    later = Epoch.parse("2000-01-11T12:00:00", "TDB")
    np.testing.assert_allclose(
        earth.states(np.array([60.0]), later), earth.states(np.array([864060.0])), rtol=1e-11
    )


def test_hill_axes() -> None:
    x = states_of_elements(ELEMENTS, GM)
    axes, rate = hill_axes(x)
    np.testing.assert_allclose(
        np.einsum("ijn,ikn->jkn", axes, axes), np.eye(3)[:, :, None].repeat(3, 2), atol=1e-14
    )
    seen = np.einsum("ijn,in->jn", axes, x[:3])
    np.testing.assert_allclose(seen[0], np.linalg.norm(x[:3], axis=0), rtol=1e-14)
    step = 100.0
    ahead, _ = hill_axes(kepler_step(x, step, GM))
    back, _ = hill_axes(kepler_step(x, -step, GM))
    turn = np.einsum("ijn,ikn->jkn", axes, (ahead - back) / (2 * step))
    np.testing.assert_allclose(turn[1, 0], rate[2], rtol=1e-6)
    np.testing.assert_allclose(turn[0, 2], 0.0, atol=1e-9 * rate[2].max())


def asteroid(**keys: Any) -> Any:
    given = {"semi_major_axis_au": 0.9224, "eccentricity": 0.1912, "rotation_rate_rad_s": 5.8e-5}
    return create("body", "asteroid", **given, **keys)


def test_orbit_of_an_asteroid() -> None:
    angles = {"inclination_rad": 0.058, "node_rad": 3.57, "periapsis_rad": 2.2}
    body = asteroid(**angles, mean_anomaly_rad=0.4)
    first = KeplerOrbit.of(body).states(np.zeros(1))
    np.testing.assert_allclose(first[:3, 0], states_of_elements(ELEMENTS, GM)[:3, 0], rtol=1e-12)
    # without an epoch of its own the anomaly is that at whatever epoch
    some = Epoch.parse("2029-04-13", "TDB")
    np.testing.assert_array_equal(KeplerOrbit.of(body).states(np.zeros(1), some), first)
    dated = asteroid(**angles, mean_anomaly_rad=0.4, epoch="2029-04-12")
    moved = KeplerOrbit.of(dated).states(np.zeros(1), some)
    np.testing.assert_allclose(moved, kepler_step(first, 86400.0, GM), rtol=0, atol=0.2)
    with pytest.raises(InputError, match="lacks mean_anomaly_deg"):
        KeplerOrbit.of(asteroid(**angles))


def test_elements_refused() -> None:
    for row, value in ((0, -1.0), (1, 1.0), (5, np.nan)):
        bad = ELEMENTS.copy()
        bad[row, 0] = value
        with pytest.raises(InputError, match="elements must be"):
            states_of_elements(bad, GM)


def test_period_closes() -> None:
    x = states_of_elements(ELEMENTS[:, :1], GM)
    period = 2 * pi * sqrt(ELEMENTS[0, 0] ** 3 / GM)
    np.testing.assert_allclose(kepler_step(x, period, GM), x, rtol=1e-11)
