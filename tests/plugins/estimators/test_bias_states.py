"""Biases that are estimated or considered: what they restore."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Flight,
    Pair,
    nothing,
    pair_flight,
    run_filter,
)

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Integers
from hillsphere.testing import example
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

ITERATED = BatchedUnscented(BatchedUnscentedSpec(update="iterated"))


def of_ranges(considered: bool, time_s: float = np.inf) -> BiasStates:
    """Return biases of both lidars' ranges."""
    shown = np.zeros((13, 2))
    shown[2, 0] = shown[7, 1] = 1.0
    return BiasStates(
        np.full(2, 40.0), np.full(2, time_s), shown, np.zeros((0, 2)), np.full(2, considered)
    )


def make_biased_flight(cases: int, steps: int, offset: Array) -> Flight:
    flight = pair_flight(cases, steps)
    rows = np.zeros((13, cases))
    rows[[2, 7]] = offset
    sets = [
        MeasurementSet(m.t_s, m.values + rows, m.sigma, m.blocks, m.present) for m in flight.sets
    ]
    return Flight(flight.truth, sets, flight.prior)


@pytest.mark.parametrize("considered", [False, True])
def test_range_biases_are_told_or_reckoned_with(considered: bool) -> None:
    offset = 40.0 * np.random.default_rng(7).normal(size=(2, 80))
    flight = make_biased_flight(80, 8, offset)
    blind = run_filter(ITERATED, Pair(), flight)
    assert nees(blind.after[-1], flight.truth[-1]).mean() > 40.0
    model = BiasAugmentedModel(Pair(), 12, of_ranges(considered))
    told = Flight(flight.truth, flight.sets, model.append_biases(flight.prior))
    run = run_filter(ITERATED, model, told)
    last, truth = run.after[-1], np.concatenate([flight.truth[-1], offset])
    low, high = chi_square_band(14, 80, 0.9999)
    assert low < nees(last, truth).mean() < high
    states = chi_square_band(12, 80, 0.9999)
    assert states[0] < nees(last, truth, range(12)).mean() < states[1]
    if considered:
        np.testing.assert_array_equal(last.x[12:], 0.0)
        np.testing.assert_allclose(last.sigma[12:], 40.0, rtol=1e-9)
    else:
        assert (last.sigma[12:] < 15.0).all()


def test_wandering_bias_keeps_its_standard_deviation() -> None:
    model = BiasAugmentedModel(Pair(), 12, of_ranges(False, 5000.0))
    belief = model.append_biases(pair_flight(2, 1).prior)
    estimator = example("estimator", "unscented")
    for _ in range(5):
        belief = estimator.predict(model, belief, belief.t_s + 1800.0, nothing(2))
        np.testing.assert_allclose(belief.sigma[12:], 40.0, rtol=1e-9)
    narrow = Belief(belief.x, 1e-3 * belief.root, belief.t_s)
    later = estimator.predict(model, narrow, narrow.t_s + 1800.0, nothing(2))
    np.testing.assert_allclose(
        later.sigma[12:] ** 2,
        1600.0 * (1.0 - (1.0 - 1e-6) * np.exp(-3600.0 / 5000.0)), rtol=1e-9,
    )  # fmt: skip


class Pushed:
    """A mass on a line that a control pushes; its place is measured."""

    blocks = ((Pair.blocks[1][0],),)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        dt = t1_s - t0_s
        return np.array([x[0] + dt * x[1] + 0.5 * dt**2 * control[0], x[1] + dt * control[0]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 2, 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.ascontiguousarray(x[:1])


def test_push_that_nobody_commands_is_found() -> None:
    biases = BiasStates(np.array([0.1]), np.array([np.inf]), np.zeros((1, 1)), np.ones((1, 1)),
                        np.zeros(1, dtype=bool))  # fmt: skip
    model, estimator = BiasAugmentedModel(Pushed(), 2, biases), example("estimator", "unscented")
    belief = model.append_biases(
        Belief.of(np.zeros((2, 1)), np.diag([1.0, 0.01])[None], np.zeros(1))
    )
    for k in range(1, 20):
        t_s = np.full(1, float(k))
        belief = estimator.predict(model, belief, t_s, np.full((1, 1), 0.2))
        place = np.array([[0.5 * 0.25 * k**2]])
        measured = MeasurementSet.of(t_s, place, np.full((1, 1), 0.01), Pushed.blocks)
        belief, _ = estimator.update(model, belief, measured)
    assert belief.x[2, 0] == pytest.approx(0.05, abs=1e-3)
    assert belief.sigma[2, 0] < 1e-3


def test_refuses_shapes_that_do_not_fit() -> None:
    with pytest.raises(InputError, match="2 biases need"):
        BiasStates(np.ones(2), np.ones(2), np.ones((3, 1)), np.ones((0, 2)), np.zeros(2, bool))
    with pytest.raises(InputError, match="must be positive"):
        BiasStates(np.zeros(1), np.ones(1), np.ones((3, 1)), np.ones((0, 1)), np.zeros(1, bool))


def test_nested_biases_are_considered_together() -> None:
    inner = BiasAugmentedModel(Pair(), 12, of_ranges(True))
    outer = BiasAugmentedModel(inner, 14, of_ranges(False))
    np.testing.assert_array_equal(outer.considered, [False] * 12 + [True] * 2 + [False] * 2)
