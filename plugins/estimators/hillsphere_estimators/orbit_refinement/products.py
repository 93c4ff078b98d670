"""What is known of the orbit of an asteroid, over geometries and random cases."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array

__all__ = ["Knowledge", "OrbitRefinement"]


@dataclass(frozen=True)
class Knowledge:
    """Errors of the asteroid's estimated state over time, and what the filter says of them.

    Parameters
    ----------
    t_s : ndarray, shape (K,)
        Times since the first observation, s.
    position_m, velocity_m_s : ndarray, shape (K, G, M)
        Lengths of the errors in G geometries of M random cases.
    position_sigma_m, velocity_sigma_m_s : ndarray, shape (K, G, M)
        Roots of the traces of the covariances.
    nees : ndarray, shape (K, G, M)
        Normalised errors squared of the asteroid's six states.
    rows : ndarray, shape (K, G)
        Mean number of measured values at that time.
    """

    t_s: Array
    position_m: Array
    velocity_m_s: Array
    position_sigma_m: Array
    velocity_sigma_m_s: Array
    nees: Array
    rows: Array


@dataclass(frozen=True)
class OrbitRefinement:
    """The orbit of an asteroid from telescopes, and with spacecraft near it.

    Parameters
    ----------
    geometries, arms : tuple of str
        Names.
    earth_distance_m : ndarray, shape (G,)
        Least distance of Earth and asteroid while it is observed optically.
    optical : Knowledge
        Of the first part.
    settled : ndarray, shape (G, M)
        1 where its least squares converged, else 0.
    tracked : tuple of Knowledge
        Of the second part, one an arm; its first entry is before any measurement.
    joint_nees : ndarray, shape (A, G, M)
        Normalised errors squared of all states at the end.
    states : int
        How many states these are.
    tracked_settled : ndarray, shape (A, G, M)
        1 where the second part has converged, else 0.
    craft_velocity_sigma_m_s : ndarray, shape (A, K, G, M)
        Root of the trace of the covariance of a spacecraft's velocity, of the worst known; zero
        without spacecraft.
    """

    geometries: tuple[str, ...]
    arms: tuple[str, ...]
    earth_distance_m: Array
    optical: Knowledge
    settled: Array
    tracked: tuple[Knowledge, ...]
    joint_nees: Array
    states: int
    tracked_settled: Array
    craft_velocity_sigma_m_s: Array
