"""States that are known exactly, by themselves or given others, beside the problem without them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Linear, Pair, nothing

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Estimator
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import chi_square_band, nees, nees_dof
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.sigma_points import SigmaRule
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

ROOTS: list[Estimator] = [
    *(BatchedUnscented(BatchedUnscentedSpec(update=u)) for u in ("plain", "iterated", "tempered")),
    example("estimator", "iterated_extended"),
]
RATE = 0.25
FREE = Linear(np.array([[1.0]]), np.zeros((1, 1)), np.array([[1.0]]))
WHOLE = Linear(np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 1)), np.array([[1.0, 0.0]]))
"""A place that moves at a speed; FREE is its place less the motion by a known speed."""


def known(cases: int = 1) -> Belief:
    x = np.repeat([[1.0], [RATE]], cases, axis=1)
    return Belief.of(x, np.repeat(np.diag([4.0, 0.0])[None], cases, axis=0), np.zeros(cases))


def measure(k: int, z: float, *, alone: bool = False) -> MeasurementSet:
    shift = RATE * k if alone else 0.0
    return MeasurementSet.of(
        np.full(1, float(k)), np.array([[z - shift]]), np.array([[0.5]]), WHOLE.blocks
    )


@pytest.mark.parametrize("estimator", ROOTS)
def test_filters_and_smoothers_are_those_of_the_other_states(estimator: Estimator) -> None:
    belief, own = known(), Belief.of(np.ones((1, 1)), np.full((1, 1, 1), 4.0), np.zeros(1))
    random = np.random.default_rng(2)
    after: tuple[list[Belief], list[Belief]] = ([], [])
    for k in range(4):
        z = float(random.normal())
        if k:
            belief = estimator.predict(WHOLE, belief, np.full(1, float(k)), nothing(1))
            own = estimator.predict(FREE, own, np.full(1, float(k)), nothing(1))
        belief, one = estimator.update(WHOLE, belief, measure(k, z))
        own, other = estimator.update(FREE, own, measure(k, z, alone=True))
        np.testing.assert_allclose(belief.x[0] - RATE * k, own.x[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(belief.sigma[0], own.sigma[0], rtol=1e-12)
        np.testing.assert_array_equal(belief.x[1], RATE)
        np.testing.assert_array_equal(belief.sigma[1], 0.0)
        np.testing.assert_allclose(one.nis, other.nis, rtol=1e-9)
        after[0].append(belief)
        after[1].append(own)
    for rule in (None, SigmaRule()):
        whole, free = (
            smooth(a, [link(m, a[k], a[k + 1].t_s, nothing(1), rule) for k in range(3)])
            for m, a in zip((WHOLE, FREE), after, strict=True)
        )
        for k in range(4):
            np.testing.assert_allclose(whole[k].x[0] - RATE * k, free[k].x[0], rtol=0, atol=1e-12)
            np.testing.assert_allclose(whole[k].sigma[0], free[k].sigma[0], rtol=1e-9)
            np.testing.assert_allclose(whole[k].sigma[1], 0.0, rtol=0, atol=1e-15)


@pytest.mark.parametrize("estimator", ROOTS)
def test_motion_may_leave_a_combination_known(estimator: Estimator) -> None:
    """A place known exactly and a speed that is not: later both are functions of one number."""
    start = Belief.of(np.array([[1.0], [0.0]]), np.diag([0.0, 4.0])[None], np.zeros(1))
    later = estimator.predict(WHOLE, start, np.ones(1), nothing(1))
    np.testing.assert_allclose(later.covariance[0], np.full((2, 2), 4.0), rtol=1e-12)
    after, _ = estimator.update(WHOLE, later, measure(1, 3.0))
    # the speed v is measured with 0.5: of x = 1 + v, 2 seen; P = 1/(1/4 + 4)
    np.testing.assert_allclose(after.x[:, 0], np.array([1.0, 0.0]) + 2.0 * 4.0 / 4.25, rtol=1e-9)
    np.testing.assert_allclose(after.covariance[0], np.full((2, 2), 1.0 / 4.25), rtol=1e-9)
    np.testing.assert_allclose(nees(later, np.array([[3.0], [2.0]])), 1.0, rtol=1e-9)
    assert nees_dof(later)[0] == 1
    assert nees(later, np.array([[3.0], [2.1]]))[0] == np.inf
    tie = link(WHOLE, start, np.ones(1), nothing(1))
    back = smooth([start, after], [tie])[0]
    np.testing.assert_allclose(back.x[:, 0], [1.0, 2.0 * 4.0 / 4.25], rtol=1e-9)
    np.testing.assert_allclose(back.covariance[0], np.diag([0.0, 1.0 / 4.25]), rtol=0, atol=1e-12)


def test_nees_counts_what_has_variance() -> None:
    random, cases = np.random.default_rng(6), 4000
    A = np.zeros((4, 4))
    A[np.ix_([0, 2, 3], [0, 2, 3])] = random.normal(size=(3, 3))
    P = np.repeat((A @ A.T)[None], cases, axis=0)
    belief = Belief.of(A @ random.normal(size=(4, cases)) + 7.0, P, np.zeros(cases))
    truth = np.full((4, cases), 7.0)
    np.testing.assert_array_equal(nees_dof(belief), 3)
    np.testing.assert_array_equal(nees_dof(belief, [0, 1]), 1)
    for states, dof in ((None, 3), ([0, 1, 2], 2)):
        low, high = chi_square_band(dof, cases, 0.9999)
        assert low < nees(belief, truth, states).mean() < high
    # an error of what is known exactly is infinite, in its case only; rounding is none
    wrong = truth.copy()
    wrong[1, 5] += 1e-6
    wrong[1, 6] += 1e-15
    found = nees(belief, wrong)
    assert np.isinf(found[5])
    np.testing.assert_array_equal(np.isinf(found).sum(), 1)
    np.testing.assert_allclose(found[6], nees(belief, truth)[6], rtol=1e-9)


def test_fits_and_bounds_are_those_of_the_other_states() -> None:
    own = Belief.of(np.ones((1, 1)), np.full((1, 1, 1), 4.0), np.zeros(1))
    z = [1.3, 0.8, 2.1]
    whole, free = (
        batch_least_squares(m, prior, [measure(k + 1, z[k], alone=alone) for k in range(3)])
        for m, prior, alone in ((WHOLE, known(), False), (FREE, own, True))
    )
    np.testing.assert_allclose(whole.belief.x[0], free.belief.x[0], rtol=1e-12)
    np.testing.assert_allclose(whole.belief.sigma[0], free.belief.sigma[0], rtol=1e-12)
    np.testing.assert_array_equal(whole.belief.sigma[1], 0.0)
    np.testing.assert_allclose(whole.squares, free.squares, rtol=1e-9)
    assert whole.settled.all()
    sets = [measure(k, z[k]) for k in range(3)]
    truth = [np.array([[1.0 + RATE * k], [RATE]]) for k in range(3)]
    bounds = cramer_rao(WHOLE, truth, known().covariance, sets)
    alone = cramer_rao(FREE, [x[:1] for x in truth], own.covariance, sets)
    for bound, one in zip(bounds, alone, strict=True):
        np.testing.assert_allclose(bound.sigma, [one.sigma[0], [0.0]], rtol=1e-12)


@pytest.mark.parametrize("type_", ["information", "ukf"])
def test_forms_with_an_inverse_refuse_by_name(type_: str) -> None:
    with pytest.raises(InputError, match=r"singular: state 1 of case 0 is known exactly"):
        example("estimator", type_).predict(WHOLE, known(), np.ones(1), nothing(1))
    with pytest.raises(InputError, match=r"singular: state 1 of case 0 is known exactly"):
        example("estimator", type_).update(WHOLE, known(), measure(0, 1.0))
    with pytest.raises(InputError, match=r"singular: state 1 of case 0 is known exactly"):
        covariance_intersection(known(), known())


def test_other_cases_keep_their_bits() -> None:
    """A case with an exact state among cases without changes none of them."""
    prior = np.repeat(np.diag([10.0, 10.0, 10.0, 1e-4, 1e-4, 1e-4] * 2)[None] ** 2, 3, axis=0)
    x = np.repeat(Pair.start[:, None], 3, axis=1) + 0.3
    z = Pair().observe(x - 0.3, np.zeros(3), np.arange(3))
    measured = MeasurementSet.of(np.zeros(3), z, Pair.sigma[:, None], Pair.blocks)
    exact = prior.copy()
    exact[1, 4, 4] = 0.0

    def update(estimator: Estimator, P: Array) -> Belief:
        return estimator.update(Pair(), Belief.of(x, P, np.zeros(3)), measured)[0]

    for estimator in ROOTS:
        one, other = update(estimator, prior), update(estimator, exact)
        for case in (0, 2):
            np.testing.assert_array_equal(one.x[:, case], other.x[:, case])
            np.testing.assert_array_equal(one.root[case], other.root[case])
        assert other.x[4, 1] == x[4, 1]


def test_variance_of_zero_beside_a_covariance_is_refused() -> None:
    with pytest.raises(InputError, match="state 1 has no variance, but a covariance of"):
        Belief.of(np.zeros((2, 1)), np.array([[[1.0, 0.5], [0.5, 0.0]]]), np.zeros(1))
