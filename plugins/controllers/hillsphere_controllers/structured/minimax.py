r"""The quadratic program of a minimax step: linear functions, an exact penalty, a quadratic term.

.. math::

    \min_{d, t, s \ge 0} \; t + ρ s + \tfrac12 d^\mathsf{T} H d \quad \text{s.t.} \quad
    f_q + g_q^\mathsf{T} d \le t, \quad h_r + g_r^\mathsf{T} d \le s.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular

from hillsphere.interfaces import Array

__all__ = ["MinimaxStep", "minimax_step"]


@dataclass(frozen=True)
class MinimaxStep:
    """A minimax step, its predicted decrease and its multipliers.

    Parameters
    ----------
    step : ndarray, shape (n,)
        d.
    predicted : float
        By how much max f + ρ max(h, 0) falls, by the linear functions and the quadratic.
    multipliers : ndarray, shape (K,)
        λ ≥ 0 of each function; those of the f sum to one.
    """

    step: Array
    predicted: float
    multipliers: Array


def minimax_step(
    levels: Array, slopes: Array, hard: NDArray[np.bool_], hessian: Array, penalty: float
) -> MinimaxStep | None:
    """Return the step; None if the solver fails.

    Parameters
    ----------
    levels : ndarray, shape (K,)
        Values f and h.
    slopes : ndarray, shape (K, n)
        Their slopes.
    hard : ndarray of bool, shape (K,)
        Which of them are constraints h ≤ 0.
    hessian : ndarray, shape (n, n)
        H, positive definite.
    penalty : float
        ρ.
    """
    count, n = slopes.shape
    try:
        factor = cholesky(hessian, lower=True)
    except np.linalg.LinAlgError:
        return None
    # in w = Lᵀ d the quadratic is |w|²/2
    turned = solve_triangular(factor, slopes.T, lower=True).T
    soft = ~hard
    top = float(levels[soft].max())
    # t is measured from the highest level, so that the right-hand sides are small numbers
    right = np.where(soft, top - levels, -levels)
    rows = [turned, -soft.astype(float)[:, None]]
    cost = [*np.zeros(n), 1.0]
    extra = bool(hard.any())
    if extra:
        rows.append(-hard.astype(float)[:, None])
        cost.append(penalty)
    matrix = np.hstack(rows)
    if extra:
        last = np.zeros((1, n + 2))
        last[0, -1] = -1.0
        matrix, right = np.vstack([matrix, last]), np.append(right, 0.0)
    size = matrix.shape[1]
    quadratic = sparse.csc_matrix((np.ones(n), (np.arange(n), np.arange(n))), shape=(size, size))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    solution = clarabel.DefaultSolver(
        quadratic, np.array(cost), sparse.csc_matrix(matrix), right,
        [clarabel.NonnegativeConeT(len(right))], settings,
    ).solve()  # fmt: skip
    primal, multipliers = np.array(solution.x), np.array(solution.z)[:count]
    if not (np.isfinite(primal).all() and np.isfinite(multipliers).all()):
        return None
    step = solve_triangular(factor.T, primal[:n], lower=False)
    model = levels + slopes @ step
    fall = top - float(model[soft].max())
    if extra:
        before, after = max(0.0, float(levels[hard].max())), max(0.0, float(model[hard].max()))
        fall += penalty * (before - after)
    fall -= 0.5 * float(primal[:n] @ primal[:n])
    return MinimaxStep(np.asarray(step), fall, np.maximum(multipliers, 0.0))
