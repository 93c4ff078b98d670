"""Cases that are no numbers: alone they raise, among others they are marked and change nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    Linear,
    Pair,
    nothing,
    pair_flight,
)

from hillsphere.cases.case_classes import case_class
from hillsphere.errors import InputError, PropagationError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Estimator, Integers
from hillsphere.testing import example
from hillsphere_estimators.batch_gaussian_sum import batch_gaussian_sum
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import mean_nis
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.navigation.divergence import endings
from hillsphere_estimators.observability import observability
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.specs import BatchedUnscentedSpec, IteratedExtendedSpec
from hillsphere_estimators.unscented import BatchedUnscented

ALL: dict[str, Estimator] = {
    **{
        update: BatchedUnscented(BatchedUnscentedSpec(update=update, gate_sigmas=5.0))
        for update in ("plain", "iterated", "tempered")
    },
    "gated": type(example("estimator", "iterated_extended"))(IteratedExtendedSpec(gate_sigmas=5.0)),
    **{type_: example("estimator", type_) for type_ in ("information", "ukf", "ekf")},
}
NAMES = list(ALL)


class Holed(Pair):
    """A pair whose first range, and motion, are no numbers far out on one side."""

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        z = super().observe(x, t_s, case)
        z[2, x[0] > 1e6] = np.nan
        return z

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        # a model may refuse what is no number: it is never given any
        assert np.isfinite(x).all()
        there = super().advance(x, t0_s, t1_s, control, case)
        there[3, x[0] > 1e6] = np.nan
        return there


def make(cases: int) -> tuple[Belief, MeasurementSet]:
    flight = pair_flight(cases, 1, share=0.001)
    return flight.prior, flight.sets[0]


def spoil(belief: Belief, case: int, value: float) -> Belief:
    x = belief.x.copy()
    x[0, case] = value
    return replace(belief, x=x)


@pytest.mark.parametrize("value", [2e6, np.nan])
@pytest.mark.parametrize("name", NAMES)
def test_a_case_fails_alone(name: str, value: float) -> None:
    estimator, model = ALL[name], Holed()
    prior, measured = make(4)
    later = prior.t_s + 600.0
    whole, innovation = estimator.update(model, prior, measured)
    moved = estimator.predict(model, prior, later, nothing(4))
    bad = spoil(prior, 2, value)
    after, brought = estimator.update(model, bad, measured)
    ahead = estimator.predict(model, bad, later, nothing(4))
    others = np.array([0, 1, 3])
    for one, other in ((whole, after), (moved, ahead)):
        np.testing.assert_array_equal(other.finite, [True, True, False, True])
        assert np.isnan(other.x[:, 2]).all()
        np.testing.assert_array_equal(one.x[:, others], other.x[:, others])
        np.testing.assert_array_equal(one.root[others], other.root[others])
    np.testing.assert_array_equal(innovation.nis[others], brought.nis[others])
    assert np.isnan(brought.nis[2])
    assert brought.used[:, 2].all()
    assert not mean_nis([brought]).inside[0]
    # and goes on failing, without any warning or error
    again, _ = estimator.update(model, estimator.predict(model, after, later, nothing(4)),
                                replace(measured, t_s=later))  # fmt: skip
    np.testing.assert_array_equal(again.finite, [True, True, False, True])


@pytest.mark.parametrize("name", NAMES)
def test_a_single_case_raises(name: str) -> None:
    estimator, model = ALL[name], Holed()
    prior, measured = make(1)
    far, none = spoil(prior, 0, 2e6), spoil(prior, 0, np.nan)
    with pytest.raises(InputError, match=r"no finite measurement of rows \[2\] at the mean"):
        estimator.update(model, far, measured)
    with pytest.raises(PropagationError, match=r"prediction from 0 s to 600 s is not finite"):
        estimator.predict(model, far, np.full(1, 600.0), nothing(1))
    for call in (
        lambda: estimator.update(model, none, measured),
        lambda: estimator.predict(model, none, np.full(1, 600.0), nothing(1)),
    ):
        with pytest.raises(InputError, match="belief at 0 s is not finite"):
            call()
    # a row that was not measured may be no number
    unseen = replace(measured, present=measured.present & (np.arange(13) != 2)[:, None])
    assert estimator.update(model, far, unseen)[0].finite.all()


class Raising(Pair):
    """A pair whose motion raises, for all columns, if one is far out: as compiled motions do."""

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        if (x[0] > 1e6).any():
            raise PropagationError("a lane turned non-finite")
        return super().advance(x, t0_s, t1_s, control, case)


@pytest.mark.parametrize("name", ["plain", "gated", "information"])
def test_a_motion_that_raises_fails_its_case_only(name: str) -> None:
    estimator, (prior, _) = ALL[name], make(4)
    later = prior.t_s + np.array([600.0, 60.0, 600.0, 30.0])
    whole = estimator.predict(Raising(), prior, later, nothing(4))
    ahead = estimator.predict(Raising(), spoil(prior, 1, 2e6), later, nothing(4))
    np.testing.assert_array_equal(ahead.finite, [True, False, True, True])
    for case in (0, 2, 3):
        np.testing.assert_array_equal(ahead.x[:, case], whole.x[:, case])
        np.testing.assert_array_equal(ahead.root[case], whole.root[case])
    with pytest.raises(PropagationError, match="turned non-finite"):
        estimator.predict(Raising(), spoil(make(1)[0], 0, 2e6), np.ones(1), nothing(1))


def test_a_flight_with_a_filter_that_is_no_number_is_undecided() -> None:
    """Its row is of the class numerics, and no failed case of the flight."""
    nees_at_end = np.array([[np.nan, 6.0, 1e9, np.nan]])
    rows = np.full((1, 4), 6.0)
    record = SimpleNamespace(nees=nees_at_end, error=np.zeros((6, 1)), nis=rows, used=rows,
                             sent=rows)  # fmt: skip
    flights = SimpleNamespace(status=("completed",) * 3 + ("impact",), cause=("", "", "", "ground"))
    status, cause = endings(record, flights, 10.0)  # type: ignore[arg-type]
    assert status == ("not_finite", "completed", "diverged", "impact")
    assert cause[0] == "filter"
    assert case_class(status[0], True) == "undecided (numerics)"


def test_smoother_fit_and_fusion_mark_it_too() -> None:
    model, (prior, measured) = Holed(), make(3)
    estimator = ALL["gated"]
    later = prior.t_s + 600.0
    bad = spoil(prior, 1, np.nan)
    good: list[Belief] = []
    spoilt: list[Belief] = []
    for start, kept in ((prior, good), (bad, spoilt)):
        first, _ = estimator.update(model, start, measured)
        tie = link(model, first, later, nothing(3))
        second, _ = estimator.update(model, tie.predicted, replace(measured, t_s=later))
        kept.append(smooth([first, second], [tie])[0])
        kept.append(batch_least_squares(model, start, [measured]).belief)
        kept.append(covariance_intersection(start, first)[0])
    for one, other in zip(good, spoilt, strict=True):
        np.testing.assert_array_equal(other.finite, [True, False, True])
        for case in (0, 2):
            np.testing.assert_array_equal(one.x[:, case], other.x[:, case])
            np.testing.assert_array_equal(one.root[case], other.root[case])
    fit = batch_least_squares(model, bad, [measured])
    np.testing.assert_array_equal(fit.settled, [True, False, True])
    alone, set_alone = make(1)
    for call in (
        lambda: batch_least_squares(model, spoil(alone, 0, 2e6), [set_alone]),
        lambda: link(model, spoil(alone, 0, 2e6), alone.t_s + 1.0, nothing(1)),
    ):
        with pytest.raises(InputError, match="is not finite"):
            call()


def test_bounds_and_gramians_mark_it_too() -> None:
    model, (prior, measured) = Holed(), make(3)
    sets = [measured, replace(measured, t_s=measured.t_s + 600.0)]
    scales = np.ones(12)
    bad = spoil(prior, 1, 2e6)
    truths = [[start.x, Pair().advance(start.x, start.t_s, sets[1].t_s, nothing(3), np.arange(3))]
              for start in (prior, bad)]  # fmt: skip
    whole, holed = (cramer_rao(model, truth, prior.covariance, sets) for truth in truths)
    gramian, other = (observability(model, start, sets, scales) for start in (prior, bad))
    np.testing.assert_array_equal(holed[1].finite, [True, False, True])
    for case in (0, 2):
        np.testing.assert_array_equal(whole[1].root[case], holed[1].root[case])
        np.testing.assert_array_equal(gramian.singular[case], other.singular[case])
    assert np.isnan(other.singular[1]).all()
    np.testing.assert_array_equal(other.rank(), gramian.rank() * [1, 0, 1])
    far, one = spoil(make(1)[0], 0, 2e6), make(1)[1]
    with pytest.raises(InputError, match="is not finite: its mean is"):
        observability(model, far, [one], scales)
    with pytest.raises(InputError, match=r"is not finite"):
        cramer_rao(model, [far.x], far.covariance, [one])


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended", "information", "ukf", "ekf"])
def test_backward_only_without_process_noise(type_: str) -> None:
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    estimator: Any = example("estimator", type_)
    prior = Belief.of(np.array([[1.0, 2.0], [0.5, 0.1]]), np.array([np.diag([4.0, 1.0])] * 2),
                      np.array([5.0, 5.0]))  # fmt: skip

    class Timed(Linear):
        def advance(self, x, t0_s, t1_s, control, case):  # type: ignore[no-untyped-def]
            return np.array([x[0] + (t1_s - t0_s) * x[1], x[1]])

        def transition(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
            phi = np.repeat(np.eye(2)[None], len(t0_s), axis=0)
            phi[:, 0, 1] = t1_s - t0_s
            return phi

        def process_noise(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
            # the root of a negative time is no number
            return self.G[None] * np.sqrt(t1_s - t0_s)[:, None, None]

    quiet, noisy = (Timed(F, np.array([[0.0], [g]]), np.eye(2)) for g in (0.0, 0.1))
    back = np.array([2.0, 7.0])
    with pytest.raises(InputError, match="case 0 would be predicted backward, from 5 s to 2 s"):
        estimator.predict(noisy, prior, back, nothing(2))
    with pytest.raises(InputError, match="case 0 would be predicted backward, from 5 s to 2 s"):
        link(noisy, prior, back, nothing(2))

    class Quiet(Timed):
        def process_noise(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
            return np.zeros((x.shape[1], 2, 1))

    quiet = Quiet(F, np.zeros((2, 1)), np.eye(2))
    earlier = estimator.predict(quiet, prior, back, nothing(2))
    np.testing.assert_allclose(earlier.x[:, 0], [1.0 - 3.0 * 0.5, 0.5], rtol=1e-9)
    np.testing.assert_allclose(
        earlier.covariance[0], [[4.0 + 9.0, -3.0], [-3.0, 1.0]], rtol=0, atol=1e-9
    )
    again = estimator.predict(quiet, earlier, np.full(2, 5.0), nothing(2))
    np.testing.assert_allclose(again.covariance, prior.covariance, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", [*NAMES, "gaussian_sum"])
def test_no_cases_are_refused_by_name(name: str) -> None:
    """A belief of no cases is an input error at the door, not an error of NumPy's."""
    estimator = ALL.get(name) or example("estimator", name)
    none = Belief(np.zeros((4, 0)), np.zeros((0, 4, 4)), np.zeros(0))
    sets = MeasurementSet.of(np.zeros(0), np.zeros((13, 0)), np.ones((13, 1)), Pair().blocks)
    with pytest.raises(InputError, match="at least one case, got none"):
        estimator.predict(Pair(), none, np.zeros(0), np.zeros((0, 0)))
    with pytest.raises(InputError, match="at least one case, got none"):
        estimator.update(Pair(), none, sets)
    with pytest.raises(InputError, match="at least one case, got none"):
        batch_gaussian_sum(Pair(), none, [])
