"""Predictions about once per second, filled up to the rate of smooth commands.

Three kinds, each exact at the predictions: both angles linearly, which fails near the zenith where
azimuth jumps; the unit vector turned evenly along great circles; and `smooth`, which commands are
made with: cubic pieces of the unit vector, whose rate is continuous too, so that the axes are not
jerked at every prediction.

References
----------
.. [1] K. Shoemake (1985), Animating Rotation with Quaternion Curves, SIGGRAPH '85 Proceedings,
   245-254 (spherical linear interpolation).
.. [2] C. de Boor (1978), A Practical Guide to Splines, Springer, chapter IV (cubic Hermite
   interpolation with slopes of parabolas, Bessel's).
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.sky import angles_of
from hillsphere_tracking.topocentric import direction_cosines

__all__ = [
    "great_circle", "great_circle_error_bound", "linear", "linear_error_bound", "smooth",
    "smooth_error_bound",
]  # fmt: skip


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
    times, azimuth, elevation, at = _validate_predictions(times_s, azimuth_rad, elevation_rad, at_s)
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
    times, azimuth, elevation, at = _validate_predictions(times_s, azimuth_rad, elevation_rad, at_s)
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
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array
) -> tuple[Array, Array]:
    """Interpolate the unit vector by cubics whose slopes are those of parabolas [2]_.

    The parabola at a prediction goes through its neighbours too, so a value depends on the four
    predictions around it only. Of two predictions a straight line is left.

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
        As for `linear`.
    """
    times, azimuth, elevation, at = _validate_predictions(times_s, azimuth_rad, elevation_rad, at_s)
    nodes = direction_cosines(azimuth, elevation)
    slopes = np.gradient(nodes, times, axis=1, edge_order=2 if times.size > 2 else 1)
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    step = times[i + 1] - times[i]
    w = (at - times[i]) / step
    v = 1.0 - w
    return angles_of(
        v**2 * (1.0 + 2.0 * w) * nodes[:, i]
        + w**2 * (1.0 + 2.0 * v) * nodes[:, i + 1]
        + step * w * v * (v * slopes[:, i] - w * slopes[:, i + 1])
    )


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
    times, azimuth, elevation, _ = _validate_predictions(
        times_s, azimuth_rad, elevation_rad, times_s, 3
    )
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
    times, azimuth, elevation, _ = _validate_predictions(
        times_s, azimuth_rad, elevation_rad, times_s, 3
    )
    nodes = direction_cosines(azimuth, elevation)
    bend = _second_derivative(times, nodes)
    inner = nodes[:, 1:-1]
    bend = bend - inner * np.einsum("ij,ij->j", inner, bend)
    size = np.linalg.norm(bend, axis=0)
    return np.asarray(np.diff(times) ** 2 / 8.0 * _interval_largest(size))


def smooth_error_bound(times_s: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return by how much `smooth` can miss on the sky between predictions.

    T³/24·|u⃛| for an interval T: the slope of a parabola through three predictions is off by
    T²/6·|u⃛|, and slopes count by T/4 at most. At both ends of the predictions it is twice that. The
    third derivative is that of differences, the largest of an interval and its neighbours.

    Parameters
    ----------
    times_s, azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions about evenly spaced, at least four.

    Returns
    -------
    ndarray, shape (K - 1,)
        Arc, rad, for each interval.

    Raises
    ------
    InputError
        If the predictions are fewer than four, not rising or not finite.
    """
    times, azimuth, elevation, _ = _validate_predictions(
        times_s, azimuth_rad, elevation_rad, times_s, 4
    )
    bend = _second_derivative(times, direction_cosines(azimuth, elevation))
    # of the inner intervals, between the bends at both their ends
    jerk = np.linalg.norm(np.diff(bend, axis=1) / np.diff(times[1:-1]), axis=0)
    near = np.concatenate([jerk[:1], jerk[:1], jerk, jerk[-1:], jerk[-1:]])
    largest = np.maximum(np.maximum(near[:-2], near[1:-1]), near[2:])
    factor = np.full(largest.size, 1.0 / 24.0)
    factor[[0, -1]] = 1.0 / 12.0
    return np.asarray(factor * np.diff(times) ** 3 * largest)


def _second_derivative(times: Array, values: Array) -> Array:
    step = np.diff(times)
    slope = np.diff(values, axis=1) / step
    return np.asarray(2.0 * np.diff(slope, axis=1) / (step[1:] + step[:-1]))


def _interval_largest(inner: Array) -> Array:
    """Return the larger of both ends' values, (K - 1,), from those of the inner nodes, (K - 2,)."""
    ends = np.concatenate([inner[:1], inner, inner[-1:]])
    return np.asarray(np.maximum(ends[:-1], ends[1:]))


def _validate_predictions(
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
