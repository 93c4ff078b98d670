"""Brackets of all zeros of several functions along a trajectory, with proof of completeness.

The states are known at the ends of equal steps. Each step is enclosed, and bisected by partial
steps of the formula until each piece has one zero or none (`hillsphere.engine.dynamics.proof`).
Boxes over several steps, as in `hillsphere.engine.dynamics.crossing`, are too wide here: a formula
of order eight takes steps of a twentieth of a revolution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.box_bounds import BoxBounds
from hillsphere.engine.dynamics.enclosures import (
    Bounded,
    Enclosure,
    LinearRows,
    enclose,
)
from hillsphere.engine.dynamics.expression_bounds import bounds_of_event
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.proof import (
    DEPTH,
    MARGIN,
    Pieces,
    count_crossings,
    decide,
    halve_pieces,
    leading,
    pad_pieces,
)
from hillsphere.engine.dynamics.system import System
from hillsphere.symbolic.expressions import Expr

__all__ = ["Brackets", "ProvedBrackets"]

_PIECES, _EACH = 4096, 4
"""Numbers of undecided pieces, in total and per examined step, at which a search is given up. A
crossing leaves two or three pieces of its step undecided in each round of bisections."""
_BESIDE = 64
"""Undecided pieces on either side of a zero that are counted as part of it; this tolerates bounds
of the slope that are 64 times too large."""

Halve = Callable[[Array, Array], tuple[Array, Array]]
"""States (n, K) at the start of a step and elapsed times (K,) → states (n, K), values (m, K)."""


@dataclass(frozen=True, eq=False)
class Brackets:
    """Brackets of E zeros, each of one function within one step.

    Parameters
    ----------
    function, step, lane : ndarray of int, shape (E,)
        Indices of function, step and lane.
    begin, end : ndarray, shape (E,)
        Ends of the bracket, as time since the start of the step.
    y0, y1 : ndarray, shape (n, E)
        States at the ends.
    g0, g1 : ndarray, shape (E,)
        Values at the ends, of different sign; g1 may be zero.
    resolved : ndarray of bool, shape (N,)
        Whether it is proved that a lane has no other zeros.
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
    """Bracketing of the zeros of functions along trajectories of an autonomous system.

    Parameters
    ----------
    system : System
        Equations without time and run-time parameters.
    functions : sequence of (str or Expr)
        Events of the system by name, or polynomials of degree two in its states. Of a function
        without bounds only changes of sign between the ends of steps are detected, and flights
        along which its magnitude falls below 0.1 are not resolved.
    """

    def __init__(self, system: System, functions: Sequence[str | Expr]) -> None:
        parts = [bounds_of_event(system, function) for function in functions]
        known = [part for part in parts if part is not None]
        self._bounded: BoxBounds | None = None
        if system.bounded is not None and len(known) == len(parts):
            self._bounded = BoxBounds(_Several(system.bounded, known), len(system.x), after=0)

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
            Steps to be examined.

        Returns
        -------
        Brackets
            The brackets, unordered. A zero at the start of a step does not count for that step.
        """
        if self._bounded is not None:
            try:
                return self._halved(self._bounded, way, values, h, halve, inside)
            except TypeError:  # an operation of which no bound is known
                self._bounded = None
        g0, g1 = values[:, :-1], values[:, 1:]
        near = (np.minimum(np.abs(g0), np.abs(g1)) < MARGIN) & inside
        at = np.nonzero(count_crossings(g0, g1, 0, from_zero=False) & inside)
        function, step, lane = at
        return Brackets(
            function, step, lane, np.zeros(len(step)), np.full(len(step), h), way[:, step, lane],
            way[:, step + 1, lane], g0[at], g1[at], np.asarray(~near.any(axis=(0, 1))),
        )  # fmt: skip

    def _halved(
        self,
        bounded: BoxBounds,
        way: Array,
        values: Array,
        h: float,
        halve: Halve,
        inside: NDArray[np.bool_],
    ) -> Brackets:
        """Bracket all zeros, with each examined step as a lane of its own."""
        lanes = way.shape[2]
        flat, level = way.reshape(len(way), -1), values.reshape(len(values), -1)
        which = np.flatnonzero(inside)
        waiting = np.ones((len(values), len(which)), dtype=bool)
        pieces = Pieces(
            which, np.zeros(len(which)), np.full(len(which), h), flat[:, which],
            flat[:, which + lanes], level[:, which], level[:, which + lanes],
        )  # fmt: skip
        rows: list[Brackets] = []
        resolved = np.ones(lanes, dtype=bool)
        most = _PIECES + _EACH * len(which)

        def keep(one: NDArray[np.bool_], now: Pieces) -> None:
            function, k = np.nonzero(one)
            step, lane = np.divmod(now.lane[k], lanes)
            rows.append(
                Brackets(
                    function, step, lane, now.begin[k], now.end[k], now.y0[:, k], now.y1[:, k],
                    now.g0[function, k], now.g1[function, k], resolved,
                )
            )  # fmt: skip

        # First trial boxes: the change of a state over a step, or over a neighbouring step if the
        # state has an extremum within the step.
        moved = np.abs(np.diff(way, axis=1))
        moved[:, 1:] = np.maximum(moved[:, 1:], moved[:, :-1])
        moved[:, :-1] = np.maximum(moved[:, :-1], moved[:, 1:])
        reach = moved.reshape(len(way), -1)[:, which]
        for depth in range(DEPTH + 1):
            # Per function and piece: certainly no zero, or certainly exactly one.
            clear, single = _decide(bounded, pieces, h, reach, waiting)
            keep(single & waiting, pieces)
            waiting = waiting & ~clear & ~single
            left: NDArray[np.bool_] = np.asarray(waiting.any(axis=0))
            if depth == DEPTH or np.count_nonzero(left) > most or not left.any():
                break
            pieces = halve_pieces(pieces.taken(left), lambda at, tau: halve(flat[:, at], tau))
            waiting = np.repeat(waiting[:, left], 2, axis=1)
            reach = 0.5 * np.repeat(reach[:, left], 2, axis=1)
        # Pieces of the smallest size with a change of sign hold a zero. Undecided neighbours of
        # such a piece belong to it; other undecided pieces leave their lane unresolved.
        crosses = waiting & count_crossings(pieces.g0, pieces.g1, 0, from_zero=False)
        keep(crosses, pieces)
        widest = np.abs(pieces.end - pieces.begin).max(initial=0.0)
        beside = np.full(int(pieces.lane.max(initial=0)) + 1, (_BESIDE + 0.5) * widest)
        for row, across in zip(waiting, crosses, strict=True):
            before = leading(row, across, pieces, beside)
            after = leading(row, across, _reverse_pieces(pieces, h), beside)
            lost = row & ~across & ~before & ~after
            resolved[pieces.lane[lost] % lanes] = False

        def joined(name: str) -> Any:
            return np.concatenate([getattr(row, name) for row in rows], axis=-1)

        return Brackets(
            joined("function"), joined("step"), joined("lane"), joined("begin"), joined("end"),
            joined("y0"), joined("y1"), joined("g0"), joined("g1"), resolved,
        )  # fmt: skip


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _decide(
    bounded: BoxBounds, pieces: Pieces, h: float, reach: Array, waiting: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Decide pieces, see `decide`: by first derivatives, and by second ones where these do not.

    `reach` (n, K) is how far the states may move, for the first trial box. Second derivatives take
    most of the time, and of most pieces the first ones are enough.
    """
    count = len(pieces.lane)
    many = pad_pieces(pieces)
    some = np.minimum(np.arange(len(many.lane)), count - 1)
    none = np.zeros((0, len(many.lane)))
    box = enclose(
        bounded.equations, many.begin, many.end - many.begin, many.y0, none,
        many.y0 + reach[:, some], bounded.rates,
    )  # fmt: skip

    def decided(now: Pieces, box: Enclosure, second: bool) -> Any:
        when = np.minimum(now.begin, now.end), np.maximum(now.begin, now.end)
        p = none[:, : len(now.lane)]
        given = when, (box.lo, box.hi), (box.rate_lo, box.rate_hi), (p, p)
        slopes = np.full((4, len(now.g0), len(now.lane)), np.nan)
        if second:
            slopes = bounded.derivatives(*given)[1]
        else:
            slopes[:2] = bounded.event_rates(*given)
        slopes[0::2, :, ~box.holds], slopes[1::2, :, ~box.holds] = -np.inf, np.inf
        a, b, c, d = slopes
        along = (a, b, c, d) if h > 0.0 else (-b, -a, c, d)
        return decide(now.g0, now.g1, np.abs(now.end - now.begin), along, 0, from_zero=False)

    clear, single = (one[:, :count] for one in decided(many, box, False))
    left = np.flatnonzero((waiting & ~clear & ~single).any(axis=0) & box.holds[:count])
    if left.size:
        few = pad_pieces(pieces.taken(left))
        at = left[np.minimum(np.arange(len(few.lane)), left.size - 1)]
        for one, more in zip((clear, single), decided(few, box.taken(at), True), strict=True):
            one[:, left] |= more[:, : left.size]
    return clear, single


def _reverse_pieces(pieces: Pieces, h: float) -> Pieces:
    """Return pieces of steps in the order of a backward flight."""
    begin, end = h - pieces.end, h - pieces.begin
    return Pieces(pieces.lane, begin, end, pieces.y1, pieces.y0, pieces.g1, pieces.g0)
