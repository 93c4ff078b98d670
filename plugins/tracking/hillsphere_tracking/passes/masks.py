"""Horizon masks and blind sectors of a station."""

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
    """Horizon mask: least visible elevation as a function of azimuth.

    Parameters
    ----------
    elevation_rad : tuple of float
        Elevations at the azimuths, with linear interpolation between them; a single one holds for
        all azimuths.
    azimuth_rad : tuple of float
        Azimuths in [0, 2π), in increasing order, one per elevation; a vertical edge is given by two
        azimuths close to each other.

    Raises
    ------
    InputError
        If the numbers of azimuths and elevations differ, azimuths do not increase, or a value is
        out of range.
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
        """Whether the elevation is the same at all azimuths."""
        return len(set(self.elevation_rad)) == 1

    @property
    def lowest_rad(self) -> float:
        """Lowest elevation of the mask."""
        return min(self.elevation_rad)

    def at(self, azimuth_rad: Array) -> Array:
        """Return the elevations (N,) of the mask at azimuths (N,)."""
        return self.on(self.segment(azimuth_rad), azimuth_rad)[0]

    def segment(self, azimuth_rad: Array) -> NDArray[np.int64]:
        """Return the indices (N,) of the linear segments that contain azimuths (N,)."""
        nodes = np.array(self.azimuth_rad)
        turned = np.remainder(np.asarray(azimuth_rad) - nodes[0], _TURN) + nodes[0]
        return np.asarray(np.searchsorted(nodes, turned, side="right") - 1)

    def on(self, segment: NDArray[np.int64], azimuth_rad: Array) -> tuple[Array, Array]:
        """Return elevations and slopes (N,) of segments (N,), extrapolated beyond their ends."""
        nodes, heights = np.array(self.azimuth_rad), np.array(self.elevation_rad)
        width = np.diff(nodes, append=nodes[0] + _TURN)
        slope = (np.roll(heights, -1) - heights) / width
        middle = nodes + 0.5 * width
        # wrap about the middle of the segment, so that azimuths near it are not a turn away
        off = np.remainder(azimuth_rad - middle[segment] + np.pi, _TURN) - np.pi
        height = heights[segment] + slope[segment] * (off + 0.5 * width[segment])
        return height, slope[segment]


@dataclass(frozen=True)
class BlindSector:
    """A sector of the sky in which the antenna cannot be used.

    Parameters
    ----------
    azimuth_rad : tuple of float
        Azimuths from the first eastwards to the second; ``(0.0, 2π)`` is a full circle.
    elevation_rad : tuple of float
        Lower and upper elevation.
    reason : str
        Name of the obstacle in tables.

    Raises
    ------
    InputError
        If the upper elevation is not above the lower one.
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
        """Return whether each direction (N,) lies in the sector."""
        begin, end = self.azimuth_rad
        # a full turn leaves the remainder 0, like an empty sector
        width = np.remainder(end - begin, _TURN) or (_TURN if end != begin else 0.0)
        inside = np.remainder(azimuth_rad - begin, _TURN) <= width
        low, high = self.elevation_rad
        return np.asarray(inside & (elevation_rad >= low) & (elevation_rad <= high))
