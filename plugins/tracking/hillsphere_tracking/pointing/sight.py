"""The smooth course of a satellite in a station's sky, through samples of it.

Azimuth and elevation of a pass through the zenith turn by a half-turn between two samples. The
vector from station to satellite does not: it is a piece of an orbit, and a spline through samples
a hundredth of a revolution apart follows it to millimetres. Directions, and how fast a mount's axis
must turn, are taken from that spline.

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

_DEGREE = 5
_LEAST = 2 * (_DEGREE + 1)


class LineOfSight:
    """The vector from a station to a satellite during a pass, as a quintic spline [1]_.

    Parameters
    ----------
    t_s : ndarray, shape (K,)
        Times of the samples, rising, K ≥ 12.
    azimuth_rad, elevation_rad, range_m : ndarray, shape (K,)
        What the station sees then.

    Attributes
    ----------
    sampling_error_rad : float
        Largest angle between samples and a spline through every second one of them. The spline
        through all errs less, by 2⁶ where the samples are dense enough.

    Raises
    ------
    InputError
        If there are fewer samples, or they are not finite or not in order.
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
        self._place = make_interp_spline(t_s, place, k=_DEGREE, axis=1)
        self._speed = self._place.derivative()
        half = make_interp_spline(t_s[::2], place[:, ::2], k=_DEGREE, axis=1)(t_s)
        half /= np.linalg.norm(half, axis=0)
        self.sampling_error_rad = float(separation(half, direction).max())

    def direction(self, t_s: Array) -> Array:
        """Return unit vectors east, north, up, shape (3, N), at times, s, shape (N,)."""
        place = self._place(t_s)
        return np.asarray(place / np.linalg.norm(place, axis=0))

    def peak_primary_rate(self, mount: Mount, t_s: Array) -> float:
        """Return the fastest that a mount's primary axis would have to turn.

        Parameters
        ----------
        mount : Mount
            Its limits do not matter.
        t_s : ndarray, shape (N,)
            Times between which to look, at least three.

        Returns
        -------
        float
            Largest |(x ẏ − y ẋ)/(x² + y²)| with x and y across the primary axis, rad/s.
        """
        best = 0.0
        # a peak at the keyhole may be narrower than the step: look ever closer
        for _ in range(6):
            rate = self._primary_rate(mount, t_s)
            k = int(np.argmax(rate))
            best = max(best, float(rate[k]))
            t_s = np.linspace(t_s[max(k - 1, 0)], t_s[min(k + 1, t_s.size - 1)], 41)
        return best

    def _primary_rate(self, mount: Mount, t_s: Array) -> Array:
        across = mount.axes[:2]
        x, y = across @ self._place(t_s)
        dx, dy = across @ self._speed(t_s)
        return np.asarray(np.abs(x * dy - y * dx) / np.maximum(x**2 + y**2, 1e-300))
