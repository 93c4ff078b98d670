r"""Normalised coprime factorisations, P = N M⁻¹ = M̃⁻¹ Ñ.

.. math::

    M^* M + N^* N = I, \qquad \tilde M \tilde M^* + \tilde N \tilde N^* = I

on the imaginary axis, all four factors stable [1]_. The columns of [N; M] span the graph of the
system.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall,
   section 13.8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import NotStabilisableError
from hillsphere_controllers.full_order.riccati import stabilising_solution
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["CoprimeFactors", "coprime_factors", "coprime_riccati"]


@dataclass(frozen=True)
class CoprimeFactors:
    """Normalised coprime factors of a system of p outputs and m inputs, as graph symbols.

    Parameters
    ----------
    right : LtiSystem
        [N; M], (p + m) × m, inner.
    left : LtiSystem
        [−M̃ Ñ], p × (p + m), co-inner; its product with `right` is zero.
    """

    right: LtiSystem
    left: LtiSystem


def coprime_riccati(system: LtiSystem) -> tuple[Array, Array]:
    """Return the solutions X and Z (n, n) of the control and the filter Riccati equation.

    Parameters
    ----------
    system : LtiSystem
        In continuous time.

    Raises
    ------
    NotStabilisableError
        If there are none: a mode that is not stable cannot be controlled or is not observed.
    """
    a, b, c, d = system.a, system.b, system.c, system.d
    p, m = system.shape
    r, s = np.eye(m) + d.T @ d, np.eye(p) + d @ d.T
    inner = a - b @ np.linalg.solve(r, d.T @ c)
    into, out = b @ np.linalg.solve(r, b.T), c.T @ np.linalg.solve(s, c)
    x = stabilising_solution(inner, -into, out)
    z = stabilising_solution(inner.T, -out, into)
    if x is None or z is None:
        raise NotStabilisableError(
            "the system has no normalised coprime factors: a mode that is not stable is not "
            "controlled by its inputs or not seen in its outputs"
        )
    return x, z


def coprime_factors(system: LtiSystem) -> CoprimeFactors:
    """Return the normalised right and left coprime factors of a system in continuous time.

    Raises
    ------
    NotStabilisableError
        As `coprime_riccati`.
    """
    even, _ = balance_states(system)
    a, b, c, d = even.a, even.b, even.c, even.d
    p, m = even.shape
    x, z = coprime_riccati(even)
    r, s = np.eye(m) + d.T @ d, np.eye(p) + d @ d.T
    f = -np.linalg.solve(r, b.T @ x + d.T @ c)
    h = -np.linalg.solve(s, (b @ d.T + z @ c.T).T).T
    # R = U Uᵀ: U⁻ᵀ is a root of R⁻¹ for the columns of [N; M], V⁻¹ one for the rows of [−M̃ Ñ]
    root = np.linalg.inv(np.linalg.cholesky(r)).T
    left_root = np.linalg.inv(np.linalg.cholesky(s))
    return CoprimeFactors(
        LtiSystem(
            a + b @ f, b @ root, np.vstack([c + d @ f, f]), np.vstack([d @ root, root])
        ),
        LtiSystem(
            a + h @ c, np.hstack([-h, b + h @ d]), left_root @ c,
            left_root @ np.hstack([-np.eye(p), d]),
        ),
    )  # fmt: skip
