"""Two-body orbits: Kepler's equation, and the conversion between elements and states.

Keplerian elements are the rows a (m), e, i, Ω, ω, M (rad) of an array of shape (6, N). States are
rows of position (m) and velocity (m/s) in the inertial frame to which i and Ω refer. Only ellipses,
e < 1, are supported.

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
    """Wrap angles (rad, any shape) to [−π, π)."""
    return np.asarray(np.remainder(np.asarray(angle_rad) + pi, 2.0 * pi) - pi)


def validate_elements(elements: Array) -> Array:
    """Check Keplerian elements and return them as a float array of shape (6, N).

    Parameters
    ----------
    elements : ndarray, shape (6, N) or (6,)
        a (m), e, i, Ω, ω, M (rad).

    Returns
    -------
    ndarray, shape (6, N)
        The same elements.

    Raises
    ------
    InputError
        If the shape differs, a value is not finite, a ≤ 0, or e is not in [0, 1).
    """
    array = np.asarray(elements, dtype=float)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.shape[0] != 6:
        raise InputError(f"elements must be (6, N): a, e, i, Ω, ω, M; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError("elements must be finite, got nan or inf")
    if not (array[0] > 0.0).all():
        raise InputError(f"semi-major axes must be > 0 m, got {array[0].min()}")
    if not ((array[1] >= 0.0) & (array[1] < 1.0)).all():
        worst = array[1][np.argmax(np.abs(array[1] - 0.5))]
        raise InputError(f"eccentricities must be in [0, 1), got {worst}")
    return array


def eccentric_anomaly(mean_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Solve Kepler's equation E − e sin E = M to rounding, by Newton's method ([1]_, section 2.2).

    On [0, π] the left side is increasing and convex. Newton's method that begins above the root
    therefore decreases monotonically to it, for every e < 1.

    Parameters
    ----------
    mean_anomaly_rad, eccentricity : ndarray, shape (N,)
        Mean anomaly M (rad), of any number of revolutions, and eccentricity in [0, 1).

    Returns
    -------
    ndarray, shape (N,)
        Eccentric anomaly E (rad), in the same revolution as M.

    Raises
    ------
    InputError
        If an eccentricity is outside [0, 1) or a mean anomaly is not finite.
    """
    m_all, e = np.broadcast_arrays(
        np.asarray(mean_anomaly_rad, dtype=float), np.asarray(eccentricity, dtype=float)
    )
    if not (np.isfinite(m_all).all() and ((e >= 0.0) & (e < 1.0)).all()):
        raise InputError("Kepler's equation needs finite mean anomalies and 0 ≤ e < 1")
    # E(M) is odd and E − M is periodic, so that M in [0, π] suffices; M + e ≥ E is above the root.
    reduced = wrap_angle(m_all)
    sign, m = np.where(reduced < 0.0, -1.0, 1.0), np.abs(reduced)
    root = np.minimum(m + e, pi)
    for _ in range(_MAX_ITERATIONS):
        step = (root - e * np.sin(root) - m) / (1.0 - e * np.cos(root))
        root = root - step
        # Two units in the last place; near E = 0 the absolute error counts, not the relative one.
        if (np.abs(step) <= 4e-16 * np.maximum(root, 1e-3)).all():
            break
    return np.asarray(m_all + (sign * root - reduced))


def true_anomaly(eccentric_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Return the true anomaly f (rad), in the same revolution as the eccentric anomaly E.

    f = E + 2 atan2(β sin E, 1 − β cos E) with β = e/(1 + √(1 − e²)) has no quadrant to choose and
    stays accurate at apogee, where tan(E/2) is infinite.

    Parameters
    ----------
    eccentric_anomaly_rad, eccentricity : ndarray, shape (N,)
        Eccentric anomaly, of any number of revolutions, and eccentricity in [0, 1).

    Returns
    -------
    ndarray, shape (N,)
        True anomaly, rad.
    """
    anomaly, e = np.asarray(eccentric_anomaly_rad, dtype=float), np.asarray(eccentricity)
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    ahead = np.arctan2(beta * np.sin(anomaly), 1.0 - beta * np.cos(anomaly))
    return np.asarray(anomaly + 2.0 * ahead)


def mean_anomaly(true_anomaly_rad: Array, eccentricity: Array) -> Array:
    """Return the mean anomaly M (rad), in the same revolution as the true anomaly f.

    Parameters
    ----------
    true_anomaly_rad, eccentricity : ndarray, shape (N,)
        True anomaly, of any number of revolutions, and eccentricity in [0, 1).

    Returns
    -------
    ndarray, shape (N,)
        Mean anomaly, rad.
    """
    f, e = np.asarray(true_anomaly_rad, dtype=float), np.asarray(eccentricity, dtype=float)
    # E from f by the inverse of the formula in `true_anomaly`, then Kepler's equation
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    behind = np.arctan2(beta * np.sin(f), 1.0 + beta * np.cos(f))
    anomaly = f - 2.0 * behind
    return np.asarray(anomaly - e * np.sin(anomaly))


def states_from_elements(elements: Array, gm_m3_s2: float) -> Array:
    """Convert osculating elements to states ([1]_, section 2.6).

    Parameters
    ----------
    elements : ndarray, shape (6, N)
        a (m), e, i, Ω, ω, M (rad).
    gm_m3_s2 : float
        Gravitational parameter.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s, in the frame of i and Ω.

    Raises
    ------
    InputError
        If the elements do not describe ellipses.
    """
    a, e, i, node, perigee, mean = validate_elements(elements)
    anomaly = eccentric_anomaly(mean, e)
    eta = np.sqrt(1.0 - e * e)
    # Perifocal coordinates: x = a (cos E − e), y = a η sin E, with Ė = √(GM/a³)/(1 − e cos E).
    rate = np.sqrt(gm_m3_s2 / a) / (1.0 - e * np.cos(anomaly))
    place = (a * (np.cos(anomaly) - e), a * eta * np.sin(anomaly))
    speed = (-rate * np.sin(anomaly), rate * eta * np.cos(anomaly))
    # The first two columns of the rotation R3(−Ω) R1(−i) R3(−ω): towards perigee, and 90° ahead.
    cn, sn, cp, sp = np.cos(node), np.sin(node), np.cos(perigee), np.sin(perigee)
    ci, si = np.cos(i), np.sin(i)
    to_perigee = np.array([cn * cp - sn * sp * ci, sn * cp + cn * sp * ci, sp * si])
    across = np.array([-cn * sp - sn * cp * ci, -sn * sp + cn * cp * ci, cp * si])
    return np.concatenate([to_perigee * p + across * q for p, q in (place, speed)])


def elements_from_states(states: Array, gm_m3_s2: float) -> Array:
    """Convert states to osculating elements ([1]_, section 2.5).

    Undefined angles are set by convention: Ω = 0 for an equatorial orbit and ω = 0 for a circular
    one. The other angles are then such that the elements reproduce the state.

    Parameters
    ----------
    states : ndarray, shape (6, N)
        Positions, m, and velocities, m/s.
    gm_m3_s2 : float
        Gravitational parameter.

    Returns
    -------
    ndarray, shape (6, N)
        a (m), e, i, Ω, ω, M (rad); angles in [0, 2π).

    Raises
    ------
    InputError
        If the shape differs, or if a state is not on an ellipse.
    """
    x = np.asarray(states, dtype=float)
    if x.ndim != 2 or x.shape[0] != 6:
        raise InputError(f"states must be (6, N), got {x.shape}")
    place, speed = x[:3], x[3:]
    r = np.sqrt((place * place).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # vis-viva equation; a parabola divides by zero and is refused below
        a = 1.0 / (2.0 / r - (speed * speed).sum(axis=0) / gm_m3_s2)
    momentum = np.cross(place, speed, axis=0)
    h = np.sqrt((momentum * momentum).sum(axis=0))
    if not (np.isfinite(a).all() and (a > 0.0).all() and (h > 0.0).all()):
        raise InputError(
            "a state is not on an ellipse: its orbital energy is not negative, or its motion is "
            "purely radial"
        )
    pole = momentum / h
    # From both components: an arc cosine of the pole's z would lose half the digits near i = 0.
    i = np.arctan2(np.hypot(pole[0], pole[1]), pole[2])
    node = np.where(np.hypot(pole[0], pole[1]) > 1e-15, np.arctan2(pole[0], -pole[1]), 0.0)
    # Argument of latitude u = ω + f, from the node (or from +x if the orbit is equatorial).
    to_node = np.array([np.cos(node), np.sin(node), np.zeros_like(node)])
    ahead = np.cross(pole, to_node, axis=0)
    argument = np.arctan2((place * ahead).sum(axis=0), (place * to_node).sum(axis=0))
    # e cos E = 1 − r/a and e sin E = r·v/√(GM a) are regular for circular orbits.
    radial = (place * speed).sum(axis=0)
    e_cos, e_sin = 1.0 - r / a, radial / np.sqrt(gm_m3_s2 * a)
    e = np.hypot(e_cos, e_sin)
    anomaly = np.where(e > 0.0, np.arctan2(e_sin, e_cos), argument)
    perigee = np.where(e > 0.0, argument - true_anomaly(anomaly, e), 0.0)
    mean = anomaly - e_sin
    return np.array([a, e, i, *(np.remainder(angle, 2.0 * pi) for angle in (node, perigee, mean))])
