"""An orbit of an Earth satellite: where it is, over which place, and until when."""

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
    """Where a satellite is."""

    @property
    def name(self) -> str:
        """Of the satellite."""
        ...

    @property
    def epoch(self) -> Epoch:
        """From which times count."""
        ...

    @property
    def frame(self) -> InertialFrame:
        """Inertial frame of the states, ``"teme"`` or ``"gcrs"``."""
        ...

    def states(self, t_s: Array) -> Array:
        """Return positions, m, and velocities, m/s, (6, N), at SI seconds (N,) after the epoch.

        Raises `PropagationError` where there is no orbit.
        """
        ...


@runtime_checkable
class LimitedOrbit(Contract, Protocol):
    """An orbit that does not last: a satellite decays, a flight ends."""

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Say for times (N,) after the epoch whether there are states."""
        ...

    def end_reason(self, t_s: float) -> str:
        """Return why there is no state at a time, as the end of a sentence."""
        ...


def earth_fixed_states(
    orbit: Orbit, start: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC
) -> Array:
    """Return where a satellite is over the rotating Earth.

    Parameters
    ----------
    orbit : Orbit
        Of the satellite.
    start : Epoch
        From which times count.
    t_s : ndarray, shape (N,)
        SI seconds after it.
    orientation : EarthOrientation
        Gives UT1 and polar motion; left out: UT1 := UTC and none.

    Returns
    -------
    ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the rotating Earth, m/s.

    Raises
    ------
    PropagationError
        If there is no orbit at one of the times.
    """
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    x = orbit.states(t_s + start.seconds_since(orbit.epoch))
    return to_earth_fixed(orbit.frame, x, start, t_s, orientation)


def last_instant(orbit: Orbit, start: Epoch, times_s: Array) -> float | None:
    """Return until when an orbit lasts.

    Parameters
    ----------
    orbit : Orbit
        Of the satellite.
    start : Epoch
        From which times count.
    times_s : ndarray, shape (K,)
        Times, rising, at which it is asked for; what happens between two of them is not seen.

    Returns
    -------
    float or None
        A time to 1 ms before which the orbit exists, ``times_s[0]`` at least; None if it exists
        throughout.

    Raises
    ------
    PropagationError
        If it does not exist at the first time already.
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
    """Narrow down when an orbit ends.

    Parameters
    ----------
    alive : callable
        Whether there is an orbit at a time, s.
    good, bad : float
        Times with and without.

    Returns
    -------
    tuple of (float, float)
        Two times within a millisecond, one at which there is an orbit and one without.
    """
    while bad - good > _END_S:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if alive(middle) else (good, middle)
    return good, bad
