"""What the stage ``station_keeping_flown`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["StationKeepingFlown"]


@dataclass(frozen=True)
class StationKeepingFlown:
    """Survival and cost of M references held by S strategies at I correction intervals.

    A combination is not flown where a strategy has nothing to do (the Floquet mode of a stable
    orbit) or there is no such interval (the period of a flight that has none).

    Parameters
    ----------
    labels : tuple of str, length M
        Names of the references.
    status : tuple of str, length M
        ``"flown"``, or why a reference was not.
    stable : ndarray of bool, shape (M,)
        Whether no deviation grows exponentially.
    strategies : tuple of str, length S
        As asked for.
    intervals : tuple of str, length I
        ``"6 h"`` and so on; ``"period"``.
    interval_s : ndarray, shape (M, I)
        Time between corrections; NaN where there is none.
    period_s : ndarray, shape (M,)
        Of the references; NaN for one without.
    unstable_time_s : ndarray, shape (M,)
        Mean time in which the largest multiplier makes a deviation grow e-fold; infinite for a
        stable one, NaN for one without period.
    flown : ndarray of bool, shape (M, S, I)
        Whether it was flown.
    statuses : tuple of str, length E
        How flights may end, see `hillsphere.simulation.STATUSES`.
    counts : ndarray of int, shape (E, M, S, I)
        How many did.
    uncorrected_counts : ndarray of int, shape (E, M)
        How the same cases end without any correction; zero for a reference that is not flown.
    uncorrected_low, uncorrected_high : ndarray, shape (M,)
        Interval of their survival probability; NaN where not flown.
    low, high : ndarray, shape (M, S, I)
        Interval of the survival probability; NaN where not flown.
    cost_m_s, cost_95_m_s : ndarray, shape (M, S, I)
        Mean and 95th percentile of Δv of the flights that survived; NaN if none did.
    deviation_m : ndarray, shape (M, S, I)
        Root mean square of the distance from the reference at the corrections after the first, of
        the flights that survived; NaN if there are none. From its nearest point for strategies on
        that point, else from where it is at the time.
    tuned_impulse_m_s, tuned_velocity_m_s : ndarray, shape (M, S, I)
        Tolerable impulse and velocity that tuning chose; NaN where nothing was tuned.
    tuned_targets : ndarray of int, shape (M, S, I)
        How many of the targets it kept; zero where nothing was tuned.
    tuning_survivors : ndarray of int, shape (M, S, I)
        Of the flights of tuning, with the chosen weights; -1 where nothing was tuned.
    index_m_s : ndarray, shape (M,)
        Analytic index of the same name; NaN where none is known.
    cases : int
        Flights of each combination.
    tuning_cases : int
        Flights on which each weight was tried, with other errors; zero without tuning.
    seed : int
        Root seed of both.
    duration_s, survival_required, confidence : float
        As asked for.
    injection_m, injection_m_s, navigation_m, navigation_m_s : float
        Standard deviations per axis.
    execution_magnitude, execution_pointing_rad, minimum_impulse_m_s : float
        Errors and least size of impulses.
    limit_factor : float
        As asked for.
    distance_max_m : float or None
        As asked for.
    """

    labels: tuple[str, ...]
    status: tuple[str, ...]
    stable: NDArray[np.bool_]
    strategies: tuple[str, ...]
    intervals: tuple[str, ...]
    interval_s: Array
    period_s: Array
    unstable_time_s: Array
    flown: NDArray[np.bool_]
    statuses: tuple[str, ...]
    counts: NDArray[np.int64]
    uncorrected_counts: NDArray[np.int64]
    uncorrected_low: Array
    uncorrected_high: Array
    low: Array
    high: Array
    cost_m_s: Array
    cost_95_m_s: Array
    deviation_m: Array
    tuned_impulse_m_s: Array
    tuned_velocity_m_s: Array
    tuned_targets: NDArray[np.int64]
    tuning_survivors: NDArray[np.int64]
    index_m_s: Array
    cases: int
    tuning_cases: int
    seed: int
    duration_s: float
    survival_required: float
    confidence: float
    injection_m: float
    injection_m_s: float
    navigation_m: float
    navigation_m_s: float
    execution_magnitude: float
    execution_pointing_rad: float
    minimum_impulse_m_s: float
    limit_factor: float
    distance_max_m: float | None

    @property
    def survival(self) -> Array:
        """Part of the flights that survived, shape (M, S, I); NaN where not flown."""
        part = self.counts[self.statuses.index("completed")] / self.cases
        return np.where(self.flown, part, np.nan)

    @property
    def uncorrected_survival(self) -> Array:
        """Part of the flights that survive without any correction, (M,); NaN where not flown."""
        part = self.uncorrected_counts[self.statuses.index("completed")] / self.cases
        return np.where(self.uncorrected_counts.any(axis=0), part, np.nan)

    @property
    def tuned(self) -> NDArray[np.bool_]:
        """Where the weights were tuned, or there are none to tune, shape (M, S, I)."""
        free = np.array([name == "floquet_mode" for name in self.strategies])[:, None]
        return np.asarray(self.flown & (free | (self.tuning_survivors >= 0)))

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Where it was flown and no flight survived, shape (M, S, I)."""
        return np.asarray(self.flown & (self.survival == 0.0))

    def longest(self) -> Array:
        """Return the longest interval with the survival required, s, shape (M, S); else NaN."""
        enough = self.flown & (self.survival >= self.survival_required)
        times = np.where(enough, self.interval_s[:, None], -np.inf)
        best = np.max(times, axis=2, initial=-np.inf)
        return np.where(np.isfinite(best), best, np.nan)
