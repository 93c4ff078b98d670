"""Transfers from pairs of legs: lower bounds, verification by propagation, Pareto fronts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.manifold_transfers.flights import (
    Coasts,
    VerifiedFlights,
    Waits,
    coasts_of,
    waits_of,
)
from hillsphere_orbits.manifold_transfers.products import ManifoldTransfers
from hillsphere_orbits.manifold_transfers.search import Legs, join_legs
from hillsphere_orbits.survey import LockedMoon
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import least_heights_m
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.pareto import front

__all__ = ["Case", "OrbitTransfers", "assemble_product"]

_STATES = 481  # of a coast that is handed on;
_EACH = 8  # sub-steps between two of them, so that it solves the equations near the body too

Fly: TypeAlias = Callable[[Sequence[Coasts | Waits]], Iterable[VerifiedFlights]]
"""Flies pieces, in order; see `LegFlights`."""


@dataclass(frozen=True, eq=False)
class OrbitTransfers:
    """Result of the search through one orbit, normalised.

    Parameters
    ----------
    status : str
        See `ManifoldTransfers`.
    multiplier : float
        Largest multiplier; NaN without a manifold.
    departure, arrival : Legs
        Ladders.
    trajectories : int
        Trajectories of the meshes.
    again : tuple of Legs, optional
        Both ladders found with twice the samples.
    unproved : int
        Trajectories on which it is not proved that no passage or impact was missed.
    """

    status: str
    multiplier: float
    departure: Legs
    arrival: Legs
    trajectories: int
    again: tuple[Legs, Legs] | None = None
    unproved: int = 0


@dataclass(frozen=True, eq=False)
class Case:
    """Data common to all transfers; see `ManifoldTransfers`."""

    plant: Plant
    flow: Flow
    orbits: PeriodicOrbits
    planar: tuple[PeriodicOrbits, PeriodicOrbits]
    curves: tuple[PolarOrbit, PolarOrbit]
    revolutions: NDArray[np.int64]
    z_m: Array
    mirrored: bool
    checked: tuple[str, ...]
    leg_limit_s: float
    distance: float
    start_distance: float
    closure_limit_m: float


def assemble_product(case: Case, results: Sequence[OrbitTransfers], fly: Fly) -> ManifoldTransfers:
    """Make the product.

    Parameters
    ----------
    case : Case
        What the transfers have in common.
    results : sequence of OrbitTransfers, length M
        Per orbit.
    fly : callable
        Flies pieces of legs, in order; see `hillsphere_orbits.manifold_transfers.flights`.

    Returns
    -------
    ManifoldTransfers
        All legs verified; the transfers on the Pareto front of each orbit.
    """
    system, scales = case.flow.system, case.plant.scales
    unit, speed = system.unit[:, None], scales.length_m / scales.time_s
    ladders = [legs for one in results for legs in (one.departure, one.arrival)]
    legs = join_legs([Legs.none(), *ladders])
    sizes = [part.p.size for part in ladders]
    member = np.repeat(np.arange(2 * len(results)) // 2, sizes).astype(np.int64)
    arrives = np.repeat(np.arange(2 * len(results)) % 2 == 1, sizes)
    again = [
        (ladder, np.full(ladder.p.size, k == 1))
        for one in results
        for k, ladder in enumerate(one.again or ())
    ]
    flown, *flown_again = _verify_legs(case, [(legs, arrives), *again], fly)
    legs = flown.legs
    energy = case.orbits.integral
    of = np.array([planar.integral[0] for planar in case.planar])
    bound = [
        least_dv(curve.largest_speed, c, energy) for curve, c in zip(case.curves, of, strict=True)
    ]
    local = least_dv(
        np.linalg.norm(legs.target[3:], axis=0), of[arrives.astype(int)], energy[member]
    )
    good = flown.good(case)
    pairs = _front(results, legs, good)
    entries, shift = _checks(case, results, legs, good, flown_again)
    moon = case.plant if isinstance(case.plant, LockedMoon) else None
    product = ManifoldTransfers(
        flights=Trajectories(
            system.frame, case.flow.names, (), (), np.empty((0, 0)), np.empty((6, 0, 0))
        ),
        departure=case.planar[0],
        arrival=case.planar[1],
        orbits=case.orbits,
        status=tuple(one.status for one in results),
        revolutions=case.revolutions,
        z_m=case.z_m,
        multiplier=np.array([one.multiplier for one in results]),
        bound_m_s=np.array(bound).reshape(2, -1) * speed,
        trajectories=np.array([one.trajectories for one in results], dtype=np.int64),
        leg_member=member,
        leg_arrives=arrives,
        leg_side=legs.side,
        leg_p=legs.p,
        leg_tof_s=legs.tof * scales.time_s,
        leg_dv_m_s=legs.dv * speed,
        leg_place_bound_m_s=local * speed,
        leg_near=legs.begin * unit,
        leg_orbit=legs.orbit * unit,
        leg_state=legs.state * unit,
        leg_target=legs.target * unit,
        leg_closure_km=flown.closure_km,
        leg_closure_m_s=flown.closure_m_s,
        leg_altitude_m=flown.altitude_m,
        leg_impact=flown.impact,
        transfer_legs=pairs,
        checked=tuple(
            label
            for label, one in zip(case.orbits.labels, results, strict=True)
            if one.again is not None
        ),
        check_entries=entries,
        check_shift_m_s=shift * speed,
        leg_limit_s=case.leg_limit_s,
        distance=case.distance,
        start_distance=case.start_distance,
        closure_limit_m=case.closure_limit_m,
        mirrored=case.mirrored,
        departure_track_m=case.curves[0].track * scales.length_m,
        arrival_track_m=case.curves[1].track * scales.length_m,
        body=moon.body_name if moon else "",
        semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
        prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
    )
    return replace(product, flights=_flights(case, product))


@dataclass(frozen=True, eq=False)
class _VerifiedLegs:
    """Legs with the misses and altitudes of their verification."""

    legs: Legs
    closure_km: Array
    closure_m_s: Array
    altitude_m: Array
    impact: NDArray[np.bool_]

    def good(self, case: Case) -> NDArray[np.bool_]:
        """Return which of them can be flown, (L,)."""
        return np.asarray(~self.impact & (self.closure_km * 1e3 <= case.closure_limit_m))


def _verify_legs(
    case: Case, sets: Sequence[tuple[Legs, NDArray[np.bool_]]], fly: Fly
) -> list[_VerifiedLegs]:
    """Correct sets of legs with the Taylor propagator, and verify them with it.

    With every set goes which of its legs arrive.
    """
    pieces: list[Coasts | Waits] = []
    for legs, arrives in sets:
        start = np.where(arrives, legs.begin, legs.state)
        end = np.where(arrives, legs.state, legs.begin)
        pieces += coasts_of(start, end, legs.tof)
        # the planar orbits are flown from their own first states to where legs meet them
        for k in (False, True):
            pieces += waits_of(legs.target[:, arrives == k], arrives=k)
    flown = iter(fly(pieces))
    return [_put_together(case, legs, arrives, flown) for legs, arrives in sets]


def _put_together(
    case: Case, legs: Legs, arrives: NDArray[np.bool_], flown: Iterator[VerifiedFlights]
) -> _VerifiedLegs:
    """Take the verified flights of a set of legs from an iterator."""

    def taken(lanes: int) -> VerifiedFlights:
        parts = [next(flown)]
        while sum(part.impact.size for part in parts) < lanes:
            parts.append(next(flown))
        return VerifiedFlights.join(parts)

    count = legs.p.size
    if not count:
        none = np.zeros(0)
        return _VerifiedLegs(legs, none, none, none, np.zeros(0, bool))
    coast = taken(count)
    legs = replace(
        legs,
        begin=np.where(arrives, coast.start, legs.begin),
        state=np.where(arrives, legs.state, coast.start),
    )
    legs = replace(legs, dv=np.linalg.norm(legs.state[3:] - legs.target[3:], axis=0))
    # where leg and planar orbit meet
    gap = (legs.state - legs.target)[:3]
    meeting = np.linalg.norm(gap, axis=0) * case.flow.system.unit[0] / 1e3
    speeds = np.zeros(count)
    for k in (False, True):
        own = np.flatnonzero(arrives == k)
        if own.size:
            planar = taken(own.size)
            meeting[own] += planar.closure_km
            speeds[own] = planar.closure_m_s
    return _VerifiedLegs(
        legs=legs,
        closure_km=np.maximum(coast.closure_km, meeting),
        closure_m_s=np.maximum(coast.closure_m_s, speeds),
        altitude_m=least_heights_m(case.plant, coast.places_m, coast.place_lane, coast.impact),
        impact=coast.impact,
    )


def _front(
    results: Sequence[OrbitTransfers], legs: Legs, good: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the Pareto-optimal pairs of legs of each orbit."""
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    first = 0
    for one in results:
        middle, last = first + one.departure.p.size, first + one.arrival.p.size
        last += one.departure.p.size
        out = np.arange(first, middle)[good[first:middle]]
        back = np.arange(middle, last)[good[middle:last]]
        a, b = (grid.ravel() for grid in np.meshgrid(out, back, indexing="ij"))
        tof = legs.tof[a] + legs.tof[b]
        best = np.flatnonzero(front(legs.dv[a] + legs.dv[b], tof))
        best = best[np.argsort(tof[best], kind="stable")]
        pairs.append(np.array([a[best], b[best]], dtype=np.int64))
        first = last
    return np.concatenate(pairs, axis=1)


def _checks(
    case: Case,
    results: Sequence[OrbitTransfers],
    legs: Legs,
    good: NDArray[np.bool_],
    again: Sequence[_VerifiedLegs],
) -> tuple[NDArray[np.int64], Array]:
    """Compare the entries that make transfers with those found with twice the samples."""
    entries: list[tuple[int, int]] = []
    shifts: list[float] = []
    others = iter(again)
    first = 0
    for one in results:
        count, shift = np.zeros(2, dtype=np.int64), 0.0
        for ladder in (one.departure, one.arrival):
            own = np.arange(first, first + ladder.p.size)
            first += ladder.p.size
            if one.again is None:
                continue
            mine = legs.dv[own[good[own]]]
            other = next(others)
            theirs = other.legs.dv[other.good(case)]
            count += mine.size, theirs.size
            same = mine.size == theirs.size
            moved = float(np.max(np.abs(mine - theirs), initial=0.0)) if same else float("inf")
            shift = max(shift, moved)
        if one.again is not None:
            entries.append((int(count[0]), int(count[1])))
            shifts.append(shift)
    return np.array(entries, dtype=np.int64).reshape(-1, 2).T, np.array(shifts)


def _flights(case: Case, product: ManifoldTransfers) -> Trajectories:
    """Return the cheapest and the quickest transfer of each connected orbit as coasts."""
    system, member = case.flow.system, product.transfer_member
    dv, tof = product.transfer_dv_m_s, product.transfer_tof_s
    plans: list[str] = []
    labels: list[str] = []
    legs: list[int] = []
    for i in np.unique(member):
        own = np.flatnonzero(member == i)
        name = case.orbits.labels[int(i)]
        for what, q in (("least impulse", np.argmin(dv[own])), ("quickest", np.argmin(tof[own]))):
            plans += [f"{name}, {what}"] * 2
            labels += ["departure", "arrival"]
            legs += product.transfer_legs[:, own[q]].tolist()
    arrives = product.leg_arrives[legs]
    start = np.where(arrives, product.leg_near[:, legs], product.leg_state[:, legs])
    duration = product.leg_tof_s[legs]
    way = case.flow.plain.trajectory(
        start / system.unit[:, None], duration / system.time_unit_s, _EACH * (_STATES - 1)
    )[:, ::_EACH]
    time = np.linspace(0.0, 1.0, _STATES)[:, None] * duration
    # the second coast of a plan follows the first; the stay at the unstable orbit is left out
    time[:, 1::2] += duration[::2]
    return Trajectories(
        frame=system.frame,
        states=case.flow.names,
        plans=tuple(plans),
        labels=tuple(labels),
        t_s=time,
        x=np.ascontiguousarray(way * system.unit[:, None, None]),
    )
