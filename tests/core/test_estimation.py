"""Beliefs and sets of measurements refuse what cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Channel

BLOCKS = ((Channel("range", "m"),), (Channel("direction", "", "direction"),))


def test_belief_of_a_covariance() -> None:
    A = np.random.default_rng(1).normal(size=(5, 3, 3))
    P = A @ np.swapaxes(A, 1, 2)
    belief = Belief.of(np.ones((3, 5)), P, np.zeros(5))
    np.testing.assert_allclose(belief.covariance, P, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(belief.root, np.tril(belief.root))
    np.testing.assert_allclose(
        belief.sigma, np.sqrt(np.diagonal(P, axis1=1, axis2=2)).T, rtol=1e-12
    )


def test_belief_refuses_what_is_no_covariance() -> None:
    P = np.repeat(np.eye(2)[None], 4, axis=0)
    P[2] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(InputError, match=r"cases \[2\] are not positive definite.*-1"):
        Belief.of(np.zeros((2, 4)), P, np.zeros(4))


@pytest.mark.parametrize(
    ("x", "root", "t_s"),
    [((2, 3), (3, 2, 3), (3,)), ((2, 3), (2, 2, 2), (3,)), ((2, 3), (3, 2, 2), (1,)),
     ((2,), (1, 2, 2), (1,))],
)  # fmt: skip
def test_belief_refuses_shapes(x: tuple[int, ...], root: tuple[int, ...], t_s: tuple[int]) -> None:
    with pytest.raises(InputError, match="a belief needs x"):
        Belief(np.zeros(x), np.zeros(root), np.zeros(t_s))


def test_what_is_nan_was_not_measured() -> None:
    values = np.array([[1.0, np.nan], [0.0, np.nan], [0.0, np.nan], [1.0, np.nan]])
    found = MeasurementSet.of(np.zeros(2), values, np.full((4, 1), 0.1), BLOCKS)
    np.testing.assert_array_equal(found.present, [[True, False]] * 4)
    assert found.sigma.shape == (4, 2)


def test_measurements_refuse_what_cannot_be_used() -> None:
    ones, there = np.ones((4, 2)), np.ones((4, 2), dtype=bool)
    with pytest.raises(InputError, match=r"must be \(4, 2\), got \(3, 2\)"):
        MeasurementSet(np.zeros(2), ones[:3], ones, BLOCKS, there)
    for wrong in (0.0, -1.0, np.inf, np.nan):
        sigma = ones.copy()
        sigma[3, 1] = wrong
        with pytest.raises(InputError, match="row 3 of case 1 is present"):
            MeasurementSet(np.zeros(2), ones, sigma, BLOCKS, there)
        absent = there.copy()
        absent[3, 1] = False
        MeasurementSet(np.zeros(2), ones, sigma, BLOCKS, absent)


def test_innovation_counts_its_rows() -> None:
    used = np.array([[True, False], [True, False], [False, True]])
    brought = Innovation(np.zeros((3, 2)), np.zeros((2, 3, 3)), used, np.zeros(2))
    np.testing.assert_array_equal(brought.dof, [2, 1])


@pytest.mark.parametrize(
    ("entries", "message"),
    [([[1.0, np.nan], [np.nan, 1.0]], "the covariance of case 1 is not finite"),
     ([[np.inf, 0.0], [0.0, 1.0]], "the covariance of case 1 is not finite"),
     ([[1.0, 0.5], [0.0, 1.0]], r"case 1 is not symmetric: its entry \(0, 1\) is 0.5")],
)  # fmt: skip
def test_belief_refuses_covariances_with_holes_or_skew(
    entries: list[list[float]], message: str
) -> None:
    P = np.array([np.eye(2), entries])
    with pytest.raises(InputError, match=message):
        Belief.of(np.zeros((2, 2)), P, np.zeros(2))


def test_belief_takes_what_is_symmetric_but_for_rounding() -> None:
    P = np.array([[[1e6, 1.0 + 1e-12], [1.0, 1e-6 + 1.0]]])
    Belief.of(np.zeros((2, 1)), P, np.zeros(1))
    with pytest.raises(InputError, match=r"must be \(N, n, n\), got \(2, 2\)"):
        Belief.of(np.zeros((2, 1)), P[0], np.zeros(1))
