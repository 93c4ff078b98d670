"""Where families of libration orbits end, and where halo orbits branch off."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Boundary
from hillsphere_orbits.members import Quantity
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.winding import resolution, sensitivity

__all__ = ["BRANCHING", "branching", "ends_of", "up_to"]

BRANCHING = "halo orbits branch off"


def up_to(reason: str, amplitude: Quantity, most: float) -> Boundary:
    """Return where an amplitude reaches its largest value."""
    return Boundary(reason, lambda z: most - amplitude(z)[0])


def branching(problem: SymmetricShooting, start: Array) -> Boundary:
    """Return where ∂ż(T/2)/∂z(0) of planar orbits passes zero, beginning at one of them (m, 1)."""

    def kernel(z: Array) -> Array:
        return np.asarray(_half(problem, z)[5, 2])

    sign = float(np.sign(kernel(start)[0]))
    return Boundary(BRANCHING, lambda z: sign * kernel(z))


def ends_of(problem: SymmetricShooting, plant: Plant) -> list[Boundary]:
    """Return the boundaries of a family: the body's surface, and orbits too sensitive to compute.

    Parameters
    ----------
    problem : SymmetricShooting
        Half a period of the orbits.
    plant : Plant
        Whose orbits they are: where its primary is.

    Returns
    -------
    list of Boundary
        The surface, or the last orbit that is resolved about a body without one; and where
        rounding errors grow, over half a period, to the tolerance of Newton's iteration.
    """
    flow = problem.flow

    def way(z: Array) -> Array:
        # both halves of an orbit are each other's mirror image
        return flow.trajectory(problem.state(z), z[-1], 2 * problem.steps)

    sensitive = sensitivity(problem)
    if "impact" not in flow.system.events:
        return [resolution(problem, plant), sensitive]
    level = flow.system.function(flow.system.events["impact"])

    def clearance(z: Array) -> Array:
        states = way(z)
        n, points, cases = states.shape
        flat = np.ascontiguousarray(states.reshape(n, points * cases))
        values = level(flat, flow.system.parameters(None, points * cases))[0]
        return np.asarray(np.min(values.reshape(points, cases), axis=0))

    return [Boundary("the orbit grazes the surface", clearance), sensitive]


def _half(problem: SymmetricShooting, z: Array) -> Array:
    """Return the matrices (n, n, N) of half a period."""
    return problem.flow.with_matrix(problem.state(z), z[-1], problem.steps)[1]
