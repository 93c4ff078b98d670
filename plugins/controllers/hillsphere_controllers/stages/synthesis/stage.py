"""The stage ``synthesis``: a controller for linear models, evaluated on all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError
from hillsphere.interfaces import Context
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere_controllers.full_order.mixed_sensitivity import mixed_sensitivity_plant
from hillsphere_controllers.linear_products import LinearModels, UncertainModel, UncertainModels
from hillsphere_controllers.stages.linear_models.systems import (
    build_performance_weight,
    build_shelving_weight,
)
from hillsphere_controllers.stages.synthesis.evaluation import evaluate_controller
from hillsphere_controllers.stages.synthesis.fixed_structure import synthesise_fixed_structure
from hillsphere_controllers.stages.synthesis.iteration import synthesise_by_dk
from hillsphere_controllers.stages.synthesis.methods import design_controller
from hillsphere_controllers.stages.synthesis.plants import restrict_channels
from hillsphere_controllers.stages.synthesis.presentation import present_synthesis
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.stages.synthesis.specs import (
    DkSpec,
    MixedSensitivitySpec,
    SynthesisSpec,
    WeightSpec,
)
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.interconnection import with_names
from hillsphere_controllers.systems.weights import on_every_channel

__all__ = ["SynthesisStage"]


class SynthesisStage:
    """A controller of linear models.

    Parameters
    ----------
    spec : SynthesisSpec
        Method and options.
    """

    def __init__(self, spec: SynthesisSpec) -> None:
        self.spec = spec

    def run(
        self,
        ctx: Context,
        models: LinearModels,
        uncertain: UncertainModels | None = None,
        wider: UncertainModels | None = None,
        start: Synthesis | None = None,
    ) -> Synthesis:
        """Make the controller, and judge it on all models.

        Parameters
        ----------
        ctx : Context
            Progress, seeds, workers.
        models : LinearModels
            Generalised plants; for the method ``"mixed_sensitivity"`` plants without weights.
        uncertain : UncertainModels or None
            For the method ``"dk"``: one uncertain model of them; for ``"structured"``: any number,
            for whose worst cases the controller is made.
        wider : UncertainModels or None
            For the method ``"structured"``: their worst case decides between designs of equal γ.
        start : Synthesis or None
            For the method ``"structured"``: where its searches begin; for ``"dk"``: with whose
            controller it begins.

        Returns
        -------
        Synthesis
            The controller; every γ is computed from the closed loops.

        Raises
        ------
        InputError
            If the models have no controls, or a name or a size does not fit.
        HillsphereError
            Errors of the method.
        """
        spec = self.spec
        plants, weights = list(models.systems), models.weights
        controls, measurements = models.controls, models.measurements
        if spec.mixed_sensitivity is not None:
            plants, weights = _apply_weights(plants, spec.mixed_sensitivity)
            measurements, controls = models.systems[0].shape
        elif not (controls and measurements):
            raise InputError(
                "the models have no controls and measurements; name them in the stage that makes "
                "the models"
            )
        outputs, inputs = spec.outputs, spec.inputs
        if uncertain is not None:
            own_outputs, own_inputs = _performance(uncertain, controls, measurements)
            outputs, inputs = outputs or own_outputs, inputs or own_inputs
        plants = [restrict_channels(one, outputs, inputs, controls, measurements) for one in plants]
        seen = set(plants[0].outputs)
        weights = tuple(one for one in weights if set(one.outputs) <= seen)
        chosen = self._chosen(models)
        own = [k for k in range(len(plants)) if chosen[k]]
        if spec.method == "dk":
            options = spec.dk or DkSpec()
            first = None if start is None else start.controller
            made = synthesise_by_dk(
                options, _single_model(uncertain), controls, measurements, ctx, first
            )
        else:
            given = [plants[k] for k in own], [models.labels[k] for k in own]
            if spec.method == "structured":
                made = synthesise_fixed_structure(
                    spec, *given, controls, measurements, ctx, uncertain, wider, start
                )
            else:
                made = design_controller(spec, *given, controls, measurements)
        advance = ctx.track("closed loops", len(plants))
        evaluation = evaluate_controller(plants, made.controller, advance)
        gamma = float(evaluation.hinf[chosen].max()) if made.gamma is None else made.gamma
        return Synthesis(
            controller=_name_signals(made.controller, plants[0]),
            others=tuple(_name_signals(one, plants[0]) for one in made.others),
            method=spec.method,
            norm={"h2": "h2", "dk": "mu"}.get(spec.method, "hinf"),
            gamma=gamma,
            lower_bound=made.lower_bound,
            added=made.added,
            plants=tuple(plants),
            labels=models.labels,
            designed=chosen,
            controls=controls,
            measurements=measurements,
            weights=weights,
            judged=evaluation,
            search=made.search,
            iterations=made.iterations,
        )

    def present(
        self,
        product: Synthesis,
        models: LinearModels,
        uncertain: UncertainModels | None = None,
        wider: UncertainModels | None = None,
        start: Synthesis | None = None,
    ) -> Presentation:
        """Show norms, margins, gains against the inverse weights, and step responses."""
        return present_synthesis(product, self.spec.step_duration_s)

    def _chosen(self, models: LinearModels) -> NDArray[np.bool_]:
        """Return which models the controller is made for."""
        spec, count = self.spec, len(models.systems)
        chosen = np.zeros(count, dtype=bool)
        for name in spec.plants:
            if name not in models.labels:
                raise InputError(
                    f"plants: no model {name!r}"
                    f"{did_you_mean(name, models.labels, otherwise='there are')}"
                )
            chosen[models.labels.index(name)] = True
        if spec.plants:
            return chosen
        if spec.method in ("structured", "dk", "given"):
            return ~chosen
        spread = np.ptp(models.values, axis=1)
        away = models.values - models.nominal[:, None]
        scaled = away / np.where(spread > 0.0, spread, 1.0)[:, None]
        chosen[int(np.argmin((scaled**2).sum(axis=0)))] = True
        return chosen


def _name_signals(controller: LtiSystem, plant: LtiSystem) -> LtiSystem:
    """Return a controller with the names that its signals have in the plant."""
    controls, measurements = controller.shape
    return replace(
        controller,
        inputs=controller.inputs or plant.outputs[len(plant.outputs) - measurements :],
        outputs=controller.outputs or plant.inputs[len(plant.inputs) - controls :],
    )


def _single_model(uncertain: UncertainModels | None) -> UncertainModel:
    if uncertain is None or len(uncertain.models) != 1:
        count = 0 if uncertain is None else len(uncertain.models)
        raise InputError(
            f"needs.uncertain: a µ synthesis is for one uncertain model, got {count}; let the "
            "stage that makes them have no known parameters"
        )
    return uncertain.models[0]


def _performance(
    uncertain: UncertainModels, controls: int, measurements: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the outputs and inputs of uncertain models that belong to performance."""
    if not uncertain.models:
        raise InputError("needs.uncertain: there is no uncertain model")
    if (uncertain.controls, uncertain.measurements) != (controls, measurements):
        raise InputError(
            f"needs.uncertain: {uncertain.controls} controls and {uncertain.measurements} "
            f"measurements, the models have {controls} and {measurements}"
        )
    model = uncertain.models[0]
    out, into = to_lft(model).closed_channels
    outputs, inputs = model.system.outputs, model.system.inputs
    return outputs[out : len(outputs) - measurements], inputs[into : len(inputs) - controls]


def _apply_weights(
    plants: list[LtiSystem], spec: MixedSensitivitySpec
) -> tuple[list[LtiSystem], tuple[LtiSystem, ...]]:
    """Return generalised plants of a mixed-sensitivity problem, and their weights by name."""
    p, m = plants[0].shape
    weights = [_weight(one, plants[0].dt_s) for one in (spec.w1, spec.w2, spec.w3)]
    made = [mixed_sensitivity_plant(one, *weights, disturbance=spec.disturbance) for one in plants]
    named = []
    for k, (weight, signal, width) in enumerate(
        zip(weights, ("e", "u", "y"), (p, m, p), strict=True), 1
    ):
        if weight is not None:
            whole = on_every_channel(weight, width)
            named.append(with_names(whole, signal, f"z{k}"))
    return made, tuple(named)


def _weight(spec: WeightSpec | None, period_s: float | None) -> LtiSystem | None:
    if spec is None:
        return None
    if spec.shelving is not None:
        return build_shelving_weight(spec.shelving, period_s)
    if spec.performance is not None:
        return build_performance_weight(spec.performance, period_s)
    return gain(np.array([[spec.gain or 0.0]]), period_s)
