"""Connections against the same arithmetic on frequency responses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import (
    append,
    close_with_gain,
    feedback,
    gain,
    lower_lft,
    parallel,
    series,
    star,
    upper_lft,
)
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous, discrete

OMEGA = np.array([0.0, 0.3, 1.7, 40.0])


def system(seed: int, outputs: int, inputs: int, order: int = 3) -> LtiSystem:
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(order, order)),
        random.normal(size=(order, inputs)),
        random.normal(size=(outputs, order)),
        random.normal(size=(outputs, inputs)),
    )


def test_series_parallel_and_append() -> None:
    g, h, k = system(1, 2, 3), system(2, 4, 2), system(3, 2, 3)
    gw, hw, kw = (s.response(OMEGA) for s in (g, h, k))
    assert_allclose(series(g, h).response(OMEGA), hw @ gw, rtol=1e-11)
    assert_allclose(parallel(g, k).response(OMEGA), gw + kw, rtol=1e-12)
    both = append(g, h).response(OMEGA)
    assert_allclose(both[:, :2, :3], gw, rtol=1e-12)
    assert_allclose(both[:, 2:, 3:], hw, rtol=1e-12)
    assert not both[:, :2, 3:].any()
    with pytest.raises(InputError, match="2 outputs into 3 inputs"):
        series(g, k)


def test_series_keeps_the_sampling_period() -> None:
    """Whichever of the two has it: a constant has none."""
    sampled = LtiSystem(0.5 * np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), 0.1)
    three = gain(np.array([[3.0]]))
    for made in (series(three, sampled), series(sampled, three), series(three, three, sampled)):
        assert made.dt_s == 0.1
        assert made.is_stable
    with pytest.raises(InputError, match="different sampling periods"):
        series(three, sampled, system(1, 1, 1))
    with pytest.raises(InputError, match="nothing to put in series"):
        series()


def test_feedback() -> None:
    g, h = system(4, 2, 3), system(5, 3, 2)
    gw, hw = g.response(OMEGA), h.response(OMEGA)
    for sign in (-1, 1):
        expected = np.linalg.solve(np.eye(2) - sign * gw @ hw, gw)
        assert_allclose(feedback(g, h, sign).response(OMEGA), expected, rtol=1e-10)


def test_star_product_and_both_fractional_transformations() -> None:
    p, q = system(6, 5, 4), system(7, 4, 3)
    pw, qw = p.response(OMEGA), q.response(OMEGA)
    made = star(p, q, 2, 2).response(OMEGA)
    p11, p12, p21, p22 = pw[:, :3, :2], pw[:, :3, 2:], pw[:, 3:, :2], pw[:, 3:, 2:]
    q11, q12, q21, q22 = qw[:, :2, :2], qw[:, :2, 2:], qw[:, 2:, :2], qw[:, 2:, 2:]
    one = np.eye(2)
    left = np.linalg.solve(one - q11 @ p22, np.concatenate([q11 @ p21, q12], axis=2))
    right = np.linalg.solve(one - p22 @ q11, np.concatenate([p21, p22 @ q12], axis=2))
    top = p12 @ left + np.concatenate([p11, np.zeros((4, 3, 1))], axis=2)
    bottom = q21 @ right + np.concatenate([np.zeros((4, 2, 2)), q22], axis=2)
    assert_allclose(made, np.concatenate([top, bottom], axis=1), rtol=1e-9)

    k = system(8, 2, 2)
    kw = k.response(OMEGA)
    low = p11 + p12 @ kw @ np.linalg.solve(one - p22 @ kw, p21)
    assert_allclose(lower_lft(p, k).response(OMEGA), low, rtol=1e-9)
    u11, u12, u21, u22 = pw[:, :2, :2], pw[:, :2, 2:], pw[:, 2:, :2], pw[:, 2:, 2:]
    high = u22 + u21 @ kw @ np.linalg.solve(one - u11 @ kw, u12)
    assert_allclose(upper_lft(p, k).response(OMEGA), high, rtol=1e-9)


def test_a_loop_of_direct_terms_alone_is_refused() -> None:
    with pytest.raises(InputError, match="not well posed"):
        feedback(gain(np.eye(2)), gain(np.eye(2)), sign=1)
    with pytest.raises(InputError, match="2 × 3"):
        close_with_gain(system(1, 3, 2), np.eye(2))
    sampled = LtiSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1), dt_s=1.0)
    with pytest.raises(InputError, match="different sampling periods"):
        series(system(2, 1, 1), sampled)


def test_bilinear_map_keeps_the_response_at_bent_frequencies() -> None:
    g, dt = system(9, 2, 2), 0.3
    image = discrete(g, dt)
    bent = 2.0 / dt * np.tan(0.5 * dt * OMEGA[:3])
    assert_allclose(image.response(OMEGA[:3]), g.response(bent), rtol=1e-11)
    back = continuous(image)
    assert_allclose(back.a, g.a, rtol=1e-11)
    assert_allclose(back.response(OMEGA), g.response(OMEGA), rtol=1e-11)
    with pytest.raises(InputError, match="z = −1"):
        continuous(LtiSystem(-np.eye(1), np.eye(1), np.eye(1), np.eye(1), dt_s=1.0))


def test_balancing_scales_by_powers_of_two_and_changes_no_response() -> None:
    random = np.random.default_rng(10)
    spread = 10.0 ** random.uniform(-6, 6, 6)
    good = system(11, 2, 3, order=6)
    bad = LtiSystem(
        good.a * spread[:, None] / spread, good.b * spread[:, None], good.c / spread, good.d
    )
    made, scale = balance_states(bad)
    assert set(np.frexp(scale)[0]) == {0.5}
    assert np.abs(made.a).max() < 10.0 * np.abs(good.a).max()
    assert_allclose(made.response(OMEGA), bad.response(OMEGA), rtol=1e-9)
    assert_allclose(made.a, bad.a * scale / scale[:, None], rtol=0)


def test_a_loop_is_judged_whatever_the_units_are() -> None:
    """A product has no loop at all, with entries of 1e15 as well; 1 − 1 = 0 stays one."""
    large = gain(np.diag([1e9, 1.0]))
    chain = close_with_gain(append(large, gain(1e15 * np.ones((2, 2)))), np.eye(4, k=-2))
    assert_allclose(chain.d[2:, :2], 1e15 * np.array([[1e9, 1.0], [1e9, 1.0]]), rtol=1e-12)
    closed = np.array([[0.0, 1e-9], [1e9, 0.0]])
    with pytest.raises(InputError, match="not well posed"):
        close_with_gain(gain(np.eye(2)), closed)


@pytest.mark.parametrize(
    "given, match",
    [
        ([[-1.0 + 5.0j]], "complex ones"),
        ([["x"]], "others, or too large ones"),
        ([[1.0, 2.0], [3.0]], "rows of different lengths"),
        ([[np.nan]], "nan or inf"),
        (-1.0, "must be a matrix"),
    ],
)
def test_what_is_no_real_matrix_is_refused(given: Any, match: str) -> None:
    one = np.eye(1)
    with pytest.raises(InputError, match=match):
        LtiSystem(given, one, one, one)
    with pytest.raises(InputError, match=match):
        close_with_gain(gain(one), given)


def test_a_system_takes_no_text_for_names_and_no_period_but_a_number() -> None:
    one = np.eye(1)
    text: Any = "u"
    with pytest.raises(InputError, match="a tuple of names is needed"):
        LtiSystem(-one, one, one, one, inputs=text)
    with pytest.raises(InputError, match="a sampling period must be a number"):
        LtiSystem(-one, one, one, one, text)
    turned: Any = 1j * one
    with pytest.raises(InputError, match="complex"):
        gain(turned)


def test_frequencies_without_a_response_are_refused() -> None:
    one = np.eye(1)
    lag, integrator = LtiSystem(-one, one, one, 0.0 * one), LtiSystem(0.0 * one, one, one, one)
    for given, omega, match in (
        (lag, np.array([np.nan]), "one row of numbers"),
        (lag, np.array([1j]), "must be real"),
        (replace(lag, dt_s=1.0), np.array([np.inf]), "in discrete time"),
        (integrator, np.array([0.0]), "that of a pole"),
    ):
        with pytest.raises(InputError, match=match):
            given.response(omega)


def test_numbers_whose_squares_are_none_are_refused() -> None:
    one = np.eye(1)
    for size in (1e200, 1e-200):
        with pytest.raises(InputError, match="whose square is no number"):
            balance_states(LtiSystem(-size * one, one, one, one))
