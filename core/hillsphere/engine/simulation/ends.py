"""Propagation between two samples, with detection of events that end a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.proof import (
    DEPTH,
    FirstCrossings,
    Pieces,
    Slopes,
    count_crossings,
    decide,
    search,
)
from hillsphere.engine.dynamics.root_finding import bracketed_roots
from hillsphere.engine.dynamics.stages import Stepper
from hillsphere.engine.dynamics.system import System
from hillsphere.engine.simulation.event_proof import EventProof
from hillsphere.engine.simulation.legs import (
    BLOCK,
    End,
    Held,
    Leg,
    Limit,
    Nodes,
    Sample,
    Unproved,
)
from hillsphere.engine.simulation.outcomes import status_of_event

__all__ = ["Watch"]

_PAUSE = 15
"""Largest number of samples without an attempt to prove all parts together, after attempts that
failed because a flight was close to an event."""
_TOGETHER = 1024
"""Sub-steps that are searched at once: enough to amortise the overhead of array operations, few
enough that little is searched after the end of a flight."""
_ALL_TOGETHER = 4096
"""The same where no flight is expected to end: their halves are still halved at once."""


class Watch:
    """All conditions that may end a flight, as rows of one function; propagates legs under them.

    Parameters
    ----------
    system : System
        The propagated equations.
    stepper : Stepper
        Their integration step.
    events : ArrayFunction or None
        The system's events, compiled, in their order; None if it has none.
    n : int
        Number of the plant's states among the system's.
    limits : sequence of Limit
        Limits of the user.
    budget : bool
        Whether the remaining Δv is checked.
    proof : EventProof
        Bounds of the conditions; its bounds for regions can be shared by several watches.
    """

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        events: ArrayFunction | None,
        n: int,
        limits: Sequence[Limit],
        budget: bool,
        proof: EventProof,
    ) -> None:
        self._stepper, self._events = stepper, events
        self._n, self._limits = n, tuple(limits)
        for limit in limits:
            if limit.lipschitz is not None and len(np.asarray(limit.lipschitz)) != n:
                raise InputError(
                    f"limit {limit.name!r}: lipschitz must have one number for each of the {n} "
                    f"states, got {limit.lipschitz!r}"
                )
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
        self._proof = proof
        self._pause = self._left = 0
        # Parts of a flight in which no flight ends, by their parameters, and where they begin.
        self._proved: dict[int, tuple[Array, Array]] = {}

    def unresolved(self, rows: Integers) -> Integers:
        """Return the causes that mark these rows as undecided."""
        return np.asarray(self.diverged + 1 + rows)

    def values(self, leg: Leg, t: Array, y: Array) -> Array:
        """Return all rows (E, B), which are positive while a flight continues."""
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
        """Return per lane the row that is negative or NaN at the start, or −1 without one."""
        cause = np.full(len(leg.t), -1)
        values = self.values(leg, leg.t, leg.y)
        for row in range(len(values) - 1, -1, -1):
            cause[values[row] < 0] = row
        cause[_broken(leg.y, values)] = self.diverged
        return cause

    def fly(self, leg: Leg, steps: int, *, ahead: bool = False) -> End:
        """Propagate a leg in equal steps, each lane to the end of the leg or of its flight.

        With `ahead` a leg of which nothing but its ends shows that no flight ends in it may be
        returned as it is, with `End.unproved`, for `count_proved`.
        """
        proof, lanes = self._proof, len(leg.t)
        proof.ready(leg)
        held = Held(leg.t, leg.period, leg.p, leg.rate, steps)
        flown, h, t = self._flow(held, leg.y)
        y, errors = self._split_off_errors(flown)
        nodes = y.transpose(1, 0, 2)
        before, end = self._at_start(leg), leg.frozen(y[-1])
        after = self.values(leg, t, y[-1])
        self._known = (end, t, leg.cases, after)
        # A finite sum excludes NaN and infinity. If the sum itself overflows, the slower exact
        # check below decides.
        sound = isfinite(np.add.reduce(flown, axis=None))
        look = proof.look
        if (
            sound
            and look is not None
            and look.is_far(leg, [held], [leg.y], before, after)
            and self._has_left(leg, after)
        ):
            return End(end, t, None, None, errors.sum(axis=0), nodes)
        if ahead and sound and look is not None and (after[:, leg.flying] > 0.0).all():
            unproved = Unproved(leg, h, np.ascontiguousarray(nodes))
            return End(end, t, None, None, errors.sum(axis=0), nodes, unproved)
        values = np.empty((steps + 1, self.diverged, lanes))
        values[0], values[-1] = before, after
        for j in range(1, steps):
            values[j] = self.values(leg, leg.t + j * h, y[j])
        least = values.min(axis=0)
        doubtful = self._doubtful(least, leg.flying)
        passed = (
            not proof.proves
            or self._was_proved(leg)
            or (look is not None and look.is_far_between(leg, y, values))
        )
        if sound and passed and (least[:, leg.flying] > 0.0).all():
            return End(end, t, None, doubtful, errors.sum(axis=0), nodes)
        nodes = np.ascontiguousarray(nodes)
        return self._settle(_Flown(leg, h, nodes, values.transpose(1, 0, 2), errors), doubtful)

    def count_proved(self, flown: Sequence[Unproved], cases: int) -> int:
        """Return how many of some legs, from the first on, are proved to end no flight.

        Parameters
        ----------
        flown : sequence of Unproved
            Legs of equally many sub-steps.
        cases : int
            Number of their first lanes that count; the others repeat the last of them.
        """
        some = [one.taken(np.flatnonzero(one.leg.flying[:cases])) for one in flown]
        counts = [len(one.h) for one in some]
        whole, total = Unproved.joined(some), sum(counts)
        # Whole blocks, so that no lane's last bits depend on how many others there are.
        lanes = -(-total // BLOCK) * BLOCK
        whole = whole.taken(np.minimum(np.arange(lanes), total - 1))
        leg, h, y = whole.leg, whole.h, np.ascontiguousarray(whole.y)
        steps = y.shape[1] - 1
        times = leg.t + np.arange(steps + 1)[:, None] * h
        many = leg.taken(np.tile(np.arange(lanes), steps + 1))
        values = self.values(many, times.ravel(), y.reshape(len(y), -1))
        values = values.reshape(-1, steps + 1, lanes)
        ends = np.arange(lanes) < total
        fails = ends & ~(values > 0.0).all(axis=(0, 1))
        parts = np.split(np.arange(total), np.cumsum(counts)[:-1])
        nodes = [
            Nodes(leg.taken(part), h[part], y[:, :, part], values[:, :, part]) for part in parts
        ]
        index = np.full((steps, lanes), -1)
        index[:, :total] = np.concatenate(self._proof.of_legs(nodes), axis=1)
        certain = self._certain(values[:, :-1], values[:, 1:], y, index, h)
        wanted = ends & ~fails & ~certain.all(axis=0)
        if wanted.any():
            searched = self._searched(
                _Flown(leg, h, y, values, np.zeros(0)), np.flatnonzero(wanted), certain, index,
                _ALL_TOGETHER,
            )  # fmt: skip
            met = np.isfinite(searched.begin) | np.isfinite(searched.open_at)
            fails |= met.any(axis=0).reshape(steps, lanes).any(axis=0)
        proved = [not fails[part].any() for part in parts]
        return len(parts) if all(proved) else proved.index(False)

    def fly_at_once(self, leg: Leg, parts: Sequence[Held], last: Leg) -> Sample | None:
        """Propagate all parts between two samples, if a joint proof excludes the end of a flight.

        Parameters
        ----------
        leg, last : Leg
            The first and the last part; the initial state of the latter is not used.
        parts : sequence of Held
            All parts.

        Returns
        -------
        Sample or None
            None without a proof; the parts must then be propagated one by one.
        """
        self._proof.ready(leg)
        self._proved.clear()
        look = self._proof.look
        if look is None:
            return None
        y, nodes, errors, begins = leg.y, [], [], []
        sum_of_all, t = 0.0, leg.t
        for part in parts:
            flown, _, t = self._flow(part, y)
            states, error = self._split_off_errors(flown)
            begins.append(y)
            y = states[-1]
            nodes.append(states.transpose(1, 0, 2))
            errors.append(error.sum(axis=0))
            sum_of_all += float(np.add.reduce(flown, axis=None))
        # A finite sum excludes NaN and infinity. If it overflows, there is no proof.
        if not isfinite(sum_of_all):
            return None
        end, before, after = leg.frozen(y), self._at_start(leg), self.values(last, t, y)
        if not self._has_left(last, after):
            return None
        if not look.is_far(leg, parts, begins, before, after):
            if self._left:
                self._left -= 1
                return None
            proved = self._prove_parts(leg, parts, nodes)
            useful = 2 * sum(proved) >= len(parts)
            self._pause = 0 if useful else min(2 * self._pause + 1, _PAUSE)
            self._left = self._pause
            if not all(proved):
                # One by one then, of which those that are proved need not be looked at again.
                for part, begin, decided in zip(parts, begins, proved, strict=True):
                    if decided:
                        self._proved[id(part.p)] = part.p, begin
                return None
        self._known = (end, t, leg.cases, after)
        return Sample(end, t, errors, nodes)

    def _prove_parts(self, leg: Leg, parts: Sequence[Held], nodes: Sequence[Array]) -> list[bool]:
        """Return of which parts the states at all ends of sub-steps prove that no flight ends.

        A flight that has fallen below zero has ended: what was computed of it later does not count.
        """
        flown: list[Nodes] = []
        flying, proved = leg.flying, []
        for part, y in zip(parts, nodes, strict=True):
            here = replace(
                leg, t=part.t, y=y[:, 0], period=part.period, p=part.p,
                flying=flying, whole=bool(flying.all()),
                # The remaining Δv never increases: its value at the end decides (`_has_left`).
                left=None if leg.left is None else np.full(len(leg.t), np.inf),
                rate=None if leg.rate is None else np.zeros(len(leg.t)),
            )  # fmt: skip
            count, lanes = y.shape[1:]
            many = here.taken(np.tile(np.arange(lanes), count))
            flat = np.ascontiguousarray(y).reshape(len(y), -1)
            values = self.values(many, part.times.ravel(), flat).reshape(-1, count, lanes)
            proved.append(bool((values[:, :, flying] > 0.0).all()))
            flown.append(Nodes(here, part.period / part.steps, y, values))
            flying = flying & ~(values[:, 1:] < 0.0).any(axis=(0, 1))
        if not any(proved):
            return proved
        for i, (one, index) in enumerate(zip(flown, self._proof.of_legs(flown), strict=True)):
            if not proved[i]:
                continue
            g = one.values
            certain = self._certain(g[:, :-1], g[:, 1:], one.y, index, one.h)
            wanted = one.leg.flying & ~certain.all(axis=0)
            if not wanted.any():
                continue
            y = np.ascontiguousarray(one.y)
            searched = self._searched(
                _Flown(one.leg, one.h, y, g, np.zeros(0)), np.flatnonzero(wanted), certain, index
            )
            proved[i] = not (np.isfinite(searched.begin) | np.isfinite(searched.open_at)).any()
        return proved

    def _was_proved(self, leg: Leg) -> bool:
        """Return whether a joint proof holds for this leg: of its part, from the same states."""
        part, begin = self._proved.pop(id(leg.p), (None, None))
        if part is None or begin is None:
            return False
        return bool(np.array_equal(leg.y[:, leg.flying], begin[:, leg.flying]))

    def _flow(self, part: Held, y: Array) -> tuple[Array, Array, Array]:
        """Propagate states y (rows, B) over a part.

        Returns
        -------
        flown : ndarray, shape (steps + 1, rows + 2, B)
            States at the end of each sub-step with its two rows of error; the start comes first.
        h, t : ndarray, shape (B,)
            Length of the sub-steps; time at the end.
        """
        rows, lanes = y.shape
        h, steps = part.period / part.steps, part.steps
        advance = self._stepper.bind_measured(h, part.p)
        flown = np.empty((steps + 1, rows + 2, lanes))
        flown[0, :rows], flown[0, rows:], t = y, 0.0, part.t
        for j in range(1, steps + 1):
            advance(flown[j - 1, :rows], flown[j], t)
            t = part.t + j * h
        return flown, h, t

    def _split_off_errors(self, flown: Array) -> tuple[Array, Array]:
        """Split propagated rows into states (steps + 1, rows, B) and errors (steps, B)."""
        return flown[:, :-2], self._stepper.error(flown[1:, -2:])

    def _has_left(self, leg: Leg, after: Array) -> bool:
        """Return whether all lanes have Δv left; it never increases, so that the end decides."""
        if leg.left is None:
            return True
        left = after[self.budget_row] > 0.0
        return bool(left.all() if leg.whole else left[leg.flying].all())

    def _at_start(self, leg: Leg) -> Array:
        """Return the rows at the start; those at the end of the last leg if nothing has changed."""
        known = self._known
        if known is not None and known[0] is leg.y and known[2] is leg.cases:
            # The clocks of both legs agree but for rounding.
            near = np.abs(known[1] - leg.t) <= 1e-12 * np.maximum(np.abs(leg.t), 1.0)
            if near.all():
                return known[3]
            # Lane by lane, so that no lane's last bits depend on the clocks of its neighbours.
            return np.where(near, known[3], self.values(leg, leg.t, leg.y))
        return self.values(leg, leg.t, leg.y)

    def _doubtful(self, least: Array, flying: NDArray[np.bool_]) -> Integers | None:
        """Return per lane the row without a bound that fell below its margin, or −1."""
        if self._proof.bounded_rows.all():
            return None
        close = (least < self._proof.margins[:, None]) & flying & ~self._proof.bounded_rows[:, None]
        if not close.any():
            return None
        return np.where(close.any(axis=0), np.argmax(close, axis=0), -1)

    def _settle(self, flown: _Flown, doubtful: Integers | None) -> End:
        """Determine the first event of each lane in a leg, its sub-step and its location."""
        leg, y, values = flown.leg, flown.y, flown.values
        steps, lanes = y.shape[1] - 1, y.shape[2]
        g0, g1, flying = values[:, :-1], values[:, 1:], leg.flying
        # A flight may begin on a surface: then only a value below zero ends it.
        fell = (count_crossings(g0, g1, -1) | (g1 < 0)) & flying
        bad = flying & _broken(y[:, 1:], g1)
        (index,) = self._proof.of_legs([Nodes(leg, flown.h, y, values)])
        certain = self._certain(g0, g1, y, index, flown.h)
        ends = bad | (fell & certain).any(axis=0)
        # Sub-steps after the first certain end of a lane are irrelevant.
        live = flying & ~_earlier(ends)
        wanted = live & ~bad & ~certain.all(axis=0)
        crossings = None
        if wanted.any():
            crossings = self._searched(flown, np.flatnonzero(wanted), certain, index)
            inner = np.isfinite(crossings.begin) | np.isfinite(crossings.open_at)
            inner = inner.reshape(len(g0), steps, lanes)
            # The search replaces the signs at the ends, except for rows that start below zero.
            searched = wanted & ~certain
            fell &= ~searched | ((g1 < 0) & ~inner)
            ends = (bad | fell.any(axis=0) | inner.any(axis=0)) & live
        else:
            ends = ends & live
        ended = ends.any(axis=0)
        if not ended.any():
            last = leg.frozen(y[:, -1].copy())
            return End(last, flown.time(steps), None, doubtful, flown.error(None), y)
        at = np.where(ended, np.argmax(ends, axis=0), steps - 1)
        end = End(
            leg.frozen(y[:, -1].copy()),
            flown.time(steps),
            np.full(lanes, -1),
            doubtful,
            flown.error(np.where(ended, at, steps - 1)),
            y,
        )
        lane = np.arange(lanes)
        step = _Step(
            leg.t + at * flown.h, np.ascontiguousarray(y[:, at, lane]), flown.h,
            np.ascontiguousarray(g0[:, at, lane]), np.ascontiguousarray(g1[:, at, lane]),
        )  # fmt: skip
        here = None
        if crossings is not None:
            column = at * lanes + lane
            here = FirstCrossings(
                crossings.begin[:, column], crossings.end[:, column], crossings.open_at[:, column]
            )
        fell, bad = fell[:, at, lane] & ended, bad[at, lane] & ended
        self._place(end, leg, step, fell & ~bad, bad, here)
        if doubtful is not None:
            # Sub-steps are propagated beyond the end of a flight; values there do not count.
            flew = np.arange(steps + 1)[:, None] <= np.where(ended, at, steps)
            least = np.where(flew, values, np.inf).min(axis=1)
            least = np.where(ended, np.minimum(least, self.values(leg, end.t, end.y)), least)
            end = replace(end, doubtful=self._doubtful(least, flying))
        return end

    def _certain(
        self, g0: Array, g1: Array, y: Array, index: Integers, h: Array
    ) -> NDArray[np.bool_]:
        """Return the rows that the ends of a sub-step decide, bool (E, steps, B)."""
        shape = g0.shape
        rows = self._proof.bounded_rows
        if not rows.any():
            return np.ones(shape, dtype=bool)
        flat = (len(g0), -1)
        length = np.broadcast_to(np.abs(h), shape[1:]).reshape(-1)
        with np.errstate(invalid="ignore", over="ignore"):
            ends = y[:, :-1].reshape(len(y), -1), y[:, 1:].reshape(len(y), -1)
            slopes = self._proof.slopes(index.reshape(-1), *ends, length)
            clear, single = decide(g0.reshape(flat), g1.reshape(flat), length, slopes, -1)
        certain = (clear | single).reshape(shape)
        certain[~rows] = True
        if self._proof.monotone:
            certain[-1] = True
        return certain

    def _searched(
        self,
        flown: _Flown,
        columns: Integers,
        certain: NDArray[np.bool_],
        index: Integers,
        together: int = _TOGETHER,
    ) -> FirstCrossings:
        """Search sub-steps for the first crossing of rows that their ends do not decide.

        Sub-steps are numbered with lanes varying fastest. They are searched in the order of time,
        up to the first that ends its lane.
        """
        leg, y, values = flown.leg, flown.y, flown.values
        rows, lanes = len(values), y.shape[2]
        steps = y.shape[1] - 1
        begun = (leg.t + np.arange(steps)[:, None] * flown.h).reshape(-1)
        length = np.broadcast_to(flown.h, (steps, lanes)).reshape(-1)
        total = steps * lanes
        crossings = FirstCrossings(
            np.full((rows, total), np.nan),
            np.full((rows, total), np.nan),
            np.full((rows, total), np.inf),
        )
        over = np.zeros(lanes, dtype=bool)

        def halve(column: Integers, tau: Array) -> tuple[Array, Array]:
            part, out = leg.taken(column % lanes), np.empty((len(y), len(column)))
            start = np.ascontiguousarray(y[:, column // lanes, column % lanes])
            self._stepper.bind(tau, part.p)(start, out, begun[column])
            return out, self.values(part, begun[column] + tau, out)

        def bounds(pieces: Pieces) -> Slopes:
            return self._proof.of_pieces(leg, pieces, begun, length, index.reshape(-1))

        for first in range(0, len(columns), together):
            now = columns[first : first + together]
            now = now[~over[now % lanes]]
            if not len(now):
                continue
            j, lane = now // lanes, now % lanes
            pieces = Pieces(
                now, np.zeros(len(now)), length[now], y[:, j, lane], y[:, j + 1, lane],
                values[:, j, lane], values[:, j + 1, lane],
            )  # fmt: skip
            part = search(pieces, total, bounds, halve, -1, ~certain[:, j, lane])
            for mine, its in (
                (crossings.begin, part.begin), (crossings.end, part.end),
                (crossings.open_at, part.open_at),
            ):  # fmt: skip
                mine[:, now] = its[:, now]
            hit = (np.isfinite(part.begin[:, now]) | np.isfinite(part.open_at[:, now])).any(axis=0)
            over[lane[hit]] = True
        return crossings

    def _place(
        self,
        end: End,
        leg: Leg,
        step: _Step,
        fell: NDArray[np.bool_],
        bad: NDArray[np.bool_],
        searched: FirstCrossings | None,
    ) -> None:
        """Write into `end` the time, state and cause of lanes that ended, each in its sub-step."""
        cause = end.cause
        assert cause is not None
        partial = np.empty_like(step.y)
        width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(step.h), np.abs(step.t))
        first, row_of = np.full(len(step.t), np.inf), np.full(len(step.t), -1)
        inner = np.zeros(fell.shape, dtype=bool)
        if searched is not None:
            inner = np.isfinite(searched.begin)
        for row in np.flatnonzero((fell | inner).any(axis=1)).tolist():

            def after(tau: Array, row: int = row) -> Array:
                self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
                value: Array = self.values(leg, step.t + tau, partial)[row]
                return value

            earlier, values = step.earlier[row], step.values[row]
            across = (fell[row] | inner[row]) & (earlier > 0) & (values <= 0)
            zero = np.zeros(len(step.t))
            tau = bracketed_roots(
                after, zero, np.where(across, step.h, 0.0), earlier, values, width
            )
            if searched is not None and inner[row].any():
                begin, until = searched.begin[row], searched.end[row]
                # Of several crossings in the sub-step the root is perhaps not the first.
                other = inner[row] & ~(across & (begin <= tau) & (tau <= until))
                if other.any():
                    tau = np.where(
                        other, _first_root(after, begin, until, other, step.h, width), tau
                    )
            hit = fell[row] | inner[row]
            sooner = hit & (tau < first)
            first[sooner], row_of[sooner] = tau[sooner], row
        hit = row_of >= 0
        if searched is not None:
            row = np.argmin(searched.open_at, axis=0)
            opens = searched.open_at[row, np.arange(len(row))]
            undecided = np.isfinite(opens) & (opens <= first)
            first[undecided] = opens[undecided]
            row_of[undecided] = self.diverged + 1 + row[undecided]
            hit |= undecided
        tau = np.where(hit, first, 0.0)
        self._stepper.bind(tau, leg.p)(step.y, partial, step.t)
        # A lane that turned non-finite is left at its last finite state.
        end.y[:, hit], end.y[:, bad] = partial[:, hit], step.y[:, bad]
        end.t[hit | bad] = (step.t + tau)[hit | bad]
        cause[hit], cause[bad] = row_of[hit], self.diverged


def _broken(y: Array, values: Array) -> NDArray[np.bool_]:
    """Return where states (rows, …) are not finite or values (E, …) are NaN."""
    return np.asarray(~np.isfinite(y).all(axis=0) | np.isnan(values).any(axis=0))


def _earlier(ends: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return for each sub-step (steps, B) whether its lane ended in an earlier one."""
    before: NDArray[np.bool_] = np.logical_or.accumulate(ends, axis=0)
    return np.concatenate([np.zeros_like(before[:1]), before[:-1]])


def _first_root(
    function: Callable[[Array], Array],
    begin: Array,
    end: Array,
    wanted: NDArray[np.bool_],
    h: Array,
    width: Array,
) -> Array:
    """Return the roots in brackets with one root each, independent of how these were found.

    Each bracket is first bisected to the smallest size of a piece, a dyadic interval of the
    sub-step, so that the result does not depend on the bounds that led to the bracket.
    """
    near, far = np.where(wanted, begin, 0.0), np.where(wanted, end, 0.0)
    while (wide := wanted & (far - near > 1.5 * np.abs(h) * 0.5**DEPTH)).any():
        middle = np.where(wide, 0.5 * (near + far), near)
        above = function(middle) > 0
        near = np.where(wide & above, middle, near)
        far = np.where(wide & ~above, middle, far)
    return bracketed_roots(function, near, far, function(near), function(far), width)


@dataclass(frozen=True, eq=False)
class _Flown:
    """A propagated leg: states (rows, steps + 1, B), values (E, steps + 1, B), step errors."""

    leg: Leg
    h: Array
    y: Array
    values: Array
    errors: Array

    def time(self, j: int) -> Array:
        """Return the time (B,) at the end of the first j sub-steps."""
        return np.asarray(self.leg.t + j * self.h)

    def error(self, last: Integers | None) -> Array:
        """Return the sum of the errors (B,), up to a lane's last sub-step if given."""
        if last is None:
            return np.asarray(self.errors.sum(axis=0))
        counted = np.arange(len(self.errors))[:, None] <= last
        return np.asarray(np.where(counted, self.errors, 0.0).sum(axis=0))


@dataclass(frozen=True)
class _Step:
    """A sub-step of length h (B,) from t and y, with the rows of the watch before and after."""

    t: Array
    y: Array
    h: Array
    earlier: Array
    values: Array
