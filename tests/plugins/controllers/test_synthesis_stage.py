"""The stage ``synthesis``: each method's controller is what the method itself makes, and judged."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError, Interrupted
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.products.product_codec import load_product
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.full_order.mixed_sensitivity import mixed_sensitivity
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.linear_products import LinearModels, UncertainModels
from hillsphere_controllers.stages.linear_models.specs import LinearModelsSpec
from hillsphere_controllers.stages.linear_models.stage import LinearModelsStage
from hillsphere_controllers.stages.step_responses import step_responses
from hillsphere_controllers.stages.synthesis.presentation import present_synthesis
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.stages.synthesis.specs import SynthesisSpec
from hillsphere_controllers.stages.synthesis.stage import SynthesisStage
from hillsphere_controllers.stages.uncertain import uncertain_model
from hillsphere_controllers.systems.algebra import feedback, gain, lower_lft
from hillsphere_controllers.systems.weights import performance_weight

PERFORMANCE = {"performance": {"bandwidth_rad_s": 1.0, "steady_error": 0.01}}


def first_order(rate: float) -> LtiSystem:
    """Return ẋ = −rate x + d + u with z = (x, 0.1 u), y = x + 0.1 n."""
    return LtiSystem(
        np.array([[-rate]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.1, 0.0]]),
        None,
        ("d", "n", "u"),
        ("z", "effort", "y"),
    )


def models(*rates: float) -> LinearModels:
    return LinearModels(
        tuple(first_order(rate) for rate in rates), tuple(f"rate={rate:g}" for rate in rates),
        ("rate",), ("1/s",), np.array([rates]), np.array([1.0]), 1, 1, (),
    )  # fmt: skip


def bare(*rates: float) -> LinearModels:
    """Return 1/(s + rate) without weights."""
    one = np.ones((1, 1))
    systems = tuple(LtiSystem(-rate * one, one, one, 0.0 * one) for rate in rates)
    return LinearModels(
        systems, tuple(f"rate={rate:g}" for rate in rates), ("rate",), ("1/s",),
        np.array([rates]), np.array([1.0]), 1, 1, (),
    )  # fmt: skip


MODELS = models(-0.5, 1.0, 2.0)


def stage(method: str, **keys: Any) -> SynthesisStage:
    table = {"needs": {"models": "models"}, "method": method} | keys
    spec = validate(SynthesisSpec, table, where="stage")
    assert isinstance(spec, SynthesisSpec)
    return SynthesisStage(spec)


def run(method: str, product: LinearModels = MODELS, **keys: Any) -> Synthesis:
    one = stage(method, **keys)
    made = one.run(RecordingContext(), product)
    check_product(made)
    check_presentation(one.present(made, product))
    return made


def test_hinf_is_made_for_the_model_nearest_to_nominal_and_judged_on_all() -> None:
    made = run("hinf")
    assert made.designed.tolist() == [False, True, False]
    design = hinf_synthesis(first_order(1.0), 1, 1)
    assert made.gamma == pytest.approx(design.gamma, rel=1e-12)
    assert made.lower_bound == design.least < made.gamma
    for k, plant in enumerate(MODELS.systems):
        loop = lower_lft(plant, made.controller)
        assert made.judged.abscissa_1_s[k] == pytest.approx(loop.poles.real.max(), rel=1e-9)
        gains = np.linalg.norm(loop.response(np.logspace(-3, 3, 2000)), 2, axis=(1, 2))
        # the norm of one that is not stable is infinite, whatever its gains
        expected = gains.max() if loop.is_stable else np.inf
        assert made.judged.hinf[k] == pytest.approx(expected, rel=1e-5)
    assert_allclose(made.judged.sampled[1:], made.judged.hinf[1:], rtol=1e-3)


def test_a_model_may_be_named() -> None:
    made = run("hinf", plants=["rate=-0.5"])
    assert made.designed.tolist() == [True, False, False]
    assert np.isfinite(made.judged.hinf[0])


def test_what_is_to_be_small_may_be_named() -> None:
    table = {
        "systems": [{"d": [[-2]], "inputs": ["y"], "outputs": ["u"]}],
        "inputs": ["y"],
        "outputs": ["u"],
    }
    made = run("given", given=table, outputs=["z"], inputs=["d"], plants=["rate=1"])
    # z/d = 1/(s + 3)
    assert made.gamma == pytest.approx(1.0 / 3.0, rel=1e-9)
    with pytest.raises(InputError, match=r"outputs: no signal 'y'"):
        run("given", given=table, outputs=["y"])


def test_h2_is_the_least() -> None:
    made, other = run("h2"), run("hinf")
    assert made.norm == "h2"
    assert made.gamma == pytest.approx(made.judged.h2[1], rel=1e-9)
    assert made.gamma < other.judged.h2[1]


def test_mixed_sensitivity_weighs_plants_that_have_no_weights() -> None:
    table = {"w1": PERFORMANCE, "w2": {"gain": 0.1}}
    made = run("mixed_sensitivity", bare(1.0, 2.0), mixed_sensitivity=table)
    one = np.ones((1, 1))
    plant = LtiSystem(-one, one, one, 0.0 * one)
    design = mixed_sensitivity(plant, performance_weight(1.0, steady_error=0.01), 0.1)
    assert made.gamma == pytest.approx(design.gamma, rel=1e-9)
    assert [weight.inputs for weight in made.weights] == [("e",), ("u",)]


def test_structured_serves_all_models_and_is_bounded_by_full_order() -> None:
    table = {"parts": [{"kind": "pid", "integral": False}], "starts": 2}
    made = run("structured", structured=table)
    assert made.designed.all()
    assert made.search is not None
    assert made.search.starts.shape == (2,)
    assert 1 <= len(made.others) <= 2
    assert {one.shape for one in made.others} == {made.controller.shape}
    assert made.lower_bound <= made.gamma == pytest.approx(made.judged.hinf.max(), rel=1e-9)
    assert made.controller.order == 1
    # the verdict in the table, the metrics and the words of the report, from one declaration
    verdict = made.search.verdict
    shown = present_synthesis(made, None)
    rows = shown.tables["synthesis_routes"].rows
    assert [row["routes"] for row in rows] == list(verdict.routes)
    # γ reaches the bound from the starts already: no other route is needed
    assert (verdict.kind, [row["searches"] for row in rows][:2]) == ("best", [2, 0])
    assert shown.metrics["synthesis_routes_agreeing"].value == len(verdict.arrived)
    assert shown.metrics["synthesis_gap"].value == pytest.approx(
        made.gamma / made.lower_bound - 1.0
    )
    for sentence in verdict.sentences:
        assert sentence in shown.verdict
        assert sentence in shown.tables["synthesis_routes"].notes
    assert f"proved lower bound of controllers of any order, {made.lower_bound:.6g}" in str(verdict)


def test_verdict_counts_the_best_wherever_it_was_found_and_says_what_holds_it() -> None:
    table = {"parts": [{"kind": "free"}], "starts": 1, "effort": "quick"}
    made = run("structured", structured=table, plants=["rate=1"])
    found = made.search
    assert found is not None

    def said(residual: float, converged: bool) -> str:
        search = replace(
            found, starts=np.array([1.3, np.inf]), shaken=np.array([1.2]),
            residual=residual, converged=converged,
        )  # fmt: skip
        return " ".join(present_synthesis(replace(made, search=search, gamma=1.2), None).verdict)

    assert "1 of 3 searches, 2 from starts and 1 from near" in said(1e-4, True)
    assert "By its gradients the result is a local minimum (residual 0.0001" in said(1e-4, True)
    assert "over a range of frequencies" not in said(1e-4, True)
    assert "not shown to be a local minimum (residual 5.4" in said(5.4, False)
    assert "over a range of frequencies" in said(5.4, False)


def test_noise_of_navigation_in_a_structured_design() -> None:
    """A weighted disturbance and coloured noise of the measurement: more noise, less gain.

    For static feedback of ẋ = d + u, y = x + n, n with deviation σ and time τ = 1/a:
    u = −k y gives var x = D²/(2k) + σ² k/(k + a) for white d of intensity D², least at
    k = a/(σ √(2a)/D − 1).
    """
    intensity, a = 0.2, 0.1
    gains = []
    for deviation in (0.7, 2.0):
        table = {
            "systems": [
                {"a": [[0]], "b": [[intensity, 1]], "c": [[1]], "inputs": ["d", "u"],
                 "outputs": ["x"]},
                {"gauss_markov": {"deviation": deviation, "correlation_time_s": 10},
                 "inputs": ["w"], "outputs": ["n"]},
            ],
            "junctions": ["y = x + n"],
            "inputs": ["d", "w"], "outputs": ["x"], "controls": ["u"], "measurements": ["y"],
        }  # fmt: skip
        spec = validate(LinearModelsSpec, table, where="stage")
        assert isinstance(spec, LinearModelsSpec)
        noisy = LinearModelsStage(spec).run(RecordingContext())
        options = {"parts": [{"kind": "free"}], "starts": 2, "shaken": False, "effort": "quick",
                   "channels": [{"outputs": ["x"], "norm": "h2"}]}  # fmt: skip
        made = run("structured", noisy, structured=options)
        k = -float(made.controller.d[0, 0])
        best = a / (deviation * np.sqrt(2.0 * a) / intensity - 1.0)
        variance = intensity**2 / (2.0 * best) + deviation**2 * best / (best + a)
        assert made.gamma == pytest.approx(np.sqrt(variance), rel=1e-9)
        assert k == pytest.approx(best, rel=1e-3)
        gains.append(k)
    assert gains[1] < 0.2 * gains[0]


def test_structured_channels_are_named_by_their_signals() -> None:
    channels = [{"outputs": ["z"], "inputs": ["d"]}, {"outputs": ["effort"], "limit": 0.5}]
    table = {"parts": [{"kind": "free"}], "starts": 1, "channels": channels, "effort": "quick"}
    made = run("structured", structured=table, plants=["rate=1"])
    loop = lower_lft(first_order(1.0), made.controller)
    peak = np.abs(loop.response(np.zeros(1))[0, 0, 0])
    assert made.gamma == pytest.approx(peak, rel=1e-6)
    effort = np.linalg.norm(loop.response(np.logspace(-4, 4, 4000))[:, 1], axis=1)
    # more gain would lower the first further: the limit of the second holds it
    assert effort.max() == pytest.approx(0.5, rel=1e-3)


def test_matrix_inequalities_keep_limits_and_regions() -> None:
    channels = [{"outputs": ["z"]}, {"outputs": ["effort"], "norm": "h2", "limit": 0.3}]
    made = run("lmi", lmi={"channels": channels, "region": {"decay_1_s": 0.8}})
    loop = lower_lft(first_order(1.0), made.controller)
    assert made.judged.abscissa_1_s[1] <= -0.8
    gains = np.linalg.norm(loop.response(np.logspace(-3, 3, 2000))[:, 0], axis=1)
    assert gains.max() == pytest.approx(made.gamma, rel=1e-5)
    effort = LtiSystem(loop.a, loop.b, loop.c[1:2], loop.d[1:2])
    assert h2_norm(effort) <= 0.3 * (1.0 + 1e-6)


def test_entries_stay_as_they_are_fixed() -> None:
    table = {
        "parts": [{"kind": "entries", "order": 1, "entries": [[-3, 1], ["free", "free"]]}],
        "starts": 1,
    }
    made = run("structured", structured=table, plants=["rate=1"])
    assert_allclose(made.controller.a, [[-3.0]], rtol=0.0)
    assert_allclose(made.controller.b, [[1.0]], rtol=0.0)


def test_given_controllers_are_judged() -> None:
    table = {
        "systems": [{"d": [[-2]], "inputs": ["y"], "outputs": ["u"]}],
        "inputs": ["y"],
        "outputs": ["u"],
    }
    made = run("given", given=table)
    assert made.lower_bound == 0.0
    assert_allclose(made.judged.abscissa_1_s, [-1.5, -3.0, -4.0], rtol=1e-12)
    # L = 2/(s + rate): |L| = 1 at sqrt(4 − rate²)
    crossing = np.sqrt(4.0 - 1.0)
    phase = np.pi - np.arctan(crossing)
    assert_allclose(made.judged.phase_rad[:, 1], phase, rtol=1e-9)
    assert_allclose(made.judged.delay_s[:, 1], phase / crossing, rtol=1e-9)
    # stable for a gain above rate/2 where the plant is not
    assert_allclose(made.judged.gain_lower[:, 0], 0.25, rtol=1e-9)


def test_steps_settle_at_their_end() -> None:
    one = np.ones((1, 1))
    loop = feedback(LtiSystem(-one, one, 4.0 * one, 0.0 * one), gain(one))
    times, (response,) = step_responses([loop])
    assert_allclose(response[:, 0, 0], 0.8 * (1.0 - np.exp(-5.0 * times)), rtol=0, atol=1e-12)
    assert 0.9 < times[-1] < 3.0


class Stopped(RecordingContext):
    """A run that is stopped after so many searches, or steps."""

    def __init__(self, workspace: Path, left: int) -> None:
        super().__init__(workspace=workspace)
        self.left, self.notes = left, list[str]()

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        def advance(count: int) -> None:
            self.left -= count
            if note is not None:
                self.notes.append(note())
            if not self.left:
                raise Interrupted("stopped")

        return advance


@pytest.mark.slow
def test_an_interrupted_search_leaves_its_best_and_goes_on_from_there(tmp_path: Path) -> None:
    table = {"parts": [{"kind": "free"}], "starts": 3}
    one = stage("structured", structured=table)
    whole = one.run(RecordingContext(), MODELS)
    assert whole.search is not None
    ctx = Stopped(tmp_path, 2)
    with pytest.raises(Interrupted) as stopped:
        one.run(ctx, MODELS)
    assert re.search(r"has γ = 0\.\d+ \(2 searches\) and is stored in ", stopped.value.kept)
    assert stopped.value.kept in ctx.messages[-1]
    assert sum("best γ = " in message for message in ctx.messages[:-1]) == 2
    assert any(re.match(r"search 2 of 3 at γ = .*, best γ = ", note) for note in ctx.notes)
    best = load_product(tmp_path / "best-controller.npz")
    assert all(lower_lft(plant, best).is_stable for plant in MODELS.systems)
    again = one.run(RecordingContext(workspace=tmp_path), MODELS)
    assert again.search is not None
    assert again.gamma == whole.gamma
    assert again.search.starts.tobytes() == whole.search.starts.tobytes()
    assert again.search.theta.tobytes() == whole.search.theta.tobytes()


@pytest.mark.parametrize(
    ("method", "keys", "said"),
    [
        ("structured", {}, "needs a table"),
        ("hinf", {"structured": {"parts": [{}]}}, "does not belong to method"),
        ("hinf", {"plants": ["rate=1", "rate=2"]}, "one plant"),
        ("mixed_sensitivity", {"mixed_sensitivity": {}}, "at least one weight"),
        ("dk", {}, "needs one"),
        ("dk", {"needs": {"models": "m", "uncertain": "u"}, "plants": ["a"]}, "leave it out"),
        ("hinf", {"needs": {"models": "m", "uncertain": "u"}}, "takes none"),
        ("mixed_sensitivity", {"mixed_sensitivity": {"w1": {}}}, "just one of"),
        ("structured", {"structured": {"parts": [{"kind": "pid", "order": 2}]}}, "kind 'pid'"),
        ("structured",
         {"structured": {"parts": [{"kind": "entries", "entries": [[1]]}]}}, "'free'"),
        ("structured",
         {"structured": {"parts": [{"kind": "transfer_function"}]}}, "at least 1"),
    ],
)  # fmt: skip
def test_faults_are_found_before_anything_runs(
    method: str, keys: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        stage(method, **keys)


@pytest.mark.parametrize(
    ("method", "keys", "said"),
    [
        ("hinf", {"plants": ["rate=3"]}, "no model 'rate=3'"),
        ("structured", {"structured": {"parts": [{}, {}]}}, "2 controls"),
        ("structured", {"structured": {"parts": [{}], "channels": [{"outputs": ["x"]}]}},
         r"channels\[0\].*no signal 'x'"),
        ("structured", {"structured": {"parts": [{}], "plant_weights": [1, 2]}},
         "2 for 3 plants"),
        ("given", {"given": {"systems": [{"d": [[1, 2]], "inputs": ["a", "b"],
                                          "outputs": ["u"]}],
                             "inputs": ["a", "b"], "outputs": ["u"]}}, "2 measurements"),
    ],
)  # fmt: skip
def test_faults_of_models_are_said(method: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        stage(method, **keys).run(RecordingContext(), MODELS)


def test_iteration_lowers_mu_and_says_its_steps(tmp_path: Path) -> None:
    # the gain of the plant from u is not known to 40 %
    plants = tuple(
        LtiSystem(
            one.a, np.hstack([0.4 * one.b[:, 2:], one.b]),
            np.vstack([np.zeros((1, 1)), one.c]),
            np.block([[np.zeros((1, 3)), np.ones((1, 1))], [np.zeros((3, 1)), one.d]]), None,
            ("w", *one.inputs), ("v", *one.outputs),
        )
        for one in MODELS.systems[1:2]
    )  # fmt: skip
    nominal = LinearModels(plants, ("nominal",), (), (), np.zeros((0, 1)), np.zeros(0), 1, 1, ())
    gain_block = Uncertainty("gain", "full", dynamic=True)
    whole = uncertain_model(Lft(plants[0], (gain_block,), (1,)), {})
    known = UncertainModels((whole,), ("uncertain",), 1, 1)
    table = {"needs": {"models": "m", "uncertain": "u"}, "dk": {"iterations": 2, "joint_steps": 0}}
    one = stage("dk", **table)
    ctx = RecordingContext()
    made = one.run(ctx, nominal, known)
    check_product(made)
    check_presentation(one.present(made, nominal, known))
    found = made.iterations
    assert found is not None
    assert made.norm == "mu"
    assert made.plants[0].outputs == ("z", "effort", "y")
    assert found.lower_mu <= found.upper_mu == made.gamma
    assert made.gamma == pytest.approx(found.upper[found.accepted].min(), rel=5e-3)
    assert len(ctx.messages) == found.upper.size
    with pytest.raises(Interrupted) as stopped:
        one.run(Stopped(tmp_path, 2), nominal, known)
    assert re.search(r"has µ ≤ [\d.]+ \(2 steps\) and is stored in ", stopped.value.kept)
    assert load_product(tmp_path / "best-controller.npz").shape == (1, 1)
    again = one.run(RecordingContext(workspace=tmp_path), nominal, known)
    assert again.iterations is not None
    assert again.controller.a.tobytes() == made.controller.a.tobytes()
    assert again.iterations.upper.tobytes() == found.upper.tobytes()
    with pytest.raises(InputError, match="one uncertain model, got 2"):
        one.run(ctx, nominal, UncertainModels((whole, whole), ("a", "b"), 1, 1))


def test_models_need_controls() -> None:
    closed = LinearModels(
        MODELS.systems, MODELS.labels, MODELS.parameters, MODELS.units, MODELS.values,
        MODELS.nominal, 0, 0, (),
    )  # fmt: skip
    with pytest.raises(InputError, match="no controls"):
        stage("hinf").run(RecordingContext(), closed)
