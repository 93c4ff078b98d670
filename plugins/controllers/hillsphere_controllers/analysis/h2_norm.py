r"""The H2 norm: the power of the outputs under white noise of unit intensity.

.. math::

    \|G\|_2^2 = \operatorname{tr}(C P C^\mathsf{T}) = \operatorname{tr}(B^\mathsf{T} Q B), \quad
    A P + P A^\mathsf{T} + B B^\mathsf{T} = 0, \quad
    A^\mathsf{T} Q + Q A + C^\mathsf{T} C = 0,

in discrete time with :math:`A P A^\mathsf{T} - P` and D added [1]_.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   4.4 and 21.4.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.balancing import balanced

__all__ = ["h2_norm"]

_AGREE = 1e-6
_NOTHING = 1e-13


def h2_norm(system: LtiSystem) -> float:
    """Return the H2 norm of a system.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    float
        Its norm; infinite if it is not stable or, in continuous time, has a direct term.

    Raises
    ------
    ConvergenceError
        If the two ways to compute it differ by more than 1e-6 of it.
    """
    if not system.is_stable or (system.dt_s is None and system.d.any()):
        return np.inf
    direct = float(np.sum(system.d**2))
    if system.order == 0 or 0 in system.shape:
        return float(np.sqrt(direct))
    made, _ = balanced(system)
    p, q = _gramian(made.a, made.b, system.dt_s), _gramian(made.a.T, made.c.T, system.dt_s)
    first = direct + float(np.sum((made.c @ p) * made.c))
    second = direct + float(np.sum((q @ made.b) * made.b))
    largest = max(first, second)
    # where inputs reach no output, both are what is left of sums of this size
    size = float(np.sum((np.abs(made.c) @ np.abs(p)) * np.abs(made.c)))
    if largest > _NOTHING * size and abs(first - second) > 2.0 * _AGREE * largest:
        raise ConvergenceError(
            f"the H2 norm is {np.sqrt(max(first, 0.0)):.9g} by one Lyapunov equation and "
            f"{np.sqrt(max(second, 0.0)):.9g} by the other: scale the states, inputs and outputs, "
            "or take poles that hardly matter out"
        )
    return float(np.sqrt(max(0.5 * (first + second), 0.0)))


def _gramian(a: Array, b: Array, dt_s: float | None) -> Array:
    if dt_s is None:
        return np.asarray(solve_continuous_lyapunov(a, -b @ b.T))
    # the direct method has n² unknowns; the bilinear one is as exact
    return np.asarray(solve_discrete_lyapunov(a, b @ b.T, method="bilinear"))
