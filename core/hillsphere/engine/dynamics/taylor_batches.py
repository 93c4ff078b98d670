"""Adaptive Taylor integrators of the compile layer, driven in batches of lanes.

Zeros of events are those of their Taylor polynomials over a whole step. They are isolated by
Descartes' rule of signs and bisection, so that pairs within one step are separated down to
rounding. Only falls along the flight stop an integrator. If it stopped at a rise too, it would miss
a fall of another event at the same instant and, for some time, further zeros of the same event.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.lane_refill import LaneRefill
from hillsphere.symbolic._heyoka import heyoka as _hy
from hillsphere.symbolic.expressions import Expr

__all__ = ["Ends", "TaylorBatches"]

_VECTOR = int(_hy.recommended_simd_size())
"""Lanes of one vector of the processor."""
_BATCH = 2 * _VECTOR
"""Lanes that fly together if there are as many: the operations of two vectors overlap, which saves
a fifth to a third of the time; four save no more. A lane's bits are the same at any width but one.
"""
_LEAST_HAIR = 1e-12
"""Least value of a switching function at the end of a step past its zero: above the rounding of
functions of order one, which could show the wrong sign."""
_HAIR = 16.0
"""The same in tolerances: the truncation of the Taylor series misses the zero by up to 5."""
_ROUNDING = 4.0 * np.finfo(float).eps
_MOMENT = 2.0**-20
"""Fraction of a flight after which the sign of an event that begins at zero is evaluated. By then
the change of the event due to its second derivative is far above rounding."""
_HALVINGS = 53
"""Bisections of a flight down to one unit in the last place of a double."""
_BESIDE = 1e-3
"""Fraction of a step on either side of a zero with zero slope at which signs are compared."""
_TIME_LIMIT = int(_hy.taylor_outcome.time_limit)
_NON_FINITE = int(_hy.taylor_outcome.err_nf_state)
_Lanes: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Ends:
    """Ends of N lanes: rows y, times, ending events, and records per event and lane.

    A lane that became non-finite has NaN in y.
    """

    y: Array
    time: Array
    ended_by: list[str | None]
    met: dict[tuple[str, int], list[tuple[float, Array]]]

    def end(self, lane: int, y: Array, time: float, name: str) -> None:
        """End a lane earlier."""
        sense = np.sign(self.time[lane] - time)
        self.y[:, lane], self.time[lane], self.ended_by[lane] = y, time, name
        for key, met in self.met.items():
            if key[1] == lane:
                met[:] = [one for one in met if sense * (one[0] - time) <= 0]


class _Carried:
    """Data of the present lanes for the callbacks of an integrator; each flight sets it anew."""

    lanes: _Lanes
    alive: NDArray[np.bool_]
    start: Array
    clock: Array
    met: dict[tuple[str, int], list[tuple[float, Array]]]


class TaylorBatches:
    """Integrators of one system, one per width, compiled when first needed.

    Parameters
    ----------
    equations : sequence of (Expr, Expr)
        Variable and its time derivative, run-time parameters numbered.
    n : int
        Number of states, which are recorded at events; the other rows are derivatives.
    tol : float
        Tolerance.
    ends, recorded : mapping of str to Expr
        Events that end a lane when they fall along the flight; events to record.
    switches : sequence of Expr
        Functions whose zeros end a step but not a flight.
    compact : bool
        Compile in compact mode.
    parameters : int
        Number k of run-time parameters.
    """

    def __init__(
        self,
        equations: Sequence[tuple[Expr, Expr]],
        n: int,
        tol: float,
        ends: Mapping[str, Expr],
        recorded: Mapping[str, Expr],
        switches: Sequence[Expr],
        compact: bool,
        parameters: int,
    ) -> None:
        self._equations, self._n, self._tol, self._compact = list(equations), n, tol, compact
        self._ends, self._recorded = dict(ends), dict(recorded)
        self._names = list(ends)
        self._outcomes = range(-len(ends), 0)
        # Of a lane that flies backward an event falls along the flight where it rises in time.
        self._sense = _hy.par[parameters]
        # A step over a switch must end on the side it flies to, beyond doubt, for the next one to
        # take the right branch: outbound on the upper of these two levels, inbound on the lower.
        hair = max(_LEAST_HAIR, _HAIR * tol)
        self._levels = [level for s in switches for level in (s - hair, s + hair)]
        self._carried = _Carried()
        self._integrators: dict[int, Any] = {}
        self._compiled: dict[tuple[Expr, ...], Any] = {}

    def fly(self, y: Array, p: Array, start: Array, target: Array) -> Ends:
        """Propagate lanes to their targets or ends.

        Parameters
        ----------
        y : ndarray, shape (rows, N)
            Start.
        p : ndarray, shape (k, N)
            Run-time parameters.
        start, target : ndarray, shape (N,)
            Times.

        Returns
        -------
        Ends
            End of each lane.
        """
        ends = self._flown(y, p, start, target)
        if not self._ends or not y.shape[1]:
            return ends
        # Two kinds of ends are not zeros of a series: an event that begins at zero with zero slope,
        # and one whose sign changed without a detected zero.
        before = self._values(y, p, start)
        for lane in np.flatnonzero((before == 0).any(axis=0)):
            self._leave_zero(ends, y, p, start, target, int(lane), before[:, lane] == 0)
        after = self._values(ends.y, p, ends.time)
        by_none = np.array([name is None for name in ends.ended_by])
        for lane in np.flatnonzero(((before > 0) & (after < 0)).any(axis=0) & by_none):
            self._halve(ends, y, p, start, target, int(lane), before[:, lane] > 0)
        return ends

    def _flown(self, y: Array, p: Array, start: Array, target: Array) -> Ends:
        """Propagate as `fly` does, with the events that are zeros of the series only."""
        cases = y.shape[1]
        ends = Ends(np.empty_like(y), np.empty(cases), [None] * cases, {})
        self._carried.met = ends.met
        if cases:
            self._stream(ends, y, p, start, target)
            ends.y[:, ~np.isfinite(ends.y).all(axis=0)] = np.nan
        return ends

    def _leave_zero(
        self,
        ends: Ends,
        y: Array,
        p: Array,
        start: Array,
        target: Array,
        lane: int,
        zero: NDArray[np.bool_],
    ) -> None:
        """End a lane at its start if an event that is zero there, with zero slope, falls."""
        one = slice(lane, lane + 1)
        soon = start[one] + _MOMENT * (target[one] - start[one])
        first = self._flown(y[:, one], p[:, one], start[one], soon)
        fell = zero & (self._values(first.y, p[:, one], first.time)[:, 0] < 0)
        if first.ended_by[0] is None and fell.any():
            ends.end(lane, y[:, lane], start[lane], list(self._ends)[int(np.argmax(fell))])

    def _halve(
        self,
        ends: Ends,
        y: Array,
        p: Array,
        start: Array,
        target: Array,
        lane: int,
        above: NDArray[np.bool_],
    ) -> None:
        """End a lane at the first undetected fall of an event, found by bisection of its flight."""
        one = slice(lane, lane + 1)
        near, far = start[one].copy(), target[one].copy()
        last = self._flown(y[:, one], p[:, one], start[one], far)
        for _ in range(_HALVINGS):
            middle = 0.5 * (near + far)
            now = self._flown(y[:, one], p[:, one], start[one], middle)
            fell = above & (self._values(now.y, p[:, one], middle)[:, 0] < 0)
            if now.ended_by[0] is None and not fell.any():
                near = middle
                continue
            far, last = middle, now
            if now.ended_by[0] is not None:
                break
        fell = above & (self._values(last.y, p[:, one], last.time)[:, 0] < 0)
        name = last.ended_by[0] or list(self._ends)[int(np.argmax(fell))]
        ends.end(lane, last.y[:, 0], last.time[0], name)

    def _values(self, y: Array, p: Array, t: Array) -> Array:
        """Return the values (m, N) of the ending events at states (rows, N)."""
        return self._evaluate(tuple(self._ends.values()), y, p, t)

    def _evaluate(self, functions: tuple[Expr, ...], y: Array, p: Array, t: Array) -> Array:
        """Return the values (m, N) of functions at states (rows, N); compile them at first use."""
        if functions not in self._compiled:
            states = [v for v, _ in self._equations[: self._n]]
            self._compiled[functions] = _hy.cfunc(
                list(functions), vars=states, compact_mode=self._compact
            )
        function = self._compiled[functions]
        options: dict[str, Any] = {}
        if function.nparams:
            options["pars"] = np.array(p[: function.nparams])  # the caller may hold both in one
        if function.is_time_dependent:
            options["time"] = np.ascontiguousarray(t)
        values: Array = function(np.ascontiguousarray(y[: self._n]), **options)
        return values

    def on_grid(self, y: Array, p: Array, times: Array) -> Array:
        """Evaluate the dense output.

        Parameters
        ----------
        y : ndarray, shape (rows, N)
            Start, at the first of the times.
        p : ndarray, shape (k, N)
            Run-time parameters.
        times : ndarray, shape (K,)
            Strictly monotone, at least two.

        Returns
        -------
        ndarray, shape (n, K, N)
            States; NaN from where a lane turned non-finite.
        """
        out = np.empty((self._n, len(times), y.shape[1]))
        for lanes in _groups(y.shape[1]):
            width = len(lanes)
            integrator = self._integrator(width)
            begin, sense = np.full(width, times[0]), np.ones(width)
            self._load(integrator, y[:, lanes], p[:, lanes], begin, sense)
            self._carried.alive = np.zeros(width, dtype=bool)
            table = np.ascontiguousarray(np.repeat(times[:, None], width, axis=1))
            _, grid = integrator.propagate_grid(table)
            out[:, :, lanes] = grid[:, : self._n].transpose(1, 0, 2)
        return out

    def _integrator(self, width: int) -> Any:
        """Return the integrator for a number of lanes, compiled at first use."""
        if width not in self._integrators:
            options: dict[str, Any] = {}
            if terminal := self._terminal():
                options["t_events"] = terminal
            if self._recorded:
                options["nt_events"] = [
                    _hy.nt_event_batch(f, callback=self._recorder(name))
                    for name, f in self._recorded.items()
                ]
            self._integrators[width] = _hy.taylor_adaptive_batch(
                self._equations,
                np.zeros((len(self._equations), width)),
                tol=self._tol,
                compact_mode=self._compact,
                **options,
            )
        return self._integrators[width]

    def _terminal(self) -> list[Any]:
        """Return the terminal events of an integrator; an outcome is an index in this list."""
        falls = {"direction": _hy.event_direction.negative}
        ends = [_hy.t_event_batch(self._sense * f, **falls) for f in self._ends.values()]
        return ends + [_hy.t_event_batch(f, callback=_goes_on) for f in self._levels]

    def _recorder(self, name: str) -> Any:
        batch, n, function = self._carried, self._n, self._recorded[name]

        def crosses(integrator: Any, time: float, lane: int) -> bool:
            # What is zero throughout, or touches zero, is zero at the ends of steps, with no slope.
            apart = _BESIDE * float(integrator.last_h[lane])
            values = []
            for beside in (time - apart, time + apart):
                integrator.update_d_output([beside] * len(batch.alive))
                y, p = np.array(integrator.d_output), np.array(integrator.pars)
                times = np.full(len(batch.alive), beside)
                values.append(self._evaluate((function,), y, p, times)[0, lane])
            return bool(values[0] * values[1] < 0)

        def record(integrator: Any, time: float, sign: int, lane: int) -> None:
            if not batch.alive[lane]:
                return
            # A zero at the start is no crossing, nor is one that rounding puts beside it.
            if abs(time - batch.start[lane]) <= _ROUNDING * batch.clock[lane]:
                return
            integrator.update_d_output([time] * len(batch.alive))
            state = np.array(integrator.d_output[:n, lane])
            if not sign and not crosses(integrator, time, lane):
                return
            batch.met.setdefault((name, int(batch.lanes[lane])), []).append((time, state))

        return record

    def _load(self, integrator: Any, y: Array, p: Array, t: Array, sense: Array) -> None:
        integrator.state[:] = y
        if len(integrator.pars):
            integrator.pars[:] = np.concatenate([p, sense[None]])[: len(integrator.pars)]
        integrator.set_time(t)
        if integrator.with_events:
            # An event that ended the last flight would hide its repetition at the next one's start.
            integrator.reset_cooldowns()

    def _stream(self, ends: Ends, y: Array, p: Array, start: Array, target: Array) -> None:
        """Propagate lanes; each that has ended takes the next flight until there is none.

        Flights of different numbers of steps thus keep all lanes busy. An event of one lane stops
        all of them, and so does a number of steps that `LaneRefill` chooses.
        """
        cases = y.shape[1]
        width = _width(cases)
        integrator, batch, refill = self._integrator(width), self._carried, LaneRefill(width)
        sense = np.where(target < start, -1.0, 1.0)
        clock = np.maximum(np.abs(start), np.abs(target))
        lanes = np.minimum(np.arange(width), cases - 1)
        self._load(integrator, y[:, lanes], p[:, lanes], start[lanes], sense[lanes])
        batch.lanes, batch.start, batch.clock = lanes, start[lanes], clock[lanes]
        # A lane without a flight of its own repeats the last flight and reports nothing.
        batch.alive = np.arange(width) < cases
        goal, waiting = target[lanes], min(width, cases)

        def progress() -> list[float]:
            flown, whole = integrator.time - batch.start, goal - batch.start
            parts: list[float] = (flown / np.where(whole, whole, 1.0)).tolist()
            return parts

        while True:
            # Without flights that wait, nothing is gained by stopping before the last end.
            steps = refill.steps(progress) if waiting < cases else 0
            integrator.propagate_until(goal, max_steps=steps)
            vacant = self._note_ends(ends, integrator, goal, refill)
            here = vacant[: cases - waiting]
            if len(here):
                taken = np.arange(waiting, waiting + len(here))
                waiting += len(here)
                batch.lanes[here], batch.start[here], batch.clock[here] = (
                    taken, start[taken], clock[taken],
                )  # fmt: skip
                goal[here], batch.alive[here] = target[taken], True
                if len(here) == width:
                    self._load(integrator, y[:, taken], p[:, taken], start[taken], sense[taken])
                else:
                    self._exchange(integrator, here, taken, y, p, start, sense)
            if not batch.alive.any():
                return
            if not batch.alive.all():
                self._refill(integrator, goal)

    def _note_ends(self, ends: Ends, integrator: Any, goal: Array, refill: LaneRefill) -> _Lanes:
        """Store the ends of flights and vacate their lanes; return these lanes."""
        batch, state, time = self._carried, integrator.state, integrator.time
        results = integrator.propagate_res
        # A lane at its goal when another one stops the batch does not report the time limit; later
        # it would take a step of the rounding of its time.
        over = time == goal
        names: dict[int, str] = {}
        plain = not self._ends and np.isfinite(state).all() and (over & batch.alive).any()
        if not plain:
            outcome = [int(result[0]) for result in results]  # a slow conversion, rarely needed
            names = {i: self._names[-o - 1] for i, o in enumerate(outcome) if o in self._outcomes}
            over |= np.isin(outcome, (_TIME_LIMIT, _NON_FINITE, *self._outcomes))
        vacant: _Lanes = (batch.alive & over).nonzero()[0]
        ended = vacant.tolist()
        refill.note([result[3] for result in results], ended)
        if ended:
            flights = batch.lanes[vacant]
            ends.y[:, flights], ends.time[flights] = state[:, vacant], time[vacant]
            for i in names:
                if batch.alive[i]:
                    ends.ended_by[int(batch.lanes[i])] = names[i]
            batch.alive[vacant] = False
        return vacant

    def _exchange(
        self,
        integrator: Any,
        here: _Lanes,
        flights: _Lanes,
        y: Array,
        p: Array,
        start: Array,
        sense: Array,
    ) -> None:
        """Put flights at their start into vacant lanes."""
        integrator.state[:, here] = y[:, flights]
        if len(integrator.pars):
            pars = np.concatenate([p[:, flights], sense[None, flights]])
            integrator.pars[:, here] = pars[: len(integrator.pars)]
        # The time of the others keeps its second part, below the rounding of a double.
        high, low = (np.array(part) for part in integrator.dtime)
        high[here], low[here] = start[flights], 0.0
        integrator.set_dtime(high, low)
        if integrator.with_events:
            for i in here.tolist():
                integrator.reset_cooldowns(i)

    def _refill(self, integrator: Any, goal: Array) -> None:
        """Replace ended lanes by copies of one that has not ended.

        Otherwise an ended lane could continue into a singularity, which stops all lanes for good.
        """
        batch = self._carried
        model = int(np.argmax(batch.alive))
        dead = np.flatnonzero(~batch.alive)
        high, low = (np.array(part) for part in integrator.dtime)
        high[dead], low[dead] = high[model], low[model]
        integrator.state[:, dead] = integrator.state[:, [model]]
        integrator.pars[:, dead] = integrator.pars[:, [model]]
        integrator.set_dtime(high, low)
        goal[dead] = goal[model]


def _goes_on(integrator: Any, sign: int, lane: int) -> bool:
    return True


def _width(cases: int) -> int:
    """Return the number of lanes that so many flights fly in; a single flight goes alone."""
    return 1 if cases == 1 else _VECTOR if cases <= _VECTOR else _BATCH


def _groups(cases: int) -> list[_Lanes]:
    """Return lane numbers in batches, the last one padded."""
    width = _width(cases)
    count = -(-cases // width)
    return list(np.minimum(np.arange(count * width), cases - 1).reshape(count, width))
