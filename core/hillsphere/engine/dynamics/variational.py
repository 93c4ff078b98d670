"""Exact first derivatives of a system, and its variational equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction, each
from hillsphere.engine.dynamics.system import System
from hillsphere.symbolic.expressions import Expr, is_zero, jacobian, parameter, sum_of, variable

__all__ = ["Derivatives", "variational_equations"]


def variational_equations(
    system: System, parameters: Sequence[str] = ()
) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
    """Extend a system by its variational equations.

    With A = ∂f/∂x and B = ∂f/∂p, the derivatives Φ = ∂x/∂x₀ and Ψ = ∂x/∂p obey

        Φ̇ = A Φ, Φ(t₀) = 1;   Ψ̇ = A Ψ + B, Ψ(t₀) = 0.

    Parameters
    ----------
    system : System
        n equations, wholly symbolic.
    parameters : sequence of str
        Names of k run-time parameters by which to differentiate too.

    Returns
    -------
    x : tuple of Expr
        The n states, then the n × (n + k) derivatives [Φ Ψ] row by row.
    rhs : tuple of Expr
        Their time derivatives.

    Raises
    ------
    InputError
        If the system has terms that are functions of arrays, or a parameter is not at run time.
    """
    if system.external is not None:
        raise InputError("variational equations need a wholly symbolic system")
    _check(system, parameters)
    n, columns = len(system.x), len(system.x) + len(parameters)
    rows = jacobian(system.rhs, [*system.x, *(parameter(name) for name in parameters)])
    phi = [[variable(f"d{i},{j}") for j in range(columns)] for i in range(n)]
    # Row i of A Φ, and of A Ψ + B in the columns of the parameters (j ≥ n).
    rates: list[Expr] = []
    for row in rows:
        # Most of A is zero for equations of motion: structural zeros never reach the compiler.
        filled = [k for k in range(n) if not is_zero(row[k])]
        for j in range(columns):
            terms = [row[k] * phi[k][j] for k in filled]
            rates.append(sum_of([*terms, row[j]] if j >= n else terms))
    return (*system.x, *(e for line in phi for e in line)), (*system.rhs, *rates)


class Derivatives:
    """The right-hand side of a system and its exact Jacobian, as functions of arrays.

    Parameters
    ----------
    system : System
        n equations.
    parameters : sequence of str
        Names of k run-time parameters (or controls, ``"u:" + name``) by which to differentiate
        too.

    Raises
    ------
    InputError
        If a parameter is not a run-time parameter.

    Notes
    -----
    Terms g that are functions of arrays enter by the chain rule, A = ∂f/∂x + ∂f/∂g ∂g/∂x. In such a
    system derivatives by parameters other than controls are refused, since ∂g/∂p is unknown.
    """

    def __init__(self, system: System, parameters: Sequence[str] = ()) -> None:
        _check(system, parameters)
        external = system.external
        if external and (bad := [q for q in parameters if not q.startswith("u:")]):
            raise InputError(f"terms that are functions of arrays may depend on {bad}")
        self._n, self._columns = len(system.x), len(system.x) + len(parameters)
        self._system, self._external = system, external
        outside = external.variables if external else ()
        inputs = (*system.x, *outside)
        by = [*system.x, *(parameter(name) for name in parameters), *outside]
        entries = [e for row in jacobian(system.rhs, by) for e in row]
        names = system.run_time_names
        self._rate = ArrayFunction(system.rhs, inputs, names)
        self._both = ArrayFunction([*system.rhs, *entries], inputs, names)

    def rate(self, x: ArrayLike, p: ArrayLike | None = None, t: ArrayLike = 0.0) -> Array:
        """Evaluate the right-hand side f.

        Parameters
        ----------
        x : array_like, shape (n, N)
            States, in the system's units.
        p : array_like, shape (k,) or (k, N), optional
            Run-time parameters, SI; nominal if absent.
        t : array_like, shape (N,) or scalar
            Time.

        Returns
        -------
        numpy.ndarray, shape (n, N)
            Time derivatives.
        """
        states, q, times = self._arguments(x, p, t)
        if self._external is not None:
            states = np.concatenate([states, self._external.values(states, times, q)])
        return self._rate(states, q, times)

    def both(
        self, x: ArrayLike, p: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]:
        """Evaluate f and its derivatives.

        Parameters
        ----------
        x, p, t : array_like
            As for `rate`.

        Returns
        -------
        rate : numpy.ndarray, shape (n, N)
            Time derivatives.
        jacobian : numpy.ndarray, shape (n, n + k, N)
            Their derivatives by the states, then by the parameters.
        """
        states, q, times = self._arguments(x, p, t)
        n, columns, external = self._n, self._columns, self._external
        if external is None:
            values = self._both(states, q, times)
            return values[:n], values[n:].reshape(n, columns, -1)
        terms = external.values(states, times, q)
        values = self._both(np.concatenate([states, terms]), q, times)
        table = values[n:].reshape(n, columns + len(terms), -1)
        result = table[:, :columns].copy()
        inner = external.jacobian(states, times, q)
        result[:, :n] += np.einsum("igN,gjN->ijN", table[:, columns:], inner)
        return values[:n], result

    def _arguments(
        self, x: ArrayLike, p: ArrayLike | None, t: ArrayLike
    ) -> tuple[Array, Array, Array]:
        states = np.ascontiguousarray(x, dtype=float)
        if states.ndim != 2 or len(states) != self._n:
            raise InputError(f"x must be ({self._n}, N), got {states.shape}")
        cases = states.shape[1]
        return states, self._system.parameters(p, cases), each(t, cases)


def _check(system: System, parameters: Sequence[str]) -> None:
    if missing := [name for name in parameters if name not in system.run_time_names]:
        have = list(system.run_time_names)
        raise InputError(f"derivatives by {missing}: the run-time parameters are {have}")
