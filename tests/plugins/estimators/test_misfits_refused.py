"""Measurements, truths and covariances that do not fit are refused, by all estimators alike."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Linear

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, EstimationModel
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.observability import observability
from hillsphere_estimators.sigma_points import SigmaRule

TYPES = ["unscented", "iterated_extended", "information", "ukf", "ekf"]
MODEL = Linear(np.eye(2), np.zeros((2, 1)), np.eye(2))


class Plain:
    """The same without its derivatives."""

    advance, process_noise, observe = MODEL.advance, MODEL.process_noise, MODEL.observe


def prior(cases: int = 1) -> Belief:
    return Belief.of(
        np.zeros((2, cases)), np.repeat(np.eye(2)[None], cases, axis=0), np.zeros(cases)
    )


def make_measurements(
    rows: int, t_s: float = 0.0, cases: int = 1, kind: Literal["linear", "angle"] = "linear"
) -> MeasurementSet:
    blocks = tuple((Channel(f"z{k}", "rad", kind),) for k in range(rows))
    return MeasurementSet.of(
        np.full(cases, t_s), np.ones((rows, cases)), np.full((rows, 1), 0.1), blocks
    )


@pytest.mark.parametrize("model", [MODEL, Plain()])
@pytest.mark.parametrize("kind", ["linear", "angle"])
@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize("type_", TYPES)
def test_other_rows(
    type_: str, rows: int, kind: Literal["linear", "angle"], model: EstimationModel
) -> None:
    """One row beside two was broadcast, and counted twice."""
    with pytest.raises(InputError, match=f"model shows 2 rows, the measurements have {rows}"):
        example("estimator", type_).update(model, prior(), make_measurements(rows, kind=kind))


def test_other_rows_of_a_fit() -> None:
    with pytest.raises(InputError, match="model shows 2 rows, the measurements have 1"):
        batch_least_squares(MODEL, prior(), [make_measurements(1)])


@pytest.mark.parametrize("type_", TYPES)
def test_other_times_and_cases(type_: str) -> None:
    estimator = example("estimator", type_)
    with pytest.raises(InputError, match="case 0 was measured at 100 s, but the belief is of 0 s"):
        estimator.update(MODEL, prior(), make_measurements(2, 100.0))
    with pytest.raises(InputError, match="belief has 2 cases, the measurements have 1"):
        estimator.update(MODEL, prior(2), make_measurements(2))
    # times that differ by rounding are the same
    late = Belief(prior().x, prior().root, np.array([0.1 + 0.2]))
    estimator.update(MODEL, late, make_measurements(2, 0.3))


@pytest.mark.parametrize("shape", [(2,), (1, 2), (2, 1)])
def test_truth_of_another_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"truth must be \(2, 2\), as the belief, got"):
        nees(prior(2), np.zeros(shape))


@pytest.mark.parametrize(("alpha", "beta"), [(1.0, 0.0), (2.0, 3.9), (0.0, 2.0), (1.0, np.nan)])
def test_sigma_points_that_make_no_covariance(alpha: float, beta: float) -> None:
    with pytest.raises(InputError, match="beta of at least its square"):
        SigmaRule(alpha, beta)


def test_means_that_are_not_finite() -> None:
    with pytest.raises(InputError, match="the mean of case 1 is not finite"):
        Belief.of(np.array([[0.0, np.nan]]), np.ones((2, 1, 1)), np.zeros(2))


def test_a_mean_over_nothing() -> None:
    with pytest.raises(InputError, match="runs must be above zero, got 0"):
        chi_square_band(2, 0)


@pytest.mark.parametrize("scales", [np.ones(3), np.array([1.0, 0.0]), np.array([1.0, np.nan])])
def test_scales_that_do_not_fit(scales: Array) -> None:
    with pytest.raises(InputError, match="scales must be 2 sizes"):
        observability(MODEL, prior(), [make_measurements(2)], scales)
    with pytest.raises(InputError, match="scales must be 2 sizes"):
        covariance_intersection(prior(), prior(), "trace", scales)


def test_controls_of_another_number() -> None:
    with pytest.raises(InputError, match="1 measurements need as many controls, got 0"):
        observability(MODEL, prior(), [make_measurements(2)], np.ones(2), [])


def test_nothing_else_is_made_least() -> None:
    least: Any = "norm"
    with pytest.raises(InputError, match=r"least must be .* got 'norm'"):
        covariance_intersection(prior(), prior(), least)
