"""The flights of one combination of reference, strategy and interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, nan

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Compensator, Integers, Plant
from hillsphere.simulation import (
    BLOCK,
    STATUSES,
    Cases,
    Flights,
    Limit,
    NavigationErrors,
    SampledReference,
    Simulator,
    Thruster,
    draws,
)
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.station_keeping_flown.reference_path import ReferencePath
from hillsphere_orbits.station_keeping_flown.sampling import Sampling, Weights
from hillsphere_orbits.station_keeping_flown.specs import StationKeepingFlownSpec
from hillsphere_orbits.station_keeping_flown.strategies import (
    STRATEGIES,
    NearestPointLaw,
    Uncorrected,
)
from hillsphere_orbits.station_keeping_flown.tuning import (
    TUNABLE,
    TuningResult,
    count_candidates,
    tune,
)
from hillsphere_orbits.survey import NEARLY_PLANAR

__all__ = ["ClosedLoop", "Outcome"]

_ACCURACY = 1e-6
"""Of a flight over `_PROBE`, both in natural units: centimetres where navigation errs by metres."""
_PROBE = 2.0
"""Duration of the trial flight that sets the sub-steps, natural units: a third of a revolution of
the primary (2π), long enough to pass the place nearest to the body."""
_ENDS = 1e-9
"""Relative slack of durations: the quotient of two durations, rounded, must not add a
correction."""
_MOST_BYTES = 100_000_000
"""Memory for the histories of the cases that fly at once; a smaller value costs no accuracy, only
more calls of the simulator."""
_COAST_S = DAY_S
"""Between the samples of a flight without corrections."""
_STREAM = "station_keeping_flown"
_TUNING = "station_keeping_tuning"
"""Names of the streams of random numbers: weights are tuned on other errors than judged by."""


@dataclass(frozen=True)
class Outcome:
    """Survival and cost of the flights of one combination.

    Parameters
    ----------
    counts : list of int
        How many ended in each of `hillsphere.simulation.STATUSES`.
    cost_m_s, cost_95_m_s : float
        Mean and 95th percentile of Δv of those that survived; NaN if none did.
    deviation_m : float
        Root mean square of the distance from the reference at their corrections after the first:
        from its nearest point for laws on that point, else from where it is at the time.
    tuned : TuningResult or None
        The weights that were chosen; None for a strategy that has none, or if they are as written.
    """

    counts: list[int]
    cost_m_s: float = nan
    cost_95_m_s: float = nan
    deviation_m: float = nan
    tuned: TuningResult | None = None


class ClosedLoop:
    """Simulates the station-keeping of references with the errors of a Spec.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    spec : StationKeepingFlownSpec
        Errors, limits, duration, cases.
    paths : sequence of ReferencePath
        All references that will be flown, by which the step is chosen.
    """

    def __init__(
        self, plant: Plant, spec: StationKeepingFlownSpec, paths: Sequence[ReferencePath]
    ) -> None:
        self.plant, self.spec = plant, spec
        self.flow = flow_of(plant)
        steps = [self.flow.plain.choose_steps(path.probe, _PROBE, _ACCURACY) for path in paths]
        self._substep_s = _PROBE / max(steps, default=1) * self.flow.system.time_unit_s
        unit = self.flow.system.unit
        self._weights = Weights(
            spec.tolerable_position_m / unit[0],
            spec.tolerable_velocity_m_s / unit[3],
            spec.tolerable_impulse_m_s / unit[3],
            spec.targets,
        )

    def fly(
        self,
        path: ReferencePath,
        strategy: str,
        interval_s: float,
        seed: int,
        advance: Callable[[int], None],
    ) -> Outcome:
        """Fly the cases of one combination.

        Parameters
        ----------
        path : ReferencePath
            The reference.
        strategy : str
            One of `STRATEGIES`.
        interval_s : float
            Time between corrections.
        seed : int
            Root seed.
        advance : callable
            Told the number of flights done.

        Returns
        -------
        Outcome
            How they ended, and at what cost.
        """
        sampling, make = self._sampling(path, interval_s), STRATEGIES[strategy]
        if not self._tunes(strategy):
            return self._fly(sampling, make(sampling, self._weights), seed, advance)
        cases = self.spec.tuning_cases

        def attempt(weights: Weights) -> tuple[int, float]:
            survivors = self._fly(sampling, make(sampling, weights), seed, advance, cases, _TUNING)
            return survivors.counts[STATUSES.index("completed")], self._weigh(
                survivors, sampling.count
            )

        tuned = tune(strategy, self._weights, attempt)
        law = make(sampling, tuned.weights)
        return replace(self._fly(sampling, law, seed, advance), tuned=tuned)

    def count_flights(self, strategy: str) -> int:
        """Return how many flights `fly` takes, those for tuning included."""
        tries = count_candidates(strategy, self._weights) if self._tunes(strategy) else 0
        return self.spec.cases + tries * self.spec.tuning_cases

    def _weigh(self, survivors: Outcome, corrections: int) -> float:
        """Return the deviation and the mean impulse weighed by their tolerable sizes as written.

        Δv alone would be least without any correction wherever the flights just survive that.
        """
        deviation = survivors.deviation_m / self.spec.tolerable_position_m
        impulse = survivors.cost_m_s / (corrections * self.spec.tolerable_impulse_m_s)
        return float(np.nan_to_num(deviation) ** 2 + np.nan_to_num(impulse) ** 2)

    def _tunes(self, strategy: str) -> bool:
        return strategy in TUNABLE and self.spec.tuning_cases > 0

    def drift(self, path: ReferencePath, seed: int, advance: Callable[[int], None]) -> Outcome:
        """Fly the same cases without any correction.

        Parameters
        ----------
        path : ReferencePath
            The reference.
        seed : int
            Root seed.
        advance : callable
            Told the number of flights done.

        Returns
        -------
        Outcome
            How they ended; the cost is zero.
        """
        interval_s = min(_COAST_S, self.spec.duration_s)
        return self._fly(self._sampling(path, interval_s), Uncorrected(interval_s), seed, advance)

    def _sampling(self, path: ReferencePath, interval_s: float) -> Sampling:
        corrections = max(1, ceil(self.spec.duration_s / interval_s * (1.0 - _ENDS)))
        return Sampling(path, interval_s / self.flow.system.time_unit_s, corrections)

    def _fly(
        self,
        sampling: Sampling,
        law: Compensator,
        seed: int,
        advance: Callable[[int], None],
        cases: int | None = None,
        stream: str = _STREAM,
    ) -> Outcome:
        """Fly cases with a law: those of the mission, or others of another stream of errors."""
        spec, system, path = self.spec, self.flow.system, sampling.path
        corrections, interval_s = sampling.count, law.period_s
        reference = path.states(sampling.times) * system.unit[:, None]
        simulator = Simulator(
            self.plant,
            law,
            reference=SampledReference(reference),
            navigation=NavigationErrors(
                self._sigma(spec.navigation_position_m, spec.navigation_velocity_m_s)
            ),
            actuator=Thruster(
                magnitude_sigma=spec.execution_magnitude,
                pointing_sigma_rad=spec.execution_pointing_rad,
                minimum=spec.minimum_impulse_m_s,
            ),
            limits=self._limits(path, corrections * interval_s),
            substeps=ceil(interval_s / self._substep_s),
        )
        sigma = self._sigma(spec.injection_position_m, spec.injection_velocity_m_s)
        total = spec.cases if cases is None else cases
        survivors = _Survivors(law)
        # in parts, for the histories of many cases are large
        per_block = 8 * BLOCK * corrections * 4 * len(sigma)
        at_once = BLOCK * max(1, _MOST_BYTES // per_block)
        for first in range(0, total, at_once):
            numbers = np.arange(first, min(first + at_once, total))
            error = draws(seed, stream, numbers, "injection", (sigma.size,))
            start = reference[:, :1] + sigma[:, None] * error
            survivors.add(
                simulator.fly(
                    Cases(start, numbers=numbers),
                    corrections,
                    seed=seed,
                    stage=stream,
                    history=True,
                    advance=advance,
                )
            )
        return survivors.outcome()

    def _sigma(self, position_m: float, velocity_m_s: float) -> Array:
        """Return standard deviations of the plant's states (n,), zero beyond the first six."""
        sigma = np.zeros(len(self.plant.states))
        sigma[:3], sigma[3:6] = position_m, velocity_m_s
        return sigma

    def _limits(self, path: ReferencePath, flight_s: float) -> list[Limit]:
        """Return the limits that end a flight, beside the plant's events."""
        spec, system = self.spec, self.flow.system
        box = spec.limit_factor * path.amplitude * system.unit[:3]
        # nearly planar orbits have no limit on z
        box[2] = np.inf if box[2] <= NEARLY_PLANAR * np.max(box) else box[2]
        n = len(self.plant.states)
        steep = np.concatenate([1.0 / box, np.zeros(n - 3)])
        limits = [Limit("amplitude", partial(_within, box[:, None]), "escape", lipschitz=steep)]
        if spec.distance_max_m is not None:
            most = spec.distance_max_m

            def near(t_s: Array, x: Array, cases: Integers) -> Array:
                place, _ = path.interpolate(t_s / system.time_unit_s)
                gap = x[:3] - place[:3] * system.unit[:3, None]
                return np.asarray(1.0 - np.sqrt(np.sum(gap**2, axis=0)) / most)

            speed = path.fastest(system.unit[:3]) / system.time_unit_s
            by_place = np.concatenate([np.full(3, 1.0 / most), np.zeros(n - 3)])
            limits.append(Limit("distance", near, lipschitz=by_place, drift=speed / most))
        end = spec.duration_s
        if flight_s > end * (1.0 + _ENDS):
            # the last interval is cut short: every flight lasts as long as every other
            limits.append(
                Limit(
                    "duration",
                    lambda t_s, x, cases: 1.0 - t_s / end,
                    "completed",
                    lipschitz=np.zeros(n),
                    drift=1.0 / end,
                )
            )
        return limits


def _within(box: Array, t_s: Array, x: Array, cases: Integers) -> Array:
    """Return the margins 1 − |x_i|/limit_i of the limits (3, 1) of |x|, |y| and |z|."""
    return np.asarray(1.0 - np.maximum.reduce(np.abs(x[:3]) / box, axis=0))


class _Survivors:
    """Ends of flights, and cost and deviation of those that survived."""

    def __init__(self, law: Compensator) -> None:
        self._law = law if isinstance(law, NearestPointLaw) else None
        self._counts = dict.fromkeys(STATUSES, 0)
        self._dv: list[Array] = []
        self._square, self._places = 0.0, 0

    def add(self, flights: Flights) -> None:
        """Add the results of some flights."""
        for status, count in flights.counts().items():
            self._counts[status] += count
        survived = np.flatnonzero(np.array(flights.status) == "completed")
        self._dv.append(flights.dv_m_s[survived])
        # flights that all ended before the first correction have no history of it
        if flights.history is not None and survived.size:
            x = flights.history.x[:, 1:-1, survived]
            if self._law is None:
                gap = x[:3] - flights.history.ref[:3, 1:, survived]
            else:
                gap = _across(self._law, x)
            self._square += float(np.sum(gap**2))
            self._places += gap[0].size

    def outcome(self) -> Outcome:
        """Return survival and cost of all flights."""
        counts, dv = list(self._counts.values()), np.concatenate(self._dv)
        if not dv.size:
            return Outcome(counts)
        deviation = float(np.sqrt(self._square / self._places)) if self._places else nan
        return Outcome(counts, float(dv.mean()), float(np.quantile(dv, 0.95)), deviation)


def _across(law: NearestPointLaw, x: Array) -> Array:
    """Return positions (3, K, N) from the nearest points, for states (n, K, N), SI.

    At corrections 1 to K, with the nearest point looked for from that of the correction before.
    """
    unit, time = law.path.flow.system.unit[:3], law.path.flow.system.time_unit_s
    gap, slip_s = np.empty((3, *x.shape[1:])), np.zeros(x.shape[2])
    for k in range(x.shape[1]):
        t_s = np.full(x.shape[2], (k + 1) * law.period_s)
        phase, delta = law.deviation(t_s, x[:, k], slip_s)
        gap[:, k] = delta[:3] * unit[:, None]
        slip_s = phase * time - t_s
    return gap
