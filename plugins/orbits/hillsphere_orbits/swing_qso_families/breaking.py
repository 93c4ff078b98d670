"""Symmetry-breaking bifurcations along a symmetric family, and the families that begin there.

At a secondary bifurcation of the kind ``branching`` a pair of planar multipliers passes 1 although
the integral does not turn there: orbits of the same period and less symmetry begin. Those that keep
one of two mirrors are found by half a period still, those that keep none by a full period.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.swing_qso_families.branching import branch_point, first_members
from hillsphere_orbits.swing_qso_families.curves import AXES, at_positions, swing_problem
from hillsphere_orbits.swing_qso_families.families import Chain
from hillsphere_orbits.swing_qso_families.starts import Start

__all__ = ["starts_of_breaking"]

_BESIDE = 1e-2  # of the distance of two orbits of the chain
_NODES = _BESIDE * np.array([-3.0, -1.0, 1.0, 3.0])
_WEIGHTS = np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0  # of the cubic through the nodes, at 0
_NULL = 1e-3  # of the largest singular value: the orbit is as near to the bifurcation as that
_FINER = 2  # sub-steps: a full period is twice the half that the parent was solved over


def starts_of_breaking(flow: Flow, chain: Chain, number: int, u: float) -> list[Start]:
    """Return first members of families that leave a symmetric one at a position of its chain.

    Parameters
    ----------
    flow : Flow
        Equations of motion, normalised.
    chain : Chain
        The symmetric family.
    number : int
        Its number, by which its children name it.
    u : float
        Position of the secondary bifurcation.

    Returns
    -------
    list of Start
        At most one: a branch and its mirror image are the same family. None if nothing is found,
        as where the pair only seems to pass 1.
    """
    start, problem = chain.start, chain.problem(flow)
    # at the branching itself Newton's equations are singular: its neighbours bracket it
    last = chain.branch.size - 1.0
    z = at_positions(
        problem, chain.branch, np.clip(u, 3.0 * _BESIDE, last - 3.0 * _BESIDE) + _NODES
    )
    x, period = problem.state(z), problem.period(z)
    mirrors = [axis for axis in AXES if axis in start.symmetry]
    for axis in mirrors:
        state = x
        # an orbit with two mirrors crosses the other axis a quarter of a period later
        if axis != start.axis:
            state = flow.with_matrix(x, 0.25 * period, _FINER * problem.steps)[0]
        other = next((a for a in mirrors if a != axis), "")
        if not other:
            continue  # the only mirror: what keeps it is no other family of this period
        half = swing_problem(flow, axis).with_steps(problem.steps)
        leaving = _first(half, half.unknowns_at(state, period), _without(flow, other, half))
        if leaving is not None:
            origin, first = leaving
            return [Start(start.d, start.n, axis, 1, axis, number, origin, first)]
    whole = swing_problem(flow, start.axis, mirror=False).with_steps(_FINER * problem.steps)
    leaving = _first(whole, whole.unknowns_at(x, period), _oblique(whole, start.axis))
    if leaving is None:
        return []
    origin, first = leaving
    return [Start(start.d, start.n, start.axis, 1, "none", number, origin, first)]


def _first(
    problem: Shooting, z: Array, apart: Callable[[Array], Array]
) -> tuple[Array, Array] | None:
    """Return the bifurcating orbit and a first member, if any, from its neighbours z (m, 4)."""
    # cubic interpolation of four neighbours at the bifurcation, and the chord as its tangent
    middle, line = z @ _WEIGHTS, z[:, 2] - z[:, 1]
    slopes = problem.residual(middle[:, None])[1]
    size = np.linalg.svd(slopes[:, :, 0], compute_uv=False)
    if np.count_nonzero(size > _NULL * size[0]) + 2 > z.shape[0]:
        return None  # the tangent is the only null vector: nothing branches off here
    point = branch_point(problem, middle, line, null=_NULL)
    if not point.kernel.shape[1]:
        return None
    members, exists = first_members(problem, point, apart)
    return (point.z, members[:, np.argmax(exists)]) if np.any(exists) else None


def _without(flow: Flow, axis: str, problem: Shooting) -> Callable[[Array], Array]:
    """Return how far orbits are from the mirror of the other axis, a quarter of a period on."""
    odd = np.array(flow.system.mirrors[AXES[axis]]) == -1

    def apart(z: Array) -> Array:
        quarter = flow.with_matrix(problem.state(z), 0.25 * problem.period(z), problem.steps)[0]
        return np.asarray(np.linalg.norm(quarter[odd], axis=0))

    return apart


def _oblique(problem: Shooting, axis: str) -> Callable[[Array], Array]:
    """Return how far orbits are from crossing their axis perpendicularly."""
    along = problem.flow.names.index("v" + axis)
    return lambda z: np.asarray(np.abs(problem.state(z)[along]))
