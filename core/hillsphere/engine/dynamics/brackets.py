"""Brackets of every zero of several functions along a trajectory, proved to be all.

Flights are known at the ends of equal steps. Each step is enclosed, and halved by partial steps of
the formula until each piece holds one zero or none, see `hillsphere.engine.dynamics.proof`. Boxes
of several steps, as in `hillsphere.engine.dynamics.crossing`, decide nothing where a step is a
twentieth of a revolution, which is what a formula of order eight needs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.enclosures import Bounded, LinearRows, derivatives_within, enclose
from hillsphere.engine.dynamics.expression_bounds import bounds_of_event
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.proof import (
    DEPTH,
    MARGIN,
    Pieces,
    Slopes,
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
"""Undecided pieces, and for each step looked at, beyond which a search is given up. A crossing
leaves two or three of its step in each round of halvings."""
_BESIDE = 64
"""Undecided pieces on either side of a zero that count as part of it: bounds 64 times too steep."""

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
            In no order. A zero at the start of a step is none of that step.
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
        bounded: Bounded,
        way: Array,
        values: Array,
        h: float,
        halve: Halve,
        inside: NDArray[np.bool_],
    ) -> Brackets:
        """Bracket all zeros, each step that counts a lane of its own."""
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

        # Of a state that turns within a step the neighbouring steps tell how far it may move.
        moved = np.abs(np.diff(way, axis=1))
        moved[:, 1:] = np.maximum(moved[:, 1:], moved[:, :-1])
        moved[:, :-1] = np.maximum(moved[:, :-1], moved[:, 1:])
        reach = moved.reshape(len(way), -1)[:, which]
        for depth in range(DEPTH + 1):
            count = len(pieces.lane)
            many = pad_pieces(pieces)
            some = np.minimum(np.arange(len(many.lane)), count - 1)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found = decide(
                    many.g0, many.g1, np.abs(many.end - many.begin),
                    _slopes(bounded, many, h, reach[:, some]), 0, from_zero=False,
                )  # fmt: skip
            clear, single = (one[:, :count] for one in found)
            keep(single & waiting, pieces)
            waiting = waiting & ~clear & ~single
            left: NDArray[np.bool_] = np.asarray(waiting.any(axis=0))
            if depth == DEPTH or np.count_nonzero(left) > most or not left.any():
                break
            pieces = halve_pieces(pieces.taken(left), lambda at, tau: halve(flat[:, at], tau))
            waiting = np.repeat(waiting[:, left], 2, axis=1)
            reach = 0.5 * np.repeat(reach[:, left], 2, axis=1)
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


def _slopes(bounded: Bounded, now: Pieces, h: float, reach: Array) -> Slopes:
    """Bound the functions' derivatives over pieces, along the flight.

    `reach` (n, K) is how far the states may move, for the first trial box.
    """
    length, none = now.end - now.begin, np.zeros((0, len(now.lane)))
    box = enclose(bounded, now.begin, length, now.y0, none, now.y0 + reach)
    when = np.minimum(now.begin, now.end), np.maximum(now.begin, now.end)
    slopes = np.array(derivatives_within(bounded, when, box, []))
    slopes[0::2, :, ~box.holds], slopes[1::2, :, ~box.holds] = -np.inf, np.inf
    return _along((slopes[0], slopes[1], slopes[2], slopes[3]), h)


def _along(slopes: Slopes, h: float) -> Slopes:
    a, b, c, d = slopes
    return slopes if h > 0.0 else (-b, -a, c, d)


def _reverse_pieces(pieces: Pieces, h: float) -> Pieces:
    """Return pieces of steps as a flight meets them that goes back."""
    begin, end = h - pieces.end, h - pieces.begin
    return Pieces(pieces.lane, begin, end, pieces.y1, pieces.y0, pieces.g1, pieces.g0)
