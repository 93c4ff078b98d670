"""One revolution of a satellite as a station sees it, with the Earth turned by any angle."""

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
"""Tolerance (rad) of the Earth's angle: 0.6 mm on the ground, far below what a station's place is
known to."""
_MOST_FLIGHTS = 12
"""Flights by the plant, each about the Earth as the one before turned it. The angle changes the
flight through the tesseral harmonics only, so that the iteration contracts fast; an angle that has
not settled after twelve does not."""
_HALVINGS = 20
"""Of a period, to find when a pass begins and ends."""
_MOST_TIMES = 4_000_000
"""Times at most at which a pass is looked for: states and rotations alone take 0.5 GB."""


@dataclass(frozen=True)
class Visit:
    """A pass, sampled: what is measured of it.

    Parameters
    ----------
    first_s, last_s : float
        First and last whole multiple of the period at which the sensor sees the satellite, after
        the epoch of its orbit.
    rise_s, set_s : float
        When it comes above the sensor's mask, and goes below it.
    highest_s, highest_rad : float
        When it stands highest, and how high.
    """

    first_s: float
    last_s: float
    rise_s: float
    set_s: float
    highest_s: float
    highest_rad: float


class Sight:
    """A satellite in one revolution, as a sensor on a turned Earth sees it.

    Parameters
    ----------
    sensor : StationSensor
        Where from.
    orbit : Orbit
        Of the satellite.
    orientation : EarthOrientation
        Of the Earth that is not turned.
    begin_s, end_s : float
        The revolution, after the orbit's epoch.
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
        """Return when in the revolution the satellite stands highest, s, and how high, rad."""
        t, height = self._t, self._elevation(self._t, self._x, angle_rad)
        for _ in range(_ROUNDS):
            k = int(np.argmax(height))
            t = np.linspace(t[max(k - 1, 0)], t[min(k + 1, t.size - 1)], _FINE)
            height = self._elevation(t, self.orbit.states(t), angle_rad)
        k = int(np.argmax(height))
        return float(t[k]), float(height[k])

    def visit(self, angle_rad: float, period_s: float, ends_s: tuple[float, float]) -> Visit | None:
        """Return the pass that the satellite makes when it stands highest.

        Parameters
        ----------
        angle_rad : float
            By which the Earth is turned, eastwards.
        period_s : float
            Between two samples.
        ends_s : tuple of float
            Until where to look for its beginning and its end.

        Returns
        -------
        Visit or None
            None if it stays below the sensor's mask.

        Raises
        ------
        InputError
            If it does not begin or end in between.
        """
        top, height = self.highest(angle_rad)
        low, high = int(np.ceil(ends_s[0] / period_s)), int(np.floor(ends_s[1] / period_s))
        if high - low > _MOST_TIMES:
            raise InputError(
                f"a pass is looked for at {high - low} times, at most {_MOST_TIMES}: give a longer "
                "period"
            )
        t: Array = np.arange(low, high + 1, dtype=float) * period_s
        turned = {"earth_fixed": self.turns(t, angle_rad)}
        seen = self._sensor.visible(self.orbit.states(t), t, turned)
        at = int(np.clip(round(top / period_s) - low, 0, t.size - 1))
        near = at + np.flatnonzero(seen[max(at - 1, 0) : at + 2]) - min(at, 1)
        if near.size == 0:
            return None
        at = int(near[np.argmin(np.abs(t[near] - top))])
        first = at - int(np.argmin(np.append(seen[: at + 1][::-1], False))) + 1
        last = at + int(np.argmin(np.append(seen[at:], False))) - 1
        if first == 0 or last == t.size - 1:
            what = "begins before" if first == 0 else "lasts beyond"
            raise InputError(
                f"the pass {what} {t[0 if first == 0 else -1]:.6g} s after the elements' epoch, "
                "which is as far as it is looked for: name a pass of another revolution, or a "
                "satellite that rises and sets"
            )
        edges = self._edges(angle_rad, t[[first, last]], t[[first - 1, last + 1]])
        return Visit(float(t[first]), float(t[last]), edges[0], edges[1], top, height)

    def _edges(self, angle_rad: float, seen_s: Array, hidden_s: Array) -> tuple[float, float]:
        """Return when the satellite passes the mask, between times at which it is seen or not."""
        for _ in range(_HALVINGS):
            t = 0.5 * (seen_s + hidden_s)
            turned = {"earth_fixed": self.turns(t, angle_rad)}
            there = self._sensor.visible(self.orbit.states(t), t, turned)
            seen_s, hidden_s = np.where(there, t, seen_s), np.where(there, hidden_s, t)
        return float(seen_s[0]), float(seen_s[1])

    def turns(self, t_s: Array, angle_rad: float) -> Array:
        """Return what turns positions to the turned Earth, (3, 3, N)."""
        earth = TurnedEarth(self._orientation, angle_rad)
        return earth_fixed(self.orbit.frame, self.orbit.epoch, t_s, earth)

    def _elevation(self, t: Array, x: Array, angle_rad: float) -> Array:
        scene = {"earth_fixed": self.turns(t, angle_rad)}
        return np.asarray(self._sensor.observe(x, t, scene)[1])


def shift_for(
    elevation_rad: float,
    sight: Sight,
    flown: Callable[[float], Sight] | None = None,
    side: Literal["least", "east", "west"] = "least",
) -> tuple[float, Sight]:
    """Find the least angle by which to turn the Earth for a highest elevation.

    Parameters
    ----------
    elevation_rad : float
        Wanted.
    sight : Sight
        The satellite as it flies about the Earth that is not turned.
    flown : callable, optional
        Gives it as it flies about one that is turned by an angle: tesseral harmonics turn with the
        Earth. Left out: it does not feel the turn.
    side : {"least", "east", "west"}
        To which side it is turned; by default to that of the least angle.

    Returns
    -------
    angle_rad : float
        Eastwards, in [−π, π].
    sight : Sight
        The satellite as it flies then.

    Raises
    ------
    InputError
        If no angle gives it.
    """

    def miss(angle: float) -> float:
        return sight.highest(angle)[1] - elevation_rad  # of the last flight

    angles = np.linspace(-np.pi, np.pi, _GRID)
    off = np.array([miss(angle) for angle in angles])
    # the peaks, where the station lies below the orbit, are narrower than the grid
    for k in np.flatnonzero((off[1:-1] >= off[:-2]) & (off[1:-1] >= off[2:])) + 1:
        found = minimize_scalar(
            lambda angle: -miss(angle), bounds=(angles[k - 1], angles[k + 1]), method="bounded",
            options={"xatol": 1e-9},
        )  # fmt: skip
        angles, off = np.append(angles, found.x), np.append(off, -found.fun)
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
    # the least angle is one of the nearest to the west and to the east
    nearest = np.minimum(np.abs(angles[brackets]), np.abs(angles[brackets + 1]))
    brackets = brackets[np.argsort(nearest)][:3]
    roots = [_root(miss, angles[k], angles[k + 1]) for k in brackets]
    best = int(np.argmin(np.abs(roots)))
    angle, k = roots[best], brackets[best]
    if flown is None:
        return angle, sight
    for _ in range(_MOST_FLIGHTS):
        sight = flown(angle)
        before = angle
        if miss(angles[k]) * miss(angles[k + 1]) > 0.0:
            break
        angle = _root(miss, angles[k], angles[k + 1])
        if abs(angle - before) < 10.0 * _ANGLE:
            return angle, sight
    raise InputError(
        f"turning the Earth to reach {np.degrees(elevation_rad):.6g}° does not settle near "
        f"{np.degrees(angle):.4g}°: ask for a slightly lower elevation"
    )


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=_ANGLE, rtol=1e-14))
