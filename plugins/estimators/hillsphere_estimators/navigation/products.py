"""What the stage ``navigation`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["NavigationFlight"]


@dataclass(frozen=True)
class NavigationFlight:
    """64 flights with different draws, measurement by measurement; NaN where one was lost.

    Parameters
    ----------
    frame : str
        Frame of the states.
    spacecraft : tuple of str
        Names of the S spacecraft.
    states : tuple of str
        Names of the n states.
    time_s : ndarray, shape (K,)
        Times of the measurements since the start.
    x, estimate, goal : ndarray, shape (n, K)
        True states, those believed and those of the reference, SI, of the first flight.
    sigma : ndarray, shape (n, K)
        Standard deviations that its filter believes in.
    position_error_m, velocity_error_m_s : ndarray, shape (S, K, N)
        Of the estimates.
    position_sigma_m : ndarray, shape (S, K, N)
        Root of the summed variances of the three axes.
    control_error_m : ndarray, shape (S, K, N)
        Distance of the true positions from the reference.
    nees, nis, used, sent : ndarray, shape (K, N)
        Normalised errors squared of the n states; normalised innovations squared, the rows that
        were used of them, and those that were sent.
    bounds_m : ndarray, shape (S, K, N)
        Posterior Cramér-Rao bounds of the position errors, each along the flight's own planned
        path.
    sensors : tuple of str
        Names of the B sensors.
    seen : ndarray, shape (B, N)
        Share of the measurements at which a sensor saw something.
    matched : bool
        Whether the filter's world is the true one.
    lost : int
        How many of the flights did not come to their end.
    endings : tuple of str
        How each of the N flights ended, and why: ``"completed"``, ``"diverged (filter)"``.
    metrics, units : tuple of str
        Names and units of the m metrics.
    values : ndarray, shape (m, N)
        Their values.
    """

    frame: str
    spacecraft: tuple[str, ...]
    states: tuple[str, ...]
    time_s: Array
    x: Array
    estimate: Array
    goal: Array
    sigma: Array
    position_error_m: Array
    velocity_error_m_s: Array
    position_sigma_m: Array
    control_error_m: Array
    nees: Array
    nis: Array
    used: Array
    sent: Array
    bounds_m: Array
    sensors: tuple[str, ...]
    seen: Array
    matched: bool
    lost: int
    endings: tuple[str, ...]
    metrics: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    @property
    def bound_m(self) -> Array:
        """Bounds (S, K) of the rms position errors."""
        return np.asarray(np.sqrt(np.mean(self.bounds_m**2, axis=2)))
