"""Taylor propagation: adaptive, to rounding, with events and dense output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.lanes import (
    initial_derivatives,
    per_lane,
    refuse_non_finite,
    start_states,
)
from hillsphere.engine.dynamics.system import System
from hillsphere.engine.dynamics.taylor_batches import TaylorBatches
from hillsphere.engine.dynamics.variational import variational_equations
from hillsphere.symbolic._heyoka import heyoka as _hy
from hillsphere.symbolic.expressions import Expr, parameter, substitute

__all__ = ["Flight", "Taylor"]

_COMPACT_FROM = 400
"""Number of terms of a right-hand side above which full compilation takes over two seconds."""
_TOLERANCES = (1e-16, 1e-3)
"""Smallest and largest tolerance: below 1e-16 rounding exceeds the truncation, and from 1e-3 on
the order of the series, ⌈1 − ln(tol)/2⌉, would fall below 5."""


@dataclass(frozen=True, eq=False)
class Flight:
    """Ends of N flights, and the events recorded on the way.

    Parameters
    ----------
    x : ndarray, shape (n, N)
        States at the end.
    phi : ndarray, shape (n, n + k, N), or None
        Derivatives of the final state at fixed final time.
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


class Taylor:
    """Propagation of N independent lanes by adaptive Taylor series, vectors of lanes at a time.

    Order and step follow from the tolerance [1]_; with the default tolerance the error is that of
    rounding.

    Parameters
    ----------
    system : System
        n equations, wholly symbolic.
    tol : float
        Tolerance, 1e-16 … 1e-3, relative to the largest element of the state. Normalised systems,
        whose states have similar sizes, are therefore preferable.
    stm : bool
        Whether the state transition matrix is carried along.
    events : sequence of str
        Names of events of the system whose fall through zero, along the flight, ends it. A flight
        that starts below zero continues until the event has risen and fallen again; one that starts
        at zero and falls ends at its start.
    record : mapping of str to Expr, or sequence of str
        Events (of the system, or expressions) whose changes of sign are all recorded by `fly`. A
        zero at the start of the flight, within the rounding of 1e-15 of its times, is not a
        crossing.
    parameters : sequence of str
        With `stm`: run-time parameters by which to differentiate too.
    compact : bool, optional
        Compile in compact mode: an order of magnitude faster to compile, half as fast to run.
        By default with `stm` and for large right-hand sides.

    Raises
    ------
    InputError
        If the system or a requested event has terms that are functions of arrays, a name is
        unknown, or the tolerance is out of range.

    Notes
    -----
    A Taylor series represents only the branch of a `select` on which its step begins. Where one of
    ``system.switches`` changes sign, the step therefore ends and a new series begins. It begins
    slightly beyond the zero, where the switch is 16 times `tol` (at least 1e-12), so that rounding
    cannot put its start on the old branch. If the right-hand side is continuous, the resulting
    error of the states is of second order in this distance. A branch without a switch is not
    detected: a flight across it is wrong without a warning, and the step map with short steps is
    the safe choice. Switches are not reported, and cost nothing in systems without them.

    In the methods below x is (n, N), where N may be zero, or (n,) for one lane; results then have
    no axis of lanes either. Durations are scalars or (N,) and may be negative. Run-time parameters
    p are (k,) or (k, N), SI, by default nominal. Integrators have internal state: use one `Taylor`
    per thread.

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
        numbers = {parameter(q): _hy.par[i] for i, q in enumerate(system.run_time_names)}
        ends = {name: _event(system, name) for name in events}
        recorded = (
            dict(record)
            if isinstance(record, Mapping)
            else {name: _event(system, name) for name in record}
        )
        if external := system.external_events((*ends.values(), *recorded.values())):
            raise InputError(
                f"an event holds {', '.join(external)}, a function of arrays, of which the Taylor "
                "propagator has no series in time: use StepMap, or a surface that is an expression"
            )
        self._ends, self._recorded = tuple(ends), tuple(recorded)
        self._batches = TaylorBatches(
            list(zip(y, _number_parameters(rate, numbers), strict=True)),
            self._n,
            tol,
            dict(zip(ends, _number_parameters(tuple(ends.values()), numbers), strict=True)),
            dict(zip(recorded, _number_parameters(tuple(recorded.values()), numbers), strict=True)),
            _number_parameters(system.switches, numbers),
            _is_large(rate) or stm if compact is None else compact,
            len(system.run_time_names),
        )

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
            Duration in the system's unit of time.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters.
        t0 : array_like, shape (N,) or scalar
            Time at the start.

        Returns
        -------
        x : ndarray, shape (n, N)
            States at the end; `fly` also returns its time and the event that ended the flight.
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
        """Propagate each lane over its duration or until an event ends it, and record events.

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
        ends = self._batches.fly(y, q, start, target)
        if strict:
            refuse_non_finite(ends.y, self._where())
        state = ends.y[: self._n]
        phi = ends.y[self._n :].reshape(self._n, self._columns, -1) if self.stm else None
        crossings = {
            name: tuple(self._crossings(ends.met.get((name, i), [])) for i in range(cases))
            for name in self._recorded
        }
        if single:
            phi = None if phi is None else phi[:, :, 0]
            return Flight(state[:, 0], phi, ends.time[0], tuple(ends.ended_by), crossings)
        return Flight(state, phi, ends.time, tuple(ends.ended_by), crossings)

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
            Times on the system's clock, monotone, on one side of `t0`, the nearest first.
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
        out = np.repeat(states[:, None], len(grid) - 1, axis=1)
        if np.count_nonzero(fresh) > 1:
            y, q = self._with_derivatives(states), self.system.parameters(p, cases)
            out = self._batches.on_grid(y, q, grid[fresh])[:, place[1:]]
        refuse_non_finite(out.reshape(out.shape[0] * out.shape[1], cases), self._where())
        return out[:, :, 0] if single else out

    def _with_derivatives(self, states: Array) -> Array:
        if not self.stm:
            return states
        extra = initial_derivatives(self._n, self._columns, states.shape[1])
        return np.concatenate([states, extra])

    def _where(self) -> str:
        return f"Taylor, tolerance {self.tol:g}"

    def _crossings(self, met: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
        times = np.array([time for time, _ in met])
        return times, np.array([state for _, state in met]).reshape(len(met), self._n).T


def _event(system: System, name: str) -> Expr:
    if name not in system.events:
        known = ", ".join(system.events) or "none"
        raise InputError(f"no event {name!r}; the system has: {known}")
    return system.events[name]


def _number_parameters(
    expressions: Sequence[Expr], numbers: Mapping[Expr, Expr]
) -> tuple[Expr, ...]:
    return substitute(expressions, numbers) if numbers and expressions else tuple(expressions)


def _is_large(expressions: Sequence[Expr]) -> bool:
    # The length of an expression of the compile layer is its number of terms, with shared ones
    # counted every time: it overflows for deep expressions, and some overflows read as zero.
    try:
        sizes = [len(cast(Sized, e)) for e in expressions]
    except OverflowError:
        return True
    return 0 in sizes or sum(sizes) > _COMPACT_FROM
