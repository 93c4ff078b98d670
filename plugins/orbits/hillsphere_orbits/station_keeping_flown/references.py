"""References for station-keeping, from the products of earlier stages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Plant
from hillsphere.products import FlightSet, OrbitSet, PeriodicOrbits, Trajectories
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.stability import multipliers
from hillsphere_orbits.station_keeping_flown.reference_path import (
    ReferencePath,
    paths_of_flights,
    paths_of_orbits,
)

__all__ = ["FLOWN", "Reference", "Sources", "references_of"]

FLOWN = "flown"
_ENDS = 1e-9
"""Relative slack of durations: a flight just as long as asked must not fail by rounding."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference orbit or trajectory for station-keeping.

    Parameters
    ----------
    label : str
        Its name.
    path : ReferencePath or None
        None if it cannot be flown.
    status : str
        ``"flown"``, or why it cannot be.
    period_s : float
        NaN if it has none.
    e_folding_s : float
        Mean time in which the largest multiplier makes a deviation grow e-fold; infinite for a
        stable orbit, NaN for a reference without period.
    """

    label: str
    path: ReferencePath | None
    status: str = FLOWN
    period_s: float = nan
    e_folding_s: float = nan

    @property
    def stable(self) -> bool:
        """Whether it can be flown and has no unstable direction."""
        return self.path is not None and self.path.unstable == 0


@dataclass(frozen=True, eq=False)
class Sources:
    """Products that provide references, and the members to take.

    Parameters
    ----------
    orbits : tuple of OrbitSet
        Periodic orbits.
    flights : tuple of FlightSet
        Other trajectories.
    ladder : FidelityLadder or None
        Orbits carried over to other equations.
    rung : str
        Name of its rung.
    members : tuple of str
        Names of the members to take; empty for all.
    """

    orbits: tuple[OrbitSet, ...]
    flights: tuple[FlightSet, ...]
    ladder: FidelityLadder | None
    rung: str
    members: tuple[str, ...]

    def select(self, labels: tuple[str, ...]) -> list[int]:
        """Return the numbers of the members to take."""
        return [i for i, name in enumerate(labels) if not self.members or name in self.members]


def references_of(plant: Plant, sources: Sources, duration_s: float) -> list[Reference]:
    """Return the references of all sources.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    sources : Sources
        Periodic orbits, trajectories, and the ladder, in this order.
    duration_s : float
        For how long; a trajectory that ends before is not flown, and says so.

    Returns
    -------
    list of Reference
        In order.

    Raises
    ------
    StageError
        If nothing is handed on, or something belongs to other equations.
    InputError
        If the ladder has no such rung, or nothing has a name that is asked for.
    """
    references: list[Reference] = []
    known: list[str] = []
    if sources.orbits:
        members = members_of(*sources.orbits)
        known += members.labels
        references += _of_orbits(plant, members, sources.select(members.labels))
    for product in sources.flights:
        known += product.flights.labels
        chosen = _select_flights(product.flights, sources.select(product.flights.labels))
        references += _of_flights(plant, chosen, duration_s)
    if sources.ladder is not None:
        known += sources.ladder.members
        references += _of_ladder(plant, sources.ladder, sources, duration_s)
    if unknown := [name for name in sources.members if name not in known]:
        raise InputError(
            f"members: nothing is called {unknown[0]!r}; there are: {', '.join(known) or 'none'}"
        )
    if not references:
        raise StageError("the stages named in needs provide no reference to hold")
    return references


def _of_orbits(plant: Plant, orbits: PeriodicOrbits, which: list[int]) -> list[Reference]:
    if not which:
        return []
    some = replace(
        orbits,
        x0=np.ascontiguousarray(orbits.x0[:, which]),
        period_s=orbits.period_s[which],
        integral=orbits.integral[which],
        monodromy=np.ascontiguousarray(orbits.monodromy[:, :, which]),
        residual=orbits.residual[which],
        labels=tuple(orbits.labels[i] for i in which),
    )
    growth = np.log(np.maximum(np.abs(multipliers(some.monodromy)[0]), 1.0))
    references = []
    for i, path in enumerate(paths_of_orbits(plant, some)):
        period = float(some.period_s[i])
        e_folding = period / float(growth[i]) if path.unstable else inf
        references.append(Reference(some.labels[i], path, FLOWN, period, e_folding))
    return references


def _select_flights(flights: Trajectories, which: list[int]) -> Trajectories:
    return replace(
        flights,
        plans=tuple(flights.plans[i] for i in which),
        labels=tuple(flights.labels[i] for i in which),
        t_s=flights.t_s[:, which],
        x=flights.x[:, :, which],
    )


def _of_flights(plant: Plant, flights: Trajectories, duration_s: float) -> list[Reference]:
    time = flow_of(plant).system.time_unit_s
    references = []
    for label, path in zip(flights.labels, paths_of_flights(plant, flights), strict=True):
        if path.length * time < duration_s * (1.0 - _ENDS):
            days = path.length * time / DAY_S
            references.append(Reference(label, None, f"not flown: it lasts {days:.4g} days only"))
        else:
            references.append(Reference(label, path))
    return references


def _of_ladder(
    plant: Plant, ladder: FidelityLadder, sources: Sources, duration_s: float
) -> list[Reference]:
    if sources.rung not in ladder.rungs:
        raise InputError(
            f"rung: the ladder has no rung {sources.rung!r}; it has {', '.join(ladder.rungs)}"
        )
    r = ladder.rungs.index(sources.rung)
    references = []
    for i in sources.select(ladder.members):
        label = ladder.members[i]
        if not ladder.converged[i, r]:
            why = ladder.status[r * len(ladder.members) + i]
            references.append(Reference(label, None, f"not flown: {why}"))
            continue
        t, x = ladder.reference(sources.rung, label)
        references += _of_flights(plant, _flight(plant, ladder.frames[r], label, t, x), duration_s)
    return references


def _flight(plant: Plant, frame: str, label: str, t: Array, x: Array) -> Trajectories:
    names = tuple(v.name for v in plant.states)
    if len(names) != len(x):
        raise StageError(
            f"the rung has {len(x)} states, this stage's plant {len(names)}; name the plant of "
            "that rung"
        )
    return Trajectories(frame, names, (label,), (label,), t[:, None], x[:, :, None])
