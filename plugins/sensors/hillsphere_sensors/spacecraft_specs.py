"""Specs of the sensors of spacecraft near an asteroid, and of stations that track them."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.base.ranges import STATION_HEIGHT_M
from hillsphere.spec import Pair, Ref, Spec, option, quantity, reference, rule

__all__ = [
    "CameraSpec",
    "DeepSpaceStationSpec",
    "InterSatelliteSpec",
    "LidarSpec",
    "SpacecraftSensorSpec",
    "StarTrackerSpec",
    "SunDopplerSpec",
    "SunSensorSpec",
]

_DEGREE = pi / 180.0
_STAR_TRACKER = 1e-4 * _DEGREE
_HELIOCENTRIC = ("origin", "axes", "rate")


class SpacecraftSensorSpec(Spec):
    """Common keys of these sensors: their spacecraft, schedule, dropouts, outliers and outages."""

    spacecraft: int = option(
        "spacecraft that carries the sensor: number of its six rows among the states, from 1",
        default=1,
        ge=1,
    )
    period_s: float = quantity(
        "time", "time between measurements, from time 0 on; 0: whenever asked", default=0.0, ge=0
    )
    outages_s: tuple[Pair, ...] = quantity(
        "time", "intervals [from, to] without measurements", default=()
    )
    dropout_probability: float = option(
        "probability that a measurement is missing, each for itself", default=0.0, ge=0, le=1
    )
    outlier_probability: float = option(
        "probability that a measurement is an outlier, each for itself", default=0.0, ge=0, le=1
    )
    outlier_factor: float = option(
        "factor by which the noise of outliers is greater", default=30.0, ge=1
    )

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        return ()

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        return {}


class CameraSpec(SpacecraftSensorSpec):
    """A camera that finds the asteroid: angles from its boresight, or pixels."""

    examples = (
        {"body": "asteroid"},
        {
            "body": "asteroid",
            "target": "disc",
            "points": 80,
            "sunlit": True,
            "output": "pixels",
            "bias_px": 1,
        },
        {"body": "asteroid", "target": "disc", "sunlit": True, "photometry": "lommel_seeliger"},
        {"body": "asteroid", "target": "points", "points": 80, "output": "pixels"},
    )

    body: Ref = reference("body", "the asteroid: gives its surface")
    target: Literal["centre", "points", "disc"] = option(
        "what is found: the centre of mass; the mean of the visible points of a grid on the "
        "surface, each as good as the other; or the centroid of the visible disc, in which each "
        "counts by the area that it shows (continuous as the asteroid turns)",
        default="centre",
    )
    sunlit: bool = option("whether only what the Sun shines on is visible", default=False)
    photometry: Literal["uniform", "lambert", "lommel_seeliger"] = option(
        "radiance of a sunlit disc, with the cosines m0 of incidence and m of emission: the same "
        "everywhere; m0; or m0/(m0 + m), for dark surfaces such as asteroids'",
        default="uniform",
    )
    points: int = option(
        "points of the grid on the surface; the disc of an ellipsoid is integrated without one",
        default=400,
        ge=50,
        le=20000,
    )
    target_rows: int = option(
        "where the target is: the number of its six rows among the states; 0: at their origin",
        default=0,
        ge=0,
    )
    output: Literal["angles", "pixels"] = option(
        "angles, or pixels from the middle of the image", default="angles"
    )
    field_of_view_rad: float = quantity(
        "angle", "full field of view, in both directions", default=30.0 * _DEGREE, gt=0, lt=pi
    )
    resolution: int = option("pixels in each direction", default=2048, ge=2)
    focal_length_m: float = quantity("length", "focal length", default=1.212e-3, gt=0)
    noise_px: float = option("standard deviation of the noise, pixels", default=2.0, ge=0)
    bias_px: float = option(
        "standard deviation of a bias, pixels, constant within a case", default=0.0, ge=0
    )
    attitude_sigma_rad: float = quantity(
        "angle", "standard deviation of the attitude's noise, each axis",
        default=_STAR_TRACKER, ge=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _photometry_of_a_lit_disc(self) -> Self:
        if self.photometry != "uniform" and not (self.sunlit and self.target == "disc"):
            raise rule(
                "photometry", f"{self.photometry!r} is that of a sunlit disc; set target = 'disc' "
                "and sunlit = true, or leave it out",
            )  # fmt: skip
        return self

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        if self.target == "centre":
            return ("boresight",)
        return ("boresight", "to_body", *(["sun"] if self.sunlit else []))

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise by the keys that set them."""
        return {"noise_px and attitude_sigma_rad": hypot(self.noise_px, self.attitude_sigma_rad)}


class LidarSpec(SpacecraftSensorSpec):
    """A laser altimeter: range to the surface and, if asked, the direction of the spot."""

    examples = (
        {"body": "asteroid"},
        {"body": "asteroid", "spot": "pointing", "angles": False},
        {"body": "asteroid", "angles": False},
        {"body": "asteroid", "angles": False, "field_of_view_deg": 30},
    )

    body: Ref = reference("body", "the asteroid: gives its surface")
    spot: Literal["below", "pointing"] = option(
        "where the beam shines: on the line to the centre of mass, as if pointing were perfect "
        "and only knowledge of it in error; or along the boresight that is commanded",
        default="below",
    )
    angles: bool = option(
        "whether the spot's direction from the boresight is measured too (spot 'below')",
        default=True,
    )
    field_of_view_rad: float | None = quantity(
        "angle", "full cone about the boresight in which the centre must lie (spot 'below'); left "
        "out: gimballed, it finds the body whatever the spacecraft's attitude",
        default=None, gt=0, lt=2 * pi,
    )  # fmt: skip
    maximum_range_m: float | None = quantity(
        "length", "greatest range; left out: none", default=None, gt=0
    )
    range_sigma_m: float = quantity(
        "length", "standard deviation of the range's noise", default=10.0, ge=0
    )
    range_bias_m: float = quantity(
        "length", "standard deviation of a bias of the range, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    pointing_sigma_rad: float = quantity(
        "angle", "standard deviation of the pointing's noise, each axis",
        default=1e-3 * _DEGREE, ge=0,
    )  # fmt: skip
    pointing_bias_rad: float = quantity(
        "angle", "standard deviation of the mounting's bias, each axis, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    attitude_sigma_rad: float = quantity(
        "angle", "standard deviation of the attitude's noise, each axis",
        default=_STAR_TRACKER, ge=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _angles_say_something(self) -> Self:
        if self.angles and self.spot == "pointing":
            text = "the beam goes along the boresight: its direction from there says nothing"
            raise rule("angles", text)
        if self.field_of_view_rad is not None and self.spot == "pointing":
            raise rule("field_of_view", "the beam is the boresight and needs none; leave it out")
        return self

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        aimed = self.angles or self.spot == "pointing" or self.field_of_view_rad is not None
        return ("to_body", *(["boresight"] if aimed else []))

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        sigmas = {"range_sigma_m": self.range_sigma_m}
        if self.angles:
            angle = hypot(self.pointing_sigma_rad, self.attitude_sigma_rad)
            sigmas["pointing_sigma_rad and attitude_sigma_rad"] = angle
        return sigmas


class InterSatelliteSpec(SpacecraftSensorSpec):
    """Range and direction of another spacecraft."""

    examples = (
        {"partner": 2},
        {"partner": 2, "angles": False, "body": "asteroid", "sun_cone_deg": 0},
    )

    partner: int = option("the other spacecraft: number of its six rows", ge=1)
    range: bool = option("whether the range is measured", default=True)
    angles: bool = option("whether azimuth and elevation are measured", default=True)
    body: Ref | None = reference(
        "body", "what may stand between the two; left out: nothing", default=None
    )
    sun_cone_rad: float = quantity(
        "angle", "the sensor is blind if the Sun is nearer to its partner than this",
        default=5.0 * _DEGREE, ge=0, lt=pi,
    )  # fmt: skip
    maximum_range_m: float | None = quantity(
        "length", "greatest range; left out: none", default=None, gt=0
    )
    range_sigma_m: float = quantity(
        "length", "standard deviation of the range's noise", default=2.0, ge=0
    )
    range_bias_m: float = quantity(
        "length", "standard deviation of a bias of the range, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    angle_sigma_rad: float = quantity(
        "angle", "standard deviation of the noise of both angles", default=_STAR_TRACKER, ge=0
    )
    angle_bias_rad: float = quantity(
        "angle", "standard deviation of the mounting's bias, each angle, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _something_of_another(self) -> Self:
        if not (self.range or self.angles):
            raise rule("range", "neither range nor angles are measured; keep one")
        if self.partner == self.spacecraft:
            raise rule("partner", f"spacecraft {self.partner} cannot be its own partner")
        return self

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        needed = {"sun": bool(self.sun_cone_rad), "to_body": self.body is not None}
        return tuple(name for name, taken in needed.items() if taken)

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        sigmas = {"range_sigma_m": self.range_sigma_m} if self.range else {}
        return sigmas | ({"angle_sigma_rad": self.angle_sigma_rad} if self.angles else {})


class DeepSpaceStationSpec(SpacecraftSensorSpec):
    """A station on the Earth that measures range, range-rate or direction of a spacecraft."""

    examples = (
        {"station": "Goldstone", "latitude_deg": 35.4259, "longitude_deg": -116.8896},
        {
            "station": "observatory",
            "latitude_deg": 28.3,
            "longitude_deg": -16.5,
            "height_m": 2390,
            "measures": ["angles"],
            "mask_elevation_deg": 20,
            "sun_below_deg": 12,
        },
    )

    station: str = option("name of the station", min_length=1, max_length=60)
    latitude_rad: float = quantity("angle", "geodetic latitude, WGS 84", ge=-pi / 2, le=pi / 2)
    longitude_rad: float = quantity("angle", "longitude, east positive", ge=-2 * pi, le=2 * pi)
    height_m: float = quantity(
        "length", "height above the ellipsoid", default=0.0, **STATION_HEIGHT_M
    )
    mask_elevation_rad: float = quantity(
        "angle", "elevation from which there are measurements",
        default=10.0 * _DEGREE, ge=0, lt=pi / 2,
    )  # fmt: skip
    sun_below_rad: float | None = quantity(
        "angle", "how deep under the horizon the Sun must be (for telescopes); left out: no matter",
        default=None, ge=0, lt=pi / 2,
    )  # fmt: skip
    measures: tuple[Literal["range", "range_rate", "angles"], ...] = option(
        "what is measured: one-way range and its rate, and longitude and latitude of the line of "
        "sight in the axes of the heliocentric states",
        default=("range", "range_rate"),
        min_length=1,
    )
    range_sigma_m: float = quantity(
        "length", "standard deviation of the range's noise", default=20.0, ge=0
    )
    range_bias_m: float = quantity(
        "length", "standard deviation of a bias of the range, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    range_rate_sigma_m_s: float = quantity(
        "speed", "standard deviation of the range-rate's noise", default=5e-4, ge=0
    )
    range_rate_bias_m_s: float = quantity(
        "speed", "standard deviation of a bias of the range-rate, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    angle_sigma_rad: float = quantity(
        "angle", "standard deviation of the noise of both angles, on the sky",
        default=_STAR_TRACKER, ge=0,
    )  # fmt: skip
    angle_bias_rad: float = quantity(
        "angle", "standard deviation of a bias of both angles, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        if len(set(self.measures)) < len(self.measures):
            raise rule("measures", "names something twice")
        return self

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        return (*_HELIOCENTRIC, "earth", "earth_axes")

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        keys = {"range": "range_sigma_m", "range_rate": "range_rate_sigma_m_s"}
        every = [keys.get(name, "angle_sigma_rad") for name in self.measures]
        return {key: getattr(self, key) for key in every}


class SunDopplerSpec(SpacecraftSensorSpec):
    """Radial velocity of a spacecraft against the Sun, by the Doppler shift of sunlight."""

    examples = ({}, {"bias_mm_s": 0.05})

    sigma_m_s: float = quantity("speed", "standard deviation of the noise", default=1e-4, ge=0)
    bias_m_s: float = quantity(
        "speed", "standard deviation of a bias, constant within a case", default=0.0, ge=0
    )

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        return _HELIOCENTRIC

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        return {"sigma_m_s": self.sigma_m_s}


class SunSensorSpec(SpacecraftSensorSpec):
    """Direction of the Sun, its attitude known, in the axes of the states."""

    examples = ({}, {"field_of_view_deg": 120})

    sigma_rad: float = quantity(
        "angle", "standard deviation of the noise, each axis", default=0.01 * _DEGREE, ge=0
    )
    bias_rad: float = quantity(
        "angle", "standard deviation of a bias, each axis, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    field_of_view_rad: float | None = quantity(
        "angle", "full cone about the direction opposite to the boresight; left out: all around",
        default=None, gt=0, le=2 * pi,
    )  # fmt: skip

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        return ("sun", *(["boresight"] if self.field_of_view_rad is not None else []))

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        return {"sigma_rad": self.sigma_rad}


class StarTrackerSpec(SpacecraftSensorSpec):
    """Attitude of a spacecraft: a small turn from the one that is commanded."""

    examples = ({}, {"roll_sigma_deg": 1e-3, "bias_deg": 1e-4, "sun_cone_deg": 30})

    sigma_rad: float = quantity(
        "angle", "standard deviation of the noise across the boresight, each axis",
        default=_STAR_TRACKER, ge=0,
    )  # fmt: skip
    roll_sigma_rad: float = quantity(
        "angle", "standard deviation of the noise about the boresight",
        default=8.0 * _STAR_TRACKER, ge=0,
    )  # fmt: skip
    bias_rad: float = quantity(
        "angle", "standard deviation of the mounting's bias, each axis, constant within a case",
        default=0.0, ge=0,
    )  # fmt: skip
    sun_cone_rad: float = quantity(
        "angle",
        "the sensor is blind if the Sun is nearer to its boresight than this; looks away from "
        "the asteroid",
        default=0.0, ge=0, lt=pi,
    )  # fmt: skip

    @property
    def takes(self) -> tuple[str, ...]:
        """What it takes from the scene, by name."""
        return ("attitude", *(["sun", "boresight"] if self.sun_cone_rad else []))

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviations of the noise, SI, by the keys that set them."""
        return {"sigma_rad": self.sigma_rad, "roll_sigma_rad": self.roll_sigma_rad}
