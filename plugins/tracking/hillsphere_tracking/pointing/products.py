"""Product of the stage ``pointing``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Pointing"]


@dataclass(frozen=True)
class Pointing:
    """Commands and errors of M mounts that follow P passes, with up to K commands per pass.

    Arrays over the commands of a pass contain NaN (or False) after its end. Naive commands have no
    plan: each axis moves to its angle on target as fast as it can, on the turn nearest to the
    middle of its stops, and rewinds at a stop.

    Parameters
    ----------
    mounts, kinds : tuple of str, length M
        Names, and ``"azimuth_elevation"`` or ``"x_y"``.
    axes : ndarray, shape (3, 3, M)
        Axes of each mount, see `mounts.Mount`.
    primary_limits, secondary_limits : ndarray, shape (4, M)
        Lower and upper stop, rad, largest rate, rad/s, and acceleration, rad/s².
    start : str
        Origin of the passes' times, UTC.
    stations, satellites : tuple of str, length P
        Station and satellite of each pass.
    revolution : ndarray of int, shape (P,)
        Revolution of each pass.
    rise_s, elevation_max_rad : ndarray, shape (P,)
        Rise and highest elevation of each pass.
    short : int
        Number of passes that are left out because they are too short for a plan.
    lock_angle_rad, period_s : float
        Largest error at which the receiver keeps lock, and interval between commands.
    count : ndarray of int, shape (P,)
        Number of commands; the first is at the rise.
    azimuth_rad, elevation_rad : ndarray, shape (K, P)
        Direction of the satellite at each command.
    primary_rad, secondary_rad, error_rad : ndarray, shape (K, P, M)
        Commanded axis angles with a plan, and angle between beam and satellite.
    naive_primary_rad, naive_secondary_rad, naive_error_rad : ndarray, shape (K, P, M)
        The same quantities without a plan.
    unramped_error_max_rad, unramped_outside_s : ndarray, shape (P, M)
        Largest error, and time beyond the lock angle, if only the turn is planned: the primary
        begins on the turn of the plan and then follows the target without ramps.
    ramp, flipped : ndarray of bool, shape (K, P, M)
        Where the primary axis leaves the target by plan (keyholes, rewinds), and where the mount is
        flipped.
    primary_rate_on_target_rad_s : ndarray, shape (P, M)
        Largest rate of a primary axis that stays on target without a flip.
    sampling_error_rad : ndarray, shape (P,)
        Error of a spline through every second sample of the pass at the other samples; the spline
        through all samples, which is used, is more accurate.
    interpolation_error_rad, interpolation_bound_rad : ndarray, shape (P,)
        Largest error of interpolation between predictions, and its bound.
    """

    mounts: tuple[str, ...]
    kinds: tuple[str, ...]
    axes: Array
    primary_limits: Array
    secondary_limits: Array
    start: str
    stations: tuple[str, ...]
    satellites: tuple[str, ...]
    revolution: Integers
    rise_s: Array
    elevation_max_rad: Array
    short: int
    lock_angle_rad: float
    period_s: float
    count: Integers
    azimuth_rad: Array
    elevation_rad: Array
    primary_rad: Array
    secondary_rad: Array
    error_rad: Array
    naive_primary_rad: Array
    naive_secondary_rad: Array
    naive_error_rad: Array
    unramped_error_max_rad: Array
    unramped_outside_s: Array
    ramp: NDArray[np.bool_]
    flipped: NDArray[np.bool_]
    primary_rate_on_target_rad_s: Array
    sampling_error_rad: Array
    interpolation_error_rad: Array
    interpolation_bound_rad: Array

    def keyhole_distance(self, mount: int) -> Array:
        """Return the distance of the satellite from the nearest keyhole, rad, shape (K, P).

        Parameters
        ----------
        mount : int
            Number of the mount.
        """
        direction = direction_cosines(self.azimuth_rad, self.elevation_rad)
        x, y, z = np.tensordot(self.axes[:, :, mount], direction, axes=1)
        return np.asarray(np.arctan2(np.hypot(x, y), np.abs(z)))

    def telling_pass(self, mount: int) -> int:
        """Return the index of the most demanding pass of a mount.

        Parameters
        ----------
        mount : int
            Number of the mount.

        Returns
        -------
        int
            The pass with the largest error. If all planned errors are within a tenth of the lock
            angle, the pass with the largest naive error.
        """
        planned = np.nanmax(self.error_rad[:, :, mount], axis=0)
        if planned.max() <= 0.1 * self.lock_angle_rad:
            planned = np.nanmax(self.naive_error_rad[:, :, mount], axis=0)
        return int(np.argmax(planned))
