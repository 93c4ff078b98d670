"""Spec of the stage ``initialisation``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Self

from pydantic import model_validator

from hillsphere.spec import (
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    Vector3,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_estimators.sensor_fit import noiseless, unseen

__all__ = ["BeginningSpec", "InitialisationSpec"]


class BeginningSpec(Spec):
    """Where a spacecraft truly is at first, in the axes of the plant."""

    examples = ({"position_m": [29.0, -1503.0, 407.0]},)

    position_m: Vector3 = quantity("length", "place")
    velocity_m_s: Vector3 = quantity("speed", "velocity", default=(0.0, 0.0, 0.0))


class InitialisationSpec(StageSpec):
    """A first belief of the states of spacecraft, from their sensors alone."""

    results = ResultNames(
        metrics=(
            "initialisation_mean_nees",
            "initialisation_chi_square_probability",
            "initialisation_settled",
        ),
        tables={
            "initialisation": (
                "spacecraft",
                "position_rms_m",
                "position_sigma_m",
                "velocity_rms_mm_s",
                "velocity_sigma_mm_s",
            ),
        },
    )
    produces = "hillsphere_estimators.initialisation.products:StartingBelief"
    examples = (
        {
            "plant": "proximity",
            "sensors": ["lidar"],
            "spacecraft": [{"position_km": [3.0, -16.0, 4.0]}],
            "duration_h": 2,
            "interval_min": 30,
            "seeds": 20,
            "depths_km": [5, 20],
        },
    )

    plant: Ref = reference("plant", "motion of the spacecraft, six states each, without control")
    sensors: tuple[Ref, ...] = reference("sensor", "the sensors")
    spacecraft: tuple[BeginningSpec, ...] = option(
        "true states at first, in the order of the plant's", min_length=1, max_length=20
    )
    duration_s: float = quantity("time", "length of the arc of measurements", gt=0)
    interval_s: float = quantity("time", "time between measurements", gt=0)
    seeds: int = option("random cases", default=100, ge=2, le=10000)
    depths_m: tuple[float, ...] = quantity(
        "length", "distances along each line of sight from which the search starts, in every "
        "combination of the spacecraft",
        gt=0, min_length=1, max_length=20,
    )  # fmt: skip
    tries: int = option("number of starts, the best at the first measurement, that are solved",
                        default=3, ge=1, le=50)  # fmt: skip
    speed_m_s: float = quantity(
        "speed", "largest speed, each axis; a tenth of the prior's standard deviation", default=1.0,
        gt=0,
    )  # fmt: skip
    pointing_rad: float = quantity(
        "angle", "standard deviation, each axis, of the pointing from the asteroid's centre",
        default=0.03, ge=0, lt=1,
    )  # fmt: skip
    step_s: float = quantity("time", "longest step of the step map", default=60.0, gt=0)
    noise_step_s: float = quantity(
        "time", "how long each of the plant's random accelerations is held", default=60.0, gt=0
    )

    @model_validator(mode="after")
    def _several(self) -> Self:
        def refuse(key: str, text: str) -> None:
            raise rule(key, text)

        if not self.sensors:
            refuse("sensors", "lists no sensor; name at least one")
        if self.interval_s > self.duration_s:
            refuse("interval_s", f"is longer than the {self.duration_s:g} s that are measured")
        if len(self.depths_m) ** len(self.spacecraft) > 20_000:
            refuse("depths_m", "makes more than 20000 combinations; give fewer distances")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the sensors that would find nothing to measure, or have no noise."""
        sensors = [(("sensors", i), ref) for i, ref in enumerate(self.sensors)]
        yield from noiseless(sensors, tables)
        yield from unseen(sensors, [self.plant], tables, takes_earth=False)
