"""Orbits, stations, masks and blind sectors from the Specs of a mission."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import WGS84, Ellipsoid, Station
from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.mean_elements import ZonalField
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.passes.specs import OLDEST_ELEMENTS_S
from hillsphere_tracking.satellite_specs import MeanElementsSpec, SatelliteSpec, StationSpec
from hillsphere_tracking.satellites import MeanElementsOrbit, Orbit, Sgp4Orbit, orbits_of
from hillsphere_tracking.tle import Checksum

__all__ = [
    "blind_sectors_of",
    "element_warnings",
    "mask_of",
    "orbits_from",
    "orbits_of_file",
    "station_of",
]

_LARGEST_FILE = 20_000_000
"""Bytes of a file of elements at most: the public catalogue of 30 000 objects takes 5 MB as
two-line sets."""


def orbits_from(specs: Sequence[SatelliteSpec]) -> tuple[Orbit, ...]:
    """Return the orbits of satellites.

    Parameters
    ----------
    specs : sequence of SatelliteSpec
        Satellites; named files are read.

    Returns
    -------
    tuple of Orbit
        Orbits in the order of the Specs, and of each file; all names are different.

    Raises
    ------
    InputError
        If a file cannot be read, does not contain the named satellite, or two satellites have the
        same name.
    """
    collected: list[Orbit] = []
    for spec in specs:
        if spec.elements is not None:
            collected.append(_mean_elements_orbit(spec.label or spec.name, spec.elements))
        elif spec.file is not None:
            collected += orbits_of_file(
                Path(spec.file), spec.name, spec.label, lenient=spec.lenient,
                checksum=spec.checksum,
            )  # fmt: skip
        else:
            orbits = orbits_of(spec.tle, "tle", lenient=spec.lenient, checksum=spec.checksum)
            if len(orbits) != 1:
                raise InputError(
                    f"tle: expected one element set, got {len(orbits)}; write one satellite per "
                    "element set, or name a file"
                )
            if name := spec.label or spec.name:
                orbits[0].name = name
            collected += orbits
    names = [orbit.name for orbit in collected]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"satellites: the name {twice[0]!r} occurs twice; give each satellite its own label"
        )
    return tuple(collected)


def element_warnings(
    orbits: Sequence[Orbit], start: Epoch, duration_s: float, oldest_s: float = OLDEST_ELEMENTS_S
) -> list[str]:
    """Return sentences about elements that are far from a span, and what readers tolerated.

    Parameters
    ----------
    orbits : sequence of Orbit
        The orbits.
    start : Epoch
        Beginning of the span.
    duration_s : float
        Its length.
    oldest_s : float
        Age from which a warning is given, before or after the epoch of the elements.
    """
    sentences: list[str] = []
    for orbit in orbits:
        sentences += getattr(orbit, "warnings", ())
        age = start.seconds_since(orbit.epoch)
        farthest = max(abs(age), abs(age + duration_s))
        if farthest > oldest_s:
            sentences.append(
                f"The elements of {orbit.name} are up to {farthest / DAY_S:.0f} days away from the "
                f"span, more than {oldest_s / DAY_S:g}: times of its passes may be wrong by "
                "seconds to minutes."
            )
    return sentences


def station_of(spec: StationSpec, ellipsoid: Ellipsoid = WGS84) -> Station:
    """Return the station that a Spec describes, on an ellipsoid."""
    return Station(spec.name, spec.latitude_rad, spec.longitude_rad, spec.height_m, ellipsoid)


def mask_of(spec: StationSpec) -> HorizonMask:
    """Return a station's horizon mask."""
    return HorizonMask(spec.mask_elevation_rad, spec.mask_azimuth_rad)


def blind_sectors_of(spec: StationSpec) -> tuple[BlindSector, ...]:
    """Return the blind sectors of a station."""
    return tuple(
        BlindSector(sector.azimuth_rad, sector.elevation_rad, sector.reason)
        for sector in spec.blind_sectors
    )


def _mean_elements_orbit(name: str, spec: MeanElementsSpec) -> MeanElementsOrbit:
    try:
        epoch = Epoch.parse(spec.epoch, "UTC")
    except InputError as error:
        raise InputError(f"satellite {name!r}: epoch: {error}") from error
    elements = np.array(
        [
            spec.semi_major_axis_m, spec.eccentricity, spec.inclination_rad, spec.node_rad,
            spec.perigee_rad, spec.mean_anomaly_rad,
        ]
    )  # fmt: skip
    earth = ZonalField(spec.field.gm_m3_s2, spec.field.radius_m, spec.field.j2, spec.field.j4)
    perigee = spec.semi_major_axis_m * (1.0 - spec.eccentricity)
    if perigee < earth.radius_m:
        raise InputError(
            f"satellite {name!r}: its perigee, {perigee / 1e3:.6g} km from the centre, lies within "
            "the Earth; check semi-major axis and eccentricity"
        )
    return MeanElementsOrbit(name, epoch, elements, earth, short_period=spec.short_period)


def orbits_of_file(
    path: Path,
    name: str = "",
    label: str = "",
    *,
    lenient: bool = False,
    checksum: Checksum = "refuse",
) -> list[Sgp4Orbit]:
    """Return the orbits of a file of element sets (TLE, or OMM in either form).

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Name or catalogue number of the satellite; by default all satellites.
    label : str
        New name of the satellite.
    lenient, checksum
        As for `orbits_of`.

    Raises
    ------
    InputError
        If the file cannot be read, or does not contain the satellite exactly once.
    """
    try:
        text = read_text(path, "utf-8-sig", _LARGEST_FILE)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise InputError(
                f"{path.name}: larger than {_LARGEST_FILE // 1_000_000} MB; split it"
            ) from error
        raise InputError(f"{path.name}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name}: not a text file: {error}") from error
    orbits = orbits_of(text, path.name, lenient=lenient, checksum=checksum)
    if not name:
        if label and len(orbits) != 1:
            raise InputError(
                f"{path.name}: the label {label!r} would name {len(orbits)} satellites; choose one "
                "satellite with name"
            )
        return _set_label(list(orbits), label)
    chosen = [orbit for orbit in orbits if name in (orbit.name, orbit.catalogue_number)]
    if not chosen:
        there = ", ".join(orbit.name for orbit in orbits[:10])
        more = " …" if len(orbits) > 10 else ""
        raise InputError(
            f"{path.name}: the file has no satellite {name!r}; there are: {there}{more}"
        )
    if len(chosen) > 1:
        raise InputError(
            f"{path.name}: the file has {len(chosen)} element sets of {name!r}; keep one of them"
        )
    return _set_label(chosen, label)


def _set_label(orbits: list[Sgp4Orbit], label: str) -> list[Sgp4Orbit]:
    if label:
        orbits[0].name = label
    return orbits
