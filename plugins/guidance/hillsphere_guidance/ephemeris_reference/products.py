"""Product of the stage ``ephemeris_reference``."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.products import FlightSet

__all__ = ["EphemerisReference"]


@dataclass(frozen=True)
class EphemerisReference(FlightSet):
    """Trajectories of an ephemeris file in the frame of a plant."""

    interpolation: str
    """How states between those of the file are found, in words."""
    epoch: str
    """Time 0, TDB."""
    deviation_m: float
    """Largest distance, at the middles of the reference's intervals, of the cubic polynomial along
    which a closed loop follows the states from the interpolation of the file."""
    warnings: tuple[str, ...] = ()
    """What the reader of the file noticed."""
