"""Specs of the body ``planet``, the keys of its table ``[body.NAME]``, and of stations on it."""

from __future__ import annotations

from math import pi
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from hillsphere.base.ranges import PLANET_GM_M3_S2, PLANET_RADIUS_M, STATION_HEIGHT_M
from hillsphere.spec.base import DataPath, Spec, data_path, option, quantity, rule

__all__ = ["GroundStationSpec", "PlanetSpec"]


class GroundStationSpec(Spec):
    """A ground station: its name and location."""

    examples: ClassVar[tuple[dict[str, Any], ...]] = (
        {"name": "Alcantara", "latitude_deg": -2.18, "longitude_deg": -44.26, "height_m": 39},
    )

    name: str = option("name of the station", min_length=1, max_length=60)
    latitude_rad: float = quantity("angle", "geodetic latitude", ge=-pi / 2, le=pi / 2)
    longitude_rad: float = quantity("angle", "longitude, east positive", ge=-2 * pi, le=2 * pi)
    height_m: float = quantity(
        "length", "height above the ellipsoid", default=0.0, **STATION_HEIGHT_M
    )


class PlanetSpec(Spec):
    """A planet with an ellipsoid for ground stations and the rotation of the Earth."""

    examples = (
        {"orientation": "constant"},
        {
            "name": "earth",
            "gm_km3_s2": 398600.4418,
            "equatorial_radius_km": 6378.137,
            "inverse_flattening": 298.257223563,
            "orientation": "constant",
            "ut1_minus_utc_s": -0.1726,
        },
    )

    name: str = option("name used in frames and figures", default="earth", min_length=1)
    gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter, for mean elements; left out: of the Earth with its atmosphere "
        "(WGS 84). Numerical flights take that of their gravity model",
        default=3.986004418e14,
        **PLANET_GM_M3_S2,
    )
    equatorial_radius_m: float = quantity(
        "length",
        "semi-major axis of the ellipsoid; left out: WGS 84",
        default=6378137.0,
        **PLANET_RADIUS_M,
    )
    inverse_flattening: float = option(
        "1/f of the ellipsoid; left out: WGS 84", default=298.257223563, gt=1
    )
    rotation_rate_rad_s: float | None = quantity(
        "angular_rate",
        "rate of rotation in numerical flights, about the axis; left out: of the Earth in the "
        "frame of the flight, 7.2921158553e-5 (teme) or 7.2921151467e-5 rad/s (gcrs)",
        default=None,
    )
    orientation: Literal["iers", "constant"] = option(
        "where UT1 and polar motion come from: tables of the IERS, or UT1 − UTC as a constant and "
        "no polar motion",
        default="iers",
    )
    orientation_file: DataPath | None = data_path(
        "table of the IERS in the format finals2000A; left out: that of the package "
        "astropy-iers-data",
        default=None,
    )
    ut1_minus_utc_s: float = quantity(
        "time",
        "with orientation = 'constant': UT1 − UTC; 0 (UT1 := UTC) misplaces stations by up to "
        "4e-3° of longitude",
        default=0.0,
        ge=-0.9,
        le=0.9,
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.orientation == "constant" and self.orientation_file is not None:
            key, text = "orientation_file", "goes with orientation = 'iers'; remove one"
        elif self.orientation == "iers" and "ut1_minus_utc_s" in self.model_fields_set:
            key, text = "ut1_minus_utc_s", "goes with orientation = 'constant'; add it, or remove"
        else:
            return self
        raise rule(key, text)
