"""Spec of the stage ``sampled_loops``: keys of its table in a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.spec import (
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    need,
    option,
    quantity,
    reference,
    rule,
)

__all__ = ["SampledLoopsNeeds", "SampledLoopsSpec"]


class SampledLoopsNeeds(Spec):
    """Products of earlier stages that ``sampled_loops`` takes."""

    models: Ref = need(
        "hillsphere_controllers.linear_products:LinearModels",
        "plants in continuous time, without what a design puts for the hold between samples",
    )
    controllers: tuple[Ref, ...] = need(
        "hillsphere.products:ControlDesign",
        "controllers that the law flies, one after the other; left out: the law has its own",
        default=(),
        max_length=20,
    )


class SampledLoopsSpec(StageSpec):
    """Stability and margins of linear loops at their sample rates, and where stability is lost.

    Exact for the plant as it moves between samples: by the monodromy over one period.
    """

    results = ResultNames(
        metrics=("sampled_lost_*",),
        tables={
            "sampled_loops": (),
        },
    )
    produces = "hillsphere_controllers.stages.sampled_loops.products:SampledLoops"
    examples = (
        {
            "needs": {"models": "models", "controllers": ["design"]},
            "periods_s": [0.05, 0.1],
            "longest_s": 10,
        },
        {
            "needs": {"models": "models", "controllers": ["design"]},
            "law": "lti",
            "models": ["nominal*"],
            "controls": ["a"],
            "sees": ["r", "v"],
        },
    )

    needs: SampledLoopsNeeds = option("products of earlier stages")
    law: Ref | None = reference(
        "compensator",
        "a linear law that says how the controllers act: its filters, whether they run between "
        "samples, its period; left out: as they are, between samples of periods_s",
        default=None,
    )
    models: tuple[str, ...] = option(
        "names of the models that are looked at; * stands for any characters; left out: all",
        default=(),
    )
    controls: tuple[str, ...] = option(
        "inputs of the models that are commanded; one name a stands for a[0], a[1] …; left out: "
        "their controls, or if they name none all inputs",
        default=(),
    )
    sees: tuple[str, ...] = option(
        "outputs of the models that the law sees, in its order; left out: their measurements, or "
        "if they name none all outputs",
        default=(),
    )
    periods_s: tuple[float, ...] = quantity(
        "time", "times between samples, at which margins are found; left out: the law's",
        default=(), gt=0,
    )  # fmt: skip
    longest_s: float | None = quantity(
        "time",
        "up to which period the first is looked for at which a loop is not stable, from a "
        "hundredth of it on; left out: ten times the longest of the others",
        default=None, gt=0,
    )  # fmt: skip
    delay_s: float = quantity(
        "time", "time from a sample until it acts, at most a period", default=0.0, ge=0
    )

    @model_validator(mode="after")
    def _some_period(self) -> Self:
        if self.law is None and not self.periods_s:
            raise rule("periods_s", "no law says it: give at least one")
        if self.law is None and not self.needs.controllers:
            raise rule("needs", "controllers: there is no law with one of its own; name some")
        if len(set(self.periods_s)) < len(self.periods_s):
            raise rule("periods_s", "a period is listed twice")
        if self.periods_s and self.delay_s > min(self.periods_s):
            raise rule("delay_s", "must be at most the shortest period")
        return self
