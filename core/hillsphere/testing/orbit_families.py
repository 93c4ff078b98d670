"""Checks of orbit families: consistent equations, with a curve of solutions that are periodic."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.engine.dynamics.system import system
from hillsphere.engine.dynamics.taylor import Taylor
from hillsphere.interfaces import OrbitFamily
from hillsphere.testing.contract import check_close, derivative_by_differences, require

__all__ = ["check_orbit_family"]

_STEP = 1e-4
"""Step of the differences, in units of the plant: rounding of the propagation (1e-14) becomes
1e-10, and the truncation of sixth order is far smaller."""


def check_orbit_family(family: OrbitFamily, z: ArrayLike, *, tol: float = 1e-7) -> None:
    """Check an orbit family.

    Parameters
    ----------
    family : OrbitFamily
        The family.
    z : array_like, shape (m, N)
        Values of its unknowns, near members or not.
    tol : float
        Largest relative difference between declared and numerical derivatives.

    Raises
    ------
    ContractViolation
        If `family` is not an `OrbitFamily`; if the shapes do not match the unknowns; if dF/dz is
        not the derivative of F; if dF/dz has a rank below m − 1 at a solution; or if a solution of
        F = 0 is not periodic in an independent propagation.
    """
    require(isinstance(family, OrbitFamily), "an orbit family has a plant and a problem")
    problem, how = family.problem
    require(bool(how.strip()), "the family does not say in words how its orbits are found")
    points = np.array(z, dtype=float)
    m, cases = len(problem.unknowns), points.shape[-1]
    require(points.shape == (m, cases), f"unknowns {problem.unknowns}, but z is {points.shape}")
    values, slopes = problem.residual(points)
    k = len(values)
    require(k >= m - 1, f"{k} equations leave more than a curve of {m} unknowns")
    require(slopes.shape == (k, m, cases), f"dF/dz is {slopes.shape}, expected {(k, m, cases)}")
    by_hand = derivative_by_differences(
        lambda at: problem.residual(at)[0], points, np.full(points.shape, _STEP)
    )
    size = np.max(np.abs(slopes), axis=(0, 1))
    check_close("dF/dz", slopes, by_hand, size, tol)

    for _ in range(20):
        values, slopes = problem.residual(points)
        steps = np.linalg.pinv(np.moveaxis(slopes, 2, 0)) @ values.T[:, :, None]
        points = points - steps[:, :, 0].T
    values, slopes = problem.residual(points)
    check_close("F at its solution", values, np.zeros_like(values), 1.0, 1e-10)
    singular = np.linalg.svd(np.moveaxis(slopes, 2, 0), compute_uv=False)
    lowest = float(np.min(singular[:, m - 2] / singular[:, 0]))
    require(lowest > 1e-10, "F does not have rank m − 1 at its solutions: no curve of members")
    start, period = problem.state(points), problem.period(points)
    end = Taylor(system(family.plant, normalised=True)).propagate(start, period)
    check_close("state after a period", end, start, 1.0, 1e-9)
