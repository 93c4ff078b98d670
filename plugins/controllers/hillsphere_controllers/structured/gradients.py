r"""Gradients of a closed loop's gains, H2 norm and poles with respect to the controller's matrix K.

At s = jω, with R = (s I − A)⁻¹, G₁₂ = C R B₂ + D₁₂, G₂₁ = C₂ R B + D₂₁ of the closed loop and
T = U Σ Vᴴ [1]_, [2]_,

.. math::

    \frac{\partial σ_i}{\partial K} =
    \mathrm{Re}\,[\overline{(G_{12}^H u_i)} (G_{21} v_i)^\mathsf{T}],

which at a peak is the gradient of the peak too. The H2 norm follows from A P + P Aᵀ + B Bᵀ = 0,
Aᵀ Q + Q A + Cᵀ C = 0: its square has the gradients 2QP, 2QB, 2CP with respect to A, B, C.

References
----------
.. [1] P. Apkarian, D. Noll (2006), Nonsmooth H∞ synthesis, IEEE Transactions on Automatic Control
   51(1), 71-86.
.. [2] J. V. Burke, D. Henrion, A. S. Lewis, M. L. Overton (2006), HIFOO - a MATLAB package for
   fixed-order controller design and H∞ optimization, IFAC Proceedings 39(9), 339-344.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig, solve_continuous_lyapunov

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.structured.closed_loop import Closed

__all__ = ["gain_slopes", "h2", "h2_slope", "pole_slopes"]

Complex = NDArray[np.complex128]


def gain_slopes(
    closed: Closed, rows: Integers, columns: Integers, omega: Array
) -> tuple[Array, Array]:
    """Return the singular values at frequencies and how they change with K.

    Parameters
    ----------
    closed : Closed
        Closed loop, or one of each frequency.
    rows, columns : ndarray
        Indices of the part of z and of w that is looked at.
    omega : ndarray, shape (W,)
        Frequencies, rad/s; may be infinite.

    Returns
    -------
    sigma : ndarray, shape (W, r)
        Singular values, the largest first.
    slopes : ndarray, shape (W, r, rows of K, columns of K)
        Their gradients, where they are apart from each other.
    """
    direct = (
        closed.d[..., rows, :][..., columns],
        closed.d12[..., rows, :],
        closed.d21[..., columns],
    )
    g, g12, g21 = (
        np.array(np.broadcast_to(part, (omega.size, *part.shape[-2:])), dtype=complex)
        for part in direct
    )
    n, m = closed.a.shape[-1], columns.size
    there = np.isfinite(omega)
    if n and there.any():
        finite = closed.at(there) if closed.a.ndim > 2 else closed
        away = 1j * omega[there, None, None] * np.eye(n) - finite.a
        into = np.concatenate([finite.b[..., columns], finite.b2], axis=-1).astype(complex)
        # one factorisation of jω − A serves G, G₁₂ and G₂₁
        x = np.linalg.solve(away, np.broadcast_to(into, (*away.shape[:-1], into.shape[-1])))
        c = finite.c[..., rows, :]
        g[there] += c @ x[..., :m]
        g12[there] += c @ x[..., m:]
        g21[there] += finite.c2 @ x[..., :m]
    u, sigma, vh = np.linalg.svd(g, full_matrices=False)
    left, right = u.conj().swapaxes(1, 2) @ g12, vh.conj() @ g21.swapaxes(1, 2)
    return sigma, np.real(left[..., :, None] * right[..., None, :])


def h2(closed: Closed, rows: Integers, columns: Integers) -> float:
    """Return the H2 norm of a part, see `gain_slopes`, of a stable closed loop."""
    b, c = closed.b[:, columns], closed.c[rows]
    p = solve_continuous_lyapunov(closed.a, -b @ b.T)
    return float(np.sqrt(max(np.trace(c @ p @ c.T), 0.0)))


def h2_slope(closed: Closed, rows: Integers, columns: Integers) -> Array:
    """Return the gradient of the logarithm of the H2 norm by K."""
    b, c = closed.b[:, columns], closed.c[rows]
    p = solve_continuous_lyapunov(closed.a, -b @ b.T)
    q = solve_continuous_lyapunov(closed.a.T, -c.T @ c)
    # d‖G‖₂²/2 = ⟨QP, dA⟩ + ⟨QB, dB⟩ + ⟨CP, dC⟩, with dA = b2 dK c2 and so on
    slope = closed.b2.T @ (q @ p @ closed.c2.T + q @ b @ closed.d21[:, columns].T)
    slope += closed.d12[rows].T @ c @ p @ closed.c2.T
    return np.asarray(slope / max(float(np.trace(c @ p @ c.T)), 1e-300))


def pole_slopes(closed: Closed) -> tuple[Complex, Complex]:
    """Return the closed loop's poles (n,) and their derivatives (n, rows, columns) by K.

    The derivative of a multiple pole that has too few eigenvectors is not finite.
    """
    poles, left, right = eig(closed.a, left=True, right=True)
    # dλ = yᴴ dA x/(yᴴ x) with dA = b2 dK c2
    y, x = closed.b2.T @ left.conj(), closed.c2 @ right
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = y.T[:, :, None] * x.T[:, None, :] / np.sum(left.conj() * right, 0)[:, None, None]
    return poles.astype(complex), slopes.astype(complex)
