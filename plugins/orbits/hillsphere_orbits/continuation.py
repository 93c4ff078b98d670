"""Continuation of one-parameter families by pseudo-arclength, for any `correction.Problem`.

References
----------
.. [1] Keller, H. B., Numerical solution of bifurcation and nonlinear eigenvalue problems, in
   Applications of Bifurcation Theory, Academic Press, 1977, p. 359 (pseudo-arclength).
.. [2] Allgower, E. L., Georg, K., Introduction to Numerical Continuation Methods, SIAM, 2003,
   chapter 6 (step control).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import bracketed_roots
from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.correction import Constraint, Problem, Watch, correct, on_planes, tangents

__all__ = ["Boundary", "Branch", "StepControl", "continue_both", "follow"]


@dataclass(frozen=True)
class Branch:
    """A piece of a family as a chain of members.

    A position on it is a number u in [0, N − 1]: member ⌊u⌋ and the fraction of the way to the
    next one. `at` corrects the members at any positions, through turning points as well.

    Parameters
    ----------
    z : ndarray, shape (m, N)
        Members, N ≥ 2.
    tangent : ndarray, shape (m, N)
        Unit tangents, all in the sense of the chain.
    ends : tuple of str
        Why the chain stops at its first and its last member.
    """

    z: Array
    tangent: Array
    ends: tuple[str, str]

    @property
    def size(self) -> int:
        """Number of members."""
        return int(self.z.shape[1])

    def guess(self, u: Array) -> tuple[Array, Constraint]:
        """Return the cubic interpolant at positions u (N,) and the planes that hold them there."""
        u = np.asarray(u, dtype=float)
        i = np.clip(np.floor(u).astype(int), 0, self.size - 2)
        s = u - i
        start, end = self.z[:, i], self.z[:, i + 1]
        chord = end - start
        length2 = np.sum(chord * chord, axis=0)
        # dz/ds where s is the fraction of the chord: the tangent, stretched to unit progress
        ahead, behind = (
            self.tangent[:, k] * (length2 / np.sum(chord * self.tangent[:, k], axis=0))
            for k in (i, i + 1)
        )
        # Hermite's cubic from both ends and their derivatives; an error of order chord⁴
        guess = (
            start
            + s * ahead
            + s**2 * (3.0 * chord - 2.0 * ahead - behind)
            + s**3 * (ahead + behind - 2.0 * chord)
        )
        return guess, on_planes(chord / np.sqrt(length2), start + s * chord)

    def at(self, problem: Problem, u: Array) -> Array:
        """Return corrected members (m, K) at positions u (K,).

        Raises
        ------
        ConvergenceError
            If one of them cannot be corrected (the chain is too coarse there).
        """
        guess, planes = self.guess(u)
        names = [f"position {value:.3f}" for value in np.asarray(u)]
        z = correct(problem, guess, planes).require_converged("member between two others", names)
        return self.near(u, z, "member between two others", names)

    def near(self, u: Array, z: Array, what: str, names: Sequence[str]) -> Array:
        """Return members z (m, K), or raise if one is not near its position u on the chain.

        Newton's iteration can end on another solution of the equations (a rest, another family)
        when its guess is poor; a member lies within a chord of both its neighbours.

        Raises
        ------
        ConvergenceError
            Naming the members that wandered off.
        """
        i = np.clip(np.floor(np.asarray(u, dtype=float)).astype(int), 0, self.size - 2)
        chord = np.linalg.norm(self.z[:, i + 1] - self.z[:, i], axis=0)
        # a solution farther than a chord from both neighbours belongs to another branch
        away = np.minimum(
            np.linalg.norm(z - self.z[:, i], axis=0), np.linalg.norm(z - self.z[:, i + 1], axis=0)
        )
        if lost := [name for name, bad in zip(names, away > chord, strict=True) if bad]:
            raise ConvergenceError(
                f"{what}: Newton's iteration left the family for {', '.join(lost[:5])}; it needs "
                "more members on its curve"
            )
        return z

    def resample(self, problem: Problem, members: int, *, relative: bool = False) -> Branch:
        """Return the same piece with this many members, equally spaced in chord length.

        With `relative` lengths count relative to the distance from the origin where that is above
        one, so that a long tail does not starve the part near it.
        """
        chord = np.linalg.norm(np.diff(self.z, axis=1), axis=0)
        if relative:
            distance = np.linalg.norm(self.z, axis=0)
            chord = chord / np.maximum(1.0, np.minimum(distance[1:], distance[:-1]))
        # positions u at equal arclength, by inverting the cumulated chord length
        length = np.concatenate([[0.0], np.cumsum(chord)])
        u = np.interp(np.linspace(0.0, length[-1], members), length, np.arange(self.size))
        z = self.at(problem, u)
        sense = np.gradient(z, axis=1)
        return Branch(z, tangents(problem, z, sense), self.ends)


@dataclass(frozen=True)
class Boundary:
    """Where a family is to end: members are kept while the function is ≥ 0.

    Parameters
    ----------
    reason : str
        What it means to be there, in words.
    function : callable
        z (m, N) → (N,), smooth near zero.
    """

    reason: str
    function: Callable[[Array], Array]


@dataclass(frozen=True)
class StepControl:
    """Steps of pseudo-arclength continuation, in the units of the unknowns.

    Parameters
    ----------
    first, smallest, largest : float
        Arclength of the first step and its bounds.
    turn : float
        Largest angle between the tangents of neighbouring members, rad.
    members : int
        Most members of one direction.
    tolerance : float
        Largest residual of a member.
    """

    first: float = 0.05
    smallest: float = 1e-6
    largest: float = 0.5
    turn: float = 0.25
    members: int = 400
    tolerance: float = 1e-11


def follow(
    problem: Problem,
    start: Array,
    direction: Array,
    *,
    boundaries: Sequence[Boundary] = (),
    control: StepControl | None = None,
    watch: Watch | None = None,
) -> Branch:
    """Follow a family in one direction by pseudo-arclength.

    Predicts along the tangent, corrects in the plane normal to it. The step doubles while Newton
    needs at most three iterations and the tangent hardly turns, and is halved when the correction
    fails, ends farther off than the family can have turned (on another one), or the tangent turns
    too far. The member on a boundary is located exactly.

    Parameters
    ----------
    problem : Problem
        The equations.
    start : ndarray, shape (m,)
        A corrected member.
    direction : ndarray, shape (m,)
        Sense in which to go; need not be a tangent.
    boundaries : sequence of Boundary
        Where to end.
    control : StepControl, optional
        Steps.
    watch : callable, optional
        Called with each member.

    Returns
    -------
    Branch
        From `start` on; a single member if it lies on a boundary already.

    Raises
    ------
    InputError
        If `start` lies outside a boundary.
    """
    control = control or StepControl()
    z = np.array(start, dtype=float)[:, None]
    for boundary in boundaries:
        if float(boundary.function(z)[0]) < -1e-9:
            raise InputError(f"the first member is already beyond the end: {boundary.reason}")
    tangent = tangents(problem, z, direction)
    members, lines, step = [z], [tangent], control.first
    reason = f"stopped after {control.members} members"
    while len(members) < control.members:
        new, line, quick = _advance(problem, z, tangent, step, control)
        if new is None or line is None:
            # the step is halved until the correction succeeds on this branch
            step *= 0.5
            if step < control.smallest:
                reason = "no further member: the step collapsed"
                break
            continue
        pair = Branch(np.hstack([z, new]), np.hstack([tangent, line]), ("", ""))
        try:
            hit = _first_crossed(problem, pair, boundaries)
        except ConvergenceError as error:
            # where orbits can hardly be computed, the one on the boundary need not be among those
            # that can: the family ends at the last member inside
            beyond = [b.reason for b in boundaries if b.function(new)[0] < 0.0]
            if len(members) < 2 or not beyond:
                raise
            reason = f"{beyond[0]} (within one member: {error})"
            break
        if hit is not None:
            position, reason = hit
            if position > 1e-9:
                last = pair.at(problem, np.array([position]))
                members.append(last)
                lines.append(tangents(problem, last, line))
            break
        members.append(new)
        lines.append(line)
        if watch is not None:
            watch(new)
        z, tangent = new, line
        step = min(control.largest, step * (2.0 if quick else 1.0))
    return Branch(np.hstack(members), np.hstack(lines), ("start", reason))


def _advance(
    problem: Problem, z: Array, tangent: Array, step: float, control: StepControl
) -> tuple[Array | None, Array | None, bool]:
    """Take one step; (None, None, False) if it failed, else member, tangent and "was easy"."""
    # Euler predictor; the corrector stays in the plane normal to the tangent (Keller 1977)
    ahead = z + step * tangent
    try:
        corrected = correct(
            problem, ahead, on_planes(tangent, ahead), tolerance=control.tolerance, iterations=8
        )
        if not bool(corrected.converged[0]):
            return None, None, False
        # a branch that turns by at most `turn` leaves its tangent by about turn·step/2; a
        # correction farther off has met another branch
        if np.linalg.norm(corrected.z - ahead) > control.turn * step:
            return None, None, False
        line = tangents(problem, corrected.z, tangent)
    except PropagationError:
        return None, None, False
    cosine = float(np.sum(line * tangent))
    # the tangent turns too far for a linear prediction
    if cosine < np.cos(control.turn):
        return None, None, False
    return corrected.z, line, corrected.iterations <= 3 and cosine > np.cos(0.4 * control.turn)


def _first_crossed(
    problem: Problem, pair: Branch, boundaries: Sequence[Boundary]
) -> tuple[float, str] | None:
    """Find the nearest boundary between two neighbouring members: (fraction, reason)."""
    hits: list[tuple[float, str]] = []
    for boundary in boundaries:
        before, after = boundary.function(pair.z)
        if after >= 0.0:
            continue
        # the member itself lies on the boundary, to rounding
        if before <= 0.0:
            hits.append((0.0, boundary.reason))
            continue

        def beyond(s: Array, function: Callable[[Array], Array] = boundary.function) -> Array:
            return function(pair.at(problem, s))

        root = bracketed_roots(
            beyond,
            np.array([0.0]), np.array([1.0]), np.array([before]), np.array([after]),
            np.array([1e-13]),
        )  # fmt: skip
        hits.append((float(root[0]), boundary.reason))
    return min(hits, default=None)


def continue_both(
    problem: Problem,
    start: Array,
    direction: Array,
    *,
    boundaries: Sequence[Boundary] = (),
    control: StepControl | None = None,
    watch: Watch | None = None,
) -> Branch:
    """Follow a family from one member both ways.

    Parameters
    ----------
    problem, start, direction, boundaries, control, watch
        As for `follow`; `direction` gives the sense of the chain.

    Returns
    -------
    Branch
        With `start` inside (or at an end, if that lies on a boundary).

    Raises
    ------
    ConvergenceError
        If there is no member besides `start`.
    """
    ahead = follow(problem, start, direction, boundaries=boundaries, control=control, watch=watch)
    sense = -ahead.tangent[:, 0]
    back = follow(problem, start, sense, boundaries=boundaries, control=control, watch=watch)
    # the backward branch reversed, without the shared first member
    z = np.hstack([back.z[:, :0:-1], ahead.z])
    tangent = np.hstack([-back.tangent[:, :0:-1], ahead.tangent])
    if z.shape[1] < 2:
        raise ConvergenceError(
            f"the family has no member besides the first one ({ahead.ends[1]}; {back.ends[1]})"
        )
    return Branch(z, tangent, (back.ends[1], ahead.ends[1]))
