"""Considered states in every estimator, beside dense textbook forms and by Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Flight,
    Linear,
    Pair,
    fly,
    nothing,
    pair_flight,
    run_filter,
)

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Estimator
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.sigma_points import SigmaRule
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

FREE = np.array([1.0, 1.0, 0.0])
SIGMA = np.array([0.5, 0.8])
SPREAD = np.array([2.0, 1.0, 1.5])
STEPS, CASES = 6, 3


class Nuisance(Linear):
    """Two states and a considered one, which wanders (a Gauss–Markov process) and enters both."""

    considered = FREE == 0.0

    def __init__(self, wander: float = 0.4, push: float = 0.3) -> None:
        decay = np.sqrt(1.0 - wander**2 / SPREAD[2] ** 2)
        F = np.array([[1.0, 0.5, 0.2], [-0.2, 0.9, 0.0], [0.0, 0.0, decay]])
        G = np.array([[0.1 * push, 0.0], [push, 0.0], [0.0, wander]])
        super().__init__(F, G, np.array([[1.0, 0.3, 0.7], [0.0, 1.0, -0.4]]))


def schmidt(P: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return Schmidt's gain and the covariance after, in dense form (Jazwinski 1970, chapter 8)."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    K[FREE == 0.0] = 0.0
    left = np.eye(len(P)) - K @ H
    return K, left @ P @ left.T + K @ R @ K.T


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended", "information"])
def test_filters_are_schmidts_over_many_steps(type_: str) -> None:
    model = Nuisance()
    flight = fly(model, np.zeros((3, CASES)), SPREAD, SIGMA, np.arange(float(STEPS)), 5)
    run = run_filter(example("estimator", type_), model, flight)
    x, P, R = flight.prior.x, flight.prior.covariance[0], np.diag(SIGMA**2)
    for k in range(STEPS):
        if k:
            x, P = model.F @ x, model.F @ P @ model.F.T + model.G @ model.G.T
        K, P = schmidt(P, model.H, R)
        x = x + K @ (flight.sets[k].values - model.H @ x)
        np.testing.assert_allclose(run.after[k].x, x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.after[k].covariance[0], P, rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.after[k].sigma[2], SPREAD[2], rtol=1e-9)


def test_fit_is_schmidts_of_all_measurements_at_once() -> None:
    model = Nuisance(wander=0.0, push=0.0)
    flight = fly(model, np.zeros((3, CASES)), SPREAD, SIGMA, np.arange(1.0, STEPS + 1.0), 5)
    prior = Belief(flight.prior.x, flight.prior.root, np.zeros(CASES))
    H = np.concatenate([model.H @ np.linalg.matrix_power(model.F, k + 1) for k in range(STEPS)])
    z = np.concatenate([one.values for one in flight.sets])
    R = np.diag(np.tile(SIGMA**2, STEPS))
    K, P = schmidt(prior.covariance[0], H, R)
    fit = batch_least_squares(model, prior, flight.sets)
    np.testing.assert_allclose(fit.belief.x, prior.x + K @ (z - H @ prior.x), rtol=0, atol=1e-8)
    np.testing.assert_allclose(fit.belief.covariance[0], P, rtol=0, atol=1e-9)
    assert fit.settled.all()
    # formal covariance of the same gain, and its sensitivity to the considered state
    left, own = (np.eye(3) - K @ H)[:2, :2], K[:2]
    formal = left @ np.diag(SPREAD[:2] ** 2) @ left.T + own @ R @ own.T
    sensitivity = own @ H[:, 2:]
    total = formal + SPREAD[2] ** 2 * sensitivity @ sensitivity.T
    np.testing.assert_allclose(fit.belief.covariance[0][:2, :2], total, rtol=0, atol=1e-9)


@pytest.mark.parametrize("rule", [None, SigmaRule()])
@pytest.mark.parametrize("wander", [0.0, 0.4])
def test_smoothed_covariance_is_that_of_the_errors(rule: SigmaRule | None, wander: float) -> None:
    """All errors as linear functions of those of prior, motion and measurements."""
    model, R = Nuisance(wander), np.diag(SIGMA**2)
    flight = fly(model, np.zeros((3, CASES)), SPREAD, SIGMA, np.arange(float(STEPS)), 5)
    estimator = example("estimator", "iterated_extended")
    run = run_filter(estimator, model, flight)
    ties = [
        link(model, run.after[k], flight.sets[k + 1].t_s, nothing(CASES), rule)
        for k in range(STEPS - 1)
    ]
    found = smooth(run.after, ties)
    # columns: prior, then motion and measurement of each step
    many, P = 3 + 4 * STEPS, np.diag(SPREAD**2)
    cause = np.diag([*SPREAD**2, *(np.tile([1.0, 1.0, *SIGMA**2], STEPS))])
    error = np.eye(3, many)
    before, after, gains = [], [], []
    for k in range(STEPS):
        if k:
            ahead = model.F @ P @ model.F.T + model.G @ model.G.T
            gains.append(P @ model.F.T @ np.linalg.inv(ahead))
            P = ahead
            error = model.F @ error - model.G @ np.eye(many)[3 + 4 * k : 5 + 4 * k]
        before.append(error)
        K, P = schmidt(P, model.H, R)
        error = error - K @ (model.H @ error) + K @ np.eye(many)[5 + 4 * k : 7 + 4 * k]
        after.append(error)
    late, mean = after[-1], run.after[-1].x
    for k in range(STEPS - 1, -1, -1):
        if k < STEPS - 1:
            late = after[k] + gains[k] @ (late - before[k + 1])
            mean = run.after[k].x + gains[k] @ (mean - model.F @ run.after[k].x)
        held = np.where(FREE[:, None] > 0.0, late, after[k])
        np.testing.assert_allclose(found[k].covariance[0], held @ cause @ held.T, rtol=0, atol=1e-7)
        expected = np.where(FREE[:, None] > 0.0, mean, run.after[k].x)
        np.testing.assert_allclose(found[k].x, expected, rtol=0, atol=1e-8)
    assert (found[0].sigma[:2] < run.after[0].sigma[:2]).all()


@pytest.mark.parametrize("wander", [0.0, 0.4])
def test_errors_are_as_large_as_stated(wander: float) -> None:
    """Over 3000 cases the mean NEES of filter, smoother and fit is in its band."""
    cases = 3000
    model = Nuisance(wander, push=0.3 if wander else 0.0)
    flight = fly(model, np.zeros((3, cases)), SPREAD, SIGMA, np.arange(4.0), 7)
    run = run_filter(example("estimator", "information"), model, flight)
    ties = [link(model, run.after[k], flight.sets[k + 1].t_s, nothing(cases)) for k in range(3)]
    checks = list(zip([*run.after, *smooth(run.after, ties)], 2 * flight.truth, strict=True))
    if not wander:
        later = fly(model, np.zeros((3, cases)), SPREAD, SIGMA, np.arange(1.0, 5.0), 8)
        # the fit's prior is one step before the flight, which begins at `later.truth`
        back = np.linalg.inv(model.F)
        start = Belief(back @ later.prior.x, back @ later.prior.root, np.zeros(cases))
        prior = Belief.of(start.x, start.covariance, start.t_s)
        checks.append((batch_least_squares(model, prior, later.sets).belief, back @ later.truth[0]))
    for belief, truth in checks:
        for states in (None, [0, 1]):
            low, high = chi_square_band(3 if states is None else 2, cases, 0.9999)
            assert low < nees(belief, truth, states).mean() < high


@pytest.mark.parametrize(
    "estimator",
    [
        *(BatchedUnscented(BatchedUnscentedSpec(update=u)) for u in ("iterated", "tempered")),
        example("estimator", "iterated_extended"),
        example("estimator", "information"),
    ],
    ids=["iterated", "tempered", "iterated_extended", "information"],
)
def test_wide_priors_are_consistent_with_considered_biases(estimator: Estimator) -> None:
    """Iterated without damping the extended filter has a mean NEES of 1e9 here."""
    cases = 200
    offset = 40.0 * np.random.default_rng(7).normal(size=(2, cases))
    flight, rows = pair_flight(cases, 1), np.zeros((13, 2))
    rows[2, 0] = rows[7, 1] = 1.0
    sets = [replace(m, values=m.values + rows @ offset) for m in flight.sets]
    biases = BiasStates(
        np.full(2, 40.0), np.full(2, np.inf), rows, np.zeros((0, 2)), np.ones(2, bool)
    )
    model = BiasAugmentedModel(Pair(), 12, biases)
    run = run_filter(
        estimator, model, Flight(flight.truth, sets, model.append_biases(flight.prior))
    )
    for belief, truth in zip(run.after, flight.truth, strict=True):
        np.testing.assert_array_equal(belief.x[12:], 0.0)
        for states in (14, 12):
            low, high = chi_square_band(states, cases, 0.9999)
            errors = nees(belief, np.concatenate([truth, offset]), range(states))
            assert low < errors.mean() < high


def test_bound_says_what_is_nuisance() -> None:
    model = Nuisance()
    flight = fly(model, np.zeros((3, CASES)), SPREAD, SIGMA, np.arange(float(STEPS)), 5)
    bounds = cramer_rao(model, flight.truth, flight.prior.covariance, flight.sets)
    np.testing.assert_array_equal(bounds.nuisance, [False, False, True])
    run = run_filter(example("estimator", "iterated_extended"), model, flight)
    free = Linear(model.F, model.G, model.H)
    best = cramer_rao(free, flight.truth, flight.prior.covariance, flight.sets)
    assert not best.nuisance.any()
    assert best.considered == best.beliefs
    for bound, held, one, after in zip(bounds, bounds.considered, best, run.after, strict=True):
        np.testing.assert_array_equal(bound.root, one.root)
        np.testing.assert_allclose(held.covariance, after.covariance, rtol=0, atol=1e-12)
    assert (bounds.considered[-1].sigma > 1.005 * bounds[-1].sigma).all()


@pytest.mark.parametrize("type_", ["ukf", "ekf"])
def test_filterpy_refuses_by_name(type_: str) -> None:
    model = Nuisance()
    prior = Belief.of(np.zeros((3, 1)), np.eye(3)[None], np.zeros(1))
    measured = MeasurementSet.of(np.zeros(1), np.zeros((2, 1)), SIGMA[:, None], model.blocks)
    with pytest.raises(InputError, match="considered"):
        example("estimator", type_).update(model, prior, measured)
