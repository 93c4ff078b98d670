"""The iterated extended filter beside the information filter, and where damping is needed."""

from __future__ import annotations

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Linear,
    Pair,
    apart,
    nothing,
    pair_flight,
    run_filter,
    without,
)

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Integers
from hillsphere.testing import example
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.information import Information
from hillsphere_estimators.iterated_extended import IteratedExtended
from hillsphere_estimators.specs import InformationSpec, IteratedExtendedSpec


def test_iterated_extended_equals_information_filter() -> None:
    flight = pair_flight(8, 12)
    flight.sets[4] = without(flight.sets[4], np.arange(13)[:, None] < np.arange(8))
    extended = run_filter(IteratedExtended(IteratedExtendedSpec()), Pair(), flight)
    information = run_filter(Information(InformationSpec()), Pair(), flight)
    for one, other in zip(extended.after, information.after, strict=True):
        assert apart(one, other) < 1e-6
    for a, b in zip(extended.brought, information.brought, strict=True):
        np.testing.assert_allclose(a.nis, b.nis, rtol=1e-6)
        np.testing.assert_array_equal(a.dof, b.dof)


def test_iterated_extended_is_consistent_from_a_wide_prior() -> None:
    flight = pair_flight(100, 8)
    run = run_filter(IteratedExtended(IteratedExtendedSpec()), Pair(), flight)
    low, high = chi_square_band(12, 100, 0.99999)
    found = [nees(b, x).mean() for b, x in zip(run.after, flight.truth, strict=True)]
    assert low < min(found)
    assert max(found) < high
    once = run_filter(IteratedExtended(IteratedExtendedSpec(iterations=1)), Pair(), flight)
    assert nees(once.after[0], flight.truth[0]).mean() > 1e3


class Flat(Linear):
    """z = arctan x, whose undamped steps from |x| > 1.39 run away from the answer 0."""

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.arctan(x)

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        return (1.0 / (1.0 + x**2)).T[:, :, None]


@pytest.mark.parametrize("type_", ["iterated_extended", "information"])
def test_steps_that_would_run_away_are_halved(type_: str) -> None:
    model = Flat(np.eye(1), np.zeros((1, 1)), np.eye(1))
    starts = np.array([[1.0, 3.0, 10.0]])
    prior = Belief.of(starts, np.full((3, 1, 1), 100.0), np.zeros(3))
    measured = MeasurementSet.of(np.zeros(3), np.zeros((1, 3)), np.full((1, 3), 1e-3), model.blocks)
    after, _ = example("estimator", type_).update(model, prior, measured)
    # the prior pulls by its share of the information, 1e-8
    np.testing.assert_allclose(after.x[0], 1e-8 * starts[0], rtol=1e-3)
    np.testing.assert_allclose(after.sigma[0], 1e-3, rtol=1e-6)


def test_refuses_what_is_known_exactly() -> None:
    model = Flat(np.eye(1), np.zeros((1, 1)), np.eye(1))
    exact = Belief(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.zeros(1))
    with pytest.raises(InputError, match="covariance of a belief is singular"):
        Information(InformationSpec()).predict(model, exact, np.ones(1), nothing(1))
