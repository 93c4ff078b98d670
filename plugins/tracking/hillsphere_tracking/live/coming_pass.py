"""The pass to be tracked: its nominal angles, the plan of the axes, and the initial tracker."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np

from hillsphere.base.orientation import EarthOrientation
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.live.atmosphere import Air
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.pointing.mounts import Mount
from hillsphere_tracking.pointing.pass_plan import PassPlan, plan_pass
from hillsphere_tracking.satellites import LimitedOrbit, Orbit, earth_fixed_states
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
"""Time (s) for which the antenna is still pointed after the nominal set, as the satellite may be
late. More keeps the antenna busy, less loses the end of a late pass."""
_LEAST_TIMES = 8
"""Times of a pass at least, from which its motion is planned: seven periods, as every difference
in the plan needs some."""


@dataclass(frozen=True)
class NominalPass:
    """A pass of the nominal orbit.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        Times one command period apart, from before the rise to after the set, and angles; the
        elevations are apparent if there is air.
    up : slice
        Indices of the times from the rise to the set: above the mask of the horizon.
    cut : bool
        Whether the orbit ends, as an ephemeris does, before the satellite sets.
    """

    times_s: Array
    azimuth_rad: Array
    elevation_rad: Array
    up: slice
    cut: bool = False

    @property
    def rise_s(self) -> float:
        """Time of the rise, or the first time if the pass is under way."""
        return float(self.times_s[self.up.start])

    @property
    def highest_s(self) -> float:
        """Time of the highest elevation."""
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
    """Return the pass that is under way at `start`, or the next one.

    Of an orbit of limited duration only its own span is searched.

    Parameters
    ----------
    orbit, place, orientation
        Orbit of the satellite, station with its mask, and orientation of the Earth.
    start : Epoch
        Beginning of the search.
    period_s : float
        Interval between commands.
    within_s : float
        Time after `start` within which the satellite must rise. The pass lasts until the set, or
        for a day if the satellite does not set.
    air : Air, optional
        Air for the refraction.

    Raises
    ------
    InputError
        If the satellite does not rise in this time.
    PropagationError
        If the orbit has no state in this time.
    """
    offset = start.seconds_since(orbit.epoch)

    def existing(times: Array) -> Array:
        """Return the times at which the orbit has a state."""
        return times[orbit.exists(times + offset)] if isinstance(orbit, LimitedOrbit) else times

    def seen(times: Array) -> tuple[Array, Array]:
        states = earth_fixed_states(orbit, start, times, orientation)
        azimuth, elevation, _ = angles(place.station, states[:3])
        return azimuth, elevation if air is None else air.apparent(elevation)

    whole = np.arange(0.0, within_s + _COARSE_S, _COARSE_S)
    grid = existing(whole)
    if not grid.size and isinstance(orbit, LimitedOrbit):
        raise PropagationError(
            f"satellite {orbit.name!r} {orbit.end_reason(offset)}; within {within_s / 3600.0:g} h "
            f"(--within) of {_utc(start, 0.0)[0]} UTC, when the search begins, there is none"
        )
    azimuth, elevation = seen(grid)
    height = place.above(azimuth, elevation)
    if height[-1] >= 0.0:  # the satellite is up at the end: extend the grid to its set
        for hour in range(1, _LONGEST_H + 1):
            whole = np.arange(0.0, within_s + 3600.0 * hour + _COARSE_S, _COARSE_S)
            beyond = existing(whole[-360:])
            if beyond.size < 360 or (place.above(*seen(beyond)) < 0.0).any():
                grid = existing(whole)
                height = place.above(*seen(grid))
                break
    above = np.flatnonzero(height >= 0.0)
    if not above.size:
        raise InputError(_no_rise(orbit, place, start, within_s, grid, elevation))
    first = above[0]
    below = np.flatnonzero(height[first:] < 0.0)
    last = first + below[0] if below.size else grid.size - 1
    begin = float(max(grid[first] - 2.0 * _COARSE_S, 0.0))
    count = int((grid[last] + _AFTER_S - begin) / period_s) + 1
    planned = begin + period_s * np.arange(float(max(count, _LEAST_TIMES)))
    times = existing(planned)
    if times.size < _LEAST_TIMES:
        first_utc, last_utc = _utc(start, grid[0], grid[-1])
        raise InputError(
            f"{orbit.name}: its orbit covers {first_utc} to {last_utc} UTC only, of which the pass "
            f"takes {times.size} periods of {period_s:g} s, expected {_LEAST_TIMES} at least; give "
            "a longer ephemeris, or a shorter --period"
        )
    azimuth, elevation = seen(times)
    height = place.above(azimuth, elevation)
    up = np.flatnonzero(height >= 0.0)
    ends = not below.size and times[-1] < planned[-1]  # the orbit, before the satellite sets
    if not ends:
        # a mask's edges and gaps between two coarse steps do not divide the pass
        up = up[times[up] <= grid[last]]
    rise, end = (int(up[0]), int(up[-1]) + 1) if up.size else (0, times.size)
    return NominalPass(
        times, azimuth, elevation, slice(rise, end), bool(ends and height[-1] >= 0.0)
    )


def _no_rise(
    orbit: Orbit, place: Place, start: Epoch, within_s: float, grid: Array, elevation: Array
) -> str:
    """Return why there is no pass, and what to do, of a search at times with these elevations."""
    mask = degrees(place.mask.lowest_rad)
    horizon = f"above {mask:g}°" if place.mask.constant else "above the mask"
    first, last = _utc(start, *grid[[0, -1]])
    clipped = grid[0] > 0.0 or grid[-1] < within_s
    part = f", of which its orbit covers {first} to {last}" if clipped else ""
    remedy = "check elements and station" + (
        "" if clipped and grid[-1] < within_s else ", or look further ahead with --within"
    )
    return (
        f"{orbit.name} does not rise {horizon} over {place.station.name} within "
        f"{within_s / 3600.0:g} h (--within) of {_utc(start, 0.0)[0]} UTC{part} (highest elevation "
        f"{degrees(float(elevation.max())):.1f}°); {remedy}"
    )


def _utc(start: Epoch, *t_s: float) -> list[str]:
    """Return the dates of times after an epoch, to the second."""
    return start.isot(np.array(t_s), 0)


def plan_of(
    nominal: NominalPass, mount: Mount, position_rad: tuple[float, float] | None
) -> PassPlan:
    """Plan the motion of the axes from their position, or from any position if it is None.

    The plan waits at the directions of the rise and the set. If it followed the satellite below
    the horizon, where nothing is received, stops there would cost parts of the pass.
    """
    start = None if position_rad is None else position_rad[0]
    up = nominal.up
    index = np.clip(np.arange(nominal.times_s.size), up.start, up.stop - 1)
    return plan_pass(
        nominal.times_s, nominal.azimuth_rad[index], nominal.elevation_rad[index], mount, start
    )


def stream_of(
    tracker: Tracker[Any],
    orbit: Orbit,
    place: Place,
    nominal: NominalPass,
    start: Epoch,
    orientation: EarthOrientation,
    sigma_rad: float,
) -> StreamingTracker:
    """Return a tracker with the nominal orbit of a pass; its times count from `start`.

    The mean elements equal the orbit's state at the highest elevation, where errors of the angles
    are largest.
    """
    t_s = nominal.highest_s
    since = np.array([t_s + start.seconds_since(orbit.epoch)])
    elements = nominal_elements(orbit, since, orientation=orientation)[:, 0]
    return StreamingTracker(tracker, elements, t_s, place.station, start, orientation, sigma_rad)
