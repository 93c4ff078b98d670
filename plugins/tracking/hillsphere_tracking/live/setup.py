"""From what ``hillsphere track`` is told to a session: satellite, station, tracker, mount, pass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, radians
from typing import Any, TypeVar

import numpy as np

from hillsphere.assembly import Assembly
from hillsphere.earth.geodetic import Station
from hillsphere.earth.orientation import EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.mission import Mission
from hillsphere.plugins import create, validate
from hillsphere.problems import did_you_mean
from hillsphere.spec import Spec
from hillsphere.time import Epoch
from hillsphere_tracking.kepler import elements_from_states
from hillsphere_tracking.live.session import Session
from hillsphere_tracking.mean_elements import EARTH_FIELD, mean_from_osculating
from hillsphere_tracking.pass_sources import orbits_from, station_of
from hillsphere_tracking.pointing.mounts import AxisLimits, azimuth_elevation
from hillsphere_tracking.pointing.planning import plan_pass
from hillsphere_tracking.satellite_specs import SatelliteSpec, StationSpec
from hillsphere_tracking.satellites import MeanElementsOrbit, Orbit, earth_fixed_states
from hillsphere_tracking.topocentric import angles
from hillsphere_tracking.trackers.streaming import StreamingTracker

__all__ = ["MountLimits", "Seen", "next_pass", "orbit_of", "session_of", "site_of", "tracker_of"]

_COARSE_S = 10.0
_AFTER_S = 60.0
"""For how long the antenna is still pointed after the nominal pass: the satellite may be late."""

SpecT = TypeVar("SpecT", bound=Spec)


@dataclass(frozen=True)
class MountLimits:
    """Limits of an azimuth-elevation mount, degrees and seconds."""

    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[float, float]
    rate_deg_s: float
    acceleration_deg_s2: float


@dataclass(frozen=True)
class Seen:
    """A pass of the nominal orbit.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        One command period apart, from before the rise to after the set.
    """

    times_s: Array
    azimuth_rad: Array
    elevation_rad: Array


def orbit_of(mission: Mission | None, file: str, name: str) -> Orbit:
    """Return the satellite's orbit: of a file of elements, or as a mission has it."""
    if file:
        keys = {"file": file, "name": name}
        spec = validate(SatelliteSpec, keys, where="--elements")
        assert isinstance(spec, SatelliteSpec)
        found = orbits_from((spec,))
    elif mission is not None:
        found = orbits_from(tuple(_within(mission, SatelliteSpec)))
    else:
        raise InputError("which satellite? give --elements FILE (TLE or OMM), or --mission")
    if name and not file:
        chosen = [orbit for orbit in found if orbit.name == name]
        if not chosen:
            names = [orbit.name for orbit in found]
            raise InputError(f"--satellite: no {name!r}{did_you_mean(name, names)}")
        return chosen[0]
    if len(found) != 1:
        there = ", ".join(orbit.name for orbit in found[:10]) or "none"
        raise InputError(f"choose one satellite with --satellite; there are: {there}")
    return found[0]


def site_of(
    mission: Mission | None,
    name: str,
    latitude_deg: float | None,
    longitude_deg: float | None,
    height_m: float,
) -> Station:
    """Return the station: by its coordinates, or as a mission has it."""
    if latitude_deg is not None and longitude_deg is not None:
        return Station(name or "station", radians(latitude_deg), radians(longitude_deg), height_m)
    if mission is None or latitude_deg is not None or longitude_deg is not None:
        raise InputError("which station? give --latitude and --longitude, or --mission")
    found = {spec.name: spec for spec in _within(mission, StationSpec)}
    if not name and len(found) == 1:
        return station_of(next(iter(found.values())))
    if name not in found:
        raise InputError(
            f"--station: no {name!r}{did_you_mean(name, found, otherwise='there are')}"
        )
    return station_of(found[name])


def tracker_of(mission: Mission | None, name: str) -> Tracker[Any]:
    """Return a tracker: a table of the mission, or a type with its usual parameters."""
    if mission is not None and name in mission.specs.get("tracker", {}):
        made: Tracker[Any] = Assembly(mission).get("tracker", name)
    else:
        made = create("tracker", name)
    return made


def next_pass(
    orbit: Orbit,
    station: Station,
    start: Epoch,
    orientation: EarthOrientation,
    period_s: float,
    *,
    mask_rad: float,
    within_s: float,
) -> Seen:
    """Return the pass that is under way at a time, or the next one.

    Parameters
    ----------
    orbit, station, orientation
        Who is seen, and from where.
    start : Epoch
        From when.
    period_s : float
        Between commands.
    mask_rad : float
        Elevation above which it counts.
    within_s : float
        How long to look ahead.

    Raises
    ------
    InputError
        If the satellite does not rise in that time.
    """
    grid = np.arange(0.0, within_s + _COARSE_S, _COARSE_S)
    _, elevation, _ = angles(station, earth_fixed_states(orbit, start, grid, orientation)[:3])
    above = np.flatnonzero(elevation >= mask_rad)
    if not above.size:
        raise InputError(
            f"{orbit.name} does not rise above {degrees(mask_rad):g}° over {station.name} within "
            f"{within_s / 3600.0:g} h of {start.isot(np.zeros(1), 0)[0]} UTC (at most "
            f"{degrees(float(elevation.max())):.1f}°); check elements and station, or look further "
            "ahead with --within"
        )
    first = above[0]
    below = np.flatnonzero(elevation[first:] < mask_rad)
    last = first + below[0] if below.size else grid.size - 1
    begin = float(max(grid[first] - 2.0 * _COARSE_S, 0.0))
    count = int((grid[last] + _AFTER_S - begin) / period_s) + 1
    times = begin + period_s * np.arange(float(max(count, 8)))
    azimuth, elevation, _ = angles(
        station, earth_fixed_states(orbit, start, times, orientation)[:3]
    )
    return Seen(times, azimuth, elevation)


def session_of(
    orbit: Orbit,
    station: Station,
    tracker: Tracker[Any],
    seen: Seen,
    start: Epoch,
    orientation: EarthOrientation,
    limits: MountLimits,
    *,
    position_rad: tuple[float, float] | None,
    sigma_rad: float,
    period_s: float,
    lost_after_s: float,
) -> Session:
    """Return the session of a pass; times count from its start.

    `position_rad` is where the axes stand, None if unknown; the other arguments are as their names
    say.
    """
    rate, acceleration = radians(limits.rate_deg_s), radians(limits.acceleration_deg_s2)
    primary, secondary = (
        AxisLimits(radians(low), radians(high), rate, acceleration)
        for low, high in (limits.azimuth_deg, limits.elevation_deg)
    )
    plan = plan_pass(
        seen.times_s,
        seen.azimuth_rad,
        seen.elevation_rad,
        azimuth_elevation(primary, secondary),
        None if position_rad is None else position_rad[0],
    )
    middle = float(seen.times_s[int(np.argmax(seen.elevation_rad))])
    elements, t_s = nominal_elements(orbit, start, middle)
    stream = StreamingTracker(tracker, elements, t_s, station, start, orientation, sigma_rad)
    return Session(stream, plan, period_s, lost_after_s)


def nominal_elements(orbit: Orbit, start: Epoch, t_s: float) -> tuple[Array, float]:
    """Return Brouwer's mean elements (6,) of an orbit, and the time to which they belong.

    Parameters
    ----------
    orbit : Orbit
        In the frame TEME.
    start : Epoch
        From which times count.
    t_s : float
        When mean elements and orbit shall agree, if the orbit is of another theory.
    """
    if isinstance(orbit, MeanElementsOrbit):
        return orbit.elements[:, 0], orbit.epoch.seconds_since(start)
    x = orbit.states(np.array([t_s + start.seconds_since(orbit.epoch)]))
    osculating = elements_from_states(x, EARTH_FIELD.gm_m3_s2)
    return mean_from_osculating(osculating, EARTH_FIELD)[:, 0], t_s


def _within(mission: Mission, kind: type[SpecT]) -> Iterator[SpecT]:
    """Yield the different Specs of a class in a mission's tables, however deep."""
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
