"""Regions: boxes of states, parameters and times in which bounds have been computed once.

Bounds in interval arithmetic cost as much as some hundred sub-steps of a block. They need not be
sharp: what they exclude for a box much larger than a leg they exclude for every leg inside it, of
all lanes and of later blocks. Regions are therefore kept, and a new one is made only for what no
region holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers

__all__ = ["Bounds", "Boxes", "Columns", "Regions", "Store"]

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
_INFLATIONS = (1.0, 1.0, *[0.3] * 8)
"""Parts of its width by which the trials of a region for once are widened if they are left. Steps
with h‖∂f/∂y‖ = 0.7, as formulae of eighth order take, are held after some six trials; with 0.3
alone after eight, with 0.1 after twelve."""
_TIGHT = 0.25
"""Part of a region's width that a group's own may be: without it the region is hardly smaller."""
_TIMES = 8
"""Fewest columns a time, on average, for which one region for all of a time is tried."""
_SEEDS = 2
"""Large regions that are tried for the columns of one leg. More would cost more than one for each
column."""
_PAUSE = 64
"""Most legs for which no large region is tried after several that held few columns."""
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
        Bounds of the rates of the states.
    slopes : ndarray, shape (4, E, R)
        See `hillsphere.engine.dynamics.proof.Slopes`.
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
        `hillsphere.engine.dynamics.enclosures`.
        """
        return _inner(self.boxes, self.low, self.high, h, tube)

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
        Extent of the beginnings of the sub-steps of each of K columns.
    chunk : ndarray of int, shape (K,)
        Number, the same for those of one time.
    h, duration : ndarray, shape (K,)
        Longest sub-step; duration of all.
    least : ndarray, shape (E, K)
        Least values of the events at the ends of the sub-steps.
    """

    boxes: Boxes
    chunk: Integers
    h: Array
    duration: Array
    least: Array


class Bounds(Protocol):
    """What computes bounds in boxes."""

    def with_room(self, boxes: Boxes, once: bool = False) -> Boxes:
        """Give boxes room for commands and, unless they serve once, in time."""
        ...

    def rates(self, boxes: Boxes) -> tuple[Array, Array]:
        """Return bounds of the rates of the states (rows, R)."""
        ...

    def regions(self, boxes: Boxes, low: Array, high: Array) -> Regions:
        """Return regions, from boxes and their rates."""
        ...


class Store:
    """Regions that were computed, the newest last.

    Where few large ones would not do, each column gets its own, for once: all at the cost of one.

    Parameters
    ----------
    bounds : Bounds
        What computes them.
    rows : ndarray of int
        Events with bounds, by which a region is judged.
    tube : callable or None
        Tube of the states of a linear law.
    """

    def __init__(self, bounds: Bounds, rows: Integers, tube: Tube | None) -> None:
        self._bounds, self._rows, self._tube = bounds, rows, tube
        self.kept: Regions | None = None
        # How many of those at the end serve once.
        self._single = 0
        self._pause = self._left = 0
        self._moved: Array | None = None
        self._seen: Array | None = None

    def indices(self, columns: Columns, alone: bool = True) -> Integers:
        """Return the region of each column (K,), −1 where none could be made; make what lacks.

        Unless `alone`, columns get none of their own if most of many of a time would need one.
        """
        count = len(columns.h)
        index = np.full(count, -1)
        missing = np.ones(count, dtype=bool)
        if self.kept is not None and self._single:
            left = len(self.kept) - self._single
            self.kept = self.kept.taken(np.arange(left)) if left else None
            self._single = 0
        if self.kept is not None:
            index = self._found(self.kept, columns)
            missing = index < 0
        if missing.any():
            self._make_large(columns, index, missing)
        many = missing.any() and self._make_by_time(columns, index, missing)
        if missing.any() and (alone or not many or 2 * np.count_nonzero(missing) < count):
            which = np.flatnonzero(missing)
            self._make_own(columns, index, which, np.arange(len(which)))
        return index

    def decided(self, index: Integers, columns: Columns) -> Flags:
        """Say which columns (K,) have a region that decides all events of which one can."""
        if self.kept is None:
            return np.zeros(len(index), dtype=bool)
        h = float(columns.h.max())
        need = self.kept.need(h)[self._rows][:, np.maximum(index, 0)]
        return (index >= 0) & self._decides(need, columns.least)

    def _decides(self, need: Array, least: Array) -> Flags:
        # Of what falls below zero no region says that it does not.
        least = least[self._rows]
        return np.asarray(np.all((least > need) | (least <= 0.0), axis=0))

    def _make_by_time(self, columns: Columns, index: Integers, missing: Flags) -> bool:
        """Make one region for all columns of one time; change `index` and `missing`.

        Only if there are many of a time, which it says.
        """
        which = np.flatnonzero(missing)
        times, group = np.unique(columns.chunk[which], return_inverse=True)
        many = 1 < len(times) <= len(which) // _TIMES
        if many:
            alike = self._make_own(columns, index, which, group)
            missing[which] = (index[which] < 0) & ~alike
        return many

    def _make_large(self, columns: Columns, index: Integers, missing: Flags) -> None:
        """Make large regions for columns that have none; change `index` and `missing`."""
        if self._left:
            self._left -= 1
            return
        wanted, asked = int(np.count_nonzero(missing)), missing.copy()
        for _ in range(_SEEDS):
            if not asked.any():
                break
            seed = int(np.argmax(asked))
            made = self._made(columns, missing, seed)
            if made is None:
                # Nothing large holds this column.
                asked[seed] = False
                continue
            self._keep(made, index)
            assert self.kept is not None
            last = len(self.kept) - 1
            holds = missing & _columns_in_box(self._inner(made, columns), 0, columns)
            index[holds] = last
            missing &= ~holds
            asked &= ~holds
        useful = np.count_nonzero(missing) <= wanted // 2
        self._pause = 0 if useful else min(2 * self._pause + 1, _PAUSE)
        self._left = self._pause

    def _make_own(
        self, columns: Columns, index: Integers, which: Integers, group: Integers
    ) -> Flags:
        """Make regions for groups of some columns, for once; change `index` where they serve.

        Parameters
        ----------
        columns, index
            Columns, and the numbers of their regions.
        which, group : ndarray of int, shape (N,)
            Some columns; the number of the group of each, all from zero on.

        Returns
        -------
        ndarray of bool, shape (N,)
            Which columns need not be tried alone.
        """
        own = _hulls(columns.boxes.taken(which), group)
        h, count = float(columns.h.max()), len(own.t_lo)
        lo, hi, p_lo, p_hi = _grow(own.lo, own.hi, own.p_lo, own.p_hi, 0.0)
        trials = self._bounds.with_room(Boxes(lo, hi, p_lo, p_hi, own.t_lo, own.t_hi), once=True)
        low, high = np.empty_like(trials.lo), np.empty_like(trials.lo)
        holds = np.zeros(count, dtype=bool)
        waiting = np.arange(count)
        for inflation in _INFLATIONS:
            now, mine = trials.taken(waiting), own.taken(waiting)
            low[:, waiting], high[:, waiting] = self._bounds.rates(now)
            inner = _inner(now, low[:, waiting], high[:, waiting], h, self._tube)
            # What is not a number, 0 · ∞ in a tube, proves nothing.
            inside = ((mine.lo >= inner.lo) & (mine.hi <= inner.hi)).all(axis=0)
            holds[waiting[inside]] = True
            with np.errstate(invalid="ignore"):
                first, last = mine.lo + (now.lo - inner.lo), mine.hi + (now.hi - inner.hi)
                wider = inflation * (last - first)
                lo, hi = np.minimum(now.lo, first - wider), np.maximum(now.hi, last + wider)
            left = ~inside & np.isfinite(hi - lo).all(axis=0)
            waiting = waiting[left]
            if not len(waiting):
                break
            trials.lo[:, waiting], trials.hi[:, waiting] = lo[:, left], hi[:, left]
        # Of these groups regions of single columns would hold, and decide, hardly more.
        width = trials.hi - trials.lo
        alike: Flags = np.all((own.hi - own.lo <= _TIGHT * width) | np.isinf(width), axis=0)
        if not holds.any():
            return alike[group]
        made = self._bounds.regions(trials.taken(holds), low[:, holds], high[:, holds])
        place = np.cumsum(holds) - 1
        serves = holds[group]
        if count < len(which):
            # Other columns are left for regions of their own.
            need = made.need(h)[self._rows]
            at = np.where(serves, place[group], 0)
            finite: Flags = np.all(np.isfinite(need), axis=0)
            decides = self._decides(need[:, at], columns.least[:, which])
            serves &= decides | (alike[group] & finite[at])
        held = 0 if self.kept is None else len(self.kept)
        self._append(made)
        self._single += len(made)
        index[which[serves]] = held + place[group[serves]]
        return alike[group]

    def _keep(self, made: Regions, index: Integers) -> None:
        kept = self.kept
        if kept is not None and len(kept) >= _MOST:
            # What the columns at hand use stays.
            used = np.zeros(len(kept), dtype=bool)
            used[index[index >= 0]] = True
            used[len(kept) // 2 :] = True
            place = np.cumsum(used) - 1
            index[index >= 0] = place[index[index >= 0]]
            self.kept = kept.taken(used)
        self._append(made)

    def _append(self, made: Regions) -> None:
        kept = self.kept
        self.kept = (
            made
            if kept is None
            else Regions(
                _join(kept.boxes, made.boxes),
                np.concatenate([kept.low, made.low], axis=-1),
                np.concatenate([kept.high, made.high], axis=-1),
                np.concatenate([kept.slopes, made.slopes], axis=-1),
                np.concatenate([kept.bends, made.bends], axis=-1),
            )
        )

    def _inner(self, regions: Regions, columns: Columns) -> Boxes:
        return regions.inner(float(columns.h.max()), self._tube)

    def _made(self, columns: Columns, missing: Flags, seed: int) -> Regions | None:
        """Return the largest region of several trials whose bounds still serve the seed."""
        trials = self._trials(columns, missing, seed)
        h, duration = float(columns.h[missing].max()), float(columns.duration[missing].max())
        one = columns.boxes.taken(np.array([seed]))
        room = np.array([*_AHEAD, *[0.0] * len(_FACTORS)]) * duration
        trials = self._bounds.with_room(trials)
        for turn in range(_ROUNDS):
            low, high = self._bounds.rates(trials)
            inner = _inner(trials, low, high, h, self._tube)
            out = (one.lo < inner.lo) | (one.hi > inner.hi)
            if turn == _ROUNDS - 1 or (turn and not out.any()):
                break
            down, up = trials.lo - inner.lo, inner.hi - trials.hi
            fastest = np.maximum(np.abs(low), np.abs(high))
            more = np.where(np.isfinite(fastest), fastest, 0.0) * room * (turn == 0)
            with np.errstate(invalid="ignore"):
                lo = np.where(out, np.fmin(trials.lo, one.lo + 2.0 * down), trials.lo) - more
                hi = np.where(out, np.fmax(trials.hi, one.hi - 2.0 * up), trials.hi) + more
            trials = replace(trials, lo=lo, hi=hi)
        regions = self._bounds.regions(trials, low, high)
        need = regions.need(h)[self._rows]
        least = columns.least[self._rows]
        reference, best = None, None
        for trial in range(len(regions) - 1, -1, -1):
            holds = missing & _columns_in_box(inner, trial, columns)
            now = need[:, trial]
            if not (holds[seed] and np.isfinite(now).all()):
                continue
            enough = 0.9 * least[:, holds].min(axis=1)
            if trial == len(regions) - 1:
                reference = now
            if reference is not None:
                reference = np.fmin(reference, now)
                enough = np.maximum(enough, _LOOSE * reference)
            if (now <= enough).all():
                best = trial
        return None if best is None else regions.taken(np.array([best]))

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
            holds = ~decided & _columns_in_box(inner, which, columns)
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
        wide, last = _grow(*hull, _GROWTH), self.kept
        union = wide
        if last is not None:
            box = last.boxes
            union = _grow(
                np.minimum(hull[0], box.lo[:, -1]), np.maximum(hull[1], box.hi[:, -1]),
                np.minimum(hull[2], box.p_lo[:, -1]), np.maximum(hull[3], box.p_hi[:, -1]),
                0.25 * _GROWTH,
            )  # fmt: skip
        tight = _grow(*hull, 0.25 * _GROWTH)
        kinds = [union, wide, tight, tight]
        box = columns.boxes
        lo, hi = box.lo[:, seed], box.hi[:, seed]
        p = box.p_lo[:, seed] - room, box.p_hi[:, seed] + room
        for factor in _FACTORS:
            spread = factor * (hi - lo)
            kinds.append(_grow(lo - spread, hi + spread, *p, 0.0))
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


def _inner(box: Boxes, low: Array, high: Array, h: float, tube: Tube | None) -> Boxes:
    """Return where a step must begin, see `Regions.inner`."""
    h *= 1.0 + 1e-6  # steps of one length differ by rounding
    down, up = np.minimum(h * low, 0.0), np.maximum(h * high, 0.0)
    if tube is not None:
        rows, growth = tube(h)
        fastest = np.maximum(np.abs(low[rows]), np.abs(high[rows]))
        up[rows] = growth @ fastest
        down[rows] = -up[rows]
    # Rounding of these sums is far below the region's own margin of 1e-9.
    return Boxes(box.lo - down, box.hi - up, box.p_lo, box.p_hi, box.t_lo, box.t_hi)


def _grow(lo: Array, hi: Array, p_lo: Array, p_hi: Array, part: float) -> tuple[Array, ...]:
    """Return a box enlarged by a part of its width, and by what rounding needs."""
    out: list[Array] = []
    for a, b in ((lo, hi), (p_lo, p_hi)):
        more = part * (b - a)
        more = more + 1e-9 * np.maximum(np.abs(a), np.abs(b)) + 1e-300
        out += [a - more, b + more]
    return tuple(out)


def _hulls(boxes: Boxes, group: Integers) -> Boxes:
    """Return the smallest boxes that hold groups, numbered from zero, of some boxes."""
    order = np.argsort(group, kind="stable")
    begins = np.searchsorted(group[order], np.arange(int(group.max()) + 1))
    sides = []
    for f in fields(boxes):
        by = np.minimum if f.name.endswith("lo") else np.maximum
        sides.append(by.reduceat(getattr(boxes, f.name)[..., order], begins, axis=-1))
    return Boxes(*sides)


def _join(first: Boxes, second: Boxes) -> Boxes:
    return Boxes(
        *(
            np.concatenate([getattr(first, f.name), getattr(second, f.name)], axis=-1)
            for f in fields(first)
        )
    )


def _columns_in_box(inner: Boxes, which: int, columns: Columns) -> Flags:
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
