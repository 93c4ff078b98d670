r"""Second-order expansion of measurements across a belief, by differences.

With z the deviation from the mean in standard deviations, x = μ + S z, a measurement in units of
its noise is

.. math:: h_k(x) \approx h_k(\mu) + L_k^T z + \tfrac12 z^T C_k z, \quad z \sim N(0, 1).

Its mean is :math:`h_k(\mu) + \tfrac12 \mathrm{tr}\, C_k`, and curvature adds
:math:`\tfrac12 \mathrm{tr}(C_k C_l)` to the covariance of the rows k and l [1]_. Unlike 2n + 1
sigma points, which lie on the axes, the differences include the products of two states: the
range-rate of an unknown position times an unknown velocity is curved along no axis.

References
----------
.. [1] Athans, Wishner, Bertolini (1968), Suboptimal state estimation for continuous-time nonlinear
   systems from discrete noisy measurements, IEEE Trans. Automatic Control 13(5).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Integers

__all__ = ["curved_points", "expand", "pair_matrix"]

_REACH = float(np.sqrt(3.0))
"""Distance of the points in standard deviations. For a normal distribution the mean slope is then
right for cubic functions too (the nodes of Gauss and Hermite's rule of three points)."""


def curved_points(belief: Belief) -> Array:
    """Return the points at which a function is evaluated for its expansion.

    Parameters
    ----------
    belief : Belief
        M beliefs of n states.

    Returns
    -------
    ndarray, shape (n, 1 + 2n + n(n − 1), M)
        The mean; ± each column of the root; ± the sum of each pair of columns, first with +.
    """
    offsets = _offsets(len(belief.x))
    return np.asarray(belief.x[:, None] + np.einsum("Mab,kb->akM", belief.root, offsets))


def expand(off: Array, n: int) -> tuple[Array, Array, Array]:
    """Return the expansion from the deviations at `curved_points`.

    Parameters
    ----------
    off : ndarray, shape (m, 2n + n(n − 1), M)
        Values at the points minus that at the mean.
    n : int
        Number of states.

    Returns
    -------
    shift : ndarray, shape (m, M)
        ½ tr C, the mean minus the value at the mean.
    linear : ndarray, shape (M, n, m)
        L.
    bent : ndarray, shape (M, n(n + 1)/2, m)
        Rows whose squares add up to the covariance by curvature: C_ii/√2, then C_ij for i < j.
    """
    ahead, behind = off[:, :n], off[:, n : 2 * n]
    linear = (ahead - behind) / (2.0 * _REACH)
    both = ahead + behind
    first, second = _pairs(n)
    crossed = off[:, 2 * n : 2 * n + len(first)] + off[:, 2 * n + len(first) :]
    mixed = (crossed - both[:, first] - both[:, second]) / (2.0 * _REACH**2)
    bent = np.concatenate([both / (_REACH**2 * np.sqrt(2.0)), mixed], axis=1)
    shift = 0.5 / _REACH**2 * both.sum(axis=1)
    return shift, linear.transpose(2, 1, 0), bent.transpose(2, 1, 0)


def pair_matrix(bent: Array, n: int) -> Array:
    """Return Σ_k C_k² (M, n, n) of the rows `bent` (M, n(n + 1)/2, m) of `expand`."""
    first, second = _pairs(n)
    full = np.empty((len(bent), n, n, bent.shape[2]))
    full[:, np.arange(n), np.arange(n)] = np.sqrt(2.0) * bent[:, :n]
    full[:, first, second] = full[:, second, first] = bent[:, n:]
    flat = full.reshape(len(bent), n, -1)
    return np.asarray(flat @ np.swapaxes(flat, 1, 2))


@lru_cache(maxsize=64)
def _pairs(n: int) -> tuple[Integers, Integers]:
    """Return the indices i < j of all pairs of n states."""
    first, second = np.triu_indices(n, 1)
    return first, second


@lru_cache(maxsize=64)
def _offsets(n: int) -> Array:
    """Return the offsets of `curved_points` in standard deviations, (points, n)."""
    one = np.eye(n)
    first, second = _pairs(n)
    both = one[first] + one[second]
    return np.asarray(_REACH * np.concatenate([np.zeros((1, n)), one, -one, both, -both]))
