"""Spec of the stage ``synthesis``: keys of its table in a mission."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from hillsphere.errors import InputError
from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, need, option, quantity, rule
from hillsphere_controllers.stages.faults import require_one
from hillsphere_controllers.stages.linear_models.specs import (
    InterconnectionSpec,
    PerformanceSpec,
    ShelvingSpec,
)
from hillsphere_controllers.structured.effort import effort_number

__all__ = [
    "ChannelSpec", "DkSpec", "HinfSpec", "LmiSpec", "MixedSensitivitySpec", "PartSpec",
    "RegionSpec", "StructuredSpec", "SynthesisNeeds", "SynthesisSpec", "WeightSpec",
]  # fmt: skip


class HinfSpec(Spec):
    """Options of a full-order H∞ synthesis by Riccati equations."""

    examples: ClassVar[tuple[dict[str, Any], ...]] = ({"back_off": 0.01},)

    tolerance: float = option(
        "relative width at which the bisection of γ ends", default=1e-4, gt=0, lt=1
    )
    back_off: float = option(
        "by how much the controller's γ is larger than the least one, relative", default=0.005,
        gt=0, lt=1,
    )  # fmt: skip
    regularisation: float | None = option(
        "weight put on every control and noise put on every measurement, for the synthesis only; "
        "0: never; left out: chosen where the problem is singular or badly conditioned",
        default=None, ge=0,
    )  # fmt: skip


class WeightSpec(Spec):
    """A weight on every channel: by its gains, by the sensitivity that it asks for, or a number."""

    examples = ({"performance": {"bandwidth_rad_s": 0.05}}, {"gain": 0.1})

    shelving: ShelvingSpec | None = option(
        "a weight by its gains at low and high frequency", default=None
    )
    performance: PerformanceSpec | None = option(
        "a weight of the sensitivity by bandwidth, peak and steady error", default=None
    )
    gain: float | None = option("a constant weight", default=None, gt=0)

    @model_validator(mode="after")
    def _one(self) -> Self:
        keys = ("shelving", "performance", "gain")
        require_one([key for key in keys if getattr(self, key) is not None], keys, "gain")
        return self


class MixedSensitivitySpec(HinfSpec):
    """Weights of S, K S and T for models that are plants without weights."""

    examples = ({"w1": {"performance": {"bandwidth_rad_s": 1}}, "w2": {"gain": 0.1}},)

    w1: WeightSpec | None = option(
        "weight of the error, which S makes of the command", default=None
    )
    w2: WeightSpec | None = option("weight of the controls, K S", default=None)
    w3: WeightSpec | None = option("weight of the outputs, T", default=None)
    disturbance: float = option(
        "size of a disturbance at every control; keeps the controller from cancelling poles that "
        "are badly damped",
        default=0.0, ge=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.w1 is None and self.w2 is None and self.w3 is None:
            raise rule("w1", "at least one weight is needed")
        return self


class PartSpec(Spec):
    """Structure of a controller, or of one of the parts on its diagonal."""

    examples = (
        {"kind": "free", "order": 2},
        {"kind": "pid", "integral": False},
        {"kind": "transfer_function", "order": 3, "relative_degree": 1},
        {"kind": "entries", "order": 1, "entries": [[-1, "free"], ["free", 0]]},
    )

    kind: Literal["free", "pid", "transfer_function", "entries"] = option(
        "any controller of an order; PID, or a transfer function, of one control and one "
        "measurement; or some entries of [A B; C D] free and the others fixed",
        default="free",
    )
    order: int = option("number of states, but for a PID", default=0, ge=0, le=50)
    controls: int | None = option(
        "controls of a free part; left out: of a single part all, else one", default=None, ge=1
    )
    measurements: int | None = option(
        "measurements of a free part; left out: of a single part all, else one", default=None, ge=1
    )
    strictly_proper: bool = option("whether a free part has D = 0", default=False)
    integral: bool = option("whether a PID has integral action", default=True)
    derivative: bool = option("whether a PID has derivative action", default=True)
    relative_degree: int = option("relative degree of a transfer function", default=0, ge=0, le=50)
    entries: tuple[tuple[float | Literal["free"], ...], ...] = option(
        "[A B; C D] of a part of kind 'entries', row by row", default=()
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        own = {
            "free": {"order", "controls", "measurements", "strictly_proper"},
            "pid": {"integral", "derivative"},
            "transfer_function": {"order", "relative_degree"},
            "entries": {"order", "entries"},
        }[self.kind]
        for key in sorted(self.model_fields_set - own - {"kind"}):
            raise rule(key, f"does not belong to a part of kind {self.kind!r}; leave it out")
        if self.kind == "transfer_function":
            if self.order < 1:
                raise rule("order", "a transfer function needs an order of at least 1")
            if self.relative_degree > self.order:
                raise rule("relative_degree", f"must not be above the order, {self.order}")
        if self.kind == "entries":
            lengths = {len(row) for row in self.entries}
            if len(lengths) != 1 or min(len(self.entries), *lengths) <= self.order:
                raise rule(
                    "entries", "must be rows of one length, more of both than the order's states"
                )
            if not any(entry == "free" for row in self.entries for entry in row):
                raise rule("entries", "no entry is 'free'")
        return self


class ChannelSpec(Spec):
    """Part of the transfer matrix from disturbances to weighted signals."""

    examples = ({"outputs": ["z_error"], "inputs": ["r"], "weight": 2},)

    outputs: tuple[str, ...] = option("which outputs of the models; left out: all", default=())
    inputs: tuple[str, ...] = option("which inputs of the models; left out: all", default=())
    norm: Literal["hinf", "h2"] = option("norm of the channel", default="hinf")
    weight: float = option("factor of the norm", default=1.0, gt=0)
    limit: float | None = option(
        "the weighted norm is only to stay below this; left out: as small as possible",
        default=None, gt=0,
    )  # fmt: skip


class RegionSpec(Spec):
    """Where the poles of all closed loops are to be."""

    examples = ({"decay_1_s": 0.1, "damping": 0.3, "fastest_rad_s": 100},)

    decay_1_s: float = option("real parts at most minus this, 1/s", default=0.0, ge=0)
    damping: float = option("damping at least", default=0.0, ge=0, lt=1)
    fastest_rad_s: float | None = quantity(
        "angular_rate", "sizes at most; left out: any", default=None, gt=0
    )


class LmiSpec(Spec):
    """Options of a full-order synthesis by linear matrix inequalities, for up to 20 states."""

    examples = (
        {"channels": [{"outputs": ["z_error"]}, {"norm": "h2", "limit": 3}],
         "region": {"decay_1_s": 0.1}},
    )  # fmt: skip

    channels: tuple[ChannelSpec, ...] = option(
        "what is to be small: the largest of these; left out: all outputs of all inputs", default=()
    )
    region: RegionSpec | None = option("region of the closed loop's poles", default=None)


class StructuredSpec(Spec):
    """Options of a synthesis of fixed structure for one or many plants."""

    examples = (
        {"parts": [{"kind": "free", "order": 1}], "starts": 3},
        {"parts": [{"kind": "pid"}], "starts": 2, "largest_gain": 100,
         "region": {"damping": 0.2}, "channels": [{"outputs": ["z_error"]}]},
        {"parts": [{"kind": "free", "order": 1}], "starts": 1, "controller_stable": True,
         "bandwidth_rad_s": 1, "shaken": False, "per_plant": True, "target": 0.9,
         "effort": "quick"},
    )  # fmt: skip

    parts: tuple[PartSpec, ...] = option(
        "the controller; several are on its diagonal, each with measurements and controls of its "
        "own, in their order",
        min_length=1,
    )
    channels: tuple[ChannelSpec, ...] = option(
        "what is to be small: the largest of these; left out: all outputs of all inputs", default=()
    )
    starts: int = option("how many searches, from different controllers", default=10, ge=1, le=1000)
    effort: Literal["quick", "normal", "thorough"] | float = option(
        "how many searches follow by other routes (homotopies, release of a gain bound), in units "
        "of starts: 'quick' 0, 'normal' 1, 'thorough' 5, or a number from 0 to 100",
        default="normal",
    )
    scatter: float = option(
        "with needs.start: how far from that controller the searches after the first begin, "
        "relative to its scaled parameters; what they find then says nothing of other minima; 0: "
        "only the first begins there, the others as without needs.start",
        default=0.01, ge=0, le=1,
    )  # fmt: skip
    target: float = option(
        "a search ends once its γ is below this, though it might fall further; 0: none does",
        default=0.0, ge=0,
    )  # fmt: skip
    largest_gain: float | None = option(
        "largest Frobenius norm of [A B; C D]; some plants have their infimum at infinite gain",
        default=None, gt=0,
    )  # fmt: skip
    region: RegionSpec | None = option("region of the closed loops' poles", default=None)
    controller_stable: bool = option("whether the controller itself is to be stable", default=False)
    alike: bool = option(
        "whether the parts, all of one kind, are about the same: random searches first vary them "
        "together",
        default=False,
    )
    bandwidth_rad_s: float | None = quantity(
        "angular_rate",
        "about the bandwidth expected, the scale of the search; left out: by the plants' poles, "
        "those of weights among them",
        default=None, gt=0,
    )  # fmt: skip
    shaken: bool = option("whether searches near the best controllers follow", default=True)
    tie: float = option(
        "designs whose γ differ by no more, relative, are equal, with needs.wider", default=1e-3,
        gt=0, lt=1,
    )  # fmt: skip
    rounds: int = option("with needs.uncertain: designs at most", default=10, ge=1, le=100)
    per_plant: bool = option(
        "whether γ is shown too that the structure reaches for each plant by itself, by searches "
        "near the controller of all",
        default=False,
    )
    plant_weights: tuple[float, ...] = option(
        "what all norms of each plant are multiplied with, in their order; left out: 1",
        default=(), gt=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _check_effort(self) -> Self:
        try:
            effort_number(self.effort)
        except InputError as error:
            raise rule("effort", str(error)) from error
        return self


class DkSpec(Spec):
    """Options of µ synthesis by D–K (for real parameters D,G–K) iteration."""

    examples = (
        {"iterations": 4, "highest_order": 3, "joint_steps": 0},
        {"iterations": 2, "regularisation": 1e-4},
    )

    iterations: int = option("largest number of steps after the first", default=10, ge=0, le=100)
    highest_order: int = option("highest order of the scaling of one block", default=4, ge=0, le=12)
    joint_steps: int = option(
        "steps of each joint move of scalings and controller, where alternation stalls; 0: none",
        default=6, ge=0, le=100,
    )  # fmt: skip
    target: float = option("ends once µ is certified to be below", default=0.0, ge=0)
    gap: float = option(
        "by how much certified bounds are above the largest found at one frequency, relative",
        default=2e-3, ge=1e-6, lt=1,
    )  # fmt: skip
    back_off: float = option(
        "relative distance of γ above the least one in the H∞ synthesis of each step, see 'hinf'",
        default=0.002,
        gt=0,
        lt=1,
    )
    regularisation: float = option(
        "regularisation of the H∞ synthesis in each step, see 'hinf': for measurements without "
        "noise and controls without weight; µ is certified of the plant as it is",
        default=0.0, ge=0,
    )  # fmt: skip
    reduction: float = option(
        "by how much µ may be higher for a controller with fewer states, relative; that "
        "controller is then taken; 0: none is looked for",
        default=0.0, ge=0, lt=1,
    )  # fmt: skip


class SynthesisNeeds(Spec):
    """Products of earlier stages that ``synthesis`` takes."""

    models: Ref = need(
        "hillsphere_controllers.linear_products:LinearModels",
        "plants that the controller is made for",
    )
    uncertain: Ref | None = need(
        "hillsphere_controllers.linear_products:UncertainModels",
        "for the method 'dk': the uncertain model of these plants; for 'structured': any number, "
        "for whose worst cases the controller is made",
        default=None,
    )
    wider: Ref | None = need(
        "hillsphere_controllers.linear_products:UncertainModels",
        "for the method 'structured': a wider uncertainty; between designs of equal γ its worst "
        "case decides",
        default=None,
    )
    start: Ref | None = need(
        "hillsphere_controllers.stages.synthesis.products:Synthesis",
        "for the method 'structured': a synthesis of the same structure, at whose controller the "
        "first search begins, the others about it; for 'dk': a synthesis with whose controller it "
        "begins, which spares it the search for first scalings",
        default=None,
    )


class SynthesisSpec(StageSpec):
    """A controller of linear models, checked on all of them."""

    results = ResultNames(
        metrics=(
            "synthesis_gamma",
            "synthesis_order",
            "synthesis_models_stable",
            "synthesis_lower_bound",
            "synthesis_residual",
            "synthesis_spread",
            "synthesis_gap",
            "synthesis_routes_agreeing",
            "synthesis_worst_gamma",
        ),
        tables={
            "synthesis_loops": (),
            "synthesis_margins": (),
            "synthesis_controller": (),
            "synthesis_searches": (),
            "synthesis_routes": (),
            "synthesis_equals": (),
            "synthesis_worst": (),
            "synthesis_scenarios": (),
            "synthesis_own": (),
            "synthesis_iterations": (),
        },
    )
    produces = "hillsphere_controllers.stages.synthesis.products:Synthesis"
    provides = ("hillsphere.products:ControlDesign",)
    examples = (
        {"needs": {"models": "models"}, "method": "hinf", "plants": ["rate=1"]},
        {
            "needs": {"models": "models"},
            "method": "structured",
            "structured": StructuredSpec.examples[0],
        },
        {
            "needs": {"models": "models", "start": "before"},
            "method": "structured",
            "structured": {"parts": [{"kind": "free", "order": 1}], "scatter": 0.3},
        },
        {
            "needs": {"models": "models"},
            "method": "given",
            "given": {
                "systems": [
                    {"numerator": [2, 1], "denominator": [1, 0.01], "inputs": ["e"],
                     "outputs": ["u"]}
                ],
                "inputs": ["e"],
                "outputs": ["u"],
            },
        },
    )  # fmt: skip

    needs: SynthesisNeeds = option("products of earlier stages")
    method: Literal["hinf", "h2", "mixed_sensitivity", "lmi", "structured", "dk", "given"] = option(
        "full-order H∞ or H2; full-order H∞ with weights on S, K S and T; matrix "
        "inequalities for several norms and a pole region; a fixed structure for "
        "one or many plants; µ synthesis; or a controller that the mission gives, to be checked"
    )
    plants: tuple[str, ...] = option(
        "names of the models that the controller is made for; left out: all for 'structured', "
        "else the one nearest to nominal",
        default=(),
    )
    outputs: tuple[str, ...] = option(
        "outputs of the models that are to be small; left out: all, for 'dk' those of performance",
        default=(),
    )
    inputs: tuple[str, ...] = option(
        "inputs of the models that disturb; left out: all, for 'dk' those of performance",
        default=(),
    )
    hinf: HinfSpec | None = option("options of the method 'hinf'", default=None)
    mixed_sensitivity: MixedSensitivitySpec | None = option(
        "weights and options of the method 'mixed_sensitivity'", default=None
    )
    structured: StructuredSpec | None = option(
        "structure and options of the method 'structured'", default=None
    )
    lmi: LmiSpec | None = option("requirements of the method 'lmi'", default=None)
    dk: DkSpec | None = option("options of the method 'dk'", default=None)
    given: InterconnectionSpec | None = option(
        "the controller of the method 'given', its inputs the measurements", default=None
    )
    step_duration_s: float | None = quantity(
        "time", "length of the step responses shown; left out: until they have settled",
        default=None, gt=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _of_its_method(self) -> Self:
        tables = ("hinf", "mixed_sensitivity", "lmi", "structured", "dk", "given")
        for key in tables:
            if key != self.method and getattr(self, key) is not None:
                raise rule(key, f"does not belong to method = {self.method!r}; leave it out")
        required = self.method in ("mixed_sensitivity", "structured", "given")
        if required and getattr(self, self.method) is None:
            raise rule("method", f"{self.method!r} needs a table of that name")
        uncertain = self.needs.uncertain is not None
        if self.method == "dk" and not uncertain:
            raise rule("needs", "uncertain: the method 'dk' needs one")
        if uncertain and self.method not in ("dk", "structured"):
            raise rule("needs", f"uncertain: the method {self.method!r} takes none; leave it out")
        if self.needs.wider is not None and self.method != "structured":
            raise rule("needs", f"wider: the method {self.method!r} takes none; leave it out")
        if self.needs.start is not None and self.method not in ("structured", "dk"):
            raise rule("needs", f"start: the method {self.method!r} takes none; leave it out")
        if (
            self.structured is not None
            and "scatter" in self.structured.model_fields_set
            and self.needs.start is None
        ):
            raise rule("structured", "scatter: there is no needs.start; leave it out")
        if self.plants and uncertain:
            raise rule("plants", "the controller is made for the uncertain models; leave it out")
        if len(self.plants) > 1 and self.method in ("hinf", "h2", "mixed_sensitivity", "lmi"):
            raise rule("plants", f"{self.method!r} makes a controller for one plant; name one")
        if self.structured is not None and self.structured.plant_weights and self.plants:
            count = len(self.structured.plant_weights)
            if count != len(self.plants):
                raise rule("structured", f"{count} plant_weights for {len(self.plants)} plants")
        return self
