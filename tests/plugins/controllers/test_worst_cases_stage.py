"""The stage ``worst_cases``: from perturbations to points of a sweep, by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError, StageError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_controllers.linear_products import UncertainModel, UncertainModels
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_controllers.stages.mu_analysis.products import MuAnalysis
from hillsphere_controllers.stages.mu_analysis.specs import MuAnalysisSpec
from hillsphere_controllers.stages.mu_analysis.stage import MuAnalysisStage
from hillsphere_controllers.stages.worst_cases.products import WorstCases
from hillsphere_controllers.stages.worst_cases.specs import WorstCasesSpec
from hillsphere_controllers.stages.worst_cases.stage import WorstCasesStage

A, B = "gravity.body.C2,1", "gravity.body.C2,2"
GAIN = {"gain": "stage.descent.actuator.gain.ax"}


def uncertain() -> UncertainModels:
    """Return a loop of two uncertain gains, a = 2 ± 0.6, gain = 1 ± 0.1."""
    system = LtiSystem(
        np.array([[-0.2]]),
        np.array([[1.0, 1.0, 1.0]]),
        np.array([[0.16], [0.03], [0.15]]),
        np.zeros((3, 3)),
    )
    one, two = np.ones(2, dtype=np.int64), np.zeros(2, dtype=bool)
    model = UncertainModel(
        system=system, names=(A, "gain"), units=("-", "-"), kinds=("real", "real"),
        rows=one, columns=one, times=one, lower=np.array([1.4, 0.9]), nominal=np.array([2.0, 1.0]),
        upper=np.array([2.6, 1.1]), dynamic=two, covers=np.zeros(2, dtype=bool),
    )  # fmt: skip
    return UncertainModels((model,), ("point=1",), 0, 0)


def flight() -> LinearisedFlight:
    """Return a linearisation with two dispersed parameters, of which one is not in the model."""
    still, zero = LtiSystem(-np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1))), np.zeros(1)
    return LinearisedFlight(
        systems=(still,), labels=("nominal, point=1",), parameters=("point", A, B),
        units=("", "-", "-"), values=np.array([[1.0], [2.0], [5.0]]),
        nominal=np.array([1.0, 2.0, 5.0]), controls=0, measurements=0, weights=(),
        flight="f", frame="body", t_s=zero, states=("x",), rates=(), commands=("ax",),
        x=np.zeros((1, 1)), u=np.zeros((1, 1)), sigma=np.array([0.2, 0.5]),
        affine=np.ones(2, dtype=bool), acceleration_slopes=np.zeros((0, 2, 1)),
        acceleration_covariance=np.zeros((0, 0, 1)), jacobian_share=np.zeros((2, 1)),
        largest_acceleration=np.zeros(2), end_deviation_m=np.zeros(2), fit_weight=np.zeros(2),
    )  # fmt: skip


@pytest.fixture(scope="module")
def analysis() -> MuAnalysis:
    table = {"needs": {"uncertain": "u"}, "analyses": ["robust_performance"], "points": 2}
    spec = validate(MuAnalysisSpec, table, where="stage")
    assert isinstance(spec, MuAnalysisSpec)
    return MuAnalysisStage(spec).run(RecordingContext(), uncertain(), ())


def run(analysis: MuAnalysis, **keys: Any) -> WorstCases:
    needs = {"analysis": "mu", "uncertain": "u", "flight": "linear"}
    spec = validate(WorstCasesSpec, {"needs": needs} | keys, where="stage")
    assert isinstance(spec, WorstCasesSpec)
    stage = WorstCasesStage(spec)
    given = (analysis, uncertain(), flight())
    made = stage.run(RecordingContext(), *given)
    check_product(made)
    check_presentation(stage.present(made, *given))
    return made


def test_worst_values_stand_at_their_bounds_and_the_others_at_sigmas(analysis: MuAnalysis) -> None:
    # more of both makes the pole slower: the worst corner is the upper one
    made = run(analysis, inputs=GAIN)
    assert made.names == (A, B, GAIN["gain"])
    assert_allclose(made.values[0], 2.6, rtol=1e-6)
    assert_allclose(made.values[2], 1.1, rtol=1e-6)
    assert_allclose(made.values[1], [5.0, 6.5, 3.5], rtol=1e-12)
    assert made.remaining.tolist() == [0.0, 3.0, -3.0]
    assert set(made.model) == {"point=1"}
    (one,) = analysis.results
    assert_allclose(made.mu, one.lower)


def test_blocks_without_an_input_stay_out(analysis: MuAnalysis) -> None:
    made = run(analysis, remaining=[-1])
    assert made.names == (A, B)
    assert_allclose(made.values[:, 0], [2.6, 4.5], rtol=1e-6)


def test_worst_parameters_grow_together_in_standard_deviations(analysis: MuAnalysis) -> None:
    made = run(analysis, inputs=GAIN, scales=[1, 2, 4.5], remaining=[0, -3])
    # a = 2 + 0.2 k; the gain has no standard deviation and stays at its bound
    assert_allclose(made.values[0], np.tile([2.2, 2.4, 2.9], 2), rtol=1e-12)
    assert_allclose(made.values[1], np.repeat([5.0, 3.5], 3), rtol=1e-12)
    assert_allclose(made.values[2], 1.1, rtol=1e-6)
    assert made.ladder is not None
    assert made.ladder.values.tolist() == made.sigmas.tolist() == [1.0, 2.0, 4.5] * 2
    assert len(set(made.ladder.groups)) == 2
    assert len(set(made.labels)) == 6
    assert made.labels[2].endswith("4.5 σ")
    plain = run(analysis)
    assert plain.ladder is None
    assert_allclose(plain.sigmas, 3.0, rtol=1e-6)  # the declared bounds
    with pytest.raises(InputError, match="scales"):
        run(analysis, scales=[0])


def nominal_is_worst(analysis: MuAnalysis) -> MuAnalysis:
    """Return the analysis with a worst perturbation of performance alone."""
    (one,) = analysis.results
    return replace(analysis, results=(replace(one, normalised=np.zeros(2)),))


def test_a_perturbation_that_moves_nothing_is_no_case(analysis: MuAnalysis) -> None:
    with pytest.raises(StageError, match=r"as it is, point=1, robust performance\) moves what"):
        run(nominal_is_worst(analysis), inputs=GAIN)
    both = replace(analysis, results=(*nominal_is_worst(analysis).results, *analysis.results))
    made = run(both, inputs=GAIN, remaining=[0])
    assert len(made.labels) == 1
    assert made.moved.tolist() == [2]
    assert made.unmoved == ("as it is, point=1, robust performance",)
    needs = {"analysis": "mu", "uncertain": "u", "flight": "linear"}
    spec = validate(WorstCasesSpec, {"needs": needs}, where="stage")
    assert isinstance(spec, WorstCasesSpec)
    shown = WorstCasesStage(spec).present(made, both, uncertain(), flight())
    assert "Without a case (1)" in shown.tables["worst_cases"].notes[-1]
    assert run(analysis).moved.tolist() == [1, 1, 1]  # the gain has no input in the flight


def test_the_worst_gain_is_flown_as_it_is(analysis: MuAnalysis) -> None:
    (one,) = analysis.results
    inside = replace(one, analysis="worst_case_gain", normalised=np.array([1.0, -0.4]))
    for size in (1.0, 2.0):
        given = replace(
            analysis, size=size, results=(replace(inside, normalised=size * inside.normalised),)
        )
        made = run(given, inputs=GAIN, analyses=["worst_case_gain"], remaining=[0])
        assert_allclose(made.values[[0, 2], 0], [2.6, 0.96], rtol=1e-12)


def test_faults_are_said(analysis: MuAnalysis) -> None:
    with pytest.raises(InputError, match="controllers: none is called 'ka'"):
        run(analysis, controllers=["ka"])
    with pytest.raises(InputError, match=r"inputs: the models have no block 'gian'.*gain"):
        run(analysis, inputs={"gian": "stage.descent.actuator.gain.ax"})
    with pytest.raises(StageError, match="no worst case"):
        run(analysis, analyses=["robust_stability"])
