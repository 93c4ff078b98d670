"""The stage ``synthesis`` with a fixed structure for uncertain plants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.linear_products import LinearModels, UncertainModels
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.lft.transformation import Lft
from hillsphere_controllers.lft.uncertainties import Uncertainty
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
        "structured": {"parts": [{"kind": "free"}], "starts": 1, "shaken": False} | options,
    }
    spec = validate(SynthesisSpec, table, where="stage")
    assert isinstance(spec, SynthesisSpec)
    return SynthesisStage(spec)


def run(made_by: SynthesisStage, *needs: UncertainModels | None) -> Synthesis:
    made = made_by.run(RecordingContext(), MODELS, *needs)
    check_product(made)
    check_presentation(made_by.present(made, MODELS, *needs))
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
    assert made.search.robust is None


def test_a_wider_uncertainty_decides_between_equals() -> None:
    made = run(stage({"wider": "w"}, starts=1, tie=1e-3), None, uncertain(0.4))
    assert made.search is not None
    assert made.gamma <= made.search.starts.min() * (1.0 + 2e-3)


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
    ],
)  # fmt: skip
def test_faults_are_found_first(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(SynthesisSpec, {"needs": {"models": "m"}} | keys, where="stage")
