"""Covariance intersection: the least of its family, and safe whatever the correlation."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.consistency import nees
from hillsphere_estimators.covariance_intersection import covariance_intersection

SCALES = np.array([1.0, 2.0, 0.5])


def beliefs(cases: int) -> tuple[Belief, Belief]:
    random = np.random.default_rng(2)
    made = []
    for _ in range(2):
        A = random.normal(size=(cases, 3, 3))
        P = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(3)
        made.append(Belief.of(random.normal(size=(3, cases)), P, np.zeros(cases)))
    return made[0], made[1]


def joint(first: Belief, second: Belief, k: int, weight: float) -> tuple[Array, Array]:
    one, other = (np.linalg.inv(b.covariance[k]) for b in (first, second))
    P = np.linalg.inv(weight * one + (1.0 - weight) * other)
    x = P @ (weight * one @ first.x[:, k] + (1.0 - weight) * other @ second.x[:, k])
    return np.asarray(x), np.asarray(P, dtype=float)


@pytest.mark.parametrize("least", ["determinant", "trace"])
def test_is_the_least_of_its_family(least: Literal["determinant", "trace"]) -> None:
    first, second = beliefs(20)
    found, weights = covariance_intersection(first, second, least, SCALES)

    def size(P: Array) -> float:
        if least == "determinant":
            return float(np.linalg.det(P))
        return float(np.sum(np.diag(P) / SCALES**2))

    for k in range(20):
        x, P = joint(first, second, k, float(weights[k]))
        np.testing.assert_allclose(found.x[:, k], x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.covariance[k], P, rtol=1e-9, atol=1e-12)
        others = [size(joint(first, second, k, w)[1]) for w in np.linspace(0.0, 1.0, 201)]
        assert size(P) <= min(others) * (1.0 + 1e-9)
    assert weights.min() > 0.0
    assert np.ptp(weights) > 0.2


def test_takes_the_one_that_is_better_in_all() -> None:
    first, _ = beliefs(4)
    worse = Belief(first.x + 1.0, 2.0 * first.root, first.t_s)
    found, weights = covariance_intersection(first, worse)
    np.testing.assert_allclose(weights, 1.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.x, first.x, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.covariance, first.covariance, rtol=1e-8)


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.9])
def test_is_consistent_whatever_the_correlation(correlation: float) -> None:
    random = np.random.default_rng(3)
    P1, P2 = np.diag([4.0, 1.0]), np.diag([1.0, 3.0])
    both = random.normal(size=(2, 2, 20_000))
    e1 = np.sqrt(P1) @ both[0]
    e2 = np.sqrt(P2) @ (correlation * both[0] + np.sqrt(1.0 - correlation**2) * both[1])
    cases = [np.repeat(P[None], 20_000, axis=0) for P in (P1, P2)]
    first, second = (
        Belief.of(e, P, np.zeros(20_000)) for e, P in zip((e1, e2), cases, strict=True)
    )
    found, _ = covariance_intersection(first, second)
    assert nees(found, np.zeros((2, 20_000))).mean() < 2.05
    # taken for independent they would be joined with too much confidence
    information = np.linalg.inv(P1) + np.linalg.inv(P2)
    x = np.linalg.solve(information, np.linalg.solve(P1, e1) + np.linalg.solve(P2, e2))
    naive = Belief.of(x, np.repeat(np.linalg.inv(information)[None], 20_000, axis=0),
                      np.zeros(20_000))  # fmt: skip
    if correlation > 0.0:
        assert nees(naive, np.zeros((2, 20_000))).mean() > 3.0


def test_refuses_beliefs_of_other_times() -> None:
    first, second = beliefs(2)
    with pytest.raises(InputError, match="same states and times"):
        covariance_intersection(first, Belief(second.x, second.root, second.t_s + 1.0))
