"""Stability indices from monodromy matrices with known multipliers."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.stability import (
    determinant_error,
    is_decoupled,
    monodromy_of_half,
    multipliers,
    stability_indices,
)

PLANE = [0, 3, 1, 4]  # x, vx, y, vy: the pair (1, 1) in the first block, λ and 1/λ in the second


def turn(angle: float) -> Array:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def stretch(factor: float) -> Array:
    return np.diag([factor, 1.0 / factor])


def matrix(planar: Array, vertical: Array) -> Array:
    m = np.zeros((6, 6))
    m[np.ix_([0, 3], [0, 3])] = [[1.0, 0.7], [0.0, 1.0]]
    m[np.ix_([1, 4], [1, 4])] = planar
    m[np.ix_([2, 5], [2, 5])] = vertical
    return m[:, :, None]


def mixed(m: Array) -> Array:
    """Keep the multipliers, couple the planes a little by a change of states."""
    t = np.eye(6) + 0.03 * np.random.default_rng(3).normal(size=(6, 6))
    return np.asarray((t @ m[:, :, 0] @ np.linalg.inv(t))[:, :, None])


@pytest.mark.parametrize("change", [lambda m: m, mixed])
def test_indices_by_plane(change: object) -> None:
    assert callable(change)
    m = change(matrix(turn(2.0), stretch(-3.0)))
    planar, vertical = stability_indices(m)
    assert planar[0] == pytest.approx(2 * np.cos(2.0), abs=1e-12)
    assert vertical[0] == pytest.approx(-3.0 - 1 / 3.0, abs=1e-12)


def test_decoupling_is_seen() -> None:
    m = matrix(turn(1.0), turn(0.4))
    assert bool(is_decoupled(m)[0])
    assert not bool(is_decoupled(mixed(m))[0])


def test_complex_instability_has_no_index() -> None:
    """Multipliers r e^{±iφ}, e^{±iφ}/r: a quadruplet off the unit circle and off the real axis."""
    m = np.zeros((6, 6))
    m[np.ix_([0, 3], [0, 3])] = np.eye(2)
    m[np.ix_([1, 2], [1, 2])] = 1.3 * turn(0.8)
    m[np.ix_([4, 5], [4, 5])] = turn(0.8) / 1.3
    indices = np.array(stability_indices(m[:, :, None]))
    assert bool(np.all(np.isnan(indices)))


def test_plane_only() -> None:
    m = matrix(turn(0.5), turn(1.0))[np.ix_([0, 1, 3, 4], [0, 1, 3, 4])]
    planar, vertical = stability_indices(m)
    assert planar[0] == pytest.approx(2 * np.cos(0.5), abs=1e-14)
    assert bool(np.isnan(vertical[0]))


def test_other_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="4 or 6 states, got 3"):
        stability_indices(np.eye(3)[:, :, None])


def test_multipliers_and_determinant() -> None:
    m = matrix(turn(2.0), stretch(-3.0))
    found = multipliers(m)[:, 0]
    assert found[0] == pytest.approx(-3.0)
    assert found[-1] == pytest.approx(-1 / 3.0)
    assert determinant_error(m)[0] == pytest.approx(0.0, abs=1e-14)
    assert determinant_error(1.1 * m)[0] == pytest.approx(1.1**6 - 1)


def test_monodromy_of_half_of_an_oscillator() -> None:
    """X'' = −ω²x over a whole turn in two halves, mirrored in x: M is that of the whole."""
    omega, half = 1.7, 0.9
    rotation = np.array([
        [np.cos(omega * half), np.sin(omega * half) / omega],
        [-omega * np.sin(omega * half), np.cos(omega * half)],
    ])  # fmt: skip
    whole = monodromy_of_half(rotation[:, :, None], (1, -1))
    np.testing.assert_allclose(whole[:, :, 0], rotation @ rotation, rtol=0, atol=1e-14)
