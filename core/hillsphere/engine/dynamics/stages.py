"""One Runge–Kutta step of many lanes at once, compiled as a whole or evaluated stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.system import System
from hillsphere.engine.dynamics.tableaux import Tableau
from hillsphere.engine.dynamics.variational import Derivatives, variational_equations
from hillsphere.symbolic._heyoka import heyoka as _hy
from hillsphere.symbolic.compile_cache import kept_function
from hillsphere.symbolic.expressions import (
    Expr,
    parameter,
    substitute,
    sum_of,
    time,
    variable,
    variable_names,
)

__all__ = ["ArrayStages", "CompiledStep", "Stepper"]

_VECTOR = int(_hy.recommended_simd_size())
"""Lanes of one vector of the processor."""
_TOGETHER = 2
"""Vectors that a step without derivatives evaluates at once, so that their divisions and square
roots overlap: 12 % less time for an ellipsoid's field, 25 % for a point mass. Bits are the same."""
_PARAMETER, _STEP, _TIME = "p,", "h,", "t,"
"""Names of inputs of a step, with a comma, which no state's name has."""
Advance = Callable[[Array, Array, Array], None]
"""(y, out, t): advance `y` (rows, N) from times t (N,) by one step and write it to `out`."""


class Stepper(Protocol):
    """One step of a fixed formula."""

    rows: int
    """Number of rows: n, or n + n(n + k) with derivatives."""
    needs_time: bool
    """Whether steps depend on time; otherwise callers need not compute it."""

    def bind(self, h: Array, p: Array) -> Advance:
        """Fix the steps h (N,) and run-time parameters p (k, N) of the lanes."""
        ...

    def bind_measured(self, h: Array, p: Array) -> Advance:
        """Fix them for steps with an error estimate.

        Two additional rows are written: the squares of two estimates, from which `error` follows.
        """
        ...

    def error(self, squares: Array) -> Array:
        """Return estimates (…, N) of the errors of steps from their two last rows (…, 2, N).

        An estimate is the Euclidean norm over all states in units of ``system.errors_in``.
        """
        ...


class CompiledStep:
    """A whole step composed symbolically and compiled as one function.

    The stages are substituted into one another, so that the compiler receives one straight-line
    program: common subexpressions of a stage are evaluated once, nothing is stored between
    stages, and a step is a single call. Run-time parameters, the step h and the time follow the
    states as inputs of the function; time enters stage i as t + c_i h. A call whose parameters
    and time are separate arguments, as the compile layer has them too, takes three times as long.

    Separate terms of time alone are further inputs, one for each different c_i. They are computed
    before each step, only once if all lanes have the same time.

    Parameters
    ----------
    system : System
        Wholly symbolic.
    tableau : Tableau
        The formula.
    derivatives : bool
        Whether the variational equations are carried along.
    parameters : sequence of str
        Run-time parameters by which to differentiate too.
    compact : bool
        Compile in compact mode.
    errors : bool
        Whether the function also computes the squares of the two embedded error estimates, in two
        additional rows. The states are unaffected.
    """

    def __init__(
        self,
        system: System,
        tableau: Tableau,
        derivatives: bool,
        parameters: Sequence[str],
        compact: bool,
        errors: bool = False,
    ) -> None:
        self._tableau, self._errors = tableau, errors
        if errors and derivatives:
            raise InputError("the error of a step is estimated without derivatives only")
        if derivatives and system.time_terms:
            raise InputError("derivatives need a system without terms of time that stand apart")
        self._terms = _TimeTerms(system, tableau) if system.time_terms else None

        moving = _TIME in variable_names(substitute(system.rhs, {time: variable(_TIME)}))
        self.needs_time: bool = moving or self._terms is not None

        def compiled() -> Any:
            y, rate = (
                variational_equations(system, parameters) if derivatives else (system.x, system.rhs)
            )
            h, when = variable(_STEP), variable(_TIME)
            numbered = [variable(f"{_PARAMETER}{i}") for i in range(len(system.run_time))]
            table = {
                parameter(name): one
                for name, one in zip(system.run_time_names, numbered, strict=True)
            }
            rate = substitute(rate, {time: when, **table})
            held = self._terms.at_nodes() if self._terms else {}
            step = _compose(y, rate, tableau, h, when, held, system if errors else None)
            apart = self._terms.inputs if self._terms else []
            inputs = [*y, *numbered, h, when, *apart]
            return _hy.cfunc(step, vars=inputs, compact_mode=compact, batch_size=self._lanes)

        self._lanes = _VECTOR if derivatives else _TOGETHER * _VECTOR
        n = len(system.x)
        self.rows = n + n * (n + len(parameters)) if derivatives else n
        options = {
            "formula": [tableau.a.tolist(), tableau.b.tolist(), tableau.c.tolist()],
            "states": n,
            "run_time": system.run_time_names,
            "derivatives": derivatives,
            "parameters": list(parameters),
            "compact": compact,
            "time_terms": list(system.time_terms),
        }
        if errors:
            weights = [one.tolist() for one in tableau.errors]
            options["errors"] = [*weights, system.errors_in.tolist(), list(system.passing)]
        self._function: Any = kept_function(options, (*system.x, *system.rhs), compiled)

    def bind(self, h: Array, p: Array) -> Advance:
        """Fix the steps h (N,) and run-time parameters p (k, N) of the lanes."""
        whole = self._bind(h, p)
        if not self._errors:
            return whole
        buffer = np.empty((self.rows + 2, len(h)))

        def advance(y: Array, out: Array, t: Array) -> None:
            whole(y, buffer, t)
            np.copyto(out, buffer[:-2])

        return advance

    def bind_measured(self, h: Array, p: Array) -> Advance:
        """Fix them for steps with an error estimate, see `Stepper.bind_measured`."""
        if not self._errors:
            raise InputError("an error estimate needs a step map made with errors=True")
        return self._bind(h, p)

    def error(self, squares: Array) -> Array:
        """Return the errors of steps, see `Stepper.error`."""
        return self._tableau.step_error(squares[..., 0, :], squares[..., 1, :])

    def _bind(self, h: Array, p: Array) -> Advance:
        function, terms, moving = self._function, self._terms, self.needs_time
        cases, after = len(h), self.rows + len(p)
        width = _pad_lanes(cases, self._lanes)
        # the unused lanes hold ones, of which nothing is read
        inputs = np.ones((function.nvars, width))
        states, clock, held = (
            inputs[some, :cases] for some in (slice(self.rows), after + 1, slice(after + 2, None))
        )
        inputs[self.rows : after, :cases], inputs[after, :cases] = p, h
        together = terms is not None and terms.same(h)
        result = None if width == cases else np.empty((function.nouts, width))

        def advance(y: Array, out: Array, t: Array) -> None:
            states[...] = y
            if moving:
                clock[...] = t
            if terms is not None:
                some = slice(1) if together and terms.same(t) else slice(None)
                held[...] = terms(t[some], h[some])
            if result is None:
                function(inputs, out)
            else:
                function(inputs, result)
                out[...] = result[:, :cases]

        return advance


class _TimeTerms:
    """Terms of time alone at the nodes of a formula."""

    def __init__(self, system: System, tableau: Tableau) -> None:
        self._names = list(system.time_terms)
        self._nodes = np.unique(tableau.c)
        when = variable("when")
        terms = substitute(tuple(system.time_terms.values()), {time: when})
        self._function = ArrayFunction(terms, [when])
        self.rows = len(self._names) * len(self._nodes)

    @property
    def inputs(self) -> list[Expr]:
        """Inputs of a step that represent the terms at the nodes, in the order of their values."""
        return [self._input(name, node) for name in self._names for node in self._nodes.tolist()]

    def at_nodes(self) -> dict[float, dict[Expr, Expr]]:
        """Return what replaces the terms at each node."""
        return {
            node: {parameter(name): self._input(name, node) for name in self._names}
            for node in self._nodes.tolist()
        }

    def _input(self, name: str, node: float) -> Expr:
        return variable(f"{_PARAMETER}{name},{node}")

    def __call__(self, t: Array, h: Array) -> Array:
        """Return their values (rows, N) in steps h (N,) from times t (N,)."""
        times = self._nodes[:, None] * h + t
        return self._function(times.reshape(1, -1)).reshape(self.rows, len(t))

    @staticmethod
    def same(values: Array) -> bool:
        """Return whether all lanes have equal values."""
        return bool((values == values[:1]).all())


def _compose(
    y: Sequence[Expr],
    rate: Sequence[Expr],
    tableau: Tableau,
    h: Expr,
    when: Expr,
    held: Mapping[float, Mapping[Expr, Expr]],
    measured: System | None,
) -> list[Expr]:
    """Return the state one step of length h after time `when`, as expressions of that before it.

    `held` gives the separate terms of time at each node; it is empty without such terms. If
    `measured` is a system, the squares of both embedded estimates in its scales are appended.
    """
    slopes: list[tuple[Expr, ...]] = []
    for i, node in enumerate(tableau.c.tolist()):
        # Slope k_i at the stage's state y + h Σ_j a_ij k_j and time t + c_i h.
        table: dict[Expr, Expr] = dict(held.get(node, {}))
        for j, state in enumerate(y):
            terms = [w * slopes[m][j] for m, w in _weights(tableau.a[i])]
            if terms:
                table[state] = state + h * sum_of(terms)
        if node:
            table[when] = when + node * h
        slopes.append(substitute(rate, table) if table else tuple(rate))
    final = _weights(tableau.b)
    step = [s + h * sum_of([w * slopes[m][j] for m, w in final]) for j, s in enumerate(y)]
    if measured is None:
        return step
    # An embedded estimate is h Σ e_i k_i, here as the square of its norm in scaled states.
    for weights in tableau.errors:
        parts = [
            h * sum_of([w / size * slopes[m][j] for m, w in _weights(weights)])
            for j, size in enumerate(measured.errors_in.tolist())
        ]
        for j in measured.passing:
            parts[j] = h * parts[j]
        step.append(sum_of([part * part for part in parts]))
    return step


def _pad_lanes(cases: int, together: int) -> int:
    """Return the number of lanes to evaluate: one, or a multiple of those evaluated together.

    Four lanes take one and a half times as long as a lane alone, eight twice. Their functions
    differ from those of a single lane in their last bits, so that lanes left over would depend on
    their place.
    """
    return cases if cases < 2 else -(-cases // together) * together


def _weights(row: Array) -> list[tuple[int, float]]:
    return [(m, w) for m, w in enumerate(row.tolist()) if w]


class ArrayStages:
    """A step evaluated stage by stage in numpy, for systems with terms that are array functions.

    Parameters
    ----------
    system : System
        Equations.
    tableau : Tableau
        The formula.
    derivatives : bool
        Whether the variational equations are carried along.
    parameters : sequence of str
        Run-time parameters (controls) by which to differentiate too.
    """

    needs_time = True

    def __init__(
        self, system: System, tableau: Tableau, derivatives: bool, parameters: Sequence[str]
    ) -> None:
        self._n, self._tableau, self._derivatives = len(system.x), tableau, derivatives
        self._columns = self._n + len(parameters) if derivatives else 0
        self._functions = Derivatives(system, parameters)
        self.rows = self._n * (1 + self._columns)
        self._scale, self._passing = system.errors_in, list(system.passing)

    def bind(self, h: Array, p: Array) -> Advance:
        """Fix the steps h (N,) and run-time parameters p (k, N) of the lanes."""
        advance = self._bind(h, p)

        def plain(y: Array, out: Array, t: Array) -> None:
            advance(y, out, t)

        return plain

    def bind_measured(self, h: Array, p: Array) -> Advance:
        """Fix them for steps with an error estimate, see `Stepper.bind_measured`."""
        advance, size = self._bind(h, p), self._scale[:, None]

        def measured(y: Array, out: Array, t: Array) -> None:
            slopes = advance(y, out[:-2], t)
            for i, weights in enumerate(self._tableau.errors, start=self.rows):
                total = np.zeros_like(slopes[0][: self._n])
                for m, w in _weights(weights):
                    total += (w * h) * slopes[m][: self._n]
                total[self._passing] *= h
                np.sum((total / size) ** 2, axis=0, out=out[i])

        return measured

    def error(self, squares: Array) -> Array:
        """Return the errors of steps, see `Stepper.error`."""
        return self._tableau.step_error(squares[..., 0, :], squares[..., 1, :])

    def _bind(self, h: Array, p: Array) -> Callable[[Array, Array, Array], list[Array]]:
        tableau = self._tableau

        def advance(y: Array, out: Array, t: Array) -> list[Array]:
            slopes: list[Array] = []
            for i, node in enumerate(tableau.c.tolist()):
                # Slope k_i at the stage's state y + h Σ_j a_ij k_j and time t + c_i h.
                at = y.copy()
                for m, w in _weights(tableau.a[i]):
                    at += (w * h) * slopes[m]
                slopes.append(self._slope(at, p, t + node * h))
            np.copyto(out, y)
            for m, w in _weights(tableau.b):
                out += (w * h) * slopes[m]
            return slopes

        return advance

    def _slope(self, y: Array, p: Array, t: Array) -> Array:
        n = self._n
        if not self._derivatives:
            return self._functions.rate(y, p, t)
        # Variational equations: Φ̇ = A Φ and, in the columns of the parameters, Ψ̇ = A Ψ + B.
        rate, jacobian = self._functions.both(y[:n], p, t)
        phi = y[n:].reshape(n, self._columns, -1)
        change = np.einsum("ikN,kjN->ijN", jacobian[:, :n], phi)
        change[:, n:] += jacobian[:, n:]
        return np.concatenate([rate, change.reshape(n * self._columns, -1)])
