"""Spec of the stage ``ephemeris``: the keys of a mission."""

from __future__ import annotations

from typing import Literal, Self

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

__all__ = ["EphemerisNeeds", "EphemerisSpec"]


class EphemerisNeeds(Spec):
    """Products of earlier stages that ``ephemeris`` writes out."""

    orbits: tuple[Ref, ...] = need(
        "hillsphere.products:OrbitSet", "periodic orbits, flown from their start", default=()
    )
    flights: tuple[Ref, ...] = need(
        "hillsphere.products:FlightSet",
        "flights with manoeuvres, transfers and references, as they are",
        default=(),
    )
    closed_loops: tuple[Ref, ...] = need(
        "hillsphere.products:Flown", "flights under a law, as they were flown", default=()
    )


class EphemerisSpec(StageSpec):
    """Orbits and flights as orbit ephemeris messages (CCSDS OEM) in inertial axes, and as CSV.

    A flight with impulses is written as an orbit parameter message (CCSDS OPM), too.

    The body that the plant is about must have an orientation: its pole and prime meridian.
    """

    results = ResultNames(
        tables={
            "ephemerides": (
                "file",
                "begins",
                "ends",
                "states",
                "segments",
            ),
        },
    )
    produces = "hillsphere_orbits.ephemeris.stage:Ephemerides"
    examples = ({"plant": "hill", "needs": {"orbits": ["family"]}, "epoch": "2027-06-01T00:00:00"},)

    needs: EphemerisNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the orbits")
    epoch: str | None = option(
        "date and time of time 0 of every orbit and flight; left out: that of the plant's clock, "
        "if it has one",
        default=None,
        max_length=40,
    )
    time_scale: Literal["TDB", "TT", "TAI", "UTC"] = option(
        "time scale of the epoch and of the files", default="TDB"
    )
    centre: Literal["moon", "primary"] = option(
        "origin of positions and velocities: the body at the origin of the plant's frame, or its "
        "primary",
        default="moon",
    )
    duration_s: float | None = quantity(
        "time", "length of the ephemeris of an orbit; left out: one period", default=None, gt=0
    )
    step_s: float = quantity("time", "interval of an orbit's states", default=300.0, gt=0)
    object_id: str = option("identifier in the files", default="0000-000A", min_length=1)
    label: str = label("name of the table")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not (self.needs.orbits or self.needs.flights or self.needs.closed_loops):
            text = (
                "nothing to write; name stages as needs.orbits, needs.flights or needs.closed_loops"
            )
            raise rule("needs", text)
        return self
