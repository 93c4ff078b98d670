"""Spec of the stage ``passes``.

References
----------
.. [1] D. A. Vallado, P. Crawford, R. Hujsak, T. S. Kelso (2006), Revisiting Spacetrack Report #3,
   AIAA 2006-6753 (errors of SGP4 with the age of elements).
"""

from __future__ import annotations

from hillsphere.base.constants import DAY_S
from hillsphere.base.ranges import PRESSURE_HPA
from hillsphere.spec import Ref, ResultNames, StageSpec, option, quantity, reference
from hillsphere_tracking.satellite_specs import SatelliteSpec, StationSpec

__all__ = ["OLDEST_ELEMENTS_S", "PassesSpec"]

OLDEST_ELEMENTS_S = 14.0 * DAY_S
"""Age of elements from which a warning is given, by default. SGP4 gains 1 to 3 km a day along the
track of a low orbit [1]_, so that after 14 days a pass is off by some seconds, and about a degree
of azimuth on the way."""


class PassesSpec(StageSpec):
    """Passes of satellites over ground stations."""

    results = ResultNames(
        metrics=("passes",),
        tables={
            "passes": (),
            "visibility": (),
            "disturbances": (),
            "eclipses": (),
        },
    )
    produces = "hillsphere_tracking.passes.products:PassList"
    examples = (
        {
            "body": "planet",
            "satellites": [SatelliteSpec.examples[0]],
            "stations": [StationSpec.examples[0]],
            "duration_h": 8,
        },
        {
            "body": "planet",
            "plant": "earth_orbit",
            "satellites": [SatelliteSpec.examples[0]],
            "stations": [StationSpec.examples[0]],
            "duration_h": 3,
        },
        {
            "satellites": [SatelliteSpec.examples[1]],
            "stations": list(StationSpec.examples),
            "start": "2019-12-10",
            "duration_d": 1,
            "refraction": True,
        },
    )

    body: Ref | None = reference(
        "body",
        "the Earth, a body of type planet, with ellipsoid and rotation; default: WGS 84 and the "
        "tables of the IERS",
        default=None,
    )
    plant: Ref | None = reference(
        "plant",
        "plant that flies the satellites from their elements; default: the theory of the elements",
        default=None,
    )
    satellites: tuple[SatelliteSpec, ...] = option("satellites", min_length=1, max_length=400)
    stations: tuple[StationSpec, ...] = option("ground stations", min_length=1, max_length=100)
    start: str = option(
        "beginning of the search for passes, UTC; default: the epoch of the first satellite's "
        "elements",
        default="",
        max_length=40,
    )
    duration_s: float = quantity(
        "time", "length of the search for passes", default=86400.0, gt=0, le=400 * 86400.0
    )
    oldest_elements_s: float = quantity(
        "time",
        "age of elements, before or after their epoch, from which a warning is given; SGP4 gains "
        "1 to 3 km a day along the track of a low orbit",
        default=OLDEST_ELEMENTS_S, gt=0, le=4000 * 86400.0,
    )  # fmt: skip
    refraction: bool = option(
        "whether elevations in masks and tables are apparent (with refraction)",
        default=False,
    )
    pressure_hpa: float = option(
        "pressure of the air, for refraction, hPa",
        default=1010.0,
        ge=PRESSURE_HPA["ge"],
        le=PRESSURE_HPA["le"],
    )
    temperature_c: float = option(
        "temperature of the air, for refraction, °C", default=10.0, gt=-150, lt=100
    )
    label: str = option(
        "suffix of the names of tables and figures, which distinguishes two such stages",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )
