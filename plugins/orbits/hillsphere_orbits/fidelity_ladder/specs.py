"""Spec of the stage ``fidelity_ladder``: the keys of a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
from hillsphere.spec import Ref, ResultNames, StageSpec, option, quantity, reference, rule
from hillsphere_orbits.options import label
from hillsphere_orbits.source_specs import OrbitNeeds

__all__ = ["FidelityLadderSpec"]


class FidelityLadderSpec(StageSpec):
    """Periodic orbits continued to higher-fidelity equations, plant by plant.

    On each plant the continuous flight nearest to the orbit is found by multiple shooting, and
    flown on its own from its first state.
    """

    results = ResultNames(
        metrics=(
            "ladder_flights",
            "ladder_converged",
            "ladder_gap_max",
            "ladder_departure_max",
        ),
        tables={
            "fidelity_ladder": (),
            "fidelity_rungs": (),
            "fidelity_periodic": (),
        },
    )
    produces = "hillsphere_orbits.fidelity_ladder.products:FidelityLadder"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {"needs": {"orbits": ["family"]}, "rungs": ["hill"], "duration_d": 0.4},
        {
            "needs": {"orbits": ["family", "families"]},
            "rungs": ["hill", "circular", "elliptic"],
            "members": ["x = 50 km", "1:17, 70 km"],
            "start_true_anomaly_deg": 90,
            "segments": 400,
        },
    )

    needs: OrbitNeeds = option("products of earlier stages: whose members are carried over")
    rungs: tuple[Ref, ...] = reference(
        "plant", "plants from the simplest, which the orbits solve, to the truest"
    )
    members: tuple[str, ...] = option("names of the orbits carried over; left out: all", default=())
    duration_s: float = quantity("time", "length of the flights", default=30 * DAY_S, gt=0)
    segments: int | None = option(
        "arcs of a flight; left out: so many that one takes 1.5/n, n the mean motion",
        default=None,
        ge=1,
        le=100_000,
    )
    start_true_anomaly_rad: float = quantity(
        "angle", "true anomaly of the moon at the start, where its orbit is an ellipse", default=0.0
    )
    limit: float = option(
        "an uncorrected flight is lost beyond this many times the orbit's largest |x|, |y| or "
        "in space, |z|",
        default=2.0,
        gt=1,
        le=1000,
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
        if len(set(self.members)) < len(self.members):
            text = "an orbit is listed twice"
            raise rule("members", text)
        return self
