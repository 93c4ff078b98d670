"""The pass to be tracked: when it is, the plan of the axes for it, the tracker that begins it."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np

from hillsphere.base.orientation import EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.live.atmosphere import Air
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.pointing.mounts import Mount
from hillsphere_tracking.pointing.pass_plan import PassPlan, plan_pass
from hillsphere_tracking.satellites import Orbit, earth_fixed_states
from hillsphere_tracking.topocentric import angles
from hillsphere_tracking.trackers.nominal import nominal_elements
from hillsphere_tracking.trackers.streaming import StreamingTracker

__all__ = ["NominalPass", "next_pass", "plan_of", "stream_of"]

_COARSE_S = 10.0
"""Step (s) in which rise and set are looked for. A pass below 10 s, which no antenna could use, may
be missed; the antenna begins two steps earlier."""
_LONGEST_H = 24
"""Hours after which a satellite that does not set is taken to stay up, and its pass ends."""
_AFTER_S = 60.0
"""For how long the antenna is still pointed after the nominal pass: the satellite may be late."""


@dataclass(frozen=True)
class NominalPass:
    """A pass of the nominal orbit.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        One command period apart, from before the rise to after the set; apparent elevations if
        there is air.
    """

    times_s: Array
    azimuth_rad: Array
    elevation_rad: Array

    @property
    def highest_s(self) -> float:
        """When the satellite is highest."""
        return float(self.times_s[int(np.argmax(self.elevation_rad))])


def next_pass(
    orbit: Orbit,
    place: Place,
    start: Epoch,
    orientation: EarthOrientation,
    period_s: float,
    within_s: float,
    air: Air | None = None,
) -> NominalPass:
    """Return the pass that is under way at a time, or the next one.

    Parameters
    ----------
    orbit, place, orientation
        Who is seen, and from where; the place's mask says what counts.
    start : Epoch
        From when.
    period_s : float
        Between commands.
    within_s : float
        How long to look ahead for the rise. A pass goes on to its set; that of a satellite that
        does not set for a day ends there.
    air : Air, optional
        That lifts the satellite.

    Raises
    ------
    InputError
        If the satellite does not rise in that time.
    """

    def seen(times: Array) -> tuple[Array, Array]:
        states = earth_fixed_states(orbit, start, times, orientation)
        azimuth, elevation, _ = angles(place.station, states[:3])
        return azimuth, elevation if air is None else air.apparent(elevation)

    grid = np.arange(0.0, within_s + _COARSE_S, _COARSE_S)
    azimuth, elevation = seen(grid)
    height = place.above(azimuth, elevation)
    if height[-1] >= 0.0:  # it is up at the end: see when it sets
        for hour in range(_LONGEST_H):
            beyond = grid[-1] + 3600.0 * hour + _COARSE_S * np.arange(1.0, 361.0)
            if (place.above(*seen(beyond)) < 0.0).any():
                grid = np.arange(0.0, beyond[-1] + _COARSE_S, _COARSE_S)
                height = place.above(*seen(grid))
                break
    above = np.flatnonzero(height >= 0.0)
    if not above.size:
        mask = degrees(place.mask.lowest_rad)
        horizon = f"above {mask:g}°" if place.mask.constant else "above the mask"
        raise InputError(
            f"{orbit.name} does not rise {horizon} over {place.station.name} within "
            f"{within_s / 3600.0:g} h of {start.isot(np.zeros(1), 0)[0]} UTC (at most "
            f"{degrees(float(elevation.max())):.1f}°); check elements and station, or look further "
            "ahead with --within"
        )
    first = above[0]
    below = np.flatnonzero(height[first:] < 0.0)
    last = first + below[0] if below.size else grid.size - 1
    begin = float(max(grid[first] - 2.0 * _COARSE_S, 0.0))
    count = int((grid[last] + _AFTER_S - begin) / period_s) + 1
    times = begin + period_s * np.arange(float(max(count, 8)))
    return NominalPass(times, *seen(times))


def plan_of(seen: NominalPass, mount: Mount, position_rad: tuple[float, float] | None) -> PassPlan:
    """Return the plan of the axes, which stand at a position, or where they like if it is None."""
    start = None if position_rad is None else position_rad[0]
    return plan_pass(seen.times_s, seen.azimuth_rad, seen.elevation_rad, mount, start)


def stream_of(
    tracker: Tracker[Any],
    orbit: Orbit,
    place: Place,
    seen: NominalPass,
    start: Epoch,
    orientation: EarthOrientation,
    sigma_rad: float,
) -> StreamingTracker:
    """Return a tracker that begins a pass with its nominal orbit; times count from `start`.

    Mean elements are those that agree with the orbit where the satellite is highest.
    """
    t_s = seen.highest_s
    since = np.array([t_s + start.seconds_since(orbit.epoch)])
    elements = nominal_elements(orbit, since, orientation=orientation)[:, 0]
    return StreamingTracker(tracker, elements, t_s, place.station, start, orientation, sigma_rad)
