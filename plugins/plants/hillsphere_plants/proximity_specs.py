"""Specs of the plants ``proximity`` and ``heliocentric``, and of reference trajectories."""

from __future__ import annotations

from typing import ClassVar, Self

from pydantic import model_validator

from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2
from hillsphere.base.ranges import STAR_GM_M3_S2
from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, option, quantity, reference, rule

__all__ = [
    "FormationReferenceSpec",
    "HeliocentricSpec",
    "ProximitySpec",
    "RelativeElementsSpec",
    "SpacecraftSpec",
]


class SpacecraftSpec(Spec):
    """One spacecraft of a formation."""

    examples = (
        {"name": "sc-1", "reflectivity": 0.2, "area_to_mass_m2_kg": 0.04},
        {},
    )

    name: str = option("name, for tables and figures; left out: its number", default="")
    reflectivity: float = option(
        "reflectivity coefficient C_R of radiation pressure", default=1.0, ge=0
    )
    area_to_mass_m2_kg: float = quantity(
        "area_to_mass", "cross-section towards the Sun over mass; 0: no pressure", default=0.0, ge=0
    )


class ProximitySpec(Spec):
    """Spacecraft near an asteroid that turns, in the Hill frame of its elliptic orbit."""

    examples = (
        {
            "body": "asteroid",
            "gravity": "ellipsoid",
            "spacecraft": [{"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}],
        },
        {
            "body": "asteroid",
            "gravity": "harmonics",
            "spacecraft": list(SpacecraftSpec.examples),
            "true_anomaly_deg": 40,
            "rotation_angle_deg": 30,
            "acceleration_noise_m_s2": 1e-9,
            "radiation_noise": 0.2,
        },
    )
    gives: ClassVar[tuple[str, ...]] = ("sun", "to_body", "origin", "axes", "rate")
    """What sensors find in its scene, by name."""

    body: Ref = reference("body", "the asteroid: gives orbit, rotation and surface")
    gravity: Ref = reference("gravity", "gravity of the asteroid, in its body-fixed frame")
    spacecraft: tuple[SpacecraftSpec, ...] = option(
        "the spacecraft; six states and three controls each, in this order",
        default=(SpacecraftSpec(),),
        min_length=1,
        max_length=20,
    )
    true_anomaly_rad: float | None = quantity(
        "angle",
        "true anomaly of the asteroid at time 0; left out: by the mean anomaly of the body, or 0 "
        "if it has none",
        default=None,
    )
    rotation_angle_rad: float = quantity(
        "angle",
        "angle about the spin axis from away from the Sun to the asteroid's longitude 0 at time 0; "
        "with an obliquity counted in orbit and equator by way of their common line",
        default=0.0,
    )
    radiation_pressure_n_m2: float = option(
        "radiation pressure of the Sun at 1 au, N/m²", default=4.56e-6, ge=0, le=1e-2
    )
    acceleration_noise_m_s2: float = quantity(
        "acceleration",
        "standard deviation, on each axis, of random accelerations (thrusters of attitude "
        "control), for simulations and filters that hold them over their steps",
        default=0.0,
        ge=0,
    )
    radiation_noise: float = option(
        "standard deviation of the random part of radiation pressure, as a part of it",
        default=0.0,
        ge=0,
    )
    escape_radius_m: float | None = quantity(
        "length", "distance from the asteroid at which a flight ends as escaped",
        default=None, gt=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _different_names(self) -> Self:
        given = [craft.name for craft in self.spacecraft if craft.name]
        if len(set(given)) < len(given):
            text = f"names repeat: {', '.join(given)}"
            raise rule("spacecraft", text)
        return self


class HeliocentricSpec(Spec):
    """Bodies and spacecraft on their ways around the Sun, in the axes of the ecliptic of J2000."""

    examples = (
        {"bodies": [{"name": "asteroid"}]},
        {"bodies": [{"name": "asteroid"}, SpacecraftSpec.examples[0]]},
    )

    bodies: tuple[SpacecraftSpec, ...] = option(
        "the bodies; six states and three controls each, in this order", min_length=1, max_length=20
    )
    primary_gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter of the Sun; left out: the nominal value",
        default=NOMINAL_SOLAR_GM_M3_S2,
        **STAR_GM_M3_S2,
    )
    radiation_pressure_n_m2: float = option(
        "radiation pressure of the Sun at 1 au, N/m²", default=4.56e-6, ge=0, le=1e-2
    )


class RelativeElementsSpec(Spec):
    """Orbital elements of a spacecraft less those of the asteroid; the periods are the same."""

    examples = (
        {
            "eccentricity": -2.102e-10,
            "inclination_rad": 3.257e-9,
            "node_rad": 2.976e-8,
            "periapsis_rad": -4.318e-8,
        },
    )

    eccentricity: float = option("difference δe of the eccentricity", default=0.0)
    inclination_rad: float = quantity("angle", "δi of the inclination", default=0.0)
    node_rad: float = quantity("angle", "δΩ of the longitude of the ascending node", default=0.0)
    periapsis_rad: float = quantity("angle", "δω of the argument of periapsis", default=0.0)
    mean_anomaly_rad: float = quantity("angle", "δM of the mean anomaly", default=0.0)


class FormationReferenceSpec(StageSpec):
    """Where the spacecraft of a formation are to fly: by differences of their orbital elements."""

    results = ResultNames(
        metrics=("least_distance",),
        tables={
            "formation_distances": (
                "between",
                "least_km",
                "greatest_km",
            ),
        },
    )
    produces = "hillsphere_plants.formation_reference.stage:FormationReference"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {
            "plant": "proximity",
            "relative": [RelativeElementsSpec.examples[0]],
            "duration_d": 10,
            "interval_h": 6,
        },
    )

    plant: Ref = reference("plant", "the formation's plant, of type 'proximity'")
    relative: tuple[RelativeElementsSpec, ...] = option(
        "differences of the elements, one table a spacecraft", min_length=1, max_length=20
    )
    duration_s: float = quantity("time", "length of the trajectory", gt=0)
    interval_s: float = quantity("time", "time between the points of the reference", gt=0)

    @model_validator(mode="after")
    def _several_points(self) -> Self:
        if self.interval_s > self.duration_s:
            text = "is longer than the trajectory; shorten it"
            raise rule("interval_s", text)
        return self
