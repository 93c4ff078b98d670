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
        "hillsphere.products:FlightSet", "flights with manoeuvres, as they are", default=()
    )


class EphemerisSpec(StageSpec):
    """Orbits and flights as orbit ephemeris messages (CCSDS OEM) in the ICRF, and as CSV.

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
    epoch: str = option("date and time at which every orbit and flight begins", max_length=40)
    time_scale: Literal["TDB", "TT", "TAI", "UTC"] = option(
        "time scale of the epoch and of the files", default="TDB"
    )
    centre: Literal["moon", "primary"] = option(
        "origin of positions and velocities", default="moon"
    )
    duration_s: float | None = quantity(
        "time", "length of the ephemeris of an orbit; left out: one period", default=None, gt=0
    )
    step_s: float = quantity("time", "interval of an orbit's states", default=300.0, gt=0)
    object_id: str = option("identifier in the files", default="0000-000A", min_length=1)
    label: str = label("name of the table")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not (self.needs.orbits or self.needs.flights):
            text = "nothing to write; name stages as needs.orbits or needs.flights"
            raise rule("needs", text)
        return self
