"""The body at the centre of a plant's frame, for figures and for the limits of models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.surface import ArraySurface, Surface

__all__ = ["Surroundings"]

_MESH = 121
"""Number of points of the drawn surface on a circle of latitude."""


@runtime_checkable
class _AboutBody(Contract, Protocol):
    """A plant with a body at rest in its frame."""

    body_name: str

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Semi-axes of the surface along the body's own axes, m."""
        ...

    @property
    def prime_meridian_rad(self) -> float:
        """Angle about +z from +x to longitude 0."""
        ...

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which the gravity series may diverge, m."""
        ...


@runtime_checkable
class _AboutPrimary(Contract, Protocol):
    """A plant about a moon with a distant primary."""

    primary_distance_m: float


@runtime_checkable
class _TruePrimary(Contract, Protocol):
    """A plant with the primary at its true distance, without Hill's approximation."""

    primary_gm_m3_s2: float


@runtime_checkable
class _Shaped(Contract, Protocol):
    """A plant about a body whose surface may be a shape other than an ellipsoid."""

    @property
    def surface(self) -> object | None:
        """The shape, in the body's own axes."""
        ...


@runtime_checkable
class _Radial(Contract, Protocol):
    """A shape with a known radius along rays from the centre."""

    def radius_array(self, directions: Array) -> Array:
        """Return the distances (N,), m, of the surface along unit vectors (3, N)."""
        ...


@dataclass(frozen=True)
class Surroundings:
    """Properties of the central body, see `hillsphere_flight.products.ClosedLoopFlight`."""

    body: str = ""
    semi_axes_m: Array | None = None
    surface_m: Array | None = None
    prime_meridian_rad: float = 0.0
    series_radius_m: float | None = None
    hill_distance_m: float | None = None
    shape: Surface | ArraySurface | None = None
    """Points in the body's own axes, if the surface is not an ellipsoid."""

    @classmethod
    def of(cls, plant: Plant) -> Surroundings:
        """Return the properties of a plant's central body."""
        if not isinstance(plant, _AboutBody):
            return cls()
        axes = plant.semi_axes_m
        primary, shape = None, _shape(plant)
        if isinstance(plant, _AboutPrimary) and not isinstance(plant, _TruePrimary):
            primary = plant.primary_distance_m
        return cls(
            plant.body_name,
            None if axes is None else np.array(axes, dtype=float),
            None if axes is None else _surface(plant, np.array(axes, dtype=float)),
            plant.prime_meridian_rad,
            plant.series_radius_m,
            primary,
            shape if isinstance(shape, Surface | ArraySurface) else None,
        )


def _shape(plant: _AboutBody) -> object | None:
    return plant.surface if isinstance(plant, _Shaped) else None


def _surface(plant: _AboutBody, semi_axes_m: Array) -> Array:
    """Return points of the surface (3, J, K), m, in the plant's frame, on closed circles."""
    lon, lat = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, _MESH), np.linspace(-0.5 * np.pi, 0.5 * np.pi, _MESH // 2 + 1)
    )
    out = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    shape = _shape(plant)
    if isinstance(shape, _Radial):
        points = out * shape.radius_array(out.reshape(3, -1)).reshape(lon.shape)
    else:
        points = out / np.sqrt(np.sum((out / semi_axes_m[:, None, None]) ** 2, axis=0))
    cos, sin = np.cos(plant.prime_meridian_rad), np.sin(plant.prime_meridian_rad)
    x, y, z = points
    return np.array([x * cos - y * sin, x * sin + y * cos, z])
