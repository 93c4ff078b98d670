"""Refraction in live tracking: a tracker whose elevations are apparent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.topocentric import apparent_elevation, geometric_elevation

__all__ = ["Air", "ThroughAir"]


@dataclass(frozen=True)
class Air:
    """Air at a station, for the refraction.

    Parameters
    ----------
    pressure_hpa, temperature_c : float
        Pressure and temperature at the station.

    Raises
    ------
    InputError
        If the pressure or the temperature is out of range.
    """

    pressure_hpa: float = 1010.0
    temperature_c: float = 10.0

    def __post_init__(self) -> None:
        if not 0.0 < self.pressure_hpa < 2000.0:
            raise InputError(f"--pressure must be from 0 to 2000 hPa, got {self.pressure_hpa:g}")
        if not -100.0 <= self.temperature_c <= 70.0:
            raise InputError(
                f"--temperature must be from -100 to 70 °C, got {self.temperature_c:g}"
            )

    def apparent(self, elevation_rad: Array) -> Array:
        """Convert geometric to apparent elevations (rad)."""
        return apparent_elevation(elevation_rad, self.pressure_hpa, self.temperature_c)

    def geometric(self, apparent_rad: Array) -> Array:
        """Convert apparent to geometric elevations (rad)."""
        return geometric_elevation(apparent_rad, self.pressure_hpa, self.temperature_c)


class ThroughAir:
    """A tracker whose measured and predicted elevations are apparent.

    Refraction is removed from each measurement and added to each prediction. The covariance remains
    the one of geometric directions; near the horizon, where refraction compresses elevations, it is
    up to a fifth too large in elevation.

    Parameters
    ----------
    tracker : Tracker
        Tracker of geometric directions.
    air : Air
        Air at the station.
    """

    def __init__(self, tracker: Tracker[Any], air: Air) -> None:
        self._tracker, self._air = tracker, air
        self.short_period = tracker.short_period

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> Any:
        """Return the initial state of the tracker; see `hillsphere.interfaces.Tracker`."""
        return self._tracker.initial(elements, t_s, stations, epoch, orientation)

    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        """Update the estimate with one measurement per case, of apparent elevation."""
        geometric = self._air.geometric(el_rad)
        return self._tracker.update(state, t_s, az_rad, geometric, sigma_rad)

    def predict(
        self, state: Any, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, apparent elevation (K, N) and sky covariance (2, 2, K, N)."""
        azimuth, elevation, covariance = self._tracker.predict(state, times_s, biased)
        return azimuth, self._air.apparent(elevation), covariance
