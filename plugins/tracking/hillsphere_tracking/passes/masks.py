"""What a station's surroundings and mount hide: horizon masks and blind sectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = ["BlindSector", "HorizonMask"]

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class HorizonMask:
    """Elevation above which a station sees, in every direction.

    Parameters
    ----------
    elevation_rad : tuple of float
        Elevations at the azimuths, straight lines between them; one alone holds all around.
    azimuth_rad : tuple of float
        Azimuths in [0, 2π), rising, as many; a wall is two azimuths close to each other.

    Raises
    ------
    InputError
        If there are not as many azimuths, they do not rise, or something is out of range.
    """

    elevation_rad: tuple[float, ...] = (0.0,)
    azimuth_rad: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        azimuth, elevation = np.array(self.azimuth_rad), np.array(self.elevation_rad)
        if azimuth.size != elevation.size or azimuth.size == 0:
            raise InputError(
                f"a horizon mask needs as many azimuths as elevations, got {azimuth.size} and "
                f"{elevation.size}"
            )
        if not (np.diff(azimuth) > 0.0).all() or not ((azimuth >= 0.0) & (azimuth < _TURN)).all():
            raise InputError("the azimuths of a horizon mask must rise from 0° to below 360°")
        if not (np.abs(elevation) < 0.5 * np.pi).all():
            raise InputError("the elevations of a horizon mask must lie between −90° and 90°")

    @property
    def constant(self) -> bool:
        """Whether it is the same all around."""
        return len(set(self.elevation_rad)) == 1

    @property
    def lowest_rad(self) -> float:
        """Its least elevation."""
        return min(self.elevation_rad)

    def at(self, azimuth_rad: Array) -> Array:
        """Return the elevations (N,) of the mask at azimuths (N,)."""
        return self.on(self.segment(azimuth_rad), azimuth_rad)[0]

    def segment(self, azimuth_rad: Array) -> NDArray[np.int64]:
        """Return the numbers (N,) of the straight lines on which azimuths (N,) lie."""
        nodes = np.array(self.azimuth_rad)
        turned = np.remainder(np.asarray(azimuth_rad) - nodes[0], _TURN) + nodes[0]
        return np.asarray(np.searchsorted(nodes, turned, side="right") - 1)

    def on(self, segment: NDArray[np.int64], azimuth_rad: Array) -> tuple[Array, Array]:
        """Return elevations and slopes (N,) of straight lines (N,), prolonged if need be."""
        nodes, heights = np.array(self.azimuth_rad), np.array(self.elevation_rad)
        width = np.diff(nodes, append=nodes[0] + _TURN)
        slope = (np.roll(heights, -1) - heights) / width
        middle = nodes + 0.5 * width
        # about the line's middle, so that no azimuth near it is taken for one a turn away
        off = np.remainder(azimuth_rad - middle[segment] + np.pi, _TURN) - np.pi
        height = heights[segment] + slope[segment] * (off + 0.5 * width[segment])
        return height, slope[segment]


@dataclass(frozen=True)
class BlindSector:
    """A part of the sky in which the antenna cannot work.

    Parameters
    ----------
    azimuth_rad : tuple of float
        From the first eastwards to the second; ``(0.0, 2π)`` is all around.
    elevation_rad : tuple of float
        From the lower to the higher.
    reason : str
        For tables.

    Raises
    ------
    InputError
        If the higher elevation is not above the lower.
    """

    azimuth_rad: tuple[float, float]
    elevation_rad: tuple[float, float] = (-0.5 * np.pi, 0.5 * np.pi)
    reason: str = "blind sector"

    def __post_init__(self) -> None:
        if not self.elevation_rad[0] < self.elevation_rad[1]:
            raise InputError(
                f"{self.reason}: its higher elevation must be above the lower, got "
                f"{np.degrees(self.elevation_rad[0]):g}° and {np.degrees(self.elevation_rad[1]):g}°"
            )

    def contains(self, azimuth_rad: Array, elevation_rad: Array) -> NDArray[np.bool_]:
        """Say for directions (N,) whether they lie in the sector."""
        begin, end = self.azimuth_rad
        # a whole turn is no empty sector
        width = np.remainder(end - begin, _TURN) or (_TURN if end != begin else 0.0)
        inside = np.remainder(azimuth_rad - begin, _TURN) <= width
        low, high = self.elevation_rad
        return np.asarray(inside & (elevation_rad >= low) & (elevation_rad <= high))
