"""Visible sky of a station: horizon mask and blind sectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask

__all__ = ["Place"]


@dataclass(frozen=True)
class Place:
    """A station with its visible sky.

    Parameters
    ----------
    station : Station
        Location of the station.
    mask : HorizonMask
        Horizon mask.
    blind : tuple of BlindSector
        Blind sectors.
    """

    station: Station
    mask: HorizonMask
    blind: tuple[BlindSector, ...] = ()

    def above(self, azimuth_rad: Array, elevation_rad: Array) -> Array:
        """Return the elevations of directions (N,) above the mask, rad."""
        return np.asarray(elevation_rad - self.mask.at(azimuth_rad))

    def hidden_by(self, azimuth_rad: float, elevation_rad: float) -> str:
        """Return the obstacle in a direction: a blind sector's reason, ``"horizon"`` or ``""``."""
        azimuth, elevation = np.array([azimuth_rad]), np.array([elevation_rad])
        for sector in self.blind:
            if sector.contains(azimuth, elevation)[0]:
                return sector.reason
        return "" if self.above(azimuth, elevation)[0] >= 0.0 else "horizon"
