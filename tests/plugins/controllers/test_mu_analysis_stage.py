"""The stage ``mu_analysis``: published peaks, worst parameters by hand, faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.presentation import Chart, Curve, Panel, Presentation
from hillsphere.products import ControlDesign
from hillsphere.runs.judgements import RunEvidence
from hillsphere.show.outcome_specs import StatementSpec
from hillsphere.show.outcomes import Statement
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_controllers.linear_products import LinearModels, UncertainModels
from hillsphere_controllers.mu.blocks import BlockStructure, full
from hillsphere_controllers.mu.robustness import mu_bounds_on_grid
from hillsphere_controllers.stages.lft.specs import LftSpec
from hillsphere_controllers.stages.lft.stage import LftStage
from hillsphere_controllers.stages.linear_models.specs import LinearModelsSpec
from hillsphere_controllers.stages.linear_models.stage import LinearModelsStage
from hillsphere_controllers.stages.mu_analysis.presentation import present_analyses
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis
from hillsphere_controllers.stages.mu_analysis.specs import MuAnalysisSpec
from hillsphere_controllers.stages.mu_analysis.stage import MuAnalysisStage
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import gain

# Skogestad and Postlethwaite, Multivariable Feedback Control, Table 8.1; time in minutes
COLUMN: dict[str, Any] = {
    "systems": [
        {"a": [["-1/75", 0], [0, "-1/75"]], "b": [[87.8, -86.4], [108.2, -109.6]],
         "c": [["1/75", 0], [0, "1/75"]], "inputs": ["v"], "outputs": ["y"]},
        {"numerator": [1, 0.2], "denominator": [0.5, 1], "channels": 2, "inputs": ["u"],
         "outputs": ["z"]},
        {"numerator": [5, 0.5], "denominator": [10, 1e-5], "channels": 2, "inputs": ["e"],
         "outputs": ["error"]},
        {"d": [["-1.096/-2.744", "0.864/-2.744"], ["-1.082/-2.744", "0.878/-2.744"]],
         "inputs": ["e"], "outputs": ["f"]},
        {"numerator": [52.5, 0.7], "denominator": [1, 0], "channels": 2, "inputs": ["f"],
         "outputs": ["u"]},
    ],
    "junctions": ["v = u + w", "e = r - y"],
    "inputs": ["w", "r"],
    "outputs": ["z", "error"],
}  # fmt: skip
INPUTS = [{"name": f"input {k}", "outputs": [f"z[{k}]"], "inputs": [f"w[{k}]"]} for k in range(2)]


def linear(table: dict[str, Any]) -> LinearModels:
    spec = validate(LinearModelsSpec, table, where="models")
    assert isinstance(spec, LinearModelsSpec)
    return LinearModelsStage(spec).run(RecordingContext())


def uncertain(models: LinearModels, **keys: Any) -> UncertainModels:
    spec = validate(LftSpec, {"needs": {"models": "models"}} | keys, where="lft")
    assert isinstance(spec, LftSpec)
    return LftStage(spec).run(RecordingContext(), models)


def run(
    models: UncertainModels,
    controllers: dict[str, LtiSystem] | None = None,
    more: dict[str, Any] | None = None,
    **keys: Any,
) -> MuAnalysis:
    given = controllers or {}
    table = {"needs": {"uncertain": "uncertain", "controllers": list(given)}} | keys | (more or {})
    spec = validate(MuAnalysisSpec, table, where="stage")
    assert isinstance(spec, MuAnalysisSpec)
    stage = MuAnalysisStage(spec)
    designs = tuple(ControlDesign(one) for one in given.values())
    made = stage.run(RecordingContext(), models, designs)
    check_product(made)
    check_presentation(stage.present(made, models, designs))
    return made


def of(made: MuAnalysis, analysis: str, loop: int = 0) -> Analysed:
    return next(r for r in made.results if (r.analysis, r.loop) == (analysis, loop))


@pytest.fixture(scope="module")
def column() -> UncertainModels:
    return uncertain(linear(COLUMN), blocks=INPUTS)


@pytest.fixture(scope="module")
def spring() -> UncertainModels:
    """Return a mass on a spring with damping: ẍ = −k x − 0.2 ẋ + u + d, y = x."""
    return uncertain(
        linear(
            {
                "parameters": [{"name": "k", "nominal": 1, "values": [0.5, 1.5], "unit": "N/m"}],
                "systems": [
                    {"a": [[0, 1], ["-k", -0.2]], "b": [[0], [1]], "c": [[1, 0]],
                     "inputs": ["f"], "outputs": ["x"]},
                ],
                "junctions": ["f = u + d", "y = x"],
                "inputs": ["d"],
                "outputs": ["x"],
                "controls": ["u"],
                "measurements": ["y"],
            }
        ),
        degree=1,
    )  # fmt: skip


def test_skogestad_postlethwaite_table_8_1(column: UncertainModels) -> None:
    """Peaks 5.7726, 0.5242 and 0.500 on the grid of the book's program; true ones are above."""
    grid = np.logspace(-3, 3, 61)
    model = column.models[0]
    whole = BlockStructure([*to_lft(model).blocks, full(2)])
    lower, upper = mu_bounds_on_grid(model.system, whole, grid)
    assert upper.max() == pytest.approx(5.7726, abs=1.5e-4)
    assert lower.max() == pytest.approx(5.7726, abs=1.5e-4)
    made = run(column, analyses=["robust_stability", "robust_performance"], gap=0.003, points=10)
    performance, stability = of(made, "robust_performance"), of(made, "robust_stability")
    assert upper.max() < performance.peak <= performance.upper <= 1.003001 * performance.peak
    assert performance.lower == pytest.approx(performance.peak, rel=1e-6)
    assert 0.5242 < stability.peak < 0.5242 * 1.005
    assert made.nominal[0] == pytest.approx(0.5, abs=1e-4)
    assert_allclose(performance.shares.sum(), 1.0, rtol=3e-4)
    # the intervals leave no gap
    assert performance.interval_low_rad_s[0] == 0.0
    reach = np.maximum.accumulate(performance.interval_high_rad_s)
    assert (performance.interval_low_rad_s[1:] <= reach[:-1]).all()
    assert np.isinf(reach[-1])


def test_a_bound_above_a_limit_refutes_nothing(column: UncertainModels) -> None:
    """µ of robust performance is 5.77…: only a limit outside its bounds is decided."""
    made = run(column, analyses=["robust_performance"], gap=0.1, points=10)
    (one,) = made.results
    shown = present_analyses(made, None)
    evidence = RunEvidence({"mu": shown})
    between = 0.5 * (one.lower + one.upper)
    assert one.lower < between < one.upper
    table = {"table": "mu_summary", "column": "robust_performance_certified"}
    keys: dict[str, str]
    for keys in (
        table,
        table | {"column": "robust_performance"},
        table | {"column": "robust_performance_lower"},
        {"metric": "robust_performance_upper"},
        {"metric": "robust_performance_lower"},
    ):
        for value, state in ((1.0, "refuted"), (between, "undecided"), (10.0, "confirmed")):
            claim = {"text": "t", "stage": "mu", "op": "<", "value": value} | keys
            found = Statement(StatementSpec.model_validate(claim)).judge(evidence)
            assert found.state == state, (keys, value)


def test_published_values_stand_beside(column: UncertainModels, tmp_path: Path) -> None:
    table = tmp_path / "published.csv"
    table.write_text("# source: a book\ncontroller,robust_stability\nas it is,0.5242\n", "utf-8")
    keys = {"analyses": ["robust_stability"], "points": 5, "reference": str(table)}
    spec = validate(MuAnalysisSpec, {"needs": {"uncertain": "u"}} | keys, where="stage")
    assert isinstance(spec, MuAnalysisSpec)
    stage = MuAnalysisStage(spec)
    shown = stage.present(stage.run(RecordingContext(), column, ()), column, ())
    (row,) = shown.tables["mu_summary"].rows
    assert row["robust_stability_paper"] == 0.5242


def test_worst_stiffness_is_that_of_the_physics(spring: UncertainModels) -> None:
    # u = −g x with g = −0.4 takes stiffness away: unstable when k falls to 0.4
    made = run(spring, {"soft": gain(np.array([[0.4]]))}, points=3)
    stability = of(made, "robust_stability")
    assert stability.names == ("k",)
    assert stability.units == ("N/m",)
    assert stability.values[0] == pytest.approx(0.4, abs=1e-6)
    assert stability.lower == pytest.approx(0.5 / 0.6, rel=1e-6)
    assert stability.upper == pytest.approx(0.5 / 0.6, rel=0.02)
    assert abs(complex(stability.pole_re, stability.pole_im)) < 1e-6
    gained = of(made, "worst_case_gain")
    assert gained.values[0] == pytest.approx(0.5, abs=1e-6)
    # stiffness 0.1 left, damping c = 0.2: the peak is 1/(c sqrt(0.1 − c²/4))
    assert gained.lower == pytest.approx(1.0 / (0.2 * 0.3), rel=1e-6)
    assert gained.upper >= gained.lower
    assert_allclose(stability.shares, [1.0], rtol=1e-3)
    assert stability.complex_parts.tolist() == [0.01, 0.05]
    assert (stability.complex_upper >= stability.lower).all()


def test_controllers_are_compared_and_unstable_ones_said(spring: UncertainModels) -> None:
    given = {"none": gain(np.zeros((1, 1))), "bad": gain(np.array([[2.0]]))}
    made = run(spring, given, analyses=["robust_stability"], points=5)
    assert made.controllers == ("none", "bad")
    assert np.isfinite(made.nominal).tolist() == [True, False]
    assert [one.loop for one in made.results] == [0]
    # damping, and stiffness above zero: δ = −2 takes it to zero
    assert made.results[0].lower == pytest.approx(0.5, rel=1e-6)


def _curves(shown: Presentation) -> Chart:
    chart = shown.figures["mu_sensitivity_curves"]
    assert isinstance(chart, Chart)
    return chart


def test_models_are_chosen_and_drawn_with_shares_over_frequency(spring: UncertainModels) -> None:
    (model,) = spring.models
    stiffer = replace(model, upper=np.array([1.3]))
    several = replace(
        spring, models=(model, stiffer, model), labels=("point=1", "point=2", "point=10")
    )
    keys: dict[str, Any] = {
        "analyses": ["robust_performance"], "models": ["point=1*"], "curves": ["point=10"],
        "sensitivity_curves": True, "points": 6,
    }  # fmt: skip
    given = {"soft": gain(np.array([[0.4]])), "none": gain(np.zeros((1, 1)))}
    made = run(several, given, keys)
    assert made.model.tolist() == [0, 2, 0, 2]
    assert [one.omega_rad_s.size > 0 for one in made.results] == [False, True, False, True]
    one = made.results[1]
    assert one.curve_shares.shape == (2, one.omega_rad_s.size)
    assert_allclose(one.curve_shares.sum(axis=0), 1.0, rtol=0.0, atol=1e-9)
    assert (one.curve_nominal <= one.curve_upper * (1.0 + 1e-9)).all()
    assert one.curve_nominal.max() <= made.nominal[1] * (1.0 + 1e-9)
    spec = validate(
        MuAnalysisSpec, {"needs": {"uncertain": "u", "controllers": list(given)}} | keys, where="s"
    )
    assert isinstance(spec, MuAnalysisSpec)
    shown = MuAnalysisStage(spec).present(made, several, ())
    # Two columns, one a controller: bounds above, shares of the blocks below.
    _, above, _, below = (panel for panel in _curves(shown).panels if isinstance(panel, Panel))
    drawn = {mark.label: np.asarray(mark.y) for mark in below.marks if isinstance(mark, Curve)}
    assert len(drawn) == 2
    assert_allclose(sum(drawn.values()), 1.0, rtol=0.0, atol=1e-9)
    upper = next(mark for mark in above.marks if isinstance(mark, Curve))
    assert_allclose(np.asarray(upper.y), made.results[3].curve_upper)
    rows = shown.tables["mu_models_robust_performance"].rows
    assert [row["model"] for row in rows] == ["point=1", "point=10"]
    needs = {"uncertain": "u", "controllers": list(given), "beside": ["before"]}
    whole = validate(MuAnalysisSpec, {"needs": needs, "columns": ["soft"]} | keys, where="s")
    assert isinstance(whole, MuAnalysisSpec)
    columns = MuAnalysisStage(whole).present(made, several, (), (made,))
    check_presentation(columns)
    # Two columns of the analysis beside, and of its own that of one controller.
    wide, narrow = (_curves(one).size[0] for one in (columns, shown))
    assert wide - narrow == pytest.approx(3.2)
    soft, _ = shown.verdict
    assert soft.startswith("soft, uncertain: robust performance proved for 0 of 2 uncertain models")
    assert "disproved for point=1, point=10" in soft
    with pytest.raises(InputError, match=r"models: needs\.uncertain"):
        run(several, given, {"models": ["point=3"]})


def test_the_worst_of_the_channels_counts(spring: UncertainModels) -> None:
    """Two outputs, y and y/2: each by itself, they are below what they are together."""
    (model,) = spring.models
    s = model.system
    row = s.c[1:2]
    wide = LtiSystem(
        s.a, s.b, np.vstack([s.c[:2], 0.5 * row, s.c[2:]]),
        np.vstack([s.d[:2], 0.5 * s.d[1:2], s.d[2:]]), inputs=s.inputs,
        outputs=(*s.outputs[:2], "half", *s.outputs[2:]),
    )  # fmt: skip
    models = replace(spring, models=(replace(model, system=wide),))
    given = {"none": gain(np.zeros((1, 1)))}
    keys: dict[str, Any] = {"analyses": ["robust_performance"], "points": 3}
    (alone,) = run(spring, given, keys).results
    made = run(models, given, keys | {"outputs": ["half", s.outputs[1]]})
    assert [one.channel for one in made.results] == ["half", s.outputs[1]]
    half, own = made.results
    assert half.upper == pytest.approx(0.5 * own.upper, rel=0.3)
    assert half.lower < half.upper < own.lower
    (worst,) = made.worst
    assert (worst.channel, worst.lower_channel) == (s.outputs[1], s.outputs[1])
    assert (worst.upper, worst.lower) == (own.upper, own.lower)
    # bounds of two channels stay told apart
    low = 2.0 * own.upper
    crossed = replace(made, results=(replace(half, lower=low, peak=low), own))
    (mixed,) = crossed.worst
    assert (mixed.channel, mixed.lower_channel) == (s.outputs[1], "half")
    assert mixed.peak == mixed.lower == low
    certificates = present_analyses(made, None).tables["mu_certificates"]
    assert [row["channel"] for row in certificates.rows] == ["half", s.outputs[1]]
    assert worst.upper == pytest.approx(alone.upper, rel=1e-6)
    together = run(models, given, keys)
    assert together.nominal[0] == pytest.approx(made.nominal[0] * np.sqrt(1.25), rel=1e-6)
    with pytest.raises(InputError, match="outputs: no signal 'z'"):
        run(models, given, keys | {"outputs": ["z"]})


def test_what_is_uncertain_is_said_of_every_loop(spring: UncertainModels) -> None:
    made = run(spring, {"k": gain(np.zeros((1, 1)))}, analyses=["robust_stability"], points=3)
    assert made.label(0) == "k, uncertain"
    (said,) = present_analyses(made, None).verdict
    assert said.startswith("k, uncertain: ")


def with_beside(**keys: Any) -> MuAnalysisStage:
    needs = {"uncertain": "u", "controllers": ["none"], "beside": ["before"]}
    table = {"needs": needs, "sensitivity_curves": True, "points": 3} | keys
    spec = validate(MuAnalysisSpec, table, where="s")
    assert isinstance(spec, MuAnalysisSpec)
    return MuAnalysisStage(spec)


def test_analyses_beside_are_of_the_same_kind(spring: UncertainModels) -> None:
    """Told before anything is computed, and where a product is shown anew."""
    given = {"none": gain(np.zeros((1, 1)))}
    keys: dict[str, Any] = {"analyses": ["robust_performance"], "points": 3}
    made = run(spring, given, keys)
    other = run(spring, given, keys | {"analyses": ["robust_stability"]})
    stage = with_beside(**keys)
    for call in (
        lambda: stage.present(made, spring, (), (other,)),
        lambda: stage.run(RecordingContext(), spring, (), (other,)),
    ):
        with pytest.raises(InputError, match=r"needs\.beside: 'before' .* robust_"):
            call()
    both = with_beside(analyses=["robust_stability", "robust_performance"])
    with pytest.raises(InputError, match="'before' lacks robust_stability, which is analysed here"):
        both.run(RecordingContext(), spring, (), (made,))
    named = with_beside(**keys, outputs=["y"])
    with pytest.raises(InputError, match=r"'before' (has|lacks) robust_performance"):
        named.run(RecordingContext(), spring, (), (made,))
    # of loops that are all unstable nothing is known, and nothing is shown
    stage.present(made, spring, (), (replace(made, results=()),))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, ""),
        ({"gap": 0.1, "points": 9, "outputs": ["b", "a"]}, ""),
        ({"outputs": ["a"]}, 'stage \'before\' has outputs = ["a"], this one ["a", "b"]'),
        ({"analyses": ["robust_stability"]},
         'has analyses = ["robust_stability"], this one ["robust_performance"]'),
    ],
)  # fmt: skip
def test_a_mission_with_another_analysis_beside_is_not_valid(
    keys: dict[str, Any], said: str
) -> None:
    same: dict[str, Any] = {"analyses": ["robust_performance"], "outputs": ["a", "b"]}
    table = {"needs": {"uncertain": "u"}} | same | keys
    before = validate(MuAnalysisSpec, table, where="before")
    found = list(with_beside(**same).spec.misfits({"stage": {"before": before}}))
    assert len(found) == bool(said)
    for where, message in found:
        assert where == ("needs", "beside", 0)
        assert said in message
    assert not list(with_beside(**same).spec.misfits({}))


def test_columns_over_different_frequencies_say_so(spring: UncertainModels) -> None:
    keys: dict[str, Any] = {
        "analyses": ["robust_performance"], "points": 3, "sensitivity_curves": True,
    }  # fmt: skip
    made = run(spring, {"none": gain(np.zeros((1, 1)))}, keys)
    (one,) = made.results
    moved = replace(made, results=(replace(one, omega_rad_s=10.0 * one.omega_rad_s),))
    stage = with_beside(**keys)
    same, apart = (
        stage.present(made, spring, (), (beside,)).figures["mu_sensitivity_curves"].caption
        for beside in (made, moved)
    )
    assert "different frequencies" not in same
    low, high = one.omega_rad_s[[0, -1]]
    label = made.label(0)
    assert apart.endswith(
        f" The columns span different frequencies: {label}: {10 * low:.2g} to {10 * high:.2g} "
        f"rad/s; {label}: {low:.2g} to {high:.2g} rad/s."
    )


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"columns": ["kb"], "sensitivity_curves": True}, "'kb' is none of needs.controllers"),
        ({"columns": ["ka"]}, "set sensitivity_curves"),
    ],
)
def test_columns_are_those_of_controllers(keys: dict[str, Any], said: str) -> None:
    table = {"needs": {"uncertain": "u", "controllers": ["ka"]}} | keys
    with pytest.raises(InputError, match=said):
        validate(MuAnalysisSpec, table, where="s")


def test_faults_are_said(spring: UncertainModels, column: UncertainModels) -> None:
    with pytest.raises(InputError, match=r"needs\.controllers.*closes their loops"):
        run(spring)
    with pytest.raises(InputError, match="takes 2 measurements"):
        run(spring, {"wide": gain(np.zeros((2, 2)))})
    with pytest.raises(InputError, match="takes 1 measurements"):
        run(column, {"one": gain(np.zeros((1, 1)))})
    nothing = uncertain(
        linear(COLUMN), blocks=[{"name": "all", "outputs": ["z", "error"], "inputs": ["w", "r"]}]
    )
    with pytest.raises(InputError, match="performance"):
        run(nothing, analyses=["robust_performance"])
    with pytest.raises(InputError, match="is listed twice"):
        run(spring, analyses=["worst_case_gain", "worst_case_gain"])
    certain = replace(spring, models=(replace(spring.models[0], names=()), *spring.models[1:]))
    with pytest.raises(InputError, match=r"needs\.uncertain: .*'uncertain'; .*truncation.*models"):
        run(certain, {"one": gain(np.zeros((1, 1)))})


def three_parameters() -> UncertainModels:
    """Return a loop whose bound of µ with performance is 7 % above µ."""
    random = np.random.default_rng(2)
    a = random.normal(size=(4, 4))
    a -= (np.linalg.eigvals(a).real.max() + 0.15) * np.eye(4)
    b, c = 0.5 * random.normal(size=(4, 7)), 0.5 * random.normal(size=(7, 4))
    system = {"a": a.tolist(), "b": b.tolist(), "c": c.tolist(), "inputs": ["w"], "outputs": ["z"]}
    blocks = [
        {"name": name, "kind": "real", "outputs": [f"z[{2 * k}]", f"z[{2 * k + 1}]"],
         "inputs": [f"w[{2 * k}]", f"w[{2 * k + 1}]"]}
        for k, name in enumerate("abc")
    ]  # fmt: skip
    models = linear({"systems": [system], "inputs": ["w"], "outputs": ["z"]})
    return uncertain(models, blocks=blocks)


def test_a_bound_that_is_asked_for_is_proved_in_parts_or_said_not_to_be() -> None:
    models = three_parameters()
    keys: dict[str, Any] = {"analyses": ["robust_performance"], "gap": 1e-3, "points": 2}
    [whole] = run(models, **keys).results
    assert (whole.parts, whole.parts_left) == (0, 0)
    assert whole.upper > 1.05 * whole.lower
    limit = 0.4 * whole.upper + 0.6 * whole.lower
    made = run(models, **keys, prove_below=limit)
    [proved] = made.results
    assert proved.upper == limit
    assert proved.parts > 1
    assert proved.parts_left == 0
    assert proved.interval_bound == pytest.approx(whole.interval_bound)  # those of the whole
    shown = present_analyses(made, None)
    summary = shown.tables["mu_summary"]
    assert any(f"is proved in {proved.parts} parts" in note for note in summary.notes)
    assert shown.tables["mu_certificates"].rows[0]["parts"] == proved.parts
    # what needs no proof, or cannot be proved, is left alone
    for other in (1.1 * whole.upper, 0.9 * whole.lower):
        [same] = run(models, **keys, prove_below=other).results
        assert (same.upper, same.parts, same.parts_left) == (whole.upper, 0, 0)
    few = replace(made, results=(replace(proved, upper=whole.upper, parts_left=2),))
    summary = present_analyses(few, None).tables["mu_summary"]
    assert any("is not proved on 2 of" in note for note in summary.notes)


def test_a_bound_of_mu_cannot_be_proved_of_a_gain() -> None:
    keys = {"needs": {"uncertain": "u"}, "analyses": ["worst_case_gain"], "prove_below": 1.0}
    with pytest.raises(InputError, match=r"prove_below: it is a bound of µ"):
        validate(MuAnalysisSpec, keys, where="stage")


def test_the_certificate_covers_what_a_truncation_left_out() -> None:
    """ẋ = −(1 + 0.5 a + 0.01 b) x + d, y = x: µ is 0.51, and 0.5 without b.

    The largest gain is that at rest, 1/(1 − 0.51), and 1/(1 − 0.5) without b.
    """
    system = {"a": [["-1 - 0.5*a - 0.01*b"]], "b": [[1]], "c": [[1]], "inputs": ["d"],
              "outputs": ["y"]}  # fmt: skip
    parameters = [{"name": n, "nominal": 0, "values": [-1, 1], "unit": "-"} for n in ("a", "b")]
    models = linear({"parameters": parameters, "systems": [system], "inputs": ["d"],
                     "outputs": ["y"]})  # fmt: skip
    small = uncertain(models, fit="affine", truncation=0.05)
    whole = uncertain(models, fit="affine")
    assert [one.names for one in (small.models[0], whole.models[0])] == [
        ("a", "left_out"),
        ("a", "b"),
    ]
    analyses = ("robust_stability", "worst_case_gain")
    made, exact = (run(m, analyses=list(analyses), gap=0.001, points=3) for m in (small, whole))
    for analysis, right, bare in zip(analyses, (0.51, 1 / 0.49), (0.5, 2.0), strict=True):
        assert right * (1 - 1e-6) <= of(made, analysis).upper <= right * 1.002
        assert right * (1 - 1e-6) <= of(exact, analysis).upper <= right * 1.002
        beside = next(r for r in made.without_cover if r.analysis == analysis)
        assert bare * (1 - 1e-6) <= beside.upper <= bare * 1.002
        # the worst case is that of the truncated model
        assert of(made, analysis).lower == beside.lower <= bare * (1 + 1e-6)
    assert exact.without_cover == ()
    shown = present_analyses(made, None)
    names = [column.name for column in shown.tables["mu_summary"].columns]
    assert "robust_stability_without_cover" in names
    assert float(shown.metrics["robust_stability_upper"].value) > 0.51 * (1 - 1e-6)
    assert float(shown.metrics["robust_stability_without_cover"].value) < 0.505
    assert "without the cover" in shown.verdict[0]
    assert "a block covers" in " ".join(shown.tables["mu_summary"].notes)
    none = present_analyses(exact, None)
    assert "cover" not in " ".join([*none.verdict, *none.tables["mu_summary"].notes])
