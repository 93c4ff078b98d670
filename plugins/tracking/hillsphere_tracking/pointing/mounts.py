"""Two-axis antenna mounts: from directions to the angles of their axes, and back.

Every mount here has a primary axis fixed to the ground and a secondary one that it carries, at a
right angle. An azimuth-elevation mount's primary axis is upright; an X/Y mount's lies level; a
tilted one leans. They differ only in where the primary axis points, and with it their keyhole: the
direction along the primary axis, near which the primary has to turn fast.
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
    """Where an axis can go and how it can move.

    Parameters
    ----------
    lower_rad, upper_rad : float
        Stops. More than a turn apart they overlap: the same direction has two angles.
    rate_rad_s, acceleration_rad_s2 : float
        Largest magnitudes.

    Raises
    ------
    InputError
        If the stops are not in order, a limit is not positive, or anything is not finite.
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
        Rows, along east, north, up: where the beam points with both axes at 0; where with the
        primary at 90°; along the primary axis (secondary at 90°).
    primary, secondary : AxisLimits
        Of the axes. A secondary that goes beyond 90° can also reach directions over the top
        (flipped, "plunge").

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
        """Whether the secondary axis goes noticeably beyond 90°."""
        return self.secondary.upper_rad > 0.5 * pi + 1e-6

    def on_target(self, direction: Array) -> tuple[Array, Array]:
        """Return the plain axis angles of directions, stops left out.

        Adding a half-turn to the primary and taking the secondary from π gives the flipped ones.

        Parameters
        ----------
        direction : ndarray, shape (3, ...)
            Unit vectors east, north, up.

        Returns
        -------
        primary_rad, secondary_rad : ndarray, shape (...)
            In [−π, π] and [−π/2, π/2].
        """
        x, y, z = np.tensordot(self.axes, direction, axes=1)
        return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))

    def secondary_for(self, direction: Array, primary_rad: Array) -> Array:
        """Return the secondary angle, within its stops, that brings the beam closest.

        Parameters
        ----------
        direction : ndarray, shape (3, ...)
            Unit vectors east, north, up.
        primary_rad : ndarray, shape (...)
            Where the primary axis stands.

        Returns
        -------
        ndarray, shape (...)
            Secondary angle, rad.
        """
        x, y, z = np.tensordot(self.axes, direction, axes=1)
        free = np.arctan2(z, x * np.cos(primary_rad) + y * np.sin(primary_rad))
        low, high = self.secondary.lower_rad, self.secondary.upper_rad
        # within the stops if at all possible, else at the stop that is nearer around the circle
        middle = 0.5 * (low + high)
        around = middle + np.remainder(free - middle + pi, 2.0 * pi) - pi
        return np.asarray(np.clip(around, low, high))

    def direction(self, primary_rad: Array, secondary_rad: Array) -> Array:
        """Return the unit vectors east, north, up in which the beam points, shape (3, ...).

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
        """Return by how much the beam misses directions, rad, shape (...).

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
    """Return an azimuth-elevation mount; azimuth counts from north eastwards.

    Parameters
    ----------
    primary, secondary : AxisLimits
        Of azimuth and elevation.
    tilt_rad, tilt_towards_rad : float
        By how much the azimuth axis leans, and the azimuth towards which it does: a mount may be
        tilted so that a pass through the zenith misses its keyhole.

    Returns
    -------
    Mount
        With its keyhole at the zenith, or at the tilted axis.
    """
    c, s = cos(tilt_rad), sin(tilt_rad)
    ce, se = cos(tilt_towards_rad), sin(tilt_towards_rad)
    towards, aside = np.array([se, ce, 0.0]), np.array([ce, -se, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    # the level axis at a right angle to the lean stays; azimuth still counts as if from north
    leaning, pole = c * towards - s * up, c * up + s * towards
    return Mount(np.array([ce * leaning - se * aside, se * leaning + ce * aside, pole]),
                 primary, secondary)  # fmt: skip


def x_y(primary: AxisLimits, secondary: AxisLimits, axis_azimuth_rad: float = 0.0) -> Mount:
    """Return an X/Y mount: the X axis lies level, and carries the Y axis.

    Both angles are 0 at the zenith. X leans the beam to the right of the X axis's direction
    (towards the east for an axis that points north), Y towards it.

    Parameters
    ----------
    primary, secondary : AxisLimits
        Of X and Y.
    axis_azimuth_rad : float
        Azimuth of the X axis.

    Returns
    -------
    Mount
        With keyholes on the horizon, at both ends of the X axis.
    """
    c, s = cos(axis_azimuth_rad), sin(axis_azimuth_rad)
    return Mount(np.array([[0.0, 0.0, 1.0], [c, -s, 0.0], [s, c, 0.0]]), primary, secondary)


def mount_of(spec: MountSpec) -> Mount:
    """Return the mount that a mission describes."""
    primary, secondary = _limits_of(spec.primary), _limits_of(spec.secondary)
    if spec.kind == "x_y":
        return x_y(primary, secondary, spec.axis_azimuth_rad)
    return azimuth_elevation(primary, secondary, spec.tilt_rad, spec.tilt_towards_rad)


def _limits_of(spec: AxisSpec) -> AxisLimits:
    return AxisLimits(spec.lower_rad, spec.upper_rad, spec.rate_rad_s, spec.acceleration_rad_s2)
