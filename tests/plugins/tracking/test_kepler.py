"""Kepler's equation and elements to states and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere_tracking.kepler import (
    eccentric_anomaly,
    elements_from_states,
    mean_anomaly,
    states_from_elements,
    true_anomaly,
    wrap_angle,
)

GM = 398600.4418e9


def test_vallado_example_2_1() -> None:
    found = eccentric_anomaly(np.radians([235.4]), np.array([0.4]))
    assert_allclose(np.degrees(found), 220.512074767522, rtol=0, atol=1e-10)


def test_vallado_example_2_5() -> None:
    # the book's r and v, km and km/s, and its elements: p = 11067.790, e = 0.83285 ...
    state = np.array([[6524.834, 6862.875, 6448.296, 4.901327, 5.533756, -1.976341]]).T * 1e3
    a, e, i, node, perigee, mean = elements_from_states(state, GM)[:, 0]
    assert_allclose(a, 36127.343e3, rtol=1e-6)
    assert_allclose(e, 0.832853, rtol=0, atol=1e-6)
    assert_allclose(np.degrees([i, node, perigee]), [87.870, 227.898, 53.38], rtol=0, atol=6e-3)
    f = true_anomaly(eccentric_anomaly(np.array([mean]), np.array([e])), np.array([e]))
    assert_allclose(np.degrees(f), 92.335, rtol=0, atol=2e-3)


@given(
    m=st.floats(-50.0, 50.0),
    e=st.one_of(st.floats(0.0, 0.999999), st.sampled_from([0.0, 1e-300, 1e-12, 1.0 - 1e-12])),
)
def test_kepler_equation_holds(m: float, e: float) -> None:
    anomaly = eccentric_anomaly(np.array([m]), np.array([e]))
    assert_allclose(anomaly - e * np.sin(anomaly), m, rtol=4e-16, atol=4e-15)
    assert abs(anomaly[0] - m) <= e + 1e-14 * abs(m)


@given(f=st.floats(-20.0, 20.0), e=st.floats(0.0, 0.95))
def test_anomalies_keep_the_revolution(f: float, e: float) -> None:
    ee = np.array([e])
    mean = mean_anomaly(np.array([f]), ee)
    assert_allclose(true_anomaly(eccentric_anomaly(mean, ee), ee), f, rtol=0, atol=3e-13)


def edges(count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Elements among which are circular, equatorial and retrograde ones."""
    random = np.random.default_rng(4)
    e = random.choice([0.0, 1e-14, 1e-8, 0.01, 0.3, 0.9], count)
    i = random.choice([0.0, 1e-12, 0.4, 0.5 * np.pi, 2.5, np.pi - 1e-9, np.pi], count)
    angles = random.uniform(0.0, 2.0 * np.pi, (3, count))
    return np.array([random.uniform(6.6e6, 4.2e7, count), e, i, *angles])


def test_states_there_and_back_at_every_edge() -> None:
    states = states_from_elements(edges(500), GM)
    again = states_from_elements(elements_from_states(states, GM), GM)
    assert_allclose(again[:3], states[:3], rtol=0, atol=1e-5)
    assert_allclose(again[3:], states[3:], rtol=0, atol=1e-8)


def test_energy_and_momentum_of_states() -> None:
    elements = edges(100)
    x = states_from_elements(elements, GM)
    radius = np.sqrt((x[:3] ** 2).sum(axis=0))
    energy = 0.5 * (x[3:] ** 2).sum(axis=0) - GM / radius
    assert_allclose(energy, -0.5 * GM / elements[0], rtol=1e-13)
    momentum = np.cross(x[:3], x[3:], axis=0)
    size = np.sqrt(GM * elements[0] * (1.0 - elements[1] ** 2))
    assert_allclose(momentum[2], size * np.cos(elements[2]), rtol=0, atol=1e-13 * size.max())


def test_wrapped() -> None:
    turned = wrap_angle(np.array([0.0, np.pi, -np.pi, 7.0, -7.0]))
    assert_allclose(turned, [0.0, -np.pi, -np.pi, 7.0 - 2 * np.pi, 2 * np.pi - 7.0], rtol=1e-15)


@pytest.mark.parametrize(
    ("row", "value", "text"),
    [
        (0, -7e6, "semi-major axes must be > 0"),
        (1, 1.0, "eccentricities must be in"),
        (1, -0.1, "eccentricities must be in"),
        (4, np.nan, "must be finite"),
    ],
)
def test_elements_that_are_no_ellipse_are_refused(row: int, value: float, text: str) -> None:
    elements = np.array([7e6, 0.01, 0.5, 0.1, 0.2, 0.3])
    elements[row] = value
    with pytest.raises(InputError, match=text):
        states_from_elements(elements, GM)


def test_other_refusals() -> None:
    with pytest.raises(InputError, match=r"\(6, N\)"):
        states_from_elements(np.ones((5, 2)), GM)
    with pytest.raises(InputError, match=r"\(6, N\)"):
        elements_from_states(np.ones(6), GM)
    with pytest.raises(InputError, match="not on an ellipse"):
        elements_from_states(np.array([[7e6, 0, 0, 0, 12e3, 0]]).T, GM)
    with pytest.raises(InputError, match="not on an ellipse"):
        elements_from_states(np.array([[7e6, 0, 0, 1e3, 0, 0]]).T, GM)
    with pytest.raises(InputError, match="0 ≤ e < 1"):
        eccentric_anomaly(np.array([1.0]), np.array([1.0]))
