"""Gramians of systems whose poles may lie any number of decades apart."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur, solve_continuous_lyapunov, solve_triangular

from hillsphere.interfaces import Array

__all__ = ["gramian", "lyapunov_solution"]

Complex = NDArray[np.complex128]


def gramian(a: Array, q: Array, *, discrete: bool = False) -> Array:
    r"""Return P (n, n) of A P + P Aᵀ + Q = 0, or of A P Aᵀ − P + Q = 0.

    Column by column in the Schur form of A [1]_. The usual routine of LAPACK enlarges each sum of
    two eigenvalues to the rounding of the largest entry, and so loses slow poles beside fast ones;
    here they are as they are.

    Parameters
    ----------
    a, q : ndarray, shape (n, n)
        A, stable, and Q, symmetric.
    discrete : bool
        Which of the two.

    References
    ----------
    .. [1] R. H. Bartels, G. W. Stewart (1972), Solution of the matrix equation AX + XB = C,
       Communications of the ACM 15(9), 820-826.
    """
    n = len(a)
    t, u = schur(np.asarray(a, dtype=float), output="complex")
    # T X + X Tᴴ + Q̃ = 0 in the coordinates of the Schur form A = U T Uᴴ
    right = u.conj().T @ q @ u
    x: Complex = np.zeros((n, n), dtype=complex)
    one = np.eye(n)
    for k in range(n - 1, -1, -1):
        # columns behind this one are known: T is upper triangular
        known = x[:, k + 1 :] @ t[k, k + 1 :].conj()
        if discrete:
            matrix, side = t[k, k].conj() * t - one, right[:, k] + t @ known
        else:
            matrix, side = t + t[k, k].conj() * one, right[:, k] + known
        x[:, k] = solve_triangular(matrix, -side, check_finite=False)
    made = (u @ x @ u.conj().T).real
    return np.asarray(0.5 * (made + made.T))


def lyapunov_solution(a: Array, q: Array) -> Array:
    """Return P (n, n) of A P + P Aᵀ + Q = 0 by LAPACK, by `gramian` where poles lie too far apart.

    Parameters
    ----------
    a, q : ndarray, shape (n, n)
        A, stable, and Q, symmetric.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            return np.asarray(solve_continuous_lyapunov(a, -q))
        except (RuntimeWarning, np.linalg.LinAlgError):  # sums of eigenvalues near rounding
            return gramian(a, q)
