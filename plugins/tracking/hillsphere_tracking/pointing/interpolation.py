"""Interpolation of predicted directions to the rate of the commands.

There are three methods, each exact at the predictions:

- `linear` interpolates both angles. It fails near the zenith, where the azimuth jumps.
- `great_circle` rotates the unit vector at a constant rate along great circles [1]_.
- `smooth` interpolates the unit vector by cubics [2]_. Its rate is continuous, so that the axes
  have no jerk at the predictions; the commands use it.

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
    """Interpolate both angles linearly, azimuth along the shorter way.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times of the predictions, in increasing order, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions.
    at_s : ndarray, shape (N,)
        Times at which to interpolate, within `times_s`.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (N,)
        Interpolated angles, azimuth in [0, 2π).

    Raises
    ------
    InputError
        If there are fewer than two predictions, their times do not increase, a value is not finite,
        or they do not cover `at_s`.
    """
    times, azimuth, elevation, at = _validate_predictions(times_s, azimuth_rad, elevation_rad, at_s)
    along = np.interp(at, times, np.unwrap(azimuth))
    return np.remainder(along, 2.0 * pi), np.interp(at, times, elevation)


def great_circle(
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array
) -> tuple[Array, Array]:
    """Interpolate the unit vector along great circles at a constant rate [1]_.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times of the predictions, in increasing order, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions, neighbours less than 90° apart on the sky.
    at_s : ndarray, shape (N,)
        Times at which to interpolate, within `times_s`.

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
    # sin(wψ)/sin ψ by sinc functions, regular at ψ = 0; ψ < π/2 keeps the denominator above 2/π
    whole = np.sinc(arc / pi)
    left = (1.0 - w) * np.sinc((1.0 - w) * arc / pi) / whole
    right = w * np.sinc(w * arc / pi) / whole
    return angles_of(left * a + right * b)


def smooth(
    times_s: Array, azimuth_rad: Array, elevation_rad: Array, at_s: Array
) -> tuple[Array, Array]:
    """Interpolate the unit vector by Hermite cubics with slopes of parabolas (Bessel's) [2]_.

    The slope at a prediction is the slope of the parabola through it and its two neighbours. A
    value therefore depends on the four nearest predictions only. Two predictions give a straight
    line.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times of the predictions, in increasing order, at least two.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predictions.
    at_s : ndarray, shape (N,)
        Times at which to interpolate, within `times_s`.

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
    # cubic Hermite basis in w, with v = 1 − w
    v = 1.0 - w
    return angles_of(
        v**2 * (1.0 + 2.0 * w) * nodes[:, i]
        + w**2 * (1.0 + 2.0 * v) * nodes[:, i + 1]
        + step * w * v * (v * slopes[:, i] - w * slopes[:, i + 1])
    )


def linear_error_bound(times_s: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return a bound of the error of `linear` on the sky between predictions.

    The bound is T²/8·√((|Ä| cos h)² + ḧ²) for an interval T. Second derivatives are differences of
    the predictions, the larger of both ends; the bound holds unless they are larger in between.

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
    """Return a bound of the error of `great_circle` on the sky between predictions.

    The bound is T²/8·|ü_t| with the tangential part of the unit vector's second derivative. The
    radial part only bends the path along the sphere and causes no error.

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
    # remove the radial part
    bend = bend - inner * np.einsum("ij,ij->j", inner, bend)
    size = np.linalg.norm(bend, axis=0)
    return np.asarray(np.diff(times) ** 2 / 8.0 * _interval_largest(size))


def smooth_error_bound(times_s: Array, azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Return a bound of the error of `smooth` on the sky between predictions.

    The bound is T³/24·|u⃛| for an interval T: the slope of a parabola through three predictions has
    an error of T²/6·|u⃛|, and slopes enter the cubic with factors up to T/4. The bound is twice as
    large in the first and the last interval, where the parabola is one-sided. The third derivative
    is a difference of the predictions, the largest of an interval and its neighbours.

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
    # third derivative of each inner interval, from the second derivatives at its ends
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
    """Return the larger value of both ends of each interval (K − 1,), from inner nodes (K − 2,)."""
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
    # Times that are multiples of a step exceed the ends by rounding.
    inside = np.clip(at, times[0], times[-1])
    if np.any(np.abs(at - inside) > 1e-6 * (times[1] - times[0])):
        raise InputError(
            f"predictions from {times[0]:.6f} to {times[-1]:.6f} s do not reach"
            f" {at.min():.6f} to {at.max():.6f} s; predict further"
        )
    return times, azimuth, elevation, inside
