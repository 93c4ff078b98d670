"""Expressions compiled to functions of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.symbolic._heyoka import heyoka as _hy
from hillsphere.symbolic.expressions import Expr, parameter, parameter_names, variable_names

__all__ = ["ArrayFunction", "Terms"]

_VECTORS = 4
"""Vectors of the processor that a function evaluates together, so that their divisions and square
roots overlap: the ellipsoid's field takes a third less time than with one. Results do not depend
on it."""
Terms: TypeAlias = Callable[[Array, Array, Array], Array]
"""(x (n, N), t (N,), p (k, N)) → (m, N): values of terms that are functions of arrays."""


class ArrayFunction:
    """m expressions of n variables as one compiled function of arrays.

    Parameters
    ----------
    expressions : sequence of Expr
        The m outputs.
    inputs : sequence of Expr
        The n variables, in the order of the rows of `x`.
    run_time : sequence of str
        Names of the k run-time parameters, in the order of the rows of `p`.
    compact : bool
        Compile in compact mode: slower code, far shorter compilation for huge expressions.
    terms : tuple of (sequence of Expr, Terms), optional
        Further variables, and the function of arrays that gives their values at each call.

    Raises
    ------
    InputError
        If an expression holds a variable or parameter that is not listed.

    Notes
    -----
    A call has an overhead of about 4 µs, independent of N: pass arrays instead of looping over
    points. The function is thread-safe.
    """

    def __init__(
        self,
        expressions: Sequence[Expr],
        inputs: Sequence[Expr],
        run_time: Sequence[str] = (),
        *,
        compact: bool = False,
        terms: tuple[Sequence[Expr], Terms] | None = None,
    ) -> None:
        outside = () if terms is None else tuple(terms[0])
        self._terms = None if terms is None else terms[1]
        names = variable_names([*inputs, *outside])
        if unknown := sorted(set(variable_names(expressions)) - set(names)):
            raise InputError(f"expressions hold variables that are not inputs: {unknown}")
        if unknown := sorted(set(parameter_names(expressions)) - set(run_time)):
            raise InputError(f"expressions hold parameters that are not listed: {unknown}")
        self.n_in, self.n_out, self.n_par = len(inputs), len(expressions), len(run_time)
        numbered = {parameter(name): _hy.par[i] for i, name in enumerate(run_time)}
        outputs = list(expressions)
        if numbered:
            outputs = _hy.subs(outputs, numbered)
        self._function: Any = _hy.cfunc(
            outputs,
            vars=[*inputs, *outside],
            compact_mode=compact,
            batch_size=_VECTORS * _hy.recommended_simd_size(),
        )
        # functions of their inputs alone are called without a look at the rest
        self._is_plain = not (
            terms is not None or self._function.nparams or self._function.is_time_dependent
        )

    def __call__(self, x: ArrayLike, p: ArrayLike | None = None, t: ArrayLike = 0.0) -> Array:
        """Evaluate the expressions.

        Parameters
        ----------
        x : array_like, shape (n, N) or (n,)
            Inputs.
        p : array_like, shape (k, N) or (k,), optional
            Run-time parameters; one column serves all cases.
        t : array_like, shape (N,) or scalar
            Time, used if the expressions hold it.

        Returns
        -------
        numpy.ndarray, shape (m, N) or (m,)
            Outputs.
        """
        inputs = np.ascontiguousarray(x, dtype=float)
        if self._is_plain and inputs.ndim == 2 and len(inputs) == self.n_in:
            plain: Array = self._function(inputs)
            return plain
        if inputs.shape[0] != self.n_in or inputs.ndim > 2:
            raise InputError(f"x must be ({self.n_in}, N), got {inputs.shape}")
        single = inputs.ndim == 1
        if single:
            inputs = inputs[:, None]
        cases = inputs.shape[1]
        if self._terms is not None:
            given = np.zeros(0) if p is None and not self.n_par else p
            values = self._terms(inputs, each(t, cases), spread(given, self.n_par, cases, "p"))
            inputs = np.concatenate([inputs, values])
        options: dict[str, Any] = {}
        if self._function.nparams:
            options["pars"] = spread(p, self.n_par, cases, "p")[: self._function.nparams]
        if self._function.is_time_dependent:
            options["time"] = each(t, cases)
        result: Array = self._function(inputs, **options)
        return result[:, 0] if single else result


def spread(values: ArrayLike | None, rows: int, cases: int, name: str) -> Array:
    """Broadcast parameters given as (k,) or (k, N) to a contiguous (k, N)."""
    if values is None:
        raise InputError(f"{name}: {rows} run-time parameters are needed, none given")
    array = np.asarray(values, dtype=float)
    if array.ndim == 1:
        array = array[:, None]
    if array.shape[0] != rows or array.shape[1] not in (1, cases):
        raise InputError(f"{name} must be ({rows},) or ({rows}, {cases}), got {array.shape}")
    if array.shape[1] == cases:
        return np.ascontiguousarray(array)
    return np.ascontiguousarray(np.broadcast_to(array, (rows, cases)))


def each(t: ArrayLike, cases: int) -> Array:
    """Broadcast times given as a number or (N,) to a contiguous (N,)."""
    array = np.asarray(t, dtype=float)
    if array.shape != (cases,):  # numpy takes longer to broadcast than a small function to compute
        array = np.broadcast_to(array, (cases,))
    return np.ascontiguousarray(array)
