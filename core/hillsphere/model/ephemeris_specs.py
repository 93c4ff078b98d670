"""Specs of bodies in the Solar System: on a Keplerian orbit, or from a SPICE kernel."""

from __future__ import annotations

from math import pi

from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2
from hillsphere.base.ranges import ORBIT_RADIUS_M, STAR_GM_M3_S2
from hillsphere.spec.base import DataPath, Spec, data_path, option, quantity

__all__ = ["KeplerOrbitSpec", "SpiceOrbitSpec"]


class KeplerOrbitSpec(Spec):
    """A body on a Keplerian orbit around the Sun, by its elements (ecliptic and equinox J2000)."""

    examples = (
        {
            "name": "earth",
            "epoch": "2000-01-01T12:00:00",
            "semi_major_axis_au": 1.00000261,
            "eccentricity": 0.01671123,
            "inclination_deg": 0.0,
            "node_deg": 0.0,
            "periapsis_deg": 102.93768193,
            "mean_anomaly_deg": 357.52688973,
        },
    )

    name: str = option("name used in frames and figures", default="body", min_length=1)
    epoch: str = option("date and time (TDB) of the mean anomaly", max_length=40)
    primary_gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter of the Sun; left out: the nominal value",
        default=NOMINAL_SOLAR_GM_M3_S2,
        **STAR_GM_M3_S2,
    )
    semi_major_axis_m: float = quantity("length", "semi-major axis", **ORBIT_RADIUS_M)
    eccentricity: float = option("eccentricity", default=0.0, ge=0, lt=1)
    inclination_rad: float = quantity("angle", "inclination", default=0.0, ge=0, le=pi)
    node_rad: float = quantity("angle", "longitude of the ascending node", default=0.0)
    periapsis_rad: float = quantity("angle", "argument of periapsis", default=0.0)
    mean_anomaly_rad: float = quantity("angle", "mean anomaly at the epoch", default=0.0)


class SpiceOrbitSpec(Spec):
    """A body whose states are read from a SPICE kernel (SPK); needs the extra ``spice``."""

    examples = ({"name": "apophis", "kernel": "apophis.bsp", "target": "20099942"},)

    name: str = option("name used in figures", default="body", min_length=1)
    kernel: DataPath = data_path("SPK kernel (.bsp) that holds the body, and what it is given from")
    target: str = option(
        'the body: its NAIF number in quotes ("401"), or a name that SPICE knows',
        min_length=1,
        max_length=40,
    )
    centre: str = option(
        "origin of the states, a number or a name as for target; for a place in the Solar System "
        "the Sun",
        default="10", min_length=1, max_length=40,
    )  # fmt: skip
