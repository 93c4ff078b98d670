"""Multipliers of orbits that close after many revolutions.

Such an orbit, born in a resonance of high order, has besides the pair 1, 1 of every conservative
system a second pair that cannot be told from 1, 1: four multipliers of a defective matrix, which an
eigenvalue solver scatters by the root of its rounding error. The traces of M and M² are free of
that.

References
----------
.. [1] Bray, T. A., Goudas, C. L., Doubly symmetric orbits about the collinear Lagrangian points,
   Astron. J. 72, 1967, p. 202 (indices from the traces of M and M²).
.. [2] Broucke, R., Stability of periodic orbits in the elliptic, restricted three-body problem,
   AIAA J. 7, 1969, p. 1003.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["excess", "is_stable", "pair_indices", "spectrum"]

_NEUTRAL = 1e-6  # of the characteristic polynomial at b = 2: the second pair is 1, 1
_CIRCLE = 1e-8  # of an index: orbits with two mirrors touch b = −2 and turn back


def pair_indices(monodromy: Array) -> NDArray[np.complex128]:
    """Return both stability indices (2, N), the dominant one first; real unless complex-unstable.

    They are the roots of b² − σ b + ½(σ² − tr M² + 2 − 4) = 0 with σ = tr M − 2. If b = 2 is a
    root to within rounding, the other is σ − 2, free of the cancellation in the square root.
    """
    total = np.trace(monodromy) - 2.0
    squares = np.einsum("ijk,jik->k", monodromy, monodromy) + 2.0
    at_two = 4.0 - 2.0 * total + 0.5 * (total**2 - squares)
    other = total - 2.0
    neutral = np.abs(at_two) <= _NEUTRAL * np.maximum(1.0, np.abs(other - 2.0))
    root = np.sqrt((2.0 * squares - total**2).astype(complex))
    upper, lower = 0.5 * (total + root), 0.5 * (total - root)
    swap = np.abs(lower) > np.abs(upper)
    first = np.where(neutral, other, np.where(swap, lower, upper))
    second = np.where(neutral, 2.0, np.where(swap, upper, lower))
    return np.array([first, second], dtype=complex)


def spectrum(monodromy: Array) -> NDArray[np.complex128]:
    """Return the multipliers (6, N): λ, 1/λ of either pair, |λ| ≥ 1, and 1, 1."""
    b = pair_indices(monodromy)
    root = np.sqrt(b * b - 4.0)
    outer = 0.5 * np.where(np.abs(b + root) >= np.abs(b - root), b + root, b - root)
    ones = np.ones((2, b.shape[1]), dtype=complex)
    return np.concatenate([outer[:1], 1.0 / outer[:1], outer[1:], 1.0 / outer[1:], ones])


def excess(monodromy: Array) -> Array:
    """Return how far the orbit is from the edge of stability, (N,): negative inside.

    |b| − 2 of the worse pair that is not 1, 1 to within rounding; |Im b| under complex instability.
    The edge, where an index that touches it lies to within rounding, is 1e-8 beyond ±2.
    """
    b = pair_indices(monodromy)
    beyond = np.abs(b.real) - (2.0 + _CIRCLE)
    # a pair that is 1, 1 is on the edge always and says nothing
    worse = np.where(b[1] == 2.0, beyond[0], np.max(beyond, axis=0))
    tilt = np.max(np.abs(b.imag), axis=0)
    return np.asarray(np.where(tilt > _CIRCLE, tilt, worse))


def is_stable(monodromy: Array) -> NDArray[np.bool_]:
    """Whether no multiplier lies off the unit circle, (N,)."""
    return np.asarray(excess(monodromy) <= 0.0)
