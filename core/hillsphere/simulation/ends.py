"""The flight between two samples, and where it ends before the second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.dynamics import ArrayFunction, System, bracketed_roots
from hillsphere.dynamics.proof import (
    MARGIN,
    Found,
    Pieces,
    count_crossings,
    decide,
    search,
)
from hillsphere.dynamics.stages import Stepper
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.simulation.event_proof import EventProof
from hillsphere.simulation.outcomes import STATUSES, status_of_event

__all__ = ["End", "Leg", "Limit", "Watch"]


@dataclass(frozen=True)
class Limit:
    r"""A condition that ends a flight when it falls through zero.

    Parameters
    ----------
    name : str
        Shown as the cause.
    value : callable
        (t_s (N,), x (n, N), cases (N,)) → (N,), continuous along the flight; x the plant's true
        states, SI, cases the numbers of the cases, with which limits of their own are looked up.
    status : str
        One of `STATUSES`.
    lipschitz : array_like, shape (n,), optional
        L with :math:`|v(t, x) - v(t, x')| \le \sum_i L_i |x_i - x'_i|`, per unit of each state of
        the plant. With it the limit is proved between the ends of sub-steps.
    drift : float
        Largest rate, 1/s, at which the value changes with time by itself, the states held.
    margin : float
        Without `lipschitz`: a flight along which the value, at the ends of sub-steps, falls below
        this without ending by this limit is ``unresolved``.
    """

    name: str
    value: Callable[[Array, Array, Integers], Array]
    status: str = "constraint"
    lipschitz: ArrayLike | None = None
    drift: float = 0.0
    margin: float = MARGIN

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise InputError(f"status must be one of {', '.join(STATUSES)}, got {self.status!r}")


@dataclass(frozen=True)
class Leg:
    """One block between two samples.

    Parameters
    ----------
    t, y : ndarray, shape (B,), (rows, B)
        Time and state at its start.
    period : ndarray, shape (B,)
        How long.
    p : ndarray, shape (k, B)
        Run-time parameters.
    cases : ndarray of int, shape (B,)
        Numbers of the cases.
    flying : ndarray of bool, shape (B,)
        Lanes that still fly.
    whole : bool
        Whether all do.
    left, rate : ndarray, shape (B,), or None
        Δv at hand at the start, None without a budget; and what is spent per second, None if the
        last state counts it.
    """

    t: Array
    y: Array
    period: Array
    p: Array
    cases: Integers
    flying: NDArray[np.bool_]
    whole: bool = False
    left: Array | None = None
    rate: Array | None = None

    def taken(self, lanes: Integers) -> Leg:
        """Return some of the lanes, any of them as often as wanted."""
        return Leg(
            self.t[lanes], self.y[:, lanes], self.period[lanes],
            np.ascontiguousarray(self.p[:, lanes]), self.cases[lanes], self.flying[lanes],
            self.whole,
            None if self.left is None else self.left[lanes],
            None if self.rate is None else self.rate[lanes],
        )  # fmt: skip


@dataclass(frozen=True)
class End:
    """How a leg ended: the states of all lanes, and which ended before its end.

    Parameters
    ----------
    y : ndarray, shape (rows, B)
        State at the end of the leg, or of the flight.
    t : ndarray, shape (B,)
        Time of it.
    cause : ndarray of int, shape (B,), or None
        None if every lane that flew reached the end of the leg; otherwise by lane −1 for those
        that did, `Watch.diverged` for those that turned non-finite, the row of `Watch`, or
        what `Watch.unresolved` gives for a row that could not be decided.
    doubtful : ndarray of int, shape (B,), or None
        Row without a bound that came closer to zero than its margin, or −1; None for none. The
        flight goes on; unless it ends by that very row it is unresolved.
    error : ndarray, shape (B,), or None
        Sum of the estimated errors of the steps, in units of the system's scale.
    """

    y: Array
    t: Array
    cause: Integers | None
    doubtful: Integers | None = None
    error: Array | None = None


class Watch:
    """All that may end a flight, as rows of one function; and the flight of a leg under it.

    Parameters
    ----------
    system : System
        The equations that fly.
    stepper : Stepper
        Their step.
    events : ArrayFunction or None
        The system's events, compiled, in their order; None if it has none.
    n : int
        Number of the plant's states among them.
    limits : sequence of Limit
        Of the user.
    budget : bool
        Whether the Δv at hand is watched.
    """

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        events: ArrayFunction | None,
        n: int,
        limits: Sequence[Limit],
        budget: bool,
    ) -> None:
        self._stepper, self._events = stepper, events
        self._n, self._limits = n, tuple(limits)
        self.names = [*system.events, *(limit.name for limit in limits)]
        self.statuses = [*map(status_of_event, system.events), *(limit.status for limit in limits)]
        self.budget_row = len(self.names)
        if budget:
            self.names.append("dv_budget")
            self.statuses.append("propellant")
        self.diverged = len(self.names)
        self.names.append("state not finite")
        self.statuses.append("diverged")
        rows = self.names[: self.diverged]
        self.names.extend(rows)
        self.statuses.extend(["unresolved"] * len(rows))
        self._known: tuple[Array, Array, Integers, Array] | None = None
        self._proof = EventProof(system.bounded, len(system.events), limits, budget)

    def unresolved(self, rows: Integers) -> Integers:
        """Return the causes that say of these rows that they could not be decided."""
        return np.asarray(self.diverged + 1 + rows)

    def values(self, leg: Leg, t: Array, y: Array) -> Array:
        """Return all rows (E, B); positive while a flight may go on."""
        x = y[: self._n]
        rows: list[Array] = []
        if self._events is not None:
            rows.extend(self._events(y, leg.p, t))
        for limit in self._limits:
            value = np.asarray(limit.value(t, x, leg.cases), dtype=float)
            if value.shape != t.shape:
                raise InputError(f"limit {limit.name!r} must return {t.shape}, got {value.shape}")
            rows.append(value)
        if leg.left is not None:
            spent = y[-1] if leg.rate is None else leg.rate * (t - leg.t)
            rows.append(leg.left - spent)
        return np.array(rows).reshape(len(rows), len(t))

    def start(self, leg: Leg) -> Integers:
        """Return what forbids the start, by lane: −1, or a row that is negative or not a number."""
        cause = np.full(len(leg.t), -1)
        values = self.values(leg, leg.t, leg.y)
        for row in range(len(values) - 1, -1, -1):
            cause[values[row] < 0] = row
        cause[self._bad(leg.y, values)] = self.diverged
        return cause

    def fly(self, leg: Leg, steps: int) -> End:
        """Fly a leg in equal steps, each lane to the end of the leg or to its own."""
        h = leg.period / steps
        advance = self._stepper.bind_measured(h, leg.p)
        errors = np.zeros((steps, len(leg.t)))
        y = np.empty((len(leg.y), steps + 1, len(leg.t)))
        y[:, 0], here, t = leg.y, leg.y, leg.t
        rows = [self._at_start(leg)]
        for j in range(1, steps + 1):
            there = np.empty_like(here)
            errors[j - 1] = advance(here, there, t)
            here, t = there, leg.t + j * h
            y[:, j] = here
            rows.append(self.values(leg, t, here))
        values = np.stack(rows, axis=1)
        self._known = (here, t, leg.cases, rows[-1])
        # One sum tells a NaN or infinity; it may overflow by itself: the slow way is exact.
        least = values.min(axis=1)
        seen = least if leg.whole else np.where(leg.flying, least, 1.0)
        sound = seen.min(initial=1.0) > 0.0 and isfinite(np.add.reduce(y, axis=None))
        self._proof.ready(leg)
        holds, slopes = self._proof.of_leg(leg, y, h)
        proved = slopes is not None and bool((holds | ~leg.flying).all())
        far = proved and self._proof.is_far(least, h, leg.flying)
        doubtful = self._doubtful(least, leg.flying)
        if sound and (far or not self._proof.bounded_rows.any()):
            return End(here, t, None, doubtful, errors.sum(axis=0))
        blank = End(here.copy(), t.copy(), np.full(len(t), -1), doubtful)
        end, error = _Ending(blank, leg.flying.copy()), np.zeros(len(t))
        for j in range(steps):
            if not end.flying.any():
                break
            error[end.flying] += errors[j, end.flying]
            step = _Step(
                leg.t + j * h, np.ascontiguousarray(y[:, j]), h, values[:, j], values[:, j + 1]
            )
            self._end_step(end, leg, step, np.ascontiguousarray(y[:, j + 1]), slopes, holds)
        assert end.end.cause is not None
        none = (end.end.cause < 0).all()
        return End(end.end.y, end.end.t, None if none else end.end.cause, doubtful, error)

    def _at_start(self, leg: Leg) -> Array:
        """Return the rows at the start: those at the end of the last leg where nothing changed."""
        known = self._known
        if known is not None and known[0] is leg.y and known[2] is leg.cases:
            # The clocks of both legs agree but for rounding.
            near = np.abs(known[1] - leg.t) <= 1e-12 * np.maximum(np.abs(leg.t), 1.0)
            if near.all():
                return known[3]
        return self.values(leg, leg.t, leg.y)

    def _doubtful(self, least: Array, flying: NDArray[np.bool_]) -> Integers | None:
        """Return, by lane, the row without a bound that came closer to zero than its margin."""
        close = (least < self._proof.margins[: len(least), None]) & flying
        close &= ~self._proof.bounded_rows[: len(least), None]
        if not close.any():
            return None
        return np.where(close.any(axis=0), np.argmax(close, axis=0), -1)

    def _end_step(
        self,
        ending: _Ending,
        leg: Leg,
        step: _Step,
        after: Array,
        slopes: tuple[Array, Array, Array, Array] | None,
        holds: NDArray[np.bool_],
    ) -> None:
        """Decide what ends which lanes in one sub-step, and write it down."""
        flying, earlier, values = ending.flying, step.earlier, step.values
        # A flight may begin on a surface: then only going below zero ends it.
        fell = count_crossings(earlier, values, -1) | (values < 0)
        fell &= flying
        bad = flying & self._bad(after, values)
        found: Found | None = None
        bounded = self._proof.bounded_rows[:, None]
        if bounded.any():
            clear = single = np.zeros(fell.shape, dtype=bool)
            if slopes is not None:
                clear, single = decide(earlier, values, np.abs(step.h), slopes, -1)
            if self._proof.budget_row is not None:
                clear[self._proof.budget_row] = ~fell[self._proof.budget_row]
                single = single.copy()
                single[self._proof.budget_row] = fell[self._proof.budget_row]
            certain = ((clear | single) & (holds | self._proof.budget_rows)) | ~bounded
            lanes = np.flatnonzero(flying & ~bad & ~certain.all(axis=0))
            if len(lanes):
                found = self._searched(leg, step, after, lanes, certain)
                # What the search found to be more than one crossing, or none, replaces the ends'.
                fell[:, lanes] &= certain[:, lanes]
        ended: NDArray[np.bool_] = bad | np.any(fell, axis=0)
        if found is not None:
            ended |= (np.isfinite(found.begin) | np.isfinite(found.open_at)).any(axis=0)
        if ended.any():
            assert ending.end.cause is not None
            self._place(ending.end, ending.end.cause, leg, step, fell & ~bad, bad, found)
            ending.flying = flying & ~ended

    def _searched(
        self, leg: Leg, step: _Step, after: Array, lanes: Integers, certain: NDArray[np.bool_]
    ) -> Found:
        """Search a sub-step of some lanes for the first crossing of what is not certain."""
        zero = np.zeros(len(lanes))
        pieces = Pieces(
            lanes, zero, step.h[lanes], step.y[:, lanes], after[:, lanes],
            step.earlier[:, lanes], step.values[:, lanes],
        )  # fmt: skip

        def halve(lane: Integers, tau: Array) -> tuple[Array, Array]:
            part = leg.taken(lane)
            begun, out = step.t[lane], np.empty((len(step.y), len(lane)))
            start = np.ascontiguousarray(step.y[:, lane])
            self._stepper.bind(tau, part.p)(start, out, begun)
            return out, self.values(part, begun + tau, out)

        return search(
            pieces,
            len(step.t),
            lambda now: self._proof.of_pieces(leg, now, step.t),
            halve,
            -1,
            ~certain[:, lanes],
        )

    def _bad(self, y: Array, values: Array) -> NDArray[np.bool_]:
        finite = np.asarray(np.isfinite(y).all(axis=0))
        return ~finite | np.asarray(np.isnan(values).any(axis=0))

    def _place(
        self,
        end: End,
        cause: Integers,
        leg: Leg,
        step: _Step,
        fell: NDArray[np.bool_],
        bad: NDArray[np.bool_],
        searched: Found | None,
    ) -> None:
        """Write into `end` and `cause` when, where and why lanes ended in this step."""
        partial = np.empty_like(step.y)
        width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(step.h), np.abs(step.t))
        first, found = np.full(len(step.t), np.inf), np.full(len(step.t), -1)
        among = fell.any(axis=1)
        if searched is not None:
            among = among | np.isfinite(searched.begin).any(axis=1)
        for row in np.flatnonzero(among).tolist():

            def after(tau: Array, row: int = row) -> Array:
                self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
                value: Array = self.values(leg, step.t + tau, partial)[row]
                return value

            near = np.zeros(len(step.t))
            far = np.where(fell[row] & (step.earlier[row] > 0), step.h, 0.0)
            g_near, g_far = step.earlier[row], step.values[row]
            hit = fell[row]
            if searched is not None and (inner := np.isfinite(searched.begin[row]) & ~hit).any():
                near = np.where(inner, searched.begin[row], near)
                far = np.where(inner, searched.end[row], far)
                g_near = np.where(inner, after(near), g_near)
                g_far = np.where(inner, after(far), g_far)
                hit = hit | inner
            tau = bracketed_roots(after, near, far, g_near, g_far, width)
            sooner = hit & (tau < first)
            first[sooner], found[sooner] = tau[sooner], row
        hit = found >= 0
        if searched is not None:
            row = np.argmin(searched.open_at, axis=0)
            opens = searched.open_at[row, np.arange(len(row))]
            undecided = np.isfinite(opens) & (opens <= first)
            first[undecided] = opens[undecided]
            found[undecided] = self.diverged + 1 + row[undecided]
            hit |= undecided
        tau = np.where(hit, first, 0.0)
        self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
        # A lane that turned non-finite is left at its last finite state.
        end.y[:, hit], end.y[:, bad] = partial[:, hit], step.y[:, bad]
        end.t[hit | bad] = (step.t + tau)[hit | bad]
        cause[hit], cause[bad] = found[hit], self.diverged


@dataclass(eq=False)
class _Ending:
    """The end of a leg as it is being found, and the lanes that still fly."""

    end: End
    flying: NDArray[np.bool_]


@dataclass(frozen=True)
class _Step:
    """A sub-step of length h (B,) from t and y, with the rows of the watch before and after."""

    t: Array
    y: Array
    h: Array
    earlier: Array
    values: Array
