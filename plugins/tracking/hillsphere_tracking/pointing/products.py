"""What the stage ``pointing`` yields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Pointing"]


@dataclass(frozen=True)
class Pointing:
    """How M mounts follow P passes, one command a period; K of them in the longest pass.

    Arrays over the commands of a pass hold NaN (or False) after its end. What is called naive is
    commanded without a plan: each axis goes to its angle on target as fast as it can, on the turn
    nearest to the middle of its stops, and rewinds when it meets one.

    Parameters
    ----------
    mounts, kinds : tuple of str, length M
        Names, and ``"azimuth_elevation"`` or ``"x_y"``.
    axes : ndarray, shape (3, 3, M)
        Directions of each mount's axes, as `mounts.Mount` has them.
    primary_limits, secondary_limits : ndarray, shape (4, M)
        Lower and upper stop, rad, largest rate, rad/s, and acceleration, rad/s².
    start : str
        Date and time, UTC, from which the passes' times count.
    stations, satellites : tuple of str, length P
        Of each pass.
    revolution : ndarray of int, shape (P,)
        Of each pass.
    rise_s, elevation_max_rad : ndarray, shape (P,)
        When each pass begins, and how high it goes.
    short : int
        Number of passes left out as too short to be planned.
    lock_angle_rad, period_s : float
        Error up to which lock is kept, and time between commands.
    count : ndarray of int, shape (P,)
        Number of commands; the first at the rise.
    azimuth_rad, elevation_rad : ndarray, shape (K, P)
        Where the satellite is at each command.
    primary_rad, secondary_rad, error_rad : ndarray, shape (K, P, M)
        Axis angles commanded with a plan, and by how much the beam misses the satellite.
    naive_primary_rad, naive_secondary_rad, naive_error_rad : ndarray, shape (K, P, M)
        The same without.
    unramped_error_max_rad, unramped_outside_s : ndarray, shape (P, M)
        Largest error, and time beyond the lock angle, if only the turn is planned: the primary
        begins on the turn of the plan, and follows as a naive one.
    ramp, flipped : ndarray of bool, shape (K, P, M)
        Where the plan leaves the target with the primary axis (keyholes, rewinds), and where it
        goes over the top.
    primary_rate_on_target_rad_s : ndarray, shape (P, M)
        The fastest that the primary axis would have to turn to stay on target, not flipped.
    sampling_error_rad : ndarray, shape (P,)
        How far the course of the satellite through half of the pass's samples is from the others;
        the one through all of them, which is used, is closer.
    interpolation_error_rad, interpolation_bound_rad : ndarray, shape (P,)
        Largest error between predictions, and its bound.
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
        """Return how far the satellite is from a mount's nearest keyhole, rad, shape (K, P).

        Parameters
        ----------
        mount : int
            Number of the mount.
        """
        direction = direction_cosines(self.azimuth_rad, self.elevation_rad)
        x, y, z = np.tensordot(self.axes[:, :, mount], direction, axes=1)
        return np.asarray(np.arctan2(np.hypot(x, y), np.abs(z)))

    def telling_pass(self, mount: int) -> int:
        """Return the number of the pass that shows best what a mount can do.

        Parameters
        ----------
        mount : int
            Number of the mount.

        Returns
        -------
        int
            The pass with the largest error; if planning keeps the error of all within a tenth of
            the lock angle, that with the largest naive error.
        """
        planned = np.nanmax(self.error_rad[:, :, mount], axis=0)
        if planned.max() <= 0.1 * self.lock_angle_rad:
            planned = np.nanmax(self.naive_error_rad[:, :, mount], axis=0)
        return int(np.argmax(planned))
