"""Transformation from inertial frames to the rotating Earth, on arrays of times.

The inertial frames are

- ``teme``: true equator and mean equinox of date, the frame of SGP4 and of mean-element theories.
  Greenwich mean sidereal time of 1982 [1]_ and polar motion lead to the Earth-fixed frame. The
  frame is taken as inertial over a pass or a few days: its slow rotation (precession, 7e-12 rad/s,
  5 m per day in a low orbit) is neglected.
- ``gcrs``: geocentric celestial reference system, axes of the ICRF. Precession and nutation (IAU
  2006/2000A), Earth rotation angle and polar motion [2]_ lead to the Earth-fixed frame. The
  observed offsets of the celestial pole (below 0.5 mas, 2 cm at the Earth's surface) are neglected.

The Earth-fixed frame is the terrestrial system (ITRF).

References
----------
.. [1] Vallado, D. A., et al., Revisiting Spacetrack Report #3, AIAA 2006-6753, 2006, appendix C.
.. [2] IERS Conventions (2010), IERS Technical Note 36, chapter 5.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, J2000_JD, TT_MINUS_TAI_S
from hillsphere.base.errors import InputError
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation, tai_of
from hillsphere.base.time import Epoch

__all__ = [
    "ROTATION_RATES_RAD_S",
    "InertialFrame",
    "celestial_to_intermediate",
    "earth_angle",
    "earth_fixed",
    "to_earth_fixed",
    "to_inertial",
]

InertialFrame: TypeAlias = Literal["teme", "gcrs"]

ROTATION_RATES_RAD_S = MappingProxyType(
    {"teme": 7.292115855306589e-5, "gcrs": 7.292115146706979e-5}
)
"""Angular velocity of the Earth about its axis in each frame, rad per second of UT1: rate of GMST
(1982, at J2000; its relative change is 4e-16 per century) and of the Earth rotation angle."""

_NODES_PER_DAY = 8
"""Spacing of the nodes of the cubic interpolation of precession and nutation, s; its error stays
below 1e-12 rad."""


def earth_angle(
    frame: InertialFrame, epoch: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC
) -> Array:
    """Return the rotation angle of the Earth about its axis in the frame.

    Parameters
    ----------
    frame : {"teme", "gcrs"}
        Greenwich mean sidereal time of 1982, or the Earth rotation angle.
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (N,)
        Times, SI seconds after the epoch.
    orientation : EarthOrientation
        Gives UT1; by default UT1 = UTC, an error of up to 0.9 s or 4e-3°.

    Returns
    -------
    ndarray, shape (N,)
        Angles in [0, 2π).

    Raises
    ------
    InputError
        If the frame is unknown.
    """
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    return _angle(frame, epoch, t_s, orientation.at(epoch, t_s).ut1_minus_tai_s)


def earth_fixed(
    frame: InertialFrame, epoch: Epoch, t_s: Array, orientation: EarthOrientation = UT1_IS_UTC
) -> Array:
    """Return the rotation matrices from an inertial frame to the Earth-fixed frame.

    Parameters
    ----------
    frame : {"teme", "gcrs"}
        Inertial frame.
    epoch : Epoch
        Origin of the times, in any time scale.
    t_s : ndarray, shape (N,)
        Times, SI seconds after the epoch.
    orientation : EarthOrientation
        Gives UT1 and polar motion; by default UT1 = UTC without polar motion.

    Returns
    -------
    ndarray, shape (3, 3, N)
        ``r_fixed = einsum("ijn,jn->in", matrices, r_inertial)``.

    Raises
    ------
    InputError
        If the frame is unknown.
    """
    about_axis, pole = _factors(frame, epoch, t_s, orientation)
    return about_axis if pole is None else np.einsum("ijn,jkn->ikn", pole, about_axis)


def to_earth_fixed(
    frame: InertialFrame,
    x: Array,
    epoch: Epoch,
    t_s: Array,
    orientation: EarthOrientation = UT1_IS_UTC,
) -> Array:
    """Transform inertial states to Earth-fixed ones: r_fixed = P Q r, v_fixed = P (Q v − ω × Q r).

    Q is the rotation to the Earth's axis and prime meridian, P polar motion, ω the Earth's angular
    velocity about its axis. The motion of the axis itself (below 1e-11 rad/s) is neglected.

    Parameters
    ----------
    frame : {"teme", "gcrs"}
        Frame of the given states.
    x : ndarray, shape (6, N)
        Positions, m, and velocities, m/s.
    epoch : Epoch
        Origin of the times, in any time scale.
    t_s : ndarray, shape (N,)
        Times, SI seconds after the epoch.
    orientation : EarthOrientation
        Gives UT1 and polar motion; by default UT1 = UTC without polar motion.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities relative to the rotating Earth, m/s.

    Raises
    ------
    InputError
        If the frame is unknown or shapes do not match.
    """
    x, t_s = _states(x, t_s)
    if frame == "teme":
        return _from_mean_equinox(x, epoch, t_s, orientation)
    about_axis, pole = _factors(frame, epoch, t_s, orientation)
    rate = ROTATION_RATES_RAD_S[frame]
    place = np.einsum("ijn,jn->in", about_axis, x[:3])
    speed = np.einsum("ijn,jn->in", about_axis, x[3:])
    speed[0] += rate * place[1]
    speed[1] -= rate * place[0]
    if pole is not None:
        place, speed = (np.einsum("ijn,jn->in", pole, part) for part in (place, speed))
    return np.concatenate([place, speed])


def to_inertial(
    frame: InertialFrame,
    x_fixed: Array,
    epoch: Epoch,
    t_s: Array,
    orientation: EarthOrientation = UT1_IS_UTC,
) -> Array:
    """Transform Earth-fixed states to inertial ones; the inverse of `to_earth_fixed`.

    Parameters
    ----------
    frame : {"teme", "gcrs"}
        Frame of the result.
    x_fixed : ndarray, shape (6, N)
        Earth-fixed positions, m, and velocities relative to the turning Earth, m/s.
    epoch, t_s, orientation
        As for `to_earth_fixed`.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s.

    Raises
    ------
    InputError
        If the frame is unknown or shapes do not match.
    """
    x_fixed, t_s = _states(x_fixed, t_s)
    about_axis, pole = _factors(frame, epoch, t_s, orientation)
    place, speed = x_fixed[:3], x_fixed[3:].copy()
    if pole is not None:
        place, speed = (np.einsum("jin,jn->in", pole, part) for part in (place, speed))
    rate = ROTATION_RATES_RAD_S[frame]
    speed[0] -= rate * place[1]
    speed[1] += rate * place[0]
    return np.concatenate([np.einsum("jin,jn->in", about_axis, part) for part in (place, speed)])


def celestial_to_intermediate(epoch: Epoch, t_s: Array) -> Array:
    """Return precession and nutation: matrices from the GCRS to the celestial intermediate system.

    The model is IAU 2006/2000A. Its angles are evaluated at fixed instants, eight per day, and
    interpolated by cubics, which takes 1 µs per time instead of 60 µs. Since the instants are
    fixed, the result for a time does not depend on the other times.

    Parameters
    ----------
    epoch : Epoch
        Origin of the times, in any time scale.
    t_s : ndarray, shape (N,)
        Times, SI seconds after the epoch.

    Returns
    -------
    ndarray, shape (3, 3, N)
        Rotation matrices; the third row is the Earth's axis (celestial intermediate pole).
    """
    day, fraction = tai_of(epoch)
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    since = (day - J2000_JD) + fraction + (t_s + TT_MINUS_TAI_S) / DAY_S
    place = since * _NODES_PER_DAY
    cell = np.floor(place).astype(np.int64)
    nodes = np.unique(np.concatenate([cell + k for k in (-1, 0, 1, 2)]))
    at = np.searchsorted(nodes, cell)
    # Lagrange's cubic through the nodes −1, 0, 1 and 2 about each cell.
    u = place - cell
    weights = (
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    )
    angles = erfa.xys06a(J2000_JD, nodes / _NODES_PER_DAY)
    x, y, s = (
        sum((w * angle[at + k] for k, w in zip((-1, 0, 1, 2), weights, strict=True)), np.zeros(()))
        for angle in angles
    )
    return np.moveaxis(erfa.c2ixys(x, y, s), 0, -1)


def _from_mean_equinox(x: Array, epoch: Epoch, t_s: Array, orientation: EarthOrientation) -> Array:
    """Return `to_earth_fixed` of states in TEME, without the matrices, most of which is zeros."""
    now = orientation.at(epoch, t_s)
    angle = _angle("teme", epoch, t_s, now.ut1_minus_tai_s)
    c, s, rate = np.cos(angle), np.sin(angle), ROTATION_RATES_RAD_S["teme"]
    turned = np.empty_like(x)
    for row in (0, 3):
        turned[row] = c * x[row] + s * x[row + 1]
        turned[row + 1] = c * x[row + 1] - s * x[row]
        turned[row + 2] = x[row + 2]
    turned[3] += rate * turned[1]
    turned[4] -= rate * turned[0]
    x_pole, y_pole = now.x_pole_rad, now.y_pole_rad
    if not (x_pole.any() or y_pole.any()):
        return turned
    # P = R1(−y_p) R2(−x_p); s′ belongs to the system of 2006 only
    cx, sx, cy, sy = np.cos(x_pole), np.sin(x_pole), np.cos(y_pole), np.sin(y_pole)
    fixed = np.empty_like(x)
    for row in (0, 3):
        a, b, d = turned[row : row + 3]
        fixed[row] = cx * a + sx * d
        along = cx * d - sx * a
        fixed[row + 1] = cy * b - sy * along
        fixed[row + 2] = sy * b + cy * along
    return fixed


def _states(x: Array, t_s: Array) -> tuple[Array, Array]:
    x, t_s = np.asarray(x, dtype=float), np.atleast_1d(np.asarray(t_s, dtype=float))
    if x.shape != (6, t_s.size):
        raise InputError(f"states must be (6, {t_s.size}), one a time, got {x.shape}")
    return x, t_s


def _factors(
    frame: InertialFrame, epoch: Epoch, t_s: Array, orientation: EarthOrientation
) -> tuple[Array, Array | None]:
    """Return Q, the rotation to the rotating axes, and polar motion P, or None for none."""
    t_s = np.atleast_1d(np.asarray(t_s, dtype=float))
    now = orientation.at(epoch, t_s)
    angle = _angle(frame, epoch, t_s, now.ut1_minus_tai_s)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.zeros((3, 3, t_s.size))
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1], turn[2, 2] = c, s, -s, c, 1.0
    if frame == "gcrs":
        turn = np.einsum("ijn,jkn->ikn", turn, celestial_to_intermediate(epoch, t_s))
    if not (now.x_pole_rad.any() or now.y_pole_rad.any()):
        return turn, None
    # s' (below 0.1 mas) belongs to the system of 2006 only
    day, fraction = tai_of(epoch)
    tt = fraction + (t_s + TT_MINUS_TAI_S) / DAY_S
    sp = erfa.sp00(day, tt) if frame == "gcrs" else 0.0
    return turn, np.moveaxis(erfa.pom00(now.x_pole_rad, now.y_pole_rad, sp), 0, -1)


def _angle(frame: InertialFrame, epoch: Epoch, t_s: Array, ut1_minus_tai_s: Array) -> Array:
    day, fraction = tai_of(epoch)
    ut1 = fraction + (t_s + ut1_minus_tai_s) / DAY_S
    if frame == "teme":
        return np.asarray(erfa.gmst82(day, ut1))
    if frame == "gcrs":
        return np.asarray(erfa.era00(day, ut1))
    raise InputError(f"no inertial frame {frame!r}; known: {', '.join(get_args(InertialFrame))}")
