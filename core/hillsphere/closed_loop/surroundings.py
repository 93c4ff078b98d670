"""What a plant tells of the body at its centre, for figures and for the model's limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.interfaces import Array, Plant

__all__ = ["Surroundings"]


@runtime_checkable
class _AboutBody(Protocol):
    """A plant about a body that stands still in its frame."""

    body_name: str

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Of the surface, along the body's own axes."""
        ...

    @property
    def prime_meridian_rad(self) -> float:
        """Angle about +z from +x to longitude 0."""
        ...

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which gravity is a series that may diverge."""
        ...


@runtime_checkable
class _AboutPrimary(Protocol):
    """A plant about a moon, whose primary is far."""

    primary_distance_m: float


@runtime_checkable
class _TruePrimary(Protocol):
    """A plant that has the primary at its true distance, not in Hill's approximation."""

    primary_gm_m3_s2: float


@dataclass(frozen=True)
class Surroundings:
    """The body at the centre, see `hillsphere.closed_loop.products.ClosedLoopFlight`."""

    body: str = ""
    semi_axes_m: Array | None = None
    prime_meridian_rad: float = 0.0
    series_radius_m: float | None = None
    hill_distance_m: float | None = None

    @classmethod
    def of(cls, plant: Plant) -> Surroundings:
        """Ask a plant."""
        if not isinstance(plant, _AboutBody):
            return cls()
        axes = plant.semi_axes_m
        primary = None
        if isinstance(plant, _AboutPrimary) and not isinstance(plant, _TruePrimary):
            primary = plant.primary_distance_m
        return cls(
            plant.body_name,
            None if axes is None else np.array(axes, dtype=float),
            plant.prime_meridian_rad,
            plant.series_radius_m,
            primary,
        )
