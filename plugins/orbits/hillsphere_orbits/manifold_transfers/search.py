"""Legs between an unstable orbit and planar ones along the orbit's manifolds.

A leg follows a trajectory of the unstable manifold from the neighbourhood of its orbit to a point
of the plane z = 0 that lies on the planar orbit, where an impulse changes the velocity; one along
the stable manifold is the same backwards. A mesh of trajectories brackets them
(`hillsphere_orbits.manifold_transfers.mesh`); here the brackets are polished, in the order of what
they promise: only legs that may be on the front of speed change and time are worth it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.invariant_manifolds.flight import Watch
from hillsphere_orbits.invariant_manifolds.sampling import Leaves, LocalManifold, leaves
from hillsphere_orbits.manifold_transfers.mesh import Mesh, Roots
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.pareto import front

__all__ = ["Legs", "Search", "join_legs", "ladder"]

_MOVES = 4
"""Times that a bracket which lost its root is moved; it lies a few widths away or does not
exist."""
_BEYOND = 2.0  # natural units of time: partners of passages just within the limit are flown to
_GAP = 1e-11  # of g at a polished root


@dataclass(frozen=True, eq=False)
class Legs:
    """Legs of one orbit to one planar orbit.

    Parameters
    ----------
    p : ndarray, shape (L,)
        Place in the fundamental domain.
    side : ndarray of int, shape (L,)
        Side of the manifold.
    tof : ndarray, shape (L,)
        Time from the last moment at distance ε to the meeting.
    dv : ndarray, shape (L,)
        Size of the impulse.
    begin : ndarray, shape (6, L)
        State at that last moment.
    orbit : ndarray, shape (6, L)
        State of the orbit at the same time.
    state : ndarray, shape (6, L)
        State of the trajectory at the meeting.
    target : ndarray, shape (6, L)
        State of the planar orbit there.
    """

    p: Array
    side: NDArray[np.int64]
    tof: Array
    dv: Array
    begin: Array
    orbit: Array
    state: Array
    target: Array

    def select(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Legs:
        """Return some of them."""
        return Legs(*(getattr(self, field.name)[..., keep] for field in fields(self)))

    def mirror(self, mirror: Array) -> Legs:
        """Return the same legs flown backwards in a mirror, given the sign of each state."""
        rows = ("begin", "orbit", "state", "target")
        return replace(self, **{name: mirror[:, None] * getattr(self, name) for name in rows})

    @classmethod
    def none(cls) -> Legs:
        """Return an empty set."""
        row, states = np.zeros(0), np.zeros((6, 0))
        return cls(row, np.zeros(0, dtype=np.int64), row, row, states, states, states, states)


def join_legs(parts: list[Legs]) -> Legs:
    """Return the legs of several searches as one set."""
    return Legs(
        *(np.concatenate([getattr(part, f.name) for part in parts], axis=-1) for f in fields(Legs))
    )


def ladder(legs: Legs, gain: float) -> Legs:
    """Return the Pareto front, quickest first; each leg gains at least `gain` on quicker ones."""
    best = np.flatnonzero(front(legs.dv, legs.tof))
    best = best[np.argsort(legs.tof[best], kind="stable")]
    # strands of a manifold that is folded many times lie so close that they make the same leg
    kept: list[int] = []
    for i in best:
        if not kept or legs.dv[i] < legs.dv[kept[-1]] - gain:
            kept.append(int(i))
    return legs.select(np.array(kept, dtype=np.intp))


class Search:
    """The search on one side of one manifold.

    Parameters
    ----------
    local : LocalManifold
        Orbit and mode; for legs that arrive at the orbit those of its stable manifold.
    watch : Watch
        Its first function is z.
    side : int
        Side of the manifold.
    start, distance : float
        See `hillsphere_orbits.invariant_manifolds.sampling.leaves`.
    limit : float
        Longest time of flight of a leg.
    ends : tuple of str
        Watched functions that end a flight (impact).
    samples : int
        Trajectories of the first mesh.
    gain : float
        Speed by which a leg must better all quicker ones to count.
    """

    def __init__(
        self,
        local: LocalManifold,
        watch: Watch,
        side: int,
        *,
        start: float,
        distance: float,
        limit: float,
        ends: tuple[str, ...],
        samples: int,
        gain: float,
    ) -> None:
        self.local, self.watch, self.side = local, watch, side
        self.start, self.distance, self.limit, self.ends = start, distance, limit, ends
        self.samples, self.gain = samples, gain

    def legs(self, targets: list[PolarOrbit]) -> tuple[list[Legs], NDArray[np.int64]]:
        """Find the Pareto-optimal legs to planar orbits.

        Parameters
        ----------
        targets : list of PolarOrbit
            The planar orbits.

        Returns
        -------
        legs : list of Legs
            Per orbit, by time of flight; none where the manifold does not meet it in time.
        trajectories : ndarray of int, shape (2,)
            How many were flown, and on how many of them it is not proved that no passage or impact
            was missed.
        """
        mesh = Mesh(
            lambda p: leaves(
                self.local, self.watch, p, self.side, start=self.start, distance=self.distance,
                duration=self.limit + _BEYOND, ends=self.ends,
            ),
            self.local.h, targets, self.limit, self.gain,
        )  # fmt: skip
        mesh.refine(self.samples)
        roots = self._polish_candidates([mesh.roots(k) for k in range(len(targets))], targets)
        return [ladder(legs, self.gain) for legs in roots], np.array(
            [mesh.trajectories, mesh.unproved]
        )

    def _polish_candidates(self, roots: list[Roots], targets: list[PolarOrbit]) -> list[Legs]:
        """Polish roots until no other root can be on the fronts."""
        polished = [Legs.none() for _ in targets]
        waiting = [np.ones(r.low.size, dtype=bool) for r in roots]
        while True:
            # those of all targets at once: few flights take as long as one
            chosen = [
                self._promising(r, mask, done)
                for r, mask, done in zip(roots, waiting, polished, strict=True)
            ]
            which = np.repeat(np.arange(len(targets)), [here.size for here in chosen])
            if not which.size:
                return polished
            for mask, here in zip(waiting, chosen, strict=True):
                mask[here] = False
            some = [r.select(here) for r, here in zip(roots, chosen, strict=True)]
            p, node, clock, kept = self._root(Roots.join(some), which, targets)
            if p.size:
                found = self._final(p, node, clock, which[kept], targets)
                polished = [join_legs([*both]) for both in zip(polished, found, strict=True)]

    def _promising(self, roots: Roots, mask: NDArray[np.bool_], done: Legs) -> NDArray[np.intp]:
        """Return the masked roots that may be on the front, given the roots polished so far."""
        dv = np.concatenate([done.dv + self.gain, (roots.dv - roots.doubt)[mask]])
        tof = np.concatenate([done.tof, roots.tof[mask]])
        return np.flatnonzero(mask)[front(dv, tof)[done.dv.size :]]

    def _root(
        self, roots: Roots, which: NDArray[np.intp], targets: list[PolarOrbit]
    ) -> tuple[Array, NDArray[np.int64], Array, NDArray[np.intp]]:
        """Return p, first sub-step, time on the orbit's clock and number of roots."""
        low, high, clock, node = roots.low, roots.high, roots.clock, roots.node
        rate = (clock[1] - clock[0]) / (high - low)

        def gap(p: Array, lanes: NDArray[np.intp]) -> tuple[Array, Array]:
            when = clock[0, lanes] + (p - low[lanes]) * rate[lanes]
            x, when = self._passage(p, node[lanes], when)
            angle, g = np.arctan2(x[1], x[0]), np.log(np.hypot(x[0], x[1]))
            for k, target in enumerate(targets):
                own = which[lanes] == k
                g[own] -= target.log_radius(angle[own])[0]
            return g, when

        every = np.arange(low.size)
        begin, end = low.copy(), high.copy()
        ends = np.array([gap(begin, every)[0], gap(end, every)[0]])
        # neighbours that begin at different sub-steps are displaced a little: where the ends do not
        # hold the root any more, look for it where the slope says, about as widely as it is away
        for _ in range(_MOVES):
            lost = np.flatnonzero(ends[0] * ends[1] > 0.0)
            if not lost.size:
                break
            x, y, f, g = begin[lost], end[lost], ends[0, lost], ends[1, lost]
            # secant through both ends
            guess = np.where(f == g, y, x - f * (y - x) / np.where(f == g, 1.0, g - f))
            reach = np.minimum(np.abs(guess - 0.5 * (x + y)), 10.0 * (y - x))
            guess = np.clip(guess, 0.5 * (x + y) - reach, 0.5 * (x + y) + reach)
            width = np.maximum(y - x, 0.3 * reach)
            begin[lost], end[lost] = guess - width, guess + width
            ends[:, lost] = gap(begin[lost], lost)[0], gap(end[lost], lost)[0]
        held = np.flatnonzero(ends[0] * ends[1] <= 0.0)
        x, y, f, g = begin[held], end[held], ends[0, held], ends[1, held]
        # rounding of the first state moves it along the manifold, which steep strands feel
        # a change of p below this moves the first state by less than rounding
        least = np.finfo(float).eps * np.max(np.abs(self.local.orbit)) / self.start
        least /= np.log(self.local.growth)
        p = bracketed_roots(
            lambda p: _snap_roots_to_zero(gap(p, held)[0]), x, y, f, g,
            np.maximum(np.minimum(0.1, _GAP / np.maximum(_GAP, np.abs(g - f))) * (y - x), least),
        )  # fmt: skip
        return p, node[held], gap(p, held)[1], held

    def _passage(self, p: Array, node: NDArray[np.int64], when: Array) -> tuple[Array, Array]:
        """Return the passages nearest to times on the orbit's clock, and their times."""
        local, flow = self.local, self.local.flow
        sense = np.sign(local.h)
        flight = when - node * abs(local.h)
        steps = max(1, int(np.max(flight, initial=0.0) / abs(local.h)) + 1)
        x = local.state(p, self.side, self.start, node)
        x = flow.plain.propagate(x, sense * flight, steps, strict=False)
        x, late = _to_plane(flow, x, 4.0 * abs(local.h))
        return x, when + sense * late

    def _final(
        self,
        p: Array,
        node: NDArray[np.int64],
        clock: Array,
        which: NDArray[np.intp],
        targets: list[PolarOrbit],
    ) -> list[Legs]:
        """Return the legs at roots, by target, propagated as a whole for their time and impacts.

        Zeros are looked for beside the roots only, and impacts where a leg comes near the body: the
        legs that are chosen are flown anew.
        """
        local = self.local
        flown = leaves(
            local, self.watch, p, self.side, start=self.start, distance=self.distance,
            duration=self.limit, ends=self.ends, node=node, near=clock - node * abs(local.h),
        )  # fmt: skip
        z = flown.ends.zeros
        z = z.select(z.event == 0)
        late = np.abs(np.abs(flown.node[z.lane] * local.h + z.time) - clock[z.lane])
        # the passage of each lane that is nearest to the root's time
        order = np.lexsort((late, z.lane))
        first = order[np.append(True, np.diff(z.lane[order]) > 0)] if order.size else order
        first = first[late[first] <= 1e-6]
        lane = z.lane[first]
        tof = np.abs(z.time[first]) - np.abs(flown.left[lane])
        timely = (tof > 0.0) & (tof <= self.limit)
        first, lane, tof = first[timely], lane[timely], tof[timely]
        return [
            self._legs_to(target, flown, lane[own], tof[own], z.x[:, first[own]])
            for k, target in enumerate(targets)
            for own in (which[lane] == k,)
        ]

    def _legs_to(
        self, target: PolarOrbit, flown: Leaves, lane: NDArray[np.intp], tof: Array, x: Array
    ) -> Legs:
        """Return the legs of some lanes, whose passages have the states x, to a planar orbit."""
        local, flow = self.local, self.local.flow
        if not lane.size:
            return Legs.none()
        there = target.state(np.arctan2(x[1], x[0]))
        left = flown.left[lane]
        steps = max(1, int(np.max(np.abs(left), initial=0.0) / abs(local.h)) + 1)
        begin = flow.plain.propagate(flown.start[:, lane], left, steps)
        clock_left = flown.node[lane] * local.h + left
        j = np.floor(clock_left / local.h).astype(np.int64)
        orbit = flow.plain.step(np.ascontiguousarray(local.on_orbit(j)), clock_left - j * local.h)
        return Legs(
            p=flown.p[lane],
            side=np.full(lane.size, self.side, dtype=np.int64),
            tof=tof,
            dv=np.linalg.norm(x[3:] - there[3:], axis=0),
            begin=begin,
            orbit=orbit,
            state=x,
            target=there,
        )


def _snap_roots_to_zero(g: Array) -> Array:
    """Return g with roots set to zero exactly, so that the bracketing stops at them."""
    return np.where(np.abs(g) <= _GAP, 0.0, g)


def _to_plane(flow: Flow, x: Array, most: float) -> tuple[Array, Array]:
    """Return the states of the nearest passages through z = 0, and their time offsets."""
    late = np.zeros(x.shape[1])
    for _ in range(5):
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.clip(-x[2] / x[5], -most, most)
        change = np.where(np.isfinite(change), change, 0.0)
        x = flow.plain.step(np.ascontiguousarray(x), change, strict=False)
        late += change
        if np.all(np.abs(change) <= 1e-14):
            break
    return x, late
