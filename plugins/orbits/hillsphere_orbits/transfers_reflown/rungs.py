"""Recomputation of one plan on one plant: orbits, coasts and impulses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.fidelity_ladder.rung import Rung
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.multiple_shooting import ContinuousFlights, reconverge
from hillsphere_orbits.transfers.endtoend import heights_m
from hillsphere_orbits.transfers_reflown.plans import Plan

__all__ = ["REFLOWN", "Reflier", "Reflight"]

REFLOWN = "reflown"
_BETWEEN = 12
"""Points of an arc at which place and height are taken."""
_ARRIVES = 1e-9
"""Distance, natural units, within which a coast must reach the place where it is to end."""


@dataclass(eq=False)
class Reflight:
    """A plan on a plant.

    Parameters
    ----------
    status : str
        ``"reflown"``, or why not.
    dv_m_s : ndarray, shape (P,)
        Impulses at its patch points; NaN if it was not found, as all that follows.
    displacement_m : float
        Largest distance of a patch point from its place in the plan.
    closure_m, closure_m_s : float
        Largest miss of the end of a coast, flown from its first state alone.
    altitude_m : float
        Least height of its coasts.
    gap : float
        Largest gap at a node, natural units.
    iterations : int
        Steps of multiple shooting.
    coasts : list of ndarray, shape (n, K + 1)
        States of the coasts at their nodes, SI, in the plant's frame.
    track_m : list of ndarray, shape (3, L)
        Positions along them in the frame hill:BODY.
    """

    status: str
    dv_m_s: Array
    displacement_m: float = np.nan
    closure_m: float = np.nan
    closure_m_s: float = np.nan
    altitude_m: float = np.nan
    gap: float = np.nan
    iterations: int = 0
    coasts: list[Array] = field(default_factory=list)
    track_m: list[Array] = field(default_factory=list)

    @property
    def good(self) -> bool:
        """Whether it can be flown."""
        return self.status == REFLOWN

    @property
    def total_m_s(self) -> float:
        """Sum of the impulses; NaN if it cannot be flown."""
        return float(np.sum(self.dv_m_s)) if self.good else np.nan


class Reflier:
    """Recomputes plans on one plant.

    Parameters
    ----------
    plant : Plant
        The plant.
    surface : Plant
        Tells of the body's surface where the plant does not; in the frame hill:BODY.
    true_anomaly_rad : float
        True anomaly of the moon when the first coast of a plan begins, where it has one.
    """

    def __init__(self, plant: Plant, surface: Plant, true_anomaly_rad: float) -> None:
        self.plant, self.surface, self.anomaly = plant, surface, true_anomaly_rad
        self.flow = flow_of(plant)
        self._taylor: Taylor | None = None
        if self.flow.system.external is None:
            ends = [name for name in ("impact",) if name in self.flow.system.events]
            self._taylor = Taylor(self.flow.system, events=ends)

    def __call__(self, plan: Plan) -> Reflight:
        """Return a plan on this plant."""
        reflight = Reflight(plan.fault or REFLOWN, np.full(max(0, len(plan.pieces) - 1), np.nan))
        if plan.fault:
            return reflight
        # orbits first: they say where coasts begin and end
        order = sorted(range(len(plan.pieces)), key=lambda i: not plan.pieces[i].stays)
        hill: dict[int, Array] = {}
        gaps = []
        for i in order:
            piece = plan.pieces[i]
            rung = Rung(self.plant, piece.t_s, self.anomaly)
            sought = piece.hill
            if not piece.stays:
                sought = sought + _node_displacement(plan, i, hill)
            nodes = rung.states(sought[:, :, None], slice(0, piece.t_s.size))
            made = self._find_flight(rung, nodes, held=not piece.stays)
            if isinstance(made, str):
                where = "orbit" if piece.stays else "coast"
                reflight.status = f"not converged: {where} {piece.name!r}: {made}"
                return reflight
            reflight.iterations += int(made.iterations[0])
            gaps.append(float(made.gap[0]))
            hill[i] = rung.hill(made.x)[:, :, 0]
            if not piece.stays:
                reflight.coasts.append(made.x[:, :, 0])
                self._fly(reflight, piece.name, rung, made)
        pairs = range(len(plan.pieces) - 1)
        reflight.dv_m_s = np.array([np.linalg.norm(hill[i + 1][3:, 0] - hill[i][3:, -1])
                                 for i in pairs])  # fmt: skip
        ends = [k for i, piece in enumerate(plan.pieces) if not piece.stays
                for k in ((i, 0), (i, -1))]  # fmt: skip
        reflight.displacement_m = max(
            float(np.linalg.norm((hill[i] - plan.pieces[i].hill)[:3, k])) for i, k in ends
        )
        reflight.gap = max(gaps)
        return reflight

    def _find_flight(self, rung: Rung, nodes: Array, *, held: bool) -> ContinuousFlights | str:
        """Return the flight of the plant near nodes (n, K + 1, 1), or why there is none."""
        points = nodes.shape[1]
        # the places at both ends of a coast are held, their velocities are free: impulses result
        freedom = np.ones((6, points))
        if held:
            freedom[:3, [0, -1]] = 0.0
        try:
            made = reconverge(self.plant, rung.t_s, nodes, freedom=freedom)
        except InputError:
            return "its ends cannot be held: neighbouring flights of the same time meet there too"
        if not made.converged[0]:
            return made.reasons[0]
        if held:
            missed = np.linalg.norm((made.x - nodes)[:3, [0, -1], 0], axis=0)
            if np.max(missed) > _ARRIVES * self.flow.system.unit[0]:
                return f"it ends {np.max(missed) / 1e3:.3g} km from where it should"
        return made

    def _fly(self, reflight: Reflight, name: str, rung: Rung, made: ContinuousFlights) -> None:
        """Fly a coast from its first state, and take its heights."""
        system = self.flow.system
        unit, clock = system.unit[:, None], system.time_unit_s
        x = made.x[:, :, 0] / unit
        t = rung.t_s / clock
        start, spans = np.ascontiguousarray(x[:, :-1]), np.diff(t)
        # a multiple of the points per arc, so that they fall on sub-steps
        steps = _BETWEEN * -(-made.steps // _BETWEEN)
        way = self.flow.plain.trajectory(start, spans, steps)[:, :: steps // _BETWEEN]
        way = np.swapaxes(way, 1, 2).reshape(len(x), -1) * unit
        reflight.track_m.append(rung.hill(way)[:3])
        height = float(np.min(self._heights(rung, way)))
        first, span = x[:, :1], t[-1:] - t[0]
        resolved = True
        if self._taylor is not None:
            flight = self._taylor.fly(first, span, strict=False)
            end, met = flight.x, flight.ended_by[0] is not None
        elif "impact" in system.events:
            way_there = self.flow.plain.locate(
                "impact", first, span, steps * spans.size, strict=False
            )
            end, met, resolved = way_there.x, way_there.found[0], way_there.resolved[0]
        else:
            end = self.flow.plain.propagate(first, span, steps * spans.size, strict=False)
            met = False
        if met or height <= 0.0:
            height, reflight.status = 0.0, f"coast {name!r} meets the body"
        elif not resolved:
            reflight.status = f"coast {name!r}: whether it meets the body is not decided"
        else:
            miss = (end - x[:, -1:])[:6, 0] * unit[:6, 0]
            reflight.closure_m = np.fmax(reflight.closure_m, np.linalg.norm(miss[:3]))
            reflight.closure_m_s = np.fmax(reflight.closure_m_s, np.linalg.norm(miss[3:]))
        reflight.altitude_m = np.fmin(reflight.altitude_m, height)

    def _heights(self, rung: Rung, x: Array) -> Array:
        """Return heights (N,) above the surface at states (n, N), SI."""
        heights = heights_m(self.plant, x[:3])
        if np.isnan(heights).all():
            heights = heights_m(self.surface, rung.hill(x)[:3])
        return heights


def _node_displacement(plan: Plan, i: int, hill: dict[int, Array]) -> Array:
    """Return by how much the nodes of a coast move (6, K + 1) with the orbits at its ends."""
    t = plan.pieces[i].t_s
    part = (t - t[0]) / (t[-1] - t[0])
    move = np.zeros((6, t.size))
    for k, weight in ((i - 1, 1.0 - part), (i + 1, part)):
        if k in hill and plan.pieces[k].stays:
            at = -1 if k < i else 0
            move[:3] += np.outer((hill[k] - plan.pieces[k].hill)[:3, at], weight)
    return move
