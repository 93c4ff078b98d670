"""A mesh of trajectories of a manifold, refined where it may meet planar orbits.

Trajectories make a one-parameter set p; their passages through the plane z = 0, followed from one
trajectory to the next, make curves. A meeting with a planar orbit r = R(θ) is a root of
g = ln r − ln R(θ) along such a curve. Intervals of p are divided where neighbouring passages are
too far apart to be sure of g between them, or where |g| has a minimum that may touch zero, unless
no impulse there can be worth it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.invariant_manifolds.sampling import Leaves
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.pareto import front

__all__ = ["Mesh", "Roots", "partners"]

_FAR = 0.25  # natural units: passages farther apart are not known to be neighbours
_TORN = 1.0  # a sign change between passages farther apart than this is no root
_TOUCH = 1e-3  # a minimum of |g| is followed until passages are this near to one another
_LEAST_P = 1e-9
"""Narrowest interval of p, which goes from 0 to 1, that is divided: manifolds magnify the rounding
of p, so that trajectories closer together are not in order any more."""
_MOST_PARTS = 16
"""Most parts of an interval in one round: it may be far apart in one place only, and a later round
sees where."""
_EDGE_PARTS = 16
"""Parts of an interval in which trajectories begin or cease to hit the body: passages end there, so
that nothing tells how far apart its ends are."""
_EDGE = 1.0  # natural units of time between impacts of neighbours
_ROUNDS = 16
"""Most rounds of division; a strand that is folded without end would be divided for ever."""


@dataclass(frozen=True, eq=False)
class Roots:
    """Intervals of p over which g changes sign, with a bound on the gain of their roots.

    Parameters
    ----------
    low, high : ndarray, shape (R,)
        The intervals.
    node : ndarray of int, shape (R,)
        Sub-step of the orbit at which the first of both trajectories begins.
    clock : ndarray, shape (2, R)
        Times of the passages on the orbit's clock.
    tof, dv : ndarray, shape (R,)
        Time of flight and size of the impulse, interpolated.
    doubt : ndarray, shape (R,)
        By how much the impulses at both ends differ.
    """

    low: Array
    high: Array
    node: NDArray[np.int64]
    clock: Array
    tof: Array
    dv: Array
    doubt: Array

    def select(self, keep: NDArray[np.intp]) -> Roots:
        """Return some of them."""
        return Roots(*(getattr(self, name)[..., keep] for name in self.__annotations__))

    @classmethod
    def join(cls, parts: list[Roots]) -> Roots:
        """Return the roots of several targets as one set."""
        names = cls.__annotations__
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names)
        )


@dataclass(frozen=True, eq=False)
class _Passages:
    """Passages through the plane, E of them in any order."""

    p: Array
    node: NDArray[np.int64]
    clock: Array  # on the orbit's clock
    tof: Array  # since the last moment at distance ε
    rising: NDArray[np.bool_]
    x: Array  # (6, E)
    g: Array  # (T, E): of each target
    away: Array  # (T, 3, E): velocity relative to the target's at the same angle

    def select(self, keep: NDArray[np.intp] | NDArray[np.bool_]) -> _Passages:
        return _Passages(*(getattr(self, name)[..., keep] for name in self.__annotations__))

    def join(self, other: _Passages) -> _Passages:
        names = self.__annotations__
        return _Passages(
            *(np.concatenate([getattr(q, name) for q in (self, other)], axis=-1) for name in names)
        )


def partners(
    lane: NDArray[np.int64], clock: Array, rising: NDArray[np.bool_], x: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Match passages of neighbouring trajectories.

    Parameters
    ----------
    lane : ndarray of int, shape (E,)
        Trajectory of each passage, rising.
    clock : ndarray, shape (E,)
        Time of each, rising along a trajectory.
    rising : ndarray of bool, shape (E,)
        Sense.
    x : ndarray, shape (6, E)
        State.

    Returns
    -------
    after, before : ndarray of int, shape (E,)
        Number of each passage's partner on the next and on the last trajectory: of the same
        sense, the nearest in state of the four that are nearest in time; −1 without.
    """
    after, before = np.full((2, lane.size), -1)
    if not lane.size:
        return after, before
    first = float(np.min(clock))
    width = float(np.max(clock)) - first + 1.0
    for sense in (True, False):
        own = np.flatnonzero(rising == sense)
        if not own.size:
            continue
        # one sorted key by trajectory, then time: a search finds the neighbour's passage nearest in
        # time
        key = lane[own] * width + (clock[own] - first)
        for step, partner in ((1, after), (-1, before)):
            place = np.searchsorted(key, key + step * width)
            other = own[np.clip(place + np.arange(-2, 2)[:, None], 0, own.size - 1)]
            apart = np.sum((x[:, other] - x[:, None, own]) ** 2, axis=0)
            apart[lane[other] != lane[own] + step] = np.inf
            best = np.argmin(apart, axis=0), np.arange(own.size)
            partner[own] = np.where(np.isfinite(apart[best]), other[best], -1)
    return after, before


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Neighbouring points of the curves of passages, and the interval of p between them.

    Of most pairs the points lie on neighbouring trajectories. Where two passages of opposite sense
    merge and vanish, on the way to the next trajectory, they are neighbours of one another.
    """

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    low: Array
    high: Array
    apart: Array
    matched: NDArray[np.bool_]  # each other's nearest on neighbouring trajectories


class Mesh:
    """The mesh and its passages.

    Parameters
    ----------
    fly : callable
        p (N,) → Leaves; the first function that is watched is z.
    h : float
        Sub-step, signed.
    targets : list of PolarOrbit
        Planar orbits to be met.
    limit : float
        Longest time of flight.
    gain : float
        Speed by which an impulse must better all quicker ones to be worth it.
    """

    def __init__(
        self,
        fly: Callable[[Array], Leaves],
        h: float,
        targets: list[PolarOrbit],
        limit: float,
        gain: float,
    ) -> None:
        self._fly, self._h, self._targets = fly, h, targets
        self._limit, self._gain = limit, gain
        self._p = np.zeros(0)
        self._end = np.zeros(0)  # time of flight of an impact or escape; infinite without
        self._sure = [(np.zeros(0), np.zeros(0)) for _ in targets]
        self.unproved = 0
        self._passages = self._collect_passages(fly(self._p))

    @property
    def trajectories(self) -> int:
        """Trajectories of the mesh."""
        return int(self._p.size)

    def refine(self, samples: int) -> None:
        """Fly equally spaced trajectories, then divide intervals until nothing is in doubt."""
        # the end of the domain is its start, one period later: it closes the mesh
        new = np.linspace(0.0, 1.0, samples + 1)
        for _ in range(_ROUNDS):
            if not new.size:
                break
            flown = self._fly(new)
            self._passages = self._passages.join(self._collect_passages(flown))
            p = np.concatenate([self._p, new])
            end = np.abs(flown.ends.time) - np.abs(flown.left)
            end[(flown.ends.ended_by < 0) | (end > self._limit)] = np.inf
            order = np.argsort(p, kind="stable")
            self._p, self._end = p[order], np.concatenate([self._end, end])[order]
            new = self._divisions(new)

    def roots(self, target: int) -> Roots:
        """Return the intervals over which g of a target changes sign."""
        q, lane = self._subset(self._p)
        return self._roots(q, self._pairs(q, lane), target)

    def _collect_passages(self, flown: Leaves) -> _Passages:
        self.unproved += int(np.count_nonzero(~flown.ends.resolved))
        z = flown.ends.zeros
        # a stable manifold is flown backwards: its times count positive here
        sense = np.sign(self._h)
        tof = sense * (z.time - flown.left[z.lane])
        keep = (z.event == 0) & (tof > 0.0)
        z, tof = z.select(keep), tof[keep]
        angle, radius = np.arctan2(z.x[1], z.x[0]), np.log(np.hypot(z.x[0], z.x[1]))
        there = [target.state(angle) for target in self._targets]
        node = flown.node[z.lane]
        return _Passages(
            p=flown.p[z.lane],
            node=node,
            clock=sense * (node * self._h + z.time),
            tof=tof,
            rising=z.rising,
            x=z.x,
            g=np.array([radius - np.log(np.hypot(t[0], t[1])) for t in there]),
            away=np.array([z.x[3:] - t[3:] for t in there]),
        )

    def _subset(self, p: Array) -> tuple[_Passages, NDArray[np.int64]]:
        """Return the passages of some trajectories, by p and time, and their numbers."""
        at = np.minimum(np.searchsorted(p, self._passages.p), p.size - 1)
        q = self._passages.select(np.flatnonzero(p[at] == self._passages.p))
        q = q.select(np.lexsort((q.clock, q.p)))
        return q, np.searchsorted(self._p, q.p)

    def _pairs(self, q: _Passages, lane: NDArray[np.int64]) -> _Pairs:
        """Return neighbouring passages, one of each pair at least within the limit."""
        flown = np.unique(lane)
        after, before = partners(lane, q.clock, q.rising, q.x)
        # each other's nearest: two points of one curve of passages
        mutual = (after >= 0) & (before[after] == np.arange(lane.size))
        # beyond the end of the neighbour's flight, by impact or in time, nothing is missing there
        last = np.full(flown.size, -np.inf)
        np.maximum.at(last, np.searchsorted(flown, lane), q.clock)
        rows = []
        folded = np.zeros(lane.size, dtype=bool)
        for partner, back, step in ((after, before, 1), (before, after, -1)):
            alone = (partner < 0) | (back[partner] != np.arange(lane.size))
            alone &= q.clock <= last[np.searchsorted(flown, lane + step).clip(0, flown.size - 1)]
            alone &= np.isin(lane + step, flown)
            same = (lane[:-1] == lane[1:]) & (q.rising[:-1] != q.rising[1:])
            c = np.flatnonzero(alone[:-1] & alone[1:] & same)
            if step > 0:
                folded[c] = folded[c + 1] = True
            low, high = np.sort([q.p[c], self._p[lane[c] + step]], axis=0)
            rows.append((c, c + 1, low, high, np.zeros(c.size, dtype=bool)))
        following = np.searchsorted(flown, lane + 1).clip(0, max(flown.size - 1, 0))
        missed = (after >= 0) & ~folded & (q.clock <= last[following])
        a = np.flatnonzero(mutual | missed)
        rows.append((a, after[a], q.p[a], q.p[after[a]], mutual[a]))
        a, b, low, high, matched = (np.concatenate(column) for column in zip(*rows, strict=True))
        apart = np.linalg.norm(q.x[:, a] - q.x[:, b], axis=0)
        keep = np.minimum(q.tof[a], q.tof[b]) <= self._limit
        return _Pairs(a[keep], b[keep], low[keep], high[keep], apart[keep], matched[keep])

    def _divisions(self, new: Array) -> Array:
        """Return places that divide the intervals beside new trajectories, where that is needed."""
        # three trajectories show a dip: two neighbours to either side decide
        at = np.searchsorted(self._p, new)
        around = np.unique(np.clip(at + np.arange(-2, 3)[:, None], 0, self._p.size - 1))
        q, lane = self._subset(self._p[around])
        pairs = self._pairs(q, lane)
        low, high, parts = [], [], []
        for k in range(len(self._targets)):
            chosen = self._doubtful(q, pairs, k)
            low.append(pairs.low[chosen])
            high.append(pairs.high[chosen])
            parts.append(np.clip(np.ceil(pairs.apart[chosen] / _FAR), 2, _MOST_PARTS))
        edge = self._edges(at)
        low.append(self._p[edge])
        high.append(self._p[edge + 1])
        parts.append(np.full(edge.size, _EDGE_PARTS))
        begin, end, count = (np.concatenate(rows) for rows in (low, high, parts))
        # several pairs may share an interval of the mesh: the most demanding of them divides it
        order = np.lexsort((-count, begin))
        order = order[(end - begin)[order] > _LEAST_P]
        first = order[np.append(True, np.diff(begin[order]) > 0.0)] if order.size else order
        return np.concatenate(
            [np.empty(0)]
            + [
                np.linspace(x, y, int(n) + 1)[1:-1]
                for x, y, n in zip(begin[first], end[first], count[first], strict=True)
            ]
        )

    def _edges(self, at: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the trajectories whose successors hit the surface at another time, or not at all.

        The curves of passages break off between such neighbours, and may hold roots up to there.
        """
        first = np.unique(np.clip(np.concatenate([at - 1, at]), 0, self._p.size - 2))
        ends = np.array([self._end[first], self._end[first + 1]])
        with np.errstate(invalid="ignore"):  # neither ends
            return np.asarray(first[np.abs(ends[0] - ends[1]) > _EDGE])

    def _doubtful(self, q: _Passages, pairs: _Pairs, k: int) -> NDArray[np.intp]:
        """Return the pairs between which a target may be met at a cost worth resolving."""
        a, b, g = pairs.a, pairs.b, q.g[k]
        changes = g[a] * g[b] <= 0.0
        nearest = np.minimum(np.abs(g[a]), np.abs(g[b]))
        wide = (pairs.apart > _FAR) & (changes | (nearest < pairs.apart))
        # |g| least at a passage between two partners of the same sign: a pair of roots may hide
        next_pair = np.full(g.size, -1)
        next_pair[a[pairs.matched]] = np.flatnonzero(pairs.matched)
        first = np.flatnonzero(pairs.matched & ~changes)
        first = first[next_pair[b[first]] >= 0]
        second = next_pair[b[first]]
        s0, s1, s2 = np.abs(g[a[first]]), np.abs(g[b[first]]), np.abs(g[b[second]])
        with np.errstate(divide="ignore", invalid="ignore"):
            # least value of the parabola through three passages
            bottom = s1 - 0.125 * (s2 - s0) ** 2 / (s0 - 2.0 * s1 + s2)
        dips = ~changes[second] & (s1 <= s0) & (s1 <= s2) & (bottom < 0.5 * s1)
        dips &= pairs.apart[first] + pairs.apart[second] > _TOUCH
        chosen = np.unique(np.concatenate([np.flatnonzero(wide), first[dips], second[dips]]))
        # nothing between two passages is cheaper than the cheaper of them less their difference
        self._learn(self._roots(q, pairs, k), k)
        away = q.away[k]
        size = np.linalg.norm(away, axis=0)
        hope = np.minimum(size[a], size[b]) - np.linalg.norm(away[:, a] - away[:, b], axis=0)
        soonest = np.minimum(q.tof[a], q.tof[b])
        worth = hope[chosen] < self._bar(soonest[chosen], k) - self._gain
        return np.asarray(chosen[worth])

    def _learn(self, known: Roots, k: int) -> None:
        """Keep the Pareto front, time of flight against impulse, of certain meetings."""
        tof = np.concatenate([self._sure[k][0], known.tof])
        dv = np.concatenate([self._sure[k][1], known.dv + known.doubt])
        best = np.flatnonzero(front(dv, tof))
        best = best[np.argsort(tof[best])]
        self._sure[k] = (tof[best], dv[best])

    def _bar(self, tof: Array, k: int) -> Array:
        """Return the least impulse (N,) certainly available within these times (N,)."""
        times, impulses = self._sure[k]
        best = np.append(np.inf, impulses)
        return np.asarray(best[np.searchsorted(times, tof, side="right")])

    def _roots(self, q: _Passages, pairs: _Pairs, k: int) -> Roots:
        g, away = q.g[k], q.away[k]
        hit = pairs.matched & (g[pairs.a] * g[pairs.b] <= 0.0) & (pairs.apart <= _TORN)
        a, b = pairs.a[hit], pairs.b[hit]
        # linear interpolation of the root between both passages
        share = g[a] / np.where(g[a] == g[b], 1.0, g[a] - g[b])
        return Roots(
            low=q.p[a],
            high=q.p[b],
            node=np.minimum(q.node[a], q.node[b]),
            clock=np.array([q.clock[a], q.clock[b]]),
            tof=(1.0 - share) * q.tof[a] + share * q.tof[b],
            dv=np.linalg.norm((1.0 - share) * away[:, a] + share * away[:, b], axis=0),
            doubt=np.linalg.norm(away[:, a] - away[:, b], axis=0),
        )
