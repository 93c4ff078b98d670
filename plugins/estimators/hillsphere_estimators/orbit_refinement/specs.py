"""Specs of the stage ``orbit_refinement``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
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
from hillsphere_estimators.sensor_fit import noiseless

__all__ = ["ApproachSpec", "ArmSpec", "GeometrySpec", "OrbitRefinementSpec"]


class GeometrySpec(Spec):
    """Positions of the Earth and the asteroid when the observations begin."""

    examples = ({"name": "near", "epoch": "2029-01-15"},)

    name: str = option("name, for tables and figures", min_length=1, max_length=40)
    epoch: str = option(
        "date and time (TDB) of the first observation: places the Earth and turns it", max_length=40
    )
    mean_anomaly_rad: float | None = quantity(
        "angle",
        "mean anomaly of the asteroid then; left out: by its own elements and their epoch",
        default=None,
    )


class ApproachSpec(Spec):
    """Position of a spacecraft when tracking begins, in the Hill frame of the asteroid."""

    examples = ({"offset_km": [9000.0, -4000.0, 1000.0]},)

    offset_m: Vector3 = quantity("length", "place: outward, along the motion, orbit normal")
    speed_m_s: Vector3 = quantity(
        "speed", "velocity against the asteroid, in axes that do not turn", default=(0.0, 0.0, 0.0)
    )

    @model_validator(mode="after")
    def _away(self) -> Self:
        if not any(self.offset_m):
            text = "is zero: in the asteroid's middle; give the spacecraft a place beside it"
            raise rule("offset_m", text)
        return self


class ArmSpec(Spec):
    """One set of sensors that refine the orbit."""

    examples = ({"name": "all sensors", "sensors": ["deep_space_station"]},)

    name: str = option("name, for tables and figures", min_length=1, max_length=40)
    sensors: tuple[Ref, ...] = reference(
        "sensor", "its sensors; to them the asteroid is number 1, the spacecraft are 2, 3 and so on"
    )

    @model_validator(mode="after")
    def _some(self) -> Self:
        if not self.sensors:
            text = "lists no sensor; name at least one"
            raise rule("sensors", text)
        return self


class OrbitRefinementSpec(StageSpec):
    """An asteroid's orbit by telescopes, and then with spacecraft near it."""

    results = ResultNames(
        metrics=(
            "refinement_position_gain_median",
            "refinement_velocity_gain_median",
            "refinement_mean_nees",
            "refinement_mean_nees_greatest",
            "refinement_settled",
            "refinement_tracking_settled",
        ),
        tables={
            "refinement_optical": (),
            "refinement_tracking": (),
            "refinement_arms": (),
        },
    )
    produces = "hillsphere_estimators.orbit_refinement.products:OrbitRefinement"
    examples = (
        {
            "plant": "heliocentric",
            "asteroid": "solar_orbit",
            "earth": "solar_orbit",
            "geometries": [
                {"name": "one", "epoch": "2029-01-15", "mean_anomaly_deg": 60},
                {"name": "other", "epoch": "2029-01-15", "mean_anomaly_deg": 200},
            ],
            "seeds": 2,
            "optical": ["deep_space_station"],
            "optical_duration_d": 2,
            "optical_interval_h": 6,
            "initial_error": 1e-5,
            "estimator": "information",
            "duration_d": 1,
            "interval_h": 4,
            "arms": [
                {"name": "all", "sensors": ["deep_space_station", "sun_doppler"]},
                {"name": "no Doppler", "sensors": ["deep_space_station"]},
            ],
        },
    )

    plant: Ref = reference(
        "plant",
        "motion around the Sun of the asteroid, the first six states, and of the spacecraft, the "
        "next (type 'heliocentric')",
    )
    asteroid: Ref = reference("body", "the asteroid: where it truly is")
    earth: Ref = reference("body", "the Earth, from which is observed")
    geometries: tuple[GeometrySpec, ...] = option(
        "places of asteroid and spacecraft when the observations begin",
        min_length=1,
        max_length=200,
    )
    seeds: int = option("random cases of each geometry", default=20, ge=2, le=2000)

    optical: tuple[Ref, ...] = reference(
        "sensor", "sensors of the optical part; to them the asteroid is spacecraft 1"
    )
    optical_duration_s: float = quantity(
        "time", "length of the optical part", default=30.0 * DAY_S, gt=0
    )
    optical_interval_s: float = quantity(
        "time", "time between observations in the optical part", default=3600.0, gt=0
    )
    initial_error: float = option(
        "standard deviation of the first belief, each axis, as a part of the distance from the Sun "
        "and of the speed",
        default=0.01, gt=0, le=0.1,
    )  # fmt: skip

    estimator: Ref = reference("estimator", "the filter of the second part")
    spacecraft: tuple[ApproachSpec, ...] = option(
        "the spacecraft that draw near, in the order of the plant's bodies after the asteroid",
        default=(),
        max_length=19,
    )
    spacecraft_position_sigma_m: float = quantity(
        "length",
        "standard deviation of the spacecraft's first positions, each axis",
        default=1e6,
        gt=0,
    )
    spacecraft_speed_sigma_m_s: float = quantity(
        "speed",
        "standard deviation of the spacecraft's first velocities, each axis",
        default=0.1,
        gt=0,
    )
    acceleration_noise_m_s2: float = quantity(
        "acceleration",
        "standard deviation, each axis, of random accelerations of the spacecraft, held between "
        "measurements: radiation pressure and thrusters that no model knows",
        default=0.0, ge=0,
    )  # fmt: skip
    duration_s: float = quantity("time", "length of the second part", default=2.0 * DAY_S, gt=0)
    interval_s: float = quantity(
        "time", "time between measurements in the second part", default=600.0, gt=0
    )
    reported_s: tuple[float, ...] = quantity(
        "time", "times of the table, after the beginning of the second part; left out: each day",
        default=(), gt=0, max_length=20,
    )  # fmt: skip
    arms: tuple[ArmSpec, ...] = option(
        "sets of sensors, each tried on the same flights and noise; the others are compared with "
        "the first",
        min_length=1,
        max_length=10,
    )
    passes: int = option(
        "further passes of the filter over the second part, linearised along the path of the last "
        "result: a single pass is overconfident while distances are hardly known",
        default=3, ge=0, le=20,
    )  # fmt: skip
    step_s: float = quantity("time", "longest step of the step map", default=3600.0, gt=0)

    @model_validator(mode="after")
    def _times_and_names(self) -> Self:
        def refuse(key: str, text: str) -> None:
            raise rule(key, text)

        for group in ("geometries", "arms"):
            names = [item.name for item in getattr(self, group)]
            if len(set(names)) < len(names):
                refuse(group, f"names repeat: {', '.join(names)}")
        if not self.optical:
            refuse("optical", "lists no sensor; name at least one")
        for length, part in (("optical_duration_s", "optical_interval_s"),
                             ("duration_s", "interval_s")):  # fmt: skip
            if getattr(self, part) > getattr(self, length):
                refuse(part, f"is longer than {length} of {getattr(self, length):g} s; shorten it")
        late = [t for t in self.reported_s if t > self.duration_s]
        if late:
            refuse("reported_s", f"{late[0]:g} s is after the end at {self.duration_s:g} s")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the sensors that have no noise."""
        yield from noiseless([(("optical", i), ref) for i, ref in enumerate(self.optical)], tables)
        for a, arm in enumerate(self.arms):
            own = [(("arms", a, "sensors", i), ref) for i, ref in enumerate(arm.sensors)]
            yield from noiseless(own, tables)
