"""Linear compensators given by their matrices."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Variable
from hillsphere.symbolic import Expr, constant, sum_of
from hillsphere_controllers.specs import Matrix, StateSpaceSpec
from hillsphere_controllers.systems.holding import zero_order_hold_matrices

__all__ = [
    "ContinuousStateSpace",
    "SampledStateSpace",
    "error_feedback",
    "state_space",
    "zero_order_hold_matrices",
]  # fmt: skip


def state_space(spec: StateSpaceSpec) -> SampledStateSpace | ContinuousStateSpace:
    """Make the compensator: of a sampled law, or one whose states move between samples."""
    return ContinuousStateSpace(spec) if spec.states == "continuous" else SampledStateSpace(spec)


class SampledStateSpace:
    """x(k+1) = A x(k) + B e(k), u(k) = C x(k) + D e(k), with e = reference − seen.

    Parameters
    ----------
    spec : StateSpaceSpec
        Matrices; those of a continuous form are discretised by `zero_order_hold_matrices`.
    """

    def __init__(self, spec: StateSpaceSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self.actuation: Literal["hold", "impulse"] = spec.actuation
        a, b, c, d = _matrices(spec)
        if spec.form == "continuous":
            a, b = zero_order_hold_matrices(a, b, spec.period_s)
        self._order, self._inputs = b.shape
        self._all = np.block([[a, b], [c, d]])

    def initial(self, n_cases: int) -> Array:
        """Return the states (m, N), zero."""
        return np.zeros((self._order, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the states (m, N)."""
        if len(y) != self._inputs:
            raise InputError(f"the law takes {self._inputs} inputs (columns of b, d), got {len(y)}")
        both: Array = self._all @ np.concatenate([xc, ref - y])
        return both[self._order :], both[: self._order]


class ContinuousStateSpace:
    """ẋ = A x + B e, u = C x + D e with e = reference − seen, between samples too.

    Filters and compensator run with the plant; e is held between samples or follows the true
    states (`StateSpaceSpec.measurement`). See `hillsphere.simulation.ContinuousLaw`.

    Parameters
    ----------
    spec : StateSpaceSpec
        Matrices.
    """

    def __init__(self, spec: StateSpaceSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self.measurement: Literal["held", "continuous"] = spec.measurement
        self._a, self._b, self._c, self._d = _matrices(spec)
        self.inputs: int = self._b.shape[1]
        self.states = tuple(Variable(f"law:x{i}") for i in range(len(self._a)))
        self.fastest_rad_s = float(np.abs(np.linalg.eigvals(self._a)).max(initial=0.0))

    def initial(self, n_cases: int) -> Array:
        """Return the states (m, N), zero."""
        return np.zeros((len(self.states), n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return the states as they are."""
        return xc

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return A x + B e."""
        return error_feedback(self._a, self._b, xc, y, ref)

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return C x + D e."""
        return error_feedback(self._c, self._d, xc, y, ref)


def _matrices(spec: StateSpaceSpec) -> tuple[Array, Array, Array, Array]:
    m, p = len(spec.a), len(spec.c or spec.d)
    q = len((spec.b or spec.d)[0])

    def made(matrix: Matrix, rows: int, columns: int) -> Array:
        return np.array(matrix, dtype=float) if matrix else np.zeros((rows, columns))

    return made(spec.a, m, m), made(spec.b, m, q), made(spec.c, p, m), made(spec.d, p, q)


def error_feedback(
    left: Array,
    right: Array,
    xc: tuple[Expr, ...],
    y: tuple[Expr, ...],
    ref: tuple[Expr, ...],
) -> tuple[Expr, ...]:
    """Return left·x + right·(ref − y) without the terms of zero gain."""
    error = [r - s for r, s in zip(ref, y, strict=True)]
    rows = []
    for a, b in zip(left.tolist(), right.tolist(), strict=True):
        terms = [g * e for g, e in zip((*a, *b), (*xc, *error), strict=True) if g]
        rows.append(sum_of(terms) if terms else constant(0.0))
    return tuple(rows)
