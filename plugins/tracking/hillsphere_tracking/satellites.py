"""Orbits of Earth satellites from published elements: TLE, OMM or Brouwer's mean elements."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame
from hillsphere.time import Epoch
from hillsphere_tracking.kepler import validate_elements
from hillsphere_tracking.mean_elements import EARTH_FIELD, ZonalField, states
from hillsphere_tracking.omm import read_omms
from hillsphere_tracking.omm_encodings import encoding_of
from hillsphere_tracking.orbits import LimitedOrbit, Orbit, earth_fixed_states, last_instant
from hillsphere_tracking.sgp4_orbit import Sgp4Orbit
from hillsphere_tracking.tle import Checksum, read_tles

__all__ = [
    "LimitedOrbit", "MeanElementsOrbit", "Orbit", "Sgp4Orbit", "earth_fixed_states",
    "last_instant", "orbits_of",
]  # fmt: skip


class MeanElementsOrbit:
    """Orbit from Brouwer's mean elements, see `hillsphere_tracking.mean_elements`.

    Parameters
    ----------
    name : str
        Name of the satellite.
    epoch : Epoch
        Epoch of the elements.
    elements : ndarray, shape (6,)
        Mean a (m), e, i, Ω, ω, M (rad) referred to the true equator and mean equinox.
    field : ZonalField
        Gravity field of the Earth.
    short_period : bool
        Add the short-period terms of J2.

    Raises
    ------
    InputError
        If the elements do not describe an ellipse.
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
            self.elements = validate_elements(elements)
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


def orbits_of(
    text: str, where: str, *, lenient: bool = False, checksum: Checksum = "refuse"
) -> tuple[Sgp4Orbit, ...]:
    """Read orbits from two-line element sets or orbit mean-elements messages.

    Parameters
    ----------
    text : str
        Two-line element sets, or orbit mean-elements messages as text, XML, JSON or CSV.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures of messages from the standard become warnings of the orbits.
    checksum : str
        What to do about a wrong checksum of an element set, see `read_tles`.

    Returns
    -------
    tuple of Sgp4Orbit
        In the order of the text.

    Raises
    ------
    InputError
        If the text is neither, or is faulty; the message names the line.
    """
    if encoding_of(text):
        messages = read_omms(text, where, lenient=lenient)
        return tuple(Sgp4Orbit.from_omm(message) for message in messages)
    return tuple(Sgp4Orbit.from_tle(tle) for tle in read_tles(text, where, checksum=checksum))
