"""The iterated unscented update where undamped it leaps to and fro, or its iterations run out."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Bearing, Pair, pair_flight, run_filter

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, Integers
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented


class Arc:
    """The arc tangent, flat far out: there Newton's steps are longer the farther off one is."""

    blocks = ((Channel("arc", "rad"),),)
    advance, process_noise = Bearing.advance, Bearing.process_noise

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.arctan(x)


class HeldArc(Arc):
    """And beside it a number that is only reckoned with."""

    considered = np.array([False, True])

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.arctan(x[:1]) + x[1:]


def measure(model: Arc, truth: Array, sigma: float) -> MeasurementSet:
    """Return exact measurements of truths (n, N)."""
    cases = truth.shape[1]
    shown = model.observe(truth, np.zeros(cases), np.arange(cases))
    return MeasurementSet.of(np.zeros(cases), shown, np.full((1, 1), sigma), model.blocks)


def iterating_filter(iterations: int) -> BatchedUnscented:
    return BatchedUnscented(BatchedUnscentedSpec(update="iterated", iterations=iterations))


@pytest.mark.parametrize(("mean", "wide"), [(2.0, 1.0), (4.0, 1.0), (4.0, 2.0)])
def test_long_steps_are_halved(mean: float, wide: float) -> None:
    """Undamped up to half of these lie hundreds of standard deviations off."""
    truth = np.linspace(-3.0, 3.0, 25)[None]
    prior = Belief.of(np.full((1, 25), mean), np.full((25, 1, 1), wide**2), np.zeros(25))
    after, _ = iterating_filter(100).update(Arc(), prior, measure(Arc(), truth, 1e-3))
    assert np.abs((after.x - truth) / after.sigma).max() < 3.0


def test_iterations_that_run_out_leave_the_tempered_update() -> None:
    truth = np.linspace(-3.0, 3.0, 25)[None]
    prior = Belief.of(np.full((1, 25), 2.0), np.full((25, 1, 1), 4.0), np.zeros(25))
    sets = measure(Arc(), truth, 1e-3)
    after, _ = iterating_filter(3).update(Arc(), prior, sets)
    tempered, _ = BatchedUnscented(BatchedUnscentedSpec(update="tempered")).update(
        Arc(), prior, sets
    )
    same = after.x[0] == tempered.x[0]
    assert 5 < same.sum() < 20
    assert (np.abs(after.x - truth)[0] / after.sigma[0]).max() < 3.0


def test_steps_are_halved_beside_a_considered_state() -> None:
    """Schmidt's gain does not reduce the sum of squares: all states are solved for, then held."""
    truth = np.concatenate([np.linspace(-3.0, 3.0, 25)[None], np.zeros((1, 25))])
    start = np.repeat([[4.0], [0.0]], 25, axis=1)
    prior = Belief.of(start, np.repeat(np.diag([4.0, 1e-8])[None], 25, axis=0), np.zeros(25))
    after, _ = iterating_filter(100).update(HeldArc(), prior, measure(HeldArc(), truth, 1e-3))
    assert (np.abs(after.x - truth)[0] / after.sigma[0]).max() < 3.0
    np.testing.assert_array_equal(after.x[1], 0.0)
    np.testing.assert_allclose(after.sigma[1], 1e-4, rtol=1e-9)


def test_few_iterations_from_a_wide_prior_are_consistent() -> None:
    """Undamped 49 of 256 such flights are lost for ever, in silence."""
    flight = pair_flight(64, 3, share=0.3)
    run = run_filter(iterating_filter(10), Pair(), flight)
    low, high = chi_square_band(12, 64, 0.99999)
    for belief, truth in zip(run.after, flight.truth, strict=True):
        errors = nees(belief, truth)
        assert errors.max() < 60.0
        assert low < errors.mean() < high


class CountedArc(Arc):
    """Counts the states of which it predicts the measurement."""

    def __init__(self) -> None:
        self.states = 0

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        self.states += x.shape[1]
        return np.arctan(x)


@pytest.mark.parametrize("update", ["iterated", "tempered"])
def test_a_case_that_takes_long_does_not_take_the_others_with_it(
    update: Literal["iterated", "tempered"],
) -> None:
    """A batch predicts as many measurements as its cases do one by one."""
    truth = np.array([[-3.0, 2.0, 2.1, 1.9, 2.0, 2.05, 1.95, 2.0]])
    wide = np.where(truth < 0.0, 1.0, 0.01)[0]
    spec = BatchedUnscentedSpec(update=update, iterations=100)
    alone, batch = CountedArc(), CountedArc()

    def update_cases(model: CountedArc, own: slice) -> Array:
        count = truth[:, own].shape[1]
        prior = Belief.of(
            np.full((1, count), 2.0), (wide[own] ** 2)[:, None, None], np.zeros(count)
        )
        sets = measure(Arc(), truth[:, own], 1e-3)
        return BatchedUnscented(spec).update(model, prior, sets)[0].x

    together = update_cases(batch, slice(None))
    single = [update_cases(alone, slice(k, k + 1)) for k in range(truth.size)]
    np.testing.assert_allclose(together, np.concatenate(single, axis=1), rtol=1e-12)
    assert batch.states == alone.states
