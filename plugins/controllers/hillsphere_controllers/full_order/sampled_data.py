r"""Exact sampling of quadratic costs and white noise, with held inputs (sampled-data LQG).

Over a period h with x(0) = x and u held,

.. math::

    \int_0^h \begin{bmatrix} x \\ u \end{bmatrix}^\mathsf{T}
    \begin{bmatrix} Q & N \\ N^\mathsf{T} & R \end{bmatrix}
    \begin{bmatrix} x \\ u \end{bmatrix} dt
    = \begin{bmatrix} x \\ u \end{bmatrix}^\mathsf{T} \left( \int_0^h
    e^{M^\mathsf{T} t} \begin{bmatrix} Q & N \\ N^\mathsf{T} & R \end{bmatrix} e^{M t} dt \right)
    \begin{bmatrix} x \\ u \end{bmatrix}, \quad
    M = \begin{bmatrix} A & B \\ 0 & 0 \end{bmatrix},

and both integrals are blocks of one matrix exponential [1]_. A regulator for these costs knows of
the hold, whose delay of half a period costs one that was made in continuous time its margins.

References
----------
.. [1] C. F. Van Loan (1978), Computing integrals involving the matrix exponential, IEEE
   Transactions on Automatic Control 23(3), 395-404.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import real_matrix

__all__ = ["sampled_cost", "sampled_noise"]

_LARGEST_STEP = 0.5
"""Largest ‖M‖₁ h of the exponential before doubling. Below one half exp(−Mᵀ h) and exp(M h) have
one size, so that neither loses digits beside the other (Van Loan 1978)."""


def sampled_cost(
    a: Array, b: Array, q: Array, r: Array, h: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the sampled system and the cost of a period of ∫ xᵀ Q x + uᵀ R u dt.

    Parameters
    ----------
    a, b : ndarray, shape (n, n), (n, m)
        Of ẋ = A x + B u, 1/s.
    q, r : ndarray, shape (n, n), (m, m)
        Weights, symmetric.
    h : float
        Period, s.

    Returns
    -------
    a, b : ndarray, shape (n, n), (n, m)
        Of x(k+1) = A x(k) + B u(k).
    q, r, n : ndarray, shape (n, n), (m, m), (n, m)
        Of the cost xᵀ Q x + uᵀ R u + 2 xᵀ N u of a period.

    Raises
    ------
    InputError
        If the period is not positive, or a matrix does not fit.
    """
    a, b = real_matrix(a, "A"), real_matrix(b, "B")
    states, controls = b.shape
    q, r = real_matrix(q, "Q"), real_matrix(r, "R")
    for name, matrix, size in (("A", a, states), ("Q", q, states), ("R", r, controls)):
        _check_square(name, matrix, size)
    whole = np.zeros((states + controls, states + controls))
    whole[:states, :states], whole[:states, states:] = a, b
    weight = np.zeros_like(whole)
    weight[:states, :states], weight[states:, states:] = q, r
    over, cost = _integrate_weight(whole, weight, h)
    return (
        over[:states, :states], over[:states, states:],
        cost[:states, :states], cost[states:, states:], cost[:states, states:],
    )  # fmt: skip


def sampled_noise(a: Array, density: Array, h: float) -> Array:
    """Return the covariance (n, n) that white noise leaves on the states after a period.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        Of ẋ = A x + w.
    density : ndarray, shape (n, n)
        Spectral density of w.
    h : float
        Period, s.

    Returns
    -------
    ndarray, shape (n, n)
        The covariance, symmetric.

    Raises
    ------
    InputError
        If the period is not positive, or a matrix does not fit.
    """
    a, density = real_matrix(a, "A"), real_matrix(density, "the density")
    _check_square("A", a, len(a))
    _check_square("the density", density, len(a))
    return _integrate_weight(a.T, density, h)[1]


def _check_square(name: str, matrix: Array, size: int) -> None:
    if matrix.shape != (size, size):
        raise InputError(f"{name} must be {size} × {size}, got {matrix.shape}")


def _integrate_weight(m: Array, weight: Array, h: float) -> tuple[Array, Array]:
    """Return exp(M h) and ∫ exp(Mᵀ t) W exp(M t) dt."""
    if not (np.isfinite(h) and h > 0.0):
        raise InputError(f"a period must be > 0 s, got {h}")
    n = len(m)
    # the exponential holds exp(−Mᵀ h) too: over short steps, then doubled, no mode drowns another
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(m).sum(axis=0).max() * h, 1e-300)
                                           / _LARGEST_STEP))))  # fmt: skip
    # Van Loan (1978): exp([[−Mᵀ, W], [0, M]] h) has the integral in its upper right block
    both = np.block([[-m.T, weight], [np.zeros((n, n)), m]])
    exponential = expm(both * (h / 2.0**doublings))
    over = exponential[n:, n:]
    total = over.T @ exponential[:n, n:]
    for _ in range(doublings):
        # doubling: ∫₀²ʰ = ∫₀ʰ + exp(Mᵀ h) (∫₀ʰ) exp(M h)
        total = total + over.T @ total @ over
        over = over @ over
    return over, 0.5 * (total + total.T)
