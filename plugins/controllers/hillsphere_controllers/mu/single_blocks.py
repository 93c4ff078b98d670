"""Perturbations of one block alone, all others zero: what µ is never below.

With Δ zero but for block k, det(I − M Δ) = det(I − M_kk Δ_k): the smallest such Δ_k is known
exactly, from the largest singular value of M_kk for a full block, and from an eigenvalue for a
repeated scalar. A search over all blocks together may end below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere_controllers.mu.blocks import Block, BlockStructure

__all__ = ["single_block", "single_blocks"]

Complex = NDArray[np.complex128]

_REAL = 1e-10


def single_blocks(m: Complex, structure: BlockStructure) -> list[Complex]:
    """Return a Δ with which I − M Δ is singular for every block that has one by itself.

    Parameters
    ----------
    m : ndarray, shape (n, n)
        Squared.
    structure : BlockStructure
        Of Δ.

    Returns
    -------
    list of ndarray, shape (n, n)
        Squared; the smallest first.
    """
    found = [single_block(m, structure, k) for k in range(len(structure.blocks))]
    made = [delta for delta in found if delta is not None]
    return sorted(made, key=lambda delta: float(np.linalg.norm(delta, 2)))


def single_block(m: Complex, structure: BlockStructure, block: int) -> Complex | None:
    """Return the smallest Δ of one block alone with which I − M Δ is singular.

    Parameters
    ----------
    m : ndarray, shape (n, n)
        Squared.
    structure : BlockStructure
        Of Δ.
    block : int
        Its number.

    Returns
    -------
    ndarray, shape (n, n), or None
        Squared, zero but for the block; None if what the block gains by itself is no more than the
        rounding of M, or a real scalar meets no real eigenvalue.
    """
    span = structure.spans()[block]
    part = m[span, span]
    least = len(m) * np.finfo(float).eps * float(np.linalg.norm(m, 2))
    value = _smallest(part, structure.blocks[block], least)
    if value is None:
        return None
    delta = np.zeros_like(m)
    delta[span, span] = value
    return delta


def _smallest(part: Complex, block: Block, least: float) -> Complex | None:
    if block.kind == "full":
        u, s, vh = np.linalg.svd(part)
        if not s[0] > least:
            return None
        dyad: Complex = np.outer(vh[0].conj() / s[0], u[:, 0].conj())
        return dyad
    values = np.linalg.eigvals(part)
    if block.kind == "real":
        values = values[np.abs(values.imag) <= _REAL * np.abs(values)].real
    if not np.abs(values).max(initial=0.0) > least:
        return None
    scalar: Complex = np.eye(len(part)) / values[int(np.argmax(np.abs(values)))] + 0j
    return scalar
