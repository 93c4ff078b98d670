r"""Stabilising solutions of Riccati equations with an indefinite quadratic term.

.. math::

    A^\mathsf{T} X + X A + X S X + Q = 0, \qquad A + S X \text{ stable},

from the stable invariant subspace [X₁; X₂] of the Hamiltonian matrix
:math:`\begin{bmatrix} A & S \\ -Q & -A^\mathsf{T} \end{bmatrix}`, X = X₂ X₁⁻¹ [1]_.

References
----------
.. [1] A. J. Laub (1979), A Schur method for solving algebraic Riccati equations, IEEE Transactions
   on Automatic Control 24(6), 913-921.
.. [2] P. Van Dooren (1981), A generalized eigenvalue approach for solving Riccati equations, SIAM
   Journal on Scientific and Statistical Computing 2(2), 121-135.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.linalg import schur, solve_continuous_are, solve_sylvester

from hillsphere.interfaces import Array

__all__ = ["axis_frequencies", "solution_by_pencil", "stabilising_solution"]

_ON_AXIS = 1e-11
"""Real part of a Hamiltonian eigenvalue, relative to the largest, below which it counts as on the
imaginary axis: no stabilising solution exists then."""
_NEAR_AXIS = 1e-3
"""Eigenvalues this near to the axis, relative to their size, may be imaginary ones that rounding
has displaced. A larger value only costs evaluations of the response."""
_RESIDUAL = 1e-6
"""Largest residual, relative to the terms of the equation, of an accepted solution. Near the least
γ X grows without bound, and rounding leaves residuals far above 1e-9; the closed loop is checked in
any case."""
_SMALL = 1e-9
"""Residual at which Newton's method ends: further steps change no digit that the closed loop
shows."""
_NEWTON = 5
"""Steps of Newton's method at most. It converges quadratically from the Schur solution: two or
three steps suffice, or none helps."""
_SINGULAR = 1e-13
"""Smallest singular value of the orthonormal basis' upper block below which X is infinite."""


def stabilising_solution(a: Array, s: Array, q: Array, *, checked: bool = True) -> Array | None:
    """Return the stabilising solution X (n, n), symmetric, or None if there is none.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A.
    s, q : ndarray, shape (n, n)
        S and Q, symmetric, of any sign.
    checked : bool
        Whether None is returned where rounding may have spoilt the solution.

    Returns
    -------
    ndarray or None
        Refined by Newton's method; None where the Hamiltonian matrix has imaginary
        eigenvalues, X₁ is singular, or the equation is not met.
    """
    n = len(a)
    if n == 0:
        return np.zeros((0, 0))
    hamiltonian, t = _hamiltonian(a, s, q)
    try:
        # ordered real Schur form: the first n columns span the stable invariant subspace
        triangular, vectors, stable = schur(hamiltonian, sort="lhp")
    except np.linalg.LinAlgError:  # eigenvalues too near the axis to be put in order
        return None
    values = np.linalg.eigvals(triangular)
    if stable != n:
        return None
    if checked and np.abs(values.real).min() <= _ON_AXIS * np.abs(values).max():
        return None
    upper, lower = vectors[:n, :n], vectors[n:, :n]
    if np.linalg.svd(upper, compute_uv=False)[-1] <= (_SINGULAR if checked else 0.0):
        return None
    # X = t X₂ X₁⁻¹
    x = t * np.linalg.solve(upper.T, lower.T).T
    x = _refine_by_newton(a, s, q, 0.5 * (x + x.T))
    return x if not checked or _solves(a, s, q, x) else None


def solution_by_pencil(
    given: tuple[Array, Array, Array, Array, Array],
    formed: tuple[Array, Array, Array],
    *,
    checked: bool = True,
) -> Array | None:
    """Return the stabilising solution X (n, n), symmetric, from the extended pencil, or None.

    From the pencil [2]_ in which the weight R is not inverted. It takes some times as long, and
    finds solutions where R, or the units of the states, are so uneven that the Hamiltonian matrix
    has lost them.

    Parameters
    ----------
    given : tuple of ndarray
        A, B, Q, R and N of AᵀX + X A − (X B + N) R⁻¹ (X B + N)ᵀ + Q = 0.
    formed : tuple of ndarray, shape (n, n)
        A, S, Q of the same equation as of `stabilising_solution`, with which the solution is
        refined and checked.
    checked : bool
        As of `stabilising_solution`.
    """
    a, b, q, r, cross = given
    if not len(a):
        return np.zeros((0, 0))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is badly conditioned; the loop is checked
            x = solve_continuous_are(a, b, q, r, s=cross)
    except (np.linalg.LinAlgError, ValueError):  # eigenvalues on the axis, R singular
        return None
    if not np.isfinite(x).all():
        return None
    x = _refine_by_newton(*formed, 0.5 * (x + x.T))
    return x if not checked or _solves(*formed, x) else None


def axis_frequencies(a: Array, s: Array, q: Array) -> Array:
    """Return frequencies at which eigenvalues of the Hamiltonian matrix may be imaginary.

    The midpoints between them are included: if the eigenvalues are imaginary, the gain exceeds the
    level there.
    """
    values = np.linalg.eigvals(_hamiltonian(a, s, q)[0]) if len(a) else np.zeros(0)
    near = np.abs(values.real) <= _NEAR_AXIS * np.abs(values)
    omega = np.unique(np.concatenate([np.abs(values[near].imag), np.zeros(1)]))
    return np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])])


def _hamiltonian(a: Array, s: Array, q: Array) -> tuple[Array, float]:
    """Return the Hamiltonian matrix of the scaled solution X/t, and the scale t.

    The scale gives S and Q the same size, which makes the subspace well conditioned.
    """
    size_s, size_q = np.abs(s).max(), np.abs(q).max()
    t = float(np.sqrt(size_q / size_s)) if size_s > 0.0 and size_q > 0.0 else 1.0
    return np.block([[a, t * s], [-q / t, -a.T]]), t


def _solves(a: Array, s: Array, q: Array, x: Array) -> bool:
    if _largest_residual(a, s, q, x) > _RESIDUAL:
        return False
    return bool(np.linalg.eigvals(a + s @ x).real.max() < 0.0)


def _refine_by_newton(a: Array, s: Array, q: Array, x: Array) -> Array:
    """Refine X by Newton's method while the residual falls and is not yet small."""
    rest = _largest_residual(a, s, q, x)
    for _ in range(_NEWTON):
        closed = a + s @ x
        # the Newton step solves (A + S X)ᵀ Δ + Δ (A + S X) = −residual; if the equation is nearly
        # singular, the step does not lower the residual and is not taken
        step = solve_sylvester(closed.T, closed, -_residual(a, s, q, x))
        better = np.asarray(x + 0.5 * (step + step.T))
        left = _largest_residual(a, s, q, better)
        if not left < rest:
            break
        x, rest = better, left
        if rest <= _SMALL:
            break
    return x


def _largest_residual(a: Array, s: Array, q: Array, x: Array) -> float:
    """Return the largest entry of the residual, relative to the equation's largest term."""
    size = max(np.abs(q).max(), np.abs(a.T @ x).max(), np.abs(x @ s @ x).max(), 1e-300)
    return float(np.abs(_residual(a, s, q, x)).max() / size)


def _residual(a: Array, s: Array, q: Array, x: Array) -> Array:
    return a.T @ x + x @ a + x @ s @ x + q
