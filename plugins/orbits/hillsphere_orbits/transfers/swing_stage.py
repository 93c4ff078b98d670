"""The stage ``swing_transfers``: between planar orbits by way of families of swing orbits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.reference import ReferenceTable
from hillsphere.threads import in_threads
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.survey import LockedMoon
from hillsphere_orbits.swing.curves import Swing
from hillsphere_orbits.swing.products import SwingFamilies
from hillsphere_orbits.transfers.curves import PolarOrbit, step_map_of
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.pareto import front
from hillsphere_orbits.transfers.ranks import rank_correlations
from hillsphere_orbits.transfers.specs import SwingTransfersSpec
from hillsphere_orbits.transfers.swing_assembly import (
    Choice,
    Pair,
    assembled,
    joined,
    none,
    selected,
)
from hillsphere_orbits.transfers.swing_chains import Scan, scan
from hillsphere_orbits.transfers.swing_flights import flights_of
from hillsphere_orbits.transfers.swing_passages import Passages, passages
from hillsphere_orbits.transfers.swing_presentation import present_transfers
from hillsphere_orbits.transfers.swing_products import SwingTransfers, Transfers
from hillsphere_orbits.transfers.swing_routes import flown_routes
from hillsphere_orbits.transfers.swing_search import END, INTERIOR, Minimum
from hillsphere_orbits.transfers.swing_zoom import Pieces, least_along, search

__all__ = ["SwingTransfersStage", "energy_bound"]

_SAME_EQUATIONS = 1e-8
_TRACK_STEPS = 720
_ASIDE = (1e-6, 1e-5, 1e-4, 1e-3)  # on a piece
_AGREES = 1e-5  # of the cost, normalised: what a touching orbit may cost more than its estimate
_COARSE = 2  # times fewer sub-steps than for rounding: errors of 3e-10


@dataclass(frozen=True)
class _Members:
    """The members of all families that connect the orbits of one leg."""

    family: NDArray[np.int64]
    position: Array
    dv: Array
    angle: Array
    integral: Array


@dataclass(frozen=True)
class _Leg:
    """What was found for a leg: a transfer per family, the front, members, and what to log."""

    least: Transfers
    front: Transfers
    members: _Members
    notes: list[str]


class SwingTransfersStage:
    """Transfers between planar orbits by way of families of swing orbits.

    Parameters
    ----------
    spec : SwingTransfersSpec
        With its references bound.
    """

    def __init__(self, spec: SwingTransfersSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.reference and not {"leg", "dv_m_s"} <= set(self.reference.columns):
            raise InputError(
                "reference: the published costs need the columns leg and dv_m_s, got "
                f"{', '.join(self.reference.columns)}"
            )

    def run(self, ctx: Context, family: QsoFamily, swing: SwingFamilies) -> SwingTransfers:
        """Search every leg of every route.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        family : QsoFamily
            The orbits where transfers begin and end.
        swing : SwingFamilies
            The families that carry them.

        Returns
        -------
        SwingTransfers
            Legs that no family connects are said to be so; they are not an error.

        Raises
        ------
        InputError
            If a route names an orbit that the family does not have, or one that is no closed curve
            about the body.
        StageError
            If the orbits or families are those of other equations.
        """
        flow = flow_of(self.plant)
        names = self._orbits(family)
        legs = list(dict.fromkeys(pair for r in self.spec.routes for pair in pairwise(r)))
        orbits = self._curves(flow, family, names)
        integral = {name: float(family.members.integral[i]) for name, i in names.items()}
        chains = Swing(swing, self.plant)
        advance = ctx.track("swing transfers", len(chains.families) + len(legs) + 1)
        step_map_of(flow)  # compiled here, before threads ask for it
        scans: list[Scan] = []
        for scanned in in_threads(lambda f: scan(chains, f, orbits, _COARSE), chains.families):
            scans.append(scanned)
            advance(1)

        def searched(k: int) -> _Leg:
            a, b = legs[k]
            pair = Pair(k, orbits[a], orbits[b], (integral[a], integral[b]))
            least, notes = self._least(chains, scans, pair, orbits, (a, b))
            ways = [passages(s.met[a], s.met[b], s.period) for s in scans]
            front = self._front(chains, scans, pair, (a, b), ways, least)
            return _Leg(least, front, _members(swing, scans, ways), notes)

        found: list[_Leg] = []
        for leg in in_threads(searched, range(len(legs))):
            found.append(leg)
            for note in leg.notes:
                ctx.info(note)
            advance(1)
        least = [leg.least for leg in found]
        members = [leg.members for leg in found]
        every = joined(least) if least else none()
        routes = flown_routes(self.plant, orbits, legs, [tuple(r) for r in self.spec.routes], every)
        best = _cheapest_of_legs(every, len(legs))
        tracks = _tracks(flow, every, best)
        advance(1)
        ranks = [rank_correlations(m.dv, m.angle, m.integral) for m in members]
        of_least = [
            rank_correlations(t.total_m_s, np.mean(t.angle_rad, axis=0), t.integral) for t in least
        ]
        front_of_legs = joined([leg.front for leg in found]) if found else none()
        order = list(names)
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        speed = float(flow.system.unit[3])
        return SwingTransfers(
            flights=flights_of(
                orbits, legs, [swing.name(f) for f in chains.families], front_of_legs, every,
                routes,
            ),
            orbits=tuple(order),
            orbit_integral=np.array([integral[name] for name in order]),
            orbit_tracks_m=np.stack([orbits[n].track for n in order], axis=2)
            * float(flow.system.unit[0]),
            legs=tuple(f"{a} to {b}" for a, b in legs),
            departure=np.array([order.index(a) for a, _ in legs], dtype=np.int64),
            arrival=np.array([order.index(b) for _, b in legs], dtype=np.int64),
            bound_m_s=np.array(
                [energy_bound(orbits[a], orbits[b], integral[a], integral[b]) for a, b in legs]
            )
            * speed,
            status=tuple("found" if t.size else _why_not(scans, p) for t, p in
                         zip(least, legs, strict=True)),
            families=tuple(swing.name(f) for f in chains.families),
            d=swing.d,
            n=swing.n,
            least=every,
            front=front_of_legs,
            member_leg=np.repeat(np.arange(len(legs)), [m.dv.size for m in members]).astype(
                np.int64
            ),
            member_family=np.concatenate([m.family for m in members]),
            member_position=np.concatenate([m.position for m in members]),
            member_dv_m_s=np.concatenate([m.dv for m in members]) * speed,
            member_integral=np.concatenate([m.integral for m in members]),
            member_angle_rad=np.concatenate([m.angle for m in members]),
            rank=np.array(ranks),
            rank_of_least=np.array(of_least),
            routes=routes,
            track_leg=every.leg[best],
            tracks_m=tracks,
            frame=flow.system.frame,
            length_m=self.plant.scales.length_m,
            time_s=self.plant.scales.time_s,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )  # fmt: skip

    def present(
        self, product: SwingTransfers, family: QsoFamily, swing: SwingFamilies
    ) -> Presentation:
        """Show costs beside published ones, fronts, routes and what makes a transfer cheap."""
        return present_transfers(product, self.reference, self.spec.label)

    def _orbits(self, family: QsoFamily) -> dict[str, int]:
        """Return the numbers of the orbits in the routes, in the order of their first use."""
        labels = family.members.labels
        names = list(dict.fromkeys(name for route in self.spec.routes for name in route))
        if missing := [name for name in names if name not in labels]:
            raise InputError(
                f"routes: the family has no orbit {', '.join(map(repr, missing))}; it has "
                f"{', '.join(map(repr, labels))}"
            )
        return {name: labels.index(name) for name in names}

    def _curves(
        self, flow: Flow, family: QsoFamily, names: dict[str, int]
    ) -> dict[str, PolarOrbit]:
        """Return the orbits as closed curves, tried on this stage's equations."""
        system, orbits = flow.system, family.members
        x = orbits.x0 / system.unit[:, None]
        period = orbits.period_s / system.time_unit_s
        end = flow.with_matrix(x, period, flow.steps_for(x, period))[0]
        error = float(np.max(np.abs(end - x)))
        if orbits.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the family's orbits (frame {orbits.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; closure {error:.1e}); give the plant with "
                "which they were computed"
            )
        return {name: PolarOrbit(flow, x[:, i], period[i], name) for name, i in names.items()}

    def _least(
        self,
        chains: Swing,
        scans: Sequence[Scan],
        pair: Pair,
        orbits: dict[str, PolarOrbit],
        names: tuple[str, str],
    ) -> tuple[Transfers, list[str]]:
        """Return the transfer of least cost along every family that connects two orbits.

        And sentences on what could not be found so.
        """
        coarse = search(chains, scans, names, orbits)
        if not coarse:
            return none(), []
        pieces, found = least_along(chains, names, orbits, coarse)
        made = self._assembled(pieces, pair, found)
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
        return joined([made, assembled(chains, self.plant, pair, spare)]), notes

    def _assembled(self, pieces: Pieces, pair: Pair, found: Sequence[Minimum]) -> Transfers:
        """Return the transfers of minima.

        An orbit that just touches another one misses it if rounding, magnified by the flow, has
        it so. Then the nearest one beside it that does meet the other is taken.
        """
        speed = float(pair.start.flow.system.unit[3])

        def choice(m: Minimum, aside: float) -> Choice:
            last = pieces.branch(m.family).size - 1.0
            kind = m.kind if m.kind in (INTERIOR, END) else f"touches {m.kind}"
            return Choice(m.family, min(max(m.u + aside, 0.0), last), kind)

        made = assembled(pieces, self.plant, pair, [choice(m, 0.0) for m in found])
        for aside in _ASIDE:
            dv = dict(zip(made.family.tolist(), made.total_m_s / speed, strict=True))
            missed = [m for m in found if not dv.get(m.family, np.inf) < m.dv + _AGREES]
            if not missed:
                break
            more = [choice(m, side) for m in missed for side in (-aside, aside)]
            every = joined([made, assembled(pieces, self.plant, pair, more)])
            order = np.lexsort((every.total_m_s, every.family))
            first = np.unique(every.family[order], return_index=True)[1]
            made = selected(every, order[first])
        return made

    def _front(
        self,
        chains: Swing,
        scans: Sequence[Scan],
        pair: Pair,
        names: tuple[str, str],
        ways: Sequence[Passages],
        least: Transfers,
    ) -> Transfers:
        """Return the transfers of a leg that none betters in cost and time, up to a cost."""
        total = np.concatenate([w.total for w in ways]) if ways else np.empty(0)
        limit = self.spec.dearest * float(np.min(least.total_m_s, initial=np.inf))
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
        every = joined([least, assembled(chains, self.plant, pair, choices)])
        dear = limit * chains.flow.system.unit[3] * (1.0 + 1e-9)
        cost = np.where(every.total_m_s <= dear, every.total_m_s, np.inf)
        on = np.flatnonzero(front(cost, every.tof_s))
        return selected(every, on[np.argsort(every.tof_s[on])])


def energy_bound(start: PolarOrbit, end: PolarOrbit, first: float, last: float) -> float:
    """Sum of two impulses below which no orbit between two others can go.

    Parameters
    ----------
    start, end : PolarOrbit
        Departure and arrival orbit.
    first, last : float
        Their integrals, normalised.

    Returns
    -------
    float
        min over C of the bounds of both impulses, each at the place where its orbit is fastest
        (`hillsphere_orbits.transfers.energy`). With the speeds v₁(C), v₂(C) of the orbit in between
        at these places the slope of the sum is 1/v₁ − 1/v₂, whose sign is the same for all C
        because v₁² − v₂² is; the sum is therefore least at the C of one of the two orbits.
    """
    one = least_dv(start.largest_speed, first, last)
    two = least_dv(end.largest_speed, last, first)
    return float(np.minimum(one, two))


def _best_member(scanned: Scan, names: tuple[str, str]) -> Choice:
    total = scanned.least(names[0]) + scanned.least(names[1])
    return Choice(scanned.family, float(np.argmin(total)), "member")


def _members(swing: SwingFamilies, scans: Sequence[Scan], ways: Sequence[Passages]) -> _Members:
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
    return _Members(columns[0].astype(np.int64), columns[1], columns[2], columns[3], columns[4])


def _why_not(scans: Sequence[Scan], names: tuple[str, str]) -> str:
    """Say why no family connects two orbits."""
    if not scans:
        return "there is no family of swing orbits"
    silent = [n for n in names if not any(np.isfinite(s.least(n)).any() for s in scans)]
    if silent:
        return f"no member of any family meets {' or '.join(silent)}"
    return "no member of any family meets both orbits"


def _cheapest_of_legs(every: Transfers, legs: int) -> NDArray[np.intp]:
    """Return the numbers of the cheapest transfer of every leg that has one."""
    found = []
    for leg in range(legs):
        own = np.flatnonzero(every.leg == leg)
        if own.size:
            found.append(own[np.argmin(every.total_m_s[own])])
    return np.array(found, dtype=np.intp)


def _tracks(flow: Flow, every: Transfers, which: NDArray[np.intp]) -> Array:
    """Return positions (2, P, K), m, along transfers."""
    unit, clock = flow.system.unit[:, None], flow.system.time_unit_s
    x0, stepper = every.x0[:, which] / unit, step_map_of(flow)
    x: Array = x0
    if which.size:
        x = stepper.propagate(x0, every.departure_s[which] / clock, _TRACK_STEPS)
    way = stepper.trajectory(x, every.tof_s[which] / clock, _TRACK_STEPS)
    return np.ascontiguousarray(way[:2]) * float(flow.system.unit[0])
