"""Where the Sun stands, and how much of its disc a sphere hides."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["declinations", "obscuration", "sun_directions"]

_GOLDEN = 0.6180339887498949
"""(√5 − 1)/2: the irrational number whose multiples, modulo 1, are spread most evenly."""


def declinations(largest: float, seasons: int) -> Array:
    """Return the Sun's elevation over a plane at evenly spaced times of the year.

    Parameters
    ----------
    largest : float
        Angle between the plane and that of the Sun's apparent motion, rad.
    seasons : int
        Number of times, from one solstice to the other (the way back is the same); one is the
        equinox.

    Returns
    -------
    ndarray, shape (seasons,)
        asin(sin ε sin λ), rad, at the middles of equal parts of λ from −90° to 90°.
    """
    # midpoints: every sample stands for an equal part of the Sun's longitude
    turn = np.pi * ((np.arange(seasons) + 0.5) / seasons - 0.5)
    return np.asarray(np.arcsin(np.sin(largest) * np.sin(turn)))


def sun_directions(declination: float, longitudes: int, places: int) -> Array:
    """Return directions to the Sun all around, for every one of a number of places.

    Parameters
    ----------
    declination : float
        Over the plane xy, rad.
    longitudes, places : int
        K longitudes at equal distances for each of P places, shifted from place to place (by the
        golden section, so that they never fall in step): means over both resolve far less than a
        K-th of a turn.

    Returns
    -------
    ndarray, shape (3, P, K)
        Unit vectors.
    """
    shift = np.modf(_GOLDEN * (np.arange(places) + 0.5))[0]
    turn = 2.0 * np.pi * (np.arange(longitudes) + shift[:, None]) / longitudes
    ring = np.cos(declination)
    return np.array(
        [ring * np.cos(turn), ring * np.sin(turn), np.full(turn.shape, np.sin(declination))]
    )


def obscuration(to_sphere: Array, radius: float, to_sun: Array, sun_radius_rad: float) -> Array:
    """Return the part of the Sun's disc that a sphere hides.

    Parameters
    ----------
    to_sphere : ndarray, shape (3, N)
        From the observer to the sphere's centre.
    radius : float
        Of the sphere, in the same unit; observers are outside.
    to_sun : ndarray, shape (3, N, K)
        Unit vectors to the Sun.
    sun_radius_rad : float
        Apparent radius of the Sun; 0 for a point, whose shadow is a cylinder.

    Returns
    -------
    ndarray, shape (N, K)
        0 to 1: the common part of two discs in the sky [1]_.

    References
    ----------
    .. [1] Montenbruck, O., Gill, E., Satellite Orbits, Springer, 2000, section 3.4.2.
    """
    distance = np.linalg.norm(to_sphere, axis=0)
    cosine = np.einsum("in,ink->nk", to_sphere / distance, to_sun)
    apart = np.arccos(np.clip(cosine, -1.0, 1.0))
    a, b = sun_radius_rad, np.arcsin(radius / distance)[:, None]
    if a == 0.0:
        return np.where(apart < b, 1.0, 0.0)
    most = np.minimum(1.0, (b / a) ** 2)  # a small sphere leaves a ring
    b = np.broadcast_to(b, apart.shape)
    full = apart <= np.abs(b - a)
    part = np.where(full, most, 0.0)
    edge = ~full & (apart < a + b)
    c, b = apart[edge], b[edge]
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = np.sqrt(np.maximum(a * a - x * x, 0.0))
    area = (
        a * a * np.arccos(np.clip(x / a, -1.0, 1.0))
        + b * b * np.arccos(np.clip((c - x) / b, -1.0, 1.0))
        - c * y
    )
    part[edge] = area / (np.pi * a * a)
    return part
