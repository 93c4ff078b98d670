"""The flight between two samples, and where it ends before the second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import ArrayFunction, System, bracketed_roots
from hillsphere.dynamics.stages import Stepper
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.simulation.outcomes import STATUSES, status_of_event

__all__ = ["End", "Leg", "Limit", "Watch"]


@dataclass(frozen=True)
class Limit:
    """A condition that ends a flight when it falls through zero.

    Parameters
    ----------
    name : str
        Shown as the cause.
    value : callable
        (t_s (N,), x (n, N), cases (N,)) → (N,), continuous along the flight; x the plant's true
        states, SI, cases the numbers of the cases, with which limits of their own are looked up.
    status : str
        One of `STATUSES`.
    """

    name: str
    value: Callable[[Array, Array, Integers], Array]
    status: str = "constraint"

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
        that did, `Watch.diverged` for those that turned non-finite, or the row of `Watch`.
    """

    y: Array
    t: Array
    cause: Integers | None


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
        advance = self._stepper.bind(h, leg.p)
        y, t = leg.y, leg.t
        flying, whole = leg.flying, leg.whole
        end: End | None = None
        cause = np.full(0, -1)
        for j in range(1, steps + 1):
            here, before = y, t
            y, t = np.empty_like(here), leg.t + j * h
            advance(here, y, before)
            values = self.values(leg, t, y)
            seen = values if whole else np.where(flying, values, 1.0)
            # One sum tells a NaN or infinity; it may overflow by itself: the slow way is exact.
            if seen.min(initial=1.0) > 0.0 and isfinite(np.add.reduce(y, axis=None)):
                continue
            earlier = self.values(leg, before, here)
            # A flight may begin on a surface: then only going below zero ends it.
            fell = (((values <= 0) & (earlier > 0)) | (values < 0)) & flying
            bad = flying & self._bad(y, values)
            ended: NDArray[np.bool_] = bad | np.any(fell, axis=0)
            if ended.any():
                if end is None:
                    cause = np.full(len(t), -1)
                    end = End(y.copy(), t.copy(), cause)
                self._place(
                    end, cause, leg, _Step(before, here, h, earlier, values), fell & ~bad, bad
                )
                flying = flying & ~ended
                whole = False
        if end is None:
            return End(y, t, None)
        on = cause < 0
        end.y[:, on], end.t[on] = y[:, on], t[on]
        return end

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
    ) -> None:
        """Write into `end` and `cause` when, where and why lanes ended in this step."""
        partial, none = np.empty_like(step.y), np.zeros(len(step.t))
        width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(step.h), np.abs(step.t))
        first, found = np.full(len(step.t), np.inf), np.full(len(step.t), -1)
        for row in np.flatnonzero(fell.any(axis=1)).tolist():

            def after(tau: Array, row: int = row) -> Array:
                self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
                value: Array = self.values(leg, step.t + tau, partial)[row]
                return value

            far = np.where(fell[row] & (step.earlier[row] > 0), step.h, 0.0)
            tau = bracketed_roots(after, none, far, step.earlier[row], step.values[row], width)
            sooner = fell[row] & (tau < first)
            first[sooner], found[sooner] = tau[sooner], row
        hit = found >= 0
        tau = np.where(hit, first, 0.0)
        self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
        # A lane that turned non-finite is left at its last finite state.
        end.y[:, hit], end.y[:, bad] = partial[:, hit], step.y[:, bad]
        end.t[hit | bad] = (step.t + tau)[hit | bad]
        cause[hit], cause[bad] = found[hit], self.diverged


@dataclass(frozen=True)
class _Step:
    """A sub-step of length h (B,) from t and y, with the rows of the watch before and after."""

    t: Array
    y: Array
    h: Array
    earlier: Array
    values: Array
