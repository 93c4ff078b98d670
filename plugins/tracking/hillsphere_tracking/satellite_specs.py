"""Specs of satellites and ground stations, which several stages share."""

from __future__ import annotations

from itertools import pairwise
from math import pi
from typing import Self

from pydantic import model_validator

from hillsphere.base.ranges import (
    ORBIT_RADIUS_M,
    PLANET_GM_M3_S2,
    PLANET_RADIUS_M,
)
from hillsphere.model.earth.specs import GroundStationSpec
from hillsphere.spec import DataPath, Spec, data_path, option, quantity, rule
from hillsphere_tracking.tle import Checksum

__all__ = ["BlindSectorSpec", "MeanElementsSpec", "SatelliteSpec", "StationSpec", "ZonalFieldSpec"]


class ZonalFieldSpec(Spec):
    """Zonal gravity field of the Earth for the theory of mean elements."""

    examples = ({},)

    gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter",
        default=398600.4418e9,
        **PLANET_GM_M3_S2,
    )
    radius_m: float = quantity(
        "length",
        "equatorial radius to which J2 and J4 refer",
        default=6378137.0,
        **PLANET_RADIUS_M,
    )
    j2: float = option("zonal coefficient J2", default=1.08262668e-3)
    j4: float = option("zonal coefficient J4", default=-1.61962159e-6)


class MeanElementsSpec(Spec):
    """Brouwer's mean elements, referred to the true equator and mean equinox of date."""

    examples = (
        {
            "epoch": "1989-01-31T09:58:00",
            "semi_major_axis_km": 7180,
            "eccentricity": 0.0436,
            "inclination_deg": 23.82,
            "node_deg": 240.14,
            "perigee_deg": 15.47,
            "mean_anomaly_deg": 350.56,
        },
    )

    epoch: str = option("date and time of the elements, UTC", max_length=40)
    semi_major_axis_m: float = quantity("length", "semi-major axis", **ORBIT_RADIUS_M)
    eccentricity: float = option("eccentricity", ge=0, lt=1)
    inclination_rad: float = quantity("angle", "inclination", ge=0, le=pi)
    node_rad: float = quantity("angle", "right ascension of the ascending node")
    perigee_rad: float = quantity("angle", "argument of perigee")
    mean_anomaly_rad: float = quantity("angle", "mean anomaly")
    short_period: bool = option("whether the short-period terms of J2 are added", default=True)
    field: ZonalFieldSpec = option("gravity of the Earth", default=ZonalFieldSpec())


class SatelliteSpec(Spec):
    """One satellite, or all satellites of a file: exactly one of `tle`, `file`, `elements`."""

    examples = (
        {"name": "SCD", "elements": MeanElementsSpec.examples[0]},
        {
            "tle": "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991\n"
            "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482"
        },
    )

    name: str = option(
        "name of the satellite; with a file: name or catalogue number of one of its satellites, "
        "default: all (of a kernel: name or NAIF number, default: the only one)",
        default="",
        max_length=60,
    )
    label: str = option(
        "name of the satellite in tables; default: the name in its elements",
        default="",
        max_length=60,
    )
    tle: str = option(
        "two-line element set, with or without a title line", default="", max_length=400
    )
    file: DataPath | None = data_path(
        "two-line element sets, orbit mean-elements messages (CCSDS OMM, KVN or XML), an orbit "
        "ephemeris message (CCSDS OEM), or an SPK kernel, which needs the extra spice",
        default=None,
    )
    kernels: tuple[DataPath, ...] = data_path(
        "with an SPK kernel: further kernels, of the bodies between (SPK), of names and frames "
        "(text)",
        default=(),
    )
    elements: MeanElementsSpec | None = option("mean elements", default=None)
    lenient: bool = option(
        "whether harmless departures of messages from the standard are warnings, not errors",
        default=False,
    )
    checksum: Checksum = option(
        "what a wrong checksum of an element set is: refuse, an error; warn, a warning; ignore",
        default="refuse",
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [key for key in ("tle", "file", "elements") if getattr(self, key) not in ("", None)]
        if len(given) != 1:
            text = "a satellite needs exactly one of tle, file and elements, got "
            text += " and ".join(given) if given else "none"
            key = given[-1] if given else "name"
            raise rule(key, text)
        if self.elements is not None and not self.name:
            text = "mean elements need the satellite's name"
            raise rule("elements", text)
        if self.kernels and self.file is None:
            raise rule("kernels", "only a file may be a kernel; leave them out or give file")
        return self


class BlindSectorSpec(Spec):
    """A sector of the sky in which the antenna cannot be used."""

    examples = ({"azimuth_deg": [350, 20], "elevation_deg": [0, 30], "reason": "hill"},)

    azimuth_rad: tuple[float, float] = quantity(
        "angle", "azimuths: from the first eastwards to the second", ge=0, le=2 * pi + 1e-12
    )
    elevation_rad: tuple[float, float] = quantity(
        "angle", "elevations: from the lower to the higher",
        default=(0.0, pi / 2), ge=-pi / 2, le=pi / 2 + 1e-12,
    )  # fmt: skip
    reason: str = option(
        "name of the obstacle in tables", default="blind sector", min_length=1, max_length=60
    )

    @model_validator(mode="after")
    def _lower_first(self) -> Self:
        if not self.elevation_rad[0] < self.elevation_rad[1]:
            text = "the second elevation must be above the first"
            raise rule("elevation_rad", text)
        return self


class StationSpec(GroundStationSpec):
    """A ground station: location, horizon mask, blind sectors and limits of its antenna."""

    examples = (
        {
            "name": "Alcantara",
            "latitude_deg": -2.18,
            "longitude_deg": -44.26,
            "height_m": 39,
            "mask_elevation_deg": [5],
        },
        {
            "name": "Cuiaba",
            "latitude_deg": -15.53,
            "longitude_deg": -56.07,
            "height_m": 277,
            "mask_azimuth_deg": [0, 90, 200],
            "mask_elevation_deg": [5, 12, 3],
            "blind_sectors": [{"azimuth_deg": [350, 20], "elevation_deg": [0, 30]}],
            "beam_half_angle_deg": 3,
            "keyhole_elevation_deg": 85,
        },
    )

    mask_elevation_rad: tuple[float, ...] = quantity(
        "angle",
        "least visible elevation: a single one, or one for each azimuth of the mask, with linear "
        "interpolation between them",
        default=(0.0,), min_length=1, max_length=400, gt=-pi / 2, lt=pi / 2,
    )  # fmt: skip
    mask_azimuth_rad: tuple[float, ...] = quantity(
        "angle", "azimuths of the mask, rising", default=(0.0,), min_length=1, max_length=400,
        ge=0, lt=2 * pi,
    )  # fmt: skip
    blind_sectors: tuple[BlindSectorSpec, ...] = option(
        "sectors of the sky in which the antenna cannot be used", default=(), max_length=40
    )
    beam_half_angle_rad: float | None = quantity(
        "angle", "angle from the beam's axis within which the Sun disturbs; default: not computed",
        default=None, gt=0, lt=pi,
    )  # fmt: skip
    keyhole_elevation_rad: float | None = quantity(
        "angle", "elevation above which a pass is marked as one through the mount's keyhole",
        default=None, gt=0, le=pi / 2,
    )  # fmt: skip

    @model_validator(mode="after")
    def _mask(self) -> Self:
        azimuth = self.mask_azimuth_rad
        text = ""
        if len(azimuth) != len(self.mask_elevation_rad):
            text = (
                f"a mask needs as many azimuths as elevations, got {len(azimuth)} and "
                f"{len(self.mask_elevation_rad)}"
            )
        elif any(b <= a for a, b in pairwise(azimuth)):
            text = "the azimuths of a mask must rise"
        if text:
            raise rule("mask_azimuth_rad", text)
        return self
