"""Legs made into transfers: bounds, flights anew, fronts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import Taylor
from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.survey import LockedMoon
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import Leg, verify
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.manifold_products import ManifoldTransfers
from hillsphere_orbits.transfers.manifold_search import Legs, joined
from hillsphere_orbits.transfers.pareto import front

__all__ = ["Case", "Found", "assembled"]

_STATES = 481  # of a coast that is handed on;
_EACH = 8  # sub-steps between two of them, so that it solves the equations near the body too
_STEPS_PER_UNIT = 120  # sub-steps of the matrix per revolution of the primary's motion
_CORRECTIONS = 3
_ENOUGH = 1e-7  # normalised: a leg that misses by no more is not corrected


@dataclass(frozen=True, eq=False)
class Found:
    """What was found through one orbit, normalised.

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
    """

    status: str
    multiplier: float
    departure: Legs
    arrival: Legs
    trajectories: int
    again: tuple[Legs, Legs] | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """What all transfers have in common; see `ManifoldTransfers`."""

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


def assembled(case: Case, found: list[Found]) -> ManifoldTransfers:
    """Make the product.

    Parameters
    ----------
    case : Case
        What the transfers have in common.
    found : list of Found, length M
        Per orbit.

    Returns
    -------
    ManifoldTransfers
        All legs flown anew; transfers that none through the same orbit betters.
    """
    system, scales = case.flow.system, case.plant.scales
    unit, speed = system.unit[:, None], scales.length_m / scales.time_s
    ladders = [legs for one in found for legs in (one.departure, one.arrival)]
    legs = joined([Legs.none(), *ladders])
    sizes = [part.p.size for part in ladders]
    member = np.repeat(np.arange(2 * len(found)) // 2, sizes).astype(np.int64)
    arrives = np.repeat(np.arange(2 * len(found)) % 2 == 1, sizes)
    flown = _reflown(case, legs, arrives)
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
    pairs = _front(found, legs, good)
    entries, shift = _checks(case, found, legs, good)
    moon = case.plant if isinstance(case.plant, LockedMoon) else None
    product = ManifoldTransfers(
        flights=Trajectories(
            system.frame, case.flow.names, (), (), np.empty((0, 0)), np.empty((6, 0, 0))
        ),
        departure=case.planar[0],
        arrival=case.planar[1],
        orbits=case.orbits,
        status=tuple(one.status for one in found),
        revolutions=case.revolutions,
        z_m=case.z_m,
        multiplier=np.array([one.multiplier for one in found]),
        bound_m_s=np.array(bound).reshape(2, -1) * speed,
        trajectories=np.array([one.trajectories for one in found], dtype=np.int64),
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
            for label, one in zip(case.orbits.labels, found, strict=True)
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
class _Reflown:
    """What legs were like when they were flown anew."""

    legs: Legs
    closure_km: Array
    closure_m_s: Array
    altitude_m: Array
    impact: NDArray[np.bool_]

    def good(self, case: Case) -> NDArray[np.bool_]:
        """Return which of them can be flown, (L,)."""
        return np.asarray(~self.impact & (self.closure_km * 1e3 <= case.closure_limit_m))


def _reflown(case: Case, legs: Legs, arrives: NDArray[np.bool_]) -> _Reflown:
    """Correct legs in the flow of the Taylor propagator, and fly them anew in it."""
    count = legs.p.size
    made = _Reflown(
        legs, np.zeros(count), np.zeros(count), np.full(count, np.nan), np.zeros(count, bool)
    )
    if not count:
        return made
    system, clock = case.flow.system, case.plant.scales.time_s
    start = np.where(arrives, legs.begin, legs.state)
    end = np.where(arrives, legs.state, legs.begin)
    start = _corrected(case, start, end, legs.tof)
    legs = replace(
        legs,
        begin=np.where(arrives, start, legs.begin),
        state=np.where(arrives, legs.state, start),
    )
    legs = replace(legs, dv=np.linalg.norm(legs.state[3:] - legs.target[3:], axis=0))
    unit, none = system.unit[:, None], np.zeros((3, count))
    coast = verify(case.plant, start * unit, [Leg("leg", legs.tof * clock, none, end * unit)])
    # where leg and planar orbit meet, and that orbit flown from its own first state to there
    gap = (legs.state - legs.target)[:3]
    meeting = np.linalg.norm(gap, axis=0) * system.unit[0] / 1e3
    speeds = np.zeros(count)
    for k, curve in enumerate(case.curves):
        own = np.flatnonzero(arrives == bool(k))
        if own.size:
            target = legs.target[:, own]
            wait = curve.time(np.arctan2(target[1], target[0])) * clock
            first = np.repeat(curve.x0[:, None], own.size, axis=1)
            planar = verify(
                case.plant, first * unit, [Leg("planar", wait, none[:, own], target * unit)]
            )
            meeting[own] += planar.closure_km
            speeds[own] = planar.closure_m_s
    return replace(
        made,
        legs=legs,
        closure_km=np.maximum(coast.closure_km, meeting),
        closure_m_s=np.maximum(coast.closure_m_s, speeds),
        altitude_m=coast.altitude_m,
        impact=coast.impact,
    )


def _corrected(case: Case, start: Array, end: Array, tof: Array) -> Array:
    """Return first states from which the Taylor propagator reaches planned ends.

    Passing near the body and the unstable orbit, a leg magnifies the last digits of its first
    state. The matrix of the flight backwards tells which change of the first state, of the order
    of those digits, takes the miss away; a step that does not make it smaller is not taken.
    """
    flow = case.flow
    taylor = Taylor(flow.system)
    steps = int(np.max(tof) / (2.0 * np.pi) * _STEPS_PER_UNIT) + 1
    _, back = flow.with_matrix(np.ascontiguousarray(end), -tof, steps)
    best = start
    miss = taylor.propagate(best, tof) - end
    for _ in range(_CORRECTIONS):
        tried = best - np.einsum("ijk,jk->ik", back, miss)
        other = taylor.propagate(tried, tof) - end
        size = np.linalg.norm(miss, axis=0)
        better = (size > _ENOUGH) & (np.linalg.norm(other, axis=0) < size)
        best, miss = np.where(better, tried, best), np.where(better, other, miss)
    return best


def _front(found: list[Found], legs: Legs, good: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the pairs of legs that no pair through the same orbit betters."""
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    first = 0
    for one in found:
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
    case: Case, found: list[Found], legs: Legs, good: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], Array]:
    """Compare the entries that make transfers with those found with twice the samples."""
    entries: list[tuple[int, int]] = []
    shifts: list[float] = []
    first = 0
    for one in found:
        count, shift = np.zeros(2, dtype=np.int64), 0.0
        for k, ladder in enumerate((one.departure, one.arrival)):
            own = np.arange(first, first + ladder.p.size)
            first += ladder.p.size
            if one.again is None:
                continue
            mine = legs.dv[own[good[own]]]
            other = _reflown(case, one.again[k], np.full(one.again[k].p.size, k == 1))
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
    """Return of each connected orbit the cheapest and the quickest transfer as coasts."""
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
