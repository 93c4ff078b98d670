"""Predictions of members between known ones, on curves that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.prediction import null_vectors, predict_members


def curve(s: Array) -> tuple[Array, Array]:
    """Return points (4, K) of a smooth curve and its unit tangents."""
    z = np.array([s, np.sin(s), 1.0 - 0.3 * s**2, np.cos(2.0 * s)])
    t = np.array([np.ones_like(s), np.cos(s), -0.6 * s, -2.0 * np.sin(2.0 * s)])
    return z, t / np.linalg.norm(t, axis=0)


def known(s: Array) -> tuple[np.ndarray, Array, Array, Array]:
    z, t = curve(s)
    # a null vector has no sense
    t[:, ::2] *= -1.0
    return np.zeros(s.size, dtype=np.intp), np.arange(s.size, dtype=float), z, t


def test_prediction_is_far_better_than_a_cubic() -> None:
    s = np.array([0.15, 0.2, 0.275, 0.35, 0.4])
    truth, tangent = curve(np.array([0.3]))
    # a guess in the plane through the true place
    aside = np.array([[0.0], [1.0], [0.5], [0.0]])
    guess = truth + 1e-3 * (aside - tangent * np.sum(tangent * aside, axis=0))
    family, u = np.array([0]), np.array([2.3])
    made = predict_members(known(s), (family, u), guess, tangent)
    # degree seven: 6.5e-9 was measured; the cubic errs by 3.7e-6
    assert np.max(np.abs(made - truth)) < 3e-8
    assert np.sum(tangent * (made - guess)) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("fault", ["another curve", "one member", "along the plane"])
def test_guess_is_kept_where_nothing_better_is_known(fault: str) -> None:
    family, u, z, t = known(np.array([0.0, 0.1, 0.25, 0.4, 0.5]))
    guess, tangent = curve(np.array([0.3]))
    normal = tangent
    if fault == "another curve":
        z = z + np.where(u > 2.0, 1.0, 0.0) * np.array([[0.0], [0.0], [1.0], [0.0]])
    elif fault == "one member":
        family, u, z, t = family[:1], u[:1], z[:, :1], t[:, :1]
    else:
        normal = np.linalg.svd(tangent.T)[2][-1][:, None]
    made = predict_members((family, u, z, t), (np.array([0]), np.array([2.3])), guess, normal)
    assert np.array_equal(made, guess)


def test_null_vectors_are_tangents() -> None:
    slopes = np.random.default_rng(3).normal(size=(3, 4, 5))
    lines = null_vectors(slopes)
    assert np.max(np.abs(np.einsum("ijk,jk->ik", slopes, lines))) < 1e-14
    assert np.linalg.norm(lines, axis=0) == pytest.approx(np.ones(5))
