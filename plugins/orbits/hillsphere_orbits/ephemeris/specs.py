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
    """Orbits and flights in inertial axes: orbit ephemeris messages (CCSDS OEM), or SPK kernels.

    Messages are accompanied by tables (CSV), and, for a flight with impulses, by an orbit parameter
    message (CCSDS OPM); kernels by a frame kernel. Kernels need the extra ``spice``.

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
                "spacecraft_id",
                "degrees",
                "between_m",
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
    format: Literal["oem", "spk"] = option(
        "files: oem, orbit ephemeris messages and tables; spk, kernels of SPICE", default="oem"
    )
    spk_type: Literal[13, 9] = option(
        "type of the segments of kernels: 13, Hermite's polynomials; 9, Lagrange's", default=13
    )
    spacecraft_id: int | None = option(
        "with format = 'spk': NAIF number of the spacecraft of the first file, negative; further "
        "files count down from it",
        default=None,
        lt=0,
        ge=-999_999_999,
    )
    body_id: int | None = option(
        "with format = 'spk': NAIF number of the centre; left out: that which SPICE knows by its "
        "name",
        default=None,
        gt=0,
        le=999_999_999,
    )
    label: str = label("name of the table")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not (self.needs.orbits or self.needs.flights or self.needs.closed_loops):
            text = (
                "nothing to write; name stages as needs.orbits, needs.flights or needs.closed_loops"
            )
            raise rule("needs", text)
        return self

    @model_validator(mode="after")
    def _numbers_of_a_kernel(self) -> Self:
        if self.format == "spk" and self.spacecraft_id is None:
            raise rule(
                "spacecraft_id",
                "format = 'spk' needs the NAIF number of the spacecraft, such as -999",
            )
        for key in ("spacecraft_id", "body_id"):
            if self.format != "spk" and getattr(self, key) is not None:
                raise rule(key, "only a kernel has it; give format = 'spk' as well")
        return self
