"""Distances and small offsets on the sky."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["angles_of", "offset", "parallel_transport", "separation"]


def angles_of(direction: Array) -> tuple[Array, Array]:
    """Return azimuth in [0, 2π) and elevation, rad, of vectors east, north, up.

    Parameters
    ----------
    direction : ndarray, shape (3, ...)
        Of any length but zero.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        Azimuth from north eastwards; 0 at the very zenith.
    """
    east, north, up = direction
    azimuth = np.remainder(np.arctan2(east, north), 2.0 * np.pi)
    # a hair west of north rounds to a full turn
    azimuth = np.where(azimuth >= 2.0 * np.pi, 0.0, azimuth)
    return azimuth, np.arctan2(up, np.hypot(east, north))


def separation(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors, exact for small and for large ones alike.

    Parameters
    ----------
    a, b : ndarray, shape (3, ...)
        Unit vectors.

    Returns
    -------
    ndarray, shape (...)
        Angles in [0, π], rad.
    """
    return np.asarray(
        2.0 * np.arctan2(np.linalg.norm(a - b, axis=0), np.linalg.norm(a + b, axis=0))
    )


def offset(
    azimuth_rad: Array, elevation_rad: Array, right_rad: Array, up_rad: Array
) -> tuple[Array, Array]:
    """Return the directions beside others, by arcs of great circles.

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        From where.
    right_rad, up_rad : ndarray, shape (...)
        Arc towards growing azimuth (cross-elevation) and towards the zenith.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        There; azimuth in [0, 2π).
    """
    azimuth, elevation, right, up = np.broadcast_arrays(
        azimuth_rad, elevation_rad, right_rad, up_rad
    )
    sine, level = np.sin(elevation), np.cos(elevation)
    zero = np.zeros_like(np.asarray(sine))
    rightwards = np.array([np.cos(azimuth), -np.sin(azimuth), zero])
    upwards = np.array([-np.sin(azimuth) * sine, -np.cos(azimuth) * sine, level])
    arc = np.hypot(right, up)
    # sin(x)/x without its hole at zero; numpy's sinc takes x/π
    step = np.sinc(arc / np.pi) * (right * rightwards + up * upwards)
    return angles_of(np.cos(arc) * direction_cosines(azimuth, elevation) + step)


def parallel_transport(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return by how much arcs that keep their direction turn against right and up along a course.

    Near the zenith right and up turn with the azimuth, the sky does not. Between neighbours the
    arcs are carried in parallel along a great circle.

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        The course, K ≥ 1.

    Returns
    -------
    ndarray, shape (K,)
        Angles from right towards up since the first direction, rad.
    """
    azimuth, elevation = np.asarray(azimuth_rad), np.asarray(elevation_rad)
    sine, level = np.sin(elevation), np.cos(elevation)
    right = np.array([np.cos(azimuth), -np.sin(azimuth), np.zeros_like(azimuth)])
    up = np.array([-np.sin(azimuth) * sine, -np.cos(azimuth) * sine, level])
    place = direction_cosines(azimuth, elevation)
    both = place[:, :-1] + place[:, 1:]
    across = np.sum(right[:, :-1] * place[:, 1:], axis=0)
    # opposite directions have no great circle of their own
    apart = np.maximum(0.5 * np.sum(both**2, axis=0), 1e-12)
    carried = right[:, :-1] - across / apart * both
    step = np.arctan2(np.sum(carried * up[:, 1:], axis=0), np.sum(carried * right[:, 1:], axis=0))
    return np.concatenate([[0.0], np.cumsum(step)])
