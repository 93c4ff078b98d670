"""The smoother beside the joint distribution of all states, and beside the filter."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Flight,
    Linear,
    Pair,
    apart,
    fly,
    nothing,
    pair_flight,
)

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import EstimationModel, Estimator
from hillsphere.testing import example
from hillsphere_estimators.sigma_points import SigmaRule
from hillsphere_estimators.smoother import link, smooth


def both(
    estimator: Estimator, model: EstimationModel, flight: Flight, rule: SigmaRule | None
) -> tuple[list[Belief], list[Belief]]:
    """Return filtered and smoothed beliefs."""
    belief, after, links = flight.prior, [], []
    for k, measured in enumerate(flight.sets):
        if k:
            tie = link(model, belief, measured.t_s, nothing(len(measured.t_s)), rule)
            links.append(tie)
            belief = tie.predicted
        belief, _ = estimator.update(model, belief, measured)
        after.append(belief)
    return after, smooth(after, links)


@pytest.mark.parametrize("rule", [None, SigmaRule(), SigmaRule(alpha=0.3, kappa=1.0)])
def test_equals_the_joint_distribution_of_all_states(rule: SigmaRule | None) -> None:
    random = np.random.default_rng(4)
    F, G = np.array([[1.0, 0.5], [-0.2, 0.9]]), np.array([[0.1], [0.4]])
    H, sigma, K = np.array([[1.0, 0.3]]), np.array([0.5]), 6
    model = Linear(F, G, H)
    flight = fly(model, random.normal(size=(2, 2)), np.array([2.0, 1.0]), sigma,
                   np.arange(float(K)), 5)  # fmt: skip
    _, found = both(example("estimator", "unscented"), model, flight, rule)
    for case in range(2):
        # least squares on all states at once: prior, steps, measurements
        information, vector = np.zeros((2 * K, 2 * K)), np.zeros(2 * K)
        start = np.linalg.inv(flight.prior.covariance[case])
        information[:2, :2] += start
        vector[:2] += start @ flight.prior.x[:, case]
        step = np.hstack([-F, np.eye(2)])
        joint = np.linalg.inv(G @ G.T + 1e-9 * np.eye(2))
        for k in range(K):
            own = slice(2 * k, 2 * k + 2)
            information[own, own] += H.T @ H / sigma**2
            vector[own] += H[0] * flight.sets[k].values[0, case] / sigma[0] ** 2
            if k:
                two = slice(2 * k - 2, 2 * k + 2)
                information[two, two] += step.T @ joint @ step
        covariance = np.linalg.inv(information)
        mean = covariance @ vector
        for k in range(K):
            own = slice(2 * k, 2 * k + 2)
            np.testing.assert_allclose(found[k].x[:, case], mean[own], rtol=0, atol=1e-6)
            np.testing.assert_allclose(
                found[k].covariance[case], covariance[own, own], rtol=0, atol=1e-6
            )


@pytest.mark.parametrize("rule", [None, SigmaRule()])
def test_is_surer_than_the_filter_and_rightly_so(rule: SigmaRule | None) -> None:
    flight = pair_flight(40, 16)
    after, found = both(example("estimator", "unscented", 2), Pair(), flight, rule)
    better = []
    for one, other, truth in zip(after, found, flight.truth, strict=True):
        size = one.sigma.T[:, :, None] * one.sigma.T[:, None]
        gained = np.linalg.eigvalsh((one.covariance - other.covariance) / size)
        assert gained.min() > -1e-9
        rms = [np.sqrt(np.mean((b.x - truth)[[0, 1, 2, 6, 7, 8]] ** 2)) for b in (one, other)]
        better.append(rms[1] / rms[0])
    assert max(better) < 1.0 + 1e-12
    assert better[0] < 0.7


@pytest.mark.parametrize("rule", [None, SigmaRule()])
def test_link_predicts_as_the_filter_does(rule: SigmaRule | None) -> None:
    flight = pair_flight(3, 2)
    estimator = example("estimator", "unscented" if rule else "iterated_extended")
    later = flight.sets[1].t_s
    tie = link(Pair(), flight.prior, later, nothing(3), rule)
    assert apart(tie.predicted, estimator.predict(Pair(), flight.prior, later, nothing(3))) < 1e-12


def test_refuses_a_missing_link() -> None:
    flight = pair_flight(1, 2)
    with pytest.raises(InputError, match="needs 1 links, got 0"):
        smooth([flight.prior, flight.prior], [])
