"""Brouwer's mean elements: secular motion, and the conversion to and from osculating elements.

Elements are rows a (m), e, i, Ω, ω, M (rad) of arrays (6, N), as in `hillsphere_tracking.kepler`.
`hillsphere_tracking.dynamics_brouwer` gives the equations and their sources.
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
"""Zonal field of the Earth: J2 and J4 of EGM2008, equatorial radius of WGS 84."""

RETROGRADE = -0.5
"""Cosine of the inclination (120°) below which elements that are regular at 180° are used. Both
sets are regular in between; few satellites have an inclination near this one."""


def secular_rates(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Return the secular rates of Ω, ω and M, to second order in J2 and first order in J4.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements.
    field : ZonalField
        Gravity field of the planet.

    Returns
    -------
    ndarray, shape (3, N)
        Rates of Ω, ω and M, rad/s; the rate of M includes the mean motion √(GM/a³).

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    """
    # the rates do not depend on the angles: from zero, after one second, the angles are the rates
    start = validate_elements(elements).copy()
    start[3:] = 0.0
    one = np.ones((1, start.shape[1]))
    return _compile_secular(field)(np.concatenate([start, one]))


def propagate_secular(elements: Array, dt_s: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Propagate mean elements by their secular rates.

    Parameters
    ----------
    elements : ndarray, shape (6, N) or (6, 1)
        Mean elements.
    dt_s : ndarray, shape (N,)
        Time since the epoch of the elements.
    field : ZonalField
        Gravity field of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Mean elements at the later times; the angles are not wrapped to one revolution.

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    """
    start = validate_elements(elements)
    dt_s = np.atleast_1d(np.asarray(dt_s, dtype=float))
    start = np.broadcast_to(start, (6, max(start.shape[1], dt_s.size)))
    rates = secular_rates(start, field)
    return np.concatenate([start[:3], start[3:] + rates * dt_s])


def osculating(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Convert mean to osculating elements, with the short-period terms of first order in J2.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Mean elements.
    field : ZonalField
        Gravity field of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Osculating elements, angles in [0, 2π).

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    """
    mean = validate_elements(elements)
    sense = retrograde_sign(mean)
    return classical(_osculating_equinoctial(mean, sense, field), sense)


def mean_from_osculating(elements: Array, field: ZonalField = EARTH_FIELD) -> Array:
    """Convert osculating to mean elements: the inverse of `osculating`, to rounding.

    The fixed-point iteration x ← x + (target − osculating(x)) runs on equinoctial elements, which
    are regular for circular and equatorial orbits. Each step contracts the error by about J2.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        Osculating elements.
    field : ZonalField
        Gravity field of the planet.

    Returns
    -------
    ndarray, shape (6, N)
        Mean elements, angles in [0, 2π).

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    ConvergenceError
        If the iteration does not converge: the orbit is outside the range of the theory (deep
        inside the planet, or with an eccentricity near one).
    """
    wanted = validate_elements(elements)
    sense = retrograde_sign(wanted)
    target = equinoctial(wanted, sense)
    # relative change of a, absolute change of the five others, which are of order one
    scale = np.concatenate([target[:1], np.ones((5, target.shape[1]))])
    estimate = target
    last = np.inf
    for _ in range(40):
        guess = classical(estimate, sense)
        if not (guess[0] > 0.0).all() or not (guess[1] < 1.0).all():
            break
        miss = target - _osculating_equinoctial(guess, sense, field)
        miss[5] = wrap_angle(miss[5])
        estimate = estimate + miss
        change = float(np.abs(miss / scale).max(initial=0.0))
        # The change stagnates at a level that only rounding explains.
        if change < 1e-15 or (change < 1e-13 and change >= 0.5 * last):
            return classical(estimate, sense)
        last = change
    raise ConvergenceError(
        "the conversion from osculating to mean elements does not converge; the first-order theory "
        "in J2 needs orbits outside the planet with e well below 1, got a ≥ "
        f"{wanted[0].min():.6g} m, e ≤ {wanted[1].max():.6g}"
    )


def states(
    elements: Array, dt_s: Array, field: ZonalField = EARTH_FIELD, *, short_period: bool = True
) -> Array:
    """Return the inertial states of mean elements at later times.

    Parameters
    ----------
    elements : ndarray, shape (6, N) or (6, 1)
        Mean elements.
    dt_s : ndarray, shape (N,)
        Time since the epoch of the elements.
    field : ZonalField
        Gravity field of the planet.
    short_period : bool
        Add the short-period terms of J2.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s, in the frame of the elements.

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    """
    later = propagate_secular(elements, dt_s, field)
    return states_from_elements(osculating(later, field) if short_period else later, field.gm_m3_s2)


def retrograde_sign(elements: Array) -> Array:
    """Return the sign s (N,) of equinoctial elements: −1 if cos i < `RETROGRADE`, else +1.

    With s = 1 the elements contain tan(i/2), which is singular at i = 180°; with s = −1 they
    contain cot(i/2), which is singular at i = 0.
    """
    return np.where(np.cos(elements[2]) < RETROGRADE, -1.0, 1.0)


def _osculating_equinoctial(mean: Array, sense: Array, field: ZonalField) -> Array:
    return _compile_osculating(field)(np.concatenate([mean, sense[None]]))


def equinoctial(elements: Array, sense: Array) -> Array:
    """Convert classical to equinoctial elements (6, N), see `dynamics_brouwer.Equinoctial`."""
    # t = tan(i/2) for s = 1 and cot(i/2) = tan((π − i)/2) for s = −1; ϖ = ω + sΩ
    a, e, i, node, perigee, mean = elements
    tangent = np.where(sense > 0.0, np.tan(0.5 * i), np.tan(0.5 * (pi - i)))
    turned = perigee + sense * node
    return np.array(
        [a, e * np.cos(turned), e * np.sin(turned), tangent * np.cos(node), tangent * np.sin(node),
         mean + turned]
    )  # fmt: skip


def classical(orbit: Array, sense: Array) -> Array:
    """Convert equinoctial to classical elements a, e, i, Ω, ω, M (6, N); angles in [0, 2π)."""
    # (q, p) = t (cos Ω, sin Ω) and (k, h) = e (cos ϖ, sin ϖ), then ω = ϖ − sΩ and M = λ − ϖ
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
