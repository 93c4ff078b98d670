"""Line of sight from a station to a satellite during a pass, as a spline through samples.

In a pass through the zenith the azimuth changes by half a turn between two samples. The vector from
the station to the satellite is smooth instead: a spline through samples a hundredth of a revolution
apart has errors of millimetres. Directions and rates of the axes are computed from this spline.

References
----------
.. [1] C. de Boor (1978), A Practical Guide to Splines, Springer (interpolating splines).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.mounts import Mount
from hillsphere_tracking.pointing.sky import separation
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["LineOfSight"]

_SPLINE_DEGREE = 5
"""Degree of the spline: its error falls with the sixth power of the distance of the samples. Degree
3 needs more samples for the same error, a higher one oscillates more at the ends."""
_LEAST = 2 * (_SPLINE_DEGREE + 1)
"""Samples at least: the spline through every second one needs one more than its degree."""


class LineOfSight:
    """Vector from a station to a satellite during a pass, as a quintic spline [1]_.

    Parameters
    ----------
    t_s : ndarray, shape (K,)
        Times of the samples in increasing order, K ≥ 12.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (K,)
        Topocentric coordinates of the samples.

    Attributes
    ----------
    sampling_error_rad : float
        Largest angle between the samples and a spline through every second one of them. The error
        of the spline through all samples is smaller, by 2⁶ for dense samples.

    Raises
    ------
    InputError
        If there are fewer than 12 samples, or they are not finite or not in order.
    """

    def __init__(
        self, t_s: Array, azimuth_rad: Array, elevation_rad: Array, range_m: Array
    ) -> None:
        direction = direction_cosines(azimuth_rad, elevation_rad)
        place = range_m * direction
        if t_s.size < _LEAST or not (np.isfinite(place).all() and np.all(np.diff(t_s) > 0.0)):
            raise InputError(
                f"the course of a pass needs at least {_LEAST} finite samples in order of time, got"
                f" {t_s.size}"
            )
        self._place = make_interp_spline(t_s, place, k=_SPLINE_DEGREE, axis=1)
        self._speed = self._place.derivative()
        half = make_interp_spline(t_s[::2], place[:, ::2], k=_SPLINE_DEGREE, axis=1)(t_s)
        half /= np.linalg.norm(half, axis=0)
        self.sampling_error_rad = float(separation(half, direction).max())

    def direction(self, t_s: Array) -> Array:
        """Return the unit vectors east, north, up (3, N) at times (N,), s."""
        place = self._place(t_s)
        return np.asarray(place / np.linalg.norm(place, axis=0))

    def peak_primary_rate(self, mount: Mount, t_s: Array) -> float:
        """Return the largest rate of a primary axis that stays on target.

        Parameters
        ----------
        mount : Mount
            The mount; its limits are not used.
        t_s : ndarray, shape (N,)
            Grid of times, at least three, around whose largest rate is refined.

        Returns
        -------
        float
            Largest |(x ẏ − y ẋ)/(x² + y²)| with x and y across the primary axis, rad/s.
        """
        best = 0.0
        # A peak at the keyhole may be narrower than the step: refine the grid six times by 20.
        for _ in range(6):
            rate = self._primary_rate(mount, t_s)
            k = int(np.argmax(rate))
            best = max(best, float(rate[k]))
            t_s = np.linspace(t_s[max(k - 1, 0)], t_s[min(k + 1, t_s.size - 1)], 41)
        return best

    def _primary_rate(self, mount: Mount, t_s: Array) -> Array:
        across = mount.axes[:2]
        # derivative of atan2(y, x); both vanish exactly at the keyhole
        x, y = across @ self._place(t_s)
        dx, dy = across @ self._speed(t_s)
        return np.asarray(np.abs(x * dy - y * dx) / np.maximum(x**2 + y**2, 1e-300))
