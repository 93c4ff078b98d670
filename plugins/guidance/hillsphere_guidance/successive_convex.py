"""Successive convex programming: flights under held commands and linearised constraints."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from scipy import sparse

from hillsphere.errors import ConvergenceError, PropagationError
from hillsphere.interfaces import Array, GuidanceTask, GuidedFlight, Plant
from hillsphere_guidance.errors import InfeasibleGuidanceError
from hillsphere_guidance.held_steps import HeldSteps, command_times, fly_held_steps
from hillsphere_guidance.minimum_energy import MinimumEnergy
from hillsphere_guidance.motion import Motion, motion_of
from hillsphere_guidance.requirements import Constraints, Requirements, Violations
from hillsphere_guidance.specs import MinimumEnergySpec
from hillsphere_guidance.splines import gauss_nodes

__all__ = ["fly_successively"]

_FIRST_PENALTY, _GROWTH, _LARGEST_GROWTH = 20.0, 10.0, 100.0
"""Penalty of a violation, in natural units per unit of cost and of its largest derivative by a
command, and its growth. The penalty is exact once it exceeds the Lagrange multipliers, which are of
the order of that derivative; a much larger one makes the rounds creep along curved constraints."""
_FIRST_RADIUS, _LEAST_RADIUS, _LARGEST_RADIUS = 0.3, 1e-9, 10.0
"""Radii of the trust region about the last path, in the plant's units of length and speed: the
first, the least (at which a search without progress ends) and the largest."""
_GAIN = 1e-6
"""Relative gain of cost that is not worth another round."""
_ROUNDS = 60
"""Convex problems at one penalty at most. A search that converges needs fewer; one that does not
would otherwise end only when its trust region has shrunk."""
_MET = 1e-6
"""Violation, natural units, that may remain before the flight is closed by shooting. Shooting
converges from there; a smaller value would cost rounds for digits that shooting gives at once."""
_CLOSED = 1e-11
"""Largest miss of the end of a closed flight, natural units: what rounding leaves after hundreds of
steps. A smaller limit is not reached, a larger one would show in the replays of the flight."""
_SHOTS = 20
"""Newton iterations of the shooting at most. From a path whose gaps are below `_MET` a few suffice;
if twenty do not, the steps are too long for their linearisation."""
_START_POINTS = 16
"""Control points of the first guess, a path of least energy: enough for its shape. Its command is
then averaged over the steps, so that a finer one would start no better."""


@dataclass(frozen=True)
class _Iterate:
    """A path of N steps, with gaps between the steps.

    Parameters
    ----------
    x : ndarray, shape (n, N + 1)
        States at the starts of the steps, and at the end.
    u : ndarray, shape (d, N)
        Accelerations held.
    steps : HeldSteps
        Each step flown from its own start.
    """

    x: Array
    u: Array
    steps: HeldSteps


def fly_successively(plant: Plant, task: GuidanceTask, requirements: Requirements) -> GuidedFlight:
    """Find a flight of locally least cost that meets constraints.

    Each round flies every step exactly, linearises it with exact derivatives, and solves a
    second-order cone program for the change of the path within a trust region. Virtual controls
    take up what the linear model cannot meet, at an exact penalty. The region grows or shrinks with
    the ratio of the true to the predicted reduction of the cost [1]_. Finally the steps are closed
    to one flight by shooting, so that it satisfies the equations of the plant to rounding.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    task : GuidanceTask
        Start, end and duration.
    requirements : Requirements
        Cost and limits.

    Returns
    -------
    GuidedFlight
        With commands held for `requirements.hold_s` (the last one shorter or longer).

    Raises
    ------
    InfeasibleGuidanceError
        If the rounds end at a path that violates a constraint.
    ConvergenceError
        If they do not end.

    References
    ----------
    .. [1] Y. Mao, M. Szmuk, B. Açıkmeşe (2016), Successive convexification of non-convex optimal
       control problems and its convergence properties, 55th IEEE Conference on Decision and
       Control, 3636-3641.
    """
    return _Search(plant, task, requirements).run()


class _Search:
    """The search of one task.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    task : GuidanceTask
        Start, end and duration.
    requirements : Requirements
        Cost and limits.
    """

    def __init__(self, plant: Plant, task: GuidanceTask, requirements: Requirements) -> None:
        self._plant, self._task, self._wanted = plant, task, requirements
        self._motion: Motion = motion_of(plant)
        self._t = command_times(task.duration_s, requirements.hold_s)
        self._h = np.diff(self._t)
        scales = self._motion.scales
        self._acceleration = scales.length_m / scales.time_s**2
        self._rows = [*self._motion.positions, *self._motion.velocities]
        self._unit = self._motion.unit[self._rows]
        self._weights = self._h / scales.time_s
        # a gap in position counts as the speed that closes it in one step
        step = float(min(1.0, self._weights.min()))
        self._gap_unit = np.array([step] * self._motion.axes + [1.0] * self._motion.axes)
        self._constraints: Constraints = requirements.constraints(
            plant, task, self._t, self._acceleration
        )

    def run(self) -> GuidedFlight:
        """Iterate from the path of least energy; the penalty grows until the path is a flight."""
        best, rounds, growth, before = self._first(), 0, 1.0, np.inf
        slope = self._wanted.slope(best.u / self._acceleration)
        while True:
            best, excess, more = self._descend(best, _FIRST_PENALTY * slope * growth)
            rounds += more
            if excess.largest <= _MET:
                break
            # with an exact penalty a feasible problem is met at once: less than half of the
            # violation gone means that it is infeasible
            if growth >= _LARGEST_GROWTH or excess.largest > 0.5 * before:
                raise InfeasibleGuidanceError(
                    f"no flight meets all requirements: after {rounds} rounds the best has "
                    f"{excess.words()}; give more time or thrust, or ask for less"
                )
            growth, before = growth * _GROWTH, excess.largest
        flown, shots = self._close_by_shooting(best)
        left = self._cost(flown)[1]
        if left.largest > 10.0 * _MET:
            raise InfeasibleGuidanceError(
                f"closed to one flight the path has {left.words()}; take shorter steps (hold_s)"
            )
        return self._flight(flown, f"{rounds} convex problems, {shots} shots")

    def _descend(self, best: _Iterate, penalty: float) -> tuple[_Iterate, Violations, int]:
        """Reduce cost plus penalised violations until a round gains nothing."""
        radius, rounds = _FIRST_RADIUS, 0
        cost, excess = self._cost(best)
        while radius >= _LEAST_RADIUS:
            if rounds == _ROUNDS:
                if excess.largest > _MET:
                    break
                raise ConvergenceError(
                    f"successive convexification: no end after {_ROUNDS} rounds, at a cost of "
                    f"{cost:.6g}; give more time, or fewer requirements"
                )
            rounds += 1
            merit = cost + penalty * excess.total
            predicted, x, u = self._solve_convex(best, radius, penalty)
            gain = merit - predicted
            if gain <= _GAIN * (1.0 + cost):
                break
            # ratio of the true to the predicted reduction, of the better of two candidates
            ratio = -np.inf
            for candidate in self._candidates(x, u):
                new_cost, new_excess = self._cost(candidate)
                new_ratio = (merit - new_cost - penalty * new_excess.total) / gain
                if new_ratio > ratio:
                    ratio, better = new_ratio, (candidate, new_cost, new_excess)
            if ratio > 0.0:
                best, cost, excess = better
            # the usual limits of trust-region methods: shrink below 1/4, grow above 3/4
            if ratio < 0.25:
                radius *= 0.3
            elif ratio > 0.75:
                radius = min(2.0 * radius, _LARGEST_RADIUS)
        return best, excess, rounds

    def _first(self) -> _Iterate:
        """Return the minimum-energy path, its command averaged over the steps."""
        task, t = self._task, self._t
        guess = MinimumEnergy(MinimumEnergySpec(control_points=_START_POINTS)).plan(
            self._plant, task
        )
        place, weights = gauss_nodes(t, 3)
        a = (guess.command(place) * weights).reshape(self._motion.axes, len(self._h), 3)
        return self._iterate(guess.states(t), a.sum(axis=2) / self._h)

    def _iterate(self, x: Array, u: Array) -> _Iterate:
        """Return states and command as an iterate, each step flown from its own start."""
        times = self._task.time_s + self._t[:-1]
        return _Iterate(x, u, fly_held_steps(self._motion, x[:, :-1], u, self._h, times))

    def _defects(self, it: _Iterate) -> Array:
        """Return the gaps between the steps (2d, N), natural units."""
        return np.asarray((it.steps.end - it.x[:, 1:])[self._rows] / self._unit[:, None])

    def _cost(self, it: _Iterate) -> tuple[float, Violations]:
        """Return the true cost and the violations."""
        u = it.u / self._acceleration
        excess = self._constraints.violations(it.x[self._motion.positions], u)
        excess.add("gaps between its steps", np.abs(self._defects(it)) / self._gap_unit[:, None])
        return self._wanted.cost(u, self._weights), excess

    def _solve_convex(
        self, it: _Iterate, radius: float, penalty: float
    ) -> tuple[float, Array, Array]:
        """Solve the convex problem about a path; return its cost, states and command.

        The unknowns are the changes of the inner states, the command and the virtual controls.
        """
        cp: Any = import_module("cvxpy")  # slow to import, and ships no complete types

        d, n = self._motion.axes, len(self._h)
        unit, size = self._unit, self._acceleration
        by_state = it.steps.by_state * (unit / unit[:, None])[:, :, None]
        by_command = it.steps.by_command * (size / unit)[:, None, None]
        change = cp.Variable(2 * d * (n - 1))
        u = cp.Variable((d, n))
        virtual = cp.Variable(2 * d * n)
        # linear dynamics: change after step k = A_k change before + B_k (u − u_k) + gap + virtual
        # control. Both ends are fixed: the first step has no change before it, the last none after.
        inner = sparse.eye_array(2 * d * n, format="csc")[:, : 2 * d * (n - 1)]
        # Blocks that are sparse arrays make a sparse array in every SciPy; dense ones make a matrix
        # in some versions and an array in others.
        states = [sparse.coo_array(by_state[:, :, k]) for k in range(n)]
        commands = [sparse.coo_array(by_command[:, :, k]) for k in range(n)]
        before = sparse.block_diag(states, format="csc")[:, 2 * d :]
        pushed = sparse.block_diag(commands, format="csc")
        known = self._defects(it).T.ravel() - pushed @ (it.u / size).T.ravel()
        dynamics = inner @ change - before @ change - pushed @ cp.vec(u, order="F") == (
            known + cp.multiply(np.tile(self._gap_unit, n), virtual)
        )
        rules: list[Any] = [dynamics, cp.abs(change) <= radius]
        moved = cp.reshape(change, (2 * d, n - 1), order="F")
        cost = self._wanted.convex_cost(cp, u, self._weights, rules)
        slack = self._constraints.convex_rules(
            cp, it.x[self._motion.positions], moved[:d], it.u / size, u, rules
        )
        total = cost + penalty * (cp.norm1(virtual) + slack)
        problem = cp.Problem(cp.Minimize(total), rules)
        try:
            with warnings.catch_warnings():
                # an inaccurate solution is accepted or not by the flight that results from it
                warnings.simplefilter("ignore", UserWarning)
                problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError as error:
            raise ConvergenceError(f"successive convexification: {error}") from error
        if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            raise ConvergenceError(
                f"successive convexification: the convex problem is {problem.status}"
            )
        x = it.x.copy()
        x[self._rows, 1:-1] += np.asarray(moved.value) * unit[:, None]
        return float(problem.value), x, np.asarray(u.value) * size

    def _candidates(self, x: Array, u: Array) -> Iterator[_Iterate]:
        """Yield the path of a convex problem, and the same with its gaps closed to first order."""
        try:
            flat = self._iterate(x, u)
            yield flat
            yield self._close_gaps(flat)
        except PropagationError:
            return  # a path through the body's centre: a smaller region excludes it

    def _close_gaps(self, it: _Iterate) -> _Iterate:
        """Close the gaps to first order by the least relative change of the command."""
        steps, unit = it.steps, self._unit
        gaps = (steps.end - it.x[:, 1:])[self._rows]
        reach, carried = self._reach(steps, gaps)
        bend = self._least(reach, -carried, it.u)
        x, u = it.x.copy(), it.u + bend
        moved = np.zeros(len(unit))
        for k in range(len(self._h) - 1):
            moved = (
                steps.by_state[:, :, k] @ moved
                + steps.by_command[:, :, k] @ bend[:, k]
                + gaps[:, k]
            )
            x[self._rows, k + 1] += moved
        return self._iterate(x, u)

    def _reach(self, steps: HeldSteps, gaps: Array) -> tuple[Array, Array]:
        """Return the end's derivatives by the command (2d, d, N), and its change by gaps (2d,)."""
        reach, onwards = np.empty_like(steps.by_command), np.eye(len(self._unit))
        carried = np.zeros(len(self._unit))
        for k in range(len(self._h) - 1, -1, -1):
            reach[:, :, k] = onwards @ steps.by_command[:, :, k]
            carried += onwards @ gaps[:, k]
            onwards = onwards @ steps.by_state[:, :, k]
        return reach, carried

    def _least(self, reach: Array, miss: Array, u: Array) -> Array:
        """Return the least relative change (d, N) of a command that moves the end by `miss` (2d,).

        The change of each command is weighted by its size, so that a coast stays a coast.
        """
        weight = np.linalg.norm(u, axis=0) + 1e-9 * self._acceleration
        table = (reach / self._unit[:, None, None] * weight).reshape(len(miss), -1)
        bend = np.linalg.lstsq(table, miss / self._unit, rcond=None)[0]
        return np.asarray(bend.reshape(u.shape) * weight)

    def _close_by_shooting(self, it: _Iterate) -> tuple[_Iterate, int]:
        """Fly from the start and correct the command, by Newton's method, to meet the end.

        Of all corrections the least relative one is taken: commands of zero stay zero.
        """
        u, goal = np.array(it.u), it.x[self._rows, -1]
        self._substeps = self._motion.step_map.choose_steps(
            np.ascontiguousarray(it.x[:, :-1]), self._h, 1e-11, u, self._task.time_s + self._t[:-1]
        )
        worst = np.inf
        for shot in range(_SHOTS):
            x, steps = self._fly(u)
            miss = (goal - x[self._rows, -1]) / self._unit
            if np.abs(miss).max() <= _CLOSED:
                return _Iterate(x, u, steps), shot + 1
            worst = float(np.abs(miss).max())
            reach, _ = self._reach(steps, np.zeros((len(miss), len(self._h))))
            u = u + self._least(reach, goal - x[self._rows, -1], u)
        raise ConvergenceError(
            f"successive convexification: the flight does not close, it misses its end by "
            f"{worst:.1e} of the plant's scales; take shorter steps (hold_s)"
        )

    def _fly(self, u: Array) -> tuple[Array, HeldSteps]:
        """Return the states (n, N + 1) of the flight under a command, and its steps."""
        motion, times = self._motion, self._task.time_s + self._t[:-1]
        x = np.empty((len(motion.states), len(self._t)))
        x[:, 0] = self._task.start
        for k, h in enumerate(self._h):
            x[:, k + 1] = motion.step_map.propagate(
                x[:, k], h, self._substeps, np.ascontiguousarray(u[:, k]), times[k]
            )
        return x, fly_held_steps(motion, x[:, :-1], u, self._h, times)

    def _flight(self, it: _Iterate, account: str) -> GuidedFlight:
        """Return the flight as functions of time."""
        motion, task, nodes = self._motion, self._task, self._t
        last = len(self._h) - 1
        substeps = self._substeps

        def place(t: Array) -> Any:
            return np.clip(np.searchsorted(nodes, t, side="right") - 1, 0, last)

        def states(t: Array) -> Array:
            k = place(t)
            begun, u = np.ascontiguousarray(it.x[:, k]), np.ascontiguousarray(it.u[:, k])
            x = motion.step_map.propagate(begun, t - nodes[k], substeps, u, task.time_s + nodes[k])
            return np.asarray(x)

        def command(t: Array) -> Array:
            return np.array(it.u[:, place(t)])

        return GuidedFlight(task.duration_s, states, command, nodes, account)
