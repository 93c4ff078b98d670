"""Adaptive Taylor integrators of the compile layer, driven in batches of lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere._heyoka import heyoka as _hy
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr

__all__ = ["Ends", "TaylorBatches"]

_BATCH = 4
"""Lanes in one SIMD batch; eight does not pay without AVX-512."""
_LEAST_HAIR = 1e-12
_HAIR = 16.0
"""How far past its zero, in tolerances, a switch ends a step; truncation misses it by up to 5."""
_ROUNDING = 4.0 * np.finfo(float).eps
_TIME_LIMIT = int(_hy.taylor_outcome.time_limit)
_NON_FINITE = int(_hy.taylor_outcome.err_nf_state)
_Lanes: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Ends:
    """Where N lanes ended: rows y, times, ending events, and what was recorded per event and lane.

    A lane that turned non-finite has NaN in y.
    """

    y: Array
    time: Array
    ended_by: tuple[str | None, ...]
    met: Mapping[tuple[str, int], list[tuple[float, Array]]]


class _Carried:
    """What callbacks see of the lanes that an integrator carries; each flight sets it anew."""

    lanes: _Lanes
    alive: NDArray[np.bool_]
    sense: Array
    start: Array
    clock: Array
    met: dict[tuple[str, int], list[tuple[float, Array]]]


class TaylorBatches:
    """Integrators of one system, one per width (1 or 4 lanes), compiled when first needed.

    Parameters
    ----------
    equations : sequence of (Expr, Expr)
        Variable and its time derivative, run-time parameters numbered.
    n : int
        How many of them are states, recorded at events; the rest are derivatives.
    tol : float
        Tolerance.
    ends, recorded : mapping of str to Expr
        Events that end a lane when they fall along the flight; events to record.
    switches : sequence of Expr
        Functions whose zeros end a step and nothing else.
    compact : bool
        Compile in compact mode.
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
    ) -> None:
        self._equations, self._n, self._tol, self._compact = list(equations), n, tol, compact
        self._ends, self._recorded = dict(ends), dict(recorded)
        # A step over a switch must end on the side it flies to, beyond doubt, for the next one to
        # take the right branch: outbound on the upper of these two levels, inbound on the lower.
        hair = max(_LEAST_HAIR, _HAIR * tol)
        self._levels = [level for s in switches for level in (s - hair, s + hair)]
        self._carried = _Carried()
        self._integrators: dict[int, Any] = {}

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
            What became of each lane.
        """
        cases = y.shape[1]
        end, time = np.empty_like(y), np.empty(cases)
        ended: list[str | None] = [None] * cases
        self._carried.met = {}
        for lanes in _groups(cases):
            self._fly_group(lanes, y, p, start, target, end, time, ended)
        return Ends(end, time, tuple(ended), self._carried.met)

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
            self._load(integrator, y[:, lanes], p[:, lanes], np.full(width, times[0]))
            self._carried.alive = np.zeros(width, dtype=bool)
            table = np.ascontiguousarray(np.repeat(times[:, None], width, axis=1))
            _, found = integrator.propagate_grid(table)
            out[:, :, lanes] = found[:, : self._n].transpose(1, 0, 2)
        return out

    def _integrator(self, width: int) -> Any:
        """Return the integrator of so many lanes, compiled when first asked for."""
        if width not in self._integrators:
            options: dict[str, Any] = {}
            # Those of the caller first: an outcome is told by its place in this list.
            terminal = [_hy.t_event_batch(f, callback=self._ender()) for f in self._ends.values()]
            terminal += [_hy.t_event_batch(f, callback=_goes_on) for f in self._levels]
            if terminal:
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

    def _ender(self) -> Any:
        """Return a callback that lets a flight go on (True) unless the event falls along it."""
        batch = self._carried

        def goes_on(integrator: Any, sign: int, lane: int) -> bool:
            return bool(sign * batch.sense[lane] > 0)

        return goes_on

    def _recorder(self, name: str) -> Any:
        batch, n = self._carried, self._n

        def record(integrator: Any, time: float, sign: int, lane: int) -> None:
            if not batch.alive[lane]:
                return
            # A zero at the start is no crossing, nor is one that rounding puts beside it.
            if abs(time - batch.start[lane]) <= _ROUNDING * batch.clock[lane]:
                return
            integrator.update_d_output([time] * len(batch.alive))
            state = np.array(integrator.d_output[:n, lane])
            batch.met.setdefault((name, int(batch.lanes[lane])), []).append((time, state))

        return record

    def _load(self, integrator: Any, y: Array, p: Array, t: Array) -> None:
        integrator.state[:] = y
        integrator.pars[:] = p[: len(integrator.pars)]
        integrator.set_time(t)
        if integrator.with_events:
            # An event that ended the last flight would hide its repetition at the next one's start.
            integrator.reset_cooldowns()

    def _fly_group(
        self,
        lanes: _Lanes,
        y: Array,
        p: Array,
        start: Array,
        target: Array,
        end: Array,
        time: Array,
        ended: list[str | None],
    ) -> None:
        """Fly one batch; an event that ends one lane halts all, so go on until every one is done.

        A lane that is done follows a copy of one that is not: an integrator has no empty lanes.
        """
        integrator = self._integrator(len(lanes))
        self._load(integrator, y[:, lanes], p[:, lanes], start[lanes])
        batch, names = self._carried, list(self._ends)
        goal = target[lanes].copy()
        batch.lanes, batch.sense = lanes, np.sign(target[lanes] - start[lanes])
        batch.start = start[lanes]
        batch.clock = np.maximum(np.abs(start[lanes]), np.abs(target[lanes]))
        # A lane that pads the last batch repeats its neighbour and reports nothing.
        batch.alive = np.concatenate([[True], np.diff(lanes) > 0])
        while True:
            integrator.propagate_until(goal)
            for i, result in enumerate(integrator.propagate_res):
                if not batch.alive[i]:
                    continue
                outcome, lane = int(result[0]), int(lanes[i])
                by_event = -len(names) <= outcome < 0
                if outcome == _NON_FINITE:
                    end[:, lane] = np.nan
                elif by_event or outcome == _TIME_LIMIT:
                    end[:, lane] = integrator.state[:, i]
                else:
                    continue
                time[lane] = integrator.time[i]
                ended[lane] = names[-outcome - 1] if by_event else None
                batch.alive[i] = False
            if not batch.alive.any():
                return
            self._refill(integrator, goal)

    def _refill(self, integrator: Any, goal: Array) -> None:
        """Let the lanes that are done follow one that is not.

        Left to itself, one may run on into a singularity, which halts all lanes for good.
        """
        batch = self._carried
        model = int(np.argmax(batch.alive))
        dead = np.flatnonzero(~batch.alive)
        times = np.array(integrator.time)
        times[dead] = times[model]
        integrator.state[:, dead] = integrator.state[:, [model]]
        integrator.pars[:, dead] = integrator.pars[:, [model]]
        integrator.set_time(times)
        goal[dead] = goal[model]
        batch.sense[dead] = batch.sense[model]


def _goes_on(integrator: Any, sign: int, lane: int) -> bool:
    return True


def _groups(cases: int) -> list[_Lanes]:
    """Return lane numbers in batches of four, the last one padded; a single lane goes alone."""
    if cases == 1:
        return [np.array([0])]
    count = -(-cases // _BATCH)
    return list(np.minimum(np.arange(count * _BATCH), cases - 1).reshape(count, _BATCH))
