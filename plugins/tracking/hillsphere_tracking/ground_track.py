"""Ground tracks: Earth-fixed states of a satellite and the points below it."""

from __future__ import annotations

from math import sqrt

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import WGS84, Ellipsoid, geodetic
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import to_earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.ephemeris_orbit import EphemerisOrbit
from hillsphere_tracking.orbits import LimitedOrbit, Orbit, last_instant

__all__ = ["EarthTrack", "ground_points", "split_at_wrap"]

_GM = 3.986004418e14
"""Gravitational parameter of the Earth (m³/s², WGS 84); it determines only the length of steps."""
_STEPS_PER_RADIAN = 16.0
"""States per radian of the motion about the Earth at perigee, some 100 in a revolution of a
circular orbit. The search for passes begins with every other one: fewer could hide a pass between
two of them, more cost time in proportion."""
_STEP_RANGE_S = (5.0, 1800.0)
"""Shortest and longest step (s). The first is below a seventh of the step of any orbit above the
ground and only bounds the count; in the second the Earth turns by 7.5°, so that an orbit far
above the geostationary one is still followed over the rotating ground."""
_MOST_TIMES = 4_000_000
"""States of a track at most: they take 200 MB, and some copies are made of them."""


class EarthTrack:
    """Earth-fixed trajectory of a satellite over an interval of time.

    Parameters
    ----------
    orbit : Orbit
        Orbit of the satellite.
    start : Epoch
        Origin of the times.
    duration_s : float
        Length of the interval.
    orientation : EarthOrientation
        UT1 and polar motion; by default UT1 = UTC without polar motion.

    Attributes
    ----------
    times_s : ndarray, shape (K,)
        Times from 0, or the beginning of an ephemeris, to the end, 16 per radian of the motion at
        perigee.
    end_s : float
        ``duration_s``, or the time at which the orbit ends if that is earlier.
    end_reason : str
        Reason why the orbit ends earlier; ``""`` if it does not.

    Raises
    ------
    InputError
        If the duration is not positive and finite, or needs too many times.
    PropagationError
        If the orbit does not exist at the start.
    """

    def __init__(
        self,
        orbit: Orbit,
        start: Epoch,
        duration_s: float,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> None:
        if not (np.isfinite(duration_s) and duration_s > 0.0):
            raise InputError(f"the duration must be positive and finite, got {duration_s} s")
        self.orbit, self.start, self.orientation = orbit, start, orientation
        self._offset_s = offset = start.seconds_since(orbit.epoch)
        # an ephemeris may begin later than the search
        begin = max(0.0, -offset) if isinstance(orbit, EphemerisOrbit) else 0.0
        last_instant(orbit, start, np.array([begin]))
        step = _step_s(orbit.states(np.array([begin + offset]))[:, 0])
        count = int(np.ceil(duration_s / step))
        if count > _MOST_TIMES:
            raise InputError(
                f"satellite {orbit.name!r}: {duration_s / DAY_S:g} days need {count} states, at "
                f"most {_MOST_TIMES}; look for passes over a shorter time"
            )
        times = np.linspace(0.0, duration_s, count + 1)
        if begin:
            times = np.append(begin, times[times > begin])
        end = last_instant(orbit, start, times)
        self.end_reason = ""
        if end is not None and isinstance(orbit, LimitedOrbit):
            after = float(times[times > end][0])
            self.end_reason = orbit.end_reason(after + offset)
            times = np.append(times[times < end], end)
            if times.size < 2:
                times = np.array([begin, end])
        self.times_s, self.end_s = times, float(times[-1])
        self._remembered: dict[bytes, Array] = {}

    def states(self, t_s: Array) -> Array:
        """Return Earth-fixed states at times after the start.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            SI seconds.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities relative to the rotating Earth, m/s; read-only.

        Notes
        -----
        Results for many times at once are cached: the search of every station begins with the same
        times.
        """
        key = t_s.tobytes() if 4 * t_s.size >= self.times_s.size else None
        if key is not None and key in self._remembered:
            return self._remembered[key]
        x = self.orbit.states(t_s + self._offset_s)
        x = to_earth_fixed(self.orbit.frame, x, self.start, t_s, self.orientation)
        x.setflags(write=False)
        if key is not None and len(self._remembered) < 3:
            self._remembered[key] = x
        return x

    def node_times(self) -> Array:
        """Return the times of the ascending nodes, s, by linear interpolation, to about 1 s."""
        # zero crossings of z upwards
        z = self.states(self.times_s)[2]
        at = np.flatnonzero((z[:-1] < 0.0) & (z[1:] >= 0.0))
        t = self.times_s
        return np.asarray(t[at] - z[at] * (t[at + 1] - t[at]) / (z[at + 1] - z[at]))


def ground_points(r_ecef_m: Array, ellipsoid: Ellipsoid = WGS84) -> tuple[Array, Array, Array]:
    """Return the subsatellite points on the ellipsoid.

    Parameters
    ----------
    r_ecef_m : ndarray, shape (3, N)
        Earth-fixed positions, m.
    ellipsoid : Ellipsoid
        Reference ellipsoid of the Earth.

    Returns
    -------
    latitude_rad, longitude_rad : ndarray, shape (N,)
        Geodetic latitude, and longitude in (−π, π].
    height_m : ndarray, shape (N,)
        Height of the satellite above the ellipsoid.
    """
    return geodetic(r_ecef_m, ellipsoid)


def split_at_wrap(
    longitude: Array, latitude: Array, turn: float = 2.0 * np.pi
) -> tuple[Array, Array]:
    """Split a track at the edges of a map, so that no line is drawn across the map.

    Parameters
    ----------
    longitude, latitude : ndarray, shape (N,)
        Points of the track, less than half a turn apart; longitudes from −turn/2 to turn/2.
    turn : float
        A full turn in the unit of the longitudes.

    Returns
    -------
    longitude, latitude : ndarray, shape (M,)
        The track with three points inserted at each crossing of the edge: the point on one edge,
        NaN, and the point on the opposite edge.
    """
    step = np.diff(longitude)
    jumps = np.flatnonzero(np.abs(step) > 0.5 * turn)
    if jumps.size == 0:
        return longitude, latitude
    # A jump from +turn/2 to −turn/2 is a crossing eastwards: it leaves at `side` = +turn/2.
    side = -np.sign(step[jumps]) * 0.5 * turn
    going = step[jumps] + 2.0 * side
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(going != 0.0, (side - longitude[jumps]) / going, 0.5)
    edge = latitude[jumps] + np.clip(part, 0.0, 1.0) * (latitude[jumps + 1] - latitude[jumps])
    nothing = np.full(jumps.size, np.nan)
    at = np.repeat(jumps + 1, 3)
    return (
        np.insert(longitude, at, np.column_stack([side, nothing, -side]).ravel()),
        np.insert(latitude, at, np.column_stack([edge, nothing, edge]).ravel()),
    )


def _step_s(x: Array) -> float:
    """Return the time (s) in which a satellite moves by 1/16 rad about the Earth at perigee."""
    # eccentricity vector e = v × h/GM − r̂; perigee radius h²/GM/(1 + e)
    r, v = x[:3], x[3:]
    distance = float(np.linalg.norm(r))
    momentum = float(np.linalg.norm(np.cross(r, v)))
    eccentric = np.cross(v, np.cross(r, v)) / _GM - r / distance
    perigee = momentum**2 / _GM / (1.0 + float(np.linalg.norm(eccentric)))
    # A nearly radial motion has its perigee at the centre: the step must not vanish with it.
    slowest = max(perigee, 1e-3 * distance)
    # speed there by the vis-viva equation
    energy = 0.5 * float(v @ v) - _GM / distance
    speed = sqrt(max(2.0 * (energy + _GM / slowest), 1e-12))
    return float(np.clip(slowest / speed / _STEPS_PER_RADIAN, *_STEP_RANGE_S))
