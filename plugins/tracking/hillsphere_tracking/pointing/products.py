"""Product of the stage ``pointing``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["Pointing"]


@dataclass(frozen=True)
class Pointing:
    """Commands and errors of M mounts that follow P passes, with up to K commands per pass.

    Arrays over the commands of a pass contain NaN (or False) after its end. Naive commands have no
    plan: each axis moves to its angle on target as fast as it can, on the turn nearest to the
    middle of its stops, and rewinds at a stop.
    """

    mounts: Annotated[tuple[str, ...], Shape("mounts"), Label("mount")]
    """Names of the mounts."""
    kinds: Annotated[tuple[str, ...], Shape("mounts"), Label("kind")]
    """``"azimuth_elevation"`` or ``"x_y"``."""
    axes: Annotated[Array, Shape(3, 3, "mounts")]
    """Axes of each mount, see `mounts.Mount`."""
    primary_limits: Annotated[Array, Shape(4, "mounts")]
    """Lower and upper stop of the primary axis, rad, largest rate, rad/s, and acceleration,
    rad/s²."""
    secondary_limits: Annotated[Array, Shape(4, "mounts")]
    """The same limits of the secondary axis."""
    start: str
    """Origin of the passes' times, UTC."""
    stations: Annotated[tuple[str, ...], Shape("passes"), Label("station")]
    """Station of each pass."""
    satellites: Annotated[tuple[str, ...], Shape("passes"), Label("satellite")]
    """Satellite of each pass."""
    revolution: Annotated[Integers, Shape("passes"), Label("revolution")]
    """Revolution of each pass."""
    rise_s: Annotated[Array, Shape("passes")]
    """Rise of each pass."""
    elevation_max_rad: Annotated[Array, Shape("passes"), Label("highest elevation", 4, "deg")]
    """Highest elevation of each pass."""
    short: int
    """Number of passes that are left out because they are too short for a plan."""
    lock_angle_rad: float
    """Largest error at which the receiver keeps lock."""
    period_s: float
    """Interval between commands."""
    count: Annotated[Integers, Shape("passes"), Label("commands")]
    """Number of commands of each pass; the first is at the rise."""
    azimuth_rad: Annotated[Array, Shape("times", "passes")]
    """Azimuth of the satellite at each command."""
    elevation_rad: Annotated[Array, Shape("times", "passes")]
    """Elevation of the satellite at each command."""
    primary_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Commanded angle of the primary axis, with a plan."""
    secondary_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Commanded angle of the secondary axis, with a plan."""
    error_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Angle between beam and satellite, with a plan."""
    naive_primary_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Commanded angle of the primary axis, without a plan."""
    naive_secondary_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Commanded angle of the secondary axis, without a plan."""
    naive_error_rad: Annotated[Array, Shape("times", "passes", "mounts")]
    """Angle between beam and satellite, without a plan."""
    unramped_error_max_rad: Annotated[
        Array, Shape("passes", "mounts"), Label("largest error, only the turn planned", 3, "deg")
    ]
    """Largest error if only the turn is planned: the primary begins on the turn of the plan and
    then follows the target without ramps."""
    unramped_outside_s: Annotated[
        Array, Shape("passes", "mounts"), Label("beyond it, only the turn planned", 5)
    ]
    """Time beyond the lock angle if only the turn is planned."""
    ramp: Annotated[NDArray[np.bool_], Shape("times", "passes", "mounts")]
    """Where the primary axis leaves the target by plan (keyholes, rewinds)."""
    flipped: Annotated[NDArray[np.bool_], Shape("times", "passes", "mounts")]
    """Where the mount is flipped (the beam goes over the top)."""
    primary_rate_on_target_rad_s: Annotated[
        Array, Shape("passes", "mounts"), Label("primary's rate if on target", 4, "deg_s")
    ]
    """Largest rate of a primary axis that stays on target without a flip."""
    sampling_error_rad: Annotated[
        Array, Shape("passes"), Label("course of the satellite, from half its samples", 2, "deg")
    ]
    """Error of a spline through every second sample of the pass at the other samples; the spline
    through all samples, which is used, is more accurate."""
    interpolation_error_rad: Annotated[
        Array, Shape("passes"), Label("error between predictions", 2, "deg")
    ]
    """Largest error of interpolation between predictions."""
    interpolation_bound_rad: Annotated[Array, Shape("passes"), Label("its bound", 2, "deg")]
    """Bound of that error."""

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
