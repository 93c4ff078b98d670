"""Two-body orbits: Kepler's equation, and elements to states and back.

Elements are rows a (m), e, i, Ω, ω, M (rad) of an array of shape (6, N); states are rows of
position (m) and velocity (m/s) in the inertial frame to which i and Ω refer. Ellipses only, e < 1.

References
----------
.. [1] Vallado, D. A. (2013), Fundamentals of Astrodynamics and Applications, 4th ed., sections 2.2
   and 2.5-2.6.
"""

from __future__ import annotations

from math import pi

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = [
    "eccentric_anomaly",
    "elements_from_states",
    "mean_anomaly",
    "states_from_elements",
    "true_anomaly",
    "validate_elements",
    "wrap_angle",
]

_MAX_ITERATIONS = 80
"""Newton steps at most. At e = 0.999 it settles within 14; above e = 0.7 the last bit of up to 1.5
% of the anomalies flickers without end, and this limit ends the loop."""


def wrap_angle(angle_rad: Array) -> Array:
    """Return angles brought to [−π, π); any shape."""
    return np.asarray(np.remainder(np.asarray(angle_rad) + pi, 2.0 * pi) - pi)


def validate_elements(elements: Array) -> Array:
    """Return elements as floats of shape (6, N).

    Raises
    ------
    InputError
        If the shape is another one, a value is not finite, a ≤ 0, or e is not in [0, 1).
    """
    found = np.asarray(elements, dtype=float)
    if found.ndim == 1:
        found = found[:, None]
    if found.ndim != 2 or found.shape[0] != 6:
        raise InputError(f"elements must be (6, N): a, e, i, Ω, ω, M; got shape {found.shape}")
    if not np.isfinite(found).all():
        raise InputError("elements must be finite, got nan or inf")
    if not (found[0] > 0.0).all():
        raise InputError(f"semi-major axes must be > 0 m, got {found[0].min()}")
    if not ((found[1] >= 0.0) & (found[1] < 1.0)).all():
        worst = found[1][np.argmax(np.abs(found[1] - 0.5))]
        raise InputError(f"eccentricities must be in [0, 1), got {worst}")
    return found


def eccentric_anomaly(mean_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Solve Kepler's equation E − e sin E = M to rounding.

    On [0, π] its left side is convex and rises, so Newton's method from above the root falls to
    it whatever e < 1 is.

    Parameters
    ----------
    mean_anomaly_rad, eccentricity : ndarray, shape (N,)
        M, of any number of revolutions, and e in [0, 1).

    Returns
    -------
    ndarray, shape (N,)
        E, in the same revolution as M.

    Raises
    ------
    InputError
        If an eccentricity is outside [0, 1) or anything is not finite.
    """
    m_all, e = np.broadcast_arrays(
        np.asarray(mean_anomaly_rad, dtype=float), np.asarray(eccentricity, dtype=float)
    )
    if not (np.isfinite(m_all).all() and ((e >= 0.0) & (e < 1.0)).all()):
        raise InputError("Kepler's equation needs finite mean anomalies and 0 ≤ e < 1")
    reduced = wrap_angle(m_all)
    sign, m = np.where(reduced < 0.0, -1.0, 1.0), np.abs(reduced)
    root = np.minimum(m + e, pi)
    for _ in range(_MAX_ITERATIONS):
        step = (root - e * np.sin(root) - m) / (1.0 - e * np.cos(root))
        root = root - step
        if (np.abs(step) <= 4e-16 * np.maximum(root, 1e-3)).all():
            break
    return np.asarray(m_all + (sign * root - reduced))


def true_anomaly(eccentric_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Return f (N,) of E and e (N,), in the same revolution as E."""
    anomaly, e = np.asarray(eccentric_anomaly_rad, dtype=float), np.asarray(eccentricity)
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    ahead = np.arctan2(beta * np.sin(anomaly), 1.0 - beta * np.cos(anomaly))
    return np.asarray(anomaly + 2.0 * ahead)


def mean_anomaly(true_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Return M (N,) of f and e (N,), in the same revolution as f."""
    f, e = np.asarray(true_anomaly_rad, dtype=float), np.asarray(eccentricity, dtype=float)
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    behind = np.arctan2(beta * np.sin(f), 1.0 + beta * np.cos(f))
    anomaly = f - 2.0 * behind
    return np.asarray(anomaly - e * np.sin(anomaly))


def states_from_elements(elements: Array, gm_m3_s2: float) -> Array:
    """Return the states of osculating elements.

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        a, e, i, Ω, ω, M.
    gm_m3_s2 : float
        Gravitational parameter.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s.

    Raises
    ------
    InputError
        If the elements are no ellipses.
    """
    a, e, i, node, perigee, mean = validate_elements(elements)
    anomaly = eccentric_anomaly(mean, e)
    eta = np.sqrt(1.0 - e * e)
    rate = np.sqrt(gm_m3_s2 / a) / (1.0 - e * np.cos(anomaly))
    place = (a * (np.cos(anomaly) - e), a * eta * np.sin(anomaly))
    speed = (-rate * np.sin(anomaly), rate * eta * np.cos(anomaly))
    cn, sn, cp, sp = np.cos(node), np.sin(node), np.cos(perigee), np.sin(perigee)
    ci, si = np.cos(i), np.sin(i)
    to_perigee = np.array([cn * cp - sn * sp * ci, sn * cp + cn * sp * ci, sp * si])
    across = np.array([-cn * sp - sn * cp * ci, -sn * sp + cn * cp * ci, cp * si])
    return np.concatenate([to_perigee * p + across * q for p, q in (place, speed)])


def elements_from_states(states: Array, gm_m3_s2: float) -> Array:
    """Return the osculating elements of states.

    Where an angle is not defined it is a convention that keeps the state: Ω = 0 for an equatorial
    orbit, ω = 0 for a circular one.

    Parameters
    ----------
    states : ndarray, shape (6, N)
        Positions, m, and velocities, m/s.
    gm_m3_s2 : float
        Gravitational parameter.

    Returns
    -------
    ndarray, shape (6, N)
        a, e, i, Ω, ω, M; angles in [0, 2π).

    Raises
    ------
    InputError
        If the shape is another one or a state is on no ellipse.
    """
    x = np.asarray(states, dtype=float)
    if x.ndim != 2 or x.shape[0] != 6:
        raise InputError(f"states must be (6, N), got {x.shape}")
    place, speed = x[:3], x[3:]
    r = np.sqrt((place * place).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        a = 1.0 / (2.0 / r - (speed * speed).sum(axis=0) / gm_m3_s2)
    momentum = np.cross(place, speed, axis=0)
    h = np.sqrt((momentum * momentum).sum(axis=0))
    if not (np.isfinite(a).all() and (a > 0.0).all() and (h > 0.0).all()):
        raise InputError(
            "a state is on no ellipse: its energy is not negative, or it falls radially"
        )
    pole = momentum / h
    # in the plane, from the node (or +x if the orbit is equatorial)
    i = np.arctan2(np.hypot(pole[0], pole[1]), pole[2])
    node = np.where(np.hypot(pole[0], pole[1]) > 1e-15, np.arctan2(pole[0], -pole[1]), 0.0)
    to_node = np.array([np.cos(node), np.sin(node), np.zeros_like(node)])
    ahead = np.cross(pole, to_node, axis=0)
    argument = np.arctan2((place * ahead).sum(axis=0), (place * to_node).sum(axis=0))
    radial = (place * speed).sum(axis=0)
    e_cos, e_sin = 1.0 - r / a, radial / np.sqrt(gm_m3_s2 * a)
    e = np.hypot(e_cos, e_sin)
    anomaly = np.where(e > 0.0, np.arctan2(e_sin, e_cos), argument)
    perigee = np.where(e > 0.0, argument - true_anomaly(anomaly, e), 0.0)
    mean = anomaly - e_sin
    return np.array([a, e, i, *(np.remainder(angle, 2.0 * pi) for angle in (node, perigee, mean))])
