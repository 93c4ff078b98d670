"""Largest deviations from the reference and largest commands over flights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.course import Course, Rows
from hillsphere.engine.simulation.block import Follower, Passage, Recorder
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.simulation import BLOCK, Moment
from hillsphere_flight.between import hermite_points, largest_square, slope_points

__all__ = ["SAME_TIME", "Largest", "PlannedEnd"]

SAME_TIME = 1e-9
"""Part of a duration by which two times may differ by rounding alone."""

_SHORT = 1e-3
"""Part of a sub-step below which the velocity is taken to be linear in time; the neglected
curvature is of the order of its square, 1e-6."""

_TOGETHER = 64
"""Ends of sub-steps that are processed in one call. With fewer the overhead of calls exceeds the
arithmetic; with more the arrays no longer fit in the cache of a core."""

Flags = NDArray[np.bool_]
OwnCommand = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class _Followed:
    """Trajectories of a block between two samples.

    Parameters
    ----------
    k : int
        Number of the first.
    t, y, p : ndarray, shape (S + 1, B), (rows, S + 1, B), (k, B)
        Times and states at the ends of sub-steps; parameters.
    full : ndarray, shape (S, B)
        Lengths of the sub-steps, were they not cut short by events.
    flying, whole : ndarray of bool, shape (B,)
        Which lanes flew, and flew to the end.
    """

    k: int
    t: Array
    y: Array
    p: Array
    full: Array
    flying: Flags
    whole: Flags


class PlannedEnd:
    """Deviations at the planned end of flights, where it lies between two samples.

    The deviation of positions is the cubic Hermite polynomial through the deviations of positions
    and velocities at the sample before the planned end and at the one after, or at the end of a
    flight that ended in between. The deviation of velocities is its derivative. The reference is
    continued beyond its end with a constant acceleration, so that the deviation stays smooth.

    Parameters
    ----------
    course : Course
        The reference.
    planned_s : float
        Planned end, s since the start.
    acceleration : ndarray, shape (p,)
        Acceleration of the reference beyond its end, m/s².
    before : int
        Number of the last sample before the planned end.
    period_s : float
        Between samples.
    impulses : bool
        Whether commands are added to velocities at samples.
    total : int
        Number of cases.
    """

    def __init__(
        self,
        course: Course,
        planned_s: float,
        acceleration: Array,
        before: int,
        period_s: float,
        *,
        impulses: bool,
        total: int,
    ) -> None:
        self.before, self._period_s = before, period_s
        self._rest_s = planned_s - before * period_s
        self._rows, self._acceleration, self._impulses = course.rows, acceleration, impulses
        self._goal0, self._goal = course.at(np.array([before * period_s, planned_s])).T
        self._x0, self._x1 = np.zeros((2, len(self._goal), total))
        self._reached = np.zeros(total, dtype=bool)

    def see(self, now: Moment, place: slice, count: int) -> None:
        """Store the states of one block, cases `place`, at the samples around the planned end."""
        if now.k == self.before:
            x = now.x[:, :count].copy()
            if self._impulses and now.done is not None:
                x[self._rows.velocities] += now.done[:, :count]
            self._x0[:, place] = x
        elif now.k == self.before + 1:
            self._x1[:, place] = now.x[:, :count]
            self._reached[place] = now.flying[:count]

    def deviations(self, end: Array, lasted: Array) -> Array:
        """Return the deviations of position, m, and velocity, m/s, at the planned end (2, N).

        Parameters
        ----------
        end : ndarray, shape (n, N)
            States when flights ended.
        lasted : ndarray, shape (N,)
            Durations, s; the result means nothing for a flight that ended before the planned end.
        """
        rows, rest = self._rows, self._rest_s
        left = lasted - self.before * self._period_s
        h = np.where(self._reached, self._period_s, np.maximum(left, rest))
        x0 = self._x0 - self._goal0[:, None]
        x1 = np.where(self._reached, self._x1, end) - self._goal[:, None]
        r0, v0 = x0[rows.positions], x0[rows.velocities]
        beyond, a = h - rest, self._acceleration[:, None]
        v1 = x1[rows.velocities] - a * beyond
        r1 = x1[rows.positions] - (self._goal[rows.velocities, None] + 0.5 * a * beyond) * beyond
        # Cubic Hermite basis at s = (t − t0)/h, and its derivative divided by h.
        s = rest / h
        r = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * r0 + s * (1.0 - s) ** 2 * h * v0
        r += s**2 * (3.0 - 2.0 * s) * r1 - s**2 * (1.0 - s) * h * v1
        v = 6.0 * s * (1.0 - s) * (r1 - r0) / h
        v += (1.0 - s) * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
        gap = np.zeros_like(x0)
        gap[rows.positions], gap[rows.velocities] = r, v
        return np.array([rows.distance(gap), rows.speed(gap)])


class Largest:
    """Largest deviations and commands of flights: an `Observer` that stores no histories.

    Within a sub-step the deviation of positions is the cubic Hermite polynomial through the
    deviations of positions and velocities at both ends, and the deviation of velocities is its
    derivative. A held command is constant until the next sample. A command that changes is
    evaluated at the ends of the sub-steps; its maximum is that of the parabola through the largest
    of these values and its two neighbours.

    Parameters
    ----------
    rows : Rows
        Rows of the plant's positions and velocities.
    goal : ndarray, shape (n, K + 1)
        Reference at each sample and at the end of the last.
    total : int
        Number of cases.
    first, final : int
        Samples from which, and until which, deviations count; commands before the latter.
    commands : int
        Number of rows of a command.
    planned : PlannedEnd or None
        For flights that may go on beyond the planned end, where that is no sample.
    course : Course or None
        The reference; None to take the values at samples only.
    planned_s : float
        Planned end, s since the start; sub-steps that end later do not count.
    begun : ndarray, shape (N,), or None
        Start times of the flights, s.

    Attributes
    ----------
    deviations : ndarray, shape (2, N)
        Largest deviations of position, m, and velocity, m/s, from the reference; of several
        spacecraft the largest.
    command : ndarray, shape (N,)
        Largest size of the command of the law, m/s² or m/s, likewise.
    """

    def __init__(
        self,
        rows: Rows,
        goal: Array,
        total: int,
        first: int,
        final: int,
        commands: int,
        planned: PlannedEnd | None = None,
        course: Course | None = None,
        planned_s: float = np.inf,
        begun: Array | None = None,
    ) -> None:
        self._rows, self._course, self._planned_s, self._begun = rows, course, planned_s, begun
        self.deviations, self.command = np.zeros((2, total)), np.zeros(total)
        self._thrusts = thrust_vectors(commands)
        order = [*rows.positions, *rows.velocities]
        # One row-wise copy per sample; plants whose states are already in this order need none.
        self._order = slice(0, len(order)) if order == list(range(len(order))) else order
        self._goal = np.ascontiguousarray(goal[order].T)[:, :, None]
        self._first, self._final = first, final
        axes = len(rows.positions) // rows.vectors
        self._starts = np.arange(0, len(order), axes)
        self._vectors = rows.vectors
        self._planned = planned
        self._flush: dict[int, Callable[[], None]] = {}

    def at_planned_end(self, end: Array, lasted: Array) -> Array:
        """Return the deviations (2, N) then, zero where it is a sample: see `PlannedEnd`."""
        if self._planned is None:
            return np.zeros((2, len(lasted)))
        return self._planned.deviations(end, lasted)

    def recorder(self, first: int, count: int) -> Recorder:
        """Return the function that records one block at its samples."""
        squares = np.zeros((2 * self._vectors, BLOCK))
        place = slice(first, first + count)
        goal, order, starts, begin = self._goal, self._order, self._starts, self._first
        last, final, planned = len(goal) - 1, self._final, self._planned
        # The command at the last sample before the planned end acts until the planned end.
        until = final - (planned is None)

        most = np.zeros(BLOCK)

        def record(now: Moment) -> None:
            if begin <= now.k <= final:
                gap = now.x[order] - goal[now.k]
                gap *= gap
                np.maximum(squares, np.add.reduceat(gap, starts), out=squares, where=now.flying)
            if planned is not None:
                planned.see(now, place, count)
            if now.own is not None and now.k <= until:
                size = np.add.reduce((now.own * now.own).reshape(self._thrusts, -1, BLOCK), axis=1)
                np.maximum(most, np.maximum.reduce(size, axis=0), out=most, where=now.flying)
            if now.k == last:
                if first in self._flush:
                    self._flush.pop(first)()
                each = squares.reshape(2, self._vectors, BLOCK).max(axis=1)
                # The sub-steps may have had larger deviations than the samples.
                self.deviations[:, place] = np.maximum(
                    self.deviations[:, place], np.sqrt(each)[:, :count]
                )
                self.command[place] = np.maximum(self.command[place], np.sqrt(most)[:count])

        return record

    def follower(self, first: int, count: int) -> Follower | None:
        """Return the function that records one block at its sub-steps; None without a course."""
        if self._course is None or self._begun is None:
            return None
        place = slice(first, first + count)
        begun = self._begun[np.minimum(np.arange(first, first + BLOCK), len(self._begun) - 1)]
        waiting: list[_Followed] = []
        own: OwnCommand | None = None

        def flush() -> None:
            if waiting:
                self._take_up(waiting, begun, own, place)
                waiting.clear()

        def follow(passage: Passage) -> None:
            nonlocal own
            t, y = _to_the_ends(passage)
            # Passages that are processed together have the same number of sub-steps.
            if waiting and waiting[0].t.shape != t.shape:
                flush()
            own, full = passage.act.own_along, np.diff(passage.t, axis=0)
            whole = passage.end_t >= passage.t[-1]
            p = passage.act.p.copy()
            waiting.append(_Followed(passage.k, t, y, p, full, passage.flying, whole))
            if len(waiting) * len(t) >= _TOGETHER:
                flush()

        self._flush[first] = flush
        return follow

    def _take_up(
        self,
        waiting: Sequence[_Followed],
        begun: Array,
        own: OwnCommand | None,
        place: slice,
    ) -> None:
        """Take up the largest deviations and commands of passages of one block."""
        assert self._course is not None
        until = self._final - (self._planned is None)
        commanded = [one for one in waiting if one.k <= until]
        if own is not None and commanded:
            self._follow_command(commanded, own, place)
        counted = [one for one in waiting if one.k >= self._first]
        if not counted:
            return
        after = np.concatenate([one.t for one in counted]) - begun
        x = np.concatenate([one.y[: len(self._rows.names)] for one in counted], axis=1)
        if (after == after[:, :1]).all():
            goal = self._course.at(after[:, 0])[:, :, None]
        else:
            goal = self._course.at(after.ravel()).reshape(x.shape)
        # All but the last of each passage begin a sub-step.
        nodes = len(counted[0].t)
        begins = np.flatnonzero(np.arange(len(after)) % nodes != nodes - 1)
        flying = np.repeat([one.flying for one in counted], nodes - 1, axis=0)
        full = np.concatenate([one.full for one in counted])
        counts = (after[begins + 1] <= self._planned_s * (1.0 + SAME_TIME)) & flying
        gap = x - goal
        self._follow_deviations(
            gap[:, begins], gap[:, begins + 1], after[begins + 1] - after[begins], full, counts,
            place,
        )  # fmt: skip

    def _follow_deviations(
        self, gap0: Array, gap1: Array, h: Array, full: Array, counts: Flags, place: slice
    ) -> None:
        """Take up the largest deviations between gaps (n, S, B) at both ends of sub-steps.

        They last h (S, B), and full (S, B) where no event cut them short.
        """
        width = place.stop - place.start
        rows = self._rows
        r0, v0, r1, v1 = (
            gap[which] for gap in (gap0, gap1) for which in (rows.positions, rows.velocities)
        )
        points = hermite_points(r0, v0, r1, v1, h)
        # A sub-step that an event cut short after a thousandth bends no slope, but the difference
        # of positions over it, which is divided by its length, is rounding.
        bends = np.where(h > _SHORT * full, h, 0.0)
        slopes = slope_points(points, v0, v1, np.broadcast_to(bends, r1.shape))
        axes = len(rows.positions) // self._vectors
        for row, control in enumerate((points, slopes)):
            least = self.deviations[row, place] ** 2
            for vector in range(self._vectors):
                own = control[:, vector * axes : (vector + 1) * axes]
                bound = np.einsum("kasb,kasb->ksb", own, own).max(axis=0)
                step, lane = np.nonzero((bound > _pad_block(least)) & counts)
                kept = lane < width
                step, lane = step[kept], lane[kept]
                if lane.size:
                    least = largest_square(own[:, :, step, lane], lane, least)
            self.deviations[row, place] = np.sqrt(least)

    def _follow_command(self, waiting: Sequence[_Followed], own: OwnCommand, place: slice) -> None:
        """Take up the largest command of a law that changes it between samples."""
        nodes = len(waiting[0].t)
        t = np.array([one.t for one in waiting])
        y = np.stack([one.y for one in waiting], axis=1).reshape(len(waiting[0].y), -1)
        p = np.stack([one.p for one in waiting], axis=1)[:, :, None]
        p = np.broadcast_to(p, (len(p), *t.shape)).reshape(len(p), -1)
        command = own(t.ravel(), y, p).reshape(self._thrusts, -1, *t.shape)
        size = np.sqrt((command * command).sum(axis=1).max(axis=0))
        top = np.argmax(size, axis=1)[:, None]
        largest = np.take_along_axis(size, top, axis=1)
        if nodes > 2:
            middle = np.clip(top, 1, nodes - 2)
            around = [
                tuple(np.take_along_axis(each, middle + d, axis=1) for each in (t, size))
                for d in (-1, 0, 1)
            ]
            lift = _vertex(*around)
            whole = np.array([one.whole for one in waiting])[:, None] & (top == middle)
            largest = np.where(whole & np.isfinite(lift), largest + lift, largest)
        flying = np.array([one.flying for one in waiting])[:, None]
        seen = np.where(flying & np.isfinite(largest), largest, 0.0).max(axis=(0, 1))
        count = place.stop - place.start
        self.command[place] = np.maximum(self.command[place], seen[:count])


def _vertex(before: Sequence[Array], here: Sequence[Array], after: Sequence[Array]) -> Array:
    """Return by how much the parabola through three points (t, value) rises above the middle one.

    Zero where it bends up, or has its vertex outside.
    """
    (t0, y0), (t1, y1), (t2, y2) = before, here, after
    h0, h1 = t1 - t0, t2 - t1
    left, right = (y1 - y0) / h0, (y2 - y1) / h1
    bend = (right - left) / (h0 + h1)
    slope = (h1 * left + h0 * right) / (h0 + h1)
    at = np.divide(slope, -2.0 * bend, out=np.full_like(y1, np.inf), where=bend < 0.0)
    return np.where((-h0 <= at) & (at <= h1), 0.5 * slope * at, 0.0)


def _to_the_ends(passage: Passage) -> tuple[Array, Array]:
    """Return times (S + 1, B) and states (rows, S + 1, B) at sub-steps, the end standing still."""
    t = passage.t
    beyond = t > passage.end_t
    if not beyond.any():
        return t, passage.y
    return np.where(beyond, passage.end_t, t), np.where(beyond, passage.end_y[:, None], passage.y)


def _pad_block(squares: Array) -> Array:
    """Return squares (B,) of a block that is not full, infinite where it only is filled."""
    return np.pad(squares, (0, BLOCK - len(squares)), constant_values=np.inf)
