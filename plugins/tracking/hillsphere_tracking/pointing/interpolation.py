"""Predictions about once per second, filled up to the rate of smooth commands.

Either both angles are interpolated linearly, or the unit vector is turned evenly from one
prediction to the next along a great circle. The second goes through the zenith, where azimuth
jumps, as if nothing were there.

Every interpolation here is exact at the predictions, so changing from one kind to the other between
two intervals leaves no step.

References
----------
.. [1] K. Shoemake (1985), Animating Rotation with Quaternion Curves, SIGGRAPH '85 Proceedings,
   245-254 (spherical linear interpolation).
"""

from __future__ import annotations

from math import pi, radians

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.sky import angles_of
from hillsphere_tracking.topocentric import direction_cosines

__all__ = [
    "NEAR_ZENITH_RAD", "great_circle", "great_circle_error_bound", "linear", "linear_error_bound",
    "smooth",
]  # fmt: skip

NEAR_ZENITH_RAD = radians(75.0)
"""Elevation above which `smooth` turns the unit vector instead of the angles.

Predictions of a low satellite a second apart miss by 1e-3° there with linear angles, by 2e-4° with
great circles; at 89.9° it would be 0.1°.
"""


def linear(
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array
) -> tuple[Array, Array]:
    """Interpolate both angles linearly, azimuth the short way round.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Of the predictions, rising, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions.
    at_s : ndarray, shape (N,)
        Where to, within `times_s`.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Azimuth in [0, 2π).

    Raises
    ------
    InputError
        If the predictions are fewer than two, not rising or not finite, or do not reach `at_s`.
    """
    times, azimuth, elevation, at = _checked(times_s, azimuth_rad, elevation_rad, at_s)
    along = np.interp(at, times, np.unwrap(azimuth))
    return np.remainder(along, 2.0 * pi), np.interp(at, times, elevation)


def great_circle(
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array
) -> tuple[Array, Array]:
    """Turn the unit vector evenly along great circles between predictions [1]_.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Of the predictions, rising, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions, neighbours less than 90° apart on the sky.
    at_s : ndarray, shape (N,)
        Where to, within `times_s`.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Azimuth in [0, 2π).

    Raises
    ------
    InputError
        As for `linear`, or if neighbours are 90° apart or more.
    """
    times, azimuth, elevation, at = _checked(times_s, azimuth_rad, elevation_rad, at_s)
    nodes = direction_cosines(azimuth, elevation)
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    w = (at - times[i]) / (times[i + 1] - times[i])
    a, b = nodes[:, i], nodes[:, i + 1]
    cosine = np.einsum("ij,ij->j", a, b)
    if np.any(cosine <= 0.0):
        raise InputError(
            "predictions are 90° or more apart on the sky; predict at shorter intervals"
        )
    arc = np.arctan2(np.linalg.norm(np.cross(a, b, axis=0), axis=0), cosine)
    # sin(wψ)/sin ψ without its hole at ψ = 0; arc < π/2 keeps the denominator above 2/π
    whole = np.sinc(arc / pi)
    left = (1.0 - w) * np.sinc((1.0 - w) * arc / pi) / whole
    right = w * np.sinc(w * arc / pi) / whole
    return angles_of(left * a + right * b)


def smooth(
    times_s: Array,
    azimuth_rad: Array,
    elevation_rad: Array,
    at_s: Array,
    near_zenith_rad: float = NEAR_ZENITH_RAD,
) -> tuple[Array, Array]:
    """Interpolate angles linearly, but turn the unit vector wherever a prediction is near zenith.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Of the predictions, rising, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions.
    at_s : ndarray, shape (N,)
        Where to, within `times_s`.
    near_zenith_rad : float
        Intervals with an end at or above this elevation are great circles.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Azimuth in [0, 2π).

    Raises
    ------
    InputError
        As for `great_circle`.
    """
    times, azimuth, elevation, at = _checked(times_s, azimuth_rad, elevation_rad, at_s)
    by_angle = linear(times, azimuth, elevation, at)
    high = np.asarray(elevation) >= near_zenith_rad
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    turned = high[i] | high[i + 1]
    if not turned.any():
        return by_angle
    by_arc = great_circle(times, azimuth, elevation, at)
    return np.where(turned, by_arc[0], by_angle[0]), np.where(turned, by_arc[1], by_angle[1])


def linear_error_bound(times_s: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return by how much linear angles can miss on the sky between predictions.

    T²/8·√((|Ä| cos h)² + ḧ²) for an interval T, with second derivatives from differences of the
    predictions, the larger of both ends: a bound as long as they are not larger in between.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions, at least three.

    Returns
    -------
    ndarray, shape (K - 1,)
        Arc, rad, for each interval.

    Raises
    ------
    InputError
        If the predictions are fewer than three, not rising or not finite.
    """
    times, azimuth, elevation, _ = _checked(times_s, azimuth_rad, elevation_rad, times_s, 3)
    level = np.cos(elevation)
    level = np.maximum(level[:-1], level[1:])
    turn = _interval_largest(np.abs(_second_derivative(times, np.unwrap(azimuth)[None])[0]))
    rise = _interval_largest(np.abs(_second_derivative(times, elevation[None])[0]))
    return np.asarray(np.diff(times) ** 2 / 8.0 * np.hypot(turn * level, rise))


def great_circle_error_bound(times_s: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return by how much great circles can miss on the sky between predictions.

    T²/8·|ü_t|, with the part of the unit vector's second derivative along the sky; that towards the
    station, which only bends the path around the sphere, costs nothing.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions, at least three.

    Returns
    -------
    ndarray, shape (K - 1,)
        Arc, rad, for each interval.

    Raises
    ------
    InputError
        If the predictions are fewer than three, not rising or not finite.
    """
    times, azimuth, elevation, _ = _checked(times_s, azimuth_rad, elevation_rad, times_s, 3)
    nodes = direction_cosines(azimuth, elevation)
    bend = _second_derivative(times, nodes)
    inner = nodes[:, 1:-1]
    bend = bend - inner * np.einsum("ij,ij->j", inner, bend)
    size = np.linalg.norm(bend, axis=0)
    return np.asarray(np.diff(times) ** 2 / 8.0 * _interval_largest(size))


def _second_derivative(times: Array, values: Array) -> Array:
    step = np.diff(times)
    slope = np.diff(values, axis=1) / step
    return np.asarray(2.0 * np.diff(slope, axis=1) / (step[1:] + step[:-1]))


def _interval_largest(inner: Array) -> Array:
    """Return the larger of both ends' values, (K - 1,), from those of the inner nodes, (K - 2,)."""
    ends = np.concatenate([inner[:1], inner, inner[-1:]])
    return np.asarray(np.maximum(ends[:-1], ends[1:]))


def _checked(
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array, least: int = 2
) -> tuple[Array, Array, Array, NDArray[np.float64]]:
    times, azimuth, elevation, at = (
        np.atleast_1d(np.asarray(q, dtype=float))
        for q in (times_s, azimuth_rad, elevation_rad, at_s)
    )
    if times.size < least or not times.shape == azimuth.shape == elevation.shape:
        raise InputError(
            f"interpolation needs at least {least} predictions with a time, an azimuth and an"
            f" elevation each, got {times.shape}, {azimuth.shape} and {elevation.shape}"
        )
    if not (np.isfinite([times, azimuth, elevation]).all() and np.isfinite(at).all()):
        raise InputError("predictions and times must be finite, got nan or inf")
    if np.any(np.diff(times) <= 0.0):
        first = int(np.argmax(np.diff(times) <= 0.0))
        raise InputError(
            f"predictions must be in order of time, got {times[first]:g} s before"
            f" {times[first + 1]:g} s"
        )
    # times counted up in steps miss the ends by rounding
    inside = np.clip(at, times[0], times[-1])
    if np.any(np.abs(at - inside) > 1e-6 * (times[1] - times[0])):
        raise InputError(
            f"predictions from {times[0]:.6f} to {times[-1]:.6f} s do not reach"
            f" {at.min():.6f} to {at.max():.6f} s; predict further"
        )
    return times, azimuth, elevation, inside
