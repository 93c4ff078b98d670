"""Product of the stage ``invariant_manifolds``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products import PeriodicOrbits
from hillsphere.products.fields import Shape

__all__ = ["Manifolds"]


@dataclass(frozen=True)
class Manifolds:
    """Trajectories of invariant manifolds and their crossings of surfaces.

    Times count from the last moment at which a trajectory is `distance` away from its orbit; they
    are negative before it, and on stable manifolds, which are flown backwards, after it.
    """

    orbits: PeriodicOrbits
    """The orbits."""
    kinds: Annotated[tuple[str, ...], Shape("orbits")]
    """``"unstable"``, ``"stable"`` or ``"complex"``; only the first have trajectories."""
    multiplier: Annotated[Array, Shape("orbits")]
    """Largest multiplier; NaN unless real and off the unit circle."""
    one_side: Annotated[NDArray[np.bool_], Shape("orbits")]
    """Whether the second side of each manifold is the mirror image of the first."""
    distance: float
    """From the orbit where times begin, normalised."""
    start_distance: float
    """From the orbit where the linear motion ends, normalised."""
    orbit: Annotated[Integers, Shape("trajectories")]
    """Orbit of each trajectory."""
    stable: Annotated[NDArray[np.bool_], Shape("trajectories")]
    """Whether it belongs to the stable manifold."""
    side: Annotated[Integers, Shape("trajectories")]
    """1 or −1: the side of the orbit."""
    p: Annotated[Array, Shape("trajectories")]
    """Place in the fundamental domain, 0 … 1."""
    start: Annotated[Array, Shape(6, "trajectories")]
    """First states, SI."""
    end: Annotated[Array, Shape(6, "trajectories")]
    """Last states, SI."""
    start_time_s: Annotated[Array, Shape("trajectories")]
    """Times of the first states."""
    end_time_s: Annotated[Array, Shape("trajectories")]
    """Times of the last states."""
    ended_by: Annotated[tuple[str, ...], Shape("trajectories")]
    """``"impact"``, ``"escape"``, or empty where the duration was flown."""
    events: tuple[str, ...]
    """``"plane z = 0"``, ``"cylinder R km"`` …, and those that end a flight."""
    met_trajectory: Annotated[Integers, Shape("met")]
    """Trajectory of each thing met, by trajectory and time."""
    met_event: Annotated[Integers, Shape("met")]
    """Event of each thing met."""
    met_time_s: Annotated[Array, Shape("met")]
    """When."""
    met_rising: Annotated[NDArray[np.bool_], Shape("met")]
    """Whether z, or the distance from the axis, grows along the flight (of a stable manifold:
    backwards in time)."""
    met: Annotated[Array, Shape(6, "met")]
    """States there, SI."""
    track_trajectory: Annotated[Integers, Shape("tracks")]
    """Trajectories of which positions along the way are kept, for figures."""
    tracks_m: Annotated[Array, Shape(3, "points", "tracks")]
    """Those positions."""
    orbit_tracks_m: Annotated[Array, Shape(3, "orbit_points", "orbits")]
    """Positions along one period of each orbit."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""
