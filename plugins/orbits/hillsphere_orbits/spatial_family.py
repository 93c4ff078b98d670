"""Families of orbits in space that branch off planar ones at vertical resonances.

At a vertical bifurcation d:n the planar orbit, run through n times, has a kernel of two directions
out of the plane: a displacement z and a velocity ż. Along each of them a family branches off whose
orbits keep one of two mirrors under time reversal: the plane xz ("position": z ≠ 0, ż = 0 at the
start), or the half-turn about the x axis ("velocity": z = 0, ż ≠ 0). Either way half a period,
n/2 revolutions, is solved between two states that the mirror keeps.

About a body that looks the same after half a turn (an ellipsoid, a point mass) the two are
different families for odd n only: for even n one is the other, seen some revolutions later.

References
----------
.. [1] Robin, I. A., Markellos, V. V., Numerical determination of three-dimensional periodic orbits
   generated from vertical self-resonant satellite orbits, Celestial Mechanics 21, 1980, p. 395.
.. [2] Hénon, M., Vertical stability of periodic orbits in the restricted problem, Astron.
   Astrophys. 28, 1973, p. 415.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hillsphere.dynamics import bracketed_roots
from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch, StepControl
from hillsphere_orbits.correction import correct, fixed, on_planes
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.lockstep import follow_lanes
from hillsphere_orbits.roots import brackets
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.spatial_stability import excess, pair_indices

__all__ = ["MIRRORS", "Spatial", "branch_off", "height", "spatial_problem"]

MIRRORS = {"position": (1, -1, 1, -1, 1, -1), "velocity": (1, -1, -1, -1, 1, 1)}
"""Signs of x, y, z, vx, vy, vz under the time reversal that each branch keeps."""

_PLANE = (1, 1, -1, 1, 1, -1)
_BIRTH = 0.01  # z or ż, natural units, of the first member: beyond it the kernel's plane is left
_CONTROL = StepControl(first=0.02, largest=0.4, turn=0.35, members=600)
_FOLLOWED = 1e-7  # error of half a period while following; what is returned is better
_RETURNED = 3e-11
_ROUNDING = 3e-14  # of the half-period's matrix: what no number of steps improves on
_PASSES = 3
_SURFACE = "the next orbit meets the surface"
_NEAR = 6.0  # index up to which stability may be near
_WINDOW = 1e-3  # edges of windows of stability, in distances of two members


def spatial_problem(flow: Flow, branch: str, samples: Array) -> SymmetricShooting:
    """Return the half-period problem of a branch.

    Parameters
    ----------
    flow : Flow
        States x, y, z, vx, vy, vz.
    branch : {"position", "velocity"}
        Which.
    samples : ndarray, shape (6, K)
        States at which the mirrors are tried.

    Raises
    ------
    InputError
        If the equations do not keep the mirrors: there are no such families then.
    """
    if not flow.keeps(_PLANE, samples, reverses_time=False) or not flow.keeps(
        MIRRORS[branch], samples, reverses_time=True
    ):
        raise InputError(
            "families in space need equations that keep the mirror planes xy and xz; this plant's "
            "gravity does not (harmonics with S terms or of odd degree minus order, a tilted body)"
        )
    return SymmetricShooting(flow, MIRRORS[branch])


def branch_off(
    problem: SymmetricShooting, x: Array, period: Array, n: Array
) -> tuple[SymmetricShooting, Array]:
    """Return the problem with sub-steps and a first member of each family.

    Parameters
    ----------
    problem : SymmetricShooting
        From `spatial_problem`.
    x : ndarray, shape (6, M)
        Planar orbits at the bifurcations, normalised.
    period : ndarray, shape (M,)
        Their periods, of one revolution.
    n : ndarray, shape (M,)
        Revolutions of the families' orbits.

    Returns
    -------
    problem : SymmetricShooting
        With sub-steps good for these members while following.
    z : ndarray, shape (4, M)
        Members with z (or ż) = 0.01, held while correcting.
    """
    kernel = _kernel(problem)
    z = problem.unknowns_at(x, period * n)
    z[kernel] = _BIRTH
    problem = problem.with_steps(_steps(problem, z, _FOLLOWED))
    found = correct(problem, z, fixed(kernel, _BIRTH), tolerance=1e-9)
    names = [f"x = {value:.6g}, n = {turns}" for value, turns in zip(x[0], n, strict=True)]
    return problem, found.checked("first orbit out of the plane", names)


def height(problem: SymmetricShooting, z: Array) -> Array:
    """Return the amplitude (N,) of members: z at the start, or the largest |z| ("velocity")."""
    if problem.mirror == MIRRORS["position"]:
        return np.asarray(z[problem.unknowns.index("z")])
    flow = problem.flow
    # both halves are each other's mirror image
    way = flow.trajectory(problem.state(z), z[-1], problem.steps)
    lane = np.arange(z.shape[1])
    top = np.argmax(np.abs(way[2]), axis=0)
    here = base = way[:, top, lane]
    h = np.zeros(z.shape[1])
    for _ in range(6):
        h = h - here[5] / flow.rate(here)[5]
        here = flow.at_once(base, h)
    return np.asarray(np.abs(here[2]))


@dataclass(frozen=True)
class Spatial:
    """Families in space, computed.

    Parameters
    ----------
    problem : SymmetricShooting
        The equations, with sub-steps for the members returned.
    branches : tuple of Branch
        One per family, from the plane on.
    z_max : float
        Amplitude up to which they were followed, normalised.
    """

    problem: SymmetricShooting
    branches: tuple[Branch, ...]
    z_max: float

    @classmethod
    def follow(cls, problem: SymmetricShooting, z: Array, z_max: float) -> Spatial:
        """Follow families from their first members (4, M) up to an amplitude, all in lockstep.

        A family that comes back to the plane ends there, and one whose orbits meet the body before
        they do.

        Raises
        ------
        ConvergenceError
            If a family cannot be followed, meets the body at once, or becomes so unstable that
            half a period cannot be computed.
        """
        kernel = _kernel(problem)
        direction = np.eye(len(problem.unknowns))[kernel]
        used, returned = [problem], [problem]

        met: set[int] = set()

        def done(members: Array, lanes: NDArray[np.intp]) -> list[str]:
            tall, clear = height(used[0], members), _clearance(used[0], members)
            met.update(int(k) for k in lanes[clear < 0.0])
            return [
                _SURFACE if room < 0.0
                else "the amplitude asked for" if top > z_max
                else "the family returns to the plane" if out < 0.5 * _BIRTH
                else ""
                for room, top, out in zip(clear, tall, members[kernel], strict=True)
            ]  # fmt: skip

        def exact(chains: list[Array]) -> SymmetricShooting:
            # the member that meets the body is not one of those returned
            whole = [c[:, :-1] if k in met else c for k, c in enumerate(chains)]
            ends = np.concatenate([c[:, [c.shape[1] // 2, -1]] for c in whole], axis=1)
            returned[0] = problem.with_steps(_steps(problem, ends, _RETURNED))
            return returned[0]

        for _ in range(_PASSES):
            branches = follow_lanes(used[0], z, direction, done=done, control=_CONTROL, exact=exact)
            ends = np.array([branch.z[:, -1] for branch in branches]).T
            needed = _steps(problem, ends, 30.0 * _FOLLOWED)
            if needed <= used[0].steps:
                break
            used[0] = problem.with_steps(2 * needed)
        return cls(returned[0], tuple(branches), z_max)

    @property
    def curve(self) -> tuple[NDArray[np.int64], Array]:
        """Family number (K,) and all members (4, K)."""
        family = np.repeat(np.arange(len(self.branches)), [b.size for b in self.branches])
        return family.astype(np.int64), np.concatenate([b.z for b in self.branches], axis=1)

    def at(self, family: NDArray[np.int64], u: Array) -> Array:
        """Return corrected members (4, K) at positions u (K,) of the families' chains."""
        guess, normals = np.empty((2, len(self.problem.unknowns), u.size))
        for f in np.unique(family):
            lanes, branch = family == f, self.branches[f]
            guess[:, lanes] = branch.guess(u[lanes])[0]
            i = np.clip(np.floor(u[lanes]).astype(int), 0, branch.size - 2)
            chord = branch.z[:, i + 1] - branch.z[:, i]
            normals[:, lanes] = chord / np.linalg.norm(chord, axis=0)
        found = correct(self.problem, guess, on_planes(normals, guess), tolerance=1e-9)
        names = [f"family {f}, position {v:.3f}" for f, v in zip(family, u, strict=True)]
        return found.checked("member between two others", names)

    def members_at(
        self, heights: Sequence[float]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """Find every member of every family at given amplitudes.

        Parameters
        ----------
        heights : sequence of float
            Amplitudes, normalised.

        Returns
        -------
        family, target : ndarray of int, shape (N,)
            Number of the family and of the amplitude; ordered by both, then by arclength.
        z : ndarray, shape (4, N)
            The members.
        """
        rows: list[tuple[int, int, int, float, float]] = []
        for f, branch in enumerate(self.branches):
            tall = height(self.problem, branch.z)
            for k, wanted in enumerate(heights):
                rows += [
                    (f, k, int(i), tall[i] - wanted, tall[i + 1] - wanted)
                    for i in brackets(tall, wanted)
                ]
        if not rows:
            none = np.empty(0, dtype=np.int64)
            return none, none, np.empty((len(self.problem.unknowns), 0))
        family, target, i = np.array([row[:3] for row in rows], dtype=np.int64).T
        below, above = np.array([row[3:] for row in rows]).T
        wanted = np.asarray(heights, dtype=float)[target]
        if self.problem.mirror == MIRRORS["position"]:
            u = i + below / (below - above)
            guess = np.concatenate(
                [self.branches[f].guess(np.array([v]))[0] for f, v in zip(family, u, strict=True)],
                axis=1,
            )
            held = fixed(self.problem.unknowns.index("z"), wanted)
            found = correct(self.problem, guess, held, tolerance=1e-9)
            names = [f"family {f}, z = {v:.9g}" for f, v in zip(family, wanted, strict=True)]
            return family, target, found.checked("member at a prescribed amplitude", names)
        u = bracketed_roots(
            lambda u: height(self.problem, self.at(family, u)) - wanted,
            i.astype(float), i + 1.0, below, above, np.full(wanted.shape, 1e-13),
        )  # fmt: skip
        return family, target, self.at(family, u)

    def windows(self, monodromy: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """Locate the windows of stability of all families.

        Between the members the index is sampled once more at half way, and where a cubic spline
        through it turns, so that windows between two members show; their edges are then bracketed
        to a thousandth of the distance of two members.

        Parameters
        ----------
        monodromy : ndarray, shape (6, 6, K)
            Of the members of `curve`.

        Returns
        -------
        family : ndarray of int, shape (W,)
            Number of the family.
        begin, end : ndarray, shape (4, W)
            Members at the edges of each window, in the order of the chain.
        """
        family, _ = self.curve
        u = np.concatenate([np.arange(branch.size, dtype=float) for branch in self.branches])
        index, edge = pair_indices(monodromy)[0].real, excess(monodromy)
        for places in (self._halves, self._turns):
            more_family, more_u = places(family, u, index)
            if more_u.size:
                matrices = self.problem.monodromy(self.at(more_family, more_u))
                family = np.concatenate([family, more_family])
                u = np.concatenate([u, more_u])
                index = np.concatenate([index, pair_indices(matrices)[0].real])
                edge = np.concatenate([edge, excess(matrices)])
                order = np.lexsort((u, family))
                family, u, index, edge = family[order], u[order], index[order], edge[order]
        passed = (family[1:] == family[:-1]) & ((edge[1:] > 0.0) != (edge[:-1] > 0.0))
        i = np.flatnonzero(passed)
        roots = u[:0]
        if i.size:
            roots = bracketed_roots(
                lambda v: excess(self.problem.monodromy(self.at(family[i], v))),
                u[i], u[i + 1], edge[i], edge[i + 1], np.full(i.shape, _WINDOW),
            )  # fmt: skip
        rows: list[tuple[int, float, float]] = []
        for f, branch in enumerate(self.branches):
            own = family == f
            cuts = [0.0, *roots[family[i] == f], branch.size - 1.0]
            begins_stable = bool(edge[own][0] <= 0.0)
            rows += [
                (f, a, b)
                for k, (a, b) in enumerate(pairwise(cuts))
                if (k % 2 == 0) == begins_stable
            ]
        if not rows:
            none = np.empty((len(self.problem.unknowns), 0))
            return np.empty(0, dtype=np.int64), none, none
        which = np.array([row[0] for row in rows], dtype=np.int64)
        begin, end = (self.at(which, np.array([row[k] for row in rows])) for k in (1, 2))
        return which, begin, end

    def _halves(
        self, family: NDArray[np.int64], u: Array, index: Array
    ) -> tuple[NDArray[np.int64], Array]:
        """Return the middles of the intervals of which an end is not far from stable."""
        near = np.minimum(np.abs(index[1:]), np.abs(index[:-1])) < _NEAR
        i = np.flatnonzero((family[1:] == family[:-1]) & near)
        return family[i], 0.5 * (u[i] + u[i + 1])

    def _turns(
        self, family: NDArray[np.int64], u: Array, index: Array
    ) -> tuple[NDArray[np.int64], Array]:
        """Return where splines through the index turn, in or near stability."""
        found: list[tuple[int, float]] = []
        for f in range(len(self.branches)):
            own = (family == f) & (np.abs(index) < 50.0)
            if np.count_nonzero(own) < 4:
                continue
            curve = CubicSpline(u[own], index[own])
            turns = curve.derivative().roots(extrapolate=False)
            found += [
                (f, float(v))
                for v in turns[np.isfinite(turns)]
                if abs(float(curve(v))) < _NEAR and np.min(np.abs(u[own] - v)) > 1e-3
            ]
        return (
            np.array([f for f, _ in found], dtype=np.int64),
            np.array([v for _, v in found]),
        )


def _clearance(problem: SymmetricShooting, z: Array) -> Array:
    """Return the least value of the event "impact" along each orbit (N,); 1 without a body."""
    flow = problem.flow
    if "impact" not in flow.system.events:
        return np.ones(z.shape[1])
    # both halves of an orbit are each other's mirror image
    way = flow.trajectory(problem.state(z), z[-1], problem.steps)
    states, points, cases = way.shape
    flat = np.ascontiguousarray(way.reshape(states, points * cases))
    compiled = flow.system.function(flow.system.events["impact"])
    values = compiled(flat, flow.system.parameters(None, points * cases))[0]
    return np.asarray(np.min(values.reshape(points, cases), axis=0))


def _outside(branch: Branch) -> Branch:
    """Return the branch without its last member if that meets the body."""
    if branch.ends[1] != _SURFACE:
        return branch
    if branch.size < 3:
        raise ConvergenceError("a family's orbits meet the body where it leaves the plane")
    return Branch(branch.z[:, :-1], branch.tangent[:, :-1], branch.ends)


def _kernel(problem: SymmetricShooting) -> int:
    """Return the number of the unknown that leads out of the plane."""
    return problem.unknowns.index("z" if problem.mirror == MIRRORS["position"] else "vz")


def _steps(problem: SymmetricShooting, z: Array, tolerance: float) -> int:
    """Return sub-steps of half a period that meet a tolerance, or rounding where that is more."""
    x = problem.state(z)
    flow = problem.flow
    try:
        coarse = flow.map.choose_steps(x, z[-1], max(tolerance, 1e-6))
        if tolerance >= 1e-6:
            return coarse
        _, half = flow.with_matrix(x, z[-1], coarse)
        floor = _ROUNDING * float(np.max(np.abs(half)))
        return flow.map.choose_steps(x, z[-1], max(tolerance, floor))
    except PropagationError as error:
        top = float(np.max(height(problem, z)))
        raise ConvergenceError(
            f"orbits of amplitude up to {top:.4g} natural units are too sensitive to be computed "
            f"over half a period ({error}); ask for smaller amplitudes (z_max)"
        ) from error
