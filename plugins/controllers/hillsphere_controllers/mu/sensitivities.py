"""How much each block has to do with µ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.upper_bound import upper_bound

__all__ = ["sensitivities"]

Complex = NDArray[np.complex128]

_STEP = 2e-3
_TOLERANCE = 1e-9


def sensitivities(matrix: Complex | Array, structure: BlockStructure) -> Array:
    """Return the relative change of µ's upper bound with the size of each block.

    By central differences of bounds solved anew. µ is proportional to the size of all blocks
    together, so that they sum to one: each is the block's share.

    Parameters
    ----------
    matrix : ndarray, shape (p, m)
        M, such as that of a system at the frequency of the peak.
    structure : BlockStructure
        With k blocks.

    Returns
    -------
    ndarray, shape (k,)
        d log µ / d log of the block's size.

    Raises
    ------
    InputError
        If the matrix does not fit the structure, or µ is zero, which has no shares.
    """
    squared = structure.squared(matrix)
    square = BlockStructure([b.squared() for b in structure.blocks])
    here = upper_bound(squared, square, tolerance=_TOLERANCE)
    if here.value <= 1e-12 * float(np.linalg.norm(squared)):
        raise InputError("µ is zero: no block has a share of it")
    made = np.empty(len(structure.blocks))
    for k, span in enumerate(structure.spans()):
        logs = []
        for step in (_STEP, -_STEP):
            scaled = squared.copy()
            scaled[span] *= np.exp(step)
            found = upper_bound(scaled, square, start=here.scalings, tolerance=_TOLERANCE)
            logs.append(np.log(found.value))
        made[k] = (logs[0] - logs[1]) / (2.0 * _STEP)
    return made
