"""Differences of antenna angles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.interfaces import Array
from hillsphere_tracking.assisted_tracking.errors import (
    arc,
    larger_sigma,
    nees,
    on_the_sky,
    root_sum_square,
)

RNG = np.random.default_rng(5)


def unit(angles: Array) -> Array:
    azimuth, elevation = angles
    level = np.cos(elevation)
    return np.array([np.sin(azimuth) * level, np.cos(azimuth) * level, np.sin(elevation)])


def directions(count: int) -> Array:
    return np.array([RNG.uniform(0.0, 2.0 * np.pi, count), RNG.uniform(0.0, 1.5, count)])


def test_arc_is_the_angle_between_unit_vectors() -> None:
    a, b = directions(50), directions(50)
    across = np.linalg.norm(np.cross(unit(a), unit(b), axis=0), axis=0)
    expected = np.arctan2(across, (unit(a) * unit(b)).sum(axis=0))
    assert_allclose(arc(a, b), expected, rtol=1e-12)


def test_across_the_zenith_the_arc_is_small_and_the_sum_of_squares_is_not() -> None:
    a, b = np.array([0.1, np.pi / 2 - 1e-3]), np.array([0.1 + np.pi, np.pi / 2 - 1e-3])
    assert arc(a, b) == pytest.approx(2e-3, rel=1e-6)
    assert root_sum_square(a, b) == pytest.approx(np.pi)


def test_azimuth_goes_the_short_way_round() -> None:
    a, b = np.array([0.01, 0.3]), np.array([2.0 * np.pi - 0.02, 0.34])
    assert root_sum_square(a, b) == pytest.approx(0.05)


def test_components_on_the_sky() -> None:
    reference = directions(20)
    step = 1e-5 * RNG.normal(size=(2, 20))
    found = on_the_sky(reference + step, reference)
    assert_allclose(found[0], step[0] * np.cos(reference[1]), rtol=0, atol=1e-9)
    assert_allclose(found[1], step[1], rtol=0, atol=1e-9)
    far = directions(20)
    assert_allclose(np.hypot(*on_the_sky(far, reference)), arc(far, reference), rtol=1e-12)


def test_normalised_square_and_larger_sigma() -> None:
    root = RNG.normal(size=(2, 2, 7))
    covariance = np.einsum("ikn,jkn->ijn", root, root)
    error = RNG.normal(size=(2, 7))
    solved = [error[:, n] @ np.linalg.solve(covariance[:, :, n], error[:, n]) for n in range(7)]
    assert_allclose(nees(error, covariance), solved, rtol=1e-9)
    values = np.linalg.eigvalsh(covariance.transpose(2, 0, 1))[:, 1]
    assert_allclose(larger_sigma(covariance), np.sqrt(values), rtol=1e-12)
