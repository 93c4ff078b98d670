r"""Linear-quadratic state feedback, from a Riccati equation with a definite quadratic term.

The energy of :math:`C x + D u` is brought to that of :math:`C_\perp x` and of a control of unit
weight, by the QR factorisation of D, in which nothing is squared: what cancels, cancels to zero.
The solution is then refined by Newton's method [1]_ on the equation in its factors,

.. math::

    A^\mathsf{T} X + X A - F^\mathsf{T} F + C_\perp^\mathsf{T} C_\perp = 0, \qquad
    F = -B^\mathsf{T} X,

which keeps its accuracy however cheap the control is.

References
----------
.. [1] D. L. Kleinman (1968), On an iterative technique for Riccati equation computations, IEEE
   Transactions on Automatic Control 13(1), 114-115.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
from scipy.linalg import qr, solve_continuous_are, solve_discrete_are, solve_triangular

from hillsphere.interfaces import Array
from hillsphere_controllers.analysis.gramians import gramian
from hillsphere_controllers.errors import SingularProblemError
from hillsphere_controllers.full_order.modes import axis_mode
from hillsphere_controllers.full_order.riccati import stabilising_solution

__all__ = ["optimal_cost"]

_RESIDUAL = 1e-9
"""Largest residual, relative to the largest term of the equation, of an accepted X."""
_CANCELLED = 1e-14
"""Entries below this share of the sums that they are the difference of are rounding; kept, they
would show modes to the cost that it does not contain."""
_MOST = 60
"""Steps of Newton's method at most. From a far stabilising start each step halves the error first;
sixty reach the quadratic range over 18 decades."""
_SETTLED = 1e-15
"""Residual of rounding size, at which no step can gain any more."""
_QUADRATIC = 1e-6
"""Below that, a step that gains nothing is the last."""


def optimal_cost(
    a: Array, b: Array, c: Array, d: Array, *, discrete: bool = False
) -> tuple[Array, Array]:
    r"""Return X and F of the state feedback u = F x that minimises the energy of C x + D u.

    Parameters
    ----------
    a, b, c, d : ndarray, shape (n, n), (n, m), (p, n), (p, m)
        Matrices, D of full column rank.
    discrete : bool
        Whether x follows in steps.

    Returns
    -------
    x : ndarray, shape (n, n)
        The energy from a state x is xᵀ X x.
    f : ndarray, shape (m, n)
        The feedback.

    Raises
    ------
    SingularProblemError
        If there is no stabilising solution.
    """
    a, b, c, d = (np.asarray(matrix, dtype=float) for matrix in (a, b, c, d))
    n, m = b.shape
    if n == 0:
        return np.zeros((0, 0)), np.zeros((m, 0))
    # u = R⁻¹ (v − Q₁ᵀ C x), of which v has the weight one
    whole, r = qr(d)
    unit, feed = r[:m], whole[:, :m].T @ c
    seen = whole[:, m:].T @ c
    seen[np.abs(seen) <= _CANCELLED * (np.abs(whole[:, m:]).T @ np.abs(c))] = 0.0
    back = solve_triangular(unit, b.T, trans="T").T
    away = a - back @ feed
    at = axis_mode(away, seen, discrete=discrete)
    if at is not None:
        raise SingularProblemError(
            f"a mode at {'z' if discrete else 's'} = {at:.6g}, on the stability boundary, is not "
            "weighted or not excited (a zero from u to z or from w to y); weight it a little, or "
            "shift it off"
        )
    for start in _starts(away, back, seen, discrete):
        x = _refine_by_newton(away, back, seen, start, discrete)
        if x is not None:
            f = _feedback(away, back, x, discrete)
            return x, np.asarray(solve_triangular(unit, f - feed))
    raise SingularProblemError(
        "no stabilising solution of the Riccati equation was found: a mode lies too near to the "
        f"{'unit circle' if discrete else 'imaginary axis'} (a zero from u to z or from w to y), "
        "or the data are badly scaled; weight the mode a little, or shift it off"
    )


def _starts(a: Array, b: Array, c: Array, discrete: bool) -> Iterator[Array]:
    """Yield initial solutions of the Riccati equation, the fastest method first."""
    q, one = c.T @ c, np.eye(b.shape[1])
    if not discrete:
        solution = stabilising_solution(a, -b @ b.T, q, checked=False)
        if solution is not None:
            yield solution
    # where nothing is weighted the pencil is hard to part: each feedback that stabilises will do
    size = float(max(np.abs(q).max(), np.abs(a).max() ** 2 / max(np.abs(b).max() ** 2, 1e-300)))
    for more in (0.0, 1e-6 * size, size):
        weight = q + more * np.eye(len(a))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of bad conditions; what is found is checked
                solve = solve_discrete_are if discrete else solve_continuous_are
                yield np.asarray(solve(a, b, weight, one))
        except (np.linalg.LinAlgError, ValueError):
            continue


def _feedback(a: Array, b: Array, x: Array, discrete: bool) -> Array:
    if not discrete:
        return np.asarray(-b.T @ x)
    return np.asarray(-np.linalg.solve(np.eye(b.shape[1]) + b.T @ x @ b, b.T @ x @ a))


def _refine_by_newton(a: Array, b: Array, c: Array, x: Array, discrete: bool) -> Array | None:
    """Refine X by Newton's method (Kleinman); None if X does not stabilise or solve."""
    error = np.inf
    best = x
    for _ in range(_MOST):
        if not np.isfinite(x).all():
            return None
        f = _feedback(a, b, x, discrete)
        closed = a + b @ f
        poles = np.linalg.eigvals(closed)
        if not (np.abs(poles).max() < 1.0 if discrete else poles.real.max() < 0.0):
            break
        if discrete:
            # residual in its factors: squares do not cancel against each other
            terms = closed.T @ x @ closed, -x, f.T @ f, c.T @ c
        else:
            flow = a.T @ x
            terms = flow, flow.T, -f.T @ f, c.T @ c
        rest = sum(terms[1:], start=terms[0])
        size = max(np.abs(term).max() for term in terms)
        reached = float(np.abs(rest).max() / max(size, 1e-300))
        if not reached < error and error <= _QUADRATIC:
            break
        if reached < error:
            best, error = x, reached
        if error <= _SETTLED:
            break
        # Newton step: the Lyapunov equation of the closed loop for the residual
        x = x + gramian(closed.T, rest, discrete=discrete)
    return best if error <= _RESIDUAL else None
