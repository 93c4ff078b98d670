"""Linear stability of periodic orbits from their monodromy matrices.

Matrices are (n, n, N): n states (positions, then velocities), N orbits. The multipliers of a
conservative system come as 1, 1 and reciprocal pairs λ, 1/λ; the stability index of a pair is
b = λ + 1/λ, and |b| < 2 means that it lies on the unit circle.

References
----------
.. [1] Hénon, M., Vertical stability of periodic orbits in the restricted problem, Astron.
   Astrophys. 28, 1973, p. 415.
.. [2] Bray, T. A., Goudas, C. L., Doubly symmetric orbits about the collinear Lagrangian points,
   Astron. J. 72, 1967, p. 202 (indices from the traces of M and M²).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = [
    "determinant_error",
    "is_decoupled",
    "monodromy_of_half",
    "multipliers",
    "stability_indices",
]


def monodromy_of_half(half: Array, mirror: Sequence[int]) -> Array:
    """Monodromy matrix of a mirror-symmetric orbit from its first half.

    Parameters
    ----------
    half : ndarray, shape (n, n, N)
        State transition matrix from one perpendicular crossing to the next.
    mirror : sequence of int
        Diagonal of S, the sign of each state under time reversal.

    Returns
    -------
    ndarray, shape (n, n, N)
        M = S M_h⁻¹ S M_h.
    """
    sign = np.asarray(mirror, dtype=float)
    first = np.moveaxis(half, 2, 0)
    # M_h⁻¹ is not formed: a linear solve loses fewer digits for large multipliers
    second = sign[:, None] * np.linalg.solve(first, sign[:, None] * first)
    return np.ascontiguousarray(np.moveaxis(second, 0, 2))


def determinant_error(monodromy: Array) -> Array:
    """Return det M − 1 (N,); a conservative flow keeps the volume."""
    return np.asarray(np.linalg.det(np.moveaxis(monodromy, 2, 0)) - 1.0)


def multipliers(monodromy: Array) -> NDArray[np.complex128]:
    """Return the eigenvalues (n, N), those of largest modulus first."""
    values = np.linalg.eigvals(np.moveaxis(monodromy, 2, 0)).astype(complex)
    order = np.argsort(-np.abs(values), axis=1)
    return np.ascontiguousarray(np.take_along_axis(values, order, axis=1).T)


def is_decoupled(monodromy: Array, tolerance: float = 1e-9) -> NDArray[np.bool_]:
    """Whether motion along the third axis is separate from that in the plane, (N,)."""
    inside, outside = [0, 1, 3, 4], [2, 5]
    size = np.max(np.abs(monodromy), axis=(0, 1))
    mixed = np.maximum(
        np.max(np.abs(monodromy[np.ix_(inside, outside)]), axis=(0, 1)),
        np.max(np.abs(monodromy[np.ix_(outside, inside)]), axis=(0, 1)),
    )
    return np.asarray(mixed <= tolerance * size)


def stability_indices(monodromy: Array) -> tuple[Array, Array]:
    """Planar and vertical stability index of each orbit.

    Where the vertical motion is decoupled (a planar orbit in a field that is symmetric about the
    plane) b_planar = M00 + M11 + M33 + M44 − 2 and b_vertical = M22 + M55. Otherwise both are
    roots of b² − (tr M − 2) b + ½[(tr M − 2)² − tr M² − 2] = 0, and the one nearer to
    M22 + M55 is called vertical; a complex pair (complex instability) has no real index: NaN.

    Parameters
    ----------
    monodromy : ndarray, shape (6, 6, N) or (4, 4, N)
        Of states x, y, z, vx, vy, vz, or x, y, vx, vy.

    Returns
    -------
    planar, vertical : ndarray, shape (N,)
        Without dimension; vertical is NaN for a plant with a plane only.

    Raises
    ------
    InputError
        If the matrices have another size.
    """
    size = monodromy.shape[0]
    diagonal = monodromy[np.arange(size), np.arange(size)]
    if size == 4:
        return diagonal.sum(axis=0) - 2.0, np.full(monodromy.shape[2], np.nan)
    if size != 6:
        raise InputError(f"stability indices are defined for 4 or 6 states, got {size}")
    # index of each plane: the trace of its block, less 2 for the pair 1, 1 of the planar one
    vertical = diagonal[2] + diagonal[5]
    planar = diagonal[0] + diagonal[1] + diagonal[3] + diagonal[4] - 2.0
    # coupled motion: b₁ + b₂ = tr M − 2 and b₁² + b₂² = tr M² + 2, since λ² + 1/λ² = b² − 2
    total = diagonal.sum(axis=0) - 2.0
    squares = np.einsum("ijk,jik->k", monodromy, monodromy) + 2.0
    gap = 2.0 * squares - total**2  # (b1 − b2)²
    with np.errstate(invalid="ignore"):
        root = np.sqrt(gap)
    pair = np.array([0.5 * (total - root), 0.5 * (total + root)])
    upper_is_vertical = np.abs(pair[1] - vertical) < np.abs(pair[0] - vertical)
    separate = is_decoupled(monodromy)
    return (
        np.where(separate, planar, np.where(upper_is_vertical, pair[0], pair[1])),
        np.where(separate, vertical, np.where(upper_is_vertical, pair[1], pair[0])),
    )
