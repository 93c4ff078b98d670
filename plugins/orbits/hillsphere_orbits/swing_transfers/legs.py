"""The search of one leg through all families, as pieces for the workers of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Compiled, flow_of
from hillsphere_orbits.swing_qso_families.curves import FamilyTangents, Swing
from hillsphere_orbits.swing_qso_families.products import SwingFamilies
from hillsphere_orbits.swing_transfers.assembly import (
    Choice,
    Pair,
    assemble_transfers,
    join_transfers,
    none,
    select_transfers,
)
from hillsphere_orbits.swing_transfers.chains import Scan, scan
from hillsphere_orbits.swing_transfers.passages import Passages, passages
from hillsphere_orbits.swing_transfers.products import Transfers
from hillsphere_orbits.swing_transfers.search import END, INTERIOR, Minimum
from hillsphere_orbits.swing_transfers.zoom import Pieces, least_along, search
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.pareto import front

__all__ = ["Leg", "LegSearch", "Members", "ScannedFamily", "SearchedLeg"]

_ASIDE = (1e-6, 1e-5, 1e-4, 1e-3)  # on a piece
_AGREES = 1e-5  # normalised cost by which a tangent orbit may exceed its estimate
_COARSE = 2  # times fewer sub-steps than for rounding: errors of 3e-10


@dataclass(frozen=True)
class Members:
    """The members of all families that connect the orbits of one leg.

    Parameters
    ----------
    family : ndarray of int, shape (K,)
        Their families.
    position : ndarray, shape (K,)
        Their places on the chains.
    dv, angle, integral : ndarray, shape (K,)
        Least cost of the leg, mean angle at which the orbits meet, and integral, normalised.
    """

    family: NDArray[np.int64]
    position: Array
    dv: Array
    angle: Array
    integral: Array


@dataclass(frozen=True)
class Leg:
    """A leg to be searched.

    Parameters
    ----------
    number : int
        Its number.
    names : (str, str)
        Departure and arrival orbit.
    scans : sequence of Scan
        What the members of every family meet.
    known : sequence of Known
        What else is known of every family.
    """

    number: int
    names: tuple[str, str]
    scans: Sequence[Scan]
    known: Sequence[FamilyTangents]


@dataclass(frozen=True)
class ScannedFamily:
    """Scan of one family.

    Parameters
    ----------
    scan : Scan
        What its members meet.
    known : FamilyTangents
        What was worked out for it, which the search of a leg need not do again.
    """

    scan: Scan
    known: FamilyTangents


@dataclass(frozen=True)
class SearchedLeg:
    """Result of the search of one leg.

    Parameters
    ----------
    least : Transfers
        The cheapest transfer through every family.
    front : Transfers
        The Pareto front in cost and time.
    members : Members
        Every member that connects the orbits.
    notes : list of str
        Sentences for the report.
    """

    least: Transfers
    front: Transfers
    members: Members
    notes: list[str]


@dataclass(frozen=True, eq=False)
class LegSearch:
    """Data common to the searches of all legs; see `hillsphere.runs.workers.Divisible`.

    Its pieces are numbers of families, whose members are scanned, and then the legs.

    Parameters
    ----------
    compiled : Compiled
        Equations of motion.
    swing : SwingFamilies
        The families.
    orbits : mapping of str to (ndarray, float, float)
        State (6,), period and integral of the orbits at the ends of the legs, normalised.
    dearest : float
        Times the least cost that transfers on the front may cost.
    """

    compiled: Compiled
    swing: SwingFamilies
    orbits: Mapping[str, tuple[Array, float, float]]
    dearest: float

    def prepare(self) -> Callable[[int | Leg], ScannedFamily | SearchedLeg]:
        """Return the function that does a piece.

        Raises
        ------
        InputError
            If an orbit is no closed curve about the body.
        StageError
            If the families are those of other equations.
        """
        return _Searching(self)


class _Searching:
    """Scans families and searches legs with one compiled flow."""

    def __init__(self, work: LegSearch) -> None:
        self._plant, self._dearest = work.compiled.plant, work.dearest
        flow = flow_of(self._plant)
        self._chains = Swing(work.swing, self._plant)
        self._orbits = {
            name: PolarOrbit(flow, x0, period, name)
            for name, (x0, period, _) in work.orbits.items()
        }
        self._integral = {name: integral for name, (_, _, integral) in work.orbits.items()}

    def __call__(self, piece: int | Leg) -> ScannedFamily | SearchedLeg:
        if isinstance(piece, int):
            scanned = scan(self._chains, piece, self._orbits, _COARSE)
            return ScannedFamily(scanned, self._chains.tangents(piece))
        for family, known in enumerate(piece.known):
            self._chains.learn(family, known)
        (a, b), scans = piece.names, piece.scans
        pair = Pair(
            piece.number, self._orbits[a], self._orbits[b], (self._integral[a], self._integral[b])
        )
        least, notes = self._least(scans, pair, (a, b))
        ways = [passages(s.met[a], s.met[b], s.period) for s in scans]
        front = self._front(scans, pair, (a, b), ways, least)
        return SearchedLeg(least, front, _members(self._chains.product, scans, ways), notes)

    def _least(
        self, scans: Sequence[Scan], pair: Pair, names: tuple[str, str]
    ) -> tuple[Transfers, list[str]]:
        """Return the transfer of least cost along every family that connects two orbits.

        And sentences on what could not be found so.
        """
        chains, orbits = self._chains, self._orbits
        coarse = search(chains, scans, names, orbits)
        if not coarse:
            return none(), []
        pieces, minima_found = least_along(chains, names, orbits, coarse)
        made = self._assemble(pieces, pair, minima_found)
        own = made.family.tolist()
        positions = [pieces.position(k, u) for k, u in zip(own, made.position, strict=True)]
        made = replace(
            made,
            position=np.array(positions, dtype=float),
            family=np.array([pieces.whole[k] for k in own], dtype=np.int64),
        )
        # a minimum that is lost when it is looked into leaves the best member of its family
        lost = {m.family for m in coarse} - set(made.family.tolist())
        spare = [_best_member(s, names) for s in scans if s.family in lost]
        notes = [
            f"{' to '.join(names)}: the minimum along {chains.product.name(choice.family)} is not "
            "there on a finer look; the best of its members stands in its place"
            for choice in spare
        ]
        return join_transfers([made, assemble_transfers(chains, self._plant, pair, spare)]), notes

    def _assemble(self, pieces: Pieces, pair: Pair, minima: Sequence[Minimum]) -> Transfers:
        """Return the transfers of minima.

        An orbit that just touches another one misses it if rounding, magnified by the flow, has
        it so. Then the nearest one beside it that does meet the other is taken.
        """
        speed = float(pair.start.flow.system.unit[3])

        def choice(m: Minimum, aside: float) -> Choice:
            last = pieces.branch(m.family).size - 1.0
            kind = m.kind if m.kind in (INTERIOR, END) else f"touches {m.kind}"
            return Choice(m.family, min(max(m.u + aside, 0.0), last), kind)

        made = assemble_transfers(pieces, self._plant, pair, [choice(m, 0.0) for m in minima])
        for aside in _ASIDE:
            dv = dict(zip(made.family.tolist(), made.total_m_s / speed, strict=True))
            missed = [m for m in minima if not dv.get(m.family, np.inf) < m.dv + _AGREES]
            if not missed:
                break
            more = [choice(m, side) for m in missed for side in (-aside, aside)]
            every = join_transfers([made, assemble_transfers(pieces, self._plant, pair, more)])
            order = np.lexsort((every.total_m_s, every.family))
            first = np.unique(every.family[order], return_index=True)[1]
            made = select_transfers(every, order[first])
        return made

    def _front(
        self,
        scans: Sequence[Scan],
        pair: Pair,
        names: tuple[str, str],
        ways: Sequence[Passages],
        least: Transfers,
    ) -> Transfers:
        """Return the Pareto front of a leg in cost and time, up to a cost."""
        chains = self._chains
        total = np.concatenate([w.total for w in ways]) if ways else np.empty(0)
        limit = self._dearest * float(np.min(least.total_m_s, initial=np.inf))
        limit /= chains.flow.system.unit[3]
        tof = np.concatenate([w.tof for w in ways]) if ways else np.empty(0)
        source = np.repeat(np.arange(len(ways)), [w.total.size for w in ways])
        begin = np.concatenate([[0], np.cumsum([w.total.size for w in ways])])
        choices = []
        seen: set[tuple[float, float]] = set()
        for k in np.flatnonzero(front(np.where(total <= limit, total, np.inf), tof)).tolist():
            key = (round(float(total[k]), 7), round(float(tof[k]), 7))
            if key in seen:  # a mirror image
                continue
            seen.add(key)
            s, w = scans[int(source[k])], ways[int(source[k])]
            i = k - int(begin[source[k]])
            lane = int(w.lane[i])
            phases = (
                float(s.met[names[0]].time[w.departure[i]] / s.period[lane]),
                float(s.met[names[1]].time[w.arrival[i]] / s.period[lane]),
            )
            choices.append(Choice(s.family, float(lane), "member", phases))
        every = join_transfers([least, assemble_transfers(chains, self._plant, pair, choices)])
        dear = limit * chains.flow.system.unit[3] * (1.0 + 1e-9)
        cost = np.where(every.total_m_s <= dear, every.total_m_s, np.inf)
        on = np.flatnonzero(front(cost, every.tof_s))
        return select_transfers(every, on[np.argsort(every.tof_s[on])])


def _best_member(scanned: Scan, names: tuple[str, str]) -> Choice:
    total = scanned.least(names[0]) + scanned.least(names[1])
    return Choice(scanned.family, float(np.argmin(total)), "member")


def _members(swing: SwingFamilies, scans: Sequence[Scan], ways: Sequence[Passages]) -> Members:
    """Return cost, angle and integral of every member that connects the orbits of a leg."""
    parts: list[tuple[Array, Array, Array, Array, Array]] = []
    for s, w in zip(scans, ways, strict=True):
        chosen = w.cheapest(s.period.size)
        lanes = np.flatnonzero(chosen >= 0)
        own = swing.curve.integral[swing.curve_family == s.family]
        parts.append(
            (np.full(lanes.size, float(s.family)), lanes.astype(float), w.total[chosen[lanes]],
             w.angle[chosen[lanes]], own[lanes])
        )  # fmt: skip
    columns = [np.concatenate([p[k] for p in parts]) if parts else np.empty(0) for k in range(5)]
    return Members(columns[0].astype(np.int64), columns[1], columns[2], columns[3], columns[4])
