"""Brouwer's mean elements: published values, flights, and the edges of the theory."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.kepler import elements_from_states, states_from_elements, wrap_angle
from hillsphere_tracking.mean_elements import (
    EARTH_FIELD,
    ZonalField,
    mean_from_osculating,
    osculating,
    propagate_secular,
    secular_rates,
    states,
)

DEGREE = np.pi / 180.0
UNITS = np.array([1e3, 1.0, DEGREE, DEGREE, DEGREE, DEGREE])
# Kuga and Carrara (1990), section 5
PAPER = np.array([7180.0, 0.0436, 23.82, 240.14, 15.47, 350.56]) * UNITS


def test_secular_rates_of_kuga_carrara_1990() -> None:
    node, perigee, mean = secular_rates(PAPER)[:, 0] / DEGREE * 86400.0
    assert_allclose([mean, perigee, node], [5142.101213424, 10.572696873, -6.073518124],
                    rtol=0, atol=1e-9)  # fmt: skip


def test_osculating_elements_of_kuga_carrara_1990() -> None:
    # a, e, M from an independent coding of Brouwer's and Lyddane's terms; i and Ω as it adds
    # Brouwer's terms to them, which is the same to first order only
    a, e, i, node, _, mean = osculating(PAPER)[:, 0] / UNITS
    assert_allclose([a, e, mean], [7182.3233108286, 0.0448086686, 350.8182568758],
                    rtol=0, atol=2e-10)  # fmt: skip
    assert_allclose([i, node], [23.8341480375, 240.1481072389], rtol=0, atol=1e-5)


def flight(start: Array, field: ZonalField, times: Array) -> Array:
    """States (6, K) under J2 alone, by SciPy."""
    gm, radius, j2 = field.gm_m3_s2, field.radius_m, field.j2

    def slope(t: float, x: Array) -> Array:
        r = np.sqrt(x[:3] @ x[:3])
        up = 5.0 * (x[2] / r) ** 2
        flat = 1.5 * j2 * gm * radius**2 / r**5 * np.array([1.0 - up, 1.0 - up, 3.0 - up])
        return np.concatenate([x[3:], -gm / r**3 * x[:3] - flat * x[:3]])

    flown = solve_ivp(
        slope, (0.0, times[-1]), start, method="DOP853", rtol=1e-12, atol=1e-5, t_eval=times
    )
    return np.asarray(flown.y)


@pytest.mark.parametrize(
    ("e", "i_deg"), [(0.0436, 43.8), (0.2, 43.8), (0.0, 23.8), (1e-4, 98.2), (0.05, 0.0),
                     (0.05, 144.0)],
)  # fmt: skip
def test_short_period_terms_are_those_of_a_flight(e: float, i_deg: float) -> None:
    # Mean elements found along a flight change by what is of second order, J2² ≈ 1e-6, and drift
    # evenly; the terms themselves are of 1e-3. The sum M + ω + Ω is where the two parts of the
    # theory with the divisor e must join.
    field = ZonalField(j4=0.0)
    mean = np.array([9180e3, e, i_deg * DEGREE, 4.19, 0.27, 6.12])[:, None]
    times = np.linspace(0.0, 18000.0, 300)
    osc = elements_from_states(
        flight(states(mean, np.zeros(1), field)[:, 0], field, times), field.gm_m3_s2
    )
    found = mean_from_osculating(osc, field)
    sense = 1.0 if i_deg < 120.0 else -1.0

    def scatter(elements: Array) -> Array:
        turned = elements[4] + sense * elements[3]
        rows = [elements[0] / 9180e3, elements[1] * np.cos(turned), elements[1] * np.sin(turned),
                elements[2], np.unwrap(elements[5] + turned)]  # fmt: skip
        return np.array([np.std(r - np.polyval(np.polyfit(times, r, 1), times)) for r in rows])

    assert (scatter(found) < 1e-6).all()
    assert scatter(osc).max() > 1e-4


def edges(count: int) -> Array:
    random = np.random.default_rng(6)
    e = random.choice([0.0, 1e-15, 1e-9, 1e-4, 0.02, 0.15], count)
    i = random.choice([0.0, 1e-10, 0.4, 1.107149, 1.6, 2.09, 2.1, np.pi - 1e-9, np.pi], count)
    angles = random.uniform(0.0, 2.0 * np.pi, (3, count))
    return np.array([random.uniform(6.8e6, 4.2e7, count), e, i, *angles])


def test_inverse_to_rounding_at_every_edge() -> None:
    elements = edges(600)
    zero = np.zeros(600)
    again = states(mean_from_osculating(osculating(elements)), zero)
    expected = states(elements, zero)
    assert_allclose(again[:3], expected[:3], rtol=0, atol=2e-6)
    assert_allclose(again[3:], expected[3:], rtol=0, atol=2e-9)


@pytest.mark.parametrize("row", [1, 2])
def test_no_jump_at_circular_and_equatorial_orbits(row: int) -> None:
    base = PAPER.copy()[:, None] * np.ones(2)
    base[row] = [0.0, 1e-9]
    a, b = states(base, np.zeros(2)).T
    assert_allclose(a[:3], b[:3], rtol=0, atol=0.05)  # 1e-9 of 7000 km, and what is of first order


def test_no_jump_where_the_retrograde_elements_begin() -> None:
    base = PAPER.copy()[:, None] * np.ones(2)
    base[2] = np.arccos(-0.5) + np.array([-1e-12, 1e-12])
    a, b = states(base, np.zeros(2)).T
    assert_allclose(a[:3], b[:3], rtol=0, atol=10.0)  # they differ in what is of second order


def test_propagated() -> None:
    later = propagate_secular(PAPER[:, None], np.array([0.0, 86400.0]))
    assert_allclose(later[:, 0], PAPER, rtol=0, atol=0)
    assert_allclose((later[3:, 1] - later[3:, 0]) / DEGREE, [-6.073518124, 10.572696873,
                    5142.101213424], rtol=0, atol=1e-9)  # fmt: skip


def test_sphere_leaves_elements_alone() -> None:
    sphere = ZonalField(j2=0.0, j4=0.0)
    elements = edges(50)
    keplerian = states_from_elements(elements, sphere.gm_m3_s2)
    assert_allclose(states(elements, np.zeros(50), sphere), keplerian, rtol=0, atol=1e-6)
    rates = secular_rates(elements, sphere)
    assert_allclose(rates[:2], 0.0, atol=0)
    assert_allclose(rates[2], np.sqrt(sphere.gm_m3_s2 / elements[0] ** 3), rtol=1e-15)


def test_angles_come_back_in_one_revolution() -> None:
    found = osculating(edges(50))
    assert ((found[3:] >= 0.0) & (found[3:] <= 2.0 * np.pi)).all()
    assert np.abs(wrap_angle(found[5] + found[4] + found[3])).max() <= np.pi


def test_refusals() -> None:
    with pytest.raises(InputError, match="eccentricities"):
        osculating(np.array([7e6, 1.2, 0.5, 0.0, 0.0, 0.0]))
    with pytest.raises(ConvergenceError, match="does not converge"):
        mean_from_osculating(np.array([6e5, 0.9, 0.5, 1.0, 1.0, 0.1]))
    with pytest.raises(InputError, match="zonal field"):
        ZonalField(gm_m3_s2=-1.0)
    assert ZonalField() == EARTH_FIELD
