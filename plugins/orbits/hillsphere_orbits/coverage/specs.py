"""Spec of the stage ``coverage``: the keys of a mission."""

from __future__ import annotations

from math import pi
from typing import Self

from pydantic import model_validator

from hillsphere.spec import Ref, ResultNames, StageSpec, option, quantity, reference, rule
from hillsphere_orbits.options import label
from hillsphere_orbits.source_specs import OrbitNeeds

__all__ = ["CoverageSpec"]


class CoverageSpec(StageSpec):
    """Ground track, altitude, eclipses and light on the ground of periodic orbits."""

    results = ResultNames(
        tables={
            "coverage": (),
            "latitude_bands": (),
            "seasons": (),
        },
    )
    produces = "hillsphere_orbits.coverage.products:Coverage"
    examples = (
        {
            "plant": "hill",
            "needs": {"orbits": ["family"]},
            "primary_radius_km": 3396.19,
            "seasons": 3,
            "sun_longitudes": 12,
        },
        {
            "plant": "hill",
            "needs": {"orbits": ["families"]},
            "primary_radius_km": 3396.19,
            "sun_distance_au": 1.523679,
            "sun_declination_max_deg": 25.19,
            "sun_elevation_min_deg": 15,
        },
    )

    needs: OrbitNeeds = option("products of earlier stages: whose members are described")
    plant: Ref = reference("plant", "equations of motion about a locked moon, those of the orbits")
    cell_rad: float = quantity(
        "angle",
        "largest width of the bands of latitude over which time is counted (an odd number of them, "
        "so that the equator lies within one), and of the cells of latitude and longitude that "
        "count as seen once the point below the spacecraft is in them",
        default=pi / 18.0,
        ge=pi / 1800.0,
        le=pi / 2.0,
    )
    primary_radius_m: float | None = quantity(
        "length", "radius of the primary; left out: its shadow is not looked for", default=None,
        gt=0,
    )  # fmt: skip
    sun_distance_m: float | None = quantity(
        "length",
        "distance of the Sun, which makes the primary's shadow a cone; left out: it is infinite, "
        "and the shadow a cylinder",
        default=None,
        gt=1e9,
    )
    sun_radius_m: float = quantity(
        "length", "radius of the Sun: the IAU's nominal one", default=6.957e8, gt=0
    )
    sun_declination_max_rad: float = quantity(
        "angle",
        "largest elevation of the Sun over the moon's orbit plane in the course of the year; over "
        "the year it is asin(sin of this · sin λ) with λ growing evenly",
        default=0.0,
        ge=0,
        le=pi / 2.0,
    )
    seasons: int = option("places of the year that are looked at", default=25, ge=1, le=1000)
    sun_longitudes: int = option(
        "directions of the Sun about the orbit's normal that are averaged over: it goes round once "
        "per revolution of the primary",
        default=180,
        ge=4,
        le=3600,
    )
    sun_elevation_min_rad: float = quantity(
        "angle",
        "elevation of the Sun, at the point below the spacecraft, from which pictures are useful",
        default=10.0 * pi / 180.0,
        ge=0,
        lt=pi / 2.0,
    )
    label: str = label()

    @model_validator(mode="after")
    def _sun_is_outside(self) -> Self:
        if self.sun_distance_m is not None and self.sun_distance_m <= self.sun_radius_m:
            text = "the Sun must be farther away than its radius"
            raise rule("sun_distance_m", text)
        return self
