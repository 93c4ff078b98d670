"""Pseudo-arclength continuation of many families at once.

One evaluation of the equations advances every family by one Newton step: a lane that has converged
takes its tangent from the derivatives already in hand and predicts its next member, while its
neighbours go on correcting. So no lane waits for another, and a lane that has come to its end
leaves the arrays.

References
----------
.. [1] Keller, H. B., Numerical solution of bifurcation and nonlinear eigenvalue problems, in
   Applications of Bifurcation Theory, Academic Press, 1977, p. 359 (pseudo-arclength).
.. [2] Allgower, E. L., Georg, K., Introduction to Numerical Continuation Methods, SIAM, 2003,
   chapter 6 (step control).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.contracts import Contract
from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch, StepControl
from hillsphere_orbits.correction import Problem, correct, on_planes

__all__ = ["Done", "LaneProblem", "follow_lanes"]

Done: TypeAlias = Callable[[Array, NDArray[np.intp]], Sequence[str]]
"""Members z (m, K) of lanes (K,) → why each lane ends there; an empty string goes on."""

_COARSE = 1e-8  # residual from which one more Newton step, untested, is as good as converged
_EASY, _MOST = 2, 6  # Newton steps: the next step may be longer; the step was too long
_QUICK = 0.35  # part of the largest turn up to which the next step may be longer


@runtime_checkable
class LaneProblem(Problem, Contract, Protocol):
    """Equations with settings of their own in every lane (sub-steps, parameters)."""

    def of(self, lanes: NDArray[np.intp]) -> Problem:
        """Return the problem of some of the lanes."""
        ...


@dataclass
class _Lane:
    """State of the continuation of one family."""

    step: float
    members: list[Array] = field(default_factory=list)
    lines: list[Array] = field(default_factory=list)
    newton: int = 0
    end: str = ""

    def accept(self, z: Array, line: Array) -> None:
        self.members.append(np.array(z))  # z may be a view of arrays that go on changing
        self.lines.append(np.array(line))
        self.newton = 0

    @property
    def ahead(self) -> Array:
        """The prediction of the next member, and the foot of the plane it is sought in."""
        return np.asarray(self.members[-1] + self.step * self.lines[-1])


def follow_lanes(
    problem: Problem,
    z: Array,
    direction: Array,
    *,
    done: Done,
    control: StepControl | None = None,
    exact: Callable[[list[Array]], Problem] | None = None,
    finish: bool = True,
) -> list[Branch]:
    """Follow M families in one direction each, every one with steps of its own.

    Members are predicted along the tangent and corrected in the plane normal to it, so that turning
    points are passed. While following, a member counts as converged at a residual of 1e-8, and one
    further Newton step is taken unseen; in the end all members of all families are corrected
    together until they are within ``control.tolerance`` or cannot be bettered.

    Parameters
    ----------
    problem : Problem
        The equations, common to all lanes, or a `LaneProblem`.
    z : ndarray, shape (m, M)
        A corrected member of each family.
    direction : ndarray, shape (m,) or (m, M)
        Sense in which to go; need not be a tangent.
    done : callable
        See `Done`; the member at which it says why is the family's last.
    control : StepControl, optional
        Steps.
    exact : callable, optional
        From the members of every lane, (m, K) each, to the same equations solved as exactly as
        the members returned shall be; by default those followed.
    finish : bool
        Whether the members are corrected together in the end and every family must have two. If
        not, they are as good as following left them, and the caller does the rest.

    Returns
    -------
    list of Branch
        One per lane, from its `z` on, with the reason of its end.

    Raises
    ------
    InputError
        If the shapes do not fit or there is no lane.
    PropagationError
        If a first member is outside the domain of the equations.
    ConvergenceError
        If a family has no member besides its first.
    """
    control = control or StepControl()
    z = np.array(z, dtype=float)
    if z.ndim != 2 or z.shape[0] != len(problem.unknowns) or not z.shape[1]:
        raise InputError(
            f"z must be ({len(problem.unknowns)}, M) with at least one lane, got {z.shape}"
        )
    sense = np.broadcast_to(np.reshape(direction, (z.shape[0], -1)), z.shape)
    lanes = [_Lane(control.first) for _ in range(z.shape[1])]
    _, slopes = problem.residual(z)
    lines = _null_vectors(slopes, sense)
    for k, lane in enumerate(lanes):
        lane.accept(z[:, k], lines[:, k])
        z[:, k] = lane.ahead
    active = np.arange(z.shape[1])
    while active.size:
        own = [lanes[k] for k in active]
        # one Newton step of every lane per pass: a lane corrects, accepts or retries independently
        z[:, active] = _advance(_of(problem, active), z[:, active], own, control)
        _ask(done, lanes, active)
        active = np.array([k for k in active if not lanes[k].end], dtype=np.intp)
    if finish:
        return _correct_members(problem, lanes, control, exact)
    return [
        Branch(np.array(lane.members).T, np.array(lane.lines).T, ("start", lane.end))
        for lane in lanes
    ]


def _of(problem: Problem, lanes: NDArray[np.intp]) -> Problem:
    return problem.of(lanes) if isinstance(problem, LaneProblem) else problem


def _advance(problem: Problem, z: Array, lanes: list[_Lane], control: StepControl) -> Array:
    """Take one Newton step of every lane and return where each is to be evaluated next."""
    values, slopes = _evaluate(problem, z)
    lines = np.array([lane.lines[-1] for lane in lanes]).T
    feet = np.array([lane.ahead for lane in lanes]).T
    plane, normal = on_planes(lines, feet)(z)
    error = np.max(np.abs(np.concatenate([values, plane])), axis=0)
    usable = np.isfinite(error) & np.all(np.isfinite(slopes), axis=(0, 1))
    new, tangents = z.copy(), lines.copy()
    if np.any(usable):
        # bordered system [F'; tᵀ] of pseudo-arclength, regular at turning points too
        matrix = np.concatenate([slopes, normal])[:, :, usable]
        rhs = np.concatenate([values, plane])[:, usable]
        new[:, usable] -= (np.linalg.pinv(np.moveaxis(matrix, 2, 0)) @ rhs.T[:, :, None])[:, :, 0].T
        tangents[:, usable] = _null_vectors(slopes[:, :, usable], lines[:, usable])
    cosine = np.sum(tangents * lines, axis=0)
    for k, lane in enumerate(lanes):
        converged = bool(usable[k] and error[k] <= max(_COARSE, control.tolerance))
        turned = cosine[k] < np.cos(control.turn)
        # `new` is one Newton step beyond the accepted residual, so that its error is the square of
        # it
        if converged and not turned:
            easy = lane.newton <= _EASY and cosine[k] > np.cos(_QUICK * control.turn)
            lane.accept(new[:, k], tangents[:, k])
            lane.step = min(control.largest, lane.step * (2.0 if easy else 1.0))
            new[:, k] = lane.ahead
            if len(lane.members) >= control.members:
                lane.end = f"stopped after {control.members} members"
            continue
        lane.newton += 1
        # the tangent turned too far, the flow left its domain, or Newton stalls: halve the step
        if converged or not usable[k] or lane.newton > _MOST:
            lane.step, lane.newton = 0.5 * lane.step, 0
            new[:, k] = lane.ahead
            if lane.step < control.smallest:
                lane.end = "no further member: the step collapsed"
    return new


def _ask(done: Done, lanes: list[_Lane], active: NDArray[np.intp]) -> None:
    """Call `done` for the lanes that have just accepted a member, and end them accordingly."""
    fresh = np.array(
        [k for k in active if lanes[k].newton == 0 and len(lanes[k].members) > 1], dtype=np.intp
    )
    if fresh.size:
        last = np.array([lanes[k].members[-1] for k in fresh]).T
        for k, reason in zip(fresh, done(last, fresh), strict=True):
            lanes[k].end = reason or lanes[k].end


def _evaluate(problem: Problem, z: Array) -> tuple[Array, Array]:
    """Return F and dF/dz, NaN for the lanes that are outside the domain of the equations."""
    try:
        return problem.residual(z)
    except PropagationError:
        cases, m = z.shape[1], z.shape[0]
        if cases == 1:
            return np.full((m - 1, 1), np.nan), np.full((m - 1, m, 1), np.nan)
        # the culprit does not say its number: halve until it stands alone
        halves = np.array_split(np.arange(cases), 2)
        parts = [_evaluate(_of(problem, own), z[:, own]) for own in halves]
        rows = max(len(values) for values, _ in parts)
        return (
            np.concatenate([_rows(values, rows) for values, _ in parts], axis=-1),
            np.concatenate([_rows(slopes, rows) for _, slopes in parts], axis=-1),
        )


def _rows(values: Array, rows: int) -> Array:
    """Pad the equations of a lane without values to the number of the other lanes."""
    missing = rows - len(values)
    return np.concatenate([values, np.full((missing, *values.shape[1:]), np.nan)])


def _null_vectors(slopes: Array, along: Array) -> Array:
    """Return unit null vectors (m, N) of dF/dz (k, m, N), in the sense of `along`."""
    # the right singular vector of the smallest singular value spans the null space
    vectors = np.linalg.svd(np.moveaxis(slopes, 2, 0))[2][:, -1, :].T
    return np.asarray(np.where(np.sum(vectors * along, axis=0) < 0.0, -vectors, vectors))


def _correct_members(
    problem: Problem,
    lanes: list[_Lane],
    control: StepControl,
    exact: Callable[[list[Array]], Problem] | None,
) -> list[Branch]:
    """Correct all members of all lanes at once and make the branches."""
    if alone := [str(k) for k, lane in enumerate(lanes) if len(lane.members) < 2]:
        reasons = "; ".join(sorted({lanes[int(k)].end for k in alone}))
        raise ConvergenceError(
            f"no member besides the first of lane {', '.join(alone)} ({reasons}); "
            "try a smaller first step"
        )
    chains = [np.array(lane.members).T for lane in lanes]
    problem = exact(chains) if exact else problem
    z = np.concatenate(chains, axis=1)
    lines = np.array([line for lane in lanes for line in lane.lines]).T
    z = correct(problem, z, on_planes(lines, z), tolerance=control.tolerance, iterations=2).z
    cuts = np.cumsum([len(lane.members) for lane in lanes])[:-1]
    return [
        Branch(np.ascontiguousarray(part), np.ascontiguousarray(line), ("start", lane.end))
        for part, line, lane in zip(
            np.split(z, cuts, axis=1), np.split(lines, cuts, axis=1), lanes, strict=True
        )
    ]
