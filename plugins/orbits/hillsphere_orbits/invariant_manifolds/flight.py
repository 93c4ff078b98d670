"""Flights of many lanes on the step map, with every zero of several functions on the way.

The lanes march in equal sub-steps. Bounds of the functions' derivatives prove between the ends of
each how many zeros there are (`hillsphere.dynamics.ProvedBrackets`), so that none is missed however
near two of them are. Zeros are then refined, all of them at once, on partial sub-steps of the same
formula, to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import ProvedBrackets, StepMap, System, bracketed_roots
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr, gradient, sum_of, variable_names

__all__ = ["UNPROVED", "FlightEnds", "Watch", "Zeros", "fly"]

UNPROVED = "that no crossing of theirs was missed is not proved"
"""Remark about flights that are not resolved."""

_CHUNK = 64  # sub-steps between two looks: long enough that Python's share is small
_TOGETHER = 1 << 14
"""Sub-steps that are examined at once: with few lanes those of many chunks, since interpreted code
costs as much for ten sub-steps as for a thousand. Their states take some megabytes."""
_CLEAR = 1.0
"""Value of a function that ends flights, at either end of a sub-step, below which the sub-step is
examined although its zeros are not read. Above an ellipsoid's surface one is 0.4 of its radius: to
reach the body from there and leave it again within one sub-step takes a speed of a diameter per
sub-step. A limit of escape is below one everywhere, so that with it nothing is left out."""
_NEWTON = 4
"""Steps from the zero of the interpolating cubic: Newton's method doubles its digits with each, and
zeros that have not converged by then are bracketed."""


class Watch:
    """Functions of the state whose zeros are sought along flights, with their rates.

    Parameters
    ----------
    system : System
        Equations.
    functions : mapping of str to Expr
        In the symbols of ``system.x``; of positions only where the plant has array terms.

    Raises
    ------
    InputError
        If a rate needs terms of the plant that are no expressions.
    """

    def __init__(self, system: System, functions: Mapping[str, Expr]) -> None:
        self.names = tuple(functions)
        values = tuple(functions.values())
        rates = []
        for name, value in functions.items():
            slope = gradient(value, system.x)
            rate = sum_of([s * f for s, f in zip(slope, system.rhs, strict=True)])
            if not set(variable_names([rate])) <= set(variable_names(system.x)):
                raise InputError(
                    f"event {name!r}: its rate holds gravity that is a function of arrays; watch "
                    "functions of the position"
                )
            rates.append(rate)
        self._function = system.function(*values, *rates)
        self._p = system.parameters(None, 1)
        own = [name if system.events.get(name) == f else f for name, f in functions.items()]
        self.brackets = ProvedBrackets(system, own)

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Return values and rates (m, …) at states (n, …)."""
        m = len(self.names)
        both = self._function(np.ascontiguousarray(x.reshape(len(x), -1)), self._p)
        both = both.reshape(2 * m, *x.shape[1:])
        return both[:m], both[m:]


@dataclass(frozen=True, eq=False)
class Zeros:
    """Zeros of the watched functions, by lane and time.

    Parameters
    ----------
    lane, event : ndarray of int, shape (E,)
        Which lane, and which function by its number.
    time : ndarray, shape (E,)
        Since the start of the flight; negative backwards.
    rising : ndarray of bool, shape (E,)
        Whether the function rises along the flight (which may go backwards in time).
    x : ndarray, shape (n, E)
        States.
    """

    lane: NDArray[np.intp]
    event: NDArray[np.intp]
    time: Array
    rising: NDArray[np.bool_]
    x: Array

    def select(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Zeros:
        """Return some of them."""
        return Zeros(
            self.lane[keep], self.event[keep], self.time[keep], self.rising[keep], self.x[:, keep]
        )


@dataclass(frozen=True, eq=False)
class FlightEnds:
    """Ends of N flights and the zeros of the watched functions on the way.

    Parameters
    ----------
    x : ndarray, shape (n, N)
        States at the end; not finite where a lane met a singularity.
    time : ndarray, shape (N,)
        Length of flight, signed.
    ended_by : ndarray of int, shape (N,)
        Number of the function that ended the flight by falling; −1 without.
    zeros : Zeros
        All before the end of their lane, where they are read.
    resolved : ndarray of bool, shape (N,)
        Whether it is proved that these are all; False where a function touches zero but for
        rounding, or offers no bound and comes nearer to zero than 0.1.
    """

    x: Array
    time: Array
    ended_by: NDArray[np.intp]
    zeros: Zeros
    resolved: NDArray[np.bool_]


@dataclass(eq=False)
class _Brackets:
    """Sub-steps, or parts of them, at whose ends a function differs in sign."""

    lane: NDArray[np.intp]
    event: NDArray[np.intp]
    begin: Array  # time at the start of the sub-step
    x: Array  # state there
    ends: Array  # (2, E): ends within the sub-step
    values: Array  # (2, E): values there
    slopes: Array  # (2, E): and rates


@dataclass(frozen=True, eq=False)
class _Chunk:
    """Sub-steps to be examined, of lanes that were flown together."""

    way: Array  # (n, K + 1, L)
    values: Array  # (m, K + 1, L)
    inside: NDArray[np.bool_]  # (K, L): which are examined
    lane: NDArray[np.intp]  # (L,)
    first: NDArray[np.intp]  # (L,): number of the first one


def _join_chunks(
    chunks: list[_Chunk],
) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
    way, values, inside, lane, first = (
        np.concatenate([getattr(one, field.name) for one in chunks], axis=-1)
        for field in fields(_Chunk)
    )
    return way, values, inside, lane, first


def fly(
    step_map: StepMap,
    watch: Watch,
    x: Array,
    h: float,
    goes_on: Callable[[NDArray[np.intp], int, Array], tuple[NDArray[np.intp], NDArray[np.bool_]]],
    most: int,
    ends: tuple[str, ...] = (),
) -> FlightEnds:
    """Fly lanes until each is stopped, or a function that ends flights falls through zero.

    Parameters
    ----------
    step_map : StepMap
        Without derivatives.
    watch : Watch
        The functions.
    x : ndarray, shape (n, N)
        Starts.
    h : float
        Sub-step; negative to fly backwards.
    goes_on : callable
        ``goes_on(lanes, first, way)`` is shown the states ``way`` (n, K, L) of some lanes (L,)
        at the ends of the sub-steps number ``first`` … ``first + K − 1`` (0 is the start) and
        returns how many of these K states are still part of each flight (L,), K to go on, and in
        which of the sub-steps between them zeros are read, (K − 1, L).
    most : int
        Largest number of sub-steps.
    ends : tuple of str
        Names of functions whose fall ends a flight.

    Returns
    -------
    FlightEnds
        Ends and zeros. Sub-steps whose zeros are not read are examined near an end only.
    """
    cases = x.shape[1]
    lanes = np.arange(cases)
    end, last = x.copy(), np.zeros(cases, dtype=np.intp)
    parts: list[_Brackets] = []
    held: list[_Chunk] = []
    resolved = np.ones(cases, dtype=bool)

    def prove() -> None:
        way, values, inside, lane, first = _join_chunks(held)
        brackets, sure = _brackets(step_map, watch, way, values, inside, h)
        np.logical_and.at(resolved, lane, sure)
        brackets.begin += first[brackets.lane] * h
        brackets.lane = lane[brackets.lane]
        parts.append(brackets)
        held.clear()

    killers = [watch.names.index(name) for name in ends]
    now, done = np.ascontiguousarray(x), 0
    while lanes.size and done < most:
        steps = min(_CHUNK, most - done)
        way = step_map.trajectory(now, steps * h, steps, strict=False)
        bad = ~np.isfinite(way).all(axis=0)
        whole = np.where(bad.any(axis=0), np.argmax(bad, axis=0), steps + 1)
        length, read = goes_on(lanes, done, way)
        length = np.minimum(length, whole)
        values = watch(way)[0]
        inside = np.arange(steps)[:, None] < length - 1
        ending = values[killers]
        falls = (ending[:, :-1] > 0.0) & (ending[:, 1:] <= 0.0) & inside
        # what falls and rises again within a sub-step is seen by the proof: it ends the flight too
        alive = (length == steps + 1) & ~falls.any(axis=(0, 1))
        close: NDArray[np.bool_] = np.asarray((ending < _CLEAR).any(axis=0))
        inside &= read | close[:-1] | close[1:]
        if held and len(held[0].inside) != steps:
            prove()
        if inside.any():
            held.append(_Chunk(way, values, inside, lanes, np.full(lanes.size, done)))
        if sum(np.count_nonzero(one.inside) for one in held) >= _TOGETHER:
            prove()
        at = np.maximum(length - 1, 0)
        end[:, lanes] = way[:, at, np.arange(lanes.size)]
        last[lanes] = done + at
        now, lanes, done = np.ascontiguousarray(way[:, -1, alive]), lanes[alive], done + steps
    if held:
        prove()
    zeros = _refine_brackets(step_map, watch, parts, h)
    time, ended = np.asarray(last * h, float), np.full(cases, -1, dtype=np.intp)
    for i in np.flatnonzero(np.isin(zeros.event, killers) & ~zeros.rising)[::-1]:
        lane = zeros.lane[i]  # zeros are in order: the first of each lane is seen last
        time[lane], ended[lane], end[:, lane] = zeros.time[i], zeros.event[i], zeros.x[:, i]
    keep = np.abs(zeros.time) <= np.abs(time[zeros.lane])
    return FlightEnds(end, time, ended, zeros.select(keep), resolved)


def _brackets(
    step_map: StepMap,
    watch: Watch,
    way: Array,
    values: Array,
    inside: NDArray[np.bool_],
    h: float,
) -> tuple[_Brackets, NDArray[np.bool_]]:
    """Return all brackets of a chunk (n, K + 1, L); `begin` counts from its start."""

    def halve(base: Array, tau: Array) -> tuple[Array, Array]:
        x = step_map.step(np.ascontiguousarray(base), tau, strict=False)
        return x, watch(x)[0]

    b = watch.brackets(way, values, h, halve, inside)
    pick = np.arange(b.lane.size)
    slopes = np.array([watch(x)[1][b.function, pick] for x in (b.y0, b.y1)])
    ends, values = np.array([b.begin, b.end]), np.array([b.g0, b.g1])
    begin = np.asarray(b.step * h, float)
    base = way[:, b.step, b.lane]
    return _Brackets(b.lane, b.function, begin, base, ends, values, slopes), b.resolved


def _refine_brackets(step_map: StepMap, watch: Watch, brackets: list[_Brackets], h: float) -> Zeros:
    """Refine brackets to zeros by Newton's method, and by bracketing where it fails."""
    n = len(step_map.system.x)
    if not brackets:
        empty = np.zeros(0, dtype=np.intp)
        return Zeros(empty, empty, np.zeros(0), empty.astype(bool), np.zeros((n, 0)))
    b = _join_brackets(brackets)
    pick = np.arange(b.lane.size)
    x = np.ascontiguousarray(b.x)
    low, high = b.ends
    size = high - low
    (f0, f1), (g0, g1) = b.values, b.slopes * size
    with np.errstate(divide="ignore", invalid="ignore"):
        u = f0 / (f0 - f1)
        for _ in range(3):  # Newton on the cubic
            u = u - _cubic(f0, f1, g0, g1, u) / _cubic_slope(f0, f1, g0, g1, u)
    tau = low + size * np.where((u >= 0.0) & (u <= 1.0), u, 0.5)
    change = np.full(tau.shape, np.inf)
    at = x
    for _ in range(_NEWTON):
        at = step_map.step(x, tau, strict=False)
        # Newton's step with the exact rate of the watched function along the motion
        value, rate = (q[b.event, pick] for q in watch(at))
        with np.errstate(divide="ignore", invalid="ignore"):
            change = value / rate
        new = tau - change
        # a step out of the bracket is not taken; such a zero is bracketed below
        ok = np.isfinite(new) & ((new - low) * (new - high) <= 0.0)
        tau, change = np.where(ok, new, tau), np.where(ok, change, np.inf)
        if np.all(np.abs(change) <= 1e-13 * abs(h)):
            break
    lost = np.flatnonzero(~(np.abs(change) <= 1e-11 * abs(h)))
    if lost.size:
        base, event, few = np.ascontiguousarray(x[:, lost]), b.event[lost], np.arange(lost.size)

        def value_at(tau: Array) -> Array:
            return np.asarray(watch(step_map.step(base, tau, strict=False))[0][event, few])

        width = np.full(lost.size, 4.0 * np.finfo(float).eps * abs(h))
        tau[lost] = bracketed_roots(
            value_at, low[lost], high[lost], b.values[0, lost], b.values[1, lost], width
        )
    at = step_map.step(x, tau, strict=False)
    time = b.begin + tau
    # by lane, then by time since the start, also for flights backwards
    order = np.lexsort((np.abs(time), b.lane))
    rising = b.values[1] > b.values[0]
    return Zeros(b.lane[order], b.event[order], time[order], rising[order], at[:, order])


def _join_brackets(parts: list[_Brackets]) -> _Brackets:
    return _Brackets(
        *(
            np.concatenate([getattr(p, name) for p in parts], axis=-1)
            for name in ("lane", "event", "begin", "x", "ends", "values", "slopes")
        )
    )


def _cubic(a: Array, b: Array, s: Array, t: Array, u: Array) -> Array:
    """Cubic with values a, b and slopes s, t at u = 0, 1."""
    return a + u * (s + u * (3.0 * (b - a) - 2.0 * s - t + u * (2.0 * (a - b) + s + t)))


def _cubic_slope(a: Array, b: Array, s: Array, t: Array, u: Array) -> Array:
    return s + u * (2.0 * (3.0 * (b - a) - 2.0 * s - t) + 3.0 * u * (2.0 * (a - b) + s + t))
