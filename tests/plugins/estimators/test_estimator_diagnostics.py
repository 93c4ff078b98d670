"""NEES and its bands, the posterior Cramér–Rao bound, the observability Gramian."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Linear, Pair, fly, pair_flight, run_filter

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.testing import example
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.cramer_rao import cramer_rao, rms
from hillsphere_estimators.observability import observability


def test_nees_of_draws_is_chi_square() -> None:
    random = np.random.default_rng(1)
    A = random.normal(size=(3, 3))
    P = np.repeat((A @ A.T)[None], 20_000, axis=0)
    belief = Belief.of(A @ random.normal(size=(3, 20_000)), P, np.zeros(20_000))
    for states, dof in ((None, 3), ([0, 2], 2), ([1], 1)):
        found = nees(belief, np.zeros((3, 20_000)), states)
        low, high = chi_square_band(dof, 20_000, 0.9999)
        assert low < found.mean() < high
        # 95 % of χ² lie below their quantile: two standard deviations of the share are 0.003
        limit = chi_square_band(dof, 1, 0.9)[1]
        assert abs(np.mean(found < limit) - 0.95) < 0.005


def test_band_of_the_mean_over_seeds() -> None:
    # Wilson–Hilferty, good to some 1e-3 here: χ²/k = (1 − 2/(9k) + z √(2/(9k)))³
    k, z = 12 * 40, np.array([-3.290527, 3.290527])
    expected = 12.0 * (1.0 - 2.0 / (9.0 * k) + z * np.sqrt(2.0 / (9.0 * k))) ** 3
    np.testing.assert_allclose(chi_square_band(12, 40, 0.999), expected, rtol=1e-4)
    assert chi_square_band([1, 12], 40, 0.9).shape == (2, 2)
    with pytest.raises(InputError, match="between 0 and 1"):
        chi_square_band(12, 40, 1.0)


def test_bound_of_a_linear_problem_is_its_kalman_covariance() -> None:
    random = np.random.default_rng(2)
    F = np.eye(3) + 0.3 * random.normal(size=(3, 3))
    model = Linear(F, 0.2 * random.normal(size=(3, 1)), random.normal(size=(2, 3)))
    flight = fly(model, random.normal(size=(3, 4)), np.full(3, 2.0), np.array([0.3, 0.7]),
                   np.arange(10.0), 3)  # fmt: skip
    run = run_filter(example("estimator", "unscented"), model, flight)
    for pooled in (False, True):
        bounds = cramer_rao(model, flight.truth, flight.prior.covariance, flight.sets,
                            pooled=pooled)  # fmt: skip
        for bound, after in zip(bounds, run.after, strict=True):
            np.testing.assert_allclose(bound.covariance, after.covariance, rtol=1e-9, atol=1e-12)
    with pytest.raises(InputError, match="one set of measurements for each of the 9 times"):
        cramer_rao(model, flight.truth[:9], flight.prior.covariance, flight.sets)


def test_filter_reaches_the_bound() -> None:
    flight = pair_flight(100, 10)
    run = run_filter(example("estimator", "unscented", 2), Pair(), flight)
    bounds = cramer_rao(Pair(), flight.truth, flight.prior.covariance, flight.sets, pooled=True)
    for first in (0, 6):
        own = slice(first, first + 3)
        for k in (3, 6, 9):
            off = np.sum((run.after[k].x - flight.truth[k])[own] ** 2, axis=0)
            # of 100 runs the rms is known to some 5 %
            assert 0.85 < np.sqrt(off.mean()) / rms(bounds[k], own) < 1.2


def test_observability_of_a_rocking_mass() -> None:
    """A free mass whose place is seen twice: Σ Φᵀ Hᵀ H Φ / σ² = [[2, 1], [1, 1]] / 0.25."""
    model = Linear(np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 1)), np.array([[1.0, 0.0]]))
    start = Belief.of(np.zeros((2, 1)), np.eye(2)[None], np.zeros(1))

    def seen(count: int) -> list[MeasurementSet]:
        return [
            MeasurementSet.of(np.full(1, 1.0 + k), np.zeros((1, 1)), np.full((1, 1), 0.5),
                              model.blocks)
            for k in range(count)
        ]  # fmt: skip

    found = observability(model, start, seen(2), np.array([10.0, 0.1]))
    gramian = np.array([[2.0, 3.0], [3.0, 5.0]]) / 0.25
    scaled = gramian * np.outer([10.0, 0.1], [10.0, 0.1])
    np.testing.assert_allclose(np.swapaxes(found.root, 1, 2) @ found.root, scaled[None], rtol=1e-12)
    np.testing.assert_allclose(found.singular[0] ** 2, np.linalg.eigvalsh(scaled)[::-1], rtol=1e-9)
    assert found.rank() == 2
    once = observability(model, start, seen(1), np.ones(2))
    assert once.rank() == 1
    np.testing.assert_allclose(
        np.abs(once.directions[0, 1]), np.array([1.0, 1.0]) / np.sqrt(2.0), rtol=1e-12
    )


def test_pair_is_told_worst_where_the_filter_is() -> None:
    flight = pair_flight(2, 4)
    start = Belief(flight.truth[0], flight.prior.root, flight.prior.t_s)
    scales = np.tile([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4], 2)
    found = observability(Pair(), start, flight.sets, scales)
    np.testing.assert_array_equal(found.rank(), 12)
    bounds = 1.0 / found.singular[:, -1]
    # without a prior: the worst direction is known worse than any state of the bound
    quiet = cramer_rao(Pair(), flight.truth, flight.prior.covariance, flight.sets)
    assert (bounds > quiet[-1].sigma[:3].max(axis=0)).all()
