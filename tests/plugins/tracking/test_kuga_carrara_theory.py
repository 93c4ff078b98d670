"""The theory behind the paper's orbit, written a second time and tried on a flight.

Kuga and Carrara (1990) take their secular rates from Brouwer (1959); their elements are mean ones.
Here the rates and the short-period terms of J2 stand as they are printed there, with Lyddane's
recombination (1963), one orbit at a time.

References
----------
.. [1] Brouwer, D. (1959), Solution of the problem of artificial satellite theory without drag,
   Astronomical Journal 64, 378.
.. [2] Lyddane, R. H. (1963), Small eccentricities or inclinations in the Brouwer theory of the
   artificial satellite, Astronomical Journal 68, 555.
"""

from __future__ import annotations

from importlib import resources
from itertools import pairwise
from math import atan2, cos, degrees, pi, sin, sqrt

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from hillsphere.interfaces import Array
from hillsphere_tracking.kepler import elements_from_states
from hillsphere_tracking.mean_elements import ZonalField, osculating, secular_rates, states
from hillsphere_tracking.satellites import Sgp4Orbit
from hillsphere_tracking.tle import read_tles

GM, RADIUS, J2, J4 = 398600.4418e9, 6378137.0, 1.08262668e-3, -1.61962159e-6
PAPER = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
DAY = 86400.0


def brouwers_rates(a: float, e: float, i: float) -> tuple[float, float, float]:
    """Return the rates of M, ω and Ω [1]_."""
    n, eta, t = sqrt(GM / a**3), sqrt(1.0 - e * e), cos(i)
    g2 = 0.5 * J2 * (RADIUS / a) ** 2 / eta**4
    g4 = -0.375 * J4 * (RADIUS / a) ** 4 / eta**8
    mean = (
        1.0
        + 1.5 * g2 * eta * (3 * t**2 - 1)
        + 3.0 / 32.0 * g2**2 * eta
        * (-15 + 16 * eta + 25 * eta**2 + (30 - 96 * eta - 90 * eta**2) * t**2
           + (105 + 144 * eta + 25 * eta**2) * t**4)
        + 15.0 / 16.0 * g4 * eta * e**2 * (3 - 30 * t**2 + 35 * t**4)
    )  # fmt: skip
    perigee = (
        1.5 * g2 * (5 * t**2 - 1)
        + 3.0 / 32.0 * g2**2
        * (-35 + 24 * eta + 25 * eta**2 + (90 - 192 * eta - 126 * eta**2) * t**2
           + (385 + 360 * eta + 45 * eta**2) * t**4)
        + 5.0 / 16.0 * g4
        * (21 - 9 * eta**2 + (126 * eta**2 - 270) * t**2 + (385 - 189 * eta**2) * t**4)
    )  # fmt: skip
    node = (
        -3.0 * g2 * t
        + 3.0 / 8.0 * g2**2
        * ((-5 + 12 * eta + 9 * eta**2) * t - (35 + 36 * eta + 5 * eta**2) * t**3)
        + 5.0 / 4.0 * g4 * (5 - 3 * eta**2) * t * (3 - 7 * t**2)
    )  # fmt: skip
    return n * mean, n * perigee, n * node


def test_secular_rates_of_brouwer_1959_at_kuga_carraras_elements() -> None:
    rates = np.degrees(brouwers_rates(*PAPER[:3])) * DAY
    # degrees a day; M, ω, Ω
    assert_allclose(rates, [5142.101213424, 10.572696873, -6.073518124], rtol=0, atol=1e-9)
    assert degrees(sqrt(GM / 7180e3**3)) * DAY == pytest.approx(5137.106819231, abs=1e-9)


def test_secular_rates_of_brouwer_1959_for_any_orbit() -> None:
    random = np.random.default_rng(1959)
    orbits = np.array(
        [random.uniform(6.6e6, 4.2e7, 200), random.uniform(0.0, 0.8, 200),
         random.uniform(0.0, pi, 200), *random.uniform(0.0, 2.0 * pi, (3, 200))]
    )  # fmt: skip
    expected = np.array([brouwers_rates(*orbit[:3]) for orbit in orbits.T]).T[[2, 1, 0]]
    assert_allclose(secular_rates(orbits), expected, rtol=1e-13, atol=1e-20)


def kepler(mean: float, e: float) -> float:
    """Return the true anomaly."""
    anomaly = mean
    for _ in range(60):
        anomaly -= (anomaly - e * sin(anomaly) - mean) / (1.0 - e * cos(anomaly))
    return 2.0 * atan2(sqrt(1.0 + e) * sin(anomaly / 2.0), sqrt(1.0 - e) * cos(anomaly / 2.0))


def missing_term(a: float, e: float, i: float, perigee: float, mean: float) -> float:
    """Return what (η² − η³)/e multiplies in l + g: together with it, e η²/(1 + η), rad [2]_."""
    eta, t, f = sqrt(1.0 - e * e), cos(i), kepler(mean, e)
    g2 = 0.5 * J2 * (RADIUS / a) ** 2 / eta**4
    p = (1.0 + e * cos(f)) / eta**2  # a/r
    square = (p * eta) ** 2
    braces = 2.0 * (3 * t**2 - 1) * (square + p + 1.0) * sin(f) + 3.0 * (1 - t**2) * (
        (1.0 - square - p) * sin(2 * perigee + f)
        + (square + p + 1.0 / 3.0) * sin(2 * perigee + 3 * f)
    )
    return g2 / 4.0 * e * eta**2 / (1.0 + eta) * braces


def brouwer_lyddane(
    a: float, e: float, i: float, node: float, perigee: float, mean: float, *, whole: bool = True
) -> tuple[float, ...]:
    """Return osculating a, e, i, Ω, ω, M [1]_, [2]_; not whole: without the term above."""
    eta, t, f = sqrt(1.0 - e * e), cos(i), kepler(mean, e)
    sine, g = sin(i), perigee
    gamma = 0.5 * J2 * (RADIUS / a) ** 2
    g2 = gamma / eta**4
    p = (1.0 + e * cos(f)) / eta**2
    square = (p * eta) ** 2
    d_a = a * gamma * (
        (3 * t**2 - 1) * (p**3 - eta**-3) + 3.0 * sine**2 * p**3 * cos(2 * g + 2 * f)
    )  # fmt: skip
    d_e = eta**2 / (2.0 * e) * (
        gamma * ((3 * t**2 - 1) * (p**3 - eta**-3)
                 + 3.0 * sine**2 * (p**3 - eta**-4) * cos(2 * g + 2 * f))
        - g2 * sine**2 * (3 * e * cos(2 * g + f) + e * cos(2 * g + 3 * f))
    )  # fmt: skip
    d_i = g2 / 2.0 * t * sine * (
        3 * cos(2 * g + 2 * f) + 3 * e * cos(2 * g + f) + e * cos(2 * g + 3 * f)
    )  # fmt: skip
    braces = 2.0 * (3 * t**2 - 1) * (square + p + 1.0) * sin(f) + 3.0 * sine**2 * (
        (1.0 - square - p) * sin(2 * g + f) + (square + p + 1.0 / 3.0) * sin(2 * g + 3 * f)
    )
    e_d_l = -(eta**3) * g2 / 4.0 * braces
    centre = (f - mean + pi) % (2.0 * pi) - pi + e * sin(f)
    waves = 3 * sin(2 * g + 2 * f) + 3 * e * sin(2 * g + f) + e * sin(2 * g + 3 * f)
    d_h = -g2 / 2.0 * t * (6.0 * centre - waves)
    # l + g: the parts of l and g with the divisor e join to the regular one
    d_lg = g2 / 4.0 * (6.0 * (5 * t**2 - 1) * centre + (3 - 5 * t**2) * waves)
    if whole:
        d_lg += missing_term(a, e, i, perigee, mean)
    along, across = e + d_e, e_d_l
    x = along * cos(mean) - across * sin(mean)
    y = along * sin(mean) + across * cos(mean)
    tilt, turn = sin(i / 2.0) + 0.5 * cos(i / 2.0) * d_i, sin(i / 2.0) * d_h
    u = tilt * cos(node) - turn * sin(node)
    v = tilt * sin(node) + turn * cos(node)
    new_node, new_mean = atan2(v, u), atan2(y, x)
    total = mean + perigee + node + d_lg + d_h
    new_i = 2.0 * atan2(sqrt(u * u + v * v), sqrt(1.0 - u * u - v * v))
    return a + d_a, sqrt(x * x + y * y), new_i, new_node, total - new_node - new_mean, new_mean


def in_degrees(elements: tuple[float, ...]) -> list[float]:
    return [elements[0] / 1e3, elements[1], *(degrees(q) % 360.0 for q in elements[2:])]


def test_short_period_terms_at_kuga_carraras_elements() -> None:
    whole = in_degrees(brouwer_lyddane(*PAPER))
    ours = in_degrees(tuple(osculating(PAPER)[:, 0]))
    assert_allclose(ours, whole, rtol=0, atol=2e-10)
    assert_allclose([whole[k] for k in (0, 1, 4, 5)],
                    [7182.3233108286, 0.0448086686, 15.2045580893, 350.8182568758],
                    rtol=0, atol=2e-10)  # fmt: skip
    # i and Ω where the terms are simply added, the same to first order
    assert_allclose(whole[2:4], [23.8341480375, 240.1481072389], rtol=0, atol=1e-5)


def test_short_period_terms_of_brouwer_and_lyddane_for_any_orbit() -> None:
    random = np.random.default_rng(1963)
    orbits = np.array(
        [random.uniform(6.8e6, 4.2e7, 100), random.uniform(1e-4, 0.3, 100),
         random.uniform(0.01, 2.0, 100), *random.uniform(0.0, 2.0 * pi, (3, 100))]
    )  # fmt: skip
    expected = np.array([brouwer_lyddane(*orbit) for orbit in orbits.T]).T
    found = osculating(orbits)
    assert_allclose(found[0], expected[0], rtol=1e-13)
    assert_allclose(found[1:3], expected[1:3], rtol=0, atol=1e-13)
    turned = (found[3:] - expected[3:] + pi) % (2.0 * pi) - pi
    assert_allclose(turned, 0.0, rtol=0, atol=3e-12)


def fly(start: Array, times: Array) -> Array:
    """Return states (6, K) under a point mass and J2, by SciPy."""

    def slope(_: float, x: Array) -> Array:
        r = np.sqrt(x[:3] @ x[:3])
        up = 5.0 * (x[2] / r) ** 2
        flat = 1.5 * J2 * GM * RADIUS**2 / r**5 * np.array([1.0 - up, 1.0 - up, 3.0 - up])
        return np.concatenate([x[3:], -GM / r**3 * x[:3] - flat * x[:3]])

    flown = solve_ivp(
        slope, (0.0, times[-1]), start, method="DOP853", rtol=1e-11, atol=1e-4, t_eval=times
    )
    return np.asarray(flown.y)


def test_a_flight_needs_lyddanes_whole_argument_of_latitude() -> None:
    """Sums l + g without the term in (η² − η³)/e give ω = 15.20481°, with it 15.20456°.

    The mean longitude Ω + ω + M that is found along a flight under J2 must be a straight line but
    for what is of second order, about J2² = 1e-6; the term is 4e-6 at the paper's elements and
    swings once a revolution.
    """
    short = brouwer_lyddane(*PAPER, whole=False)
    # Ω + ω as they were printed elsewhere, with Ω simply added: the term was left out there
    assert degrees(short[3] + short[4]) % 360.0 == pytest.approx(
        240.1481072389 + 15.2048059784, abs=3e-10
    )
    times = np.linspace(0.0, DAY / 2.0, 500)
    field = ZonalField(GM, RADIUS, J2, 0.0)
    flown = elements_from_states(fly(states(PAPER[:, None], np.zeros(1), field)[:, 0], times), GM)
    node, perigee, mean = secular_rates(PAPER, field)[:, 0]
    scatter = []
    for whole in (True, False):
        off = np.empty(times.size)
        for k, t in enumerate(times):
            now = (*PAPER[:3], PAPER[3] + node * t, PAPER[4] + perigee * t, PAPER[5] + mean * t)
            expected = brouwer_lyddane(*now, whole=whole)
            off[k] = (flown[3:, k].sum() - sum(expected[3:]) + pi) % (2.0 * pi) - pi
        line = np.polyval(np.polyfit(times, off, 1), times)
        scatter.append(float(np.std(off - line)))
    assert scatter[0] < 1e-6
    assert scatter[1] > 20.0 * scatter[0]


def published_states() -> list[tuple[str, list[list[float]]]]:
    """Return the satellites of the output of the verification, with minutes and TEME states."""
    text = resources.files("sgp4").joinpath("tcppver.out").read_text()
    found: list[tuple[str, list[list[float]]]] = []
    for line in text.splitlines():
        if line.rstrip().endswith("xx"):
            found.append((line.split()[0], []))
        else:
            found[-1][1].append([float(word) for word in line.split()[:7]])
    return found


def test_sgp4_states_of_vallado_2006() -> None:
    """All satellites of the verification of SGP4 that live for a day, to 1e-6 km over that day.

    Vallado, Crawford, Hujsak, Kelso (2006), AIAA 2006-6753: low, geostationary, Molniya,
    sun-synchronous and decaying ones, as their C++ program printed them.
    """
    lines = resources.files("sgp4").joinpath("SGP4-VER.TLE").read_text().splitlines()
    pairs = {
        one[2:7].strip().lstrip("0"): (one[:69], two[:69])
        for one, two in pairwise(line for line in lines if not line.startswith("#"))
        if one.startswith("1 ") and two.startswith("2 ")
    }
    seen = set()
    for number, rows in published_states():
        table = np.array([row for row in rows if abs(row[0]) <= 1440.0])
        made_up = number in ("33333", "33334", "33335")  # error cases, with wrong checksums
        if made_up or table.shape[0] < 5:
            continue
        (tle,) = read_tles("\n".join(pairs[number]), number)
        x = Sgp4Orbit.from_tle(tle).states(table[:, 0] * 60.0)
        assert_allclose(x[:3].T / 1e3, table[:, 1:4], rtol=0, atol=1e-6, err_msg=number)
        assert_allclose(x[3:].T / 1e3, table[:, 4:], rtol=0, atol=1e-8, err_msg=number)
        seen.add(number)
    assert {"6251", "8195", "28057", "28626"} <= seen
    assert len(seen) >= 15
