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

from hillsphere.errors import ConvergenceError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gramians import gramian
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["h2_norm", "h2_rounding"]

_AGREE = 1e-6
"""Relative difference of the norms from the two Gramians up to which the norm is trusted."""
_NOTHING = 1e-13
"""Rounding of the squares relative to the sum of the sizes of their terms: a norm below it is zero
but for cancellation."""


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
    first, second, size = _squares(system)
    largest = max(first, second)
    if largest > _NOTHING * size and abs(first - second) > 2.0 * _AGREE * largest:
        raise ConvergenceError(
            f"the H2 norm is {np.sqrt(max(first, 0.0)):.9g} by one Lyapunov equation and "
            f"{np.sqrt(max(second, 0.0)):.9g} by the other: scale the states, inputs and outputs, "
            "or take poles that hardly matter out"
        )
    return float(np.sqrt(max(0.5 * (first + second), 0.0)))


def h2_rounding(system: LtiSystem) -> float:
    """Return the H2 norm below which a result is rounding, from the parts that cancel.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    float
        Size of the rounding, in the unit of the norm.
    """
    if system.order == 0 or 0 in system.shape:
        return 0.0
    return float(np.sqrt(_NOTHING * _squares(system)[2]))


def _squares(system: LtiSystem) -> tuple[float, float, float]:
    """Return the norm's square by both Gramians, and the sum of the sizes of its terms."""
    made, _ = balance_states(system)
    direct, discrete = float(np.sum(system.d**2)), system.dt_s is not None
    p = gramian(made.a, made.b @ made.b.T, discrete=discrete)
    q = gramian(made.a.T, made.c.T @ made.c, discrete=discrete)
    # where inputs reach no output, both are what is left of sums of this size
    size = direct + float(np.sum((np.abs(made.c) @ np.abs(p)) * np.abs(made.c)))
    return (
        direct + float(np.sum((made.c @ p) * made.c)),
        direct + float(np.sum((q @ made.b) * made.b)), size,
    )  # fmt: skip
