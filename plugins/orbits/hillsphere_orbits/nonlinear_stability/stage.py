"""The stage ``nonlinear_stability``: largest offsets that orbits survive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.cases.case_classes import ratio_interval
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere_orbits.nonlinear_stability.edges import Edges, first_losses
from hillsphere_orbits.nonlinear_stability.nearby_resonances import (
    NearbyResonance,
    nearby_resonances,
)
from hillsphere_orbits.nonlinear_stability.presentation import present_stability
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.sampled_orbits import (
    SampledOrbits,
    require_states,
    retrace,
)
from hillsphere_orbits.nonlinear_stability.specs import NonlinearStabilitySpec
from hillsphere_orbits.nonlinear_stability.survival import Fate, Fates, Survival
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.survey import NEARLY_PLANAR

__all__ = ["NonlinearStabilityStage"]

_AXES = ("x", "y", "z", "vx", "vy", "vz")
_REACH = 0.5
"""Largest offset of the search without a limit of the mission, in amplitudes of the orbit: beyond
it a flight is no perturbation of that orbit any more."""
_ON_ORBIT = 1e-9  # natural units: how exactly a place on an orbit is known


class NonlinearStabilityStage:
    """Stability radii, survival probabilities and nearby resonances of periodic orbits.

    Parameters
    ----------
    spec : NonlinearStabilitySpec
        With its references bound.
    """

    def __init__(self, spec: NonlinearStabilitySpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        require_states(self.plant.states, "survival")

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...],
    ) -> NonlinearStability:
        """Fly the members of the families with offsets.

        Parameters
        ----------
        ctx : Context
            Random numbers and progress.
        orbits : tuple of OrbitSet
            Whose members are tried.

        Returns
        -------
        NonlinearStability
            One row per member. The draws of an orbit depend on the mission's seed, its name and
            the phase only.

        Raises
        ------
        InputError
            If the plant has other states than position and velocity in space.
        StageError
            If the orbits belong to other equations.
        """
        spec = self.spec
        given = members_of(*orbits)
        trial = _Trial(self.plant, spec, given, ctx.track("flights with an offset"))
        members = len(given.labels)
        every = np.arange(members)
        reference = trial.fly(every, trial.start)
        names, direction = _directions(spec.random_directions, ctx.rng("directions"))
        largest, edges = trial.edges(direction, reference)
        counts = np.zeros((len(Fate), members, len(spec.phases)), dtype=np.int64)
        median = np.full(counts.shape[1:], np.nan)
        for k, phase in enumerate(spec.phases):
            start = trial.at_phase(phase)
            errors = [_draws(spec, ctx, f"{name}, phase {phase!r}") for name in given.labels]
            lanes = np.repeat(every, spec.draws)
            fates = trial.fly(lanes, start[:, lanes] + trial.normalise(np.hstack(errors)))
            table = fates.fate.reshape(members, spec.draws)
            counts[:, :, k] = [np.count_nonzero(table == fate, axis=1) for fate in Fate]
            times = fates.time.reshape(table.shape)
            for i in np.flatnonzero((table != Fate.SURVIVES).any(axis=1)):
                median[i, k] = np.median(times[i, table[i] != Fate.SURVIVES])
        low, high = ratio_interval(counts[Fate.SURVIVES], spec.draws, spec.confidence)
        offset = _prescribed_offsets(spec)
        asked = np.repeat(every, offset.shape[1])
        told = trial.fly(asked, trial.start[:, asked] + np.tile(trial.normalise(offset), members))
        near = _near(orbits, spec)
        unit, time = given.length_m, trial.survival.system.time_unit_s
        ctx.info(f"{trial.flights} flights; largest change of the integral {trial.drift:.1e}")
        return NonlinearStability(
            labels=given.labels,
            amplitude_m=trial.around.amplitude * unit,
            limit_m=trial.limits * unit,
            reference_fate=reference.fate,
            reference_time_s=reference.time * time,
            directions=names,
            direction=direction,
            largest=largest,
            survived=edges.survived.reshape(largest.shape),
            lost=edges.lost.reshape(largest.shape),
            lost_fate=edges.fate.reshape(largest.shape),
            lost_time_s=edges.time.reshape(largest.shape) * time,
            phases=np.array(spec.phases, dtype=float),
            counts=counts,
            low=low,
            high=high,
            median_loss_s=median * time,
            offset=offset,
            offset_fate=told.fate.reshape(members, -1),
            offset_time_s=told.time.reshape(members, -1) * time,
            near_member=np.array([r.member for r in near], dtype=np.int64),
            near_plane=tuple(r.plane for r in near),
            near_d=tuple(r.d for r in near),
            near_n=tuple(r.n for r in near),
            near_x_m=np.array([r.x_m for r in near], dtype=float),
            near_distance_m=np.array([r.distance_m for r in near], dtype=float),
            near_vy_offset_m_s=np.array([r.vy_offset_m_s for r in near], dtype=float),
            draws=spec.draws,
            confidence=spec.confidence,
            sigma_position_m=spec.sigma_position_m,
            sigma_velocity_m_s=spec.sigma_velocity_m_s,
            duration_s=spec.duration_s,
            limit=spec.limit,
            doublings=spec.doublings,
            scan=spec.scan,
            flights=trial.flights,
            drift=trial.drift,
            has_surface="impact" in trial.survival.system.events,
        )

    def present(
        self,
        product: NonlinearStability,
        orbits: tuple[OrbitSet, ...] = (),
    ) -> Presentation:
        """Show radii, probabilities, edges and resonances."""
        return present_stability(product, self.spec.label)


def _near(orbits: tuple[OrbitSet, ...], spec: NonlinearStabilitySpec) -> list[NearbyResonance]:
    """Return the resonances near the members of planar families, numbered among all members."""
    resonances: list[NearbyResonance] = []
    before = 0
    for family in orbits:
        if isinstance(family, QsoFamily):
            near = nearby_resonances(family, spec.n_max, spec.resonance_distance_m)
            resonances += [replace(one, member=one.member + before) for one in near]
        before += len(family.members.labels)
    return resonances


class _Trial:
    """The orbits of a run with their limits and a propagator for batches of offsets."""

    def __init__(
        self,
        plant: Plant,
        spec: NonlinearStabilitySpec,
        orbits: PeriodicOrbits,
        tick: Callable[[int], None],
    ) -> None:
        self.survival = Survival(plant, spec.accuracy)
        self.around: SampledOrbits = retrace(self.survival.map, orbits)
        self.start = np.ascontiguousarray(self.around.way[:, 0])
        amplitude = self.around.amplitude
        self.limits = spec.limit * amplitude
        # nearly planar orbits have no limit on z
        self.limits[2, amplitude[2] <= NEARLY_PLANAR * np.max(amplitude, axis=0)] = np.inf
        self.flights = 0
        self.drift = 0.0 if self.survival.has_integral else float("nan")
        self._spec, self._tick = spec, tick

    def normalise(self, offsets: Array) -> Array:
        """Return SI offsets (6, N) in the units of the flights."""
        return offsets / self.survival.system.unit[:, None]

    def fly(self, orbit: NDArray[np.intp], x: Array) -> Fates:
        """Fly states (6, N) that belong to the orbits (N,)."""
        duration = self._spec.duration_s / self.survival.system.time_unit_s
        fates = self.survival.fly(x, self.limits[:, orbit], duration, self._tick)
        self.flights += orbit.size
        told = fates.drift[fates.fate != Fate.UNRESOLVED]
        self.drift = float(np.max(np.abs(told), initial=self.drift))
        return fates

    def at_phase(self, phase: float) -> Array:
        """Return the states (6, M) of the orbits at a phase, in parts of their period."""
        if phase == 0.0:
            return self.start
        fly, states = self.survival.map, []
        # each alone, with its own sub-steps: no result may depend on the other orbits
        for i in range(self.start.shape[1]):
            one, span = self.start[:, [i]], phase * self.around.period[[i]]
            states.append(fly.propagate(one, span, fly.choose_steps(one, span, _ON_ORBIT)))
        return np.ascontiguousarray(np.hstack(states))

    def edges(self, direction: Array, reference: Fates) -> tuple[Array, Edges]:
        """Search all directions (6, D) of all orbits.

        Returns
        -------
        largest : ndarray, shape (M, D)
            Offsets at which the search ended, SI.
        edges : Edges
            Of M·D rows.
        """
        members, count = self.start.shape[1], direction.shape[1]
        unit = self.survival.system.unit
        reach = _REACH * self.around.amplitude[0]
        spec = self._spec
        far = np.full(members, spec.position_max_m) if spec.position_max_m else reach * unit[0]
        fast = np.full(members, spec.velocity_max_m_s) if spec.velocity_max_m_s else reach * unit[3]
        is_velocity = direction[3:].any(axis=0)
        largest = np.where(is_velocity, fast[:, None], far[:, None])
        step = self.normalise(direction)

        def judge(row: NDArray[np.intp], offset: Array) -> Fates:
            orbit, k = np.divmod(row, count)
            return self.fly(orbit, self.start[:, orbit] + step[:, k] * offset)

        # an orbit that is lost without an offset has the radius zero
        keeps = np.repeat(~reference.lost, count)
        rows = np.flatnonzero(keeps)
        losses = first_losses(
            lambda row, offset: judge(rows[row], offset),
            largest.ravel()[rows], spec.doublings, spec.scan,
        )  # fmt: skip
        every = Edges(
            np.zeros(keeps.size), np.zeros(keeps.size), np.repeat(reference.fate, count),
            np.repeat(reference.time, count), losses.flights,
        )  # fmt: skip
        for name in ("survived", "lost", "fate", "time"):
            getattr(every, name)[rows] = getattr(losses, name)
        return largest, every


def _directions(drawn: int, rng: np.random.Generator) -> tuple[tuple[str, ...], Array]:
    """Return names and unit vectors (6, D): both senses of each axis, and random directions."""
    names: list[str] = []
    vectors: list[Array] = []
    for first, what in ((0, "position"), (3, "velocity")):
        for axis in range(first, first + 3):
            for sign, mark in ((1.0, "+"), (-1.0, "-")):
                names.append(mark + _AXES[axis])
                vectors.append(np.where(np.arange(6) == axis, sign, 0.0))
        for i in range(drawn):
            vector = np.zeros(6)
            vector[first : first + 3] = rng.normal(size=3)
            names.append(f"{what} {i + 1}")
            vectors.append(vector / np.linalg.norm(vector))
    return tuple(names), np.array(vectors).T


def _draws(spec: NonlinearStabilitySpec, ctx: Context, stream: str) -> Array:
    """Return injection errors (6, draws), SI."""
    sigma = np.repeat([spec.sigma_position_m, spec.sigma_velocity_m_s], 3)
    return np.asarray((ctx.rng(stream).normal(size=(spec.draws, 6)) * sigma).T)


def _prescribed_offsets(spec: NonlinearStabilitySpec) -> Array:
    """Return the offsets given in the mission (6, Q), SI."""
    zero = (0.0, 0.0, 0.0)
    rows = [(*r, *zero) for r in spec.position_offsets_m]
    rows += [(*zero, *v) for v in spec.velocity_offsets_m_s]
    return np.array(rows, dtype=float).reshape(-1, 6).T
