"""Members of a family at prescribed values, all corrected in lockstep.

`members_at` takes a quantity with a gradient (an amplitude, the period, an integral) as a further
equation of Newton's method; `members_where` takes any function of a member (a stability index) and
brackets its roots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import Problem, correct, tangents
from hillsphere_orbits.roots import brackets, extrema

__all__ = [
    "MembersAtValues",
    "Quantity",
    "coordinate",
    "insert_members",
    "members_at",
    "members_where",
]

Quantity: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""z (m, N) → values (N,), gradients (m, N)."""

_END = 1e-9  # a target this near to the value at an end of the chain is that end


@dataclass(frozen=True)
class MembersAtValues:
    """Members that were found on a branch.

    Parameters
    ----------
    target : ndarray of int, shape (K,)
        Which of the targets each member belongs to; one without members does not appear, one
        that is met several times appears as often.
    z : ndarray, shape (m, K)
        The corrected members, in the order of the targets and along the branch.
    """

    target: NDArray[np.intp]
    z: Array

    def missing(self, targets: int) -> list[int]:
        """Return the numbers, out of `targets`, of those without a member."""
        return sorted(set(range(targets)) - set(self.target.tolist()))


def coordinate(index: int, factor: float = 1.0) -> Quantity:
    """Return the quantity factor · z[index]."""

    def quantity(z: Array) -> tuple[Array, Array]:
        gradient = np.zeros_like(z)
        gradient[index] = factor
        return factor * z[index], gradient

    return quantity


def members_at(
    problem: Problem, branch: Branch, quantity: Quantity, targets: Array
) -> MembersAtValues:
    """Find the members at which a quantity has prescribed values (natural-parameter correction).

    Parameters
    ----------
    problem : Problem
        The equations.
    branch : Branch
        Members in between, dense enough for the quantity to be nearly linear from one to the next.
    quantity : callable
        See `Quantity`.
    targets : ndarray, shape (R,)
        The values; one at the end of the branch counts as reached.

    Returns
    -------
    MembersAtValues
        Every member at every value.

    Raises
    ------
    ConvergenceError
        If a bracketed member cannot be corrected.
    """
    targets = np.atleast_1d(np.asarray(targets, dtype=float))
    values, _ = quantity(branch.z)
    # linear interpolation gives the guess, Newton's method the member itself
    which, u = _positions(values, targets)
    if not which.size:
        return MembersAtValues(which, np.empty((branch.z.shape[0], 0)))
    wanted = targets[which]

    def hold(z: Array) -> tuple[Array, Array]:
        value, gradient = quantity(z)
        return (value - wanted)[None], gradient[None]

    guess, _ = branch.guess(u)
    what, names = "member at a prescribed value", [f"{v:.9g}" for v in wanted]
    z = correct(problem, guess, hold).require_converged(what, names)
    return MembersAtValues(which, branch.near(u, z, what, names))


def insert_members(
    problem: Problem,
    branch: Branch,
    function: Callable[[Array], Array],
    tolerance: float,
    *,
    passes: int = 7,
) -> Branch:
    """Insert members until a function is linear from one to the next, to a tolerance.

    Parameters
    ----------
    problem : Problem
        The equations.
    branch : Branch
        Members; none is removed.
    function : callable
        z (m, N) → (N,); lanes where it is not finite are left as they are.
    tolerance : float
        Largest difference between the function half-way between two members and their mean.
    passes : int
        Halvings of an interval at most.

    Returns
    -------
    Branch
        On which `members_where` overlooks no pair of roots deeper than the tolerance.
    """
    values, z, tangent = function(branch.z), branch.z, branch.tangent
    coarse = np.ones(branch.size - 1, dtype=bool)
    for _ in range(passes):
        left = np.flatnonzero(coarse)
        if not left.size:
            break
        # a corrected member half-way; its value against the mean measures the curvature
        middle = Branch(z, tangent, branch.ends).at(problem, np.asarray(left, dtype=float) + 0.5)
        between = function(middle)
        gap = np.abs(between - 0.5 * (values[left] + values[left + 1]))
        fine = ~(gap > tolerance)
        z = np.insert(z, left + 1, middle, axis=1)
        tangent = np.insert(tangent, left + 1, tangents(problem, middle, tangent[:, left]), axis=1)
        values = np.insert(values, left + 1, between)
        # Both halves of an interval that was bent are looked at again.
        again = np.zeros(coarse.shape, dtype=bool)
        again[left] = ~fine
        coarse = np.repeat(again, np.where(coarse, 2, 1))
    return Branch(z, tangent, branch.ends)


def members_where(
    problem: Problem,
    branch: Branch,
    function: Callable[[Array], Array],
    targets: Array,
    *,
    width: float = 1e-12,
) -> MembersAtValues:
    """Find every member at which a function takes given values.

    Sign changes between neighbouring members bracket the roots; extrema are refined first, so
    that a pair of roots between two members is not overlooked. Each bracket is then narrowed with
    corrected members, all brackets at once.

    Parameters
    ----------
    problem : Problem
        The equations.
    branch : Branch
        Members in between, dense enough that the function has at most one extremum between
        neighbours.
    function : callable
        z (m, N) → (N,).
    targets : ndarray, shape (R,)
        The values.
    width : float
        Brackets are narrowed to this part of the distance of two members.

    Returns
    -------
    MembersAtValues
        Every root.
    """
    targets = np.atleast_1d(np.asarray(targets, dtype=float))

    def at(u: Array) -> Array:
        return function(branch.at(problem, u))

    values = function(branch.z)
    u_bend, f_bend = extrema(at, values)
    places = np.concatenate([np.arange(branch.size), u_bend])
    order = np.argsort(places, kind="stable")
    places, values = places[order], np.concatenate([values, f_bend])[order]
    hits = [(k, i) for k, target in enumerate(targets) for i in brackets(values, float(target))]
    if not hits:
        return MembersAtValues(np.empty(0, dtype=np.intp), np.empty((branch.z.shape[0], 0)))
    which, i = (np.array(column, dtype=np.intp) for column in zip(*hits, strict=True))
    wanted = targets[which]
    u = bracketed_roots(
        lambda u: at(u) - wanted,
        places[i], places[i + 1], values[i] - wanted, values[i + 1] - wanted,
        np.full(wanted.shape, width),
    )  # fmt: skip
    return MembersAtValues(which, branch.at(problem, u))


def _positions(values: Array, targets: Array) -> tuple[NDArray[np.intp], Array]:
    """Return (target, position) wherever the samples pass a target, by linear interpolation."""
    which: list[int] = []
    places: list[float] = []
    for k, target in enumerate(targets):
        inside = brackets(values, float(target))
        if not inside.size:
            near = _END * max(1.0, abs(float(target)))
            ends = [j for j in (0, values.size - 1) if abs(values[j] - target) <= near]
            which += [k] * len(ends)
            places += [float(j) for j in ends]
        for i in inside:
            which.append(k)
            places.append(float(i + (target - values[i]) / (values[i + 1] - values[i])))
    return np.array(which, dtype=np.intp), np.array(places)
