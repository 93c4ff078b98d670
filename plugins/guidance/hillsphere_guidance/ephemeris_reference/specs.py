"""Spec of the stage ``ephemeris_reference``: the keys of a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    StageSpec,
    data_path,
    option,
    quantity,
    reference,
    rule,
)

__all__ = ["EphemerisReferenceSpec"]


_MESSAGE = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2027-01-01T00:00:00
ORIGINATOR = EXAMPLE
META_START
OBJECT_NAME = PROBE
OBJECT_ID = 2027-001A
CENTER_NAME = body
REF_FRAME = ICRF
TIME_SYSTEM = TDB
START_TIME = 2027-06-01T00:00:00
STOP_TIME = 2027-06-01T00:02:00
META_STOP
2027-06-01T00:00:00 100.0 0.0 0.0 0.0 0.02 0.0
2027-06-01T00:01:00 100.0 1.2 0.0 0.0 0.02 0.0
2027-06-01T00:02:00 100.0 2.4 0.0 0.0 0.02 0.0
"""
"""The least message of an example: a probe on a straight line."""


class EphemerisReferenceSpec(StageSpec):
    """A trajectory of an ephemeris (CCSDS OEM, or SPK of SPICE) in the frame of a plant.

    Each segment of the object becomes a trajectory of its own, since a manoeuvre may lie between
    two of them: named as the object if it is the only one, otherwise ``segment 1`` and so on.
    """

    results = ResultNames(
        tables={"ephemeris_reference": ("trajectory", "begins_s", "ends_s", "states")}
    )
    produces = "hillsphere_guidance.ephemeris_reference.products:EphemerisReference"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {"plant": "hill", "text": _MESSAGE},
        {"plant": "hill", "file": "flight.oem", "epoch": "2027-06-01T00:00:00"},
    )

    plant: Ref = reference("plant", "equations of motion in whose frame the trajectory is wanted")
    file: DataPath | None = data_path(
        "orbit ephemeris message (CCSDS OEM, KVN or XML), or SPK kernel, which needs the extra "
        "spice",
        default=None,
    )
    kernels: tuple[DataPath, ...] = data_path(
        "with an SPK kernel: further kernels, of the bodies between (SPK), of names and frames "
        "(text)",
        default=(),
    )
    text: str = option("instead of a file: the message itself", default="", max_length=1_000_000)
    object: str = option(
        "name or identifier of the object (of a kernel: its name or NAIF number); left out: the "
        "only one",
        default="",
        max_length=80,
    )
    lenient: bool = option(
        "whether harmless departures of a message from the standard are warnings, not errors",
        default=False,
    )
    epoch: str | None = option(
        "date and time (TDB) of time 0; left out: that of the plant's clock, if it has one, else "
        "the first useable state",
        default=None,
        max_length=40,
    )
    interval_s: float | None = quantity(
        "time",
        "interval of the reference's states, interpolated as the message says; left out: the "
        "states of the message",
        default=None,
        gt=0,
    )
    others: dict[str, float] = option(
        "values at the first state of states of the plant that are neither position nor velocity, "
        "by name, SI (true_anomaly = 0.5)",
        default={},
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (not self.text):
            raise rule("file", "give one of file and text")
        if self.kernels and self.file is None:
            raise rule("kernels", "only a file may be a kernel; leave them out or give file")
        return self
