"""The stage ``station_keeping_flown``: orbits held in the closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.cases.case_classes import ratio_interval
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet, OrbitSet
from hillsphere.simulation import STATUSES
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.spatial_qso_families.products import StationKeepingIndex
from hillsphere_orbits.station_keeping_flown.closed_loop import ClosedLoop
from hillsphere_orbits.station_keeping_flown.presentation import present_flown
from hillsphere_orbits.station_keeping_flown.products import StationKeepingFlown
from hillsphere_orbits.station_keeping_flown.references import Sources, references_of
from hillsphere_orbits.station_keeping_flown.specs import StationKeepingFlownSpec

__all__ = ["StationKeepingFlownStage"]


class StationKeepingFlownStage:
    """Survival and cost of holding orbits with errors of injection, navigation and execution.

    Parameters
    ----------
    spec : StationKeepingFlownSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant's states do not begin with three positions and three velocities.
    """

    def __init__(self, spec: StationKeepingFlownSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        dimensions = [(v.length, v.time) for v in self.plant.states]
        if dimensions[:6] != [(1, 0)] * 3 + [(1, -1)] * 3:
            raise InputError(
                "station-keeping needs a plant with states x, y, z and their velocities; this one "
                f"has {', '.join(v.name for v in self.plant.states)}"
            )

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...] = (),
        flights: tuple[FlightSet, ...] = (),
        ladder: FidelityLadder | None = None,
        index: StationKeepingIndex | None = None,
    ) -> StationKeepingFlown:
        """Fly every reference with every strategy at every interval, and without correction.

        Parameters
        ----------
        ctx : Context
            Seed and progress.
        orbits : tuple of OrbitSet
            Periodic orbits to be held.
        flights : tuple of FlightSet
            Other trajectories to be held.
        ladder : FidelityLadder, optional
            Orbits carried over to this plant, to be held.
        index : StationKeepingIndex, optional
            Analytic indices, shown beside the simulated cost, matched by name.

        Returns
        -------
        StationKeepingFlown
            A case meets the same errors in every combination: those of injection at the start,
            those of navigation and execution by the number of the correction. Weights are tuned on
            other errors, the same ones for all strategies.

        Raises
        ------
        StageError
            If there is nothing to hold, or something belongs to other equations.
        InputError
            If the ladder has no such rung, or nothing has a name that is asked for.
        """
        spec = self.spec
        sources = Sources(orbits, flights, ladder, spec.rung, spec.members)
        held = references_of(self.plant, sources, spec.duration_s)
        loop = ClosedLoop(self.plant, spec, [h.path for h in held if h.path is not None])
        period = np.array([h.period_s for h in held])
        stable = np.array([h.stable for h in held], dtype=bool)
        interval = np.tile(np.array(spec.intervals_s, dtype=float), (len(held), 1))
        names = [f"{value / HOUR_S:g} h" for value in spec.intervals_s]
        if spec.once_per_period:
            interval = np.column_stack([interval, period])
            names.append("period")
        shape = (len(held), len(spec.strategies), len(names))
        flown = np.zeros(shape, dtype=bool)
        counts = np.zeros((len(STATUSES), *shape), dtype=np.int64)
        cost, cost_95, deviation, impulse, velocity = np.full((5, *shape), np.nan)
        targets = np.zeros(shape, dtype=np.int64)
        survivors_tuning = np.full(shape, -1, dtype=np.int64)
        wanted = [
            (i, s, j)
            for i, s, j in np.ndindex(*shape)
            if held[i].path is not None
            and np.isfinite(interval[i, j])
            and not (stable[i] and spec.strategies[s] == "floquet_mode")
        ]
        free = np.zeros((len(STATUSES), len(held)), dtype=np.int64)
        there = np.array([h.path is not None for h in held], dtype=bool)
        total = np.count_nonzero(there) * spec.cases
        total += sum(loop.count_flights(spec.strategies[s]) for _, s, _ in wanted)
        advance = ctx.track("flights with and without corrections", int(total))
        for i, one in enumerate(held):
            if one.path is not None:
                free[:, i] = loop.drift(one.path, ctx.seed, advance).counts
        for i, s, j in wanted:
            path = held[i].path
            assert path is not None
            outcome = loop.fly(path, spec.strategies[s], float(interval[i, j]), ctx.seed, advance)
            flown[i, s, j] = True
            counts[:, i, s, j] = outcome.counts
            cost[i, s, j], cost_95[i, s, j] = outcome.cost_m_s, outcome.cost_95_m_s
            deviation[i, s, j] = outcome.deviation_m
            if outcome.tuned is not None:
                weights, unit = outcome.tuned.weights, path.flow.system.unit[3]
                impulse[i, s, j] = weights.impulse * unit
                velocity[i, s, j] = weights.velocity * unit
                targets[i, s, j] = len(weights.targets)
                survivors_tuning[i, s, j] = outcome.tuned.survivors
        survivors = counts[STATUSES.index("completed")]
        low, high = ratio_interval(survivors, spec.cases, spec.confidence)
        free_low, free_high = ratio_interval(
            free[STATUSES.index("completed")], spec.cases, spec.confidence
        )
        ctx.info(f"{len(wanted)} combinations of {spec.cases} flights each")
        labels = tuple(h.label for h in held)
        return StationKeepingFlown(
            labels=labels,
            status=tuple(h.status for h in held),
            stable=stable,
            strategies=spec.strategies,
            intervals=tuple(names),
            interval_s=interval,
            period_s=period,
            unstable_time_s=np.array([h.e_folding_s for h in held]),
            flown=flown,
            statuses=STATUSES,
            counts=counts,
            uncorrected_counts=free,
            uncorrected_low=np.where(there, free_low, np.nan),
            uncorrected_high=np.where(there, free_high, np.nan),
            low=np.where(flown, low, np.nan),
            high=np.where(flown, high, np.nan),
            cost_m_s=cost,
            cost_95_m_s=cost_95,
            deviation_m=deviation,
            tuned_impulse_m_s=impulse,
            tuned_velocity_m_s=velocity,
            tuned_targets=targets,
            tuning_survivors=survivors_tuning,
            index_m_s=_index_of(labels, index),
            cases=spec.cases,
            tuning_cases=spec.tuning_cases,
            seed=ctx.seed,
            duration_s=spec.duration_s,
            survival_required=spec.survival_required,
            confidence=spec.confidence,
            injection_m=spec.injection_position_m,
            injection_m_s=spec.injection_velocity_m_s,
            navigation_m=spec.navigation_position_m,
            navigation_m_s=spec.navigation_velocity_m_s,
            execution_magnitude=spec.execution_magnitude,
            execution_pointing_rad=spec.execution_pointing_rad,
            minimum_impulse_m_s=spec.minimum_impulse_m_s,
            limit_factor=spec.limit_factor,
            distance_max_m=spec.distance_max_m,
        )

    def present(
        self,
        product: StationKeepingFlown,
        orbits: tuple[OrbitSet, ...] = (),
        flights: tuple[FlightSet, ...] = (),
        ladder: FidelityLadder | None = None,
        index: StationKeepingIndex | None = None,
    ) -> Presentation:
        """Show survival, cost and the longest intervals."""
        return present_flown(product, self.spec.label)


def _index_of(labels: Sequence[str], index: StationKeepingIndex | None) -> Array:
    """Return the index (M,) of the members of the same names."""
    known = {} if index is None else dict(zip(index.labels, index.v_cm_m_s.tolist(), strict=True))
    return np.array([known.get(label, nan) for label in labels], dtype=float)
