"""Measurements that arrive late: the result of all in order."""

from __future__ import annotations

from dataclasses import replace

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
    run_filter,
    without,
)

from hillsphere.errors import InputError
from hillsphere.estimation import MeasurementSet
from hillsphere.interfaces import EstimationModel, Estimator
from hillsphere.testing import example
from hillsphere_estimators.fixed_lag import FixedLag, LaggedBelief

TYPES = ["unscented", "iterated_extended", "information", "ukf", "ekf"]
MODEL = Linear(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.05], [0.1]]), np.eye(2)[:1])


def linear_flight(cases: int = 3) -> Flight:
    x = np.zeros((2, cases))
    return fly(MODEL, x, np.array([3.0, 1.0]), np.array([0.3]), np.arange(8.0), 4)


def take(lag: FixedLag, flight: Flight, order: list[int]) -> LaggedBelief:
    lagged = lag.start(flight.prior)
    for k in order:
        lagged = lag.add(lagged, flight.sets[k])
        assert len(lagged.steps) <= lag.steps
    return lagged


class Timed(Linear):
    """The same mass with its motion by the time between, so that it can be predicted in parts."""

    def advance(self, x, t0_s, t1_s, control, case):  # type: ignore[no-untyped-def]
        return np.array([x[0] + (t1_s - t0_s) * x[1], x[1]])

    def transition(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
        phi = np.repeat(np.eye(2)[None], len(t0_s), axis=0)
        phi[:, 0, 1] = t1_s - t0_s
        return phi

    def process_noise(self, x, t0_s, t1_s, control):  # type: ignore[no-untyped-def]
        dt, root = t1_s - t0_s, np.zeros((len(t0_s), 2, 2))
        root[:, 0, 0], root[:, 1, 0] = dt**1.5 / np.sqrt(3.0), np.sqrt(0.75 * dt)
        root[:, 1, 1] = np.sqrt(0.25 * dt)
        return 0.1 * root


@pytest.mark.parametrize("type_", TYPES)
@pytest.mark.parametrize("late", [1, 2, 5])
def test_late_by_k_steps_is_as_in_order(type_: str, late: int) -> None:
    model, flight = Timed(MODEL.F, MODEL.G, MODEL.H), linear_flight()
    estimator = example("estimator", type_)
    inorder = run_filter(estimator, model, flight)
    order = [0, 1, *range(3, 3 + late), 2, *range(3 + late, 8)]
    found = take(FixedLag(estimator, model, late), flight, order)
    # in between a prediction is in two parts and again in one: bit for bit the same all the same
    np.testing.assert_array_equal(found.belief.x, inorder.after[-1].x)
    np.testing.assert_array_equal(found.belief.root, inorder.after[-1].root)
    for step, brought in zip(found.steps, inorder.brought[-late:], strict=True):
        np.testing.assert_array_equal(step.innovation.nis, brought.nis)


@pytest.mark.parametrize("gate", [None, 5.0])
def test_nonlinear_models_behind_gates_too(gate: float | None) -> None:
    estimator: Estimator = example("estimator", "unscented", 1).__class__(
        type(example("estimator", "unscented").spec)(update="iterated", gate_sigmas=gate)
    )
    flight = pair_flight(4, 6, period_s=600.0)
    inorder = run_filter(estimator, Pair(), flight)
    found = take(FixedLag(estimator, Pair(), 3), flight, [0, 2, 1, 4, 5, 3])
    np.testing.assert_array_equal(found.belief.x, inorder.after[-1].x)
    np.testing.assert_array_equal(found.belief.root, inorder.after[-1].root)


def test_cases_may_have_delays_of_their_own() -> None:
    """Rows that come later for some cases are merged with those that were there at that time."""
    estimator: Estimator = example("estimator", "iterated_extended")
    model: EstimationModel = Pair()
    flight = pair_flight(4, 5, period_s=600.0)
    inorder = run_filter(estimator, model, flight)
    lag = FixedLag(estimator, model, 4)
    lagged = lag.start(flight.prior)
    missing = np.zeros((13, 4), dtype=bool)
    missing[:5, 1], missing[:, 3] = True, True
    for k, measured in enumerate(flight.sets):
        lagged = lag.add(lagged, without(measured, missing) if k == 2 else measured)
    assert apart(lagged.belief, inorder.after[-1]) > 1e-6
    # before the present values of rows that are not present are arbitrary
    for rows in (missing & (np.arange(4) == 1), missing & (np.arange(4) == 3)):
        lagged = lag.add(lagged, replace(flight.sets[2], present=rows))
    np.testing.assert_array_equal(lagged.belief.x, inorder.after[-1].x)
    np.testing.assert_array_equal(lagged.belief.root, inorder.after[-1].root)
    with pytest.raises(InputError, match=r"row 0 of case 0 has been measured at 1200 s already"):
        lag.add(lagged, flight.sets[2])


def test_sets_that_cannot_be_inserted() -> None:
    flight = linear_flight(2)
    estimator = example("estimator", "unscented")
    lag = FixedLag(estimator, MODEL, 2)
    lagged = take(lag, flight, [0, 1, 3, 4, 5])
    with pytest.raises(InputError, match=r"measurements of 2 s in case 0 are older .* dropped 3"):
        lag.add(lagged, flight.sets[2])
    # what was dropped cannot be measured again, what is before the prior not at all
    with pytest.raises(InputError, match="of 3 s in case 0 are older"):
        lag.add(lagged, flight.sets[3])
    early = replace(flight.sets[0], t_s=flight.sets[0].t_s - 1.0)
    with pytest.raises(InputError, match="of -1 s in case 0 are older"):
        lag.add(lag.start(flight.prior), early)
    split = replace(flight.sets[2], t_s=np.array([4.5, 5.5]))
    with pytest.raises(InputError, match=r"4.5 s in case 0 and of 5.5 s in case 1 lie on differ"):
        lag.add(lagged, split)
    other = MeasurementSet.of(np.full(2, 5.0), np.zeros((2, 2)), np.ones((2, 1)),
                              (*MODEL.blocks, *MODEL.blocks))  # fmt: skip
    with pytest.raises(InputError, match="of 5 s with other blocks"):
        lag.add(lagged, other)
    with pytest.raises(InputError, match="at least one step, got steps = 0"):
        FixedLag(estimator, MODEL, 0)
    assert nothing(2).shape == (0, 2)
