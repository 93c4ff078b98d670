"""The correction by one measurement, against the matrix formulae, case by case."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.interfaces import Array
from hillsphere_tracking.trackers.correction import Correction, correct_estimate, select_correction

CASES = 5


def given(m: int, far: float = 1.0) -> tuple[Array, Array, Array, Array]:
    """Covariances, slopes, what is off, and variances, of sizes that differ by 10⁵."""
    random = np.random.default_rng(m)
    root = random.standard_normal((CASES, m, m)) * np.logspace(0.0, 5.0, m)[:, None]
    prior = (root @ root.transpose(0, 2, 1)).transpose(1, 2, 0)
    slopes = random.standard_normal((2, m, CASES)) / np.logspace(0.0, 5.0, m)[:, None]
    off = far * random.standard_normal((2, CASES))
    return prior, slopes, off, random.uniform(0.5, 2.0, (2, CASES))


@pytest.mark.parametrize("m", [2, 3, 6, 10])
def test_is_the_kalman_filter(m: int) -> None:
    prior, slopes, off, variances = given(m)
    found = correct_estimate(prior, slopes, off, variances, 100.0)
    assert_allclose(found.weight, 1.0, rtol=0)
    for k in range(CASES):
        p, h, r = prior[..., k], slopes[..., k], np.diag(variances[:, k])
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        assert_allclose(found.step[:, k], -gain @ off[:, k], rtol=1e-9)
        assert_allclose(found.shift[k], np.abs(h @ gain @ off[:, k]).max(), rtol=1e-9)
        rest = np.eye(m) - gain @ h
        after = rest @ p @ rest.T + gain @ r @ gain.T
        scale = np.sqrt(np.outer(np.diag(after), np.diag(after)))
        assert_allclose(found.covariance[..., k] / scale, after / scale, rtol=0, atol=1e-9)
        assert_allclose(found.covariance[..., k], found.covariance[..., k].T, rtol=0)


def test_an_outlier_comes_to_stand_near_the_gate_and_loses_weight() -> None:
    prior, slopes, off, variances = given(4)
    steps = []
    for far in (3e2, 3e3, 3e4):
        found = correct_estimate(prior, slopes, far * off, variances, 5.0)
        for k in range(CASES):
            h, nu = slopes[..., k], far * off[:, k]
            s = h @ prior[..., k] @ h.T + np.diag(variances[:, k])
            weight = nu @ np.linalg.solve(s, nu) / 25.0
            assert weight > 1.0
            assert_allclose(found.weight[k], weight, rtol=1e-9)
            grown = s + (weight - 1.0) * np.diag(np.diag(s))
            gain = prior[..., k] @ h.T @ np.linalg.inv(grown)
            assert_allclose(found.step[:, k], -gain @ nu, rtol=1e-9)
            assert 10.0 < nu @ np.linalg.solve(grown, nu) < 50.0
        steps.append(np.abs(found.step))
    # ten times as far counts a tenth, though the prior is far wider than the noise
    assert_allclose(steps[2], 0.1 * steps[1], rtol=0.02)
    nothing = correct_estimate(prior, slopes, 1e9 * off, variances, 5.0)
    assert_allclose(nothing.covariance, prior, rtol=1e-6)


def test_linearised_elsewhere_the_same_line_gives_the_same_step() -> None:
    prior, slopes, off, variances = given(3)
    first = correct_estimate(prior, slopes, off, variances, 5.0)
    there = np.full((3, CASES), 0.3)
    moved = off + np.einsum("amn,mn->an", slopes, there)
    again = correct_estimate(prior, slopes, moved, variances, 5.0, (there, first.weight))
    assert_allclose(again.step, first.step, rtol=1e-9)
    assert_allclose(again.weight, first.weight, rtol=0)
    assert_allclose(again.covariance, first.covariance, rtol=1e-9)
    left = np.einsum("amn,mn->an", slopes, first.step - there)
    assert_allclose(again.shift, np.abs(left).max(axis=0), rtol=1e-9)


def test_chosen_case_by_case() -> None:
    old, new = (
        Correction(*(np.full((*shape, 3), number) for shape in ((2,), (), (), (2, 2))))
        for number in (1.0, 2.0)
    )
    found = select_correction(np.array([True, False, True]), new, old)
    for array in vars(found).values():
        assert_allclose(array, np.broadcast_to([2.0, 1.0, 2.0], array.shape), rtol=0)
