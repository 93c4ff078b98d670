"""Specs of initial conditions: inertial states and Keplerian elements."""

from __future__ import annotations

from math import pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec.base import DataPath, Spec, Vector3, data_path, option, quantity, rule

__all__ = [
    "InertialStartSpec",
    "KeplerianStartSpec",
    "MessageStartSpec",
    "StartFormsSpec",
    "StartSpec",
]


class _InertialSpec(Spec):
    """Common keys of both inertial forms."""

    about: str = option(
        "name of the body about which it is given, the plant's body or its primary; left out: the "
        "plant's body",
        default="",
        max_length=80,
    )
    axes: Literal["plant", "icrf"] = option(
        "inertial axes: 'plant' coincide with those of the plant's frame at the start; 'icrf' are "
        "those of the stars, by the orientation of the body and the epoch",
        default="plant",
    )
    epoch: str | None = option(
        "with axes = 'icrf': date and time (TDB) of the start", default=None, max_length=40
    )

    @model_validator(mode="after")
    def _whole_epoch(self) -> Self:
        if (self.axes == "icrf") != (self.epoch is not None):
            raise rule("epoch", "axes = 'icrf' and epoch belong together; give both or neither")
        return self


class InertialStartSpec(_InertialSpec):
    """An initial state in inertial axes, centred on a body."""

    examples = ({"position_km": [100, 0, 0], "velocity_m_s": [0, 25, 0], "about": "phobos"},)

    position_m: Vector3 = quantity("length", "position relative to the body")
    velocity_m_s: Vector3 = quantity("speed", "velocity relative to the body, in these axes")


class KeplerianStartSpec(_InertialSpec):
    """An initial state on a Keplerian ellipse about a body."""

    examples = (
        {"semi_major_axis_km": 30, "inclination_deg": 90, "true_anomaly_deg": 10},
        {"semi_major_axis_km": 9400, "eccentricity": 0.01, "mean_anomaly_deg": 0, "about": "mars"},
    )

    semi_major_axis_m: float = quantity("length", "semi-major axis a", gt=0)
    eccentricity: float = option("eccentricity e", default=0.0, ge=0, lt=1)
    inclination_rad: float = quantity(
        "angle", "inclination i to the plane of the axes' x and y", default=0.0, ge=0, le=pi
    )
    node_rad: float = quantity(
        "angle", "angle Ω from the axes' x to the ascending node", default=0.0
    )
    periapsis_rad: float = quantity("angle", "argument of periapsis ω", default=0.0)
    true_anomaly_rad: float | None = quantity(
        "angle", "true anomaly ν; or give the mean anomaly", default=None
    )
    mean_anomaly_rad: float | None = quantity(
        "angle", "mean anomaly M; or give the true anomaly", default=None
    )

    @model_validator(mode="after")
    def _one_anomaly(self) -> Self:
        if self.true_anomaly_rad is None and self.mean_anomaly_rad is None:
            raise rule("true_anomaly_rad", "where? give true_anomaly or mean_anomaly")
        if self.true_anomaly_rad is not None and self.mean_anomaly_rad is not None:
            raise rule("mean_anomaly_rad", "true_anomaly says it already; give one of the two")
        return self


class MessageStartSpec(Spec):
    """An initial state from a file: OPM, a state of an OEM or SPK kernel, or elements for SGP4."""

    examples = ({"file": "start.opm"}, {"file": "flight.oem", "epoch": "2027-06-01T00:00:00"})

    file: DataPath = data_path(
        "orbit parameter message (OPM), orbit ephemeris message (OEM), elements (TLE, OMM), or SPK "
        "kernel, which needs the extra spice"
    )
    kernels: tuple[DataPath, ...] = data_path(
        "with an SPK kernel: further kernels, of the bodies between (SPK), of names and frames "
        "(text)",
        default=(),
    )
    object: str = option(
        "object of an ephemeris by name or identifier (of a kernel: name or NAIF number); left "
        "out: the only one",
        default="", max_length=80,
    )  # fmt: skip
    epoch: str = option(
        "date and time (TDB) of the state of an ephemeris; left out: its first useable state",
        default="", max_length=40,
    )  # fmt: skip
    lenient: bool = option(
        "whether harmless departures of a message from the standard are warnings, not errors",
        default=False,
    )


class StartFormsSpec(Spec):
    """Forms of an initial state other than positions and velocities in the plant's frame."""

    inertial: InertialStartSpec | None = option(
        "instead of position and velocity: the start in axes that do not turn", default=None
    )
    elements: KeplerianStartSpec | None = option(
        "instead of position and velocity: the start by Keplerian elements", default=None
    )

    message: MessageStartSpec | None = option(
        "instead of position and velocity: the start that a file states", default=None
    )

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        own = [
            key
            for key in ("position_m", "velocity_m_s")
            if getattr(self, key, None) not in (None, ())
        ]
        given = own[:1] + [key for key in ("inertial", "elements", "message") if getattr(self, key)]
        if len(given) > 1:
            raise rule(
                given[1],
                f"the start is given by {given[0]} already; give one of position and velocity "
                "(in the plant's frame), inertial, elements and message",
            )
        return self


class StartSpec(StartFormsSpec):
    """Initial state and time of a flight."""

    position_m: tuple[float, ...] | None = quantity(
        "length",
        "positions in the plant's frame, one per state that is a length, in their order; left out: "
        "those of the reference",
        default=None,
        min_length=1,
    )
    velocity_m_s: tuple[float, ...] | None = quantity(
        "speed",
        "velocities in the plant's frame, one per state that is a velocity, in their order; "
        "left out: those of the reference",
        default=None,
        min_length=1,
    )
    others: dict[str, float] = option(
        "values of states that are neither position nor velocity, by name, SI "
        "(true_anomaly = 0.5); left out: those of the reference",
        default={},
    )
    time_s: float = quantity("time", "time at the start", default=0.0)
