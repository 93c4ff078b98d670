"""Given trajectories, of observers and of the plant's centre, interpolated in time."""

from __future__ import annotations

import erfa
import numpy as np
from scipy.interpolate import make_interp_spline

from hillsphere.base.constants import AU_M, DAY_S, J2000_JD
from hillsphere.errors import InputError
from hillsphere.formats.oem import read_oem
from hillsphere.interfaces import Array
from hillsphere.time import J2000, Epoch

__all__ = ["Trajectory", "frame_bias", "read_trajectory"]

_DEGREE = 7
"""Degree of the splines: states every few minutes of a low orbit, or every day of a planet, are
then interpolated to below a metre."""
_FEWEST = 4
"""States from which a spline of degree 3 can be made."""
_WRONG_SPEED = 1e-3
"""Relative difference between the spline's velocities and those given, in the middle of the
trajectory, above which the states are too far apart. A sound one is below 1e-8."""
_EARTH_STEP_S = 0.25 * DAY_S
"""Spacing of the Earth's places: a spline of degree 7 then errs by less than 1 mm, the Moon's pull
included."""


class Trajectory:
    """A trajectory of given states.

    Parameters
    ----------
    name : str
        For messages.
    t_s : ndarray, shape (K,)
        Times, rising.
    x : ndarray, shape (6, K)
        States in inertial axes, m and m/s; the velocities only check the interpolation.

    Raises
    ------
    InputError
        If there are fewer than four states, or they are too far apart.
    """

    def __init__(self, name: str, t_s: Array, x: Array) -> None:
        if len(t_s) < _FEWEST:
            raise InputError(f"{name}: needs at least {_FEWEST} states, got {len(t_s)}")
        self.name, self.span_s = name, (float(t_s[0]), float(t_s[-1]))
        degree = min(_DEGREE, 2 * ((len(t_s) - 2) // 2) + 1)
        self._place = make_interp_spline(t_s - t_s[0], x[:3].T, k=degree)
        self._speed = self._place.derivative()
        middle = len(t_s) // 2
        given = x[3:, middle]
        off = np.linalg.norm(self._speed(t_s[middle] - t_s[0]) - given)
        if off > _WRONG_SPEED * np.linalg.norm(given):
            raise InputError(
                f"{name}: the states are too far apart to be interpolated: in the middle the "
                f"velocity of the interpolation differs by {off:.3g} m/s from the one given"
            )

    def states(self, t_s: Array) -> Array:
        """Return the states (6, N) at times (N,).

        Raises
        ------
        InputError
            If a time is outside the trajectory.
        """
        low, high = float(np.min(t_s)), float(np.max(t_s))
        if low < self.span_s[0] or high > self.span_s[1]:
            worst = low if low < self.span_s[0] else high
            raise InputError(
                f"{self.name}: has states from {self.span_s[0]:.12g} s to {self.span_s[1]:.12g} s "
                f"after the plant's epoch, none for {worst:.12g} s; signals need some light time "
                "more than the data"
            )
        since = t_s - self.span_s[0]
        return np.concatenate([self._place(since).T, self._speed(since).T])


def frame_bias(name: str) -> Array | None:
    """Return the matrix (3, 3) from a fixed celestial frame to the ICRF; None for other frames.

    EME2000 is the mean equator and equinox of J2000, 23 mas from the ICRF.
    """
    if name.startswith(("ICRF", "GCRF")):
        return np.eye(3)
    if name == "EME2000":
        return np.asarray(erfa.bp06(J2000_JD, 0.0)[0]).T
    return None


def read_trajectory(text: str, path: str, zero: Epoch, what: str) -> Trajectory:
    """Read an orbit ephemeris message of one segment.

    Parameters
    ----------
    text : str
        The message.
    path : str
        Its file, for messages.
    zero : Epoch
        From which the trajectory's times count.
    what : str
        The key, for messages.

    Returns
    -------
    Trajectory
        In the axes of the ICRF.

    Raises
    ------
    InputError
        If it cannot be read, or has several segments or another frame.
    """
    segments = read_oem(text, path)
    if len(segments) != 1:
        raise InputError(f"{what}: {path} has {len(segments)} segments; give one of them")
    segment = segments[0]
    turn = frame_bias(segment.ref_frame)
    if turn is None:
        raise InputError(
            f"{what}: {path} is in {segment.ref_frame}; expected ICRF, GCRF or EME2000"
        )
    t = segment.epoch.seconds_since(zero) + segment.t_s
    x = np.concatenate([turn @ segment.x[:3], turn @ segment.x[3:]])
    return Trajectory(f"{what}: {path}", t, x)


def earth_trajectory(zero: Epoch, begin_s: float, end_s: float) -> Trajectory:
    """Return the Earth's way about the barycentre of the Solar System, in the ICRF.

    By ERFA's series, which errs by some kilometres and millimetres per second. Only displacements
    during light times are taken from it.

    Parameters
    ----------
    zero : Epoch
        Origin of the times.
    begin_s, end_s : float
        Span of the times.
    """
    count = max(2 * _DEGREE, int(np.ceil((end_s - begin_s) / _EARTH_STEP_S)) + 2 * _DEGREE)
    t = np.asarray(begin_s + _EARTH_STEP_S * (np.arange(count) - _DEGREE + 1.0), dtype=np.float64)
    days = zero.to("TDB").seconds_since(J2000) / DAY_S + t / DAY_S
    _, barycentric = erfa.epv00(J2000_JD, days)
    x = np.concatenate([barycentric["p"].T * AU_M, barycentric["v"].T * (AU_M / DAY_S)])
    return Trajectory("the Earth", t, x)
