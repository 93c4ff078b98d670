"""Filters over many steps, from wide priors behind a gate, and joined with unknown correlations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from tests.plugins.estimators.estimation_models import (
    ANGLES,
    Linear,
    Pair,
    nothing,
    pair_flight,
    run_filter,
    without,
)

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Estimator
from hillsphere.testing import example
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.iterated_extended import IteratedExtended
from hillsphere_estimators.specs import BatchedUnscentedSpec, IteratedExtendedSpec
from hillsphere_estimators.unscented import BatchedUnscented

FIRST_ROWS = [0, 2, 5, 7, 10]
"""Of each of the pair's five blocks."""
GATED: list[Estimator] = [
    BatchedUnscented(BatchedUnscentedSpec(update="iterated", gate_sigmas=5)),
    IteratedExtended(IteratedExtendedSpec(gate_sigmas=5)),
]


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended", "information"])
def test_covariance_stays_positive_definite_over_1e5_steps(type_: str) -> None:
    """250 cases of 400 steps, noise of measurements from 1e-7 to 1e7 of the motion's.

    At the end each covariance is the steady one of its own Riccati equation.
    """
    estimator: Estimator = example("estimator", type_)
    cases, steps = 250, 400
    F, G, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0], [1.0]]), np.array([[1.0, 0.0]])
    model, sigma = Linear(F, G, H), np.logspace(-7.0, 7.0, cases)
    root = np.repeat(np.eye(2)[None], cases, axis=0) * 10.0
    belief = Belief(np.zeros((2, cases)), root, np.zeros(cases))
    for k in range(steps):
        belief = estimator.predict(model, belief, belief.t_s + 1.0, nothing(cases))
        measured = MeasurementSet.of(belief.t_s, np.zeros((1, cases)), sigma[None], model.blocks)
        belief, _ = estimator.update(model, belief, measured)
        assert np.diagonal(belief.root, axis1=1, axis2=2).min() > 0.0, k
    scaled = belief.covariance / (belief.sigma.T[:, :, None] * belief.sigma.T[:, None])
    assert np.linalg.eigvalsh(scaled).min() > 0.0
    for case in range(75, 150, 25):  # those that have settled
        R = sigma[case] ** 2
        P = solve_discrete_are(F.T, H.T, G @ G.T, [[R]])
        K = P @ H.T / (H @ P @ H.T + R)
        steady = (np.eye(2) - K @ H) @ P
        np.testing.assert_allclose(belief.covariance[case], steady, rtol=1e-6)


@pytest.mark.parametrize("estimator", GATED)
@pytest.mark.parametrize("period_s", [600.0, 21600.0])
def test_gate_takes_every_good_measurement_from_the_first(
    estimator: Estimator, period_s: float
) -> None:
    """From a prior of a tenth of the distance, where only the curvature is no measure."""
    flight = pair_flight(40, 6, period_s=period_s)
    run = run_filter(estimator, Pair(), flight)
    for brought in run.brought:
        np.testing.assert_array_equal(brought.dof, 13)
    low, high = chi_square_band(12, 40, 0.99999)
    assert low < nees(run.after[-1], flight.truth[-1]).mean() < high


def test_gate_keeps_what_is_good_among_dropouts_and_outliers() -> None:
    """Formation of two, 30 % of the blocks missing and 2 % thirty standard deviations off.

    From the fifth measurement on: no good block is refused, every wild one is.
    """
    flight, random = pair_flight(40, 14, seed=5), np.random.default_rng(8)
    for k, measured in enumerate(flight.sets):
        wild = spread(random.random((5, 40)) < 0.02) & (k > 4)
        missing = spread(random.random((5, 40)) < 0.3)
        shifted = measured.values + np.where(wild, 30.0 * measured.sigma, 0.0)
        flight.sets[k] = without(replace(measured, values=shifted), missing)
        # what was sent wild is marked by its rows, for the count below
        flight.truth[k] = np.concatenate([flight.truth[k], wild[FIRST_ROWS]])
    run = run_filter(GATED[0], Pair(), flight)
    good = refused = caught = wild_count = 0
    for k, brought in enumerate(run.brought):
        there, used = flight.sets[k].present[FIRST_ROWS], brought.used[FIRST_ROWS]
        marked = flight.truth[k][12:] > 0.5
        good += int((there & ~marked).sum())
        refused += int((there & ~marked & ~used).sum())
        wild_count += int((there & marked).sum())
        caught += int((there & marked & ~used).sum())
    assert wild_count >= 15
    assert good > 1500
    assert refused == 0
    assert caught == wild_count
    low, high = chi_square_band(12, 40, 0.99999)
    assert low < nees(run.after[-1], flight.truth[-1][:12]).mean() < high


def spread(blocks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what holds for blocks (5, N) for their rows (13, N)."""
    rows = [len(block) for block in Pair.blocks]
    assert rows == [len(ANGLES), 3, 2, 3, 3]
    return np.repeat(blocks, rows, axis=0)


def test_intersection_covers_every_joint_covariance() -> None:
    """With x = W₁x₁ + W₂x₂ the true covariance is W J Wᵀ, J any joint one with these diagonals.

    P_ci − W J Wᵀ must be positive semidefinite for all of them [Julier, Uhlmann (1997), eq. 5].
    """
    random = np.random.default_rng(4)
    cases, n = 2000, 3
    mixed = random.normal(size=(cases, 2 * n, 4 * n))
    # from nearly one common error to independent ones
    mixed *= np.concatenate([np.full(n, 30.0), np.ones(3 * n)]) ** random.random((cases, 1, 1))
    joint = mixed @ np.swapaxes(mixed, 1, 2)
    t = np.zeros(cases)
    zero = np.zeros((n, cases))
    first = Belief.of(zero, joint[:, :n, :n], t)
    second = Belief.of(zero, joint[:, n:, n:], t)
    found, weight = covariance_intersection(first, second)
    one = weight[:, None, None] * found.covariance @ np.linalg.inv(first.covariance)
    other = (1.0 - weight)[:, None, None] * found.covariance @ np.linalg.inv(second.covariance)
    gains = np.concatenate([one, other], axis=2)
    true = gains @ joint @ np.swapaxes(gains, 1, 2)
    size = found.sigma.T[:, :, None] * found.sigma.T[:, None]
    assert np.linalg.eigvalsh((found.covariance - true) / size).min() > -1e-9
    # the sum of informations, right for independent errors only, does not cover them
    naive = np.linalg.inv(np.linalg.inv(first.covariance) + np.linalg.inv(second.covariance))
    gains = np.concatenate(
        [naive @ np.linalg.inv(first.covariance), naive @ np.linalg.inv(second.covariance)], axis=2
    )
    true = gains @ joint @ np.swapaxes(gains, 1, 2)
    assert np.mean(np.linalg.eigvalsh((naive - true) / size)[:, 0] < -1e-3) > 0.5
