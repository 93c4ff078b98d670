"""Multipliers of orbits that close after many revolutions.

Such an orbit, born in a resonance of high order, has besides the pair 1, 1 of every conservative
system a second pair that cannot be told from 1, 1: four multipliers of a defective matrix, which an
eigenvalue solver scatters by the root of its rounding error. The traces of M and M² are free of
that.

Where an orbit returns after half its period to the mirror image of its start (x → S x, a symmetry
of the equations in space), M is the square of the half-period's return map N = S M_h. Its indices
c = ν + 1/ν are those of M by b = c² − 2, and far more accurate: no power of the large elements of M
cancels, and b never falls below −2 by rounding.

References
----------
.. [1] Bray, T. A., Goudas, C. L., Doubly symmetric orbits about the collinear Lagrangian points,
   Astron. J. 72, 1967, p. 202 (indices from the traces of M and M²).
.. [2] Broucke, R., Stability of periodic orbits in the elliptic, restricted three-body problem,
   AIAA J. 7, 1969, p. 1003.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.stability import monodromy_of_half

__all__ = [
    "CIRCLE",
    "ReturnMaps",
    "excess",
    "is_stable",
    "pair_indices",
    "return_maps",
    "return_symmetry",
    "spectrum",
]

_NEUTRAL = 1e-6  # of the characteristic polynomial at b = 2: the second pair is 1, 1
CIRCLE = 1e-8
"""Of an index: where it touches ±2 and turns back, to within rounding, nothing becomes unstable."""

_RETURNS = 1e-6  # of half a period's end from the mirror image of the start


def pair_indices(monodromy: Array) -> NDArray[np.complex128]:
    """Return both stability indices (2, N), the dominant one first; real unless complex-unstable.

    They are the roots of b² − σ b + ½(σ² − tr M² + 2 − 4) = 0 with σ = tr M − 2. If b = 2 is a
    root to within rounding, the other is σ − 2, free of the cancellation in the square root.
    """
    total = np.trace(monodromy) - 2.0
    squares = np.einsum("ijk,jik->k", monodromy, monodromy) + 2.0
    # value of the quadratic in b at 2: zero if one pair is 1, 1
    at_two = 4.0 - 2.0 * total + 0.5 * (total**2 - squares)
    other = total - 2.0
    neutral = np.abs(at_two) <= _NEUTRAL * np.maximum(1.0, np.abs(other - 2.0))
    root = np.sqrt((2.0 * squares - total**2).astype(complex))
    upper, lower = 0.5 * (total + root), 0.5 * (total - root)
    # dominant: the index of larger modulus
    swap = np.abs(lower) > np.abs(upper)
    first = np.where(neutral, other, np.where(swap, lower, upper))
    second = np.where(neutral, 2.0, np.where(swap, upper, lower))
    return np.array([first, second], dtype=complex)


def spectrum(monodromy: Array) -> NDArray[np.complex128]:
    """Return the multipliers (6, N): λ, 1/λ of either pair, |λ| ≥ 1, and 1, 1."""
    return _multipliers(pair_indices(monodromy))


def _multipliers(b: NDArray[np.complex128]) -> NDArray[np.complex128]:
    # λ² − b λ + 1 = 0; the root of larger modulus first, its inverse without cancellation
    root = np.sqrt(b * b - 4.0)
    outer = 0.5 * np.where(np.abs(b + root) >= np.abs(b - root), b + root, b - root)
    ones = np.ones((2, b.shape[1]), dtype=complex)
    return np.concatenate([outer[:1], 1.0 / outer[:1], outer[1:], 1.0 / outer[1:], ones])


def _beyond(indices: NDArray[np.complex128]) -> Array:
    b = indices
    beyond = np.abs(b.real) - (2.0 + CIRCLE)
    # a pair that is 1, 1 is on the edge always and says nothing
    worse = np.where(b[1] == 2.0, beyond[0], np.max(beyond, axis=0))
    tilt = np.max(np.abs(b.imag), axis=0)
    return np.asarray(np.where(tilt > CIRCLE, tilt, worse))


def excess(monodromy: Array) -> Array:
    """Return how far the orbit is from the edge of stability, (N,): negative inside.

    |b| − 2 of the worse pair that is not 1, 1 to within rounding; |Im b| under complex instability.
    The edge, where an index that touches it lies to within rounding, is 1e-8 beyond ±2.
    """
    return _beyond(pair_indices(monodromy))


def is_stable(monodromy: Array) -> NDArray[np.bool_]:
    """Whether no multiplier lies off the unit circle, (N,)."""
    return np.asarray(excess(monodromy) <= 0.0)


class ReturnMaps:
    """Maps N of orbits to their return, of which M is a power.

    Parameters
    ----------
    matrix : ndarray, shape (6, 6, K)
        N.
    power : ndarray of int, shape (K,)
        1 (N is M) or 2 (half a period and a symmetry).
    """

    def __init__(self, matrix: Array, power: NDArray[np.int64]) -> None:
        self.matrix, self.power = matrix, power
        # the direction in which the phase of the vertical motion shifts is one of N as of M: a
        # second pair that cannot be told from ±1, ±1 is 1, 1
        self.indices = pair_indices(matrix)
        """Indices c of N (2, K)."""

    @property
    def monodromy(self) -> Array:
        """M (6, 6, K)."""
        # M = N² where half a period and a symmetry make the return map
        square = np.einsum("ijk,jlk->ilk", self.matrix, self.matrix)
        return np.where(self.power == 2, square, self.matrix)

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers of M (6, K), as from `spectrum`."""
        return np.asarray(_multipliers(self.indices) ** self.power)

    @property
    def excess(self) -> Array:
        """How far each is from the edge of stability (K,), in terms of its own indices."""
        return _beyond(self.indices)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether no multiplier lies off the unit circle (K,)."""
        return np.asarray(self.excess <= 0.0)

    @property
    def neutral(self) -> NDArray[np.bool_]:
        """Whether the second pair is 1, 1 to within rounding (K,)."""
        return np.asarray(self.indices[1] == 2.0)


def return_symmetry(
    start: Array, end: Array, symmetries: Sequence[tuple[int, ...]]
) -> NDArray[np.int64]:
    """Return the symmetry (6,) that takes an orbit's start to where it is half a period later.

    Parameters
    ----------
    start, end : ndarray, shape (6,)
        States.
    symmetries : sequence of tuple of int
        Signs of the states, of those that the equations keep.

    Returns
    -------
    ndarray of int, shape (6,)
        Zeros if there is none.
    """
    for signs in symmetries:
        if float(np.max(np.abs(np.array(signs) * start - end))) < _RETURNS:
            return np.array(signs, dtype=np.int64)
    return np.zeros(6, dtype=np.int64)


def return_maps(phi: Array, signs: NDArray[np.int64], mirror: Sequence[int]) -> ReturnMaps:
    """Return the maps of orbits from their matrices over half a period.

    Parameters
    ----------
    phi : ndarray, shape (6, 6, K)
        M_h.
    signs : ndarray of int, shape (6, K)
        From `return_symmetry`, per orbit.
    mirror : sequence of int
        Signs of the time reversal that the orbits keep.
    """
    twice = np.any(signs != 0, axis=0)
    # N = S Φ(T/2): half a period, then the symmetry that brings the orbit back to its start
    matrix = signs[:, None] * phi
    if not np.all(twice):
        rest = np.ascontiguousarray(phi[:, :, ~twice])
        matrix[:, :, ~twice] = monodromy_of_half(rest, mirror)
    return ReturnMaps(matrix, np.where(twice, 2, 1))
