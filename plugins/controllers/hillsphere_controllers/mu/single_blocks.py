"""Lower bounds of µ from one block alone, with all other blocks zero.

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

_NEAR = 1e-3
"""Eigenvalues so near to each other, or to the real axis, relative, may be one of several Jordan
blocks: rounding parts a triple one by 1e-5."""
_SINGULAR = 1e-10
"""Smallest singular value of I − M/ρ, relative to the size of M/ρ, at which ρ counts as a real
eigenvalue."""


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
    perturbations = [single_block(m, structure, k) for k in range(len(structure.blocks))]
    made = [delta for delta in perturbations if delta is not None]
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
    value = _smallest_perturbation(part, structure.blocks[block], least)
    if value is None:
        return None
    delta = np.zeros_like(m)
    delta[span, span] = value
    return delta


def _smallest_perturbation(part: Complex, block: Block, least: float) -> Complex | None:
    if block.kind == "full":
        u, s, vh = np.linalg.svd(part)
        if not s[0] > least:
            return None
        # smallest Δ of a full block: v₁ u₁ᴴ/σ₁
        dyad: Complex = np.outer(vh[0].conj() / s[0], u[:, 0].conj())
        return dyad
    # smallest δ of a repeated scalar: 1/λ of the largest (real) eigenvalue
    values: Complex = np.linalg.eigvals(part).astype(complex)
    if block.kind == "real":
        values = _real_eigenvalues(part, values)
    if not np.abs(values).max(initial=0.0) > least:
        return None
    scalar: Complex = np.eye(len(part)) / values[int(np.argmax(np.abs(values)))] + 0j
    return scalar


def _real_eigenvalues(part: Complex, values: Complex) -> Complex:
    """Return the real eigenvalues (k,), and the means of clusters that rounding has split.

    A multiple eigenvalue without as many eigenvectors is found as several, most of them complex,
    about it; their mean is near to rounding. Only those are kept with which I − M/λ is singular.
    """
    kept = []
    for value in values:
        close = np.abs(values - value) <= _NEAR * abs(value)
        if abs(value.imag) > _NEAR * abs(value) or value == 0.0:
            continue
        for one in (float(values[close].mean().real), float(value.real)):
            if one == 0.0:
                continue
            product = part / one
            least = float(np.linalg.svd(np.eye(len(part)) - product, compute_uv=False)[-1])
            if least <= _SINGULAR * max(1.0, float(np.linalg.norm(product, 2))):
                kept.append(one)
                break
    return np.array(kept, dtype=complex)
