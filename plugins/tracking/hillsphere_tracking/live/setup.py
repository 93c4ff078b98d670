"""Satellite, station and tracker of ``hillsphere track``, from a mission or from options."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians
from typing import Any, TypeVar

from hillsphere.base.geodetic import Station
from hillsphere.base.problems import did_you_mean
from hillsphere.base.ranges import STATION_HEIGHT_M
from hillsphere.errors import InputError
from hillsphere.interfaces import Tracker
from hillsphere.mission import Mission
from hillsphere.plugins import create, validate
from hillsphere.runs.assembly import Assembly
from hillsphere.spec import Spec
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.passes.sources import blind_sectors_of, mask_of, orbits_from, station_of
from hillsphere_tracking.satellite_specs import SatelliteSpec, StationSpec
from hillsphere_tracking.satellites import Orbit

__all__ = ["orbit_of", "place_of", "specs_within", "tracker_of"]

SpecT = TypeVar("SpecT", bound=Spec)


def orbit_of(
    mission: Mission | None,
    file: str,
    name: str,
    *,
    lenient: bool = False,
    checksum: str = "refuse",
) -> Orbit:
    """Return the orbit of the satellite, from a file of elements or from a mission."""
    if file:
        keys = {"file": file, "name": name, "lenient": lenient, "checksum": checksum}
        spec = validate(SatelliteSpec, keys, where="--elements")
        assert isinstance(spec, SatelliteSpec)
        orbits = orbits_from((spec,))
    elif mission is not None:
        orbits = orbits_from(tuple(specs_within(mission, SatelliteSpec)))
    else:
        raise InputError("which satellite? give --elements FILE (TLE, OMM or OEM), or --mission")
    if name and not file:
        chosen = [orbit for orbit in orbits if orbit.name == name]
        if not chosen:
            names = [orbit.name for orbit in orbits]
            raise InputError(f"--satellite: no {name!r}{did_you_mean(name, names)}")
        return chosen[0]
    if len(orbits) != 1:
        there = ", ".join(orbit.name for orbit in orbits[:10]) or "none"
        raise InputError(f"choose one satellite with --satellite; there are: {there}")
    return orbits[0]


def place_of(
    mission: Mission | None,
    name: str,
    coordinates: tuple[float | None, float | None, float],
    mask_deg: float | None,
) -> Place:
    """Return the station with its mask and blind sectors, by coordinates or from a mission.

    Parameters
    ----------
    mission : Mission or None
        Mission that may contain the station.
    name : str
        Name of the station; may be empty if there is only one.
    coordinates : tuple
        Latitude and longitude, degrees, or None, and height, m.
    mask_deg : float or None
        Elevation of rise and set; by default the mission's mask, else 0°.

    Raises
    ------
    InputError
        If the station is ambiguous or unknown, or a value is out of range.
    """
    if mask_deg is not None and not abs(mask_deg) < 90.0:
        raise InputError(f"--mask must lie between -90° and 90°, got {mask_deg:g}°")
    mask = None if mask_deg is None else HorizonMask((radians(mask_deg),))
    latitude, longitude, height_m = coordinates
    if latitude is not None and longitude is not None:
        if not abs(latitude) <= 90.0:
            raise InputError(f"--latitude must be from -90° to 90°, got {latitude:g}°")
        if not abs(longitude) <= 360.0:
            raise InputError(f"--longitude must be from -360° to 360°, got {longitude:g}°")
        low, high = STATION_HEIGHT_M["ge"], STATION_HEIGHT_M["le"]
        if not low <= height_m <= high:
            raise InputError(f"--height must be from {low:g} to {high:g} m, got {height_m:g} m")
        given = Station(name or "station", radians(latitude), radians(longitude), height_m)
        return Place(given, mask or HorizonMask())
    if mission is None or latitude is not None or longitude is not None:
        raise InputError("which station? give --latitude and --longitude, or --mission")
    stations = {spec.name: spec for spec in specs_within(mission, StationSpec)}
    if not name and len(stations) == 1:
        name = next(iter(stations))
    if name not in stations:
        raise InputError(
            f"--station: no {name!r}{did_you_mean(name, stations, otherwise='there are')}"
        )
    spec = stations[name]
    return Place(station_of(spec), mask or mask_of(spec), blind_sectors_of(spec))


def tracker_of(mission: Mission | None, name: str) -> Tracker[Any]:
    """Return a tracker: a table of the mission, or a type with its default parameters."""
    if mission is not None and name in mission.specs.get("tracker", {}):
        tracker: Tracker[Any] = Assembly(mission).get("tracker", name)
    else:
        tracker = create("tracker", name)
    return tracker


def specs_within(mission: Mission, kind: type[SpecT]) -> Iterator[SpecT]:
    """Yield the distinct Specs of a class in the tables of a mission, at any depth."""
    seen: list[SpecT] = []

    def walk(value: Any) -> Iterator[SpecT]:
        if isinstance(value, kind):
            if value not in seen:
                seen.append(value)
                yield value
        elif isinstance(value, Spec):
            for name in type(value).model_fields:
                yield from walk(getattr(value, name))
        elif isinstance(value, tuple):
            for item in value:
                yield from walk(item)

    for tables in mission.specs.values():
        for spec in tables.values():
            yield from walk(spec)
