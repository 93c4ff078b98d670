"""One block of lanes through the loop, from the first sample to the last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, isfinite
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.engine.simulation.acting import Act, ByImpulse, Done, Extra
from hillsphere.engine.simulation.ahead import Ahead, is_repeatable
from hillsphere.engine.simulation.ends import Watch
from hillsphere.engine.simulation.legs import BLOCK, End, Held, Leg, Unproved
from hillsphere.interfaces.loop import Navigation, Reference

__all__ = [
    "BLOCK", "CAUSES", "Follower", "Moment", "Part", "Passage", "Recorder", "Result", "Settings",
    "fly_block",
]  # fmt: skip

_HEARTBEAT = 64
"""Samples between two calls that tell the executor that the block is alive: seconds at most pass
between them, and they cost nothing beside 64 samples of a block."""

_WHOLE = 1e-9
"""Part of a sub-step by which a share of the steps may exceed a whole number by rounding."""


@dataclass(frozen=True)
class Settings:
    """What all blocks share.

    Parameters
    ----------
    watch : Watch
        Equations and what ends a flight.
    n, p : int
        Number of states and of rows of a command.
    navigation, reference
        What the law sees and follows.
    scale : ndarray, shape (rows,)
        Typical size of the states of the system that flies.
    substeps, most_substeps : int
        Steps between two samples, and the most that the tolerance may ask for.
    tolerance : float or None
        Largest difference to twice as many steps, in units of `scale`; None for no check.
    budget : bool
        Whether the Δv at hand is limited.
    wall_limit_s : float or None
        Wall-clock time for a block.
    to_last_sample : bool
        Whether flights end with the last sample instead of one period after it.
    """

    watch: Watch
    n: int
    p: int
    navigation: Navigation
    reference: Reference
    scale: Array
    substeps: int
    most_substeps: int
    tolerance: float | None
    budget: bool
    wall_limit_s: float | None
    to_last_sample: bool


@dataclass(frozen=True)
class Part:
    """The cases of one block.

    Parameters
    ----------
    x0 : ndarray, shape (n, B)
        Start.
    t0, period, budget : ndarray, shape (B,)
        Time at the start, time between samples, Δv at hand (infinite without a limit).
    samples, cases : ndarray of int, shape (B,)
        Number of samples, number of the case.
    seen, done : ndarray, shape (K + 1, noise, B) and (K, noise, B)
        Normal numbers for navigation and actuator.
    count : int
        How many of the first lanes are cases; the others repeat the last of them.
    """

    x0: Array
    t0: Array
    period: Array
    budget: Array
    samples: Integers
    cases: Integers
    seen: Array
    done: Array
    count: int = BLOCK


@dataclass(frozen=True)
class Result:
    """How the flights of a block ended; `cause` is a row of the watch or one of those below."""

    cause: Integers
    t: Array
    x: Array
    dv: Array
    firings: Integers
    samples: Integers
    error: Array


# Below zero: ends that are no event of the plant, whose numbers begin at zero.
COMPLETED, COMMAND, STEP_SIZE, TIME_LIMIT = -1, -2, -3, -4
CAUSES = {
    COMPLETED: ("completed", ""),
    COMMAND: ("diverged", "command not finite"),
    STEP_SIZE: ("step_size", "sub-steps"),
    TIME_LIMIT: ("time_limit", "wall clock"),
}
"""Status and cause beside those of the watch."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Moment:
    """A sample of a block before it acts, or the end of the block.

    Parameters
    ----------
    k : int
        Number of the sample; at the end, of the one that would follow the last.
    t, dv : ndarray, shape (B,)
        Time, and Δv spent until then.
    x : ndarray, shape (n, B)
        True states.
    flying : ndarray of bool, shape (B,)
        Lanes that fly; at the end those that reached their last sample.
    y, ref : ndarray, shape (q, B), or None
        What the law sees and what it should see; None at the end.
    own, done : ndarray, shape (p, B), or None
        What the law commands by itself, without feedforward, and what the actuator then does; at
        the end None.
    """

    k: int
    t: Array
    dv: Array
    x: Array
    flying: Flags
    y: Array | None = None
    ref: Array | None = None
    own: Array | None = None
    done: Array | None = None


@dataclass(frozen=True, eq=False)
class Passage:
    """The sub-steps of a block from one sample to the next.

    Parameters
    ----------
    k : int
        Number of the sample that it follows.
    t : ndarray, shape (S + 1, B)
        Time at its start, and at the end of each of its S sub-steps.
    y : ndarray, shape (rows, S + 1, B)
        States of the system that flies then.
    end_t, end_y : ndarray, shape (B,), (rows, B)
        Where a lane ended in it, its time and state then; else those of its end.
    flying : ndarray of bool, shape (B,)
        Lanes that flew it.
    act : Act
        The law at work.
    """

    k: int
    t: Array
    y: Array
    end_t: Array
    end_y: Array
    flying: Flags
    act: Act


Follower = Callable[[Passage], None]
"""Called after each sample; what it does not copy is overwritten."""

Recorder = Callable[[Moment], None]
"""Called at each sample while a lane of the block flies, and at the end."""


def fly_block(
    s: Settings,
    part: Part,
    act: Act,
    heartbeat: Callable[[int], None],
    record: Recorder | None,
    follow: Follower | None = None,
) -> Result:
    """Fly one block.

    Parameters
    ----------
    s : Settings
        Shared by all blocks.
    part : Part
        Its cases.
    act : Act
        The law at work on it.
    heartbeat : callable
        Called with 0 now and then; raises if the run was asked to stop.
    record : callable or None
        Takes the history.
    follow : callable or None
        Takes the sub-steps.

    Returns
    -------
    Result
        One column per lane.
    """
    block = _Block(s, part, act, follow)
    begun, last, k = perf_counter(), int(part.samples.max(initial=0)), 0
    may_repeat = block.may_repeat and not s.to_last_sample
    ahead = Ahead(s.watch, record, part.count) if may_repeat else None
    while True:
        if ahead is not None and (ahead.full or k == last or block.over):
            k = block.settle(ahead, k)
        if k == last or block.over:
            break
        if k % _HEARTBEAT == 0:
            heartbeat(0)
        if s.wall_limit_s is not None and perf_counter() - begun > s.wall_limit_s:
            block.stop(block.flying, TIME_LIMIT, block.t)
            break
        if ahead is not None:
            k = block.fly_ahead(k, ahead)
            continue
        done = block.sample(k, record)
        if k < last - s.to_last_sample:
            block.leg(k, done)
        k += 1
    result = block.result()
    if record is not None:
        record(Moment(last, result.t, result.dv, result.x, result.cause == COMPLETED))
    return result


class _Block:
    """Where the lanes of a block are."""

    def __init__(self, s: Settings, part: Part, act: Act, follow: Follower | None) -> None:
        self._s, self._part, self._act = s, part, act
        self._follow = follow
        # What was flown since the last sample: each part, and its nodes.
        self._flown: list[tuple[Held, Array]] = []
        width = len(part.t0)
        self.t, self._y = part.t0, act.begin(part.x0)
        self._even = bool((part.samples == part.samples.max(initial=0)).all())
        self._memory = s.navigation.initial(self.t, part.x0, part.seen[0])
        self._command = np.zeros((s.p, width))
        self._dv = np.zeros(width)
        self._error = np.zeros(width)
        self._doubtful = np.full(width, -1)
        self._firings, self._acted = np.zeros((2, width), dtype=np.int64)
        self._cause = np.full(width, COMPLETED)
        legs = np.maximum(part.samples - s.to_last_sample, 0)
        self._end_t = part.t0 + legs * part.period
        self.flying: Flags = np.ones(width, dtype=bool)
        self._whole, self.over = True, False
        begin = Held(self.t, part.period, act.p, None, 1)
        first = s.watch.start(self._leg_of(begin, self._dv))
        for row in np.unique(first[first >= 0]).tolist():
            self.stop(first == row, row, self.t)
        self._alone(self.flying & (part.samples > 0))

    @property
    def may_repeat(self) -> bool:
        """Whether samples can be repeated from the same state, with the same result.

        Only for impulses: between held commands a leg is short, and proved at a glance.
        """
        s = self._s
        return (
            isinstance(self._act, ByImpulse)
            and is_repeatable(s.navigation)
            and s.tolerance is None
            and s.wall_limit_s is None
            and self._follow is None
        )

    def fly_ahead(self, k: int, ahead: Ahead) -> int:
        """Fly on from sample k, perhaps without a proof; return the sample that comes next."""
        before = self._state()
        try:
            done = self.sample(k, ahead.hear)
            ahead.add(k, before, self.leg(k, done, ahead=ahead.tries))
        except Exception:
            # A law may refuse a state that it meets only beyond the end of a flight.
            again = self.settle(ahead, k)
            if again == k:
                raise
            return again
        return k + 1

    def settle(self, ahead: Ahead, k: int) -> int:
        """Prove what is not proved before sample k; return the sample from which to fly on."""
        again = ahead.settle()
        if again is None:
            return k
        k, state = again
        assert isinstance(self._act, ByImpulse)
        self._act.memory = state.pop("_law")
        vars(self).update(state)
        return k

    def _state(self) -> dict[str, Any]:
        """Return a copy of all that samples and legs change."""
        assert isinstance(self._act, ByImpulse)
        kept = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}
        return kept | {"_law": self._act.memory.copy()}

    def stop(self, lanes: Flags, why: int, when: Array) -> None:
        """End the flight of some lanes."""
        self._cause[lanes], self._end_t[lanes] = why, when[lanes]
        self._alone(self.flying & ~lanes)

    def _alone(self, flying: Flags) -> None:
        self.flying = flying
        self._whole, self.over = bool(flying.all()), not flying.any()

    def sample(self, k: int, record: Recorder | None) -> Done:
        """Let the law act, and return what it did."""
        s, part, t, y = self._s, self._part, self.t, self._y
        x = y[: s.n]
        seen, self._memory = s.navigation.observe(
            k, t, x, self._command, part.seen[k + 1], self._memory
        )
        ref = s.reference.at(k, t, seen, part.cases)
        if ref.shape != seen.shape:
            raise InputError(
                f"the reference gives {ref.shape}, the navigation {seen.shape}; they must agree"
            )
        extra = Extra(s.reference.feedforward(k, t, part.cases), part.done[k])
        now = self._act.at(k, t, y, seen, ref, extra)
        self._command = now.command
        if not isfinite(np.add.reduce(now.done, axis=None)):
            self.stop(self.flying & ~np.isfinite(now.done).all(axis=0), COMMAND, t)
        before = self._spent() if record is not None else self._dv
        if now.spent is not None:
            if s.budget:
                beyond = self.flying & (self._dv + now.spent > part.budget)
                self.stop(beyond, s.watch.budget_row, t)
            self._dv = self._dv + np.where(self.flying, now.spent, 0.0)
        if record is not None:
            record(Moment(k, t, before, x, self.flying, seen, ref, now.own, now.done))
        if now.y is not y:
            self._y = now.y if self._whole else np.where(self.flying, now.y, y)
        self._acted += self.flying
        size = now.spent if now.spent is not None else now.rate
        for one in now.later:
            size = None if size is None or one.rate is None else np.maximum(size, one.rate)
        self._firings += self.flying if size is None else self.flying & (size > 0)
        return now

    def leg(self, k: int, now: Done, ahead: bool = False) -> Unproved | None:
        """Fly to the next sample; with `ahead` perhaps without proof, then return what lacks it."""
        part, flying = self._part, self.flying
        held, unproved = self._divide(now), None
        self._flown.clear()
        if not self._fly_at_once(held):
            for one in held:
                if self.over:
                    break
                unproved = self._advance(one, ahead)
        if self._follow is not None and self._flown:
            self._follow(self._passage(k, flying))
        self.t = part.t0 + (k + 1) * part.period
        if not self._even:
            self._alone(self.flying & (k + 1 < part.samples))
        return unproved

    def _divide(self, now: Done) -> list[Held]:
        """Return the parts of the time until the next sample, by what is held in each."""
        period, substeps = self._part.period, self._s.substeps
        if not now.later:
            return [Held(self.t, period, self._act.p, now.rate, substeps)]
        first = now.later[0].begin
        p = self._act.p.copy()
        held = [Held(self.t, first * period, p, now.rate, _share(substeps, first))]
        for one in now.later:
            self._act.hold(one.value)
            share, p = one.end - one.begin, self._act.p.copy()
            begin = self.t + one.begin * period
            held.append(Held(begin, share * period, p, one.rate, _share(substeps, share)))
        return held

    def _fly_at_once(self, held: Sequence[Held]) -> bool:
        """Fly all parts at once, if that is proved to end no flight; say whether it was."""
        if len(held) == 1 or self._s.tolerance is not None:
            return False
        dv = self._dv
        for one in held[:-1]:
            dv = self._after(dv, one, one.end)
        first, last = self._leg_of(held[0], self._dv), self._leg_of(held[-1], dv)
        flown = self._s.watch.fly_at_once(first, held, last)
        if flown is None:
            return False
        self._y, self._dv = flown.y, self._after(dv, held[-1], held[-1].end)
        for error in flown.errors:
            self._error = self._error + np.where(self.flying, error, 0.0)
        self._flown.extend(zip(held, flown.nodes, strict=True))
        return True

    def _advance(self, held: Held, ahead: bool) -> Unproved | None:
        """Fly on, under what is held."""
        self.t, y = held.t, self._y
        end, coarse = _fly(self._s, self._leg_of(held, self._dv), held.steps, ahead)
        if end.nodes is not None:
            self._flown.append((held, end.nodes))
        if coarse is not None and coarse.any():
            self.stop(coarse, STEP_SIZE, self.t)
        self._dv = self._after(self._dv, held, end.t)
        # The watch leaves lanes that do not fly where they were.
        self._y = end.y if coarse is None else np.where(self.flying, end.y, y)
        if end.error is not None:
            self._error = self._error + np.where(self.flying, end.error, 0.0)
        if end.doubtful is not None:
            self._doubtful = np.where(self._doubtful < 0, end.doubtful, self._doubtful)
        if end.cause is not None:
            for row in np.unique(end.cause[end.cause >= 0]).tolist():
                self.stop(self.flying & (end.cause == row), row, end.t)
        return end.unproved

    def _after(self, dv: Array, held: Held, until: Array) -> Array:
        """Return what is spent of Δv after a part was flown until some time (B,)."""
        if held.rate is None:
            return dv
        spent = held.rate * (until - held.t)
        return dv + (spent if self._whole else np.where(self.flying, spent, 0.0))

    def _passage(self, k: int, flying: Flags) -> Passage:
        """Return what was flown since sample k, for whoever follows it."""
        times = [held.times for held, _ in self._flown]
        # Each part begins where the one before it ends.
        t = np.concatenate([times[0], *(one[1:] for one in times[1:])])
        first, *rest = [nodes for _, nodes in self._flown]
        y = np.concatenate([first, *(nodes[:, 1:] for nodes in rest)], axis=1)
        end_t = np.where(self.flying, t[-1], self._end_t)
        return Passage(k, t, y, end_t, self._y, flying, self._act)

    def result(self) -> Result:
        """Return how it ended."""
        doubt = (self._doubtful >= 0) & (self._cause != self._doubtful)
        self._cause[doubt] = self._s.watch.unresolved(self._doubtful[doubt])
        x = self._y[: self._s.n]
        return Result(
            self._cause, self._end_t, x, self._spent(), self._firings, self._acted, self._error
        )

    def _spent(self) -> Array:
        return self._y[-1] if self._act.counts else self._dv

    def _leg_of(self, held: Held, dv: Array) -> Leg:
        """Return a part as a leg, after some Δv was spent."""
        part, left, rate = self._part, None, held.rate
        if self._s.budget:
            left = part.budget if self._act.counts else part.budget - dv
            if rate is None and not self._act.counts:
                rate = np.zeros(len(self.t))
        return Leg(
            held.t, self._y, held.period, held.p, part.cases, self.flying, self._whole, left, rate,
            None if held.period is part.period else part.period,
        )  # fmt: skip


def _share(steps: int, share: float) -> int:
    """Return how many of the steps of a period a part of it takes."""
    return max(1, ceil(share * steps - _WHOLE))


def _fly(s: Settings, leg: Leg, steps: int, ahead: bool) -> tuple[End, Flags | None]:
    """Fly a leg; with a tolerance, lane by lane with as many steps as it asks for.

    Then the lanes follow for which the most steps were not enough.
    """
    end = s.watch.fly(leg, steps, ahead=ahead)
    if s.tolerance is None:
        return end, None
    coarse = leg.flying
    none = np.full(len(leg.t), COMPLETED)
    while 2 * steps <= s.most_substeps and coarse.any():
        steps *= 2
        finer = s.watch.fly(leg, steps)
        before = none if end.cause is None else end.cause
        after = none if finer.cause is None else finer.cause
        difference = np.max(np.abs(finer.y - end.y) / s.scale[:, None], axis=0)
        alike = (difference <= s.tolerance) & (after == before)
        # The finer flight of the first pair that agrees is kept for good.
        end = End(
            np.where(coarse, finer.y, end.y),
            np.where(coarse, finer.t, end.t),
            np.where(coarse, after, before),
            _of_either(end.doubtful, finer.doubtful, coarse),
            None
            if end.error is None or finer.error is None
            else np.where(coarse, finer.error, end.error),
            # At the ends of the first sub-steps, which every finer flight shares.
            None
            if end.nodes is None or finer.nodes is None
            else np.where(
                coarse,
                finer.nodes[:, :: (finer.nodes.shape[1] - 1) // (end.nodes.shape[1] - 1)],
                end.nodes,
            ),
        )
        coarse = coarse & ~alike
    return end, coarse


def _of_either(before: Integers | None, after: Integers | None, coarse: Flags) -> Integers | None:
    """Return the rows in doubt of the flights that are kept, lane by lane: None is −1 for all."""
    if before is None and after is None:
        return None
    rows = [np.full(len(coarse), -1) if each is None else each for each in (before, after)]
    return np.where(coarse, rows[1], rows[0])
