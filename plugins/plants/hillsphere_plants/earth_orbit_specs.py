"""Spec of the plant ``earth_orbit``."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import field_validator, model_validator
from pydantic_core import PydanticCustomError

from hillsphere.spec import Ref, Spec, option, quantity, reference, rule

__all__ = ["DragSpec", "EarthOrbitSpec"]


class DragSpec(Spec):
    """Drag in an atmosphere that turns with the Earth, of a density after NRLMSISE-00."""

    examples = (
        {
            "drag_coefficient": 2.2,
            "area_to_mass_m2_kg": 0.01,
            "f107": 150.0,
            "f107_average": 150.0,
            "ap": 15.0,
        },
    )

    drag_coefficient: float = option("drag coefficient", gt=0)
    area_to_mass_m2_kg: float = quantity("area_to_mass", "cross-section over mass", gt=0)
    f107: float = option(
        "solar flux at 10.7 cm of the day before, 1e-22 W/(m² Hz): quiet 70, moderate 150, high "
        "230",
        ge=50,
        le=400,
    )
    f107_average: float = option(
        "mean of the solar flux at 10.7 cm over 81 days about the day, 1e-22 W/(m² Hz)",
        ge=50,
        le=300,
    )
    ap: float = option("daily geomagnetic index Ap; quiet 4, moderate 15, storm 100", ge=0, le=400)


class EarthOrbitSpec(Spec):
    """Flight of a satellite about the turning Earth, in an inertial frame."""

    examples = (
        {
            "body": "planet",
            "gravity": "harmonics",
            "epoch": "1989-01-31T09:58:00",
            "drag": DragSpec.examples[0],
        },
        {
            "body": "planet",
            "gravity": "harmonics",
            "epoch": "2026-11-21T00:00:00",
            "frame": "gcrs",
            "arc_d": 1,
            "drag": DragSpec.examples[0],
            "third_bodies": ["sun", "moon"],
        },
    )

    body: Ref = reference("body", "the planet: gives ellipsoid and rotation")
    gravity: Ref = reference("gravity", "gravity of the planet, in its body-fixed frame")
    epoch: str = option("date and time (UTC) at which times count from zero", max_length=40)
    frame: Literal["teme", "gcrs"] = option(
        "frame of the states: true equator and mean equinox of the epoch, about whose pole the "
        "Earth turns by Greenwich mean sidereal time; or the axes of the ICRF, in which precession "
        "and nutation stand still at their values in the middle of the arc",
        default="teme",
    )
    arc_s: float = quantity(
        "time",
        "length of the arc to be flown, in whose middle precession and nutation are taken "
        "(frame 'gcrs'); the axis moves by up to 0.2″ a day",
        default=0.0,
    )
    drag: DragSpec | None = option("drag; left out: none", default=None)
    third_bodies: tuple[Literal["sun", "moon"], ...] = option(
        "bodies whose attraction disturbs the flight as well, by analytic series of their places",
        default=(),
    )

    @field_validator("third_bodies")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) < len(value):
            raise PydanticCustomError("rule", "names a body twice")
        return value

    @model_validator(mode="after")
    def _arc_has_a_meaning(self) -> Self:
        if self.frame == "teme" and self.arc_s != 0.0:
            text = "goes with frame = 'gcrs'; the frame 'teme' is that of the epoch, remove it"
            raise rule("arc_s", text)
        return self
