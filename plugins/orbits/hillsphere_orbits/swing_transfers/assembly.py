"""Transfers from chosen swing orbits, corrected and verified from end to end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.swing_transfers.chains import Chains, fly
from hillsphere_orbits.swing_transfers.passages import Passages, passages
from hillsphere_orbits.swing_transfers.products import Transfers
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import Leg, verify
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.meetings import Meetings, meetings

__all__ = ["Choice", "Pair", "assemble_transfers", "join_transfers", "none", "select_transfers"]

_TOUCH = 1e-9  # largest gap of corrected orbits that touch, relative to the distance


@dataclass(frozen=True)
class Choice:
    """A swing orbit chosen for a leg.

    Parameters
    ----------
    family : int
        Its family.
    u : float
        Position on it.
    kind : str
        See `Transfers.kind`.
    phases : (float, float), optional
        In periods, where it is entered and left; by default where that is cheapest.
    """

    family: int
    u: float
    kind: str
    phases: tuple[float, float] | None = None


def none() -> Transfers:
    """Return no transfers."""
    numbers, places = np.empty(0, dtype=np.int64), np.empty((2, 3, 0))
    e, pair = np.empty(0), np.empty((2, 0))
    return Transfers(
        numbers, numbers, e, (), np.empty((6, 0)), e, e, e, e, e, e, e, places, pair, pair, places,
        e, e, e,
    )  # fmt: skip


@dataclass(frozen=True)
class Pair:
    """A leg: the orbits at its ends.

    Parameters
    ----------
    leg : int
        Its number.
    start, end : PolarOrbit
        Departure and arrival orbit.
    integrals : (float, float)
        Their integrals, normalised.
    """

    leg: int
    start: PolarOrbit
    end: PolarOrbit
    integrals: tuple[float, float]


def assemble_transfers(
    chains: Chains, plant: Plant, pair: Pair, choices: Sequence[Choice]
) -> Transfers:
    """Make transfers of a leg from chosen swing orbits, corrected and verified.

    Parameters
    ----------
    chains : Chains
        The families.
    plant : Plant
        Equations of motion.
    pair : Pair
        The leg.
    choices : sequence of Choice
        The swing orbits; one that meets an orbit no more once it is corrected, or hits the body on
        the way, is left out.

    Returns
    -------
    Transfers
        In the order of the choices.
    """
    if not choices:
        return none()
    family = np.array([c.family for c in choices], dtype=np.intp)
    z: list[Array] = [np.empty(0)] * len(choices)
    for f in sorted(set(family.tolist())):
        own = np.flatnonzero(family == f).tolist()
        between = [k for k in own if not choices[k].u.is_integer()]
        for k in own:
            z[k] = chains.branch(f).z[:, int(choices[k].u)]
        if between:
            unknowns = chains.at(f, np.array([choices[k].u for k in between]))
            for k, column in zip(between, unknowns.T, strict=True):
                z[k] = column
    # one period of each chosen swing orbit, and its meetings with both ends
    strands = fly(chains, family, z)
    period = strands.h * (strands.way.shape[1] - 1)
    met = (meetings(pair.start, strands, _TOUCH), meetings(pair.end, strands, _TOUCH))
    ways = passages(*met, period)
    chosen = _choose_passages(ways, met, period, choices)
    kept = np.flatnonzero(chosen >= 0)
    way = chosen[kept]
    first, last = ways.departure[way], ways.arrival[way]
    system = chains.flow.system
    unit, clock = system.unit[:, None], system.time_unit_s
    speed, length = system.unit[3], system.unit[0]
    x0 = np.ascontiguousarray(strands.way[:, 0, kept])
    energy = _integral(chains, x0)
    leave, reach = met[0].state[:, first], met[1].state[:, last]
    before, after = met[0].on_curve[:, first], met[1].on_curve[:, last]
    # from the departure orbit on to the swing orbit, and from that on to the arrival orbit
    impulses = np.array([leave[3:] - before[3:], after[3:] - reach[3:]])
    bounds = [
        least_dv(np.linalg.norm(state[3:], axis=0), c, energy)
        for state, c in zip((before, after), pair.integrals, strict=True)
    ]
    made = Transfers(
        leg=np.full(kept.size, pair.leg, dtype=np.int64),
        family=family[kept].astype(np.int64),
        position=np.array([choices[k].u for k in kept.tolist()]),
        kind=tuple(choices[k].kind for k in kept.tolist()),
        x0=x0 * unit,
        period_s=period[kept] * clock,
        integral=energy,
        departure_s=met[0].time[first] * clock,
        arrival_s=met[1].time[last] * clock,
        on_departure_s=pair.start.time(np.arctan2(before[1], before[0])) * clock,
        on_arrival_s=pair.end.time(np.arctan2(after[1], after[0])) * clock,
        tof_s=ways.tof[way] * clock,
        impulse_m_s=impulses * speed,
        angle_rad=np.array([met[0].angle[first], met[1].angle[last]]),
        bound_m_s=np.array(bounds) * speed,
        place_m=np.array([leave[:3], reach[:3]]) * length,
        closure_km=np.zeros(kept.size),
        closure_m_s=np.zeros(kept.size),
        altitude_m=np.zeros(kept.size),
    )
    return _fly_transfers(plant, pair, made, leave * unit, after * unit)


def _choose_passages(
    ways: Passages, met: tuple[Meetings, Meetings], period: Array, choices: Sequence[Choice]
) -> NDArray[np.intp]:
    """Return the passage of every choice: the cheapest, or that nearest to its phases."""
    chosen = ways.cheapest(len(choices))
    for k, choice in enumerate(choices):
        own = np.flatnonzero(ways.lane == k)
        if choice.phases is None or not own.size:
            continue
        away = np.zeros(own.size)
        for meeting, number, phase in zip(
            met, (ways.departure, ways.arrival), choice.phases, strict=True
        ):
            apart = np.abs(meeting.time[number[own]] / period[k] - phase)
            # distance of phases on a circle
            away += np.minimum(apart, np.abs(1.0 - apart))
        chosen[k] = own[np.argmin(away)]
    return chosen


def _integral(chains: Chains, x: Array) -> Array:
    """Return the integral (N,) at normalised states."""
    system = chains.flow.system
    if system.integral is None:
        raise InputError("transfers are judged by their energy; the plant has no integral")
    return np.asarray(system.function(system.integral)(x, system.parameters(None, x.shape[1]))[0])


def _fly_transfers(
    plant: Plant, pair: Pair, made: Transfers, leave: Array, after: Array
) -> Transfers:
    """Fly transfers from the departure orbit's start to a full revolution on the arrival orbit."""
    if not made.size:
        return made
    unit, clock = pair.start.flow.system.unit[:, None], pair.start.flow.system.time_unit_s
    cases = made.size
    legs = [
        Leg("departure orbit", made.on_departure_s, made.impulse_m_s[0], leave),
        Leg("swing orbit", made.tof_s, made.impulse_m_s[1], after),
        Leg("arrival orbit", np.full(cases, pair.end.period * clock), np.zeros((3, cases)), after),
    ]
    start = np.repeat(pair.start.x0[:, None] * unit, cases, axis=1)
    seen = verify(plant, start, legs)
    made = replace(
        made, closure_km=seen.closure_km, closure_m_s=seen.closure_m_s, altitude_m=seen.altitude_m
    )
    return made if not seen.impact.any() else select_transfers(made, np.flatnonzero(~seen.impact))


def select_transfers(transfers: Transfers, which: NDArray[np.intp]) -> Transfers:
    """Return some of the transfers, in the order of their numbers."""
    parts = {
        field.name: np.ascontiguousarray(getattr(transfers, field.name)[..., which])
        for field in fields(Transfers)
        if field.name != "kind"
    }
    return Transfers(kind=tuple(transfers.kind[k] for k in which.tolist()), **parts)


def join_transfers(parts: Sequence[Transfers]) -> Transfers:
    """Return all transfers of several sets in one."""
    arrays = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts], axis=-1)
        for field in fields(Transfers)
        if field.name != "kind"
    }
    return Transfers(kind=tuple(kind for part in parts for kind in part.kind), **arrays)
