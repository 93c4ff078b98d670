"""Orbits propagated by SGP4/SDP4 from two-line element sets and orbit mean-elements messages.

References
----------
.. [1] D. A. Vallado, P. Crawford, R. Hujsak, T. S. Kelso (2006), Revisiting Spacetrack Report #3,
   AIAA 2006-6753.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sgp4 import omm as sgp4_omm
from sgp4.api import SGP4_ERRORS, Satrec

from hillsphere.base.constants import DAY_S
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame
from hillsphere.time import Epoch
from hillsphere_tracking.omm import Omm
from hillsphere_tracking.orbits import bisect_end
from hillsphere_tracking.sgp4_near_earth import (
    COMPILED_FROM,
    elements_of,
    is_certain_to_last,
    propagate_near_earth,
)
from hillsphere_tracking.tle import Tle, alpha5

__all__ = ["Sgp4Orbit"]

_TURN = 2.0 * np.pi
_DECAYED = (1, 4, 6)
"""Error codes of SGP4 that mean a decay: drag has carried the mean eccentricity out of its range
(1) or made the semi-latus rectum negative (4), or the radius is below the Earth's (6)."""
_PER_REVOLUTION = 40
"""Checks in each revolution when the end of an orbit is looked for: errors come and go with the
position in the orbit, and fewer checks could step over the first one. More cost time in proportion
to the days between epoch and pass."""


class Sgp4Orbit:
    """Orbit by the analytic theory SGP4/SDP4 [1]_, constants WGS 72, in the frame TEME.

    Parameters
    ----------
    name : str
        Name of the satellite.
    epoch : Epoch
        Epoch of the elements, UTC.
    satellite : sgp4.api.Satrec
        Initialised elements.
    number : str
        Number in the catalogue; by default that of the elements.

    Raises
    ------
    InputError
        If the elements define no orbit at their own epoch.

    Notes
    -----
    Times are SI seconds after the epoch. Other programs count days of UTC from the epoch, so that
    their times differ by one second across a leap second.

    Many states at once are computed by the compiled theory (`sgp4_near_earth`), few ones and those
    in deep space (periods of 225 min or more) by the package sgp4; both agree to 1e-8 km.
    """

    frame: InertialFrame = "teme"

    def __init__(self, name: str, epoch: Epoch, satellite: Any, number: str = "") -> None:
        self.name = name
        self.epoch = epoch
        self.warnings: tuple[str, ...] = ()
        self._number = number or str(satellite.satnum)
        self._satellite = satellite
        self.near_earth_elements = elements_of(satellite)
        """Elements (7,) for `sgp4_near_earth.propagate_near_earth`; None in deep space."""
        self._certain_s, self._checked_s, self._end_s = -1.0, 0.0, np.inf
        code = int(self._propagate(np.zeros(1))[0][0])
        if code:
            raise InputError(
                f"satellite {name!r}: its elements define no orbit at their own epoch "
                f"({SGP4_ERRORS.get(code, code)}); check them"
            )

    @classmethod
    def from_tle(cls, tle: Tle) -> Sgp4Orbit:
        """Return the orbit of a two-line element set.

        Parameters
        ----------
        tle : Tle
            Element set, as `read_tles` returns it.

        Returns
        -------
        Sgp4Orbit
            Orbit whose epoch is the epoch of the elements.

        Raises
        ------
        InputError
            If the elements define no orbit.
        """
        try:
            satellite = Satrec.twoline2rv(tle.line1, tle.line2)
        except ValueError as error:
            raise InputError(f"satellite {tle.name!r}: {error}") from error
        epoch = Epoch(satellite.jdsatepoch, satellite.jdsatepochF, "UTC")
        orbit = cls(tle.name, epoch, satellite)
        orbit.warnings = tle.warnings
        return orbit

    @classmethod
    def from_omm(cls, message: Omm) -> Sgp4Orbit:
        """Return the orbit of an orbit mean-elements message.

        Parameters
        ----------
        message : Omm
            Message, as `read_omms` returns it.

        Returns
        -------
        Sgp4Orbit
            Orbit whose epoch is the epoch of the elements.

        Raises
        ------
        InputError
            If the elements define no orbit.
        """
        satellite = Satrec()
        number = message.fields["NORAD_CAT_ID"]
        # The library holds five columns of an element set; messages have up to nine digits. The
        # number has no part in the propagation.
        fields = {**message.fields, "NORAD_CAT_ID": number if alpha5(int(number)) else "0"}
        try:
            sgp4_omm.initialize(satellite, fields)
        except ValueError as error:
            raise InputError(f"satellite {message.name!r}: {error}") from error
        orbit = cls(message.name, message.epoch, satellite, number)
        orbit.warnings = message.warnings
        return orbit

    @property
    def catalogue_number(self) -> str:
        """Number of the satellite in the catalogue, without leading zeros."""
        return self._number

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
            If the orbit is not defined at one of the times: the satellite has decayed.
        """
        t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        code, x = self._propagate(t_s)
        gone = (code != 0) | (t_s >= self._end_before(t_s))
        if gone.any():
            first = float(t_s[gone][np.argmin(np.abs(t_s[gone]))])
            raise PropagationError(
                f"satellite {self.name!r} {self.end_reason(first)}; ask for times nearer to the "
                f"epoch, or give {'newer' if first >= 0.0 else 'older'} elements"
            )
        return x

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Return whether the orbit exists at each of the times (N,), s after the epoch."""
        t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        if self._certainly_exists(float(np.max(np.abs(t_s), initial=0.0))):
            return np.ones(t_s.shape, dtype=bool)
        return np.asarray((self._propagate(t_s)[0] == 0) & (t_s < self._end_before(t_s)))

    def end_reason(self, t_s: float) -> str:
        """Return why the orbit has no state at a time, as the end of a sentence."""
        when = np.array([min(t_s, self._end_before(np.array([t_s])))])
        code = int(self._propagate(when)[0][0])
        days = f"{abs(when[0]) / DAY_S:.2f} days"
        if t_s < 0.0:  # SGP4's own messages, such as "decayed", describe times after the epoch
            return (
                f"has no orbit {days} before the epoch of its elements, which are not valid so "
                f"early (SGP4: error {code})"
            )
        why = "has decayed" if code in _DECAYED else "has no orbit"
        return f"{why} {days} after the epoch of its elements (SGP4: {SGP4_ERRORS.get(code, code)})"

    def _end_before(self, t_s: Array) -> float:
        """Return the time at which the orbit ends, if it ends before the last of `t_s`, else ∞.

        Long after a decay SGP4 returns states again, which are meaningless. The orbit is therefore
        tested in every revolution since the epoch.
        """
        last = float(np.max(t_s, initial=0.0))
        if self._end_s < np.inf or last <= self._checked_s or self._certainly_exists(last):
            return self._end_s
        step = _TURN / self._satellite.no_kozai * 60.0 / _PER_REVOLUTION
        times = np.arange(self._checked_s, last + step, step)
        code = self._propagate(times)[0]
        self._checked_s = float(times[-1])
        if code.any():
            bad = float(times[np.argmax(code != 0)])
            self._end_s = bisect_end(
                lambda t: int(self._propagate(np.array([t]))[0][0]) == 0, bad - step, bad
            )[1]
        return self._end_s

    def _certainly_exists(self, within_s: float) -> bool:
        """Return whether the orbit certainly exists at all times up to this far from the epoch."""
        # NaN is not certain
        if not within_s <= self._certain_s and is_certain_to_last(self._satellite, within_s / 60.0):
            self._certain_s = within_s
        return within_s <= self._certain_s

    def _propagate(self, t_s: Array) -> tuple[NDArray[np.uint8], Array]:
        if not np.isfinite(t_s).all():
            raise InputError(f"satellite {self.name!r}: times must be finite, got nan or inf")
        if t_s.size >= COMPILED_FROM and self.near_earth_elements is not None:
            return propagate_near_earth(self.near_earth_elements[:, None], t_s)
        days = np.floor(t_s / DAY_S)
        satellite = self._satellite
        code, r, v = satellite.sgp4_array(
            satellite.jdsatepoch + days, satellite.jdsatepochF + (t_s - days * DAY_S) / DAY_S
        )
        return code, 1e3 * np.concatenate([r.T, v.T])
