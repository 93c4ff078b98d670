"""One revolution of a satellite seen from a station, with the Earth turned by any angle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from hillsphere.base.orientation import EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, StationSensor
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere_tracking.assisted_tracking.turned_earth import TurnedEarth
from hillsphere_tracking.orbits import Orbit

__all__ = ["Sight", "Visit", "shift_for"]

_COARSE = 300
"""Samples of a revolution, 20 s apart for a low orbit: the highest point of a pass is then between
the neighbours of the highest sample."""
_FINE = 21
"""Samples between those neighbours in each round of refinement, which divides the interval by
ten."""
_ROUNDS = 3
"""Rounds of refinement: the time of the highest point is known to 0.02 s, and its elevation, flat
there, to far better."""
_GRID = 121
"""Angles of the Earth, 3° apart, between which the highest elevation is bracketed. A peak narrower
than that is found by a minimiser of its own; a coarser grid could miss a pair of roots."""
_ANGLE = 1e-10
"""Tolerance (rad) of the Earth's angle: 0.6 mm on the ground, far below the accuracy of a station's
location."""
_MOST_FLIGHTS = 12
"""Flights by the plant, each about the Earth as the one before turned it. The angle changes the
flight through the tesseral harmonics only, so that the iteration contracts fast; an angle that has
not settled after twelve does not."""
_HALVINGS = 20
"""Bisections of a period between samples, to find rise and set to 1e-6 of it."""
_MOST_TIMES = 4_000_000
"""Times at most at which a pass is looked for: states and rotations alone take 0.5 GB."""


@dataclass(frozen=True)
class Visit:
    """Times of a pass: first and last sample, rise, set and culmination.

    Parameters
    ----------
    first_s, last_s : float
        First and last multiple of the period at which the sensor sees the satellite, after the
        epoch of the orbit.
    rise_s, set_s : float
        Times at which the satellite crosses the sensor's mask.
    highest_s, highest_rad : float
        Time and value of the highest elevation.
    """

    first_s: float
    last_s: float
    rise_s: float
    set_s: float
    highest_s: float
    highest_rad: float


class Sight:
    """One revolution of a satellite, seen by a sensor on an Earth that can be turned.

    Parameters
    ----------
    sensor : StationSensor
        Sensor at a ground station.
    orbit : Orbit
        Orbit of the satellite.
    orientation : EarthOrientation
        Orientation of the Earth before it is turned.
    begin_s, end_s : float
        Beginning and end of the revolution after the orbit's epoch.
    """

    def __init__(
        self,
        sensor: StationSensor,
        orbit: Orbit,
        orientation: EarthOrientation,
        begin_s: float,
        end_s: float,
    ) -> None:
        self._sensor, self.orbit, self._orientation = sensor, orbit, orientation
        self._t = np.linspace(begin_s, end_s, _COARSE)
        self._x = orbit.states(self._t)

    def highest(self, angle_rad: float) -> tuple[float, float]:
        """Return time (s) and value (rad) of the highest elevation in the revolution."""
        times, heights = self.highest_each(np.array([angle_rad]))
        return float(times[0]), float(heights[0])

    def highest_each(self, angles_rad: Array) -> tuple[Array, Array]:
        """Return times and values (M,) of the highest elevations about M Earths, by their angles.

        One call for many angles takes a tenth of the time of as many calls.
        """
        rows = np.arange(angles_rad.size)
        t: Array = np.broadcast_to(self._t, (rows.size, self._t.size))
        height = self._elevations(t, np.tile(self._x, rows.size), angles_rad)
        for _ in range(_ROUNDS):
            k = np.argmax(height, axis=1)
            low, high = np.maximum(k - 1, 0), np.minimum(k + 1, t.shape[1] - 1)
            t = np.linspace(t[rows, low], t[rows, high], _FINE, axis=1)
            height = self._elevations(t, self.orbit.states(t.ravel()), angles_rad)
        k = np.argmax(height, axis=1)
        return t[rows, k], height[rows, k]

    def visit(self, angle_rad: float, period_s: float, ends_s: tuple[float, float]) -> Visit | None:
        """Return the pass around the highest elevation of the revolution.

        Parameters
        ----------
        angle_rad : float
            Angle by which the Earth is turned eastwards.
        period_s : float
            Interval between samples.
        ends_s : tuple of float
            Interval in which the pass must begin and end.

        Returns
        -------
        Visit or None
            The pass; None if the satellite stays below the sensor's mask.

        Raises
        ------
        InputError
            If the pass does not begin or end within the interval.
        """
        top, height = self.highest(angle_rad)
        low, high = int(np.ceil(ends_s[0] / period_s)), int(np.floor(ends_s[1] / period_s))
        if high - low > _MOST_TIMES:
            raise InputError(
                f"the search for a pass needs {high - low} samples, at most {_MOST_TIMES}: give a "
                "longer period"
            )
        t: Array = np.arange(low, high + 1, dtype=float) * period_s
        turned = {"earth_fixed": self.turns(t, angle_rad)}
        visible = self._sensor.visible(self.orbit.states(t), t, turned)
        # the visible sample next to the culmination, then the visible samples around it
        at = int(np.clip(round(top / period_s) - low, 0, t.size - 1))
        near = at + np.flatnonzero(visible[max(at - 1, 0) : at + 2]) - min(at, 1)
        if near.size == 0:
            return None
        at = int(near[np.argmin(np.abs(t[near] - top))])
        first = at - int(np.argmin(np.append(visible[: at + 1][::-1], False))) + 1
        last = at + int(np.argmin(np.append(visible[at:], False))) - 1
        if first == 0 or last == t.size - 1:
            what = "begins before" if first == 0 else "lasts beyond"
            raise InputError(
                f"the pass {what} {t[0 if first == 0 else -1]:.6g} s after the elements' epoch, "
                "the limit of the search: name a pass of another revolution, or a satellite that "
                "rises and sets"
            )
        edges = self._edges(angle_rad, t[[first, last]], t[[first - 1, last + 1]])
        return Visit(float(t[first]), float(t[last]), edges[0], edges[1], top, height)

    def _edges(self, angle_rad: float, seen_s: Array, hidden_s: Array) -> tuple[float, float]:
        """Bisect for the times of rise and set, between visible and hidden times (2,)."""
        for _ in range(_HALVINGS):
            t = 0.5 * (seen_s + hidden_s)
            turned = {"earth_fixed": self.turns(t, angle_rad)}
            there = self._sensor.visible(self.orbit.states(t), t, turned)
            seen_s, hidden_s = np.where(there, t, seen_s), np.where(there, hidden_s, t)
        return float(seen_s[0]), float(seen_s[1])

    def turns(self, t_s: Array, angle_rad: float | Array) -> Array:
        """Return the rotations (3, 3, N) from the orbit's frame to the turned Earth.

        The angle may be one for all times, or one for each.
        """
        earth = TurnedEarth(self._orientation, angle_rad)
        return earth_fixed(self.orbit.frame, self.orbit.epoch, t_s, earth)

    def _elevations(self, t: Array, x: Array, angles_rad: Array) -> Array:
        """Return elevations (M, K) at times (M, K), with states (6, M·K), about M Earths."""
        flat = t.ravel()
        scene = {"earth_fixed": self.turns(flat, np.repeat(angles_rad, t.shape[1]))}
        return np.asarray(self._sensor.observe(x, flat, scene)[1]).reshape(t.shape)


def shift_for(
    elevation_rad: float,
    sight: Sight,
    flown: Callable[[float], Sight] | None = None,
    side: Literal["least", "east", "west"] = "least",
) -> tuple[float, Sight]:
    """Find the least rotation of the Earth that gives a pass the requested highest elevation.

    Parameters
    ----------
    elevation_rad : float
        Requested highest elevation.
    sight : Sight
        The satellite about the Earth before it is turned.
    flown : callable, optional
        Returns the satellite's flight about an Earth that is turned by an angle, since tesseral
        harmonics rotate with the Earth. By default the flight does not depend on the angle.
    side : {"least", "east", "west"}
        Direction of the rotation; by default the direction of the least angle.

    Returns
    -------
    angle_rad : float
        Rotation eastwards, in [−π, π].
    sight : Sight
        The satellite about the turned Earth.

    Raises
    ------
    InputError
        If no rotation gives the elevation.
    """

    def miss(angle: float) -> float:
        return sight.highest(angle)[1] - elevation_rad  # of the last flight

    angles = np.linspace(-np.pi, np.pi, _GRID)
    off = sight.highest_each(angles)[1] - elevation_rad
    # Peaks, where the orbit passes over the station, are narrower than the grid: add their tops.
    for k in np.flatnonzero((off[1:-1] >= off[:-2]) & (off[1:-1] >= off[2:])) + 1:
        peak = minimize_scalar(
            lambda angle: -miss(angle), bounds=(angles[k - 1], angles[k + 1]), method="bounded",
            options={"xatol": 1e-9},
        )  # fmt: skip
        angles, off = np.append(angles, peak.x), np.append(off, -peak.fun)
    order = np.argsort(angles)
    angles, off = angles[order], off[order]
    brackets = np.flatnonzero(np.sign(off[:-1]) != np.sign(off[1:]))
    if brackets.size == 0:
        raise InputError(
            f"the highest elevation lies between {np.degrees(off.min() + elevation_rad):.4g}° and "
            f"{np.degrees(off.max() + elevation_rad):.4g}° however the Earth is turned; "
            f"{np.degrees(elevation_rad):.4g}° cannot be reached: ask for one in between"
        )
    if side != "least":
        sign = 1.0 if side == "east" else -1.0
        brackets = brackets[sign * (angles[brackets] + angles[brackets + 1]) > 0.0]
        if brackets.size == 0:
            raise InputError(
                f"turned to the {side} the Earth brings the satellite at no angle to "
                f"{np.degrees(elevation_rad):.4g}°: turn it to the other side"
            )
    # The least root lies in one of the brackets nearest to zero, on either side.
    nearest = np.minimum(np.abs(angles[brackets]), np.abs(angles[brackets + 1]))
    brackets = brackets[np.argsort(nearest)][:3]
    roots = [_root(miss, angles[k], angles[k + 1]) for k in brackets]
    best = int(np.argmin(np.abs(roots)))
    angle, k = roots[best], brackets[best]
    if flown is None:
        return angle, sight
    # fixed point: fly about the turned Earth, then correct the angle for that flight
    for _ in range(_MOST_FLIGHTS):
        sight = flown(angle)
        before = angle
        if miss(angles[k]) * miss(angles[k + 1]) > 0.0:
            break
        angle = _root(miss, angles[k], angles[k + 1])
        if abs(angle - before) < 10.0 * _ANGLE:
            return angle, sight
    raise InputError(
        f"the rotation of the Earth for {np.degrees(elevation_rad):.6g}° does not converge near "
        f"{np.degrees(angle):.4g}°: request a slightly lower elevation"
    )


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=_ANGLE, rtol=1e-14))
