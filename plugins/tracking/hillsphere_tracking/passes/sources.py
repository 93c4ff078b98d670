"""Orbits, stations, masks and blind sectors from the Specs of a mission."""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import WGS84, Ellipsoid, Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.formats.ephemeris_files import refuse_kernels
from hillsphere.model.spk import is_daf, read_spk
from hillsphere.time import Epoch
from hillsphere_tracking.ephemeris_orbit import (
    EphemerisOrbit,
    ephemeris_orbits_of,
    orbits_of_segments,
)
from hillsphere_tracking.mean_elements import ZonalField
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.passes.specs import OLDEST_ELEMENTS_S
from hillsphere_tracking.satellite_specs import MeanElementsSpec, SatelliteSpec, StationSpec
from hillsphere_tracking.satellites import MeanElementsOrbit, Orbit, Sgp4Orbit, orbits_of
from hillsphere_tracking.tle import Checksum

__all__ = [
    "blind_sectors_of",
    "covering",
    "element_warnings",
    "is_ephemeris",
    "mask_of",
    "orbits_from",
    "orbits_of_file",
    "station_of",
]

_LARGEST_FILE = 20_000_000
"""Bytes of a file of elements at most: the public catalogue of 30 000 objects takes 5 MB as
two-line sets."""
_BEGINNING = 4096
"""Characters at the beginning of a file that say what it is: comments may stand before them."""


def orbits_from(
    specs: Sequence[SatelliteSpec], orientation: EarthOrientation = UT1_IS_UTC
) -> tuple[Orbit, ...]:
    """Return the orbits of satellites.

    Parameters
    ----------
    specs : sequence of SatelliteSpec
        Satellites; named files are read.
    orientation : EarthOrientation
        UT1 and polar motion, by which Earth-fixed states of an ephemeris are turned.

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
                checksum=spec.checksum, orientation=orientation, kernels=spec.kernels,
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
        if isinstance(orbit, EphemerisOrbit):
            since = orbit.epoch.seconds_since(start)
            if since > 0.0 or since + orbit.last_s < duration_s:
                sentences.append(
                    f"The ephemeris of {orbit.name} covers {orbit.covered()} only: there is no "
                    "pass outside this span."
                )
            continue
        age = start.seconds_since(orbit.epoch)
        farthest = max(abs(age), abs(age + duration_s))
        if farthest > oldest_s:
            sentences.append(
                f"The elements of {orbit.name} are up to {farthest / DAY_S:.0f} days away from the "
                f"span, more than {oldest_s / DAY_S:g}: times of its passes may be wrong by "
                "seconds to minutes."
            )
    return sentences


def covering(orbits: Sequence[Orbit], start: Epoch, duration_s: float) -> tuple[Orbit, ...]:
    """Return the orbits without those parts of an ephemeris that lie outside a search.

    Parameters
    ----------
    orbits : sequence of Orbit
        The orbits.
    start : Epoch
        Beginning of the search.
    duration_s : float
        Its length.

    Raises
    ------
    InputError
        If no part of a satellite's ephemeris, or no orbit at all, has a state within the search.
    """
    within: list[Orbit] = []
    for orbit in orbits:
        if isinstance(orbit, EphemerisOrbit):
            since = orbit.epoch.seconds_since(start)
            if since >= duration_s or since + orbit.last_s <= 0.0:
                continue
        within.append(orbit)
    if not within:
        spans = "; ".join(o.covered() for o in orbits if isinstance(o, EphemerisOrbit))
        (begin, end) = start.isot(np.array([0.0, duration_s]), 0)
        raise InputError(
            f"start: expected a search within the ephemeris of {orbits[0].name}, which covers "
            f"{spans}, got {begin} to {end} UTC"
        )
    return tuple(within)


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
    orientation: EarthOrientation = UT1_IS_UTC,
    kernels: Sequence[str] = (),
) -> list[Sgp4Orbit | EphemerisOrbit]:
    """Return the orbits of a file: element sets (TLE, OMM) or an ephemeris (OEM, SPK).

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Name or catalogue number of the satellite; by default all satellites, of a kernel the only
        one.
    label : str
        New name of the satellite.
    lenient, checksum
        As for `orbits_of`.
    orientation : EarthOrientation
        As for `orbits_from`.
    kernels : sequence of str
        Of a kernel: further ones, see `hillsphere.model.spk.read_spk`.

    Raises
    ------
    InputError
        If the file cannot be read, or does not contain the satellite exactly once.
    """
    if is_daf(path):
        segments = read_spk(path, name, centres=("EARTH",), kernels=kernels)
        return _set_label(list(orbits_of_segments(segments, path.name, orientation)), label)
    refuse_kernels(path, kernels)
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
    orbits: Sequence[Sgp4Orbit | EphemerisOrbit]
    if is_ephemeris(text):
        orbits = ephemeris_orbits_of(text, path.name, lenient=lenient, orientation=orientation)
    else:
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
    if len(chosen) > 1 and isinstance(chosen[0], Sgp4Orbit):
        raise InputError(
            f"{path.name}: the file has {len(chosen)} element sets of {name!r}; keep one of them"
        )
    return _set_label(chosen, label)


def is_ephemeris(text: str) -> bool:
    """Return whether a text says that it is an Orbit Ephemeris Message."""
    beginning = text[:_BEGINNING]
    return "CCSDS_OEM_VERS" in beginning or bool(re.search(r"<(\w+:)?oem\b", beginning))


def _set_label(
    orbits: list[Sgp4Orbit | EphemerisOrbit], label: str
) -> list[Sgp4Orbit | EphemerisOrbit]:
    if label:
        for number, orbit in enumerate(orbits, start=1):
            orbit.name = label if number == 1 else f"{label} #{number}"
    return orbits
