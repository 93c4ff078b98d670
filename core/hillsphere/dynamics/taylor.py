"""Taylor propagation: adaptive, to rounding, with events and dense output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, field
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere._heyoka import heyoka as _hy
from hillsphere.dynamics.lanes import (
    initial_derivatives,
    per_lane,
    refuse_non_finite,
    start_states,
)
from hillsphere.dynamics.system import System
from hillsphere.dynamics.variational import variational_equations
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr, parameter, substitute

__all__ = ["Flight", "Taylor"]

_BATCH = 4
"""Lanes in one SIMD batch; eight does not pay without AVX-512."""
_COMPACT_FROM = 400
"""Size of a right-hand side (terms) from which compilation in full mode takes over two seconds."""
_TOLERANCES = (1e-16, 1e-3)
_TIME_LIMIT = int(_hy.taylor_outcome.time_limit)
_NON_FINITE = int(_hy.taylor_outcome.err_nf_state)


@dataclass(frozen=True, eq=False)
class Flight:
    """Ends of N flights and what was met on the way.

    Parameters
    ----------
    x : ndarray, shape (n, N)
        States at the end.
    phi : ndarray, shape (n, n + k, N), or None
        Derivatives of the flow for the end's time held fixed.
    time : ndarray, shape (N,)
        Time of the end on the system's clock.
    ended_by : tuple of (str or None), length N
        Event that ended the flight, or None if it lasted its duration.
    crossings : mapping of str to tuple of (times, states)
        For every recorded event, per lane: times (c,) and states (n, c) in the order of flight.
    """

    x: Array
    phi: Array | None
    time: Array
    ended_by: tuple[str | None, ...]
    crossings: Mapping[str, tuple[tuple[Array, Array], ...]]


_Lanes: TypeAlias = NDArray[np.intp]


@dataclass(eq=False)
class _Batch:
    """What the callbacks of one integrator see of the lanes that it now carries."""

    lanes: _Lanes = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    alive: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    sense: Array = field(default_factory=lambda: np.zeros(0))
    met: dict[tuple[str, int], list[tuple[float, Array]]] = field(default_factory=dict)


class Taylor:
    """Propagation of N independent lanes by adaptive Taylor series, four lanes at a time.

    Order and step follow from the tolerance [1]_; at the default the error is rounding.

    Parameters
    ----------
    system : System
        n equations, wholly symbolic.
    tol : float
        Tolerance, 1e-16 … 1e-3, relative to the largest element of the state; normalised systems
        are the better balanced.
    stm : bool
        Whether the state transition matrix is carried along.
    events : sequence of str
        Names of events of the system whose fall through zero, along the flight, ends it. A flight
        that starts below zero goes on until the event has risen and fallen again.
    record : mapping of str to Expr, or sequence of str
        Events (of the system, or expressions) whose every zero is recorded by `fly`.
    parameters : sequence of str
        With `stm`: run-time parameters by which to differentiate too.
    compact : bool, optional
        Compile in compact mode: an order of magnitude faster to compile, half as fast to run.
        By default with `stm` and for large right-hand sides.

    Raises
    ------
    InputError
        If the system has terms that are functions of arrays, or a name or the tolerance does not
        fit.

    Notes
    -----
    In the methods below x is (n, N) or, for one lane, (n,), and the results lose that axis
    likewise; durations are scalars or (N,) and may be negative; run-time parameters p are (k,) or
    (k, N), SI, nominal if absent. Integrators keep state: one `Taylor` per thread.

    References
    ----------
    .. [1] F. Biscani, D. Izzo (2021), Revisiting high-order Taylor methods for astrodynamics and
       celestial mechanics, Monthly Notices of the Royal Astronomical Society 504(2), 2614-2628.
    """

    def __init__(
        self,
        system: System,
        tol: float = 1e-15,
        stm: bool = False,
        events: Sequence[str] = (),
        record: Mapping[str, Expr] | Sequence[str] = (),
        *,
        parameters: Sequence[str] = (),
        compact: bool | None = None,
    ) -> None:
        if system.external is not None:
            raise InputError(
                "the Taylor propagator differentiates the equations in time, and terms that are "
                "functions of arrays have no such derivatives: use StepMap"
            )
        low, high = _TOLERANCES
        if not low <= tol <= high:
            raise InputError(f"tol must be in [{low:g}, {high:g}], got {tol}")
        if parameters and not stm:
            raise InputError("derivatives by parameters come with the STM: give stm=True")
        self.system, self.tol, self.stm = system, tol, stm
        self._n = len(system.x)
        self._columns = self._n + len(parameters) if stm else 0
        y, rate = (system.x, system.rhs)
        if stm:
            y, rate = variational_equations(system, parameters)
        self._compact = _is_large(rate) or stm if compact is None else compact
        self._ends = {name: _event(system, name) for name in events}
        self._recorded = (
            dict(record)
            if isinstance(record, Mapping)
            else {name: _event(system, name) for name in record}
        )
        numbered = {parameter(q): _hy.par[i] for i, q in enumerate(system.run_time_names)}
        self._equations = list(zip(y, _numbered(rate, numbered), strict=True))
        self._end_functions = _numbered(tuple(self._ends.values()), numbered)
        self._recorded_functions = _numbered(tuple(self._recorded.values()), numbered)
        self._batch = _Batch()
        self._integrators: dict[int, Any] = {}

    def propagate(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
    ) -> Any:
        """Propagate each lane over its duration, or until an event ends it.

        Parameters
        ----------
        x : array_like, shape (n, N)
            States.
        duration : array_like, shape (N,) or scalar
            How long.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters.
        t0 : array_like, shape (N,) or scalar
            Time at the start.

        Returns
        -------
        x : ndarray, shape (n, N)
            States at the end; `fly` also tells when and why it ended.
        phi : ndarray, shape (n, n + k, N)
            Derivatives by the states at the start (only with `stm`).

        Raises
        ------
        PropagationError
            If a lane turns non-finite.
        """
        flight = self.fly(x, duration, p, t0)
        return (flight.x, flight.phi) if self.stm else flight.x

    def fly(
        self,
        x: ArrayLike,
        duration: ArrayLike,
        p: ArrayLike | None = None,
        t0: ArrayLike = 0.0,
        *,
        strict: bool = True,
    ) -> Flight:
        """Propagate each lane over its duration or to its end, with a record of events.

        Parameters
        ----------
        x, duration, p, t0
            As for `propagate`.
        strict : bool
            Whether non-finite lanes raise; otherwise their states are returned as NaN.

        Returns
        -------
        Flight
            States, times, ends and crossings.

        Raises
        ------
        PropagationError
            If a lane turns non-finite.
        """
        states, single = start_states(x, self._n)
        cases = states.shape[1]
        start = per_lane(t0, cases, "t0")
        target = start + per_lane(duration, cases, "duration")
        q = self.system.parameters(p, cases)
        y = self._with_derivatives(states)
        end, time = np.empty_like(y), np.empty(cases)
        ended: list[str | None] = [None] * cases
        batch = self._batch
        batch.met = {}
        for lanes in _groups(cases):
            self._fly_group(lanes, y, q, start, target, end, time, ended)
        if strict:
            refuse_non_finite(end, self._where())
        phi = None
        if self.stm:
            phi = end[self._n :].reshape(self._n, self._columns, -1)
        crossings = {
            name: tuple(self._crossings(name, lane) for lane in range(cases))
            for name in self._recorded
        }
        if single:
            phi = None if phi is None else phi[:, :, 0]
            return Flight(end[: self._n, 0], phi, time[0], tuple(ended), crossings)
        return Flight(end[: self._n], phi, time, tuple(ended), crossings)

    def sample(
        self,
        x: ArrayLike,
        times: ArrayLike,
        p: ArrayLike | None = None,
        t0: float = 0.0,
    ) -> Array:
        """Evaluate the dense output at given times.

        Parameters
        ----------
        x : array_like, shape (n, N)
            States at `t0`.
        times : array_like, shape (K,)
            Times on the system's clock, all on one side of `t0` and going away from it.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters.
        t0 : float
            Time at the start.

        Returns
        -------
        ndarray, shape (n, K, N)
            States; without derivatives.

        Raises
        ------
        InputError
            If the times are not in order, or this propagator has events that end flights.
        PropagationError
            If a lane turns non-finite.
        """
        if self._ends:
            raise InputError("sample with a Taylor propagator that has no events to end a flight")
        states, single = start_states(x, self._n)
        cases = states.shape[1]
        grid = np.concatenate([[float(t0)], np.asarray(times, dtype=float).reshape(-1)])
        steps = np.diff(grid)
        forward = not (steps < 0).any()
        if not np.isfinite(grid).all() or not (forward or not (steps > 0).any()):
            raise InputError("times must be finite and lead away from t0 in one direction")
        # The integrator wants strictly monotone times; repeated ones share a sample.
        fresh = np.concatenate([[True], steps != 0])
        place = np.cumsum(fresh) - 1
        unique = grid[fresh]
        q = self.system.parameters(p, cases)
        y = self._with_derivatives(states)
        out = np.empty((self._n, len(grid) - 1, cases))
        for lanes in _groups(cases):
            width = len(lanes)
            integrator = self._integrator(width)
            self._load(integrator, y[:, lanes], q[:, lanes], np.full(width, float(t0)))
            self._batch.alive = np.zeros(width, dtype=bool)
            if len(unique) > 1:
                table = np.repeat(unique[:, None], width, axis=1)
                _, found = integrator.propagate_grid(np.ascontiguousarray(table))
            else:
                found = y[None][:, :, lanes]
            out[:, :, lanes] = found[place[1:], : self._n].transpose(1, 0, 2)
        refuse_non_finite(out.reshape(-1, cases), self._where())
        return out[:, :, 0] if single else out

    def _with_derivatives(self, states: Array) -> Array:
        if not self.stm:
            return states
        extra = initial_derivatives(self._n, self._columns, states.shape[1])
        return np.concatenate([states, extra])

    def _where(self) -> str:
        return f"Taylor, tolerance {self.tol:g}"

    def _crossings(self, name: str, lane: int) -> tuple[Array, Array]:
        met = self._batch.met.get((name, lane), [])
        times = np.array([time for time, _ in met])
        return times, np.array([state for _, state in met]).reshape(len(met), self._n).T

    def _integrator(self, width: int) -> Any:
        """Return the integrator of so many lanes, compiled when first asked for."""
        if width not in self._integrators:
            options: dict[str, Any] = {}
            if self._ends:
                options["t_events"] = [
                    _hy.t_event_batch(f, callback=self._ender()) for f in self._end_functions
                ]
            if self._recorded:
                options["nt_events"] = [
                    _hy.nt_event_batch(f, callback=self._recorder(name))
                    for name, f in zip(self._recorded, self._recorded_functions, strict=True)
                ]
            self._integrators[width] = _hy.taylor_adaptive_batch(
                self._equations,
                np.zeros((len(self._equations), width)),
                tol=self.tol,
                compact_mode=self._compact,
                **options,
            )
        return self._integrators[width]

    def _ender(self) -> Any:
        """Return a callback that lets a flight go on (True) unless the event falls along it."""
        batch = self._batch

        def goes_on(integrator: Any, sign: int, lane: int) -> bool:
            return bool(sign * batch.sense[lane] > 0)

        return goes_on

    def _recorder(self, name: str) -> Any:
        batch, n = self._batch, self._n

        def record(integrator: Any, time: float, sign: int, lane: int) -> None:
            if not batch.alive[lane]:
                return
            integrator.update_d_output([time] * len(batch.alive))
            state = np.array(integrator.d_output[:n, lane])
            batch.met.setdefault((name, int(batch.lanes[lane])), []).append((time, state))

        return record

    def _load(self, integrator: Any, y: Array, p: Array, t: Array) -> None:
        integrator.state[:] = y
        if len(integrator.pars):
            integrator.pars[:] = p[: len(integrator.pars)]
        integrator.set_time(t)
        if self._ends:
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
        batch, names = self._batch, list(self._ends)
        goal = target[lanes].copy()
        batch.lanes, batch.sense = lanes, np.sign(target[lanes] - start[lanes])
        # A lane that pads the last batch repeats its neighbour and reports nothing.
        batch.alive = np.concatenate([[True], np.diff(lanes) > 0])
        while batch.alive.any():
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
            self._refill(integrator, goal)

    def _refill(self, integrator: Any, goal: Array) -> None:
        batch = self._batch
        if not batch.alive.any() or batch.alive.all():
            return
        model = int(np.argmax(batch.alive))
        dead = np.flatnonzero(~batch.alive)
        times = np.array(integrator.time)
        times[dead] = times[model]
        integrator.state[:, dead] = integrator.state[:, [model]]
        if len(integrator.pars):
            integrator.pars[:, dead] = integrator.pars[:, [model]]
        integrator.set_time(times)
        goal[dead] = goal[model]
        batch.sense[dead] = batch.sense[model]


def _groups(cases: int) -> list[_Lanes]:
    """Return lane numbers in batches of four, the last one padded; a single lane goes alone."""
    if cases == 1:
        return [np.array([0])]
    count = -(-cases // _BATCH)
    return list(np.minimum(np.arange(count * _BATCH), cases - 1).reshape(count, _BATCH))


def _event(system: System, name: str) -> Expr:
    if name not in system.events:
        known = ", ".join(system.events) or "none"
        raise InputError(f"no event {name!r}; the system has: {known}")
    return system.events[name]


def _numbered(expressions: Sequence[Expr], numbers: Mapping[Expr, Expr]) -> tuple[Expr, ...]:
    return substitute(expressions, numbers) if numbers and expressions else tuple(expressions)


def _is_large(expressions: Sequence[Expr]) -> bool:
    # The length of an expression of the compile layer is its number of terms, with shared ones
    # counted every time: it overflows for deep expressions, and some overflows read as zero.
    try:
        sizes = [len(cast(Sized, e)) for e in expressions]
    except OverflowError:
        return True
    return 0 in sizes or sum(sizes) > _COMPACT_FROM
