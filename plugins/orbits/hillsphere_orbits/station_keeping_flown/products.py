"""Product of the stage ``station_keeping_flown``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape

__all__ = ["StationKeepingFlown"]


@dataclass(frozen=True)
class StationKeepingFlown:
    """Survival and cost of references held by several strategies at several correction intervals.

    A combination is not flown where a strategy has nothing to do (the Floquet mode of a stable
    orbit) or there is no such interval (the period of a flight that has none).
    """

    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    """Names of the references."""
    status: Annotated[tuple[str, ...], Shape("orbits")]
    """``"flown"``, or why a reference was not."""
    stable: Annotated[NDArray[np.bool_], Shape("orbits")]
    """Whether no deviation grows exponentially."""
    strategies: Annotated[tuple[str, ...], Shape("strategies"), Label("strategy")]
    """As requested."""
    intervals: Annotated[tuple[str, ...], Shape("intervals")]
    """``"6 h"`` and so on; ``"period"``."""
    interval_s: Annotated[Array, Shape("orbits", "intervals")]
    """Time between corrections; NaN where there is none."""
    period_s: Annotated[Array, Shape("orbits"), Label("period", 6, "h")]
    """Of the references; NaN for one without."""
    unstable_time_s: Annotated[Array, Shape("orbits")]
    """Mean time in which the largest multiplier makes a deviation grow e-fold; infinite for a
    stable one, NaN for one without period."""
    flown: Annotated[NDArray[np.bool_], Shape("orbits", "strategies", "intervals")]
    """Whether it was flown."""
    statuses: Annotated[tuple[str, ...], Shape("endings")]
    """How flights may end, see `hillsphere.simulation.STATUSES`."""
    counts: Annotated[Integers, Shape("endings", "orbits", "strategies", "intervals")]
    """How many did."""
    uncorrected_counts: Annotated[Integers, Shape("endings", "orbits")]
    """How the same cases end without any correction; zero for a reference that is not flown."""
    uncorrected_low: Annotated[Array, Shape("orbits")]
    """Lower end of the interval of their survival probability; NaN where not flown."""
    uncorrected_high: Annotated[Array, Shape("orbits")]
    """Its upper end."""
    low: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Lower end of the interval of the survival probability; NaN where not flown."""
    high: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Its upper end."""
    cost_m_s: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Mean Δv of the flights that survived; NaN if none did."""
    cost_95_m_s: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """95th percentile of the same."""
    deviation_m: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Root mean square of the distance from the reference at the corrections after the first, of
    the flights that survived; NaN if there are none. From its nearest point for strategies on
    that point, else from where it is at the time."""
    tuned_impulse_m_s: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Tolerable impulse that tuning chose; NaN where nothing was tuned."""
    tuned_velocity_m_s: Annotated[Array, Shape("orbits", "strategies", "intervals")]
    """Tolerable velocity that tuning chose; NaN where nothing was tuned."""
    tuned_targets: Annotated[Integers, Shape("orbits", "strategies", "intervals")]
    """How many of the targets it kept; zero where nothing was tuned."""
    tuning_survivors: Annotated[Integers, Shape("orbits", "strategies", "intervals")]
    """Of the flights of tuning, with the chosen weights; -1 where nothing was tuned."""
    index_m_s: Annotated[Array, Shape("orbits"), Label("index v_cm", 5)]
    """Analytic index of the same name; NaN where none is known."""
    cases: int
    """Flights of each combination."""
    tuning_cases: int
    """Flights on which each weight was tried, with other errors; zero without tuning."""
    seed: int
    """Root seed of both."""
    duration_s: float
    """Of the flights, as requested."""
    survival_required: float
    """Part of the flights that must survive, as requested."""
    confidence: float
    """Of the intervals, as requested."""
    injection_m: float
    """Standard deviation per axis of the position at the start."""
    injection_m_s: float
    """The same of the velocity."""
    navigation_m: float
    """Standard deviation per axis of the position known at a correction."""
    navigation_m_s: float
    """The same of the velocity."""
    execution_magnitude: float
    """Relative error of the size of impulses."""
    execution_pointing_rad: float
    """Error of their direction."""
    minimum_impulse_m_s: float
    """Least size of impulses."""
    limit_factor: float
    """Multiples of an orbit's amplitudes beyond which it is lost, as requested."""
    distance_max_m: float | None
    """Distance from the reference beyond which it is lost, as requested."""

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
