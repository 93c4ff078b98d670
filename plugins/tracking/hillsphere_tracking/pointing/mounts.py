"""Two-axis antenna mounts: conversion between directions and axis angles.

Every mount has a primary axis fixed to the ground, which carries the secondary axis at a right
angle. The primary axis is vertical for an azimuth-elevation mount, horizontal for an X/Y mount, and
inclined for a tilted mount. The direction along the primary axis is the keyhole of the mount: the
primary axis must turn fast near it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isfinite, pi, sin

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.sky import separation
from hillsphere_tracking.pointing.specs import AxisSpec, MountSpec

__all__ = ["AxisLimits", "Mount", "azimuth_elevation", "mount_of", "x_y"]


@dataclass(frozen=True)
class AxisLimits:
    """Stops, largest rate and largest acceleration of an axis.

    Parameters
    ----------
    lower_rad, upper_rad : float
        Stops. If they are more than a turn apart, some directions have two angles.
    rate_rad_s, acceleration_rad_s2 : float
        Largest rate and acceleration in either direction.

    Raises
    ------
    InputError
        If the stops are not in order, a limit is not positive, or a value is not finite.
    """

    lower_rad: float
    upper_rad: float
    rate_rad_s: float
    acceleration_rad_s2: float

    def __post_init__(self) -> None:
        numbers = (self.lower_rad, self.upper_rad, self.rate_rad_s, self.acceleration_rad_s2)
        if not all(isfinite(number) for number in numbers):
            raise InputError(f"axis limits must be finite, got {numbers}")
        if not self.lower_rad < self.upper_rad:
            raise InputError(
                f"an axis's lower stop must be below its upper one, got"
                f" {np.degrees(self.lower_rad):g}° and {np.degrees(self.upper_rad):g}°"
            )
        if not min(self.rate_rad_s, self.acceleration_rad_s2) > 0.0:
            raise InputError(
                f"an axis's largest rate and acceleration must be > 0, got {self.rate_rad_s:g}"
                f" rad/s and {self.acceleration_rad_s2:g} rad/s²"
            )


@dataclass(frozen=True, eq=False)
class Mount:
    """A two-axis mount; make one with `azimuth_elevation` or `x_y`.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        Rows with components east, north, up: beam with both axes at 0; beam with the primary at
        90°; direction of the primary axis (secondary at 90°).
    primary, secondary : AxisLimits
        Limits of the axes. A secondary axis that reaches beyond 90° permits flipped operation
        ("plunge"): the beam goes over the top.

    Raises
    ------
    InputError
        If the rows are not unit vectors at right angles.
    """

    axes: Array
    primary: AxisLimits
    secondary: AxisLimits

    def __post_init__(self) -> None:
        if np.shape(self.axes) != (3, 3) or not np.allclose(
            self.axes @ np.transpose(self.axes), np.eye(3), rtol=0.0, atol=1e-9
        ):
            raise InputError("a mount's axes must be three unit vectors at right angles")

    @property
    def plunges(self) -> bool:
        """Whether the secondary axis reaches beyond 90° by more than rounding."""
        return self.secondary.upper_rad > 0.5 * pi + 1e-6

    def on_target(self, direction: Array) -> tuple[Array, Array]:
        """Return the axis angles of directions, without regard to the stops.

        The flipped solution has the primary angle plus π, and π minus the secondary angle.

        Parameters
        ----------
        direction : ndarray, shape (3, ...)
            Unit vectors east, north, up.

        Returns
        -------
        primary_rad, secondary_rad : ndarray, shape (...)
            Axis angles in [−π, π] and [−π/2, π/2].
        """
        x, y, z = np.tensordot(self.axes, direction, axes=1)
        return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))

    def secondary_for(self, direction: Array, primary_rad: Array) -> Array:
        """Return the secondary angle within its stops that brings the beam closest to a direction.

        Parameters
        ----------
        direction : ndarray, shape (3, ...)
            Unit vectors east, north, up.
        primary_rad : ndarray, shape (...)
            Angle of the primary axis.

        Returns
        -------
        ndarray, shape (...)
            Secondary angle, rad.
        """
        x, y, z = np.tensordot(self.axes, direction, axes=1)
        free = np.arctan2(z, x * np.cos(primary_rad) + y * np.sin(primary_rad))
        low, high = self.secondary.lower_rad, self.secondary.upper_rad
        # Wrap about the middle of the stops: beyond them the nearer stop on the circle is taken.
        middle = 0.5 * (low + high)
        around = middle + np.remainder(free - middle + pi, 2.0 * pi) - pi
        return np.asarray(np.clip(around, low, high))

    def direction(self, primary_rad: Array, secondary_rad: Array) -> Array:
        """Return the unit vectors east, north, up of the beam, shape (3, ...).

        Parameters
        ----------
        primary_rad, secondary_rad : ndarray, shape (...)
            Axis angles.
        """
        level = np.cos(secondary_rad)
        along = np.array(
            [np.cos(primary_rad) * level, np.sin(primary_rad) * level, np.sin(secondary_rad)]
        )
        return np.asarray(np.tensordot(np.transpose(self.axes), along, axes=1))

    def error(self, direction: Array, primary_rad: Array, secondary_rad: Array) -> Array:
        """Return the angle between the beam and given directions, rad, shape (...).

        Parameters
        ----------
        direction : ndarray, shape (3, ...)
            Unit vectors east, north, up.
        primary_rad, secondary_rad : ndarray, shape (...)
            Axis angles.
        """
        return separation(self.direction(primary_rad, secondary_rad), direction)


def azimuth_elevation(
    primary: AxisLimits,
    secondary: AxisLimits,
    tilt_rad: float = 0.0,
    tilt_towards_rad: float = 0.0,
) -> Mount:
    """Return an azimuth-elevation mount; azimuth is measured from north eastwards.

    Parameters
    ----------
    primary, secondary : AxisLimits
        Limits of azimuth and elevation.
    tilt_rad, tilt_towards_rad : float
        Tilt of the azimuth axis, and azimuth of the tilt. A tilted mount has its keyhole away from
        the zenith.

    Returns
    -------
    Mount
        Mount with its keyhole at the zenith, or along the tilted axis.
    """
    c, s = cos(tilt_rad), sin(tilt_rad)
    ce, se = cos(tilt_towards_rad), sin(tilt_towards_rad)
    towards, aside = np.array([se, ce, 0.0]), np.array([ce, -se, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    # The tilt is a rotation about the horizontal axis `aside`; azimuth 0 remains nearest to north.
    leaning, pole = c * towards - s * up, c * up + s * towards
    return Mount(np.array([ce * leaning - se * aside, se * leaning + ce * aside, pole]),
                 primary, secondary)  # fmt: skip


def x_y(primary: AxisLimits, secondary: AxisLimits, axis_azimuth_rad: float = 0.0) -> Mount:
    """Return an X/Y mount: the X axis is horizontal and carries the Y axis.

    Both angles are 0 at the zenith. A positive X moves the beam to the right of the X axis's
    direction (eastwards if the axis points north), a positive Y towards that direction.

    Parameters
    ----------
    primary, secondary : AxisLimits
        Limits of X and Y.
    axis_azimuth_rad : float
        Azimuth of the X axis.

    Returns
    -------
    Mount
        Mount with keyholes on the horizon, at both ends of the X axis.
    """
    c, s = cos(axis_azimuth_rad), sin(axis_azimuth_rad)
    return Mount(np.array([[0.0, 0.0, 1.0], [c, -s, 0.0], [s, c, 0.0]]), primary, secondary)


def mount_of(spec: MountSpec) -> Mount:
    """Return the mount that a Spec describes."""
    primary, secondary = _limits_of(spec.primary), _limits_of(spec.secondary)
    if spec.kind == "x_y":
        return x_y(primary, secondary, spec.axis_azimuth_rad)
    return azimuth_elevation(primary, secondary, spec.tilt_rad, spec.tilt_towards_rad)


def _limits_of(spec: AxisSpec) -> AxisLimits:
    return AxisLimits(spec.lower_rad, spec.upper_rad, spec.rate_rad_s, spec.acceleration_rad_s2)
