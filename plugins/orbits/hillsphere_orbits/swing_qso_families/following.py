"""Continuation and survey of families, group by group, for the workers of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hillsphere.errors import ConvergenceError, PropagationError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.flow import Compiled, Flow, flow_of
from hillsphere_orbits.secondary import Secondary, secondary
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.survey import Surveyor
from hillsphere_orbits.swing_qso_families.curves import at_positions, swing_problem
from hillsphere_orbits.swing_qso_families.description import distances, errors, largest_multiplier
from hillsphere_orbits.swing_qso_families.families import Chain, Limits, follow
from hillsphere_orbits.swing_qso_families.starts import Start

__all__ = ["FollowedGroup", "Following", "SurveyedFamily", "surveyor_of"]


@dataclass(frozen=True)
class SurveyedFamily:
    """A family as far as it keeps the accuracy, with its stability and extent.

    Parameters
    ----------
    chain : Chain
        Its orbits, as far as they keep the accuracy.
    end : str
        Why it ends.
    half, closure : ndarray, shape (N,)
        Half-period residual and closure by another propagator.
    nearest, farthest : ndarray, shape (N,)
        Least and largest distance from the centre, normalised.
    monodromy : ndarray, shape (6, 6, N)
        Matrices of one period.
    events : Secondary
        Secondary bifurcations.
    unsearched : str
        Why these could not be looked for; empty if they were.
    """

    chain: Chain
    end: str
    half: Array
    closure: Array
    nearest: Array
    farthest: Array
    monodromy: Array
    events: Secondary
    unsearched: str = ""


@dataclass
class FollowedGroup:
    """Families followed from a group of starts.

    Parameters
    ----------
    families : dict of int to Surveyed
        By the start's place in the group.
    faults : list of str
        Which could not be followed, and why.
    remarks : dict of int to str
        Further remarks, by the start's place.
    """

    families: dict[int, SurveyedFamily] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    remarks: dict[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Following:
    """Data common to all groups; see `hillsphere.runs.workers.Divisible`.

    Parameters
    ----------
    compiled : Compiled
        Equations of motion.
    limits : Limits
        How far families are followed.
    accuracy : float
        Largest half-period residual in another propagator, normalised.
    secondary : bool
        Whether secondary bifurcations are looked for.
    """

    compiled: Compiled
    limits: Limits
    accuracy: float
    secondary: bool

    def prepare(self) -> Callable[[Sequence[Start]], FollowedGroup]:
        """Return the function that follows a group of starts."""
        plant = self.compiled.plant
        flow = flow_of(plant)
        surveyor = surveyor_of(plant, flow)

        def followed(starts: Sequence[Start]) -> FollowedGroup:
            chains, faults = follow(flow, starts, self.limits)
            group = FollowedGroup(faults=faults)
            places = {id(start): place for place, start in enumerate(starts)}
            for chain in chains:
                place, name = places[id(chain.start)], chain.start.name
                family = self._survey(flow, surveyor, chain)
                if family is None:
                    group.remarks[place] = (
                        f"{chain.start.d}:{chain.start.n} from the {chain.start.axis} axis: its "
                        f"orbits do not keep the accuracy {self.accuracy:g} when propagated anew"
                    )
                    continue
                group.families[place] = family
                if family.unsearched:
                    group.remarks[place] = (
                        f"{name}: secondary bifurcations could not be looked for "
                        f"({family.unsearched})"
                    )
            return group

        return followed

    def _survey(self, flow: Flow, surveyor: Surveyor, chain: Chain) -> SurveyedFamily | None:
        """Cut a family where it does not keep the accuracy any more, and look along it."""
        problem, z = chain.problem(flow), chain.branch.z
        half, closure = errors(surveyor, problem, z)
        monodromy = problem.monodromy(z)
        growth = np.maximum(1.0, 1e-3 * largest_multiplier(monodromy))
        beyond = closure > 10.0 * self.accuracy * growth
        if isinstance(problem, SymmetricShooting):
            beyond |= half > self.accuracy
        lost = np.flatnonzero(beyond)
        kept, end = z.shape[1], chain.branch.ends[1]
        if lost.size:
            kept = int(lost[0])
            end = f"the orbits do not keep the accuracy {self.accuracy:g} beyond; then {end}"
        if kept < 2:
            return None
        branch = Branch(z[:, :kept], chain.branch.tangent[:, :kept], ("it branches off", end))
        chain = replace(chain, branch=branch)
        events = Secondary((), (), np.empty(0), np.empty((2, 0), dtype=complex))
        unsearched = ""
        if self.secondary:
            regular = chain.regular_problem(flow)
            try:
                events = secondary(
                    lambda u: problem.monodromy(at_positions(regular, branch, u)),
                    monodromy[:, :, :kept],
                    integral=lambda u: surveyor.integral(
                        problem.state(at_positions(regular, branch, u))
                    ),
                )
            except (ConvergenceError, PropagationError) as error:
                unsearched = str(error)
        near, far = distances(problem, branch.z)
        return SurveyedFamily(
            chain, end, half[:kept], closure[:kept], near, far, monodromy[:, :, :kept], events,
            unsearched,
        )  # fmt: skip


def surveyor_of(plant: Plant, flow: Flow) -> Surveyor:
    """Return the surveyor of planar orbits of several revolutions of a plant."""
    return Surveyor(plant, swing_problem(flow, "x", mirror=False))
