"""The stage ``synthesis`` with a fixed structure for uncertain plants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import SingularProblemError
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.linear_products import LinearModels, UncertainModels
from hillsphere_controllers.stages.synthesis.presentation import present_synthesis
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.stages.synthesis.specs import SynthesisSpec
from hillsphere_controllers.stages.synthesis.stage import SynthesisStage
from hillsphere_controllers.stages.uncertain import uncertain_model
from hillsphere_controllers.systems.algebra import lower_lft


def plant(rate: float, spread: float) -> LtiSystem:
    """Make ẋ = −(rate + spread δ) x + d + u, z = (x, 0.1 u), y = x + 0.1 n."""
    return LtiSystem(
        np.array([[-rate]]),
        np.array([[-spread, 1.0, 0.0, 1.0]]),
        np.array([[1.0], [1.0], [0.0], [1.0]]),
        np.array([[0.0] * 4, [0.0] * 4, [0.0, 0.0, 0.0, 0.1], [0.0, 0.0, 0.1, 0.0]]),
        None,
        ("w", "d", "n", "u"),
        ("v", "z", "effort", "y"),
    )


RATES = (-0.5, 1.0)
MODELS = LinearModels(
    tuple(plant(rate, 0.0) for rate in RATES), tuple(f"rate={rate:g}" for rate in RATES),
    ("rate",), ("1/s",), np.array([RATES]), np.array([1.0]), 1, 1, (),
)  # fmt: skip


def uncertain(spread: float, kind: Any = "real") -> UncertainModels:
    block = Uncertainty("decay", kind, lower=-2.0, nominal=0.0, upper=4.0)
    if kind != "real":
        block = Uncertainty("decay", kind)
    models = (uncertain_model(Lft(plant(r, spread), (block,), (1,)), {}) for r in RATES)
    return UncertainModels(tuple(models), MODELS.labels, 1, 1)


def stage(needs: dict[str, str] | None = None, **options: Any) -> SynthesisStage:
    table = {
        "needs": {"models": "m"} | (needs or {}),
        "method": "structured",
        "outputs": ["z", "effort"],
        "inputs": ["d", "n"],
        "structured": {"parts": [{"kind": "free"}], "starts": 1, "shaken": False, "effort": "quick"}
        | options,
    }
    spec = validate(SynthesisSpec, table, where="stage")
    assert isinstance(spec, SynthesisSpec)
    return SynthesisStage(spec)


def run(
    made_by: SynthesisStage,
    known: UncertainModels | None = None,
    wider: UncertainModels | None = None,
) -> Synthesis:
    made = made_by.run(RecordingContext(), MODELS, known, wider)
    check_product(made)
    check_presentation(made_by.present(made, MODELS, known, wider))
    return made


def test_worst_cases_of_all_models_are_in_the_product() -> None:
    models = uncertain(0.3)
    made = run(stage({"uncertain": "u"}), models)
    assert made.search is not None
    robust = made.search.robust
    assert robust is not None
    assert robust.converged
    assert robust.labels == MODELS.labels
    assert made.plants[0].outputs == ("z", "effort", "y")
    assert made.gamma <= robust.worst.max() * (1.0 + 1e-9) <= made.gamma * 1.005
    assert robust.gammas[-1] == robust.worst.max()
    assert robust.plants[-1] == 0  # the unstable one
    assert_allclose(robust.values[-1], [-2.0], rtol=1e-9)  # at the bound, in its own unit
    for rate, worst in zip(RATES, robust.worst, strict=True):
        found = [
            hinf_norm(lower_lft(_known(rate + 0.3 * delta), made.controller)).value
            for delta in (-1.0, 0.0, 1.0)
        ]
        assert_allclose(max(found), worst, rtol=1e-6)
    nominal = run(stage())
    assert nominal.gamma < made.gamma


def _known(rate: float) -> LtiSystem:
    one = plant(rate, 0.0)
    return LtiSystem(one.a, one.b[:, 1:], one.c[1:], one.d[1:, 1:])


def test_each_plant_by_itself_is_no_worse() -> None:
    made = run(stage(per_plant=True))
    assert made.search is not None
    assert made.search.per_plant.shape == (2,)
    assert made.search.per_plant.max() <= made.gamma * (1.0 + 1e-6)
    norms = [hinf_norm(lower_lft(_known(rate), made.controller)).value for rate in RATES]
    assert_allclose(made.search.joint, norms, rtol=1e-6)
    assert (made.search.per_plant <= made.search.joint * (1.0 + 1e-6)).all()
    assert made.search.robust is None


def test_a_wider_uncertainty_decides_between_equals() -> None:
    wider = uncertain(0.4)
    made = run(stage({"wider": "w"}, starts=4, tie=0.2), None, wider)
    assert made.search is not None
    assert made.gamma <= made.search.starts.min() * 1.2
    equals = made.search.equals
    assert equals[0, 0] == pytest.approx(made.gamma, rel=1e-9)
    assert equals[0, 1] == equals[:, 1].min()
    assert (equals[:, 0] <= equals[:, 0].min() * 1.2).all()
    told = present_synthesis(made, None)
    assert [row["taken"] for row in told.tables["synthesis_equals"].rows] == [
        k == 0 for k in range(len(equals))
    ]


@pytest.mark.slow
def test_searches_begin_at_the_controller_of_another_synthesis() -> None:
    first = run(stage(starts=2))
    assert first.search is not None
    made_by = stage({"start": "s"}, starts=4, scatter=0.3)
    made = made_by.run(RecordingContext(), MODELS, start=first)
    assert made.search is not None
    assert made.search.scatter == 0.3
    assert made.search.starts.shape == (4,)
    assert made.search.starts[0] <= first.gamma * (1.0 + 1e-9)  # it begins there
    assert_allclose(made.search.starts, first.gamma, rtol=1e-3)
    shown = made_by.present(made, MODELS, start=first)
    check_presentation(shown)
    rows = shown.tables["synthesis_searches"].rows
    assert [row["begun"] for row in rows] == ["at the controller given", *["about it"] * 3]
    # Where they end is no evidence of a minimum that others would find.
    said = " ".join(shown.verdict)
    assert "within 30 % about one controller" in said
    assert "than 0.2 %" not in said
    assert "synthesis_spread" not in shown.metrics
    free_by = stage({"start": "s"}, starts=4, scatter=0)
    free = free_by.run(RecordingContext(), MODELS, start=first)
    assert free.search is not None
    assert free.search.starts[0] <= first.gamma * (1.0 + 1e-9)
    assert free.search.evaluations > made.search.evaluations  # whole searches, not polishing
    told = free_by.present(free, MODELS, start=first)
    rows = told.tables["synthesis_searches"].rows
    assert [row["begun"] for row in rows] == ["at the controller given", *["from a start"] * 3]
    assert "than 0.2 %" in " ".join(told.verdict)
    assert "synthesis_spread" in told.metrics
    robust = stage({"start": "s", "uncertain": "u"}, starts=3, scatter=0.3)
    designed = robust.run(RecordingContext(), MODELS, uncertain(0.3), start=first)
    assert designed.search is not None
    assert designed.search.robust is not None
    assert designed.search.robust.converged
    alone = run(stage({"uncertain": "u"}, starts=1), uncertain(0.3))
    assert designed.gamma == pytest.approx(alone.gamma, rel=1e-3)


def test_a_start_is_a_synthesis_of_the_same_structure() -> None:
    first = run(stage(starts=1))
    other = stage({"start": "s"}, parts=[{"kind": "free", "order": 1}])
    with pytest.raises(InputError, match=r"needs\.start: its controller, of order 0"):
        other.run(RecordingContext(), MODELS, start=first)
    assert first.search is not None
    moved = replace(first, search=replace(first.search, theta=1.1 * first.search.theta))
    with pytest.raises(InputError, match=r"needs\.start"):
        stage({"start": "s"}).run(RecordingContext(), MODELS, start=moved)


def test_searches_end_below_a_target() -> None:
    best = run(stage(starts=2))
    made = run(stage(starts=2, target=1.5 * best.gamma))
    assert made.search is not None
    assert best.search is not None
    assert best.gamma <= made.gamma < 1.5 * best.gamma
    assert made.search.evaluations < best.search.evaluations
    assert any("below the target" in sentence for sentence in present_synthesis(made, None).verdict)


def test_uncertainties_must_be_real_parameters() -> None:
    with pytest.raises(InputError, match=r"'decay' of .* is full"):
        run(stage({"uncertain": "u"}), uncertain(0.3, "full"))
    few = UncertainModels(uncertain(0.3).models, MODELS.labels, 2, 1)
    with pytest.raises(InputError, match="2 controls and 1 measurements"):
        run(stage({"uncertain": "u"}), few)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"method": "hinf", "needs": {"models": "m", "wider": "w"}}, "wider"),
        ({"method": "structured", "structured": {"parts": [{}]}, "plants": ["a"],
          "needs": {"models": "m", "uncertain": "u"}}, "uncertain models"),
        ({"method": "structured", "structured": {"parts": [{}], "bandwidth_rad_s": 0}}, "0"),
        ({"method": "structured", "structured": {"parts": [{}], "scatter": 0.2}}, "needs.start"),
        ({"method": "structured", "structured": {"parts": [{}], "effort": "much"}}, "effort"),
        ({"method": "structured", "structured": {"parts": [{}], "effort": 1000}}, "effort"),
        ({"method": "hinf", "needs": {"models": "m", "start": "s"}}, "start"),
    ],
)  # fmt: skip
def test_faults_are_found_first(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(SynthesisSpec, {"needs": {"models": "m"}} | keys, where="stage")


def test_mu_synthesis_without_noise_needs_a_regularisation() -> None:
    """The certified µ is that of the plant as it is, without the noise of the synthesis."""
    whole = plant(1.0, 0.3)
    quiet = LtiSystem(
        whole.a, whole.b[:, [0, 1, 3]], whole.c, whole.d[:, [0, 1, 3]], None, ("w", "d", "u"),
        ("v", "z", "effort", "y"),
    )  # fmt: skip
    inner = replace(
        quiet, b=quiet.b[:, 1:], c=quiet.c[1:], d=quiet.d[1:, 1:], inputs=("d", "u"),
        outputs=("z", "effort", "y"),
    )  # fmt: skip
    models = LinearModels(
        (inner,), ("one",), ("rate",), ("1/s",), np.array([[1.0]]), np.array([1.0]), 1, 1, ()
    )
    block = Uncertainty("decay", "real", lower=-1.0, nominal=0.0, upper=1.0)
    known = UncertainModels((uncertain_model(Lft(quiet, (block,), (1,)), {}),), ("one",), 1, 1)

    def made(start: Synthesis | None = None, **options: float) -> Synthesis:
        begun = {} if start is None else {"start": "s"}
        table = {
            "needs": {"models": "m", "uncertain": "u"} | begun,
            "method": "dk",
            "dk": {"iterations": 1, "joint_steps": 0, "highest_order": 1} | options,
        }
        spec = validate(SynthesisSpec, table, where="stage")
        assert isinstance(spec, SynthesisSpec)
        return SynthesisStage(spec).run(RecordingContext(), models, known, start=start)

    with pytest.raises(SingularProblemError, match="D21"):
        made()
    found = made(regularisation=1e-3)
    assert found.iterations is not None
    nominal = hinf_norm(lower_lft(inner, found.controller)).value
    assert nominal <= found.gamma * (1.0 + 1e-9)
    assert found.iterations.upper_mu == found.gamma
    assert found.gamma < 0.6  # z/d alone is 1 at rest without a controller
    # Beginning with a controller it ends no higher than this one is certified.
    again = made(found, iterations=0, regularisation=1e-3)
    assert again.gamma == pytest.approx(found.gamma, rel=5e-3)
    assert_allclose(again.controller.a, found.controller.a, rtol=1e-9, atol=1e-12)
