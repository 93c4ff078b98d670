"""Families of orbits in space that branch off planar ones at vertical resonances.

At a vertical bifurcation d:n the planar orbit, run through n times, has a kernel of two directions
out of the plane. Along each of them a family branches off whose orbits keep a mirror under time
reversal (see `hillsphere_orbits.spatial_qso_families.kernel`), so that half a period, n/2
revolutions, is solved between two states which the mirror keeps.

References
----------
.. [1] Robin, I. A., Markellos, V. V., Numerical determination of three-dimensional periodic orbits
   generated from vertical self-resonant satellite orbits, Celestial Mechanics 21, 1980, p. 395.
.. [2] Hénon, M., Vertical stability of periodic orbits in the restricted problem, Astron.
   Astrophys. 28, 1973, p. 415.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch, StepControl
from hillsphere_orbits.lockstep import follow_lanes
from hillsphere_orbits.roots import brackets
from hillsphere_orbits.spatial_qso_families.following import (
    BIRTH,
    FOLLOWED,
    SENSITIVE,
    Following,
    height,
)
from hillsphere_orbits.spatial_qso_families.members import (
    CLOSED,
    RETURNED,
    LostMembersError,
    Members,
    join_members,
    polish,
)
from hillsphere_orbits.spatial_qso_families.prediction import null_vectors, predict_members
from hillsphere_orbits.spatial_qso_families.shooting import SpatialShooting, sub_steps

__all__ = ["ALONE", "Spatial", "first_members"]

_CONTROL = StepControl(first=0.02, largest=0.4, turn=0.35, members=600)
_EXACT = 3e-11  # and of the members returned
_GRID = 5  # places along a family at which sub-steps are chosen

ALONE = "no second orbit was found"


def first_members(
    problem: SpatialShooting, x: Array, period: Array, n: Array
) -> tuple[SpatialShooting, Array, NDArray[np.bool_]]:
    """Return the problem with sub-steps and a first member of each family.

    Parameters
    ----------
    problem : SpatialShooting
        Of M lanes.
    x : ndarray, shape (6, M)
        Planar orbits at the bifurcations, normalised, where the families start.
    period : ndarray, shape (M,)
        Their periods, of one revolution.
    n : ndarray, shape (M,)
        Revolutions of the families' orbits.

    Returns
    -------
    problem : SpatialShooting
        With sub-steps good for these members while following.
    z : ndarray, shape (4, M)
        Members with z (or ż) = 0.01, held while correcting.
    exists : ndarray of bool, shape (M,)
        Whether there is one.
    """
    z = problem.unknowns_at(x, period * n)
    z[problem.kernel] = BIRTH
    counts, _ = sub_steps(problem.with_counts(12 * n.astype(np.int64)), z, FOLLOWED)
    problem = problem.with_counts(counts)
    normals = np.zeros_like(z)
    normals[problem.kernel] = 1.0
    members = polish(problem, z, normals, z)
    return problem, members.z, np.asarray(members.error <= CLOSED)


@dataclass(frozen=True)
class Spatial:
    """Computed families in space that share the kind of their start.

    Parameters
    ----------
    problem : SpatialShooting
        The equations; lanes are families, with the sub-steps with which they were followed.
    branches : tuple of Branch
        One per family, from the plane on; with fewer than two members where it failed.
    members : tuple of Members
        The members of each branch.
    counts : ndarray, shape (G, F)
        Sub-steps at G equally spaced places of each family.
    """

    problem: SpatialShooting
    branches: tuple[Branch, ...]
    members: tuple[Members, ...]
    counts: Array

    @classmethod
    def follow(
        cls,
        problem: SpatialShooting,
        z: Array,
        z_max: float,
        tick: Callable[[int], None] = lambda _: None,
    ) -> Spatial:
        """Follow families from their first members (4, M) up to an amplitude, all in lockstep.

        A family that comes back to the plane ends there, and one whose orbits meet the body or
        cannot be computed ends before they do; the others go on.

        Parameters
        ----------
        problem : SpatialShooting
            From `first_members`.
        z : ndarray, shape (4, M)
            First members.
        z_max : float
            Amplitude, normalised.
        tick : callable
            Called now and then with the number of families that have ended since.
        """
        direction = np.eye(len(problem.unknowns))[problem.kernel]
        state = Following(problem, z_max, tick)
        followed = follow_lanes(
            state, z, direction, done=state.done, control=_CONTROL, finish=False
        )
        # an orbit that meets the body does not belong to the family
        followed = [_without_last(b) if f in state.dropped else b for f, b in enumerate(followed)]
        grid = np.array(
            [b.z[:, np.linspace(0, b.size - 1, _GRID).round().astype(int)] for b in followed]
        )
        flat = np.moveaxis(grid, 2, 0).reshape(_GRID * len(followed), -1).T
        lanes = np.tile(np.arange(len(followed)), _GRID)
        first = state.problem.of(lanes)
        first = first.with_counts(np.ceil(2.6 * first.counts).astype(np.int64))
        counts, _ = sub_steps(first, flat, _EXACT)
        table = counts.reshape(_GRID, len(followed)).astype(float)
        made = cls(state.problem, tuple(followed), (), table)
        return made._polish()

    def _polish(self) -> Spatial:
        family, u = self.positions
        z = np.concatenate([b.z for b in self.branches], axis=1)
        lines = np.concatenate([b.tangent for b in self.branches], axis=1)
        polished = polish(self.exact(family, u), z, lines, z)
        branches, members = [], []
        for f, branch in enumerate(self.branches):
            own = np.flatnonzero(family == f)
            bad = np.flatnonzero(~(polished.error[own] <= CLOSED))
            end = branch.ends[1]
            if bad.size:
                own, end = own[: bad[0]], SENSITIVE
            branches.append(
                Branch(polished.z[:, own], branch.tangent[:, : own.size], ("start", end))
            )
            members.append(polished.of(own))
        return Spatial(self.problem, tuple(branches), tuple(members), self.counts)

    def cut(self, good: Sequence[int], reason: str = SENSITIVE) -> Spatial:
        """Return the families with their first `good` members only, and why those cut end."""
        branches = [
            Branch(b.z[:, :k], b.tangent[:, :k], ("start", b.ends[1] if k == b.size else reason))
            for b, k in zip(self.branches, good, strict=True)
        ]
        members = [m.of(np.arange(k)) for m, k in zip(self.members, good, strict=True)]
        return Spatial(self.problem, tuple(branches), tuple(members), self.counts)

    def only(self, lanes: NDArray[np.intp]) -> Spatial:
        """Return some of the families."""
        return Spatial(
            self.problem.of(lanes),
            tuple(self.branches[k] for k in lanes),
            tuple(self.members[k] for k in lanes),
            self.counts[:, lanes],
        )

    @property
    def positions(self) -> tuple[NDArray[np.intp], Array]:
        """Family number (K,) and position (K,) on its branch of all members."""
        sizes = [b.size for b in self.branches]
        family = np.repeat(np.arange(len(sizes)), sizes)
        return family, np.concatenate([np.arange(size, dtype=float) for size in sizes])

    @property
    def whole(self) -> tuple[bool, ...]:
        """Whether each family has two members at least."""
        return tuple(b.size >= 2 for b in self.branches)

    def exact(self, family: NDArray[np.intp], u: Array) -> SpatialShooting:
        """Return the problem of members at positions u (K,), with sub-steps good for them."""
        counts = np.empty(u.size)
        for f in np.unique(family):
            own = family == f
            # places were chosen on the branch as it was followed, of which this may be a part
            top = max(self.branches[f].size - 1.0, 1.0)
            # sub-steps interpolated along the branch, with 5 % of margin
            counts[own] = np.interp(u[own] / top, np.linspace(0.0, 1.0, _GRID), self.counts[:, f])
        return self.problem.of(family).with_counts(np.ceil(1.05 * counts).astype(np.int64))

    def at(
        self,
        family: NDArray[np.intp],
        u: Array,
        guess: Array | None = None,
        tolerance: float = RETURNED,
        known: tuple[NDArray[np.intp], Array, Members] | None = None,
    ) -> Members:
        """Return corrected members at positions u (K,) of the families' branches.

        They are sought in the planes normal to the chord through a guess (4, K), by default the
        branch's own. Newton's iteration starts at a prediction from `known` members with their
        families and positions, by default those of the branches.

        Raises
        ------
        LostMembersError
            If some of them cannot be corrected.
        """
        own, normals = np.empty((2, len(self.problem.unknowns), u.size))
        for f in np.unique(family):
            lanes, branch = family == f, self.branches[f]
            if guess is None:
                own[:, lanes] = branch.guess(u[lanes])[0]
            i = np.clip(np.floor(u[lanes]).astype(int), 0, branch.size - 2)
            chord = branch.z[:, i + 1] - branch.z[:, i]
            normals[:, lanes] = chord / np.linalg.norm(chord, axis=0)
        guess = own if guess is None else guess
        start = self.predict(family, u, guess, normals, known)
        return polish(self.exact(family, u), start, normals, guess, tolerance).require_converged(
            family, u
        )

    def predict(
        self,
        family: NDArray[np.intp],
        u: Array,
        guess: Array,
        normals: Array,
        known: tuple[NDArray[np.intp], Array, Members] | None = None,
    ) -> Array:
        """Return where families (K,) pass at positions u (K,) through planes; see `at`."""
        numbers, places, members = known or (*self.positions, join_members(self.members))
        slopes = self.problem.conditions(members.z, members.end, members.phi)[1]
        rows = numbers, places, members.z, null_vectors(slopes)
        return predict_members(rows, (family, u), guess, normals)

    def members_at(
        self, heights: Sequence[float]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Members]:
        """Find every member of every family at given amplitudes.

        Parameters
        ----------
        heights : sequence of float
            Amplitudes, normalised.

        Returns
        -------
        family, target : ndarray of int, shape (N,)
            Number of the family and of the amplitude; ordered by both, then by arclength. A
            member that cannot be corrected is not among them.
        u : ndarray, shape (N,)
            Position on the family's branch.
        members : Members
            The members.
        """
        rows: list[tuple[int, int, int, float, float]] = []
        for f, branch in enumerate(self.branches):
            family = np.full(branch.size, f)
            tall = height(self.exact(family, np.arange(branch.size, dtype=np.float64)), branch.z)
            for k, wanted in enumerate(heights):
                rows += [
                    (f, k, int(i), tall[i] - wanted, tall[i + 1] - wanted)
                    for i in brackets(tall, wanted)
                ]
        while rows:
            try:
                return self._between(rows, heights)
            except LostMembersError as lost:
                rows = [row for row in rows if not lost.among(row[0], row[2])]
        none = np.empty((4, 0))
        index = np.empty(0, dtype=np.intp)
        members = Members(none, np.empty((6, 0)), np.empty((6, 6, 0)), none[0])
        return index, index, none[0], members

    def _between(
        self, rows: Sequence[tuple[int, int, int, float, float]], heights: Sequence[float]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Members]:
        """Find one member per row: family, amplitude, interval, excess at both its ends."""
        family, target, i = np.array([row[:3] for row in rows], dtype=np.intp).T
        below, above = np.array([row[3:] for row in rows]).T
        wanted = np.asarray(heights, dtype=float)[target]
        if self.problem.start != "position":
            u = bracketed_roots(
                lambda u: height(self.exact(family, u), self.at(family, u).z) - wanted,
                i.astype(float), i + 1.0, below, above, np.full(wanted.shape, 1e-13),
            )  # fmt: skip
            return family, target, u, self.at(family, u)
        # linear interpolation; then z itself is prescribed, so that no root is left to find
        u = i + below / (below - above)
        guess = np.concatenate(
            [self.branches[f].guess(np.array([v]))[0] for f, v in zip(family, u, strict=True)],
            axis=1,
        )
        guess[self.problem.kernel] = wanted
        normals = np.zeros_like(guess)
        normals[self.problem.kernel] = 1.0
        start = self.predict(family, u, guess, normals)
        members = polish(self.exact(family, u), start, normals, guess)
        return family, target, u, members.require_converged(family, u)


def _without_last(branch: Branch) -> Branch:
    return Branch(branch.z[:, :-1], branch.tangent[:, :-1], branch.ends)
