"""Angles, offsets and parallel transport on the sky."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["angles_of", "offset", "parallel_transport", "separation"]


def angles_of(direction: Array) -> tuple[Array, Array]:
    """Convert vectors east, north, up to azimuth and elevation.

    Parameters
    ----------
    direction : ndarray, shape (3, ...)
        Vectors of any nonzero length.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        Azimuth from north eastwards in [0, 2π), 0 exactly at the zenith, and elevation.
    """
    east, north, up = direction
    azimuth = np.remainder(np.arctan2(east, north), 2.0 * np.pi)
    # a tiny negative azimuth rounds to a full turn, which is outside [0, 2π)
    azimuth = np.where(azimuth >= 2.0 * np.pi, 0.0, azimuth)
    return azimuth, np.arctan2(up, np.hypot(east, north))


def separation(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors, accurate for small and large angles.

    The angle is 2 atan2(|a − b|, |a + b|); an arc cosine loses half the digits near 0 and π.

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
    """Move directions along great circles (exponential map of the sphere).

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        Initial directions.
    right_rad, up_rad : ndarray, shape (...)
        Components of the arc towards growing azimuth (cross-elevation) and towards the zenith.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        Final directions; azimuth in [0, 2π).
    """
    azimuth, elevation, right, up = np.broadcast_arrays(
        azimuth_rad, elevation_rad, right_rad, up_rad
    )
    sine, level = np.sin(elevation), np.cos(elevation)
    zero = np.zeros_like(np.asarray(sine))
    rightwards = np.array([np.cos(azimuth), -np.sin(azimuth), zero])
    upwards = np.array([-np.sin(azimuth) * sine, -np.cos(azimuth) * sine, level])
    arc = np.hypot(right, up)
    # sin(x)/x, regular at zero; numpy's sinc takes x/π
    step = np.sinc(arc / np.pi) * (right * rightwards + up * upwards)
    return angles_of(np.cos(arc) * direction_cosines(azimuth, elevation) + step)


def parallel_transport(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return the rotation of parallel-transported arcs against the axes "right" and "up".

    Near the zenith the axes "right" and "up" rotate with the azimuth, whereas an arc that keeps its
    direction on the sky does not. Between neighbouring directions the arc is transported in
    parallel along the great circle.

    Parameters
    ----------
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Directions along a path, K ≥ 1.

    Returns
    -------
    ndarray, shape (K,)
        Angles from "right" towards "up" since the first direction, rad.
    """
    azimuth, elevation = np.asarray(azimuth_rad), np.asarray(elevation_rad)
    sine, level = np.sin(elevation), np.cos(elevation)
    right = np.array([np.cos(azimuth), -np.sin(azimuth), np.zeros_like(azimuth)])
    up = np.array([-np.sin(azimuth) * sine, -np.cos(azimuth) * sine, level])
    place = direction_cosines(azimuth, elevation)
    both = place[:, :-1] + place[:, 1:]
    across = np.sum(right[:, :-1] * place[:, 1:], axis=0)
    # Parallel transport from a to b: v − (v·b)/(1 + a·b) (a + b), with 1 + a·b = |a + b|²/2. For
    # opposite directions, which have no unique great circle, the divisor is held above zero.
    apart = np.maximum(0.5 * np.sum(both**2, axis=0), 1e-12)
    carried = right[:, :-1] - across / apart * both
    step = np.arctan2(np.sum(carried * up[:, 1:], axis=0), np.sum(carried * right[:, 1:], axis=0))
    return np.concatenate([[0.0], np.cumsum(step)])
