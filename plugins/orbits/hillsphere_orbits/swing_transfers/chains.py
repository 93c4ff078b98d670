"""Families of planar periodic orbits between their members, and meetings with other orbits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.meetings import Meetings, Strands, meetings

__all__ = ["Chains", "Scan", "fly", "interpolate_unknowns", "least_of", "scan"]


class Chains(Protocol):
    """Families of planar periodic orbits, as `swing_qso_families.curves.Swing` gives them."""

    @property
    def flow(self) -> Flow:
        """The compiled flow."""
        ...

    @property
    def problem(self) -> Callable[[int], Shooting]:
        """Family → the equations of its orbits."""
        ...

    @property
    def branch(self) -> Callable[[int], Branch]:
        """Family → the chain of its orbits."""
        ...

    @property
    def families(self) -> range:
        """Numbers of the families."""
        ...

    def at(self, family: int, u: Array) -> Array:
        """Return corrected unknowns (m, N) at positions u (N,)."""
        ...


@dataclass(frozen=True)
class Scan:
    """Meetings of the members of one family's chain with the orbits.

    Parameters
    ----------
    family : int
        The family.
    period : ndarray, shape (N,)
        Of its members.
    met : mapping of str to Meetings
        By name of the orbit that is met; the lanes are the members.
    """

    family: int
    period: Array
    met: Mapping[str, Meetings]

    def least(self, name: str) -> Array:
        """Return the least speed change (N,) between members and an orbit; infinite without."""
        return least_of(self.met[name], self.period.size)


def least_of(met: Meetings, lanes: int) -> Array:
    """Return the least speed change (lanes,) of the meetings of every lane."""
    least = np.full(lanes, np.inf)
    np.minimum.at(least, met.lane, met.dv)
    return least


def fly(chains: Chains, family: NDArray[np.intp], z: Sequence[Array], coarse: int = 1) -> Strands:
    """Propagate orbits of families, z[k] (m,) of family[k], over their periods.

    With `coarse` they take so many times fewer sub-steps than for rounding.
    """
    x0, period = np.empty((6, len(z))), np.empty(len(z))
    steps = 1
    for f in sorted(set(family.tolist())):
        own = np.flatnonzero(family == f)
        problem, unknowns = chains.problem(f), np.array([z[k] for k in own.tolist()]).T
        x0[:, own], period[own] = problem.state(unknowns), problem.period(unknowns)
        steps = max(steps, _whole(problem, unknowns))
    return Strands.fly(chains.flow, x0, period, -(-steps // coarse))


def _whole(problem: Shooting, z: Array) -> int:
    """Return the sub-steps of a full period, from those of the flight that is solved."""
    return problem.steps * round(float(problem.period(z)[0] / z[-1, 0]))


def scan(chains: Chains, family: int, orbits: Mapping[str, PolarOrbit], coarse: int) -> Scan:
    """Find the meetings of the members of a family's chain with the orbits.

    Parameters
    ----------
    chains : Chains
        The families.
    family : int
        Which.
    orbits : mapping of str to PolarOrbit
        The orbits that may be met.
    coarse : int
        Times fewer sub-steps than for rounding; the error grows with its eighth power.

    Returns
    -------
    Scan
        Of every member.
    """
    z = chains.branch(family).z
    strands = fly(chains, np.full(z.shape[1], family), list(z.T), coarse)
    met = {name: meetings(orbit, strands) for name, orbit in orbits.items()}
    return Scan(family, chains.problem(family).period(z), met)


def interpolate_unknowns(chains: Chains, family: NDArray[np.intp], u: Array) -> list[Array]:
    """Return the unknowns at positions u (K,) of families (K,), interpolated on their chains."""
    return [
        chains.branch(int(f)).guess(np.array([place]))[0][:, 0]
        for f, place in zip(family, u, strict=True)
    ]
