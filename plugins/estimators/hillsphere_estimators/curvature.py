r"""Expansion of measurements across a belief to second order, and what it leaves out.

With z the deviation from the mean in standard deviations, x = μ + S z, a measurement in units of
its noise is

.. math:: h_k(x) = h_k(\mu) + L_k^T z + \tfrac12 z^T C_k z + \rho_k(z), \quad z \sim N(0, 1).

Its mean is :math:`h_k(\mu) + \tfrac12 \mathrm{tr}\, C_k` without ρ, and curvature adds
:math:`\tfrac12 \mathrm{tr}(C_k C_l)` to the covariance of the rows k and l [1]_. Unlike 2n + 1
sigma points, which lie on the axes, the differences include the products of two states: the
range-rate of an unknown position times an unknown velocity is curved along no axis.

The remainder ρ is seen at points of its own: on the axes at another distance, and along rotated
axes. Without it a function that is odd about the mean, as x³, the sine or the arctangent, would
pass for a linear one however much it bends, since all even differences vanish.

For a cubic function L is its mean slope over the belief, and what is left of it along an axis is
Hermite's third polynomial, b (z³ − 3z): −2b at z = 1, and √6 b as a root mean square. The remainder
at one standard deviation times √(3/2) is therefore a row of the covariance. A term of three
different states is seen only along rotated axes. The mean of (q₁ q₂ q₃)² over unit vectors q of n
coordinates is 1/(n (n + 2)(n + 4)): at the distance r = ((n + 2)(n + 4))^(1/6) the squares at n
points add up to its variance 1, on average over rotations.

References
----------
.. [1] Athans, Wishner, Bertolini (1968), Suboptimal state estimation for continuous-time nonlinear
   systems from discrete noisy measurements, IEEE Trans. Automatic Control 13(5).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.fft import dct

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Integers

__all__ = ["curved_points", "direction_matrix", "expand", "point_count"]

_REACH = float(np.sqrt(3.0))
"""Distance of the points in standard deviations. For a normal distribution the mean slope is then
right for cubic functions too (the nodes of Gauss and Hermite's rule of three points)."""
_CUBIC = float(np.sqrt(1.5))
"""Root mean square of Hermite's third polynomial over its size at one standard deviation, √6/2."""
_ROUNDED = 16.0 * float(np.finfo(float).eps)
"""Remainder, over the largest value at the points, that is rounding: some ten values are added up
to form it, each rounded to half an eps."""


def curved_points(belief: Belief) -> Array:
    """Return the points at which a function is evaluated for its expansion.

    Parameters
    ----------
    belief : Belief
        M beliefs of n states.

    Returns
    -------
    ndarray, shape (n, 1 + 2n + n(n − 1) + 2d, M)
        The mean; ± each column of the root; ± the sum of each pair of columns, first with +; + and
        then − the d directions of the remainder: 2n, or 1 for a single state.
    """
    offsets = _offsets(len(belief.x))
    return np.asarray(belief.x[:, None] + np.einsum("Mab,kb->akM", belief.root, offsets))


def point_count(n: int) -> int:
    """Return the number of points of `curved_points` for n states."""
    return len(_offsets(n))


def expand(off: Array, n: int) -> tuple[Array, Array, Array]:
    """Return the expansion from the deviations at `curved_points`.

    Parameters
    ----------
    off : ndarray, shape (m, 2n + n(n − 1) + 2d, M)
        Values at the points minus that at the mean.
    n : int
        Number of states.

    Returns
    -------
    shift : ndarray, shape (m, M)
        ½ tr C, the mean minus the value at the mean.
    linear : ndarray, shape (M, n, m)
        L.
    bent : ndarray, shape (M, n(n + 1)/2 + 2d, m)
        Rows whose squares add up to the covariance by curvature: C_ii/√2, then C_ij for i < j, then
        the remainders in the d directions, first their odd and then their even halves.
    """
    ahead, behind = off[:, :n], off[:, n : 2 * n]
    linear = (ahead - behind) / (2.0 * _REACH)
    both = ahead + behind
    first, second = _pairs(n)
    last = 2 * n + 2 * len(first)
    crossed = off[:, 2 * n : 2 * n + len(first)] + off[:, 2 * n + len(first) : last]
    mixed = (crossed - both[:, first] - both[:, second]) / (2.0 * _REACH**2)
    shift = 0.5 / _REACH**2 * both.sum(axis=1)

    direction = _directions(n)
    d = len(direction)
    plus, minus = off[:, last : last + d], off[:, last + d :]
    slope = np.einsum("db,mbM->mdM", direction, linear)
    square = np.einsum("db,mbM->mdM", direction**2 / _REACH**2, both)
    square += 2.0 * np.einsum("dp,mpM->mdM", direction[:, first] * direction[:, second], mixed)
    odd, even = 0.5 * (plus - minus) - slope, 0.5 * (plus + minus - square)
    # what is smaller than the rounding of the values themselves is no remainder
    least = _ROUNDED * np.abs(off).max(axis=1, keepdims=True)
    rest = np.concatenate([odd, even], axis=1)
    rest = np.where(np.abs(rest) <= least, 0.0, rest)
    size = np.where(np.arange(d) < n, _CUBIC, 1.0)
    rest *= np.tile(size, 2)[:, None]

    bent = np.concatenate([both / (_REACH**2 * np.sqrt(2.0)), mixed, rest], axis=1)
    return shift, linear.transpose(2, 1, 0), bent.transpose(2, 1, 0)


def direction_matrix(bent: Array, n: int) -> Array:
    """Return the matrices whose largest eigenvalue belongs to the direction of most curvature.

    Parameters
    ----------
    bent : ndarray, shape (M, n(n + 1)/2 + 2d, m)
        Rows of `expand`.
    n : int
        Number of states.

    Returns
    -------
    ndarray, shape (M, n, n)
        Σ_k C_k² + 2 Σ ρ² u uᵀ over the remainders ρ and their directions u. The trace is twice the
        variance by curvature.
    """
    first, second = _pairs(n)
    pairs = n + len(first)
    full = np.empty((len(bent), n, n, bent.shape[2]))
    full[:, np.arange(n), np.arange(n)] = np.sqrt(2.0) * bent[:, :n]
    full[:, first, second] = full[:, second, first] = bent[:, n:pairs]
    flat = full.reshape(len(bent), n, -1)
    direction = _directions(n)
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    squares = np.sum(bent[:, pairs:] ** 2, axis=2).reshape(len(bent), 2, -1).sum(axis=1)
    return np.asarray(
        flat @ np.swapaxes(flat, 1, 2) + 2.0 * np.einsum("Md,da,db->Mab", squares, unit, unit)
    )


@lru_cache(maxsize=64)
def _pairs(n: int) -> tuple[Integers, Integers]:
    """Return the indices i < j of all pairs of n states."""
    first, second = np.triu_indices(n, 1)
    return first, second


@lru_cache(maxsize=64)
def _directions(n: int) -> Array:
    """Return the points (d, n) of the remainder: the axes, and rotated ones if n > 1.

    The rotation is the discrete cosine transform, none of whose rows is along an axis.
    """
    if n == 1:
        return np.ones((1, 1))
    reach = ((n + 2.0) * (n + 4.0)) ** (1.0 / 6.0)
    return np.concatenate([np.eye(n), reach * dct(np.eye(n), norm="ortho", axis=0)])


@lru_cache(maxsize=64)
def _offsets(n: int) -> Array:
    """Return the offsets of `curved_points` in standard deviations, (points, n)."""
    one = np.eye(n)
    first, second = _pairs(n)
    both, other = one[first] + one[second], _directions(n)
    near = _REACH * np.concatenate([np.zeros((1, n)), one, -one, both, -both])
    return np.concatenate([near, other, -other])
