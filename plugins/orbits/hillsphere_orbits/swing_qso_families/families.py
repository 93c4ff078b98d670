"""Continuation of families of orbits of several revolutions from first members to their ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import StepMap, bracketed_roots
from hillsphere.errors import ConvergenceError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch, StepControl
from hillsphere_orbits.correction import tangents
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.lockstep import follow_lanes
from hillsphere_orbits.shooting import Shooting, SymmetricShooting
from hillsphere_orbits.swing_qso_families.curves import at_positions, swing_problem
from hillsphere_orbits.swing_qso_families.starts import Start
from hillsphere_orbits.winding import turns

__all__ = ["Chain", "Limits", "follow", "groups_of", "integration_time"]

_CONTROL = StepControl(first=0.03, largest=0.4, turn=0.3, members=200)
_FOLLOWED = 1e-6  # error of the flow while following; returned members are corrected further
_WITHOUT_MIRROR = 1e-10  # the same where no mirror separates the branches
_RETURNED = 1e-11
"""Error of the flow over the time that is solved, for the members that are returned."""
_MARGIN = 1.5  # of the sub-steps that meet the tolerance: it divides the error by 25
_EDGE = 1e-3  # of the distance of two orbits: where the last one lies
_LOOKS = 64  # per revolution, at the distance from the body
_APART = 1e-7  # of two orbits by which the growth of errors is judged
_MOST = 1 << 12
"""Most sub-steps. An orbit that needs more passes through the body or next to a singularity: it
lies beyond the end of its family."""
_ROUNDING = 3e-14  # of the matrix: rounding, below which no number of steps helps
_PASSES = 3
"""Most times that a group is followed: each pass takes the sub-steps which the ends of the last one
need, and the result of the last pass stands."""
_SIMILAR = 1.6  # largest ratio of the revolutions of families that share their sub-steps
_RETURNS = 0.3  # of the largest closure after one revolution: below it the parent is near
_CLEARANCE = 1e-9  # of an event: on the surface itself the gravity gradient is ambiguous
_ON_PARENT = 1e-6  # closure after one revolution
_MAPS: WeakKeyDictionary[Flow, StepMap] = WeakKeyDictionary()
SURFACE, CLOSE, FAR, LONG, UNSTABLE, LOOP, RETURN, COLLISION = (
    "the orbits graze the surface",
    "the orbits come as near to the centre as was asked for",
    "the orbits reach as far out as was asked for",
    "the family is as long as was asked for",
    "the orbits become too unstable to be computed over half a period",
    "the family closes: it is a loop",
    "the family returns to orbits of one revolution",
    "the next orbits wind otherwise about the body: there was a collision in between",
)


@dataclass(frozen=True)
class Limits:
    """How far families are followed, in natural units.

    Parameters
    ----------
    nearest : float
        Least distance from the centre of mass; 0 for the body's surface only.
    farthest : float or None
        Largest x or −x; None for three times that of the bifurcation.
    length : float
        Arclength of a family in its unknowns.
    growth : float
        Largest growth of a small error over the time that is solved for. Rounding grows by as
        much; for a symmetric orbit the square is about the largest multiplier.
    """

    nearest: float
    farthest: float | None
    length: float
    growth: float = 3e4


@dataclass(frozen=True)
class Chain:
    """A family as computed.

    Parameters
    ----------
    start : Start
        Where it begins.
    steps : int
        Sub-steps to rounding, of the time that is solved for.
    branch : Branch
        Its orbits, the first one next to the bifurcation.
    """

    start: Start
    steps: int
    branch: Branch

    def problem(self, flow: Flow) -> Shooting:
        """Return the equations of its orbits."""
        mirror = self.start.symmetry != "none"
        return swing_problem(flow, self.start.axis, mirror=mirror).with_steps(self.steps)

    def regular_problem(self, flow: Flow) -> Shooting:
        """Return equations in the same unknowns that are regular where one of two mirrors breaks.

        There half a period from mirror to mirror is solved by orbits of either family. With the
        distance κ between them these equations differ by κ³ only (a pitchfork), so that a residual
        of 1e-9 allows κ = 1e-3.
        """
        if self.start.symmetry != "xy":
            return self.problem(flow)
        return swing_problem(flow, self.start.axis, other=True).with_steps(self.steps)


def integration_time(problem: Shooting, z: Array) -> Array:
    """Return the time (N,) over which a problem integrates: half a period, or a whole one."""
    period = problem.period(z)
    return 0.5 * period if isinstance(problem, SymmetricShooting) else period


def follow(flow: Flow, starts: Sequence[Start], limits: Limits) -> tuple[list[Chain], list[str]]:
    """Follow families to their ends in lockstep.

    Parameters
    ----------
    flow : Flow
        Equations of motion, normalised.
    starts : sequence of Start
        First members, as `groups_of` puts them together.
    limits : Limits
        Where to stop at the latest.

    Returns
    -------
    chains : list of Chain
        In the order of the starts; those without a second member are left out.
    notes : list of str
        Which were left out, and why.
    """
    chains: dict[int, Chain] = {}
    notes: list[str] = []
    todo = [list(range(len(starts)))]
    while todo:
        some = todo.pop()
        try:
            followed = _Follower(flow, [starts[k] for k in some], limits).chains()
        except (ConvergenceError, PropagationError) as error:
            if len(some) > 1:
                # the failure of one family must not stop the others
                todo += [[k] for k in some]
                continue
            start = starts[some[0]]
            notes.append(f"{start.d}:{start.n} from the {start.axis} axis: {error}")
        else:
            chains.update(zip(some, followed, strict=True))
    return [chains[k] for k in sorted(chains)], notes


def groups_of(starts: Sequence[Start]) -> list[list[int]]:
    """Return numbers of starts with the same equations and similar revolutions, in groups."""
    groups: list[list[int]] = []

    def equations(k: int) -> tuple[bool, str]:
        return starts[k].symmetry == "none", starts[k].axis

    for k in sorted(range(len(starts)), key=lambda k: (*equations(k), starts[k].n)):
        first = groups[-1][0] if groups else k
        alike = equations(first) == equations(k) and starts[k].n <= _SIMILAR * starts[first].n
        if groups and alike:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _map_of(flow: Flow) -> StepMap:
    """Return the flow without its matrix: a seventh of the work, for a look at orbits."""
    if flow not in _MAPS:
        _MAPS[flow] = StepMap(flow.system, method="dop853")
    return _MAPS[flow]


class _Follower:
    """Continuation of families with the same equations, one per lane."""

    def __init__(self, flow: Flow, starts: list[Start], limits: Limits) -> None:
        self.flow, self.starts, self.limits = flow, starts, limits
        self._map = _map_of(flow)
        self.problem = swing_problem(flow, starts[0].axis, mirror=starts[0].symmetry != "none")
        self.n = np.array([start.n for start in starts])
        z = np.array([start.z for start in starts]).T
        origin = np.array([start.origin for start in starts]).T
        self.z, self.sense = z, z - origin
        mirror = isinstance(self.problem, SymmetricShooting)
        self._error = _FOLLOWED if mirror else _WITHOUT_MIRROR
        self.problem = self.problem.with_steps(_steps(self.problem, z, self._error))
        way = self._way(self.problem.state(origin), integration_time(self.problem, origin))
        reach = np.max(np.abs(way[0]), axis=0)
        self.farthest = (
            3.0 * reach if limits.farthest is None else np.full(z.shape[1], limits.farthest)
        )
        impact = flow.system.events.get("impact")
        self._impact = flow.system.function(impact) if impact is not None else None
        self._forget()

    def _forget(self) -> None:
        lanes = self.z.shape[1]
        self._gap: list[Array | None] = [None] * lanes
        self._widest = np.zeros(lanes)
        self._last, self._length = self.z.copy(), np.zeros(lanes)
        self._ahead = np.zeros(lanes, dtype=bool)

    def chains(self) -> list[Chain]:
        """Follow all lanes."""
        exact = self.problem
        for _ in range(_PASSES):
            self._forget()
            branches = follow_lanes(
                self.problem, self.z, self.sense, done=self._done, control=_CONTROL,
                exact=self._exact,
            )  # fmt: skip
            exact = self._final
            ends = np.concatenate([b.z[:, -2:-1] for b in branches], axis=1)
            needed = _steps(self.problem, ends, 30.0 * self._error, 2)
            if needed <= self.problem.steps:
                break
            self.problem = self.problem.with_steps(needed)
        return [
            Chain(start, exact.steps, self._wound(k, exact, self._trim_at_end(k, exact, branch)))
            for k, (start, branch) in enumerate(zip(self.starts, branches, strict=True))
        ]

    def _wound(self, lane: int, problem: Shooting, branch: Branch) -> Branch:
        """Cut the branch before the first member that winds differently about the body.

        In the plane that number changes only in a collision, so that a family which a step took
        across one is no longer the same.
        """
        z = branch.z
        time, steps = integration_time(problem, z), max(problem.steps, _LOOKS * int(self.n[lane]))
        way = self._map.trajectory(problem.state(z), time, steps, strict=False)
        number = turns(way)
        # half a symmetric orbit winds by half the whole number
        other = np.flatnonzero(np.abs(number - number[0]) > 0.25)
        if not other.size:
            return branch
        kept = int(other[0])
        if kept < 2:
            raise ConvergenceError(f"{COLLISION} next to the bifurcation")
        return Branch(z[:, :kept], branch.tangent[:, :kept], (branch.ends[0], COLLISION))

    def _exact(self, chains: list[Array]) -> Shooting:
        """Return the equations with the sub-steps that the members returned need."""
        least = self.problem.steps
        for back in (2, 3, 5, 9):
            # the last member may lie beyond the end, and those before it graze the surface, where
            # no number of steps is enough
            picks = [np.unique([0, c.shape[1] // 2, max(c.shape[1] - back, 0)]) for c in chains]
            some = np.concatenate([c[:, i] for c, i in zip(chains, picks, strict=True)], axis=1)
            steps = _steps(self.problem, some, _RETURNED, least)
            if steps > least:
                break
        self._final = self.problem.with_steps(max(int(_MARGIN * steps), least))
        return self._final

    def _way(self, x: Array, duration: Array) -> Array:
        """Return the trajectory (6, P, N) over the time that the problem solves, for a look."""
        whole = 2 if isinstance(self.problem, SymmetricShooting) else 1
        steps = max(self.problem.steps, _LOOKS * int(self.n.max()) // whole)
        return self._map.trajectory(x, duration, steps, strict=False)

    def _room(self, way: Array, lanes: NDArray[np.intp]) -> Array:
        """Return least clearance of the surface, least and largest distance, (3, N)."""
        states, points, cases = way.shape
        surface = np.ones(cases)
        if self._impact is not None:
            flat = np.ascontiguousarray(way.reshape(states, points * cases))
            values = self._impact(flat, self.flow.system.parameters(None, points * cases))[0]
            surface = _least(values.reshape(points, cases)) - _CLEARANCE
        radius = np.sqrt(np.min(way[0] ** 2 + way[1] ** 2 + way[2] ** 2, axis=0))
        reach = np.max(np.abs(way[0]), axis=0)
        return np.array([surface, radius - self.limits.nearest, self.farthest[lanes] - reach])

    def _done(self, z: Array, lanes: NDArray[np.intp]) -> list[str]:
        x, duration, cases = self.problem.state(z), integration_time(self.problem, z), z.shape[1]
        beside = x + _APART * np.array([[0.5], [0.5], [0.0], [0.5], [0.5], [0.0]])
        both = self._way(np.concatenate([x, beside], axis=1), np.tile(duration, 2))
        room = self._room(both[:, :, :cases], lanes)
        growth = np.max(np.abs(both[:, -1, cases:] - both[:, -1, :cases]), axis=0) / _APART
        turn = self.problem.period(z) / self.n[lanes]
        steps = max(48, 2 * self.problem.steps // int(self.n.min()))
        gap = self._map.propagate(x, turn, steps, strict=False) - x
        reasons = []
        for k, lane in enumerate(lanes):
            self._length[lane] += float(np.linalg.norm(z[:, k] - self._last[:, lane]))
            reasons.append(
                SURFACE if not room[0, k] >= 0.0
                else CLOSE if room[1, k] < 0.0
                else FAR if room[2, k] < 0.0
                else UNSTABLE if not growth[k] <= self.limits.growth
                else LONG if self._length[lane] > self.limits.length
                else self._return_reason(int(lane), gap[:, k], z[:, k])
            )  # fmt: skip
            self._last[:, lane] = z[:, k]
        return reasons

    def _return_reason(self, lane: int, gap: Array, z: Array) -> str:
        """Say whether a lane has come back to orbits of one revolution, or to its own start."""
        before, self._gap[lane] = self._gap[lane], gap
        size = float(np.linalg.norm(gap))
        self._widest[lane] = max(self._widest[lane], size)
        one_turn = self.starts[lane].parent < 0
        # near the parent the orbit almost closes after one revolution
        small = size < _RETURNS * self._widest[lane]
        # passing through the parent, the displacement after one revolution changes sign
        back = before is not None and (float(gap @ before) < 0.0 or size < _ON_PARENT)
        if one_turn and small and back:
            return RETURN
        passed = float(self.sense[:, lane] @ (z - self.z[:, lane])) > 0.0
        near = float(np.linalg.norm(z - self.z[:, lane])) < 2.0 * _CONTROL.largest
        closes = passed and near and not self._ahead[lane] and self._length[lane] > 2.0
        self._ahead[lane] = passed
        return LOOP if closes else ""

    def _trim_at_end(self, lane: int, problem: Shooting, branch: Branch) -> Branch:
        """Put the family's last member where it ends, or leave out one that lies beyond."""
        reason = branch.ends[1]
        edges = (SURFACE, CLOSE, FAR)
        if reason in edges:
            row, last = edges.index(reason), branch.size - 1.0
            if branch.size < 3:
                raise ConvergenceError(f"{reason} next to the bifurcation")
            self.problem = problem

            def room(u: Array) -> Array:
                z = at_positions(problem, branch, u)
                way = self._way(problem.state(z), integration_time(problem, z))
                return np.asarray(self._room(way, np.array([lane]))[row])

            low, high = np.array([last - 1.0]), np.array([last])
            try:
                f_low, f_high = room(low), room(high)
                if f_low[0] > 0.0 > f_high[0]:
                    u = bracketed_roots(room, low, high, f_low, f_high, np.array([_EDGE]))
                    z = at_positions(problem, branch, u)
                    line = tangents(problem, z, branch.tangent[:, -1])
                    return Branch(
                        np.hstack([branch.z[:, :-1], z]),
                        np.hstack([branch.tangent[:, :-1], line]),
                        branch.ends,
                    )
            except (ConvergenceError, PropagationError):
                pass  # beyond the surface orbits may not exist: the last one before it is the end
        beyond = reason in (*edges, UNSTABLE) or reason == RETURN
        if not beyond:
            return branch
        if branch.size < 3:
            raise ConvergenceError(f"{reason} next to the bifurcation")
        return Branch(branch.z[:, :-1], branch.tangent[:, :-1], branch.ends)


def _least(values: Array) -> Array:
    """Least value of each column (P, N) of samples along a way, refined by a parabola."""
    i = np.clip(np.argmin(values, axis=0), 1, values.shape[0] - 2)
    lane = np.arange(values.shape[1])
    before, here, after = values[i - 1, lane], values[i, lane], values[i + 1, lane]
    bend, slope = before - 2.0 * here + after, 0.5 * (after - before)
    vertex = here - 0.5 * slope**2 / np.where(bend > 0.0, bend, np.inf)
    return np.asarray(np.minimum(np.min(values, axis=0), vertex))


def _steps(problem: Shooting, z: Array, tolerance: float, least: int = 32) -> int:
    """Return sub-steps that meet a tolerance, or rounding where that is more; at least so many.

    Where no number of steps meets it (an orbit dips into the body, where the gravity gradient is
    not smooth) the least is returned: such an orbit is beyond the end of its family.
    """
    flow, x, duration = problem.flow, problem.state(z), integration_time(problem, z)
    try:
        # a coarse flight measures how much rounding is magnified; the finer one need not go below
        # that
        coarse = flow.map.choose_steps(x, duration, max(tolerance, 1e-6), most=_MOST)
        if tolerance >= 1e-6:
            return max(coarse, least)
        size = float(np.max(np.abs(flow.with_matrix(x, duration, coarse)[1])))
        fine = flow.map.choose_steps(x, duration, max(tolerance, _ROUNDING * size), most=_MOST)
    except PropagationError:
        return least
    return max(fine, least)
