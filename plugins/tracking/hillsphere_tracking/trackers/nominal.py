"""Nominal mean elements of a tracker, from any orbit (TLE, OMM, numerical flight)."""

from __future__ import annotations

import numpy as np

from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import to_earth_fixed, to_inertial
from hillsphere_tracking.kepler import elements_from_states
from hillsphere_tracking.mean_elements import EARTH_FIELD, ZonalField, mean_from_osculating
from hillsphere_tracking.satellites import Orbit

__all__ = ["nominal_elements"]


def nominal_elements(
    orbit: Orbit,
    t_s: Array,
    field: ZonalField = EARTH_FIELD,
    orientation: EarthOrientation = UT1_IS_UTC,
) -> Array:
    """Return the mean elements whose osculating states equal the states of an orbit.

    Elements at the beginning of a pass reproduce the orbit during the pass: an SGP4 orbit of the
    International Space Station to 11 m in 15 minutes.

    Parameters
    ----------
    orbit : Orbit
        Orbit in any frame.
    t_s : ndarray, shape (N,)
        Times of the elements after the orbit's epoch.
    field : ZonalField
        Gravity field that the tracker uses.
    orientation : EarthOrientation
        Orientation that the tracker uses; needed for an orbit in the frame ``gcrs``.

    Returns
    -------
    ndarray, shape (6, N)
        a, e, i, Ω, ω, M (m, rad), in the frame ``teme``.

    Raises
    ------
    PropagationError
        If the orbit has no state at one of the times.
    InputError, ConvergenceError
        If a state is not on an ellipse, or the orbit is outside the range of the theory.
    """
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    x = orbit.states(t_s)
    if orbit.frame != "teme":
        fixed = to_earth_fixed(orbit.frame, x, orbit.epoch, t_s, orientation)
        x = to_inertial("teme", fixed, orbit.epoch, t_s, orientation)
    return mean_from_osculating(elements_from_states(x, field.gm_m3_s2), field)
