"""What the stage ``invariant_manifolds`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import PeriodicOrbits

__all__ = ["Manifolds"]


@dataclass(frozen=True)
class Manifolds:
    """Trajectories of invariant manifolds and what they meet.

    Times count from the last moment at which a trajectory is `distance` away from its orbit; they
    are negative before it, and on stable manifolds, which are flown backwards, after it.

    Parameters
    ----------
    orbits : PeriodicOrbits
        The M orbits.
    kinds : tuple of str, length M
        ``"unstable"``, ``"stable"`` or ``"complex"``; only the first have trajectories.
    multiplier : ndarray, shape (M,)
        Largest multiplier; NaN unless real and off the unit circle.
    one_side : ndarray of bool, shape (M,)
        Whether the second side of each manifold is the mirror image of the first.
    distance, start_distance : float
        Distances from the orbit where times begin and where the linear motion ends, normalised.
    orbit : ndarray of int, shape (K,)
        Orbit of each trajectory.
    stable : ndarray of bool, shape (K,)
        Whether it belongs to the stable manifold.
    side : ndarray of int, shape (K,)
        1 or −1: the side of the orbit.
    p : ndarray, shape (K,)
        Place in the fundamental domain, 0 … 1.
    start, end : ndarray, shape (6, K)
        First and last states, SI.
    start_time_s, end_time_s : ndarray, shape (K,)
        Their times.
    ended_by : tuple of str, length K
        ``"impact"``, ``"escape"``, or empty where the duration was flown.
    events : tuple of str
        ``"plane z = 0"``, ``"cylinder R km"`` …, and those that end a flight.
    met_trajectory, met_event : ndarray of int, shape (E,)
        Trajectory and event of each of the E things met, by trajectory and time.
    met_time_s : ndarray, shape (E,)
        When.
    met_rising : ndarray of bool, shape (E,)
        Whether z, or the distance from the axis, grows along the flight (of a stable manifold:
        backwards in time).
    met : ndarray, shape (6, E)
        States there, SI.
    track_trajectory : ndarray of int, shape (J,)
        Trajectories of which positions along the way are kept, for figures.
    tracks_m : ndarray, shape (3, P, J)
        Those positions.
    orbit_tracks_m : ndarray, shape (3, Q, M)
        Positions along one period of each orbit.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    orbits: PeriodicOrbits
    kinds: tuple[str, ...]
    multiplier: Array
    one_side: NDArray[np.bool_]
    distance: float
    start_distance: float
    orbit: NDArray[np.int64]
    stable: NDArray[np.bool_]
    side: NDArray[np.int64]
    p: Array
    start: Array
    end: Array
    start_time_s: Array
    end_time_s: Array
    ended_by: tuple[str, ...]
    events: tuple[str, ...]
    met_trajectory: NDArray[np.int64]
    met_event: NDArray[np.int64]
    met_time_s: Array
    met_rising: NDArray[np.bool_]
    met: Array
    track_trajectory: NDArray[np.int64]
    tracks_m: Array
    orbit_tracks_m: Array
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float
