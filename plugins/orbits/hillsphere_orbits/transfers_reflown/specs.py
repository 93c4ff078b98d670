"""Spec of the stage ``transfers_reflown``: the keys of a mission."""

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
from hillsphere_orbits.options import label

__all__ = ["TransfersReflownNeeds", "TransfersReflownSpec"]


class TransfersReflownNeeds(Spec):
    """Products of earlier stages that ``transfers_reflown`` takes."""

    flights: tuple[Ref, ...] = need(
        "hillsphere.products:FlightSet", "transfers, each a plan of coasts", min_length=1
    )
    orbits: tuple[Ref, ...] = need(
        "hillsphere.products:OrbitSet",
        "families with the orbits where plans begin, stay between coasts, and end",
        default=(),
    )


class TransfersReflownSpec(StageSpec):
    """Transfers and their impulses recomputed on higher-fidelity equations, plant by plant.

    Where a plan begins, stays or ends on a periodic orbit, that orbit is re-converged on each plant
    about that time, and the coasts lead from where it then is to where the next one is, in the time
    of the plan. Other patch points keep the places of the plan.
    """

    results = ResultNames(
        metrics=(
            "reflown_transfers",
            "reflown_found",
            "reflown_change_max",
            "reflown_closure_max",
        ),
        tables={
            "transfers_reflown": (),
            "transfers_reflown_patches": (),
            "transfers_reflown_rungs": (),
        },
    )
    produces = "hillsphere_orbits.transfers_reflown.products:TransfersReflown"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {
            "needs": {"flights": ["fidelity_ladder"], "orbits": ["family"]},
            "rungs": ["hill", "three_body"],
            "cheapest": 4,
            "start_true_anomaly_deg": 90,
        },
    )

    needs: TransfersReflownNeeds = option("products of earlier stages")
    rungs: tuple[Ref, ...] = reference(
        "plant", "plants from the simplest, on which the transfers were found, to the truest"
    )
    plans: tuple[str, ...] = option(
        "names of the plans that are flown again; left out: the cheapest", default=()
    )
    cheapest: int = option(
        "without plans: how many of each product between the same orbits, those of least impulse",
        default=3,
        ge=1,
        le=1000,
    )
    revolutions: float = option(
        "how long the orbits of departure and arrival are flown before and after, in their periods",
        default=1.0,
        gt=0,
        le=100,
    )
    start_true_anomaly_rad: float = quantity(
        "angle",
        "true anomaly of the moon when a plan's first coast begins, where its orbit is an ellipse",
        default=0.0,
    )
    label: str = label()

    @model_validator(mode="after")
    def _some_rungs(self) -> Self:
        if not self.rungs:
            text = "no plant is given; name those of the ladder, the simplest first"
            raise rule("rungs", text)
        # plants given in Python have no names of their own
        if len({(ref.name, id(ref.target)) for ref in self.rungs}) < len(self.rungs):
            text = "a plant is listed twice"
            raise rule("rungs", text)
        if len(set(self.plans)) < len(self.plans):
            text = "a plan is listed twice"
            raise rule("plans", text)
        return self
