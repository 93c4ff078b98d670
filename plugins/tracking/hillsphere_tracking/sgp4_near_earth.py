"""SGP4 of many satellites at many times in one call, and a bound on how long an orbit lasts.

Each column of a call has its own elements and its own time, so that it may mix satellites at will.
The compiled theory is that for periods below 225 min; it leaves deep space out [2]_.

References
----------
.. [1] F. R. Hoots, R. L. Roehrich (1980), Models for Propagation of NORAD Element Sets, Spacetrack
   Report #3, section 6 (SGP4).
.. [2] D. A. Vallado, P. Crawford, R. Hujsak, T. S. Kelso (2006), Revisiting Spacetrack Report #3,
   AIAA 2006-6753.
"""

from __future__ import annotations

from functools import cache
from math import cos, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere import symbolic as sy
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array

__all__ = ["COMPILED_FROM", "elements_of", "is_certain_to_last", "propagate_near_earth"]

COMPILED_FROM = 20_000
"""States from which the compiled theory is worth its cost. It takes 0.18 µs a state where the
library takes 0.6 µs, and once in a process 25 ms to load (0.2 s to compile, once on a machine): a
process that needs only these few loses at most 17 ms, one that asks again gains from then on. The
choice depends on the number of states alone, so that results do not depend on what ran before."""

_WGS72_RADIUS_KM = 6378.135
_J2, _J3_OVER_J2 = 0.001082616, -2.53881e-6 / 0.001082616
"""Constants of WGS 72, the only ones for which the compiled theory is written [2]_."""
_FINE = 0.5
"""Largest relative decrease of √a by drag for which `is_certain_to_last` vouches: beyond it the
power series in time is far from where it was fitted."""
_LEAST_E = -0.0009
"""Least mean eccentricity for which it vouches; the theory gives error 1 below −0.001 [2]_."""
_LEAST_RADIUS = 1.000001
"""Least radius, in radii of the Earth, for which it vouches; the theory gives error 6 below 1. The
difference, 6 m, is far above rounding."""


def elements_of(satellite: Any) -> Array | None:
    """Return the elements (7,) of a `Satrec` for `propagate_near_earth`.

    Parameters
    ----------
    satellite : sgp4.api.Satrec
        Initialised elements.

    Returns
    -------
    ndarray, shape (7,), or None
        Mean motion (rad/min), e, i, Ω, ω, M (rad), B*; None for a satellite in deep space or with
        other constants than those of WGS 72, which the compiled theory does not cover.
    """
    if satellite.method != "n" or satellite.radiusearthkm != _WGS72_RADIUS_KM:
        return None
    names = ("no_kozai", "ecco", "inclo", "nodeo", "argpo", "mo", "bstar")
    return np.array([getattr(satellite, name) for name in names])


def propagate_near_earth(elements: Array, t_s: Array) -> tuple[NDArray[np.uint8], Array]:
    """Return the states of satellites in TEME by SGP4, each at its own time.

    Parameters
    ----------
    elements : ndarray, shape (7, N) or (7, 1)
        As `elements_of` gives them, column by column.
    t_s : ndarray, shape (N,)
        Time since the epoch of the elements, s.

    Returns
    -------
    code : ndarray of uint8, shape (N,)
        Error codes of SGP4, 0 for none.
    x : ndarray, shape (6, N)
        Positions, m, and velocities, m/s; meaningless where there is an error.
    """
    given = np.empty((8, t_s.size))
    given[:7] = elements
    np.divide(t_s, 60.0, out=given[7])
    found = _compile_sgp4()(given)
    return found[6].astype(np.uint8), 1e3 * found[:6]


@cache
def _compile_sgp4() -> ArrayFunction:
    inputs = sy.variables("n", "e", "i", "node", "perigee", "mean", "drag", "minutes")
    return ArrayFunction(sy.sgp4(inputs[:7], inputs[7]), inputs)


def is_certain_to_last(satellite: Any, minutes: float) -> bool:
    """Return whether SGP4 certainly gives no error between −t and t minutes from the epoch.

    The answer costs nothing beside a propagation, and is "no" where it is not certain. The theory's
    a shrinks by (1 − C1 t − D2 t² − D3 t³ − D4 t⁴)² and its e by B* C4 t + B* C5 (sin M − sin M0)
    [1]_. Bounds of both bound the radius from below: r ≥ a (1 − e_L), with the long-period term of
    J3 in e_L, minus the short-period terms of J2, which [2]_ adds last.

    Parameters
    ----------
    satellite : sgp4.api.Satrec
        Initialised elements.
    minutes : float
        t ≥ 0.

    Returns
    -------
    bool
        True only for elements that `elements_of` takes.
    """
    if elements_of(satellite) is None:
        return False
    a, e = satellite.a, satellite.ecco
    c1, c4, c5, d = _drag(satellite)
    shrunk = sum(abs(c) * minutes ** (k + 1) for k, c in enumerate((c1, *d)))
    change = abs(satellite.bstar) * (abs(c4) * minutes + 2.0 * abs(c5))
    if not (shrunk < _FINE and e - change > _LEAST_E and e + change < 0.9):
        return False
    least, most = a * (1.0 - shrunk) ** 2, e + change
    # long-period term of the eccentricity vector: J3 sin i / (2 J2 a (1 − e²))
    lifted = most + 0.5 * abs(_J3_OVER_J2) / (least * (1.0 - most * most))
    if not lifted < 1.0:
        return False
    latus = least * (1.0 - lifted * lifted)
    # r (1 − 3/2 k₂/p² η (3 cos² i − 1)) + k₂/2p sin² i cos 2u with k₂ = J2/2, |3 cos² i − 1| ≤ 2
    short = 0.5 * _J2 / latus
    radius = least * (1.0 - lifted) * (1.0 - 3.0 * short / latus) - 0.5 * short
    return bool(radius > _LEAST_RADIUS)


def _drag(satellite: Any) -> tuple[float, float, float, tuple[float, float, float]]:
    """Return C1, C4, C5 and (D2, D3, D4) of SGP4 ([1]_, with the corrections of [2]_)."""
    a, e, i = satellite.a, satellite.ecco, satellite.inclo
    perigee_km = (a * (1.0 - e) - 1.0) * _WGS72_RADIUS_KM
    # height at which the density is fitted: lowered with the perigee below 156 km
    fitted_km = 78.0 if perigee_km >= 156.0 else max(perigee_km - 78.0, 20.0)
    s = fitted_km / _WGS72_RADIUS_KM + 1.0
    density = ((120.0 - fitted_km) / _WGS72_RADIUS_KM) ** 4
    free = 1.0 - e * e
    near = 1.0 / (a - s)
    eta = a * e * near
    eta2, both = eta * eta, e * eta
    across = abs(1.0 - eta2)
    tilt = 3.0 * cos(i) ** 2 - 1.0
    # the mean motion of Brouwer's theory follows from a, that of Kozai is given
    n = satellite.xke / (a * sqrt(a))
    first = density * near**4 / across**3.5
    c1 = satellite.bstar * first * n * (
        a * (1.0 + 1.5 * eta2 + both * (4.0 + eta2))
        + 0.375 * _J2 * near / across * tilt * (8.0 + 3.0 * eta2 * (8.0 + eta2))
    )  # fmt: skip
    c4 = 2.0 * n * first * a * free * (
        eta * (2.0 + 0.5 * eta2) + e * (0.5 + 2.0 * eta2)
        - _J2 * near / (a * across) * (
            -3.0 * tilt * (1.0 - 2.0 * both + eta2 * (1.5 - 0.5 * both))
            + 0.75 * sin(i) ** 2 * (2.0 * eta2 - both * (1.0 + eta2)) * cos(2.0 * satellite.argpo)
        )
    )  # fmt: skip
    c5 = 2.0 * first * a * free * (1.0 + 2.75 * (eta2 + both) + both * eta2)
    d2 = 4.0 * a * near * c1 * c1
    part = d2 * near * c1 / 3.0
    d3 = (17.0 * a + s) * part
    d4 = 0.5 * part * a * near * (221.0 * a + 31.0 * s) * c1
    return c1, c4, c5, (d2, d3, d4)
