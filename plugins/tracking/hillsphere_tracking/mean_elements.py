"""Brouwer's mean elements: secular motion, and the way to osculating elements and back.

Elements are rows a (m), e, i, Ω, ω, M (rad) of arrays (6, N), as in `hillsphere_tracking.kepler`.
The equations and their sources stand in `hillsphere_tracking.dynamics_brouwer`.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi

import numpy as np

from hillsphere import symbolic as sy
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere_tracking.dynamics_brouwer import ZonalField, at_time, osculating_equinoctial
from hillsphere_tracking.kepler import states_from_elements, validate_elements, wrap_angle

__all__ = [
    "EARTH_FIELD",
    "RETROGRADE",
    "ZonalField",
    "classical",
    "equinoctial",
    "mean_from_osculating",
    "osculating",
    "propagate_secular",
    "retrograde_sign",
    "secular_rates",
    "states",
]

EARTH_FIELD = ZonalField()
"""The Earth as of EGM2008's J2 and J4 and the radius of WGS 84."""

RETROGRADE = -0.5
"""Cosine of the inclination below which elements regular at 180° are used; few orbits lie there."""


def secular_rates(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Return the secular rates of Ω, ω and M.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements.
    field : ZonalField
        Of the planet.

    Returns
    -------
    ndarray, shape (3, N)
        rad/s; the rate of M includes the mean motion √(GM/a³).

    Raises
    ------
    InputError
        If the elements are no ellipses.
    """
    start = validate_elements(elements).copy()
    start[3:] = 0.0
    one = np.ones((1, start.shape[1]))
    return _compile_secular(field)(np.concatenate([start, one]))


def propagate_secular(elements: Array, dt_s: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Return mean elements a time later.

    Parameters
    ----------
    elements : ndarray, shape (6, N) or (6, 1)
        Mean elements.
    dt_s : ndarray, shape (N,)
        Seconds from then.
    field : ZonalField
        Of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Mean elements; the angles run on, they are not brought back to one revolution.

    Raises
    ------
    InputError
        If the elements are no ellipses.
    """
    start = validate_elements(elements)
    dt_s = np.atleast_1d(np.asarray(dt_s, dtype=float))
    start = np.broadcast_to(start, (6, max(start.shape[1], dt_s.size)))
    rates = secular_rates(start, field)
    return np.concatenate([start[:3], start[3:] + rates * dt_s])


def osculating(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Return osculating elements of mean ones, by the short-period terms of first order in J2.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements.
    field : ZonalField
        Of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Osculating elements, angles in [0, 2π).

    Raises
    ------
    InputError
        If the elements are no ellipses.
    """
    mean = validate_elements(elements)
    sense = retrograde_sign(mean)
    return classical(_osculating_equinoctial(mean, sense, field), sense)


def mean_from_osculating(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Return the mean elements whose `osculating` are given, to rounding.

    Fixed-point iteration on equinoctial elements, which contracts by about J2 a step.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Osculating elements.
    field : ZonalField
        Of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Mean elements, angles in [0, 2π).

    Raises
    ------
    InputError
        If the elements are no ellipses.
    ConvergenceError
        If the iteration does not settle: the orbit is beyond the theory (deep in the planet, or
        with an eccentricity near one).
    """
    wanted = validate_elements(elements)
    sense = retrograde_sign(wanted)
    target = equinoctial(wanted, sense)
    scale = np.concatenate([target[:1], np.ones((5, target.shape[1]))])
    found = target
    last = np.inf
    for _ in range(40):
        guess = classical(found, sense)
        if not (guess[0] > 0.0).all() or not (guess[1] < 1.0).all():
            break
        miss = target - _osculating_equinoctial(guess, sense, field)
        miss[5] = wrap_angle(miss[5])
        found = found + miss
        change = float(np.abs(miss / scale).max(initial=0.0))
        # rounding: no progress any more, at a level that only rounding explains
        if change < 1e-15 or (change < 1e-13 and change >= 0.5 * last):
            return classical(found, sense)
        last = change
    raise ConvergenceError(
        "no mean elements found for these osculating ones; first-order theory in J2 needs orbits "
        f"outside the planet with e well below 1, got a ≥ {wanted[0].min():.6g} m, "
        f"e ≤ {wanted[1].max():.6g}"
    )


def states(
    elements: Array, dt_s: Array, field: ZonalField = EARTH_FIELD, *, short_period: bool = True
) -> Array:
    """Return inertial states of mean elements a time later.

    Parameters
    ----------
    elements : ndarray, shape (6, N) or (6, 1)
        Mean elements.
    dt_s : ndarray, shape (N,)
        Seconds from then.
    field : ZonalField
        Of the planet.
    short_period : bool
        Whether the short-period terms are added.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s, in the frame of the elements.

    Raises
    ------
    InputError
        If the elements are no ellipses.
    """
    later = propagate_secular(elements, dt_s, field)
    return states_from_elements(osculating(later, field) if short_period else later, field.gm_m3_s2)


def retrograde_sign(elements: Array) -> Array:
    """Return s (N,): −1 for orbits so retrograde that cot(i/2) is the regular variable, else +1."""
    return np.where(np.cos(elements[2]) < RETROGRADE, -1.0, 1.0)


def _osculating_equinoctial(mean: Array, sense: Array, field: ZonalField) -> Array:
    return _compile_osculating(field)(np.concatenate([mean, sense[None]]))


def equinoctial(elements: Array, sense: Array) -> Array:
    """Return the equinoctial elements (6, N), as `dynamics_brouwer.Equinoctial` lists them."""
    a, e, i, node, perigee, mean = elements
    tangent = np.where(sense > 0.0, np.tan(0.5 * i), np.tan(0.5 * (pi - i)))
    turned = perigee + sense * node
    return np.array(
        [a, e * np.cos(turned), e * np.sin(turned), tangent * np.cos(node), tangent * np.sin(node),
         mean + turned]
    )  # fmt: skip


def classical(orbit: Array, sense: Array) -> Array:
    """Return a, e, i, Ω, ω, M (6, N) of equinoctial elements; angles in [0, 2π)."""
    a, k, h, q, p, longitude = orbit
    tilt = 2.0 * np.arctan(np.hypot(q, p))
    node = np.arctan2(p, q)
    turned = np.arctan2(h, k)
    angles = np.remainder([node, turned - sense * node, longitude - turned], 2.0 * pi)
    return np.array([a, np.hypot(k, h), np.where(sense > 0.0, tilt, pi - tilt), *angles])


@lru_cache(maxsize=16)
def _compile_secular(field: ZonalField) -> ArrayFunction:
    inputs = sy.variables("a", "e", "i", "node", "perigee", "mean", "dt")
    return ArrayFunction(at_time(inputs[:6], inputs[6], field)[3:], inputs)


@lru_cache(maxsize=16)
def _compile_osculating(field: ZonalField) -> ArrayFunction:
    inputs = sy.variables("a", "e", "i", "node", "perigee", "mean", "sense")
    orbit = osculating_equinoctial(inputs[:6], inputs[6], field)
    return ArrayFunction(orbit.tuple(), inputs)
