r"""Minimal realisation: the controllable and observable part of a system.

The controllable subspace is built block by block, B, A B, A² B …, each block orthogonal to those
before it [1]_; the observable part is that of the transposed system.

References
----------
.. [1] C. C. Paige (1981), Properties of numerical algorithms related to computing controllability,
   IEEE Transactions on Automatic Control 26(1), 130-138.
"""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["minimal_realisation"]


def minimal_realisation(system: LtiSystem, tolerance: float = 1e-9) -> LtiSystem:
    """Return the controllable and observable part of a system.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.
    tolerance : float
        Singular values of a block below this share of its size count as zero. Transfer functions
        have about ten correct digits where their coefficients have sixteen.

    Returns
    -------
    LtiSystem
        With the same transfer matrix. The system as it is, with its states, if it is minimal.

    Raises
    ------
    InputError
        If the tolerance is not between 0 and 1.
    """
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance must be between 0 and 1, got {tolerance}")
    scaled, _ = balance_states(system)
    v = _reachable_basis(scaled.a, scaled.b, tolerance)
    a, b, c = v.T @ scaled.a @ v, v.T @ scaled.b, scaled.c @ v
    w = _reachable_basis(a.T, c.T, tolerance)
    if w.shape[1] == system.order:
        return system
    return LtiSystem(
        w.T @ a @ w, w.T @ b, c @ w, system.d, system.dt_s, system.inputs, system.outputs
    )


def _reachable_basis(a: Array, b: Array, tolerance: float) -> Array:
    """Return an orthonormal basis (n, r) of the controllable subspace of (A, B)."""
    n = len(a)
    basis, block = np.zeros((n, 0)), b
    size = max(float(np.linalg.norm(a)), 1.0)
    while block.shape[1] and basis.shape[1] < n:
        # B counts relative to itself, A times a unit vector relative to A
        scale = float(np.linalg.norm(block)) if basis.shape[1] == 0 else size
        for _ in range(2):  # the second pass removes what rounding left of the first
            block = block - basis @ (basis.T @ block)
        u, values, _ = np.linalg.svd(block, full_matrices=False)
        new = u[:, values > tolerance * scale]
        basis = np.hstack([basis, new])
        block = a @ new
    return basis
