"""Orbits of Earth satellites behind one interface: element sets, mean elements, flights.

References
----------
.. [1] D. A. Vallado, P. Crawford, R. Hujsak, T. S. Kelso (2006), Revisiting Spacetrack Report #3,
   AIAA 2006-6753.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sgp4 import omm as sgp4_omm
from sgp4.api import SGP4_ERRORS, Satrec

from hillsphere.earth.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.earth.rotation import InertialFrame, to_earth_fixed
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.kepler import checked
from hillsphere_tracking.mean_elements import EARTH_FIELD, ZonalField, states
from hillsphere_tracking.omm import Omm, read_omms
from hillsphere_tracking.tle import Tle, read_tles

__all__ = [
    "LimitedOrbit", "MeanElementsOrbit", "Orbit", "Sgp4Orbit", "earth_fixed_states",
    "last_instant", "orbits_of",
]  # fmt: skip

_DAY = 86400.0
_TURN = 2.0 * np.pi
_DECAYED = (1, 4, 6)
_PER_REVOLUTION = 40
_END_S = 1e-3


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
class LimitedOrbit(Protocol):
    """An orbit that does not last: a satellite decays, a flight ends."""

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Say for times (N,) after the epoch whether there are states."""
        ...

    def end_reason(self, t_s: float) -> str:
        """Return why there is no state at a time, as the end of a sentence."""
        ...


class Sgp4Orbit:
    """Orbit by the analytic theory SGP4/SDP4 [1]_, constants WGS 72, in the frame TEME.

    Parameters
    ----------
    name : str
        Of the satellite.
    epoch : Epoch
        Of the elements, UTC.
    satellite : sgp4.api.Satrec
        Initialised elements.

    Raises
    ------
    InputError
        If the elements give no orbit at their own epoch.

    Notes
    -----
    Times run in SI seconds from the epoch. Element sets count days of UTC, so that across a leap
    second other programs may be a second apart.
    """

    frame: InertialFrame = "teme"

    def __init__(self, name: str, epoch: Epoch, satellite: Any) -> None:
        self.name = name
        self.epoch = epoch
        self._satellite = satellite
        self._checked_s, self._end_s = 0.0, np.inf
        code = int(self._propagated(np.zeros(1))[0][0])
        if code:
            raise InputError(
                f"satellite {name!r}: its elements give no orbit at their own epoch "
                f"({SGP4_ERRORS.get(code, code)}); check them"
            )

    @classmethod
    def from_tle(cls, tle: Tle) -> Sgp4Orbit:
        """Return the orbit of a two-line element set.

        Parameters
        ----------
        tle : Tle
            As `read_tles` reads it.

        Returns
        -------
        Sgp4Orbit
            Its epoch is that of the elements.

        Raises
        ------
        InputError
            If the elements give no orbit.
        """
        try:
            satellite = Satrec.twoline2rv(tle.line1, tle.line2)
        except ValueError as error:
            raise InputError(f"satellite {tle.name!r}: {error}") from error
        epoch = Epoch(satellite.jdsatepoch, satellite.jdsatepochF, "UTC")
        return cls(tle.name, epoch, satellite)

    @classmethod
    def from_omm(cls, message: Omm) -> Sgp4Orbit:
        """Return the orbit of an orbit mean-elements message.

        Parameters
        ----------
        message : Omm
            As `read_omms` reads it.

        Returns
        -------
        Sgp4Orbit
            Its epoch is that of the elements.

        Raises
        ------
        InputError
            If the elements give no orbit.
        """
        satellite = Satrec()
        try:
            sgp4_omm.initialize(satellite, message.fields)
        except ValueError as error:
            raise InputError(f"satellite {message.name!r}: {error}") from error
        return cls(message.name, message.epoch, satellite)

    @property
    def catalogue_number(self) -> str:
        """Number of the satellite in the catalogue, without leading zeros."""
        return str(self._satellite.satnum)

    def states(self, t_s: Array) -> Array:
        """Return states at times after the epoch.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            SI seconds after the epoch, in any order, also negative.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities, m/s, in TEME.

        Raises
        ------
        PropagationError
            If there is no orbit at one of them: the satellite has decayed.
        """
        t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        code, x = self._propagated(t_s)
        gone = (code != 0) | (t_s >= self._end_before(t_s))
        if gone.any():
            first = float(t_s[gone][np.argmin(np.abs(t_s[gone]))])
            raise PropagationError(
                f"satellite {self.name!r} {self.end_reason(first)}; ask for earlier times, or "
                "give newer elements"
            )
        return x

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Say for times (N,) after the epoch whether there is an orbit."""
        t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        return np.asarray((self._propagated(t_s)[0] == 0) & (t_s < self._end_before(t_s)))

    def end_reason(self, t_s: float) -> str:
        """Return why there is no state at a time, as the end of a sentence."""
        when = np.array([min(t_s, self._end_before(np.array([t_s])))])
        code = int(self._propagated(when)[0][0])
        why = "has decayed" if code in _DECAYED else "has no orbit"
        return (
            f"{why} {when[0] / _DAY:+.2f} days from the epoch of its elements "
            f"(SGP4: {SGP4_ERRORS.get(code, code)})"
        )

    def _end_before(self, t_s: Array) -> float:
        """Return when the orbit ended before the last of some times; infinity if it did not.

        Long after the end the theory gives states again, which mean nothing: every revolution since
        the epoch must have been one.
        """
        last = float(np.max(t_s, initial=0.0))
        if self._end_s < np.inf or last <= self._checked_s:
            return self._end_s
        step = _TURN / self._satellite.no_kozai * 60.0 / _PER_REVOLUTION
        times = np.arange(self._checked_s, last + step, step)
        code = self._propagated(times)[0]
        self._checked_s = float(times[-1])
        if code.any():
            bad = float(times[np.argmax(code != 0)])
            self._end_s = _bisected(
                lambda t: int(self._propagated(np.array([t]))[0][0]) == 0, bad - step, bad
            )[1]
        return self._end_s

    def _propagated(self, t_s: Array) -> tuple[NDArray[np.uint8], Array]:
        if not np.isfinite(t_s).all():
            raise InputError(f"satellite {self.name!r}: times must be finite, got nan or inf")
        days = np.floor(t_s / _DAY)
        satellite = self._satellite
        code, r, v = satellite.sgp4_array(
            satellite.jdsatepoch + days, satellite.jdsatepochF + (t_s - days * _DAY) / _DAY
        )
        return code, 1e3 * np.concatenate([r.T, v.T])


class MeanElementsOrbit:
    """Orbit by Brouwer's mean elements, see `hillsphere_tracking.mean_elements`.

    Parameters
    ----------
    name : str
        Of the satellite.
    epoch : Epoch
        Of the elements.
    elements : ndarray, shape (6,)
        Mean a (m), e, i, Ω, ω, M (rad) referred to the true equator and mean equinox.
    field : ZonalField
        Of the Earth.
    short_period : bool
        Whether the short-period terms are added.

    Raises
    ------
    InputError
        If the elements are no ellipse.
    """

    frame: InertialFrame = "teme"

    def __init__(
        self,
        name: str,
        epoch: Epoch,
        elements: Array,
        field: ZonalField = EARTH_FIELD,
        *,
        short_period: bool = True,
    ) -> None:
        self.name, self.epoch, self.field = name, epoch, field
        self.short_period = short_period
        try:
            self.elements = checked(elements)
        except InputError as error:
            raise InputError(f"satellite {name!r}: {error}") from error

    def states(self, t_s: Array) -> Array:
        """Return states at times after the epoch.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            SI seconds after the epoch, in any order, also negative.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities, m/s, in TEME.
        """
        t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        if t_s.size == 0:
            return np.zeros((6, 0))
        return states(self.elements, t_s, self.field, short_period=self.short_period)


def orbits_of(text: str, where: str) -> tuple[Sgp4Orbit, ...]:
    """Read orbits from element sets or messages, whichever it is.

    Parameters
    ----------
    text : str
        Two-line element sets, or orbit mean-elements messages as text or XML.
    where : str
        Name of the file, for errors.

    Returns
    -------
    tuple of Sgp4Orbit
        In the order of the text.

    Raises
    ------
    InputError
        If it is neither, or faulty; the message names the line.
    """
    start = text.lstrip("\ufeff \t\r\n")
    if start.startswith(("<", "CCSDS_OMM_VERS")):
        return tuple(Sgp4Orbit.from_omm(message) for message in read_omms(text, where))
    return tuple(Sgp4Orbit.from_tle(tle) for tle in read_tles(text, where))


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
    return _bisected(
        lambda t: bool(orbit.exists(np.array([t + offset]))[0]),
        float(times_s[first - 1]),
        float(times_s[first]),
    )[0]


def _bisected(alive: Callable[[float], bool], good: float, bad: float) -> tuple[float, float]:
    """Return two times within a millisecond, one at which there is an orbit and one without."""
    while bad - good > _END_S:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if alive(middle) else (good, middle)
    return good, bad
