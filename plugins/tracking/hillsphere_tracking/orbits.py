"""Interface of the orbits of Earth satellites: states, Earth-fixed states, and the orbit's end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.contracts import Contract
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame, to_earth_fixed
from hillsphere.time import Epoch

__all__ = ["LimitedOrbit", "Orbit", "bisect_end", "earth_fixed_states", "last_instant"]

_END_S = 1e-3
"""Accuracy (s) of the time at which an orbit ends. A satellite moves 8 m in it; no decay is known
to a second."""


class Orbit(Protocol):
    """Orbit of a satellite: its inertial state at any time."""

    @property
    def name(self) -> str:
        """Name of the satellite."""
        ...

    @property
    def epoch(self) -> Epoch:
        """Origin of the times."""
        ...

    @property
    def frame(self) -> InertialFrame:
        """Inertial frame of the states, ``"teme"`` or ``"gcrs"``."""
        ...

    def states(self, t_s: Array) -> Array:
        """Return positions, m, and velocities, m/s, (6, N), at SI seconds (N,) after the epoch.

        Raises `PropagationError` at times for which the orbit is not defined.
        """
        ...


@runtime_checkable
class LimitedOrbit(Contract, Protocol):
    """An orbit of limited duration: a satellite decays, a flight ends."""

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Return whether the orbit has a state at each of the times (N,), s after the epoch."""
        ...

    def end_reason(self, t_s: float) -> str:
        """Return why the orbit has no state at a time, as the end of a sentence."""
        ...


def earth_fixed_states(
    orbit: Orbit, start: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC
) -> Array:
    """Return the states of a satellite relative to the rotating Earth.

    Parameters
    ----------
    orbit : Orbit
        Orbit of the satellite.
    start : Epoch
        Origin of the times.
    t_s : ndarray, shape (N,)
        SI seconds after `start`.
    orientation : EarthOrientation
        UT1 and polar motion; by default UT1 = UTC without polar motion.

    Returns
    -------
    ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.

    Raises
    ------
    PropagationError
        If the orbit is not defined at one of the times.
    """
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    x = orbit.states(t_s + start.seconds_since(orbit.epoch))
    return to_earth_fixed(orbit.frame, x, start, t_s, orientation)


def last_instant(orbit: Orbit, start: Epoch, times_s: Array) -> float | None:
    """Return the last time at which an orbit exists.

    Parameters
    ----------
    orbit : Orbit
        Orbit of the satellite.
    start : Epoch
        Origin of the times.
    times_s : ndarray, shape (K,)
        Times in increasing order at which the orbit is tested; a gap between two of them is not
        noticed.

    Returns
    -------
    float or None
        Last time at which the orbit exists, to 1 ms, ``times_s[0]`` at least; None if it exists at
        all times.

    Raises
    ------
    PropagationError
        If the orbit does not exist at the first time.
    """
    if not isinstance(orbit, LimitedOrbit):
        return None
    offset = start.seconds_since(orbit.epoch)
    there = orbit.exists(times_s + offset)
    if there.all():
        return None
    first = int(np.argmin(there))
    if first == 0:
        raise PropagationError(
            f"satellite {orbit.name!r} {orbit.end_reason(float(times_s[0]) + offset)}; ask for "
            "other times, or give newer elements"
        )
    return bisect_end(
        lambda t: bool(orbit.exists(np.array([t + offset]))[0]),
        float(times_s[first - 1]),
        float(times_s[first]),
    )[0]


def bisect_end(alive: Callable[[float], bool], good: float, bad: float) -> tuple[float, float]:
    """Bisect for the time at which an orbit ends.

    Parameters
    ----------
    alive : callable
        Returns whether the orbit exists at a time, s.
    good, bad : float
        Times, s, at which the orbit exists and does not exist.

    Returns
    -------
    tuple of (float, float)
        Two times, s, less than a millisecond apart: the orbit exists at the first and does not
        exist at the second.
    """
    while bad - good > _END_S:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if alive(middle) else (good, middle)
    return good, bad
