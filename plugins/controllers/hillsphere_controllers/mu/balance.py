r"""Units in which a matrix that Δ closes has rows and columns of about the same size.

A diagonal T of the structure's form commutes with every Δ: T M T⁻¹ has the µ of M. Where blocks
have very different units M is far larger than µ, and of the digits of a search in M's own units few
are left for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["balance", "level_units"]

Complex = NDArray[np.complex128]

_SWEEPS = 100
_EVEN = 0.05
"""Of the logarithm of a column's square over that of its row."""
_APART = float(np.log(1e-9))
"""What feeds nothing back becomes so small relative to what does."""
_FARTHEST = 115.0
"""Of log T: D = T² stays within 1e±100."""


def balance(m: Complex | Array, structure: BlockStructure) -> Array:
    """Return the T with which rows and columns of T M T⁻¹ are alike, the diagonal left out.

    The sum of the squares of T M T⁻¹ is a convex function of log T. It is lowered for all rows at
    once by half of what each alone would ask for, under which it never rises; of parts that feed
    nothing back to each other it has no minimum, and those are moved apart [1]_.

    Parameters
    ----------
    m : ndarray, shape (K, n, n)
        Squared; of several matrices the sum of squares is balanced.
    structure : BlockStructure
        Of Δ.

    Returns
    -------
    ndarray, shape (n,)
        T, positive, the same on all of a full block; its squares sum to n.

    References
    ----------
    .. [1] E. E. Osborne (1960), On pre-conditioning of matrices, Journal of the ACM 7, 338-345.
    """
    starts = [
        k
        for span, block in zip(structure.spans(), structure.blocks, strict=True)
        for k in range(span.start, span.start + 1 if block.kind == "full" else span.stop)
    ]
    squares = np.sum(np.abs(m / max(float(np.abs(m).max()), 1e-300)) ** 2, axis=0)
    whole = np.add.reduceat(np.add.reduceat(squares, starts, axis=0), starts, axis=1)
    with np.errstate(divide="ignore"):
        weight = np.log(whole)
    own = np.diagonal(weight).copy()
    np.fill_diagonal(weight, -np.inf)
    count, part = connected_components(np.isfinite(weight), connection="strong")
    inside = np.where(part[:, None] == part, weight, -np.inf)
    logs = np.zeros(len(starts))
    linked = np.isfinite(inside).any(axis=1)
    for _ in range(_SWEEPS if linked.any() else 0):
        now = inside + 2.0 * (logs[:, None] - logs)
        rows, columns = np.logaddexp.reduce(now, axis=1), np.logaddexp.reduce(now, axis=0)
        uneven = np.where(linked, columns, 0.0) - np.where(linked, rows, 0.0)
        logs += 0.125 * uneven
        if np.abs(uneven).max() < _EVEN:
            break
    if count > 1:
        logs += _apart(weight + 2.0 * (logs[:, None] - logs), own, part, count)
    logs -= 0.5 * (logs.max() + logs.min())
    made = np.exp(np.clip(logs, -_FARTHEST, _FARTHEST))
    made = np.repeat(made, np.diff([*starts, structure.size]))
    return np.asarray(made * np.sqrt(structure.size / np.sum(made**2)))


def _apart(weight: Array, own: Array, part: NDArray[np.int32], count: int) -> Array:
    """Return what to add to log T (k,), for log squares: nothing within parts, which feed forward.

    What leads from one part to another comes to be far below what is within them.
    """
    across = np.full((count, count), -np.inf)
    np.maximum.at(across, (part[:, None], part), weight)
    largest = max(float(own.max()), float(np.diagonal(across).max()))
    np.fill_diagonal(across, -np.inf)
    if not np.isfinite(largest):
        largest = float(across.max())
    if not np.isfinite(largest):
        return np.zeros(len(part))
    need = 0.5 * (across - largest) - _APART
    logs = np.zeros(count)
    for _ in range(count):  # the longest way there
        more = np.maximum(logs, (logs[:, None] + need).max(axis=0))
        if np.array_equal(more, logs):
            break
        logs = more
    return np.asarray((logs * min(1.0, _FARTHEST / max(float(logs.max()), 1.0)))[part])


def level_units(m: Complex, structure: BlockStructure, free: NDArray[np.bool_]) -> Array:
    """Return units of the levels in which M's norm is one.

    In a skewed problem the level of some blocks is one and that of the others may be in any unit:
    those are taken in which both are of comparable size, and the norm of T M T⁻¹.

    Parameters
    ----------
    m : ndarray, shape (K, n, n)
        Squared.
    structure : BlockStructure
        Of Δ.
    free : ndarray of bool, shape (n,)
        Indices of the blocks whose size the bound is about.

    Returns
    -------
    ndarray, shape (n,)
        The same for all free ones: about what the matrix gains there, with and without the way
        through the others. Zeros for a matrix of zeros.
    """
    unit, x = np.ones(len(free)), m
    if not free.all():
        x = _balanced(m, structure)

        def norm(rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> float:
            return float(np.linalg.norm(x[:, rows][:, :, columns], 2, axis=(1, 2)).max())

        inner = max(norm(~free, ~free), 1.0)
        gained = norm(free, free) + norm(free, ~free) * norm(~free, free) / inner
        if gained > 0.0:
            unit[free] = gained / inner
        x = _balanced(m / unit, structure)
    return np.asarray(unit * np.linalg.norm(x, 2, axis=(1, 2)).max())


def _balanced(m: Complex, structure: BlockStructure) -> Complex:
    root = balance(m, structure)
    return np.asarray(root[:, None] * m / root)
