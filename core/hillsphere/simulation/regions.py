"""Regions: boxes of states, parameters and times in which bounds have been computed once.

Bounds in interval arithmetic cost as much as some hundred sub-steps of a block. They need not be
sharp: what they exclude for a box much larger than a leg they exclude for every leg inside it, of
all lanes and of later blocks. Regions are therefore kept, and a new one is made only for what no
region holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers

__all__ = ["Boxes", "Columns", "Regions", "Store"]

_FACTORS = (64.0, 16.0, 4.0, 1.0, 0.25)
"""Half widths of trial regions about one column, in units of its own extent. The first serves some
sixty legs of a steady flight; the last hardly more than the column itself."""
_GROWTH = 0.5
"""Part of its width by which a region that was left is enlarged on either side: what flights that
spread leave is found again after few regions."""
_AHEAD = (8.0, 2.0, 1.25, 0.0)
"""Room of the trials about several columns, in units of what their rates cover in the duration of
one: with more than one a leg need be looked at by its ends alone. The first also holds the last
region."""
_LOOSE = 4.0
"""How much looser than those of the smallest trial the bounds of a larger region may be where they
decide nothing by themselves: two more halvings of a piece at a close approach."""
_ROUNDS = 3
"""Enlargements of a trial region that the sub-steps may leave."""
_FAILURES = 4
"""Columns without a region after which the others of a leg are not tried: they are alike."""
_MOST = 256
"""Regions kept; the oldest half goes when there are more. A column is compared with all of them."""

Flags = NDArray[np.bool_]
Tube = Callable[[float], tuple[slice, Array]]
"""Length of a step → rows of a linear law, and how far they go per unit of their largest rate."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes of states (rows, R), parameters (k, R) and times (R,)."""

    lo: Array
    hi: Array
    p_lo: Array
    p_hi: Array
    t_lo: Array
    t_hi: Array

    def taken(self, which: Integers | Flags) -> Boxes:
        """Return some of them."""
        return Boxes(*(getattr(self, f.name)[..., which] for f in fields(self)))


@dataclass(frozen=True, eq=False)
class Regions:
    """Boxes, and the bounds in them.

    Parameters
    ----------
    boxes : Boxes
        R boxes.
    low, high : ndarray, shape (rows, R)
        Of the rates of the states.
    slopes : ndarray, shape (4, E, R)
        See `hillsphere.dynamics.proof.Slopes`.
    bends : ndarray, shape (rows, R)
        Upper bounds of the sizes of the second derivatives of the states.
    """

    boxes: Boxes
    low: Array
    high: Array
    slopes: Array
    bends: Array

    def __len__(self) -> int:
        return len(self.boxes.t_lo)

    def taken(self, which: Integers | Flags) -> Regions:
        """Return some of them."""
        return Regions(
            self.boxes.taken(which),
            self.low[:, which],
            self.high[:, which],
            self.slopes[..., which],
            self.bends[:, which],
        )

    def inner(self, h: float, tube: Tube | None) -> Boxes:
        """Return the boxes in which a step of length `h` must begin to stay in the region.

        By variation of constants for the states of a linear law, see
        `hillsphere.dynamics.enclosures`.
        """
        h *= 1.0 + 1e-6  # steps of one length differ by rounding
        down, up = np.minimum(h * self.low, 0.0), np.maximum(h * self.high, 0.0)
        if tube is not None:
            rows, growth = tube(h)
            fastest = np.maximum(np.abs(self.low[rows]), np.abs(self.high[rows]))
            up[rows] = growth @ fastest
            down[rows] = -up[rows]
        box = self.boxes
        # Rounding of these sums is far below the region's own margin of 1e-9.
        return Boxes(box.lo - down, box.hi - up, box.p_lo, box.p_hi, box.t_lo, box.t_hi)

    def need(self, h: float) -> Array:
        """Return what an event's values at both ends of a sub-step must exceed for no zero inside.

        Parameters
        ----------
        h : float
            Length of the sub-step.

        Returns
        -------
        ndarray, shape (E, R)
            `fall`, or the largest bend downward times h²/8.
        """
        bend = np.maximum(self.slopes[3], 0.0) * (0.125 * h * h)
        return np.asarray(np.fmin(self.fall(h), bend))

    def fall(self, h: float) -> Array:
        """Return half of how far an event may fall in a time h, by its slope alone: (E, R)."""
        steepest = np.maximum(np.abs(self.slopes[0]), np.abs(self.slopes[1]))
        return np.asarray(0.5 * h * steepest)


@dataclass(frozen=True, eq=False)
class Columns:
    """Parts of legs for which regions are looked for.

    Parameters
    ----------
    boxes : Boxes
        Extent of the ends of the sub-steps of each of K columns.
    h, duration : ndarray, shape (K,)
        Longest sub-step; duration of all.
    least : ndarray, shape (E, K)
        Least values of the events at the ends of the sub-steps.
    """

    boxes: Boxes
    h: Array
    duration: Array
    least: Array


class Store:
    """Regions that were computed, the newest last.

    Parameters
    ----------
    computed : callable
        Boxes → regions; enlarges no box of states.
    rows : ndarray of int
        Events with bounds, by which a region is judged.
    tube : callable or None
        Of the states of a linear law.
    """

    def __init__(
        self, computed: Callable[[Boxes], Regions], rows: Integers, tube: Tube | None
    ) -> None:
        self._computed, self._rows, self._tube = computed, rows, tube
        self.kept: Regions | None = None
        self._moved: Array | None = None
        self._seen: Array | None = None

    def indices(self, columns: Columns) -> Integers:
        """Return the region of each column (K,), −1 where none could be made; make what lacks."""
        count, failures = len(columns.h), 0
        index = np.full(count, -1)
        missing = np.ones(count, dtype=bool)
        if self.kept is not None:
            index = self._found(self.kept, columns)
            missing = index < 0
        while missing.any():
            seed = int(np.argmax(missing))
            made = self._made(columns, missing, seed)
            if made is None:
                # Nothing holds this column: it is left to whoever asked.
                missing[seed] = False
                failures += 1
                if failures == _FAILURES:
                    break
                continue
            self._keep(made, index)
            assert self.kept is not None
            last = len(self.kept) - 1
            holds = missing & _held(self._inner(made, columns), 0, columns)
            index[holds] = last
            missing &= ~holds
        return index

    def _keep(self, made: Regions, index: Integers) -> None:
        kept = self.kept
        if kept is None:
            self.kept = made
            return
        if len(kept) >= _MOST:
            # What the columns at hand use stays.
            used = np.zeros(len(kept), dtype=bool)
            used[index[index >= 0]] = True
            used[len(kept) // 2 :] = True
            place = np.cumsum(used) - 1
            index[index >= 0] = place[index[index >= 0]]
            kept = kept.taken(used)
        self.kept = Regions(
            _joined(kept.boxes, made.boxes),
            np.concatenate([kept.low, made.low], axis=-1),
            np.concatenate([kept.high, made.high], axis=-1),
            np.concatenate([kept.slopes, made.slopes], axis=-1),
            np.concatenate([kept.bends, made.bends], axis=-1),
        )

    def _inner(self, regions: Regions, columns: Columns) -> Boxes:
        return regions.inner(float(columns.h.max()), self._tube)

    def _made(self, columns: Columns, missing: Flags, seed: int) -> Regions | None:
        """Return the largest region of several trials whose bounds still serve the seed."""
        trials = self._trials(columns, missing, seed)
        h, duration = float(columns.h[missing].max()), float(columns.duration[missing].max())
        one = columns.boxes.taken(np.array([seed]))
        room = np.array([*_AHEAD, *[0.0] * len(_FACTORS)]) * duration
        for turn in range(_ROUNDS):
            found = self._computed(trials)
            inner = found.inner(h, self._tube)
            down, up = trials.lo - inner.lo, inner.hi - trials.hi
            out = (one.lo < inner.lo) | (one.hi > inner.hi)
            fastest = np.maximum(np.abs(found.low), np.abs(found.high))
            more = np.where(np.isfinite(fastest), fastest, 0.0) * room * (turn == 0)
            if turn and not out.any():
                break
            with np.errstate(invalid="ignore"):
                lo = np.where(out, np.fmin(trials.lo, one.lo + 2.0 * down), trials.lo) - more
                hi = np.where(out, np.fmax(trials.hi, one.hi - 2.0 * up), trials.hi) + more
            trials = Boxes(lo, hi, trials.p_lo, trials.p_hi, trials.t_lo, trials.t_hi)
        need = found.need(h)[self._rows]
        least = columns.least[self._rows]
        reference, best = None, None
        for trial in range(len(found) - 1, -1, -1):
            holds = missing & _held(inner, trial, columns)
            now = need[:, trial]
            if not (holds[seed] and np.isfinite(now).all()):
                continue
            enough = 0.9 * least[:, holds].min(axis=1)
            if trial == len(found) - 1:
                reference = now
            if reference is not None:
                reference = np.fmin(reference, now)
                enough = np.maximum(enough, _LOOSE * reference)
            if (now <= enough).all():
                best = trial
        return None if best is None else found.taken(np.array([best]))

    def _found(self, regions: Regions, columns: Columns) -> Integers:
        """Return the newest region that holds each column, −1 if none does.

        Before it comes one that decides the column: the events' least values exceed its need.
        """
        count = len(columns.h)
        index = np.full(count, -1)
        decided = np.zeros(count, dtype=bool)
        need = regions.need(float(columns.h.max()))[self._rows]
        least, inner = columns.least[self._rows], self._inner(regions, columns)
        for which in range(len(regions) - 1, -1, -1):
            if decided.all():
                break
            holds = ~decided & _held(inner, which, columns)
            if not holds.any():
                continue
            far = (least > need[:, which, None]).all(axis=0)
            index[holds & ((index < 0) | far)] = which
            decided |= holds & far
        return index

    def _trials(self, columns: Columns, missing: Flags, seed: int) -> Boxes:
        """Return boxes to try, the largest first."""
        flock = columns.boxes.taken(missing)
        room = self._room(flock)
        hull = (
            flock.lo.min(axis=1), flock.hi.max(axis=1),
            flock.p_lo.min(axis=1) - room, flock.p_hi.max(axis=1) + room,
        )  # fmt: skip
        wide, last = _grown(*hull, _GROWTH), self.kept
        union = wide
        if last is not None:
            box = last.boxes
            union = _grown(
                np.minimum(hull[0], box.lo[:, -1]), np.maximum(hull[1], box.hi[:, -1]),
                np.minimum(hull[2], box.p_lo[:, -1]), np.maximum(hull[3], box.p_hi[:, -1]),
                0.25 * _GROWTH,
            )  # fmt: skip
        tight = _grown(*hull, 0.25 * _GROWTH)
        kinds = [union, wide, tight, tight]
        box = columns.boxes
        lo, hi = box.lo[:, seed], box.hi[:, seed]
        p = box.p_lo[:, seed] - room, box.p_hi[:, seed] + room
        for factor in _FACTORS:
            spread = factor * (hi - lo)
            kinds.append(_grown(lo - spread, hi + spread, *p, 0.0))
        arrays = [np.stack(part, axis=1) for part in zip(*kinds, strict=True)]
        times = [np.full(len(kinds), t) for t in (flock.t_lo.min(), flock.t_hi.max())]
        # Of the boxes about one column the time is its own.
        alone = slice(len(kinds) - len(_FACTORS), None)
        times[0][alone], times[1][alone] = box.t_lo[seed], box.t_hi[seed]
        return Boxes(arrays[0], arrays[1], arrays[2], arrays[3], times[0], times[1])

    def _room(self, flock: Boxes) -> Array:
        """Return by how much parameters may change: as much as they did from region to region."""
        middle = 0.5 * (flock.p_lo + flock.p_hi).mean(axis=1)
        if self._seen is None or self._seen.shape != middle.shape or self._moved is None:
            self._moved = np.zeros_like(middle)
        else:
            self._moved = np.maximum(self._moved, np.abs(middle - self._seen))
        self._seen = middle
        return np.asarray(self._moved)


def _grown(lo: Array, hi: Array, p_lo: Array, p_hi: Array, part: float) -> tuple[Array, ...]:
    """Return a box enlarged by a part of its width, and by what rounding needs."""
    out: list[Array] = []
    for a, b in ((lo, hi), (p_lo, p_hi)):
        more = part * (b - a)
        more = more + 1e-9 * np.maximum(np.abs(a), np.abs(b)) + 1e-300
        out += [a - more, b + more]
    return tuple(out)


def _joined(first: Boxes, second: Boxes) -> Boxes:
    return Boxes(
        *(
            np.concatenate([getattr(first, f.name), getattr(second, f.name)], axis=-1)
            for f in fields(first)
        )
    )


def _held(inner: Boxes, which: int, columns: Columns) -> Flags:
    """Say which columns one box holds."""
    box = columns.boxes
    lo, hi = inner.lo[:, which, None], inner.hi[:, which, None]
    p_lo, p_hi = inner.p_lo[:, which, None], inner.p_hi[:, which, None]
    holds: Flags = (
        ((box.lo >= lo) & (box.hi <= hi)).all(axis=0)
        & ((box.p_lo >= p_lo) & (box.p_hi <= p_hi)).all(axis=0)
        & (box.t_lo >= inner.t_lo[which])
        & (box.t_hi <= inner.t_hi[which])
    )
    return holds
