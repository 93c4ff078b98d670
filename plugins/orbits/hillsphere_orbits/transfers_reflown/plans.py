"""Plans of transfers: their coasts, and the periodic orbits before, between and after them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hillsphere.errors import StageError
from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere_orbits.fidelity_ladder.orbits import OrbitCurves
from hillsphere_orbits.flow import Flow, flow_of

__all__ = ["Piece", "Plan", "Stays", "plans_of"]

_ARC = 1.5
"""Length of an arc, natural units: gaps of neighbouring flights stay linear over it."""
_MEETS = 2e-3
"""Distance, natural units, within which places count as equal: the error of sensitive coasts."""
_NEAR = 0.02
"""Distance of a state from an orbit, relative to its size, within which a coast arrives on it."""
_SAME_EQUATIONS = 1e-6
"""Largest relative gap between one state of a coast and the next one propagated from it. It is
wider than for periodic orbits: coasts along manifolds magnify the rounding of their states."""
_TRIAL = 1e-2
"""Part of that gap which the propagation itself may err by."""
_THIN = 4  # of the table of orbits, for a first guess
_NEWTON = 8
"""Steps of Newton's iteration for the nearest phase, from the nearest entry of the thinned
table."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A coast, or a stay on a periodic orbit; K arcs.

    Parameters
    ----------
    name : str
        Of the coast or orbit.
    stays : bool
        Whether it is a stay.
    t_s : ndarray, shape (K + 1,)
        Times of the nodes since the first coast began.
    hill : ndarray, shape (6, K + 1)
        States there, SI, in the frame hill:BODY.
    """

    name: str
    stays: bool
    t_s: Array
    hill: Array


@dataclass(frozen=True, eq=False)
class Plan:
    """Pieces in the order of flight; an impulse where two meet.

    Parameters
    ----------
    name : str
        Its name.
    pieces : tuple of Piece
        Its pieces.
    fault : str
        Why it is no continuous flight; empty if it is one.
    """

    name: str
    pieces: tuple[Piece, ...]
    fault: str = ""

    @property
    def dv_m_s(self) -> Array:
        """Impulses where pieces meet, as planned."""
        return np.array(
            [np.linalg.norm(b.hill[3:, 0] - a.hill[3:, -1]) for a, b in pairwise(self.pieces)]
        )

    @property
    def patch_orbits(self) -> list[str]:
        """Orbit on which each patch point stays; empty where there is none."""
        return [a.name if a.stays else b.name if b.stays else "" for a, b in pairwise(self.pieces)]

    @property
    def ends(self) -> tuple[str, ...]:
        """Orbits of departure and arrival; empty where there is none."""
        first, last = self.pieces[0], self.pieces[-1]
        return (first.name if first.stays else "", last.name if last.stays else "")

    @property
    def stay_s(self) -> float:
        """Time spent on orbits between coasts."""
        return float(sum(p.t_s[-1] - p.t_s[0] for p in self.pieces[1:-1] if p.stays))

    @property
    def coasts(self) -> list[Piece]:
        """Its coasts."""
        return [piece for piece in self.pieces if not piece.stays]

    @property
    def tof_s(self) -> float:
        """Time from the beginning of the first coast to the end of the last."""
        return float(self.coasts[-1].t_s[-1] - self.coasts[0].t_s[0])


class Stays:
    """Periodic orbits on which plans begin, stay and end.

    Parameters
    ----------
    plant : Plant
        Equations that the orbits solve.
    orbits : PeriodicOrbits or None
        The orbits; none if there are none.

    Raises
    ------
    StageError
        If they do not solve the equations.
    """

    def __init__(self, plant: Plant, orbits: PeriodicOrbits | None) -> None:
        self.flow = flow_of(plant)
        self.labels = orbits.labels if orbits is not None else ()
        self.curves = OrbitCurves(plant, orbits) if orbits is not None and self.labels else None

    def through(self, x: Array) -> tuple[int, float] | None:
        """Return the orbit that passes through the place of a state (6,), normalised, and when."""
        lane, phase, gap = self._nearest(x, slice(0, 3))
        return (lane, phase) if gap <= _MEETS * max(1.0, float(np.linalg.norm(x[:3]))) else None

    def on(self, x: Array) -> tuple[int, float] | None:
        """Return the orbit on which a state (6,), normalised, is about, and the phase there."""
        lane, phase, gap = self._nearest(x, slice(0, 6))
        return (lane, phase) if gap <= _NEAR * np.linalg.norm(x) else None

    def period(self, lane: int) -> float:
        """Return the period of an orbit, normalised."""
        assert self.curves is not None
        return float(self.curves.period[lane])

    def states(self, lane: int, phase: Array) -> Array:
        """Return states (6, k), normalised, at phases (k,), units of time."""
        return self._states(np.full(phase.shape, lane), phase)

    def _states(self, lanes: Array, phase: Array) -> Array:
        curves = self.curves
        assert curves is not None
        lane, last = np.asarray(lanes, dtype=np.intp), curves.table.shape[1] - 1
        h = curves.step[lane]
        # the table runs from −T/2 to T/2 in equal steps
        place = np.mod((phase + 0.5 * curves.period[lane]) / h, last)
        i = np.minimum(place.astype(np.intp), last - 1)
        # propagated from the table's node, not interpolated: exact to rounding
        start = np.ascontiguousarray(curves.table[:, i, lane])
        return np.asarray(self.flow.plain.propagate(start, (place - i) * h, 2))

    def _nearest(self, x: Array, rows: slice) -> tuple[int, float, float]:
        """Return the orbit that comes nearest to a state in some rows, the phase, the distance."""
        curves = self.curves
        if curves is None:
            return 0, 0.0, np.inf
        target = x[rows, None]
        away = np.sum((curves.table[rows, ::_THIN] - target[..., None]) ** 2, axis=0)
        lanes = np.arange(away.shape[1])
        first = np.argmin(away, axis=0) * _THIN
        phase = first * curves.step - 0.5 * curves.period
        # only those that can be the nearest
        lanes = lanes[np.argsort(np.min(away, axis=0), kind="stable")[:8]]
        phase = phase[lanes]
        for _ in range(_NEWTON):
            here = self._states(lanes, phase)
            rate = self.flow.rate(here)[rows]
            change = np.sum((target - here[rows]) * rate, axis=0) / np.sum(rate**2, axis=0)
            phase = phase + np.clip(change, -0.3, 0.3)
        gap = np.linalg.norm(self._states(lanes, phase)[rows] - target, axis=0)
        best = int(np.argmin(gap))
        return int(lanes[best]), float(phase[best]), float(gap[best])


def plans_of(plant: Plant, flights: Trajectories, stays: Stays, revolutions: float) -> list[Plan]:
    """Return the plans of a product, with the orbits between which they lead.

    Parameters
    ----------
    plant : Plant
        Equations that the coasts solve, with six states in the frame hill:BODY.
    flights : Trajectories
        The coasts. One that begins elsewhere than the last one ended goes on after a stay on an
        orbit: as long as the times tell, else from phase to phase.
    stays : Stays
        The orbits.
    revolutions : float
        How long the first and last orbit are flown, in their periods.

    Returns
    -------
    list of Plan
        In order; one whose coasts do not meet says so.

    Raises
    ------
    StageError
        If the coasts do not solve the equations.
    """
    flow = flow_of(plant)
    system = flow.system
    if flights.frame != system.frame or flights.states != flow.names:
        raise StageError(
            f"the flights have states {', '.join(flights.states)} in {flights.frame}; those of the "
            f"first rung are {', '.join(flow.names)} in {system.frame}; name the plant on which "
            "they were found first"
        )
    maker = _Maker(stays, system.unit, system.time_unit_s, revolutions)
    plans = []
    for name in dict.fromkeys(flights.plans):
        coasts = [i for i, plan in enumerate(flights.plans) if plan == name]
        plans.append(maker.plan(name, [_coast(flow, flights, i) for i in coasts]))
    return plans


class _Maker:
    """Joins coasts by stays; see `plans_of`."""

    def __init__(self, stays: Stays, unit: Array, time_unit_s: float, revolutions: float) -> None:
        self.stays, self.unit, self.clock = stays, unit, time_unit_s
        self.revolutions = revolutions

    def plan(self, name: str, coasts: list[Piece]) -> Plan:
        """Return a plan of coasts."""
        stays, unit = self.stays, self.unit
        zero = coasts[0].t_s[0]
        pieces: list[Piece] = []
        if (start := stays.through(coasts[0].hill[:, 0] / unit)) is not None:
            span = self.revolutions * stays.period(start[0])
            pieces.append(self._stay(start[0], start[1] - span, span, -span * self.clock))
        # time of stays that the plan's own times leave out
        shift = 0.0
        for k, coast in enumerate(coasts):
            begin = float(coast.t_s[0] - zero) + shift
            if k and not self._join(pieces[-1], coast, begin - float(pieces[-1].t_s[-1])):
                stay = self._between(pieces[-1], coast, begin - float(pieces[-1].t_s[-1]))
                if stay is None:
                    away = np.linalg.norm(coast.hill[:3, 0] - pieces[-1].hill[:3, -1]) / 1e3
                    fault = (
                        f"not joined: coast {coast.name!r} begins {away:.3g} km from where "
                        f"{pieces[-1].name!r} ends, and no orbit given leads from there to it"
                    )
                    return Plan(name, tuple(pieces), fault)
                pieces.append(stay)
            if k:
                shift += float(pieces[-1].t_s[-1]) - begin
            pieces.append(Piece(coast.name, False, coast.t_s - zero + shift, coast.hill))
        if (last := stays.through(coasts[-1].hill[:, -1] / unit)) is not None:
            span = self.revolutions * stays.period(last[0])
            pieces.append(self._stay(last[0], last[1], span, float(pieces[-1].t_s[-1])))
        return Plan(name, tuple(pieces))

    def _join(self, before: Piece, coast: Piece, idle: float) -> bool:
        # two coasts join directly if neither place nor time lies between them
        gap = np.linalg.norm((coast.hill[:3, 0] - before.hill[:3, -1]) / self.unit[:3])
        size = max(1.0, float(np.linalg.norm(coast.hill[:3, 0] / self.unit[:3])))
        return bool(gap <= _MEETS * size and abs(idle) <= _MEETS * self.clock)

    def _between(self, before: Piece, coast: Piece, idle: float) -> Piece | None:
        """Return the stay on an orbit from the end of one coast to the start of the next."""
        first = self.stays.on(before.hill[:, -1] / self.unit)
        last = self.stays.on(coast.hill[:, 0] / self.unit)
        if idle > 0.0:
            # impulses on to the orbit and off it: only the places are on it
            first = self.stays.through(before.hill[:, -1] / self.unit) or first
            last = self.stays.through(coast.hill[:, 0] / self.unit) or last
        if first is None or last is None or first[0] != last[0]:
            return None
        period = self.stays.period(first[0])
        # from phase to phase, by whole periods more if the plan's times leave room for them
        span = (last[1] - first[1]) % period
        if idle > 0.0:
            span += period * round((idle / self.clock - span) / period)
        if span <= 0.0:
            span += period
        return self._stay(first[0], first[1], span, float(before.t_s[-1]))

    def _stay(self, lane: int, phase: float, span: float, begin_s: float) -> Piece:
        t = np.linspace(0.0, span, max(1, round(span / _ARC)) + 1)
        hill = self.stays.states(lane, phase + t) * self.unit[:, None]
        return Piece(self.stays.labels[lane], True, begin_s + t * self.clock, hill)


def _coast(flow: Flow, flights: Trajectories, i: int) -> Piece:
    """Return a coast by some of its states, an arc apart."""
    system, label = flow.system, flights.labels[i]
    given = np.flatnonzero(
        np.isfinite(flights.t_s[:, i]) & np.isfinite(flights.x[:, :, i]).all(axis=0)
    )
    t = flights.t_s[given, i]
    if given.size < 2 or not (np.diff(t) > 0).all():
        raise StageError(
            f"coast {label!r} of {flights.plans[i]!r} needs two or more states at rising times"
        )
    # nodes of multiple shooting: those of the given states that are nearest to equal arcs
    arcs = max(1, round((t[-1] - t[0]) / system.time_unit_s / _ARC))
    wanted = np.linspace(t[0], t[-1], arcs + 1)
    nodes = np.unique(np.argmin(np.abs(t[:, None] - wanted), axis=0))
    t, hill = t[nodes], np.ascontiguousarray(flights.x[:, given[nodes], i])
    x = hill / system.unit[:, None]
    start, spans = np.ascontiguousarray(x[:, :-1]), np.diff(t) / system.time_unit_s
    steps = flow.plain.choose_steps(start, spans, _SAME_EQUATIONS * _TRIAL)
    end = flow.plain.propagate(start, spans, steps)
    gap = float(np.max(np.abs(end - x[:, 1:]) / np.maximum(1.0, np.abs(x[:, 1:]))))
    if not gap <= _SAME_EQUATIONS:
        raise StageError(
            f"coast {label!r} of {flights.plans[i]!r} does not solve the equations of the first "
            f"rung: it is off by {gap:.1e} natural units; name the plant on which it was found "
            "first"
        )
    return Piece(label, False, t, hill)
