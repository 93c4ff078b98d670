"""Spec of the stage ``worst_cases``: keys of its table in a mission."""

from __future__ import annotations

from typing import Literal

from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, need, option

__all__ = ["WorstCasesNeeds", "WorstCasesSpec"]


class WorstCasesNeeds(Spec):
    """Products of earlier stages that ``worst_cases`` takes."""

    analysis: Ref = need(
        "hillsphere_controllers.stages.mu_analysis.products:MuAnalysis",
        "what was found to be worst",
    )
    uncertain: Ref = need(
        "hillsphere_controllers.linear_products:UncertainModels",
        "the uncertain models that were analysed",
    )
    flight: Ref = need(
        "hillsphere_controllers.stages.linearise.products:LinearisedFlight",
        "the linearisation that they come from: it has all parameters, also those that the "
        "uncertain models leave out",
    )


class WorstCasesSpec(StageSpec):
    """The worst cases of an analysis by µ, for a sweep of a flight over these points.

    The worst perturbation at the peak of each analysis is brought to the size of the declared
    bounds, its largest entry at its bound. Parameters that the uncertain model leaves out stand at
    each of `remaining`.
    """

    results = ResultNames(
        metrics=("worst_cases",),
        tables={
            "worst_cases": (),
        },
    )
    produces = "hillsphere_controllers.stages.worst_cases.products:WorstCases"
    provides = ("hillsphere.products:CaseList",)
    examples = (
        {
            "needs": {"analysis": "mu", "uncertain": "uncertain", "flight": "linear"},
            "inputs": {"rate": "stage.descent.actuator.gain.ax"},
        },
        {
            "needs": {"analysis": "mu", "uncertain": "uncertain", "flight": "linear"},
            "controllers": ["design"],
            "inputs": {"gain": "stage.descent.actuator.gain.ax"},
            "remaining": [0],
            "scales": [1, 2, 3, 4, 6],
        },
    )

    needs: WorstCasesNeeds = option("products of earlier stages")
    controllers: tuple[str, ...] = option(
        "controllers whose worst cases are taken; left out: all", default=()
    )
    analyses: tuple[Literal["robust_stability", "robust_performance", "worst_case_gain"], ...] = (
        option(
            "analyses whose worst cases are taken", default=("robust_performance",), min_length=1
        )
    )
    inputs: dict[str, str] = option(
        "what a sweep sets for each real block that is no parameter of the mission: name of the "
        'block = "stage.NAME.actuator.gain.ax", or "repeat.actuator.gain.ax" for whichever stage '
        "the sweep repeats; left out: blocks without a name here stay nominal",
        default={},
    )
    scales: tuple[float, ...] = option(
        "sizes to which the worst parameters are brought together, the largest of them standing so "
        "many standard deviations from nominal; a case for each, so that a sweep with a threshold "
        "tells at which size the flight fails; blocks without a standard deviation stay at their "
        "bounds; left out: the size of the declared bounds",
        default=(), gt=0,
    )  # fmt: skip
    remaining: tuple[float, ...] = option(
        "where parameters stand that the uncertain models leave out, in standard deviations from "
        "nominal; a case for each",
        default=(0.0, 3.0, -3.0), min_length=1,
    )  # fmt: skip
