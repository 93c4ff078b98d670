"""Brackets of every zero of several functions along a trajectory, proved to be all.

Flights are known at the ends of equal steps. One box for several steps of a lane bounds the
derivatives of the functions there; it decides nearly all steps. The others are enclosed one by
one, and halved by partial steps of the formula until each piece holds one zero or none, see
`hillsphere.dynamics.proof`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics.bounds import Bound
from hillsphere.dynamics.enclosures import (
    Bounded,
    LinearRows,
    derivatives_within,
    enclose,
    region_slopes,
)
from hillsphere.dynamics.expression_bounds import bounds_of_event
from hillsphere.dynamics.intervals import Interval
from hillsphere.dynamics.proof import (
    DEPTH,
    MARGIN,
    MOST_PIECES,
    Pieces,
    Slopes,
    count_crossings,
    decide,
    halved,
    leading,
)
from hillsphere.dynamics.system import System
from hillsphere.interfaces import Array, Integers
from hillsphere.symbolic import Expr

__all__ = ["Brackets", "ProvedBrackets"]

_GROUP = 8
"""Steps in one box: of sixteen its bounds are too wide for a third of the steps near a body."""

Halve = Callable[[Array, Array], tuple[Array, Array]]
"""States (n, K) at the start of a step and times (K,) since → states (n, K), values (m, K)."""


@dataclass(frozen=True, eq=False)
class Brackets:
    """E parts of steps, each of which holds one zero of one function.

    Parameters
    ----------
    function, step, lane : ndarray of int, shape (E,)
        Which function, in which step of which lane.
    begin, end : ndarray, shape (E,)
        Ends of the part, as time since the step began.
    y0, y1 : ndarray, shape (n, E)
        States there.
    g0, g1 : ndarray, shape (E,)
        Values there, of different sign; g1 may be zero.
    resolved : ndarray of bool, shape (N,)
        Whether it is proved of a lane that there are no others.
    """

    function: Integers
    step: Integers
    lane: Integers
    begin: Array
    end: Array
    y0: Array
    y1: Array
    g0: Array
    g1: Array
    resolved: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Several:
    """Functions of one system."""

    system: Bounded
    parts: Sequence[Bounded]
    linear: LinearRows | None = None

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return those of the system."""
        return self.system.rates(t, y, p)

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return all."""
        return [event for part in self.parts for event in part.events(t, y, p)]


class ProvedBrackets:
    """Functions whose zeros are bracketed along flights of an autonomous system.

    Parameters
    ----------
    system : System
        Equations without time and run-time parameters.
    functions : sequence of (str or Expr)
        Events of the system by name, or polynomials of degree two in its states. If there is no
        bound of one, changes of sign at the ends of steps are all that is seen, and flights on
        which a function comes nearer to zero than 0.1 are not resolved.
    """

    def __init__(self, system: System, functions: Sequence[str | Expr]) -> None:
        parts = [bounds_of_event(system, function) for function in functions]
        known = [part for part in parts if part is not None]
        self._bounded: Bounded | None = None
        if system.bounded is not None and len(known) == len(parts):
            self._bounded = _Several(system.bounded, known)

    def __call__(
        self, way: Array, values: Array, h: float, halve: Halve, inside: NDArray[np.bool_]
    ) -> Brackets:
        """Bracket all zeros.

        Parameters
        ----------
        way : ndarray, shape (n, K + 1, N)
            States at the ends of K steps.
        values : ndarray, shape (m, K + 1, N)
            Functions there.
        h : float
            Step; negative for flights backward.
        halve : callable
            Partial steps, see `Halve`.
        inside : ndarray of bool, shape (K, N)
            Which steps count.

        Returns
        -------
        Brackets
            By function, step and lane, as far as one box decides them; then the others. A zero at
            the start of a step is none of that step.
        """
        g0, g1 = values[:, :-1], values[:, 1:]
        changes = count_crossings(g0, g1, 0, from_zero=False) & inside
        sure = self._grouped(way, values, h)
        if self._bounded is None:
            near = (np.minimum(np.abs(g0), np.abs(g1)) < MARGIN) & inside
            sure, resolved = np.ones_like(changes), np.asarray(~near.any(axis=(0, 1)))
        else:
            resolved = np.ones(way.shape[2], dtype=bool)
        function, step, lane = np.nonzero(changes & sure)
        ends = np.zeros(len(step)), np.full(len(step), h)
        found = Brackets(
            function, step, lane, *ends, way[:, step, lane], way[:, step + 1, lane],
            g0[function, step, lane], g1[function, step, lane], resolved,
        )  # fmt: skip
        unsure = ~sure & inside
        return self._halved(found, way, values, h, halve, unsure) if unsure.any() else found

    def _grouped(self, way: Array, values: Array, h: float) -> NDArray[np.bool_]:
        """Say of functions and steps (m, K, N) which are decided by boxes of several steps."""
        functions, steps, lanes = len(values), way.shape[1] - 1, way.shape[2]
        sure = np.zeros((functions, steps, lanes), dtype=bool)
        for size in (_GROUP, steps % _GROUP):
            begin = 0 if size == _GROUP else steps - size
            count = (steps // _GROUP) if size == _GROUP else int(size > 0)
            if not count or self._bounded is None:
                continue
            at = begin + np.arange(size + 1)[:, None] + size * np.arange(count)
            y = way[:, at].reshape(len(way), size + 1, count * lanes)
            g = values[:, at]
            zero, length = np.zeros(count * lanes), np.full(count * lanes, h)
            # A state that turned non-finite has no box; the caller leaves its steps out.
            try:
                holds, slopes = region_slopes(
                    self._bounded, zero, length, y, np.zeros((0, count * lanes))
                )
            except TypeError:  # an operation of which no bound is known
                self._bounded = None
                continue
            shape = (functions, 1, count, lanes)
            a, b, c, d = (one.reshape(shape) for one in _along(slopes, h))
            w = np.array(abs(h))
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                clear, single = decide(g[:, :-1], g[:, 1:], w, (a, b, c, d), 0, from_zero=False)
            decided = (clear | single) & holds.reshape(1, 1, count, lanes)
            sure[:, at[:-1]] = decided
        return sure

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def _halved(
        self,
        found: Brackets,
        way: Array,
        values: Array,
        h: float,
        halve: Halve,
        unsure: NDArray[np.bool_],
    ) -> Brackets:
        """Add the brackets in steps that are not sure (m, K, N), each a lane of its own."""
        lanes = way.shape[2]
        flat, level = way.reshape(len(way), -1), values.reshape(len(values), -1)
        waiting = unsure.reshape(len(unsure), -1)
        which = np.flatnonzero(waiting.any(axis=0))
        waiting = waiting[:, which]
        pieces = Pieces(
            which, np.zeros(len(which)), np.full(len(which), h), flat[:, which],
            flat[:, which + lanes], level[:, which], level[:, which + lanes],
        )  # fmt: skip
        rows = [found]
        resolved = found.resolved
        # A crossing leaves two or three pieces open in each round, whoever else is looked at.
        most = MOST_PIECES + 4 * len(which)

        def keep(one: NDArray[np.bool_], now: Pieces) -> None:
            function, k = np.nonzero(one)
            step, lane = np.divmod(now.lane[k], lanes)
            rows.append(
                Brackets(
                    function, step, lane, now.begin[k], now.end[k], now.y0[:, k], now.y1[:, k],
                    now.g0[function, k], now.g1[function, k], resolved,
                )
            )  # fmt: skip

        for depth in range(DEPTH + 1):
            clear, single = decide(
                pieces.g0, pieces.g1, np.abs(pieces.end - pieces.begin),
                self._slopes(pieces, h), 0, from_zero=False,
            )  # fmt: skip
            keep(single & waiting, pieces)
            waiting = waiting & ~clear & ~single
            left: NDArray[np.bool_] = np.asarray(waiting.any(axis=0))
            if depth == DEPTH or np.count_nonzero(left) > most or not left.any():
                break
            pieces = halved(pieces.taken(left), lambda at, tau: halve(flat[:, at], tau))
            waiting = np.repeat(waiting[:, left], 2, axis=1)
        crosses = waiting & count_crossings(pieces.g0, pieces.g1, 0, from_zero=False)
        keep(crosses, pieces)
        for row, across in zip(waiting, crosses, strict=True):
            rest = row & ~across
            lost = (
                rest & ~leading(row, across, pieces) & ~leading(row, across, _reversed(pieces, h))
            )
            resolved[pieces.lane[lost] % lanes] = False

        def joined(name: str) -> Any:
            return np.concatenate([getattr(row, name) for row in rows], axis=-1)

        return Brackets(
            joined("function"), joined("step"), joined("lane"), joined("begin"), joined("end"),
            joined("y0"), joined("y1"), joined("g0"), joined("g1"), resolved,
        )  # fmt: skip

    def _slopes(self, now: Pieces, h: float) -> Slopes:
        """Bound the functions' derivatives over pieces, along the flight."""
        assert self._bounded is not None
        length, none = now.end - now.begin, np.zeros((0, len(now.lane)))
        box = enclose(self._bounded, now.begin, length, now.y0, none, now.y1)
        when = np.minimum(now.begin, now.end), np.maximum(now.begin, now.end)
        slopes = np.array(derivatives_within(self._bounded, when, box, []))
        slopes[0::2, :, ~box.holds], slopes[1::2, :, ~box.holds] = -np.inf, np.inf
        return _along((slopes[0], slopes[1], slopes[2], slopes[3]), h)


def _along(slopes: Slopes, h: float) -> Slopes:
    a, b, c, d = slopes
    return slopes if h > 0.0 else (-b, -a, c, d)


def _reversed(pieces: Pieces, h: float) -> Pieces:
    """Return pieces of steps as a flight meets them that goes back."""
    begin, end = h - pieces.end, h - pieces.begin
    return Pieces(pieces.lane, begin, end, pieces.y1, pieces.y0, pieces.g1, pieces.g0)
