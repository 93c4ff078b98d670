"""Systems of lower order by balanced truncation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import schur, solve_sylvester

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gramians import lyapunov_solution
from hillsphere_controllers.systems.algebra import parallel
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["balanced_truncation"]


def balanced_truncation(system: LtiSystem, order: int) -> LtiSystem:
    """Reduce a system by balanced truncation: drop the states of the smallest Hankel values.

    Unstable states are kept.

    Parameters
    ----------
    system : LtiSystem
        In discrete time its bilinear image is reduced.
    order : int
        Of what is left; larger if there are more unstable states.

    Returns
    -------
    LtiSystem
        The reduced system, of the same inputs and outputs.

    Raises
    ------
    InputError
        If the order is negative.
    """
    if order < 0:
        raise InputError(f"an order must be ≥ 0, got {order}")
    if system.dt_s is not None:
        return discrete(balanced_truncation(continuous(system), order), system.dt_s)
    if order >= system.order:
        return system
    stable, rest = _split(system)
    kept = min(max(order - rest.order, 0), stable.order)
    reach = lyapunov_solution(stable.a, stable.b @ stable.b.T)
    see = lyapunov_solution(stable.a.T, stable.c.T @ stable.c)
    left, right = _root(reach), _root(see)
    # square-root method: the singular values are the Hankel singular values
    u, values, v = np.linalg.svd(right.T @ left)
    kept = min(kept, int(np.sum(values > 1e-14 * values.max(initial=1e-300))))
    scale = np.sqrt(values[:kept])
    into, back = left @ v[:kept].T / scale, right @ u[:, :kept] / scale
    small = LtiSystem(back.T @ stable.a @ into, back.T @ stable.b, stable.c @ into, stable.d)
    made = parallel(small, rest) if rest.order else small
    return replace(made, inputs=system.inputs, outputs=system.outputs)


def _split(system: LtiSystem) -> tuple[LtiSystem, LtiSystem]:
    """Return the sum's stable part, with the direct term, and the unstable one."""
    t, z, count = schur(system.a, sort="lhp")
    b, c = z.T @ system.b, system.c @ z
    first, last = slice(0, count), slice(count, None)
    # block-diagonalise the ordered Schur form
    x = solve_sylvester(t[first, first], -t[last, last], -t[first, last])
    stable = LtiSystem(t[first, first], b[first] - x @ b[last], c[:, first], system.d)
    rest = LtiSystem(t[last, last], b[last], c[:, last] + c[:, first] @ x, np.zeros_like(system.d))
    return stable, rest


def _root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
