"""Starts for the lower bound of µ: the mixed power iteration, and the upper bound's direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.scalings import Scalings, dg_form, level

__all__ = ["power_iterations", "singular_direction"]

Complex = NDArray[np.complex128]

_STEPS = 40
"""Steps of a power iteration. Some cycle instead of converging; the best iterate is taken in any
case."""
_TINY = 1e-300
"""Length below which a vector has no direction: division by it would overflow."""


def singular_direction(m: Complex, structure: BlockStructure, scalings: Scalings) -> list[Complex]:
    """Return the Q that map a = M x into x for the direction x in which F is singular.

    Parameters
    ----------
    m : ndarray, shape (n, n)
        Squared.
    structure : BlockStructure
        Of Q.
    scalings : Scalings
        Of the upper bound.
    """
    everywhere = np.ones(len(m), dtype=bool)
    beta2 = level(m[None], scalings.d, scalings.g, everywhere, 1.0)
    if not np.isfinite(beta2):
        return []
    # at the least β F is singular: its null vector x satisfies the conditions of a worst Q
    f = beta2 * scalings.d - dg_form(m, scalings.d, scalings.g)
    _, vectors = np.linalg.eigh(f)
    beta = np.sqrt(max(beta2, 0.0))
    made = []
    for x in vectors[:, : min(2, len(m))].T:
        a = m @ x
        blocks: list[complex | Complex] = []
        for span, block in zip(structure.spans(), structure.blocks, strict=True):
            into, out = a[span], x[span]
            inner = np.vdot(into, out)
            if block.kind == "real":
                # least squares of q a = β x over real q
                share = beta * inner.real / max(np.vdot(into, into).real, _TINY)
                blocks.append(complex(np.clip(share, -1.0, 1.0)))
            elif block.kind == "complex":
                blocks.append(inner / max(abs(inner), _TINY) if abs(inner) > _TINY else 1.0)
            else:
                blocks.append(_dyad(out, into))
        made.append(structure.perturbation(blocks))
    return made


def _dyad(out: Complex, into: Complex) -> Complex:
    size = np.linalg.norm(out) * np.linalg.norm(into)
    if not size > _TINY:
        made = np.zeros((out.size, into.size), dtype=complex)
        made[0, 0] = 1.0
        return made
    return np.outer(out, into.conj()) / size


def power_iterations(
    m: Complex, structure: BlockStructure, random: np.random.Generator, starts: int
) -> list[Complex]:
    """Return the last Q, and that of the largest eigenvalue, of some power iterations.

    Parameters
    ----------
    m : ndarray, shape (n, n)
        Squared, not zero.
    structure : BlockStructure
        Of Q.
    random : numpy.random.Generator
        For the starts.
    starts : int
        How many.
    """
    n = len(m)
    made: list[Complex] = []
    for _ in range(starts):
        b, w = (v / np.linalg.norm(v) for v in random.normal(size=(2, n, 2)) @ (1.0, 1j))
        q_real = random.uniform(-1.0, 1.0, len(structure.blocks))
        best: tuple[float, Complex] | None = None
        q = np.zeros_like(m)
        before = 0.0
        for _ in range(_STEPS):
            # Young and Doyle (1990): β a = M b, z from a and w, β w = Mᴴ z, b = Q a
            a = m @ b
            size = float(np.linalg.norm(a))
            if size <= _TINY:
                break
            a /= size
            z = _apply_adjoint(structure, q_real, a, w)
            w = m.conj().T @ z
            other = float(np.linalg.norm(w))
            if other <= _TINY:
                break
            w /= other
            q, q_real = _update_perturbation(structure, q_real, a, w)
            b = q @ a
            largest = float(np.linalg.norm(b))
            if largest <= _TINY:
                break
            b /= largest
            if best is None or size > best[0]:
                best = (size, q)
            # both vectors grow by the same factor, which no longer changes: an eigenvalue
            if abs(size - other) + abs(size - before) < 1e-9 * size:
                break
            before = size
        if best is not None:
            made.append(q)
            if best[1] is not q:
                made.append(best[1])
    return made


def _apply_adjoint(
    structure: BlockStructure, q_real: NDArray[np.float64], a: Complex, w: Complex
) -> Complex:
    """Return z: Qᴴ applied to w in the direction of a."""
    z = np.empty_like(a)
    for k, (span, block) in enumerate(zip(structure.spans(), structure.blocks, strict=True)):
        inner = np.vdot(w[span], a[span])
        if block.kind == "real":
            z[span] = q_real[k] * w[span]
        elif block.kind == "complex":
            z[span] = w[span] * (inner / abs(inner) if abs(inner) > _TINY else 1.0)
        else:
            size = float(np.linalg.norm(a[span]))
            z[span] = a[span] * (np.linalg.norm(w[span]) / size if size > _TINY else 1.0)
    return z


def _update_perturbation(
    structure: BlockStructure, q_real: NDArray[np.float64], a: Complex, w: Complex
) -> tuple[Complex, NDArray[np.float64]]:
    """Return Q of the directions a and w, and its real scalars."""
    blocks: list[complex | Complex] = []
    real = q_real.copy()
    for k, (span, block) in enumerate(zip(structure.spans(), structure.blocks, strict=True)):
        inner = np.vdot(a[span], w[span])
        if block.kind == "real":
            # step of the real scalar along its gradient, cut off at its range
            real[k] = np.clip(real[k] + inner.real * len(a), -1.0, 1.0)
            blocks.append(complex(real[k]))
        elif block.kind == "complex":
            blocks.append(complex(inner / abs(inner)) if abs(inner) > _TINY else 1.0)
        else:
            blocks.append(_dyad(w[span], a[span]))
    return structure.perturbation(blocks), real
