"""The search for continuous flights: all arcs of all flights as lanes of one propagation.

`hillsphere_orbits.multiple_shooting` states the problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.flow import Flow, flow_of

__all__ = ["ArcSearch", "ContinuousFlights", "Effort", "FreeFlights", "Target"]

_AT_REST = 1e-3
"""If no node moves farther than this, normalised, only the gaps are closed from then on."""
_NEARLY, _GAIN, _IDLE = 1e-3, 1e-2, 3
"""The same holds with gaps below the first number if the distance from the target has shrunk by
less than the second, relative, over the third number of steps."""
_ABOUT = 1e-5
"""Gaps, normalised, up to which the first arcs are closed alone."""
_FIRST_STEPS = 8
"""Sub-steps of an arc that are tried first; they are doubled until the error is small enough."""
_MOST_STEPS = 2048
"""Sub-steps beyond which an arc counts as one through a singularity, and its flight is given up."""
_STEP_ERROR = 3e-9
"""Largest difference, relative, between an arc in some sub-steps and in twice as many. The formula
is of eighth order, so that the arc in twice as many errs by a 256th of it, 1e-11."""
_LONGEST = 0.1
"""Longest move of a node in one step, of its distance and speed: farther arcs are not linear."""
_ALONG = 400.0
"""Variance of a node along the curve that is its target, beside one across."""
_WINDOWS = (24, 48)
"""First arcs that are closed alone, for a first node from which to fly freely."""
_NEAR = 0.25
"""Largest distance from its target, of its own distance and speed, of a node flown to freely."""

_Lanes: TypeAlias = NDArray[np.intp]


class Target(Protocol):
    """Where nodes should be."""

    def near(
        self, x: Array, nodes: slice, lanes: _Lanes, slip: Array
    ) -> tuple[Array, Array | None, Array]:
        """Return the targets of nodes, and directions along which they may slip.

        Parameters
        ----------
        x : ndarray, shape (n, k, L)
            Nodes now, SI, in the plant's frame.
        nodes : slice
            Which of the nodes these are.
        lanes : ndarray of int, shape (L,)
            Which of the flights.
        slip : ndarray, shape (k, L)
            How far the nodes were along their curves when last seen, or those before them; zero
            at first. Unit and meaning are the target's own.

        Returns
        -------
        target : ndarray, shape (n, k, L)
            SI.
        along : ndarray, shape (n, k, L), or None
            Direction in which a node may slip freely, SI, of any length.
        slip : ndarray, shape (k, L)
            How far they are now.
        """
        ...


@dataclass(frozen=True)
class Effort:
    """How long to iterate: steps towards the target, then steps that close gaps."""

    settle: int
    close: int
    tolerance: float


@dataclass(frozen=True, eq=False)
class ContinuousFlights:
    """Flights that solve the equations, as near to the given ones as they could be found.

    Parameters
    ----------
    x : ndarray, shape (n, K + 1, N)
        States at the nodes, SI, in the plant's frame; the given ones where a flight failed.
    converged : ndarray of bool, shape (N,)
        Whether all gaps are within the tolerance.
    iterations : ndarray of int, shape (N,)
        Steps taken.
    gap : ndarray, shape (N,)
        Largest gap at a node, normalised, measured by Taylor series (an array plant: by the step
        map with half the step); NaN where an arc cannot be flown.
    slip : ndarray, shape (K + 1, N)
        How far the nodes are along the curves of the target, see `Target`.
    reasons : tuple of str
        Why a flight failed; empty if it did not.
    steps : int
        Sub-steps that were enough for an arc.
    """

    x: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    gap: Array
    slip: Array
    reasons: tuple[str, ...]
    steps: int


@dataclass(frozen=True, eq=False)
class FreeFlights:
    """Free flights of some lanes: nodes and slips of all, distances, infinite where they leave."""

    lanes: _Lanes
    x: Array
    slip: Array
    distance: Array


class ArcSearch:
    """Flights of one plant, normalised, while they are sought."""

    def __init__(
        self, plant: Plant, t_s: Array, nodes: Array, target: Target, freedom: Array | None
    ) -> None:
        self.flow: Flow = flow_of(plant)
        system = self.flow.system
        self.moves = np.array([i for i, v in enumerate(system.states) if v.length != 0])
        self.unit = system.unit[:, None, None]
        self.given = np.asarray(nodes, dtype=float)
        n, m = len(system.states), len(self.moves)
        if self.given.ndim != 3 or len(self.given) != n or self.given.shape[1] < 2:
            raise InputError(f"nodes must be ({n}, K + 1, N) with K ≥ 1, got {self.given.shape}")
        points, cases = self.given.shape[1:]
        t = np.asarray(t_s, dtype=float)
        if t.shape != (points,) or not (np.diff(t) > 0).all():
            raise InputError(f"t_s must be {points} rising times, one per node")
        self.durations = np.diff(t) / system.time_unit_s
        self.target = target
        width = np.ones((m, points)) if freedom is None else np.asarray(freedom, dtype=float)
        width = width[:, :, None] if width.ndim == 2 else width
        if width.shape[:2] != (m, points) or not (width >= 0).all():
            raise InputError(f"freedom must be ({m}, {points}) or ({m}, {points}, N) and ≥ 0")
        self.freedom = np.broadcast_to(width, (m, points, cases))
        self.x = self.given / self.unit
        self.slip = np.zeros((points, cases))
        self.reasons = [""] * cases
        self.iterations = np.zeros(cases, dtype=np.int64)
        self.steps = self._sub_steps()

    @property
    def alive(self) -> _Lanes:
        """Flights that are not given up."""
        return np.array([i for i, why in enumerate(self.reasons) if not why], dtype=np.intp)

    def _sub_steps(self) -> int:
        """Return the sub-steps that resolve every arc; give up flights that need too many.

        The number is common to all arcs, so that one that passes the moon's centre must not set it.
        """
        n, points, cases = self.x.shape
        start = np.ascontiguousarray(self.x[:, :-1].reshape(n, -1))
        duration = np.repeat(self.durations, cases)
        size = np.maximum(1.0, np.max(np.abs(start[self.moves]), axis=0))
        needed = np.full(start.shape[1], np.inf)
        count = _FIRST_STEPS
        end = self.flow.plain.propagate(start, duration, count, strict=False)
        while count <= _MOST_STEPS and np.isinf(needed).any():
            left = np.flatnonzero(np.isinf(needed))
            finer = self.flow.plain.propagate(
                np.ascontiguousarray(start[:, left]), duration[left], 2 * count, strict=False
            )
            # Richardson: the difference of n and 2n steps is the error of n
            error = np.max(np.abs(finer - end)[self.moves], axis=0)
            needed[left[error <= _STEP_ERROR * size[left]]] = 2 * count
            end, count = finer[:, np.isinf(needed[left])], 2 * count
        worst = np.max(needed.reshape(points - 1, cases), axis=0)
        for lane in np.flatnonzero(np.isinf(worst)):
            self.reasons[lane] = "an arc passes too near the body's centre, or is too unstable"
        return int(np.max(worst[np.isfinite(worst)], initial=_FIRST_STEPS))

    def begin_freely(self) -> FreeFlights:
        """Put flights that were given up on free flights that stay near their targets.

        Of the flight from the first node as given, and those from the first nodes after closing
        some arcs, the nearest is taken; flights of which none stays near remain given up.
        """
        # those given up before the first step have arcs for which no sub-steps are enough
        given_up = np.array([bool(why) for why in self.reasons], dtype=np.bool_)
        lost = np.flatnonzero(given_up & (self.iterations > 0))
        reasons = list(self.reasons)
        points = self.x.shape[1]
        best = FreeFlights(lost, self.x.copy(), self.slip.copy(), np.full(len(reasons), np.inf))
        for window in (0, *_WINDOWS):
            if not lost.size or window >= points:
                break
            lanes = self._reset_to_nodes(lost)
            if window:
                lanes = self.close(slice(0, window + 1), Effort(6, 4, _ABOUT), lanes, strict=False)
            free = self._free(lanes)
            nearer = free.distance < best.distance
            best.x[:, :, nearer], best.slip[:, nearer] = free.x[:, :, nearer], free.slip[:, nearer]
            best.distance[nearer] = free.distance[nearer]
        self.reasons = reasons
        return FreeFlights(self.restart(best), best.x, best.slip, best.distance)

    def restart(self, flights: FreeFlights) -> _Lanes:
        """Put the flights that were given up back on their nodes, and return their numbers."""
        lanes = [k for k in flights.lanes if self.reasons[k] and np.isfinite(flights.distance[k])]
        for k in lanes:
            self.reasons[k] = ""
        self.x[:, :, lanes], self.slip[:, lanes] = flights.x[:, :, lanes], flights.slip[:, lanes]
        # fixed components keep their given values, whatever the free flight reached
        back = np.ix_(self.moves, np.arange(self.x.shape[1]), lanes)
        there = self.given[back] / self.unit[self.moves]
        self.x[back] = np.where(self.freedom[:, :, lanes] == 0.0, there, self.x[back])
        return np.array(lanes, dtype=np.intp)

    def _reset_to_nodes(self, lanes: _Lanes) -> _Lanes:
        """Put flights back on the nodes that were given."""
        for k in lanes:
            self.reasons[k] = ""
        self.x[:, :, lanes], self.slip[:, lanes] = self.given[:, :, lanes] / self.unit, 0.0
        return lanes

    def _free(self, lanes: _Lanes) -> FreeFlights:
        """Fly from the first nodes over all arcs, as long as flights stay near their targets."""
        x, slip = self.x.copy(), self.slip.copy()
        stays, squares = lanes, np.zeros(len(self.reasons))
        for k, duration in enumerate(self.durations):
            here = np.ascontiguousarray(x[:, k, stays])
            there = self.flow.plain.propagate(here, duration, self.steps, strict=False)
            sound = np.isfinite(there).all(axis=0)
            stays, there = stays[sound], there[:, sound]
            if not stays.size:
                break
            # the other states were given, and do not hang on the flight
            node = slice(k + 1, k + 2)
            x[np.ix_(self.moves, np.arange(k + 1, k + 2), stays)] = there[self.moves, None]
            at = x[:, node][:, :, stays]
            target, _, slip[node, stays] = self.target.near(
                at * self.unit, node, stays, slip[k : k + 1, stays]
            )
            away = np.linalg.norm((at - target / self.unit)[self.moves, 0], axis=0)
            squares[stays] += away**2
            stays = stays[away <= _NEAR * np.linalg.norm(at[self.moves, 0], axis=0)]
        distance = np.full(len(self.reasons), np.inf)
        distance[stays] = np.sqrt(squares[stays])
        return FreeFlights(lanes, x, slip, distance)

    def close(
        self,
        nodes: slice,
        effort: Effort,
        lanes: _Lanes | None = None,
        *,
        strict: bool = True,
    ) -> _Lanes:
        """Iterate on some of the nodes until every flight (of `lanes`) is closed or given up.

        Unless `strict`, a flight whose gaps stay open is left as it is: only one that cannot be
        flown is given up. Those of `lanes` that are not given up are returned.
        """
        chosen = lanes = self.alive if lanes is None else lanes
        cases = len(self.reasons)
        steps = np.zeros(cases, dtype=np.int64)
        closing = np.full(cases, int(effort.settle == 0))
        gap, away = np.full(cases, np.inf), np.full(cases, np.inf)
        idle = np.zeros(cases, dtype=np.int64)
        while lanes.size:
            gaps, phi = self._arcs(nodes, lanes)
            largest = np.max(np.abs(gaps), axis=(0, 1))
            sound = np.isfinite(largest) & np.isfinite(phi).all(axis=(0, 1, 2))
            for lane in lanes[~sound]:
                self.reasons[lane] = "an arc meets the body's centre or leaves every bound"
            stuck = ~(largest <= 0.5 * gap[lanes])
            gap[lanes] = largest
            # quadratic convergence: below a tenth of the tolerance the next step is rounding
            closed = (largest <= 0.1 * effort.tolerance) & (closing[lanes] > 0)
            spent = (closing[lanes] >= effort.close) | ((closing[lanes] > 3) & stuck)
            if strict:
                for lane in lanes[sound & ~closed & spent & (largest > effort.tolerance)]:
                    self.reasons[lane] = f"the gaps stay at {gap[lane]:.1e}"
            go = sound & ~closed & ~spent
            lanes, gaps, phi = lanes[go], gaps[:, :, go], phi[..., go]
            if not lanes.size:
                break
            move, distance = self._step(nodes, lanes, gaps, phi, closing[lanes] > 0)
            # at rest: nearly continuous, and no longer coming nearer
            nearer = distance < (1.0 - _GAIN) * away[lanes]
            idle[lanes] = np.where(nearer | (gap[lanes] > _NEARLY), 0, idle[lanes] + 1)
            rest = (idle[lanes] >= _IDLE) | (np.max(np.abs(move), axis=(0, 1)) <= _AT_REST)
            away[lanes] = np.where(idle[lanes] == 0, distance, away[lanes])
            part = np.arange(self.x.shape[1])[nodes]
            self.x[np.ix_(self.moves, part, lanes)] += move
            self.iterations[lanes] += 1
            steps[lanes] += 1
            closing[lanes] += (closing[lanes] > 0) | rest | (steps[lanes] >= effort.settle)
        return np.array([lane for lane in chosen if not self.reasons[lane]], dtype=np.intp)

    def flights(self, tolerance: float) -> ContinuousFlights:
        """Return the flights, their gaps measured by another propagator."""
        n, points, cases = self.x.shape
        gap, good = np.full(cases, np.nan), self.alive
        if good.size:
            start = np.ascontiguousarray(self.x[:, :-1, good].reshape(n, -1))
            duration = np.repeat(self.durations, good.size)
            if self.flow.system.external is None:
                end = self.flow.taylor.fly(start, duration, strict=False).x
            else:
                end = self.flow.map.propagate(start, duration, 2 * self.steps, strict=False)[0]
            # gaps by an integrator that the search did not use
            jumps = end.reshape(n, points - 1, good.size) - self.x[:, 1:, good]
            gap[good] = np.max(np.abs(jumps), axis=(0, 1))
            for lane in good[~(gap[good] <= tolerance)]:
                self.reasons[lane] = f"propagated anew the gaps are {gap[lane]:.1e}"
        converged = np.array([not why for why in self.reasons], dtype=np.bool_)
        states = np.where(converged, self.x * self.unit, self.given)
        why = tuple(self.reasons)
        return ContinuousFlights(
            states, converged, self.iterations, gap, self.slip, why, self.steps
        )

    def _arcs(self, nodes: slice, lanes: _Lanes) -> tuple[Array, Array]:
        """Return the gaps (m, K, L) and matrices (m, m, K, L) of the arcs between nodes."""
        x = self.x[:, nodes][:, :, lanes]
        n, points, cases = x.shape
        start = np.ascontiguousarray(x[:, :-1].reshape(n, -1))
        duration = np.repeat(self.durations[nodes.start : nodes.stop - 1], cases)
        end, phi = self.flow.map.propagate(start, duration, self.steps, strict=False)
        end = end.reshape(n, points - 1, cases)
        phi = phi.reshape(n, n, points - 1, cases)
        return (end - x[:, 1:])[self.moves], phi[np.ix_(self.moves, self.moves)]

    def _step(
        self, nodes: slice, lanes: _Lanes, gaps: Array, phi: Array, resting: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Return the moves (m, K + 1, L) of the nodes, and their rms distances (L,) from target."""
        x = self.x[:, nodes][:, :, lanes]
        target, along, slip = self.target.near(
            x * self.unit, nodes, lanes, self.slip[nodes][:, lanes]
        )
        self.slip[np.ix_(np.arange(len(self.slip))[nodes], lanes)] = slip
        away = (x - target / self.unit)[self.moves]
        distance = np.sqrt(np.mean(np.sum(away**2, axis=0), axis=0))
        # at rest the nodes move by the shortest way that closes the gaps, no longer towards the
        # target
        away = np.where(resting, 0.0, away)
        m = len(self.moves)
        width = np.zeros((m, *away.shape))
        width[np.arange(m), np.arange(m)] = self.freedom[:, nodes][:, :, lanes]
        if along is not None:
            sense = (along / self.unit)[self.moves]
            sense = sense / np.sqrt(np.sum(sense**2, axis=0))
            # a node may slip along its target curve at little cost: large variance in that
            # direction
            width += _ALONG * sense[:, None] * sense[None, :]
        # linear constraints A·move = gaps of all arcs, minimising (move + away)ᵀ W⁻¹ (move + away)
        rhs = gaps + away[:, 1:] - np.einsum("ijkN,jkN->ikN", phi, away[:, :-1])
        # Lagrange multipliers λ of the arcs; the move is W Aᵀ λ − away
        multiplier = _solve(phi, width, rhs)
        pull = np.zeros_like(away)
        pull[:, 1:] += multiplier
        pull[:, :-1] -= np.einsum("jikN,jkN->ikN", phi, multiplier)
        move = np.einsum("ijkN,jkN->ikN", width, pull) - away
        size = np.sqrt(np.sum(x[self.moves] ** 2, axis=0))
        length = np.sqrt(np.sum(move**2, axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            # one factor per flight: all its nodes are shortened alike, which keeps the direction
            factor = np.min(_LONGEST * size / length, axis=0)
        return move * np.fmin(1.0, factor), distance


def _solve(phi: Array, width: Array, rhs: Array) -> Array:
    """Solve A W Aᵀ λ = rhs for all flights as one banded system; shapes as in `ArcSearch._step`."""
    m, arcs, cases = rhs.shape
    # Block (k, k) is Φ W Φᵀ + W', block (k + 1, k) is −Φ' W' with k + 1 marked by a prime.
    spread = np.einsum("ijkN,jlkN->ilkN", phi, width[:, :, :-1])
    diagonal = np.einsum("ijkN,ljkN->ilkN", spread, phi) + width[:, :, 1:]
    below = -spread[:, :, 1:]
    # Lower form: entry (row, column) of the matrix stands at [row − column, column]; flights are
    # laid one after the other, nothing couples them.
    band = np.zeros((2 * m, cases, arcs, m))
    for j in range(m):
        for i in range(j, m):
            band[i - j, :, :, j] = diagonal[i, j].T
        for i in range(m):
            band[m + i - j, :, :-1, j] = below[i, j].T
    flat = band.reshape(2 * m, -1)
    try:
        solution = solveh_banded(flat, rhs.transpose(2, 1, 0).reshape(-1), lower=True)
    except LinAlgError as fault:
        raise InputError(
            "no flight can be continuous with so many states held: give the nodes more freedom"
        ) from fault
    return np.asarray(solution.reshape(cases, arcs, m).transpose(2, 1, 0))
