"""Errors of antenna angles: differences of angles, arcs on the sky, NEES."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.kepler import wrap_angle

__all__ = ["arc", "larger_sigma", "nees", "on_the_sky", "root_sum_square"]

_ROUNDING_RAD = 1e-9
"""Standard deviation (rad) that is added to covariances before inversion, that of rounding: a
singular covariance would make the NEES infinite."""


def root_sum_square(angles_rad: Array, reference_rad: Array) -> Array:
    """Return √(ΔA² + Δh²), rad, of azimuths and elevations (2, ...); ΔA is wrapped to [−π, π)."""
    return np.asarray(
        np.hypot(wrap_angle(angles_rad[0] - reference_rad[0]), angles_rad[1] - reference_rad[1])
    )


def arc(angles_rad: Array, reference_rad: Array) -> Array:
    """Return the arc on the sky between two directions (2, ...), rad.

    The haversine formula is accurate for small arcs.
    """
    half_a = 0.5 * (angles_rad[0] - reference_rad[0])
    half_h = 0.5 * (angles_rad[1] - reference_rad[1])
    level = np.cos(angles_rad[1]) * np.cos(reference_rad[1])
    square = np.sin(half_h) ** 2 + level * np.sin(half_a) ** 2
    return np.asarray(2.0 * np.arcsin(np.sqrt(np.clip(square, 0.0, 1.0))))


def on_the_sky(angles_rad: Array, reference_rad: Array) -> Array:
    """Return the arc from a reference as components along rising azimuth and elevation.

    Parameters
    ----------
    angles_rad, reference_rad : ndarray, shape (2, ...)
        Azimuths and elevations.

    Returns
    -------
    ndarray, shape (2, ...)
        Components of the great-circle arc at the reference, rad; their norm is `arc`.
    """
    turn = angles_rad[0] - reference_rad[0]
    (ch, sh), (cr, sr) = ((np.cos(q[1]), np.sin(q[1])) for q in (angles_rad, reference_rad))
    right, up = ch * np.sin(turn), sh * cr - ch * sr * np.cos(turn)
    # (right, up) has the length of the arc's sine: scale it to the arc
    size = np.hypot(right, up)
    far = arc(angles_rad, reference_rad)
    scale = np.divide(far, size, out=np.ones_like(size), where=size > 0.0)
    return np.array([right * scale, up * scale])


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised estimation error squared εᵀP⁻¹ε (N,).

    Parameters
    ----------
    error : ndarray, shape (2, N)
        Errors ε, rad.
    covariance : ndarray, shape (2, 2, N)
        Covariances P, rad².
    """
    p, q = (covariance[k, k] + _ROUNDING_RAD**2 for k in (0, 1))
    r = covariance[0, 1]
    x, y = error
    return np.asarray((q * x * x - 2.0 * r * x * y + p * y * y) / (p * q - r * r))


def larger_sigma(covariance: Array) -> Array:
    """Return the standard deviation along the major axis of covariances (2, 2, ...)."""
    # larger eigenvalue of the symmetric matrix [[p, r], [r, q]]
    p, q, r = covariance[0, 0], covariance[1, 1], covariance[0, 1]
    return np.asarray(np.sqrt(0.5 * (p + q) + np.hypot(0.5 * (p - q), r)))
