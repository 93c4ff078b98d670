"""The flights of one combination of reference, strategy and interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, nan

import numpy as np

from hillsphere.interfaces import Array, Integers, Plant
from hillsphere.simulation import (
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
from hillsphere_orbits.station_keeping_flown.specs import StationKeepingFlownSpec
from hillsphere_orbits.station_keeping_flown.strategies import STRATEGIES, Sampling, Weights

__all__ = ["ClosedLoop", "Outcome"]

_PLANAR = 1e-9
_ACCURACY = 1e-6
"""Of a flight over `_PROBE`, both in natural units: centimetres where navigation errs by metres."""
_PROBE = 2.0
_ENDS = 1e-9
_STREAM = "station_keeping_flown"


@dataclass(frozen=True)
class Outcome:
    """What became of the flights of one combination.

    Parameters
    ----------
    counts : list of int
        How many ended in each of `hillsphere.simulation.STATUSES`.
    cost_m_s, cost_95_m_s : float
        Mean and 95th percentile of Δv of those that survived; NaN if none did.
    deviation_m : float
        Root mean square of the distance from the reference at their corrections after the first.
    """

    counts: list[int]
    cost_m_s: float = nan
    cost_95_m_s: float = nan
    deviation_m: float = nan


class ClosedLoop:
    """Flies references with the errors that a Spec states.

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
        spec, system = self.spec, self.flow.system
        corrections = max(1, ceil(spec.duration_s / interval_s * (1.0 - _ENDS)))
        sampling = Sampling(path, interval_s / system.time_unit_s, corrections)
        reference = path.states(sampling.times) * system.unit[:, None]
        simulator = Simulator(
            self.plant,
            STRATEGIES[strategy](sampling, self._weights),
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
        error = draws(seed, _STREAM, np.arange(spec.cases), "injection", (sigma.size,))
        found = simulator.fly(
            Cases(reference[:, :1] + sigma[:, None] * error),
            corrections,
            seed=seed,
            stage=_STREAM,
            history=True,
            advance=advance,
        )
        return _outcome(found)

    def _sigma(self, position_m: float, velocity_m_s: float) -> Array:
        """Return standard deviations of the plant's states (n,), zero beyond the first six."""
        sigma = np.zeros(len(self.plant.states))
        sigma[:3], sigma[3:6] = position_m, velocity_m_s
        return sigma

    def _limits(self, path: ReferencePath, flight_s: float) -> list[Limit]:
        """Return what ends a flight beside the plant's events."""
        spec, system = self.spec, self.flow.system
        box = spec.limit_factor * path.amplitude * system.unit[:3]
        # in the plane nothing is said of z
        box[2] = np.inf if box[2] <= _PLANAR * np.max(box) else box[2]
        limits = [Limit("amplitude", partial(_within, box[:, None]), "escape")]
        if spec.distance_max_m is not None:
            most = spec.distance_max_m

            def near(t_s: Array, x: Array, cases: Integers) -> Array:
                place, _ = path.interpolated(t_s / system.time_unit_s)
                gap = x[:3] - place[:3] * system.unit[:3, None]
                return np.asarray(1.0 - np.sqrt(np.sum(gap**2, axis=0)) / most)

            limits.append(Limit("distance", near))
        end = spec.duration_s
        if flight_s > end * (1.0 + _ENDS):
            # the last interval is cut short: every flight lasts as long as every other
            limits.append(Limit("duration", lambda t_s, x, cases: 1.0 - t_s / end, "completed"))
        return limits


def _within(box: Array, t_s: Array, x: Array, cases: Integers) -> Array:
    """Return what is left, as a part, of the limits (3, 1) of |x|, |y| and |z|."""
    return np.asarray(1.0 - np.maximum.reduce(np.abs(x[:3]) / box, axis=0))


def _outcome(found: Flights) -> Outcome:
    status = np.array(found.status)
    survived = np.flatnonzero(status == "completed")
    counts = [int(np.count_nonzero(status == name)) for name in STATUSES]
    history = found.history
    if not survived.size or history is None:
        return Outcome(counts)
    dv = found.dv_m_s[survived]
    gap = (history.x[:3, 1:-1] - history.ref[:3, 1:])[:, :, survived]
    square = np.sum(gap**2, axis=0)
    deviation = float(np.sqrt(square.mean())) if square.size else nan
    return Outcome(counts, float(dv.mean()), float(np.quantile(dv, 0.95)), deviation)
