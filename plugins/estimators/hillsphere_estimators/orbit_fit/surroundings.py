"""Where the spacecraft of a plant and its observers are, in common inertial axes.

About the Earth the axes are those of the plant, ``teme`` or ``gcrs``, with the origin in the
Earth. About another body they are those of the ICRF. The origin is then that body for signals
between spacecraft near it, and the barycentre of the Solar System for signals from and to the
Earth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import erfa
import numpy as np
from scipy.interpolate import make_interp_spline

from hillsphere.base.constants import DAY_S, J2000_JD
from hillsphere.base.contracts import Contract
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.model.earth.rotation import InertialFrame, earth_fixed
from hillsphere.model.ephemeris import from_equator
from hillsphere.model.frame_motion import frame_motion
from hillsphere.time import J2000, Epoch
from hillsphere_estimators.orbit_fit.light_time import FARTHEST_S
from hillsphere_estimators.orbit_fit.trajectory import Trajectory, earth_trajectory, frame_bias

__all__ = ["OF_DATE", "Surroundings", "is_about_earth", "zero_of"]

OF_DATE = ("TEME", "TOD", "TOD_EARTH")
"""Frames of right ascension and declination that follow the Earth's axis."""
_EARTH_FRAMES = ("teme", "gcrs")
_MARGIN_S = 2.5 * FARTHEST_S
"""Before and after the data the Earth's place and rotation are known for this long: the longest
round trip, and some more."""
_TURN_STEP_S = 600.0
"""Spacing of the Earth's rotation, which is interpolated by a spline of degree 7: its error, 1e-14
by (ω h)⁸/8!, is below the rounding of positions."""


@runtime_checkable
class _HeliocentricFrame(Contract, Protocol):
    """A plant in a frame that turns with an orbit around the Sun, such as ``proximity``."""

    @property
    def epoch(self) -> str | None:
        """Date (TDB) of time 0."""
        ...

    @property
    def oriented(self) -> bool:
        """Whether its heliocentric axes are those of ecliptic and equinox J2000."""
        ...

    def heliocentric(self, t_s: Array) -> Mapping[str, Array]:
        """Return the axes ``"axes"`` (3, 3, N) as columns, in heliocentric ones, and others."""
        ...


def is_about_earth(plant: Plant) -> bool:
    """Return whether a plant's states are inertial and refer to the Earth."""
    return plant.frame in _EARTH_FRAMES


def zero_of(plant: Plant, start: Epoch) -> Epoch:
    """Return the instant from which a plant's times count.

    Parameters
    ----------
    plant : Plant
        Motion about the Earth, about a moon, or about an asteroid.
    start : Epoch
        Of the states that are fitted; the origin of times of a plant without a date of its own.

    Raises
    ------
    InputError
        If the plant has a frame whose date or place among the stars is not known.
    """
    if is_about_earth(plant):
        return plant.epoch  # type: ignore[attr-defined, no-any-return]  # earth_orbit has one
    if isinstance(plant, _HeliocentricFrame):
        if plant.epoch is None:
            raise InputError(
                f"plant: the frame {plant.frame} has no date: give the body its epoch and "
                "mean_anomaly, and the plant no true_anomaly"
            )
        if not plant.oriented:
            raise InputError(
                f"plant: the body of {plant.frame} does not say how its orbit stands among the "
                "stars; give it inclination, node and periapsis"
            )
        return Epoch.parse(plant.epoch, "TDB")
    if not plant.frame.startswith("hill:"):
        raise InputError(
            "plant: expected motion about the Earth, about an asteroid, or in the rotating frame "
            f"of a moon (hill:BODY), got {plant.frame}"
        )
    try:
        frame_motion(plant, start, np.zeros(1), {})
    except InputError as error:
        raise InputError(f"plant: {error}") from error
    return start


class Surroundings:
    """States of spacecraft and observers, and axes in which they are measured.

    Parameters
    ----------
    plant : Plant
        Motion of the spacecraft.
    zero : Epoch
        From which its times count.
    orientation : EarthOrientation
        UT1 and polar motion.
    stations : mapping of str to Station
        On the Earth.
    observers : mapping of str to Trajectory or None
        Other observers: trajectories about the plant's centre; None for the Earth's centre.
    centre : Trajectory, optional
        Of the plant's centre relative to the Earth; needed for observers at the Earth if the plant
        is not about it.
    span_s : tuple of float
        First and last time of the data.

    Raises
    ------
    InputError
        If the place of the Earth is needed and not given.
    """

    def __init__(
        self,
        plant: Plant,
        zero: Epoch,
        orientation: EarthOrientation,
        stations: Mapping[str, Station],
        observers: Mapping[str, Trajectory | None],
        centre: Trajectory | None,
        span_s: tuple[float, float],
    ) -> None:
        self.zero = zero
        self._stations, self._observers, self._centre = stations, observers, centre
        self.about_earth = is_about_earth(plant)
        self.axes: InertialFrame = "teme" if plant.frame == "teme" else "gcrs"
        about_moon = not self.about_earth and not isinstance(plant, _HeliocentricFrame)
        self._turning = plant if about_moon else None
        if not self.about_earth and centre is None:
            at_earth = [*stations, *(name for name, way in observers.items() if way is None)]
            if at_earth:
                raise InputError(
                    f"centre: {at_earth[0]!r} is at the Earth, and the plant's states refer to "
                    f"{plant.frame}; give the trajectory of its centre relative to the Earth (OEM)"
                )
        begin, end = span_s[0] - _MARGIN_S, span_s[1] + _MARGIN_S
        self._earth = earth_trajectory(zero, begin, end)
        nodes = begin + _TURN_STEP_S * np.arange(int((end - begin) / _TURN_STEP_S) + 2.0)
        self._begin = begin
        fixed = earth_fixed(self.axes, zero, nodes, orientation)
        self._turn = self._spline(nodes, fixed)
        self._turn_rate = self._turn.derivative()
        self._of_date = self._frame = self._turn
        if not self.about_earth and isinstance(plant, _HeliocentricFrame):
            ecliptic = from_equator(np.eye(3)[:, :, None])[:, :, 0]
            axes = np.einsum("ij,jkn->ikn", ecliptic, plant.heliocentric(nodes)["axes"])
            self._frame = self._spline(nodes, axes)
        self._frame_rate = self._frame.derivative()
        if self.axes == "teme" or self.about_earth:
            other = earth_fixed("gcrs" if self.axes == "teme" else "teme", zero, nodes, orientation)
            teme, gcrs = (fixed, other) if self.axes == "teme" else (other, fixed)
            self._of_date = self._spline(nodes, np.einsum("jin,jkn->ikn", teme, gcrs))

    def names(self) -> Sequence[str]:
        """Return the names of all observers."""
        return [*self._stations, *self._observers]

    def is_station(self, name: str) -> bool:
        """Return whether an observer is a station, which has a horizon."""
        return name in self._stations

    def is_near(self, names: Iterable[str]) -> bool:
        """Return whether a signal of these observers keeps near the plant's centre."""
        return self.about_earth or all(self._observers.get(name) is not None for name in names)

    def craft(self, x: Array, t_s: Array, near: bool) -> Array:
        """Return the inertial states (6, N) of the plant's states (n, N), see `is_near`."""
        states = self.inertial(x, t_s)
        return states if near else states + self._origin(t_s)

    def inertial(self, x: Array, t_s: Array) -> Array:
        """Return the states (6, N) about the plant's centre, in `axes` or those of the ICRF."""
        if self.about_earth:
            return x[:6]
        if self._turning is not None:
            return frame_motion(self._turning, self.zero, t_s, {}).to_inertial(x[:6])
        turn, rate = self._at(self._frame, t_s), self._at(self._frame_rate, t_s)
        place = np.einsum("nij,jn->in", turn, x[:3])
        speed = np.einsum("nij,jn->in", turn, x[3:6]) + np.einsum("nij,jn->in", rate, x[:3])
        return np.concatenate([place, speed])

    def from_inertial(self, states: Array, t_s: Array) -> Array:
        """Return states (6, N) in the plant's frame; the inverse of `inertial`."""
        if self.about_earth:
            return states
        one = np.repeat(np.eye(6)[:, :, None], len(t_s), axis=2)
        linear = np.stack([self.inertial(one[:, k], t_s) for k in range(6)], axis=1)
        solved = np.linalg.solve(np.moveaxis(linear, 2, 0), states.T[:, :, None])
        return np.ascontiguousarray(solved[:, :, 0].T)

    def observer(self, name: str, t_s: Array, near: bool) -> Array:
        """Return the inertial states (6, N) of an observer at times (N,), see `is_near`."""
        if name in self._stations:
            place = self._stations[name].ecef_m
            states = np.concatenate(
                [
                    np.einsum("nij,i->jn", matrices, place)
                    for matrices in (self._at(self._turn, t_s), self._at(self._turn_rate, t_s))
                ]
            )
            return states if self.about_earth else states + self._earth.states(t_s)
        way = self._observers[name]
        if way is None:
            return np.zeros((6, len(t_s))) if self.about_earth else self._earth.states(t_s)
        states = way.states(t_s)
        if self.about_earth:
            return self._from_icrf(states, t_s) if self.axes == "teme" else states
        return states if near else states + self._origin(t_s)

    def horizon(self, name: str, line: Array, t_s: Array) -> Array:
        """Return lines (3, N) along east, north and up of a station."""
        turned = np.einsum("nij,jn->in", self._at(self._turn, t_s), line)
        return np.asarray(self._stations[name].axes @ turned)

    def celestial(
        self, frame: str, line: Array, t_s: Array, light_time_s: Array | None, near: bool = True
    ) -> Array:
        """Return lines (3, N) along the axes of a celestial frame.

        Parameters
        ----------
        frame : str
            ICRF, GCRF, EME2000 or one of `OF_DATE`.
        line : ndarray, shape (3, N)
            In inertial axes.
        t_s : ndarray, shape (N,)
            Times.
        light_time_s : ndarray, shape (N,), optional
            Of the lines. Given for signals near the plant's centre, the motion of that centre
            meanwhile is taken from the lines: so are directions that were measured against the
            places of stars in a catalogue, from which the yearly aberration has been taken.
        near : bool
            Whether they are such, see `is_near`; other lines hold that motion already.

        Raises
        ------
        InputError
            If there is no such frame, or the motion of the centre is not known.
        """
        if self.axes == "teme" and frame == "TEME" and light_time_s is None:
            return line
        line = self._to_icrf(line, t_s)
        if light_time_s is not None and near:
            line = line - self._centre_speed(t_s) * light_time_s
        bias = frame_bias(frame)
        if bias is not None:
            return np.asarray(bias.T @ line)
        if frame == "TEME":
            return np.asarray(np.einsum("nij,jn->in", self._teme_axes(t_s), line))
        if frame not in OF_DATE:
            raise InputError(
                f"reference_frame: expected ICRF, GCRF, EME2000, {' or '.join(OF_DATE)}, got "
                f"{frame}"
            )
        days = self.zero.to("TT").seconds_since(J2000.to("TT")) / DAY_S + t_s / DAY_S
        turn = np.moveaxis(erfa.pnm06a(J2000_JD, days), 0, -1)
        return np.asarray(np.einsum("ijn,jn->in", turn, line))

    def _centre_speed(self, t_s: Array) -> Array:
        """Return the barycentric velocity (3, N) of the plant's centre."""
        if self.about_earth:
            return self._earth.states(t_s)[3:]
        if self._centre is None:
            raise InputError(
                "centre: aberration = 'stars' needs the motion of the plant's centre; give its "
                "trajectory relative to the Earth (OEM)"
            )
        return self._origin(t_s)[3:]

    def _origin(self, t_s: Array) -> Array:
        """Return the inertial states (6, N) of the plant's centre."""
        if self._centre is None:
            return np.zeros((6, len(t_s)))
        return self._centre.states(t_s) + self._earth.states(t_s)

    def _spline(self, nodes: Array, matrices: Array) -> Any:
        """Return the interpolation of matrices (3, 3, K), as rows of nine."""
        return make_interp_spline(nodes - self._begin, matrices.reshape(9, -1).T, k=7)

    def _at(self, spline: Any, t_s: Array) -> Array:
        """Return interpolated matrices (N, 3, 3)."""
        return np.asarray(spline(t_s - self._begin)).reshape(-1, 3, 3)

    def _teme_axes(self, t_s: Array) -> Array:
        """Return the matrices (N, 3, 3) from the axes of the GCRS to TEME."""
        return self._at(self._of_date, t_s)

    def _to_icrf(self, line: Array, t_s: Array) -> Array:
        if self.axes == "gcrs":
            return line
        return np.asarray(np.einsum("nji,jn->in", self._teme_axes(t_s), line))

    def _from_icrf(self, states: Array, t_s: Array) -> Array:
        return self._turned(self._teme_axes(t_s), states)

    def _turned(self, turn: Array, states: Array) -> Array:
        """Return states (6, N) turned by matrices (N, 3, 3)."""
        return np.concatenate(
            [np.einsum("nij,jn->in", turn, part) for part in (states[:3], states[3:])]
        )
