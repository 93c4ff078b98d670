"""Specs of the ground antenna: the keys of a ``[sensor.NAME]`` of type ``antenna``."""

from __future__ import annotations

from math import pi

from hillsphere.base.ranges import STATION_HEIGHT_M
from hillsphere.spec import Pair, Spec, Vector3, option, quantity

__all__ = ["AntennaSpec"]

_DEGREE = pi / 180.0
_AZIMUTH = (0.05 * _DEGREE, 0.01 * _DEGREE, 0.001 * _DEGREE)
_ELEVATION = (0.05 * _DEGREE, 0.001 * _DEGREE, 0.01 * _DEGREE)
_OF_AZIMUTH = "constant part, part over cos h, and part over cos h for each 1000 km of range"
_OF_ELEVATION = "constant part, part over sin h, and part times cot h"


class AntennaSpec(Spec):
    """A tracking antenna on the ground that measures azimuth and elevation (WGS 84)."""

    examples = (
        {"station": "Alcantara", "latitude_deg": -2.18, "longitude_deg": -44.26, "height_m": 39},
        {
            "station": "Cuiaba",
            "latitude_deg": -15.53,
            "longitude_deg": -56.07,
            "height_m": 277,
            "believed_latitude_deg": -15.5,
            "believed_longitude_deg": -56,
            "believed_height_m": 270,
            "station_sigma_m": [10, 10, 20],
            "azimuth_bias_deg": [0, 0, 0],
            "elevation_bias_deg": [0, 0, 0],
            "bias_sigma_deg": [0.1, 0.1],
            "dropout_probability": 0.1,
            "outlier_probability": 0.02,
        },
    )

    station: str = option("name of the station", min_length=1, max_length=60)
    latitude_rad: float = quantity("angle", "true geodetic latitude", ge=-pi / 2, le=pi / 2)
    longitude_rad: float = quantity("angle", "true longitude, east positive", ge=-2 * pi, le=2 * pi)
    height_m: float = quantity(
        "length", "true height above the ellipsoid", default=0.0, **STATION_HEIGHT_M
    )
    believed_latitude_rad: float | None = quantity(
        "angle", "latitude that trackers are told; left out: the true one",
        default=None, ge=-pi / 2, le=pi / 2,
    )  # fmt: skip
    believed_longitude_rad: float | None = quantity(
        "angle", "longitude that trackers are told; left out: the true one",
        default=None, ge=-2 * pi, le=2 * pi,
    )  # fmt: skip
    believed_height_m: float | None = quantity(
        "length",
        "height that trackers are told; left out: the true one",
        default=None,
        **STATION_HEIGHT_M,
    )
    station_sigma_m: Vector3 = quantity(
        "length",
        "standard deviation, east, north and up, by which the believed place differs from case to "
        "case",
        default=(0.0, 0.0, 0.0), ge=0,
    )  # fmt: skip
    mask_elevation_rad: float = quantity(
        "angle", "true elevation from which there are measurements",
        default=5.0 * _DEGREE, ge=0, lt=pi / 2,
    )  # fmt: skip
    azimuth_noise_rad: Vector3 = quantity(
        "angle", f"standard deviation of the azimuth's noise: {_OF_AZIMUTH}", default=_AZIMUTH, ge=0
    )
    elevation_noise_rad: Vector3 = quantity(
        "angle",
        f"standard deviation of the elevation's noise: {_OF_ELEVATION}",
        default=_ELEVATION,
        ge=0,
    )
    azimuth_bias_rad: Vector3 = quantity(
        "angle", f"bias of the azimuth, measured minus true: {_OF_AZIMUTH}", default=_AZIMUTH
    )
    elevation_bias_rad: Vector3 = quantity(
        "angle", f"bias of the elevation, measured minus true: {_OF_ELEVATION}", default=_ELEVATION
    )
    bias_sigma_rad: Pair = quantity(
        "angle",
        "standard deviation of further biases of azimuth and elevation, constant within a case",
        default=(0.0, 0.0), ge=0,
    )  # fmt: skip
    horizon_bias_sigma_rad: float = quantity(
        "angle",
        "standard deviation, at 45° elevation, of a further bias of the elevation that goes with "
        "its cotangent",
        default=0.0, ge=0,
    )  # fmt: skip
    dropout_probability: float = option(
        "probability that a measurement is missing, each for itself", default=0.0, ge=0, le=1
    )
    outlier_probability: float = option(
        "probability that a measurement is an outlier, each for itself", default=0.0, ge=0, le=1
    )
    outlier_sigma_rad: float = quantity(
        "angle", "standard deviation of what outliers add to both angles",
        default=5.0 * _DEGREE, gt=0,
    )  # fmt: skip
