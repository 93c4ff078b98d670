"""Probability of lock, time outside the beam, and distribution of the time to reacquisition."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from scipy.special import ndtr

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.search import Search

__all__ = [
    "Reacquisition", "expected_time_outside", "lock_probability", "reacquisition", "time_outside",
]  # fmt: skip

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_TAIL = 8.5
"""Standard deviations beyond which a Gaussian is zero in double precision (2e-17)."""
_POINTS = 6000
"""Errors of equal probability on which a search is tried: probabilities are then good to 0.003.
Time and memory grow in proportion to it."""


def lock_probability(
    covariance_rad2: Array, beam_rad: float, mean_rad: Array | None = None
) -> Array:
    """Return the probability that a Gaussian error on the sky is smaller than the beam's radius.

    Parameters
    ----------
    covariance_rad2 : ndarray, shape (2, 2, ...)
        Covariance of the error on the sky (cross-elevation and elevation), rad².
    beam_rad : float
        Radius of the beam (the lock angle).
    mean_rad : ndarray, shape (2, ...), optional
        Mean error; none by default.

    Returns
    -------
    ndarray, shape (...)
        Probabilities, accurate to 1e-9. A standard deviation below 1e-9 of the beam is raised to
        that value. The accuracy is 1e-4 if both standard deviations are below a hundredth of the
        beam and the mean lies on the edge of the beam.

    Raises
    ------
    InputError
        If the beam is not positive or the covariance is not finite.

    Notes
    -----
    In principal axes the inner integral, along the major axis, is a difference of normal
    distribution functions. The outer integral, along the minor axis, is a Gauss-Legendre sum in θ
    with y = y₀ + w sin θ, which removes the square-root singularity at the edge of the beam.
    """
    covariance = np.asarray(covariance_rad2, dtype=float)
    if not beam_rad > 0.0 or not np.isfinite(covariance).all():
        raise InputError(
            f"a probability of lock needs a beam > 0 and a finite covariance, got {beam_rad}"
        )
    shape = covariance.shape[2:]
    mean = np.zeros((2, *shape)) if mean_rad is None else np.asarray(mean_rad, dtype=float)
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, (0, 1), (-2, -1)))
    spread = np.sqrt(np.maximum(values, (1e-9 * beam_rad) ** 2))
    # principal axes: mean and standard deviations along the minor and the major axis
    minor, major = spread[..., :1], spread[..., 1:]
    centre = np.einsum("...ji,j...->...i", vectors, mean)
    across, along = centre[..., :1], centre[..., 1:]
    # limits of y: the beam, where the density across it is not zero
    low = np.clip(across - _TAIL * minor, -beam_rad, beam_rad)
    high = np.clip(across + _TAIL * minor, -beam_rad, beam_rad)
    theta = 0.5 * pi * _NODES
    half = 0.5 * (high - low)
    y = 0.5 * (high + low) + half * np.sin(theta)
    # beam² − y² as a product keeps its relative accuracy at the edge
    reach = np.sqrt(np.maximum((beam_rad - y) * (beam_rad + y), 0.0))
    inner = ndtr((reach - along) / major) - ndtr((-reach - along) / major)
    density = np.exp(-0.5 * ((y - across) / minor) ** 2) / (minor * sqrt(2.0 * pi))
    total = np.sum(_WEIGHTS * 0.5 * pi * np.cos(theta) * half * density * inner, axis=-1)
    return np.asarray(np.clip(total, 0.0, 1.0))


def time_outside(times_s: Array, error_rad: Array, beam_rad: float) -> Array:
    """Return the time for which errors exceed the beam's radius, linear between samples.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times in increasing order.
    error_rad : ndarray, shape (K, ...)
        Errors on the sky.
    beam_rad : float
        Radius of the beam.

    Returns
    -------
    ndarray, shape (...)
        Time outside the beam, s.
    """
    error = np.asarray(error_rad, dtype=float)
    step = np.diff(times_s).reshape((-1,) + (1,) * (error.ndim - 1))
    above, below = np.maximum(error - beam_rad, 0.0), np.maximum(beam_rad - error, 0.0)
    # Linear between samples: the fraction outside is the excess over the excess plus the reserve.
    outside = above[:-1] + above[1:]
    total = outside + below[:-1] + below[1:]
    # 0/0 if both samples are exactly on the edge: not outside
    fraction = np.divide(outside, total, out=np.zeros_like(total), where=total > 0.0)
    return np.asarray(np.sum(step * fraction, axis=0))


def expected_time_outside(times_s: Array, probability: Array) -> Array:
    """Return the expected time outside the beam, the integral of 1 − P(lock).

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times in increasing order.
    probability : ndarray, shape (K, ...)
        Probabilities of lock, from `lock_probability`.

    Returns
    -------
    ndarray, shape (...)
        Expected time, s.
    """
    return np.asarray(np.trapezoid(1.0 - np.asarray(probability), times_s, axis=0))


@dataclass(frozen=True, eq=False)
class Reacquisition:
    """Distribution of the time in which a search finds the signal.

    Parameters
    ----------
    times_s : ndarray, shape (M,)
        Times from the beginning of the search, for equally probable errors of the prediction, in
        increasing order; ∞ for errors that one search does not find.
    """

    times_s: Array

    def probability(self, within_s: Array | float) -> Array:
        """Return the probability that the search finds the signal within a time (s)."""
        count = np.searchsorted(self.times_s, within_s, side="right")
        return np.asarray(count / self.times_s.size)

    def quantile(self, probability: Array | float) -> Array:
        """Return the time (s) within which the signal is found with a probability; ∞ if never."""
        at = np.ceil(np.asarray(probability) * self.times_s.size).astype(np.int64) - 1
        return np.asarray(self.times_s[np.clip(at, 0, self.times_s.size - 1)])

    @property
    def found(self) -> float:
        """Probability that one search finds the signal."""
        return float(np.mean(np.isfinite(self.times_s)))

    @property
    def mean_s(self) -> float:
        """Mean time (s) of the errors that the search finds."""
        finite = self.times_s[np.isfinite(self.times_s)]
        return float(finite.mean()) if finite.size else float("inf")


def reacquisition(
    search: Search, covariance_rad2: Array, mean_rad: Array | None = None
) -> Reacquisition:
    """Return the distribution of the time that a search needs.

    The error of the prediction is assumed constant during the search. The signal is found when it
    has been in the beam for the dwell time of the search.

    Parameters
    ----------
    search : Search
        Path, speed, beam and dwell.
    covariance_rad2 : ndarray, shape (2, 2)
        Covariance of the error on the sky, rad²; it may differ from the covariance for which the
        search was planned.
    mean_rad : ndarray, shape (2,), optional
        Mean error; zero by default.

    Returns
    -------
    Reacquisition
        Distribution over 6000 errors of equal probability (a Fibonacci lattice); probabilities are
        accurate to about 0.003.
    """
    # Fibonacci lattice: radii by the inverse of the Rayleigh distribution, angles in steps of the
    # golden angle π (3 − √5).
    index = np.arange(_POINTS) + 0.5
    radius = np.sqrt(-2.0 * np.log1p(-index / _POINTS))
    angle = index * pi * (3.0 - sqrt(5.0))
    values, vectors = np.linalg.eigh(np.asarray(covariance_rad2, dtype=float))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    error = root @ np.array([radius * np.cos(angle), radius * np.sin(angle)])
    if mean_rad is not None:
        error = error + np.asarray(mean_rad, dtype=float)[:, None]
    when = search.along_rad / search.speed_rad_s
    since = np.full(_POINTS, np.inf)  # time at which the signal entered the beam last
    found_s = np.full(_POINTS, np.inf)
    open_ = np.arange(_POINTS)
    for k, time in enumerate(when):
        away = error[:, open_] - search.path_rad[:, k, None]
        inside = away[0] ** 2 + away[1] ** 2 <= search.beam_rad**2
        since[open_] = np.where(inside, np.minimum(since[open_], time), np.inf)
        done = inside & (since[open_] + search.dwell_s <= time)
        if k == when.size - 1:
            # the beam remains at the end of the path
            done |= inside
        found_s[open_[done]] = since[open_[done]] + search.dwell_s
        open_ = open_[~done]
        if open_.size == 0:
            break
    return Reacquisition(np.sort(found_s))
