"""Batch least squares beside the filter without process noise, and beside chi-square."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Linear,
    Pair,
    apart,
    fly,
    nothing,
    pair_flight,
    run_filter,
)

from hillsphere.errors import InputError
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import chi_square_band, nees


class Quiet(Pair):
    push = 1e-18


def test_equals_the_filter_on_a_linear_problem() -> None:
    random = np.random.default_rng(6)
    F = np.array([[1.0, 0.5], [-0.2, 0.9]])
    model = Linear(F, np.zeros((2, 1)), np.array([[1.0, 0.3]]))
    flight = fly(model, random.normal(size=(2, 3)), np.array([2.0, 1.0]), np.array([0.5]),
                   np.arange(8.0), 5)  # fmt: skip
    # the first measurement is one step after the prior here
    prior = run_filter(example("estimator", "unscented"), model, flight)
    fit = batch_least_squares(Shifted(model), flight.prior, flight.sets)
    last = prior.after[-1]
    moved = np.linalg.matrix_power(F, 7)
    np.testing.assert_allclose(moved @ fit.belief.x, last.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        moved @ fit.belief.covariance @ moved.T, last.covariance, rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(fit.rows, 8)
    assert fit.settled.all()


class Shifted(Linear):
    """Motion only between times that differ: the first measurement is at the start."""

    def __init__(self, model: Linear) -> None:
        super().__init__(model.F, model.G, model.H)

    def advance(self, x, t0_s, t1_s, control, case):  # type: ignore[no-untyped-def]
        return np.where(t1_s > t0_s, self.F @ x, x)

    def transition(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
        return np.where((t1_s > t0_s)[:, None, None], self.F, np.eye(len(x)))


def test_fits_from_a_wide_prior_are_consistent() -> None:
    flight = pair_flight(60, 6)
    quiet = fly(Quiet(), np.repeat(Pair.start[:, None], 60, axis=1),
                  flight.prior.sigma[:, 0], Pair.sigma, 3600.0 * np.arange(6.0), 3)  # fmt: skip
    fit = batch_least_squares(Quiet(), quiet.prior, quiet.sets)
    assert fit.settled.all()
    assert fit.iterations.max() <= 12
    np.testing.assert_array_equal(fit.rows, 78)
    low, high = chi_square_band(12, 60, 0.9999)
    assert low < nees(fit.belief, quiet.truth[0]).mean() < high
    low, high = chi_square_band(78, 60, 0.9999)
    assert low < fit.squares.mean() < high


def test_refuses_controls_that_do_not_fit() -> None:
    flight = pair_flight(2, 3)
    with pytest.raises(InputError, match="before each of 3 times, got 1"):
        batch_least_squares(Pair(), flight.prior, flight.sets, [nothing(2)])


def test_equals_the_filter_at_the_end() -> None:
    spread = np.tile([1e-2, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6], 2)
    x = np.repeat(Pair.start[:, None], 4, axis=1)
    quiet = fly(Quiet(), x, spread, Pair.sigma, 600.0 * np.arange(5.0), 3)
    fit = batch_least_squares(Quiet(), quiet.prior, quiet.sets)
    run = run_filter(example("estimator", "iterated_extended"), Quiet(), quiet)
    belief = fit.belief
    for measured in quiet.sets[1:]:
        belief = example("estimator", "iterated_extended").predict(
            Quiet(), belief, measured.t_s, nothing(4)
        )
    assert apart(belief, run.after[-1]) < 1e-4
