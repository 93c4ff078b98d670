"""Tracker of one satellite by one antenna, which takes measurements one at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.trackers.least_squares import LeastSquaresState

__all__ = ["StreamingTracker"]

_RECENT = 20
"""Number of the last measurements of which the share of outliers is computed: 20 s at one per
second. More would report a side lobe late, fewer would report chance."""


class StreamingTracker:
    """A tracker of one satellite by one antenna; it applies a `Tracker` to a single case.

    Parameters
    ----------
    tracker : Tracker
        Tracking method.
    elements : ndarray, shape (6,)
        Nominal mean elements a, e, i, Ω, ω, M (m, rad), TEME.
    t_s : float
        Time of the elements after the epoch.
    station : Station
        Location of the antenna.
    epoch : Epoch
        Origin of the times.
    orientation : EarthOrientation
        UT1 and polar motion of the Earth.
    sigma_rad : float
        Standard deviation of both angles for measurements without one; the default is 0.1°.

    Attributes
    ----------
    state : object
        State of the tracker, one case.
    is_locked : bool
        Whether the receiver has the signal, so that measurements are of the satellite.
    """

    def __init__(
        self,
        tracker: Tracker[Any],
        elements: Array,
        t_s: float,
        station: Station,
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
        sigma_rad: float = 1.7e-3,
    ) -> None:
        if not sigma_rad > 0.0:
            raise InputError(f"sigma_rad must be > 0, got {sigma_rad}")
        self.tracker = tracker
        self.state = tracker.initial(
            np.asarray(elements, dtype=float).reshape(6, 1),
            np.array([t_s], dtype=float),
            (station,),
            epoch,
            orientation,
        )
        self.is_locked = True
        self._sigma = np.array([sigma_rad])
        self._recent: deque[bool] = deque(maxlen=_RECENT)

    @property
    def outlier_share(self) -> float:
        """Share of outliers among the last 20 measurements; 0 while there are fewer.

        A large share means that the standard deviations are too small, or that the antenna is on a
        side lobe. It is 0 for trackers that do not detect outliers.
        """
        return sum(self._recent) / _RECENT if len(self._recent) == _RECENT else 0.0

    def update(
        self,
        t_s: float,
        az_rad: float,
        el_rad: float,
        sigma_rad: float | Sequence[float] | None = None,
    ) -> bool:
        """Update the estimate with a measurement.

        Parameters
        ----------
        t_s, az_rad, el_rad : float
            Time, azimuth and elevation.
        sigma_rad : float or two floats, optional
            Standard deviation of both angles, or of azimuth and of elevation.

        Returns
        -------
        bool
            Whether the measurement was used. While the signal is lost the angles of the antenna are
            not measurements of the satellite, and are ignored.
        """
        if not self.is_locked:
            return False
        sigma = self._sigma
        if sigma_rad is not None:
            sigma = np.asarray(sigma_rad, dtype=float)
            sigma = sigma.reshape(2, 1) if sigma.ndim else sigma.reshape(1)
        before = self.state
        self.state = self.tracker.update(
            self.state, np.array([t_s]), np.array([az_rad]), np.array([el_rad]), sigma
        )
        if isinstance(self.state, LeastSquaresState):
            self._recent.append(bool(self.state.outliers[0] > before.outliers[0]))
        return True

    def mark_lost(self) -> None:
        """Record that the signal is lost: measurements are ignored from now on."""
        self.is_locked = False

    def mark_locked(self) -> None:
        """Record that the signal is received again: measurements are used from now on."""
        self.is_locked = True

    def nominal_orbit(self) -> Callable[[Array], tuple[Array, Array]]:
        """Return the present estimate as a function: true times (K,) → true angles (K,), rad.

        Called before the first measurement, it is the orbit of the elements.
        """
        tracker, state = self.tracker, self.state

        def angles(times_s: Array) -> tuple[Array, Array]:
            azimuth, elevation, _ = tracker.predict(state, times_s, biased=False)
            return azimuth[:, 0], elevation[:, 0]

        return angles

    def true_direction(self, t_s: float) -> tuple[float, float]:
        """Return the estimated direction of the satellite without the biases of the angles.

        Parameters
        ----------
        t_s : float
            Time of the station's clock; an estimated bias of the clock is taken into account.

        Returns
        -------
        azimuth_rad, elevation_rad : float
        """
        late = self.state.time_bias_s[0] if isinstance(self.state, LeastSquaresState) else 0.0
        azimuth, elevation = self.nominal_orbit()(np.array([t_s + late]))
        return float(azimuth[0]), float(elevation[0])

    def predict(self, times_s: Array) -> tuple[Array, Array, Array]:
        """Predict the angles that the antenna will measure.

        Parameters
        ----------
        times_s : ndarray, shape (K,)
            Times of the clock that dates the measurements.

        Returns
        -------
        azimuth_rad, elevation_rad : ndarray, shape (K,)
            Angles including the biases; azimuth in [0, 2π).
        covariance : ndarray, shape (2, 2, K)
            Covariance of cross-elevation (azimuth times cos h) and elevation, rad².
        """
        azimuth, elevation, covariance = self.tracker.predict(self.state, times_s)
        return azimuth[:, 0], elevation[:, 0], covariance[..., 0]
